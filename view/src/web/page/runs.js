// The runs of the cell, as `quadrant runs` lists them: read when they are asked for, the newest first.

import { getJson } from "./stream.js";

const $ = id => document.getElementById(id);

function row(run, { element, fixed }) {
  const made = element("tr");
  const angle = run.following_error_um === null && run.following_error_mdeg !== null;
  const cells = [
    new Date(run.began).toLocaleString(), run.program ?? run.run.split("/").pop(), run.under_way ? "under way" : run.outcome ?? "–",
    `${fixed(run.took_s, 1)} s`, `${fixed(run.contour_error_um, 1)} µm`,
    angle ? `${fixed(run.following_error_mdeg, 1)} mdeg` : `${fixed(run.following_error_um, 1)} µm`,
    `${fixed(run.bytes / 1e6, 1)} MB`, run.marked === null ? "" : `★ ${run.marked}`,
  ];
  made.append(...cells.map(text => element("td", text)));
  made.title = run.run;
  made.dataset.outcome = run.outcome ?? "";
  return made;
}

// `tools` make elements and write numbers as the rest of the page has them.
export function prepare(token, tools) {
  $("show-runs").onclick = async () => {
    $("runs-none").textContent = "reading…";
    $("run-rows").replaceChildren();
    $("runs").showModal();
    try {
      const runs = await getJson("runs", token());
      $("run-rows").replaceChildren(...runs.map(run => row(run, tools)));
      $("runs-none").textContent = runs.length ? "" : "None yet. A cell that `quadrant up` started lists every program it has run.";
    } catch (error) {
      $("runs-none").textContent = `The runs cannot be read: ${error.message}`;
    }
  };
}

// The runs of the cell, as `quadrant runs` lists them: read when they are asked for, the newest first.

import { getJson } from "./stream.js";

const $ = id => document.getElementById(id);
const number = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits));

function row(run) {
  const made = document.createElement("tr");
  const angle = run.following_error_um === null && run.following_error_mdeg !== null;
  const cells = [
    new Date(run.began).toLocaleString(), run.program ?? run.run.split("/").pop(), run.under_way ? "under way" : run.outcome ?? "–",
    `${number(run.took_s, 1)} s`, `${number(run.contour_error_um, 1)} µm`,
    angle ? `${number(run.following_error_mdeg, 1)} mdeg` : `${number(run.following_error_um, 1)} µm`,
    `${number(run.bytes / 1e6, 1)} MB`, run.marked === null ? "" : `★ ${run.marked}`,
  ];
  for (const text of cells) {
    const cell = document.createElement("td");
    cell.textContent = text;
    made.append(cell);
  }
  made.title = run.run;
  made.dataset.outcome = run.outcome ?? "";
  return made;
}

export function prepare(token) {
  $("show-runs").onclick = async () => {
    $("runs-none").textContent = "reading…";
    $("run-rows").replaceChildren();
    $("runs").showModal();
    try {
      const runs = await getJson("runs", token());
      $("run-rows").replaceChildren(...runs.map(row));
      $("runs-none").textContent = runs.length ? "" : "None yet. A cell that `quadrant up` started lists every program it has run.";
    } catch (error) {
      $("runs-none").textContent = `The runs cannot be read: ${error.message}`;
    }
  };
}

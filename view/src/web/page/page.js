// The page: each frame is the whole state of the cell; what is on the screen is that of the newest frame, and nothing else.

import { CirclePicture, PathPicture, VIEWS } from "./pictures.js";
import * as orders from "./orders.js";
import * as runs from "./runs.js";
import * as signals from "./signals.js";
import { follow, getJson } from "./stream.js";

const $ = id => document.getElementById(id);
const CATCH_UP_MS = 500;

const path = new PathPicture($("path-picture"), $("path-legend"));
const circle = new CirclePicture($("circle-picture"), $("circle-title"), $("circle-legend"));
const state = { machine: null, session: 0, path: -1, trail: -1, next: 0, catching: false, caught: 0, heard: 0, eventsKey: "", reversalsKey: "" };
// What a test, or somebody who wonders, can read: frames shown, and when each death was on the screen.
window.quadrant = { frames: 0, first_ms: 0, last_ms: 0, first_scan: 0, last_scan: 0, missed: 0, number: 0, deaths: {} };

function element(name, text, attributes = {}) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

const put = (place, text) => { if (place.textContent !== text) place.textContent = text; };
const fixed = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1").replace("-", "−"));
const time = scan => (state.machine ? (scan * state.machine.period_us) / 1e6 : 0);

// --- header

function header(frame) {
  const { status } = frame;
  const { says } = status;
  $("state").dataset.tone = says.tone;
  put($("symbol"), says.symbol);
  put($("state-word"), says.state);
  put($("detail"), says.detail);
  put($("next"), status.next.replace(/`(?:quadrant )?([^`]*)`/g, "$1"));
  put($("cell"), status.cell);
  const title = `${says.symbol} ${says.state} · ${status.cell}`;
  if (document.title !== title) document.title = title;
}

// --- axes

function axisRows(machine) {
  $("axes").replaceChildren(...machine.axes.map(({ axis }) => {
    const row = element("tr", undefined, { "data-axis": axis });
    const cell = (kind, ...children) => { const made = element("td", undefined, { class: kind }); made.append(...children); return made; };
    const bar = () => { const made = element("span", undefined, { class: "bar" }); made.append(element("i")); return made; };
    const buttons = [["−", -1], ["+", 1]].map(([sign, direction]) => {
      const button = element("button", sign, { type: "button", "aria-label": `Jog ${axis} ${direction < 0 ? "minus" : "plus"}` });
      button.onclick = () => orders.jog(axis, direction);
      return button;
    });
    const zero = element("button", "0", { type: "button", "aria-label": `Zero ${axis}`, title: `${axis} reads 0 here` });
    zero.onclick = () => orders.zero(axis);
    const name = element("td", axis);
    row.append(
      name,
      cell("", element("span", "", { class: "position" }), element("span", "", { class: "unit" }), element("span", "", { class: "second" })),
      cell("error", element("span", ""), bar()),
      cell("more torque", element("span", ""), bar(), element("span", "", { class: "second" })),
      cell("jog", buttons[0], " ", buttons[1], " ", zero),
    );
    return row;
  }));
}

function level(bar, share) {
  const size = Math.min(1, Math.abs(share) || 0);
  bar.className = `bar${size > 0.9 ? " bad" : size > 0.6 ? " warn" : ""}`;
  bar.firstChild.style.width = `${(size * 100).toFixed(1)}%`;
}

function axes(frame) {
  frame.status.axes.forEach((axis, index) => {
    const row = $("axes").children[index];
    const limits = state.machine.axes[index];
    if (!row || !limits) return;
    const [, position, error, torque] = row.children;
    const work = axis.work_mm ?? axis.work_deg;
    const goes = axis.distance_to_go_mm ?? axis.distance_to_go_deg;
    put(position.children[0], fixed(work ?? axis.feedback_mm ?? axis.feedback_deg, 3));
    put(position.children[1], axis.unit);
    const second = [`machine ${fixed(axis.machine_mm ?? axis.machine_deg, 3)}`];
    if (goes !== undefined && goes !== null) second.push(`to go ${fixed(goes, 3)}`);
    if (!["absolute", "homed"].includes(axis.reference)) second.push(axis.reference);
    if (axis.alarm) second.push(axis.alarm);
    put(position.children[2], second.join("   "));
    const unit = axis.unit === "deg" ? "mdeg" : "µm";
    const off = axis.following_error_um ?? axis.following_error_mdeg;
    put(error.children[0], `${fixed(off, 1)} ${unit}`);
    level(error.children[1], off / (limits.following_error_limit_um ?? limits.following_error_limit_mdeg));
    put(torque.children[0], `${fixed(axis.torque_percent, 0)} %${axis.torque_limited ? " limit" : ""}`);
    level(torque.children[1], axis.torque_percent / 100);
    const quantities = state.machine.quantities.map(({ key, heading, unit, decimals }) => `${heading} ${fixed(axis[key], decimals)} ${unit}`);
    put(torque.children[2], quantities.join("   "));
  });
}

function numbers(frame) {
  const { status } = frame;
  const linear = status.axes.filter(axis => axis.unit === "mm");
  const readout = status.readout ?? {};
  const feed = readout.feed_mm_min ?? readout.feed_deg_min ?? Math.hypot(...linear.map(axis => axis.velocity_mm_s)) * 60;
  const programmed = readout.programmed_feed_mm_min ?? readout.programmed_feed_deg_min;
  const wanted = readout.rapid ? " of rapid" : programmed ? ` of ${Math.round(programmed)}` : "";
  const unit = readout.feed_deg_min === undefined ? "mm/min" : "deg/min";
  const shown = [["Feed", `${Math.round(feed)}${wanted} ${unit}`], ["Override", `${status.override_percent ?? "–"} %`]];
  if (readout.work_offset) shown.push(["Offset", readout.work_offset]);
  if (status.auxiliary && status.auxiliary.spindle !== "stopped") shown.push(["Spindle", status.auxiliary.spindle]);
  if (status.auxiliary?.tool) shown.push(["Tool", `T${status.auxiliary.tool}`]);
  if (status.auxiliary?.flood || status.auxiliary?.mist) shown.push(["Coolant", [status.auxiliary.flood && "flood", status.auxiliary.mist && "mist"].filter(Boolean).join(", ")]);
  if (status.auxiliary?.waiting) shown.push(["Waits for", status.auxiliary.waiting]);
  if (status.overrun_scans) shown.push(["Scans late", `${status.overrun_scans}`]);
  const place = $("numbers");
  const key = shown.map(([name]) => name).join();
  if (place.dataset.key !== key) {
    place.dataset.key = key;
    place.replaceChildren(...shown.map(([name]) => { const pair = element("div"); pair.append(element("dt", name), element("dd")); return pair; }));
  }
  shown.forEach(([, value], index) => put(place.children[index].children[1], value));
}

// --- program

function program(frame) {
  const { program: now, messages } = frame.status;
  put($("program-name"), now.name ?? (now.state === "none" || !now.state ? "no program is loaded" : "program"));
  put($("percent"), now.percent === null || now.state === "none" ? "" : `${fixed(now.percent, 1)} %`);
  $("done").value = now.percent ?? 0;
  const left = frame.status.readout?.time_left_s;
  const minutes = left === null || left === undefined ? "" : `${Math.floor(left / 60)}:${String(Math.floor(left % 60)).padStart(2, "0")} left`;
  put($("left"), now.state === "running" ? minutes : "");
  put($("codes"), (frame.status.readout?.active_codes ?? []).join(" "));
  put($("line"), now.line ? `line ${now.line}` : "");
  put($("text"), now.block ?? "");
  signals.show(frame.status, { element, fixed });
  const key = messages.map(message => message.number).join();
  if ($("messages").dataset.key !== key) {
    $("messages").dataset.key = key;
    $("messages").replaceChildren(...messages.slice(-2).map(message => element("li", message.line ? `line ${message.line}: ${message.text}` : message.text)));
  }
}

// --- processes, reversals, events

function processes(frame) {
  const all = frame.status.processes;
  const list = $("process-list");
  const shown = all.map(process => {
    const dead = process.live ? null : process.last_death;
    const words = [];
    if (process.drives === true) words.push("drives");
    else if (process.live && process.standby) words.push(process.standby === "synchronised" ? "standby" : `standby: ${process.standby}`);
    if (process.starts > 1) words.push(`start ${process.starts}`);
    if (process.live && process.pid) words.push(`pid ${process.pid}`);
    const last = process.last_death;
    const died = last ? `${last.signal ? `signal ${last.signal}` : "ended"} at ${fixed(time(last.scan), 1)} s` : "";
    return { name: process.process, mark: process.live ? (process.stalled ? "stalled" : "lives") : "dead", words: words.join(", "), died };
  });
  const key = JSON.stringify(shown);
  if (list.dataset.key !== key) {
    list.dataset.key = key;
    list.replaceChildren(...shown.map(({ name, mark, words, died }) => {
      const item = element("li", undefined, { "data-state": mark, "data-process": name });
      item.append(element("b", `${mark === "dead" ? "✖ " : ""}${name}`), element("span", words || mark));
      if (died) item.append(element("em", died));
      return item;
    }));
    const dead = shown.filter(({ mark }) => mark === "dead").length;
    put($("process-count"), dead ? `${dead} of ${shown.length} dead` : `${shown.length} live`);
  }
  for (const { process, last_death: death } of all) {
    if (death) {
      const seen = (window.quadrant.deaths[process] ??= {});
      seen[death.scan] ??= { shown_ms: Date.now(), scan: frame.status.scan };
    }
  }
}

function reversals(frame) {
  const key = `${frame.session} ${frame.reversals_seen}`;
  if (key === state.reversalsKey) return;
  state.reversalsKey = key;
  put($("reversals-count"), frame.reversals_seen ? `${frame.reversals_seen} seen` : "none seen");
  $("reversal-rows").replaceChildren(...frame.reversals.map(reversal => {
    const row = element("tr");
    const cells = [
      `${reversal.axis} ${reversal.new_direction > 0 ? "+" : "−"}`, `${fixed(time(reversal.scan), 2)} s`,
      reversal.height_um === null ? "–" : `${fixed(reversal.height_um, 1)} µm`,
      reversal.undercut_um === null ? "–" : `${fixed(reversal.undercut_um, 1)} µm`,
      reversal.following_error_peak_mdeg === undefined
        ? `${fixed(reversal.following_error_peak_um, 1)} µm`
        : `${fixed(reversal.following_error_peak_mdeg, 1)} mdeg`,
    ];
    row.append(...cells.map(text => element("td", text)));
    return row;
  }));
}

function events(frame) {
  const key = `${frame.session} ${frame.events.map(event => `${event.number}${event.event}`).join()}`;
  if (key === state.eventsKey) return;
  state.eventsKey = key;
  $("event-list").replaceChildren(...frame.events.map(event => {
    const item = element("li");
    if (event.warning) item.dataset.warning = "";
    item.append(element("time", `${fixed(time(event.scan), 2)} s`), element("span", `${event.warning ? "⚠ " : ""}${event.event}`));
    return item;
  }));
}

// --- pictures

async function catchUp(frame) {
  if (state.catching || performance.now() - state.caught < CATCH_UP_MS) return;
  state.catching = true;
  state.caught = performance.now();
  try {
    if (frame.drawn.path !== state.path) {
      path.setPath((await getJson("path", orders.token())).stretches);
      state.path = frame.drawn.path;
    }
    const trail = await getJson("trail", orders.token());
    path.clearTrail();
    path.add(trail.points);
    state.trail = trail.trail;
    state.next = trail.first + trail.points.length;
  } catch { /* the next frame tries again */ }
  state.catching = false;
}

function pictures(frame) {
  if (frame.circle) circle.set(frame.circle);
  path.setTool(frame.tool);
  const { drawn, points } = frame;
  const skip = state.next - drawn.first;
  const follows = drawn.path === state.path && drawn.trail === state.trail && skip >= 0;
  if (!follows) return catchUp(frame);
  if (skip < points.length) {
    path.add(points.slice(skip));
    state.next = drawn.first + points.length;
  }
}

function drawAll() {
  path.draw();
  circle.draw();
  requestAnimationFrame(drawAll);
}

function viewButtons() {
  const group = document.querySelector(".views");
  const choose = name => {
    if (name) path.look(name, true);
    for (const button of group.children) button.setAttribute("aria-checked", `${button.dataset.view === path.view}`);
  };
  for (const [name, view] of Object.entries(VIEWS)) {
    const button = element("button", view.label, { type: "button", role: "radio", "data-view": name });
    button.onclick = () => choose(name);
    group.append(button);
  }
  const keys = Object.keys(VIEWS);
  path.chose = () => choose();
  document.addEventListener("keydown", event => {
    if (event.target instanceof HTMLInputElement || event.ctrlKey || event.altKey || event.metaKey) return;
    const name = keys[Number(event.key) - 1];
    if (name) choose(name);
    if (event.key === "l") theme(true);
  });
}

function theme(other) {
  const root = document.documentElement;
  const light = () => (root.dataset.theme ? root.dataset.theme === "light" : matchMedia("(prefers-color-scheme: light)").matches);
  let chosen = localStorage.getItem("quadrant-theme");
  if (other) {
    chosen = light() ? "dark" : "light";
    localStorage.setItem("quadrant-theme", chosen);
  }
  if (chosen) root.dataset.theme = chosen;
  path.dirty = circle.dirty = true;
}

// --- the stream

async function begin(frame) {
  state.session = frame.session;
  Object.assign(state, { path: -1, trail: -1, next: 0, eventsKey: "", reversalsKey: "" });
  circle.set(null);
  const machine = await getJson("machine", orders.token());
  state.machine = machine;
  put($("machine"), machine.machine === machine.cell ? `${machine.axes.length} axes` : machine.machine);
  axisRows(machine);
  orders.begin(machine);
}

let beginning = null;

function show(frame) {
  if (frame.session !== state.session || !state.machine) {
    beginning ??= begin(frame).catch(() => { state.session = 0; }).finally(() => { beginning = null; });
    return;
  }
  header(frame);
  axes(frame);
  numbers(frame);
  program(frame);
  processes(frame);
  reversals(frame);
  events(frame);
  pictures(frame);
  orders.seen(frame.status);
  const period = frame.period_us ? ` · scan period ${frame.period_us[0]} µs, longest ${frame.period_us[2]} µs` : "";
  put($("clock"), `${fixed(frame.status.time_s, 1)} s, scan ${frame.status.scan ?? "–"}`);
  put($("footer"), `${frame.status.pace ?? ""}${period} · scans not seen ${frame.scans_not_seen}`);
  const seen = window.quadrant;
  if (seen.number && frame.frame > seen.number + 1) seen.missed += frame.frame - seen.number - 1;
  seen.number = frame.frame;
  seen.frames += 1;
  seen.last_ms = Date.now();
  seen.last_scan = frame.status.scan;
  if (seen.frames === 1) { seen.first_ms = seen.last_ms; seen.first_scan = seen.last_scan; }
  document.documentElement.dataset.frames = seen.frames;
}

function link(how, why) {
  const root = document.documentElement;
  const place = $("link");
  if (how === "open") {
    state.heard = performance.now();
    if (root.dataset.link !== "open") { root.dataset.link = "open"; place.hidden = true; state.session = 0; }
    return;
  }
  root.dataset.link = "lost";
  const age = state.heard ? `what is shown is ${((performance.now() - state.heard) / 1000).toFixed(0)} s old` : "nothing has been shown yet";
  put(place, how === "token" ? why : `NO CONNECTION: ${why}; ${age}. The machine does not depend on this page.`);
  place.hidden = false;
  $("state").dataset.tone = "bad";
}

orders.prepare();
runs.prepare(orders.token, { element, fixed });
signals.prepare();
viewButtons();
theme(false);
const resized = new ResizeObserver(() => { path.dirty = circle.dirty = true; });
for (const picture of [path, circle]) resized.observe(picture.canvas);
requestAnimationFrame(drawAll);
follow(orders.token, show, link);

// Orders: only with the token, which comes behind the address (#token=…) or from the field, and stays in this tab.

const KEY = "quadrant-token";
const RAPIDS = [100, 50, 25, 5];
const JOGS = [100, 50, 25, 10];
const ANSWER_MS = 10000;

const $ = id => document.getElementById(id);
const increments = {}; // of a unit: the one that is chosen
const units = {}; // of an axis: the unit of its increments
const session = crypto.getRandomValues(new Uint32Array(1))[0] || 1;
const clicks = []; // given and not sent yet
let clicked = 0;
let clicking = false;
let notTaken = 0;
let scanSeen = 0;
let jogsSeen = 100;
let tripped = () => false;
let overrideSeen = 100;
let rapidsSeen = 100;
let singleBlock = false;
let overrideWanted = null;
let overrideSending = false;
let cleared;

export function token() {
  return sessionStorage.getItem(KEY) || "";
}

function takeToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (given) {
    sessionStorage.setItem(KEY, given.trim());
    // It is to stand in no history and on no screen.
    history.replaceState(null, "", location.pathname);
  }
}

export function answer(tone, words) {
  const place = $("answer");
  place.dataset.tone = tone;
  place.textContent = words;
  clearTimeout(cleared);
  cleared = setTimeout(() => { place.textContent = ""; }, ANSWER_MS);
}

function shown() {
  const has = token() !== "";
  $("pad").hidden = !has;
  $("token-form").hidden = has;
  document.body.toggleAttribute("data-orders", has);
}

async function confirmed(words) {
  const dialog = $("confirm");
  $("confirm-text").textContent = words;
  dialog.returnValue = "no";
  dialog.showModal();
  await new Promise(done => dialog.addEventListener("close", done, { once: true }));
  return dialog.returnValue === "yes";
}

function named(order) {
  return [order.order, order.axis, order.distance, order.percent, order.on].filter(part => part !== undefined).join(" ");
}

export async function send(order, words = saidOf) {
  const name = named(order);
  answer("waits", `${name} …`);
  try {
    const response = await fetch("order", {
      method: "POST",
      headers: { "Content-Type": "application/json", Authorization: `Bearer ${token()}` },
      body: JSON.stringify(order),
    });
    answer(...words(response, (await response.text()).trim() || name));
    if (response.status === 401 || response.status === 403) {
      sessionStorage.removeItem(KEY);
      shown();
    }
    return response.ok;
  } catch {
    answer("bad", `${name}: the server is not reached: not given, or nobody knows`);
    return undefined;
  }
}

async function give(order) {
  if (token() === "") return answer("waits", "orders need the token");
  const asks = {
    stop: "Stop the machine? The tool comes to rest on the path.",
    home: "Home? Axes move.",
    start: "Start the program that is loaded? Axes move.",
    reset: "Reset? The rest of the program is given up; it stays loaded.",
    resume: tripped() ? "Resume after a trip? Drives come on and axes move." : null,
  };
  if (asks[order] && !await confirmed(asks[order])) return answer("waits", `${order}: not given`);
  send({ order });
}

// Steps that come faster than answers are one order.
async function override(percent) {
  if (token() === "") return;
  overrideWanted = Math.min(200, Math.max(0, percent));
  $("override-value").textContent = `${overrideWanted} %`;
  if (overrideSending) return;
  overrideSending = true;
  while (overrideWanted !== null) {
    const now = overrideWanted;
    const obeyed = await send({ order: "override", percent: now });
    if (overrideWanted === now || !obeyed) overrideWanted = null;
  }
  overrideSending = false;
}

// The next step below the one that is in force; from the last, all of it again.
function rapids() {
  if (token() === "") return;
  const percent = RAPIDS.find(step => step < rapidsSeen) ?? RAPIDS[0];
  send({ order: "rapid-override", percent });
}

// The override of jogs; the next step below the one in force, and from the last all of it again.
function jogs() {
  if (token() === "") return;
  const percent = JOGS.find(step => step < jogsSeen) ?? JOGS[0];
  send({ order: "jog-override", percent });
}

function blocks() {
  if (token() !== "") send({ order: "single-block", on: !singleBlock });
}

export async function zero(axis) {
  const words = `Zero ${axis}? It reads 0 where it is, from the next start on.`;
  if (await confirmed(words)) send({ order: "zero", axis });
}

export function seen(status) {
  rapidsSeen = status.rapid_override_percent ?? rapidsSeen;
  singleBlock = status.single_block ?? singleBlock;
  scanSeen = status.scan ?? scanSeen;
  jogsSeen = status.jog_override_percent ?? jogsSeen;
  $("jogs").textContent = `${jogsSeen} %`;
  $("rapids").firstChild.data = `${rapidsSeen} % `;
  $("blocks").firstChild.data = `Blocks ${singleBlock ? "on" : "off"} `;
  $("blocks").setAttribute("aria-pressed", `${singleBlock}`);
  tripped = () => status.mode === "tripped";
  overrideSeen = status.override_percent ?? overrideSeen;
  if (overrideWanted === null) $("override-value").textContent = `${overrideSeen} %`;
}

// Each click has a number, and goes when the one before is answered: however often one is sent, it counts once, and old ones are refused.
export async function jog(axis, direction) {
  const of = increments[units[axis]];
  if (token() === "" || !of) return;
  clicks.push({ order: "jog", axis, distance: direction * of.chosen.way, session, click: ++clicked, seen: scanSeen });
  if (clicking) return;
  clicking = true;
  while (clicks.length) {
    const click = clicks.shift();
    if (await send(click, saidOfClick) === undefined) await send(click, saidOfClick);
  }
  clicking = false;
}

function saidOf(response, words) {
  return [response.ok ? "good" : "bad", words];
}

function saidOfClick(response, words) {
  if (!words.startsWith("not taken")) {
    notTaken = 0;
    return saidOf(response, words);
  }
  notTaken += 1;
  return ["waits", `${notTaken} ${notTaken === 1 ? "click" : "clicks"} ${words}`];
}

// A choice for each unit that the machine's axes are jogged in.
function incrementButtons(machine) {
  const place = $("increments");
  place.replaceChildren();
  for (const { axis, increments: offered } of machine.axes) {
    const unit = offered[0].unit;
    units[axis] = unit;
    if (increments[unit] && place.querySelector(`[data-unit="${unit}"]`)) continue;
    const group = document.createElement("div");
    group.className = "group";
    group.dataset.unit = unit;
    group.setAttribute("role", "radiogroup");
    group.setAttribute("aria-label", `Jog increment in ${unit}`);
    const title = document.createElement("span");
    title.textContent = "Jog by";
    group.append(title);
    const before = offered.find(step => step.way === increments[unit]?.chosen.way);
    const chosen = before ?? offered.findLast(step => step.way <= 1) ?? offered[0];
    increments[unit] = { chosen };
    for (const step of offered) {
      const button = document.createElement("button");
      button.type = "button";
      button.setAttribute("role", "radio");
      button.textContent = `${step.shown}`;
      button.onclick = () => {
        increments[unit].chosen = step;
        for (const other of group.querySelectorAll("button")) other.setAttribute("aria-checked", `${other === button}`);
      };
      button.setAttribute("aria-checked", `${step === chosen}`);
      group.append(button);
    }
    const shownUnit = document.createElement("span");
    shownUnit.textContent = unit === "deg" ? "°" : unit;
    group.append(shownUnit);
    place.append(group);
  }
}

export function begin(machine) {
  incrementButtons(machine);
  $("home").hidden = !machine.axes.some(axis => axis.homes);
}

export function prepare() {
  takeToken();
  window.addEventListener("hashchange", () => { takeToken(); shown(); });
  shown();
  for (const button of document.querySelectorAll("[data-order]")) button.onclick = () => give(button.dataset.order);
  for (const button of document.querySelectorAll("[data-step]")) {
    button.onclick = () => override((overrideWanted ?? overrideSeen) + Number(button.dataset.step));
  }
  $("rapids").onclick = rapids;
  $("jogs").onclick = jogs;
  $("blocks").onclick = blocks;
  document.querySelector("[data-percent]").onclick = () => override(100);
  $("token-form").onsubmit = event => {
    event.preventDefault();
    const given = $("token").value.trim();
    if (given) sessionStorage.setItem(KEY, given);
    $("token").value = "";
    shown();
  };
  document.addEventListener("keydown", event => {
    const typing = event.target instanceof HTMLInputElement || document.querySelector("dialog[open]");
    if (typing || event.ctrlKey || event.altKey || event.metaKey || event.repeat) return;
    const step = { "+": 10, "=": 10, "-": -10 }[event.key];
    const button = document.querySelector(`[data-key="${CSS.escape(event.key)}"]:not([hidden])`);
    if (step) override((overrideWanted ?? overrideSeen) + step);
    else if (button && !$("pad").hidden) button.click();
    else if (event.key === "?") $("help").showModal();
  });
}

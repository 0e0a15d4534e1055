// Orders: only with the token, which comes behind the address (#token=…) or from the field, and stays in this tab.

const KEY = "quadrant-token";
const INCREMENTS = [0.001, 0.01, 0.1, 1, 10];
const RAPIDS = [100, 50, 25, 5];
const ANSWER_MS = 10000;

const $ = id => document.getElementById(id);
let increment = 1;
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

export async function send(order) {
  const name = [order.order, order.axis, order.distance, order.percent, order.on].filter(part => part !== undefined).join(" ");
  answer("waits", `${name} …`);
  try {
    const response = await fetch("order", {
      method: "POST",
      headers: { "Content-Type": "application/json", Authorization: `Bearer ${token()}` },
      body: JSON.stringify(order),
    });
    const words = (await response.text()).trim();
    answer(response.ok ? "good" : "bad", words || name);
    if (response.status === 401 || response.status === 403) {
      sessionStorage.removeItem(KEY);
      shown();
    }
    return response.ok;
  } catch {
    answer("bad", `${name}: the server is not reached: not given, or nobody knows`);
    return false;
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
  $("rapids").firstChild.data = `${rapidsSeen} % `;
  $("blocks").firstChild.data = `Blocks ${singleBlock ? "on" : "off"} `;
  $("blocks").setAttribute("aria-pressed", `${singleBlock}`);
  tripped = () => status.mode === "tripped";
  overrideSeen = status.override_percent ?? overrideSeen;
  if (overrideWanted === null) $("override-value").textContent = `${overrideSeen} %`;
}

export function jog(axis, direction) {
  send({ order: "jog", axis, distance: direction * increment });
}

function incrementButtons() {
  const group = $("increments");
  const title = document.createElement("span");
  title.textContent = "Jog by";
  group.append(title);
  for (const step of INCREMENTS) {
    const button = document.createElement("button");
    button.type = "button";
    button.setAttribute("role", "radio");
    button.textContent = `${step}`;
    button.onclick = () => {
      increment = step;
      for (const other of group.querySelectorAll("button")) other.setAttribute("aria-checked", `${other === button}`);
    };
    button.setAttribute("aria-checked", `${step === increment}`);
    group.append(button);
  }
}

export function begin(machine) {
  $("home").hidden = !machine.axes.some(axis => axis.homes);
}

export function prepare() {
  takeToken();
  window.addEventListener("hashchange", () => { takeToken(); shown(); });
  shown();
  incrementButtons();
  for (const button of document.querySelectorAll("[data-order]")) button.onclick = () => give(button.dataset.order);
  for (const button of document.querySelectorAll("[data-step]")) {
    button.onclick = () => override((overrideWanted ?? overrideSeen) + Number(button.dataset.step));
  }
  $("rapids").onclick = rapids;
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

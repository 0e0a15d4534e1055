// Named inputs and outputs of the machine, and its alarms.

const $ = id => document.getElementById(id);

function shown(signal, fixed) {
  if (signal.kind === "bool") return signal.value ? "on" : "off";
  const value = Number.isInteger(signal.value) ? `${signal.value}` : fixed(signal.value, 3);
  return signal.unit ? `${value} ${signal.unit}` : value;
}

function row(signal, { element, fixed }) {
  const made = element("tr");
  const state = signal.forced ? "forced" : signal.lost ? "its source is lost" : "";
  made.append(...[signal.name, shown(signal, fixed), signal.source, state].map(text => element("td", text)));
  made.dataset.state = state;
  return made;
}

// `tools` make elements and write numbers as the rest of the page has them.
export function show(status, tools) {
  const signals = status.signals ?? [];
  $("show-signals").hidden = signals.length === 0;
  if ($("signals").open) $("signal-rows").replaceChildren(...signals.map(signal => row(signal, tools)));
  const alarms = status.alarms ?? [];
  const displaced = status.axes.some(axis => axis.reference === "came back elsewhere");
  $("acknowledge").hidden = !displaced && !alarms.some(alarm => !alarm.acknowledged);
  const words = alarms.map(alarm =>
    `alarm ${alarm.number}, ${alarm.text}${alarm.remedy ? `: ${alarm.remedy}` : ""}${alarm.active ? "" : " (over, not acknowledged)"}`);
  const wired = signals.filter(signal => signal.forced || signal.lost).map(signal =>
    `signal ${signal.name} is ${signal.forced ? `forced to ${shown(signal, tools.fixed)}` : "lost"}`);
  const told = [...words, ...wired];
  if ($("alarms").dataset.key === told.join()) return;
  $("alarms").dataset.key = told.join();
  $("alarms").replaceChildren(...told.slice(0, 6).map(text => tools.element("li", text)));
}

export function prepare() {
  $("show-signals").onclick = () => $("signals").showModal();
}

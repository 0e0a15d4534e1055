// Drawing: the path with the trail of the tool, and the circle as a ball bar would show it.

const VIEWS = {
  XY: { label: "Above", axes: ["X", "Y"], at: p => [p[0], p[1]] },
  XZ: { label: "Front", axes: ["X", "Z"], at: p => [p[0], p[2]] },
  YZ: { label: "Side", axes: ["Y", "Z"], at: p => [p[1], p[2]] },
  "3D": { label: "Space", axes: null, at: p => [(p[0] - p[1]) * 0.8660254, (p[0] + p[1]) * 0.5 + p[2]] },
};
// From small to large error; told apart by those who do not see red and green as well.
const COLOURS = ["#3b6fd4", "#2a9fd0", "#3fb8a0", "#a5b93a", "#e0a82e", "#ea7a2c", "#dd3a36", "#b3127a"];
const KEPT = 6000;

const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export function nice(value) {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  for (const step of [1, 2, 5, 10]) if (value <= step * power * 1.0001) return step * power;
  return 10 * power;
}

function sized(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "13px system-ui, sans-serif";
  return { pen, width, height };
}

export class PathPicture {
  constructor(canvas, legend) {
    Object.assign(this, { canvas, legend, stretches: [], trail: [], tool: null, view: "XY", chosen: false, dirty: true, worst: 0 });
    this.scaleCanvas = document.createElement("canvas");
    this.scaleWords = document.createElement("span");
    this.scaleLow = document.createElement("span");
    legend.append("contour error", this.scaleLow, this.scaleCanvas, this.scaleWords);
  }

  // Of one way of looking, or the next best where nobody has chosen.
  look(view, chosen) {
    if (!chosen && this.chosen) return;
    Object.assign(this, { view, chosen, dirty: true });
    this.chose?.();
  }

  setPath(stretches) {
    this.stretches = stretches.map(({ rapid, places_mm: flat }) => {
      const places = [];
      for (let i = 0; i + 2 < flat.length; i += 3) places.push([flat[i], flat[i + 1], flat[i + 2]]);
      return { rapid, places };
    });
    const cut = this.stretches.filter(stretch => !stretch.rapid).flatMap(stretch => stretch.places);
    const span = axis => cut.reduce(([low, high], p) => [Math.min(low, p[axis]), Math.max(high, p[axis])], [Infinity, -Infinity]);
    const size = axis => { const [low, high] = span(axis); return high >= low ? high - low : 0; };
    this.look(size(2) > 0.05 * Math.max(size(0), size(1)) ? "3D" : "XY", false);
    this.dirty = true;
  }

  clearTrail() { this.trail = []; this.worst = 0; this.dirty = true; }

  add(points) {
    if (points.length === 0) return;
    this.trail.push(...points);
    if (this.trail.length > KEPT) this.trail.splice(0, this.trail.length - KEPT);
    for (const p of points) if (p[3] !== null && p[3] > this.worst) this.worst = p[3];
    this.dirty = true;
  }

  setTool(tool) {
    if (tool && (!this.tool || tool.some((value, index) => value !== this.tool[index]))) { this.tool = tool; this.dirty = true; }
  }

  draw() {
    if (!this.dirty) return;
    this.dirty = false;
    const { pen, width, height } = sized(this.canvas);
    const view = VIEWS[this.view];
    const places = this.stretches.flatMap(stretch => stretch.places).concat(this.stretches.length ? [] : this.trail);
    if (this.tool) places.push(this.tool);
    if (places.length === 0) return this.none(pen, width, height);
    let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
    for (const place of places) {
      const [x, y] = view.at(place);
      [left, right, low, high] = [Math.min(left, x), Math.max(right, x), Math.min(low, y), Math.max(high, y)];
    }
    const margin = 34;
    const scale = Math.min((width - 2 * margin) / Math.max(right - left, 1e-3), (height - 2 * margin) / Math.max(high - low, 1e-3), 400);
    const [dx, dy] = [(width - (right - left) * scale) / 2, (height - (high - low) * scale) / 2];
    this.px = p => { const [x, y] = view.at(p); return [dx + (x - left) * scale, height - dy - (y - low) * scale]; };
    this.ruler(pen, width, height, scale, view);
    this.path(pen);
    this.trace(pen);
    this.here(pen);
    this.scale();
  }

  none(pen, width, height) {
    pen.fillStyle = css("--soft");
    pen.textAlign = "center";
    pen.fillText("no program is loaded, and nothing has moved", width / 2, height / 2);
    pen.textAlign = "left";
  }

  ruler(pen, width, height, scale, view) {
    const length = nice(90 / scale / 2);
    pen.strokeStyle = pen.fillStyle = css("--soft");
    pen.lineWidth = 1;
    pen.beginPath();
    const [x, y] = [width - 16 - length * scale, height - 12];
    pen.moveTo(x, y - 4); pen.lineTo(x, y); pen.lineTo(x + length * scale, y); pen.lineTo(x + length * scale, y - 4);
    pen.stroke();
    pen.fillText(`${length} mm`, x, y - 7);
    pen.fillText(view.axes ? `${view.axes[0]} →  ${view.axes[1]} ↑` : "X ↗  Y ↖  Z ↑", 6, height - 10);
  }

  line(pen, places) {
    pen.beginPath();
    places.forEach((place, index) => { const [x, y] = this.px(place); if (index) pen.lineTo(x, y); else pen.moveTo(x, y); });
    pen.stroke();
  }

  path(pen) {
    for (const { rapid, places } of this.stretches) {
      pen.strokeStyle = css(rapid ? "--rapid" : "--path");
      pen.setLineDash(rapid ? [3, 5] : []);
      pen.lineWidth = rapid ? 1 : 1.4;
      this.line(pen, places);
    }
    pen.setLineDash([]);
  }

  trace(pen) {
    // What is seldom does not take the colours away from all else.
    const errors = this.trail.map(p => p[3]).filter(um => um !== null).sort((a, b) => a - b);
    this.top = nice(errors[Math.floor(errors.length * 0.97)] ?? 0);
    const step = p => (p[3] === null ? -1 : Math.min(COLOURS.length - 1, Math.floor((p[3] / this.top) * COLOURS.length)));
    pen.lineWidth = 3.2;
    pen.lineJoin = pen.lineCap = "round";
    const all = this.tool ? this.trail.concat([this.tool]) : this.trail;
    for (let i = 1; i < all.length;) {
      const colour = step(all[i]);
      let end = i;
      while (end + 1 < all.length && step(all[end + 1]) === colour) end += 1;
      pen.strokeStyle = colour < 0 ? css("--soft") : COLOURS[colour];
      pen.globalAlpha = colour < 0 ? 0.5 : 1;
      this.line(pen, all.slice(i - 1, end + 1));
      i = end + 1;
    }
    pen.globalAlpha = 1;
  }

  here(pen) {
    if (!this.tool) return;
    const [x, y] = this.px(this.tool);
    pen.strokeStyle = css("--ink");
    pen.fillStyle = css("--blue");
    pen.lineWidth = 2;
    pen.beginPath(); pen.arc(x, y, 6, 0, 7); pen.fill(); pen.stroke();
    pen.beginPath();
    for (const [ux, uy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) { pen.moveTo(x + 8 * ux, y + 8 * uy); pen.lineTo(x + 15 * ux, y + 15 * uy); }
    pen.stroke();
  }

  scale() {
    const { pen, width, height } = sized(this.scaleCanvas);
    COLOURS.forEach((colour, index) => { pen.fillStyle = colour; pen.fillRect((index * width) / COLOURS.length, 0, width / COLOURS.length + 1, height); });
    this.scaleLow.textContent = "0";
    this.scaleWords.innerHTML = "";
    this.scaleWords.append(`${this.top} µm${this.worst > this.top ? " and more" : ""}`);
    if (this.worst > 0) {
      const worst = document.createElement("b");
      worst.textContent = `${this.worst.toFixed(1)} µm`;
      this.scaleWords.append(", largest ", worst);
    }
  }
}

export class CirclePicture {
  constructor(canvas, title, legend) { Object.assign(this, { canvas, title, legend, circle: null, dirty: true }); }

  set(circle) { this.circle = circle; this.dirty = true; }

  draw() {
    if (!this.dirty) return;
    this.dirty = false;
    const { pen, width, height } = sized(this.canvas);
    const circle = this.circle;
    const seen = circle ? circle.deviation_um.map((bin, degree) => ({ bin, degree })).filter(({ bin }) => bin) : [];
    if (seen.length === 0) {
      pen.fillStyle = css("--soft");
      pen.textAlign = "center";
      pen.fillText(circle ? "the circle has just begun" : "no circle has been travelled", width / 2, height / 2);
      pen.textAlign = "left";
      return;
    }
    const middle = [width / 2, height / 2];
    const radius = Math.max(30, (Math.min(width, height) / 2 - 18) * 0.68);
    const largest = Math.max(...seen.map(({ bin }) => Math.max(Math.abs(bin[0]), Math.abs(bin[2]))));
    const top = nice(largest);
    const gain = (radius * 0.48) / top;
    this.at = (degree, um) => {
      const angle = ((degree + 0.5) * Math.PI) / 180;
      const length = radius + um * gain;
      return [middle[0] + length * Math.cos(angle), middle[1] - length * Math.sin(angle)];
    };
    this.rings(pen, middle, radius, gain, top, circle.plane);
    this.band(pen, circle.deviation_um);
    this.marker(pen, middle, radius, circle);
    this.words(circle, seen);
  }

  rings(pen, [x, y], radius, gain, top, plane) {
    pen.lineWidth = 1;
    for (const um of [-top, -top / 2, 0, top / 2, top]) {
      pen.strokeStyle = css(um === 0 ? "--path" : "--line");
      pen.setLineDash(um === 0 ? [] : [2, 4]);
      pen.beginPath(); pen.arc(x, y, radius + um * gain, 0, 7); pen.stroke();
    }
    pen.setLineDash([]);
    pen.strokeStyle = css("--line");
    pen.beginPath();
    const far = radius + top * gain;
    pen.moveTo(x - far, y); pen.lineTo(x + far, y); pen.moveTo(x, y - far); pen.lineTo(x, y + far);
    pen.stroke();
    pen.fillStyle = css("--soft");
    pen.fillText(`${top} µm`, x + 4, y - radius - top * gain + 12);
    pen.fillText(`${-top} µm`, x + 4, y - radius + top * gain - 4);
    pen.fillText(`+${plane[0]}`, x + far - 4, y - 6);
    pen.fillText(`+${plane[1]}`, x + 6, y - far - 2);
  }

  band(pen, bins) {
    const runs = [];
    bins.forEach((bin, degree) => {
      const last = runs.at(-1);
      if (!bin) return;
      if (last && last.at(-1).degree === degree - 1) last.push({ bin, degree });
      else runs.push([{ bin, degree }]);
    });
    if (runs.length > 1 && runs[0][0].degree === 0 && runs.at(-1).at(-1).degree === bins.length - 1) runs.unshift(runs.pop().concat(runs.shift()));
    else if (runs.length === 1 && runs[0].length === bins.length) runs[0].push({ bin: bins[0], degree: 0 });
    for (const run of runs) {
      pen.fillStyle = css("--blue");
      pen.globalAlpha = 0.3;
      pen.beginPath();
      run.forEach(({ bin, degree }, index) => pen[index ? "lineTo" : "moveTo"](...this.at(degree, bin[2])));
      [...run].reverse().forEach(({ bin, degree }) => pen.lineTo(...this.at(degree, bin[0])));
      pen.fill();
      pen.globalAlpha = 1;
      pen.strokeStyle = css("--blue");
      pen.lineWidth = 2.2;
      pen.beginPath();
      run.forEach(({ bin, degree }, index) => pen[index ? "lineTo" : "moveTo"](...this.at(degree, bin[1])));
      pen.stroke();
    }
  }

  marker(pen, [x, y], radius, circle) {
    if (circle.angle_rad === null) return;
    const [ux, uy] = [Math.cos(circle.angle_rad), -Math.sin(circle.angle_rad)];
    pen.strokeStyle = css(circle.running ? "--waits" : "--soft");
    pen.lineWidth = 2;
    pen.beginPath(); pen.moveTo(x + ux * 8, y + uy * 8); pen.lineTo(x + ux * radius * 0.45, y + uy * radius * 0.45); pen.stroke();
    pen.fillStyle = pen.strokeStyle;
    pen.beginPath(); pen.arc(x, y, 3, 0, 7); pen.fill();
  }

  words(circle, seen) {
    const low = Math.min(...seen.map(({ bin }) => bin[0]));
    const high = Math.max(...seen.map(({ bin }) => bin[2]));
    const feed = circle.feed_mm_min === null ? "rapid" : `F${Math.round(circle.feed_mm_min)}`;
    this.title.textContent = `${circle.plane}, R ${circle.radius_mm} mm, ${feed}${circle.running ? "" : ", left"}`;
    this.legend.innerHTML = "";
    const range = document.createElement("b");
    range.textContent = `${low.toFixed(1)} … ${high.toFixed(1)} µm`;
    this.legend.append("radial deviation ", range, ` on ${seen.length}°`);
  }
}

export { VIEWS };

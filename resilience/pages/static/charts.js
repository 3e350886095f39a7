// Charts over time: stacked areas, step lines, bands, hatched shedding; all share one cursor.
const charts = [];

function timeTicks(times, width) {
  const hours = times.slots * times.step_min / 60;
  const room = Math.max(Math.floor(width / 64), 2);
  const step = [0.25, 0.5, 1, 2, 3, 4, 6, 12, 24, 48, 96, 168, 336].find(h => hours / h <= room) || 672;
  const start = new Date(times.start + (times.start.endsWith("Z") ? "" : "Z"));
  const first = start.getUTCHours() + start.getUTCMinutes() / 60;
  const marks = [];
  for (let h = Math.ceil(first / step - 1e-9) * step - first; h <= hours + 1e-9; h += step) {
    const when = new Date(start.getTime() + Math.round(h * 3600) * 1000);
    const clock = when.toISOString().slice(11, 16);
    const day = when.toLocaleDateString("en-GB", { day: "numeric", month: "short", timeZone: "UTC" });
    const text = hours > 24 && (step >= 24 || clock === "00:00") ? day : clock;
    marks.push([h * 60 / times.step_min, h >= hours - 1e-9 && hours <= 24 && clock === "00:00" ? "24:00" : text]);
  }
  return marks;
}

function timeAxis(svg, box, times) {
  const x = scale(0, times.slots, box.left, box.right);
  for (const [slot, text] of timeTicks(times, box.right - box.left)) {
    const anchor = x(slot) > box.right - 16 ? "end" : "middle";
    node("svg:line", { class: "grid", x1: x(slot), x2: x(slot), y1: box.bottom, y2: box.bottom + 4 }, svg);
    node("svg:text", { x: x(slot) + (anchor === "end" ? 8 : 0), y: box.bottom + 16, "text-anchor": anchor }, svg, text);
  }
  return x;
}

function domain(spec, slots) {
  let low = spec.bottom === null ? Infinity : spec.bottom;
  let high = spec.top === null ? -Infinity : spec.top;
  const up = new Array(slots).fill(0), down = new Array(slots).fill(0);
  let isStacked = false;
  for (const { mark, values } of spec.series) {
    values.forEach((value, t) => {
      if (value === null) return;
      if (mark === "up") { up[t] += value; isStacked = true; }
      else if (mark === "down") { down[t] -= value; isStacked = true; }
      else if (mark !== "hatch") { low = Math.min(low, value); high = Math.max(high, value); }
    });
  }
  if (isStacked) {
    low = Math.min(low, 0, ...down);
    high = Math.max(high, 0, ...up);
  }
  for (const value of spec.limits) { low = Math.min(low, value); high = Math.max(high, value); }
  if (!Number.isFinite(low) || !Number.isFinite(high)) [low, high] = [0, 1];
  if (low === high) [low, high] = [low - (low ? Math.abs(low) * 0.05 : 0), high + (Math.abs(high) * 0.05 || 1)];
  const pad = 0.04 * (high - low);
  return [spec.bottom === null && low !== 0 ? low - pad : low, spec.top === null ? high + pad : high];
}

// The outline of a step area between two lines that are constant within slots.
function area(x, y, bottom, top) {
  const there = [], back = [];
  top.forEach((value, t) => {
    there.push(`${x(t)},${y(value)}`, `${x(t + 1)},${y(value)}`);
    back.push(`${x(t)},${y(bottom[t])}`, `${x(t + 1)},${y(bottom[t])}`);
  });
  return "M" + there.join("L") + "L" + back.reverse().join("L") + "Z";
}

function path(x, y, values, slots) {
  const joins = values.length > slots;
  let text = "", pen = "M";
  values.forEach((value, t) => {
    if (value === null) { pen = "M"; return; }
    text += `${pen}${x(t)},${y(value)}` + (joins ? "" : `L${x(t + 1)},${y(value)}`);
    pen = "L";
  });
  return text;
}

function series(svg, spec, x, y, slots) {
  let up = new Array(slots).fill(0), down = new Array(slots).fill(0);
  const of = mark => spec.series.filter(s => s.mark === mark);
  const ends = of("high").map((high, k) => [of("low")[k], high]);
  for (const [low, high] of ends) {
    node("svg:path", { d: area(x, y, low.values, high.values), style: { fill: low.colour } }, svg);
  }
  for (const s of of("up")) {
    const top = up.map((v, t) => v + (s.values[t] || 0));
    node("svg:path", { d: area(x, y, up, top), style: { fill: s.colour } }, svg);
    up = top;
  }
  for (const s of of("down")) {
    const low = down.map((v, t) => v - (s.values[t] || 0));
    node("svg:path", { d: area(x, y, low, down), style: { fill: s.colour } }, svg);
    down = low;
  }
  const demand = spec.series.find(s => s.mark === "line");
  for (const s of of("hatch")) {
    const served = demand.values.map((v, t) => v - s.values[t]);
    node("svg:path", { d: area(x, y, served, demand.values), style: { fill: "url(#hatch)", stroke: "none" } }, svg);
  }
  for (const s of of("line")) {
    node("svg:path", { d: path(x, y, s.values, slots), style: { fill: "none", stroke: s.colour, strokeWidth: s.values.length > slots ? 2 : 1.6, strokeLinejoin: "round" } }, svg);
  }
}

function hatch(svg) {
  const defs = node("svg:defs", {}, svg);
  const pattern = node("svg:pattern", { id: "hatch", width: 5, height: 5, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" }, defs);
  node("svg:rect", { width: 2, height: 5, style: { fill: "var(--shed)" } }, pattern);
}

function chartLegend(spec) {
  const kinds = { up: "", down: "", line: "line", hatch: "hatch", high: "" };
  const shown = new Map();
  for (const { name, mark, colour } of spec.series) {
    if (mark in kinds && !shown.has(name)) shown.set(name, [name, kinds[mark], colour]);
  }
  if (spec.limits.length) shown.set("limits", ["limits", "dashed", "var(--shed)"]);
  return [...shown.values()];
}

function drawChart(host, spec, times) {
  const narrow = host.clientWidth < 480;
  const { svg, box } = canvas(host, spec.tall ? (narrow ? 240 : 280) : (narrow ? 160 : 180), `${spec.title}, ${spec.unit}`);
  hatch(svg);
  const [low, high] = domain(spec, times.slots);
  const x = scale(0, times.slots, box.left, box.right);
  for (const [first, stop] of times.shade) {
    node("svg:rect", { class: "shade", x: x(first), y: box.top, width: x(stop) - x(first), height: box.bottom - box.top }, svg);
  }
  const y = valueAxis(svg, box, low, high);
  timeAxis(svg, box, times);
  series(svg, spec, x, y, times.slots);
  if (low < 0) node("svg:line", { class: "zero", x1: box.left, x2: box.right, y1: y(0), y2: y(0) }, svg);
  for (const value of spec.limits) {
    node("svg:line", { class: "limit", x1: box.left, x2: box.right, y1: y(value), y2: y(value) }, svg);
  }
  const cursor = node("svg:line", { class: "cursor", y1: box.top, y2: box.bottom, visibility: "hidden" }, svg);
  const chart = {
    point(slot) {
      const seen = slot !== null;
      cursor.setAttribute("visibility", seen ? "visible" : "hidden");
      if (seen) for (const end of ["x1", "x2"]) cursor.setAttribute(end, x(slot + 0.5));
    },
  };
  const slotOf = event => {
    const area = svg.getBoundingClientRect();
    const at = (event.clientX - area.left) * box.width / area.width;
    return Math.min(Math.max(Math.floor((at - box.left) / (box.right - box.left) * times.slots), 0), times.slots - 1);
  };
  host.onpointermove = event => {
    const slot = slotOf(event);
    page.point(slot);
    tip.show(event, slotLabel(times, slot), spec.series.map(s => [
      s.mark === "low" ? "lowest" : s.mark === "high" ? "highest" : s.mark === "down" ? s.name + " takes" : s.name,
      figure(s.values[s.values.length > times.slots ? slot + 1 : slot], spec.unit),
    ]));
  };
  host.onpointerleave = () => { tip.hide(); page.point(null); };
  host.onclick = event => page.go(slotOf(event));
  return chart;
}

function slotLabel(times, slot) {
  return `${times.labels[slot]}–${times.labels[slot + 1]}`;
}

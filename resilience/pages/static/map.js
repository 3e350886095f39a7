// The feeder: buses, lines and units where they are, in the slot that the slider names.
const OPEN = 0, CLOSED = 1, OUT = 2;

function mapBox(host, data) {
  const width = Math.max(host.clientWidth, 240);
  const xs = data.buses.map(b => b.x), ys = data.buses.map(b => b.y);
  const wide = Math.max(...xs) || 1e-3, high = Math.max(...ys) || 1e-3;
  const pad = width < 480 ? 22 : 34;
  const limit = Math.min(620, Math.max(window.innerHeight * 0.75, 320));
  const height = Math.min(Math.max((width - 2 * pad) * high / wide, 110) + 2 * pad, limit);
  const k = Math.min((width - 2 * pad) / wide, (height - 2 * pad) / high);
  const left = (width - k * wide) / 2, top = (height - k * high) / 2;
  return { width, height, place: bus => [left + k * bus.x, top + k * (high - bus.y)] };
}

class FeederMap {
  constructor(host, data, times) {
    this.host = host;
    this.data = data;
    this.times = times;
    this.frames = data.frames;
    this.slot = 0;
    this.draw();
  }

  get frame() { return Math.floor(this.slot / (this.data.every || 1)); }

  at(rows, k) {
    const row = rows && rows[k];
    return row ? row[Math.min(this.frame, row.length - 1)] : null;
  }

  draw() {
    clear(this.host);
    const data = this.data, box = mapBox(this.host, data);
    this.svg = node("svg:svg", { viewBox: `0 0 ${box.width} ${box.height}`, role: "img", "aria-label": "map of the feeder" }, this.host);
    this.spots = data.buses.map(box.place);
    const few = data.buses.length <= 80;
    this.radius = few ? (box.width < 480 ? 5 : 6.5) : 2.5;
    const layer = () => node("svg:g", {}, this.svg);
    const [wires, arrows, links, rings, buses, units, names, areas] = Array.from({ length: 8 }, layer);
    this.wires = data.lines.map(line => {
      const [x1, y1] = this.spots[line.a], [x2, y2] = this.spots[line.b];
      return node("svg:line", { x1, y1, x2, y2 }, wires);
    });
    this.arrows = data.lines.map(() => node("svg:path", { d: "" }, arrows));
    this.rings = this.spots.map(([cx, cy]) => node("svg:circle", { cx, cy, r: 0, style: { fill: "none", stroke: "var(--shed)" } }, rings));
    this.dots = data.buses.map((bus, k) => this.dot(bus, k, buses));
    this.taken = data.buses.map((_, k) => few ? this.directions(k) : []);
    this.units = few ? this.placeUnits(units, links) : [];
    if (few) this.nameBuses(names);
    this.areas(areas);
    this.update();
  }

  dot(bus, k, layer) {
    const [x, y] = this.spots[k], r = this.radius;
    const style = { stroke: "var(--ink)", strokeWidth: this.radius > 3 ? 1 : 0.4 };
    return bus.grid
      ? node("svg:rect", { x: x - r - 2, y: y - r - 2, width: 2 * r + 4, height: 2 * r + 4, style: { ...style, strokeWidth: 2 } }, layer)
      : node("svg:circle", { cx: x, cy: y, r, style }, layer);
  }

  // Angles at which lines leave a bus.
  directions(k) {
    const [x, y] = this.spots[k];
    return this.data.lines.filter(line => line.a === k || line.b === k).map(line => {
      const [u, v] = this.spots[line.a === k ? line.b : line.a];
      return Math.atan2(v - y, u - x);
    });
  }

  // The angle at a bus that is freest of lines, units and names; it is taken from then on.
  free(k) {
    const gap = angle => Math.min(Math.PI, ...this.taken[k].map(a => Math.abs(Math.atan2(Math.sin(a - angle), Math.cos(a - angle)))));
    let best = 0;
    for (let i = 1; i < 16; i++) if (gap(i * Math.PI / 8) > gap(best) + 1e-9) best = i * Math.PI / 8;
    this.taken[k].push(best);
    return best;
  }

  nameBuses(layer) {
    this.data.buses.forEach((bus, k) => {
      const [x, y] = this.spots[k], angle = this.free(k);
      const anchor = Math.cos(angle) > 0.3 ? "start" : Math.cos(angle) < -0.3 ? "end" : "middle";
      const far = this.radius + 6;
      const label = bus.name.length > 12 ? bus.name.slice(0, 11) + "…" : bus.name;
      node("svg:text", { class: "name", x: x + far * Math.cos(angle), y: y + far * Math.sin(angle) + 3.5 + 3 * Math.sin(angle), "text-anchor": anchor }, layer, label);
    });
  }

  placeUnits(layer, links) {
    return (this.data.devices || []).map(device => {
      if (this.data.buses[device.bus].grid && device.kind === "grid") return null;
      const angle = this.free(device.bus);
      const [x, y] = this.spots[device.bus];
      const far = this.radius + 13;
      const cx = x + far * Math.cos(angle), cy = y + far * Math.sin(angle);
      node("svg:line", { x1: x, y1: y, x2: cx, y2: cy, style: { stroke: device.colour, strokeWidth: 1.5 } }, links);
      const size = device.storage ? [10, 16] : [11, 11];
      node("svg:rect", { x: cx - size[0] / 2, y: cy - size[1] / 2, width: size[0], height: size[1], rx: device.storage ? 2 : 5.5, style: { fill: "var(--bg)", stroke: device.colour, strokeWidth: 1.6 } }, layer);
      const fill = node("svg:rect", { x: cx - size[0] / 2, y: cy - size[1] / 2, width: size[0], height: size[1], rx: device.storage ? 2 : 5.5, style: { fill: device.colour } }, layer);
      return { fill, cx, cy, size, storage: device.storage };
    });
  }

  areas(layer) {
    const hover = (shape, rows) => {
      shape.style.pointerEvents = "all";
      shape.onpointermove = event => { const [head, entries] = rows(); tip.show(event, head, entries); };
      shape.onpointerleave = () => tip.hide();
    };
    this.data.lines.forEach((line, k) => {
      const [x1, y1] = this.spots[line.a], [x2, y2] = this.spots[line.b];
      hover(node("svg:line", { x1, y1, x2, y2, style: { stroke: "transparent", strokeWidth: 12 } }, layer), () => [`line ${line.name}`, this.lineFacts(line, k)]);
    });
    this.spots.forEach(([cx, cy], k) => {
      hover(node("svg:circle", { cx, cy, r: Math.max(this.radius + 6, 8), style: { fill: "transparent" } }, layer), () => [`bus ${this.data.buses[k].name}`, this.busFacts(k)]);
    });
  }

  lineFacts(line, k) {
    if (line.facts) return line.facts;
    const rows = [["state", ["open", "closed", "out"][this.at(this.frames.state, k)]]];
    const flow = this.at(this.frames.flow, k), chance = this.at(this.frames.chance, k);
    if (flow !== null) {
      const from = this.data.buses[flow < 0 ? line.b : line.a].name;
      rows.push([`flow from ${from}`, figure(Math.abs(flow), "MW")]);
      if (line.rating_mva) rows.push(["rating", figure(line.rating_mva, "MVA")]);
    }
    if (chance) rows.push(["chance to be out", figure(100 * chance, "%")]);
    return rows;
  }

  busFacts(k) {
    if (this.data.buses[k].facts) return this.data.buses[k].facts;
    const rows = [], colour = this.at(this.frames.colour, k);
    rows.push(["supplied by", colour === 0 ? "nothing" : colour === 1 ? "the grid" : "its island"]);
    const voltage = this.at(this.frames.voltage, k), demand = this.at(this.frames.demand, k), shed = this.at(this.frames.shed, k);
    if (voltage !== null) rows.push(["voltage", figure(voltage, "pu")]);
    if (demand) rows.push(["demand", figure(demand, "MW")]);
    if (shed) rows.push(["shed", figure(shed, "MW")]);
    this.data.devices.forEach((device, d) => {
      if (device.bus !== k) return;
      rows.push([device.name, figure(this.at(this.frames.power, d), "MW")]);
      const soc = this.at(this.frames.soc, d);
      if (soc !== null) rows.push([device.name + " holds", figure(100 * soc, "%")]);
    });
    return rows;
  }

  busColour(k) {
    const voltage = this.at(this.frames.voltage, k);
    if (this.by !== "voltage") return `var(--i${this.at(this.frames.colour, k)})`;
    if (voltage === null || this.at(this.frames.colour, k) === 0) return "var(--i0)";
    const [low, high] = this.data.band;
    const share = Math.min(Math.max((voltage - low) / (high - low), 0), 1);
    const far = Math.round(Math.abs(2 * share - 1) * 100);
    return `color-mix(in srgb, var(--${share < 0.5 ? "low" : "high"}) ${far}%, var(--mid))`;
  }

  update() {
    if (!this.frames) return;
    this.data.lines.forEach((line, k) => this.updateLine(line, k));
    this.dots.forEach((dot, k) => { dot.style.fill = this.busColour(k); });
    this.rings.forEach((ring, k) => {
      const shed = this.at(this.frames.shed, k);
      ring.setAttribute("r", shed ? this.radius + 2.5 : 0);
      ring.style.strokeWidth = shed ? 1.5 + 4.5 * Math.sqrt(shed / this.data.largest.shed) : 0;
    });
    this.units.forEach((unit, d) => {
      if (!unit) return;
      const share = unit.storage ? this.at(this.frames.soc, d) || 0 : Math.abs(this.at(this.frames.power, d)) > 1e-6 ? 1 : 0;
      const high = unit.size[1] * share;
      unit.fill.setAttribute("height", high);
      unit.fill.setAttribute("y", unit.cy + unit.size[1] / 2 - high);
    });
  }

  updateLine(line, k) {
    const state = this.at(this.frames.state, k), flow = this.at(this.frames.flow, k);
    const chance = this.at(this.frames.chance, k);
    const share = flow === null || !this.data.largest.flow ? 0.12 : Math.abs(flow) / this.data.largest.flow;
    const slim = this.data.buses.length > 80 ? 0.6 : 1;
    const style = this.wires[k].style;
    style.stroke = state === OUT ? "var(--out)" : chance ? `var(--risk${Math.min(Math.floor(chance * 5), 4)})` : "var(--wire)";
    style.strokeWidth = slim * (state === OUT ? 2.5 : state === OPEN ? 1 : chance ? 4 : 1 + 6 * share);
    style.strokeDasharray = state === OUT ? "3 5" : state === OPEN ? "1 4" : "none";
    style.strokeLinecap = state === CLOSED ? "round" : "butt";
    this.arrows[k].setAttribute("d", state === OUT ? this.cross(line) : state === CLOSED && flow !== null && share > 0.005 ? this.arrow(line, flow, share) : "");
    this.arrows[k].style.fill = state === OUT ? "none" : "var(--ink)";
    this.arrows[k].style.stroke = state === OUT ? "var(--out)" : "none";
    this.arrows[k].style.strokeWidth = 2.5;
  }

  middle(line) {
    const [x1, y1] = this.spots[line.a], [x2, y2] = this.spots[line.b];
    return [(x1 + x2) / 2, (y1 + y2) / 2, Math.atan2(y2 - y1, x2 - x1), Math.hypot(x2 - x1, y2 - y1)];
  }

  arrow(line, flow, share) {
    const [x, y, turn, long] = this.middle(line);
    const size = Math.min(3.5 + 3.5 * share, long / 4);
    if (size < 1.5) return "";
    const angle = flow < 0 ? turn + Math.PI : turn;
    const point = (far, side) => `${x + far * Math.cos(angle) - side * Math.sin(angle)},${y + far * Math.sin(angle) + side * Math.cos(angle)}`;
    return `M${point(size, 0)}L${point(-size, size)}L${point(-size, -size)}Z`;
  }

  cross(line) {
    const [x, y] = this.middle(line), r = this.radius > 3 ? 5 : 3;
    return `M${x - r},${y - r}L${x + r},${y + r}M${x - r},${y + r}L${x + r},${y - r}`;
  }

  legend() {
    const seen = new Set(this.frames.colour.flat());
    const entries = this.by === "voltage"
      ? [[`${this.data.band[0]} pu`, "dot", "var(--low)"], ["middle", "dot", "var(--mid)"], [`${this.data.band[1]} pu`, "dot", "var(--high)"]]
      : [["on the grid", 1], ["islands, one colour each", 2], ["dead", 0]].filter(([, code]) => code === 2 ? [...seen].some(c => c > 1) : seen.has(code)).map(([name, code]) => [name, "dot", `var(--i${code})`]);
    if (this.frames.shed.some(row => row)) entries.push(["shed, by size", "ring", ""]);
    if (this.frames.state.some(row => row.includes(OUT))) entries.push(["line out", "dashed", "var(--out)"]);
    if (this.frames.state.some(row => row.includes(OPEN))) entries.push(["line open", "dashed", "var(--wire)"]);
    if (this.frames.chance) entries.push(["likely out: few storms", "line", "var(--risk0)"], ["most storms", "line", "var(--risk4)"]);
    else if (this.frames.flow.some(row => row)) entries.push(["flow by width", "line", "var(--wire)"]);
    const kinds = new Map(this.data.devices.filter(d => d.kind !== "grid").map(d => [d.kind, d.colour]));
    if (this.units.length) for (const [kind, colour] of kinds) entries.push([kind === "storage" ? "storage, filled to its charge" : kind + ", filled while it runs", "", colour]);
    return entries;
  }
}

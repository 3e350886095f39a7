// What the page does: draws everything at the width there is, and moves through the slots.
function read(id) {
  return JSON.parse(document.getElementById(id).textContent);
}

const page = {
  slot: 0,
  map: null,
  timer: null,
  drawn: null,

  start() {
    this.drawn = read("drawn");
    this.drawAll();
    this.controls();
    let width = document.documentElement.clientWidth;
    window.addEventListener("resize", () => {
      if (document.documentElement.clientWidth === width) return;
      width = document.documentElement.clientWidth;
      this.drawAll();
    });
    window.addEventListener("beforeprint", () => {
      document.querySelectorAll("details").forEach(fold => { fold.open = true; });
    });
    window.addEventListener("scroll", () => tip.hide(), { passive: true });
  },

  drawAll() {
    charts.length = 0;
    for (const host of document.querySelectorAll("[data-chart]")) {
      const spec = this.drawn.charts[host.dataset.chart];
      const plot = host.querySelector(".plot");
      const kind = host.dataset.kind || "time";
      if (kind === "time") {
        legend(host.querySelector(".legend"), chartLegend(spec));
        charts.push(drawChart(plot, spec, this.timesOf(spec)));
      } else if (kind === "dots") drawDots(plot, spec);
      else {
        legend(host.querySelector(".legend"), spec.lines.map(line => [line.name, "line", line.colour]));
        drawSteps(plot, spec);
      }
    }
    const host = document.getElementById("map");
    if (!host) return;
    if (this.map) this.map.draw();
    else this.map = new FeederMap(host, this.drawn.map, this.drawn.times);
    this.go(this.slot);
  },

  // A chart may have other slots than the map, from the same start on.
  timesOf(spec) {
    const times = this.drawn.times;
    return spec.slots ? { ...times, slots: spec.slots } : times;
  },

  controls() {
    const slider = document.getElementById("slider");
    if (!slider) return;
    slider.addEventListener("input", () => { this.stop(); this.go(Number(slider.value)); });
    document.getElementById("play").addEventListener("click", () => this.timer ? this.stop() : this.play());
    const by = document.getElementById("by");
    if (by) by.addEventListener("change", () => { this.map.by = by.value; this.map.update(); this.mapLegend(); });
    this.mapLegend();
    const first = this.drawn.times.shade.length ? this.drawn.times.shade[0][0] : this.drawn.map.first || 0;
    this.go(first);
  },

  mapLegend() {
    legend(document.getElementById("map-legend"), this.drawn.map.legend || this.map.legend());
  },

  play() {
    const slots = this.drawn.times.slots;
    if (this.slot >= slots - 1) this.go(0);
    document.getElementById("play").textContent = "Pause";
    this.timer = setInterval(() => this.slot < slots - 1 ? this.go(this.slot + 1) : this.stop(), Math.max(60, 12000 / slots));
  },

  stop() {
    clearInterval(this.timer);
    this.timer = null;
    document.getElementById("play").textContent = "Play";
  },

  point(slot) {
    const shown = slot === null && document.getElementById("slider") ? this.slot : slot;
    for (const chart of charts) chart.point(shown);
  },

  go(to) {
    const slot = Math.min(to, this.drawn.times.slots - 1);
    this.slot = slot;
    const slider = document.getElementById("slider");
    if (!slider) return;
    slider.value = slot;
    const label = slotLabel(this.drawn.times, slot);
    document.getElementById("moment").textContent = label;
    slider.setAttribute("aria-valuetext", label);
    this.map.slot = slot;
    this.map.update();
    if (this.map.frames) readout(document.getElementById("readout"), this.map);
    this.point(slot);
  },
};

// What the map shows in figures.
function readout(host, map) {
  clear(host);
  if (map.data.facts) { facts(host, map.data.facts[map.slot]); return; }
  const total = rows => rows.reduce((sum, _, k) => sum + (map.at(rows, k) || 0), 0);
  const demand = total(map.frames.demand), shed = total(map.frames.shed);
  const rows = [["demand", figure(demand, "MW")], ["shed", figure(shed, "MW")]];
  const kinds = new Map();
  map.data.devices.forEach((device, d) => kinds.set(device.kind, (kinds.get(device.kind) || 0) + map.at(map.frames.power, d)));
  for (const [kind, power] of kinds) rows.push([power < -1e-9 ? `${kind} takes` : `from ${kind}`, figure(Math.abs(power), "MW")]);
  if (map.frames.voltage) {
    const there = map.frames.voltage.map((_, k) => map.at(map.frames.voltage, k));
    const low = there.reduce((best, v, k) => v !== null && (best < 0 || v < there[best]) ? k : best, -1);
    if (low >= 0) rows.push([`lowest voltage, bus ${map.data.buses[low].name}`, figure(there[low], "pu")]);
  }
  facts(host, rows);
  storage(host, map);
  const out = map.data.lines.filter((_, k) => map.at(map.frames.state, k) === OUT).map(line => line.name);
  node("p", {}, host, out.length ? `Out: ${out.join(", ")}` : map.frames.chance ? "" : "No line is out.");
}

function facts(host, rows) {
  const table = node("table", {}, host);
  for (const [name, value] of rows) {
    const row = node("tr", {}, table);
    node("td", {}, row, name);
    node("td", {}, row, value);
  }
}

function storage(host, map) {
  const units = map.data.devices.map((device, d) => [device, map.at(map.frames.soc, d)]).filter(([device, soc]) => device.storage && soc !== null);
  if (!units.length || units.length > 12) return;
  node("p", {}, host, "State of charge at the end");
  const table = node("table", {}, host);
  for (const [device, soc] of units) {
    const row = node("tr", {}, table);
    node("td", {}, row, device.name);
    const cell = node("td", {}, row);
    const meter = node("span", { class: "meter" }, cell);
    node("i", { style: { width: 100 * soc + "%" } }, meter);
    cell.appendChild(document.createTextNode(`${Math.round(100 * soc)} %`));
  }
}

page.start();

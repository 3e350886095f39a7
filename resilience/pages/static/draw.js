"use strict";
// What all drawings share. Names come from users: they are only ever set as text.
const SVG = "http://www.w3.org/2000/svg";
const MINUS = "−";

function node(tag, attributes, parent, text) {
  const made = tag.startsWith("svg:")
    ? document.createElementNS(SVG, tag.slice(4)) : document.createElement(tag);
  for (const [key, value] of Object.entries(attributes || {})) {
    if (key === "style") Object.assign(made.style, value);
    else made.setAttribute(key, value);
  }
  if (text !== undefined) made.textContent = text;
  if (parent) parent.appendChild(made);
  return made;
}

function clear(host) {
  while (host.firstChild) host.removeChild(host.firstChild);
}

function figure(value, unit) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  const size = Math.abs(value);
  const digits = size >= 1000 ? 0 : size >= 100 ? 1 : size >= 10 ? 2 : 3;
  const rounded = Number(value.toFixed(digits)) + 0;
  const text = rounded.toLocaleString("en-GB", { maximumFractionDigits: digits });
  return text.replace("-", MINUS) + (unit ? " " + unit : "");
}

// Round values from low to high, about as many as asked for.
function ticks(low, high, count) {
  const span = high - low;
  if (!(span > 0)) return [low];
  const rough = span / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 2.5, 5, 10].map(k => k * power).find(s => s >= rough * 0.999);
  const values = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * span; k++) {
    values.push(Number((k * step).toPrecision(12)));
  }
  return values;
}

const tip = {
  box: null,
  show(event, head, rows) {
    if (!this.box) this.box = node("div", { id: "tip", role: "status" }, document.body);
    clear(this.box);
    node("b", {}, this.box, head);
    for (const [name, value] of rows) {
      const row = node("div", {}, this.box);
      node("span", {}, row, name);
      node("span", {}, row, value);
    }
    this.box.style.display = "block";
    const wide = this.box.offsetWidth, room = document.documentElement.clientWidth;
    const left = event.clientX + 14 + wide > room ? event.clientX - wide - 14 : event.clientX + 14;
    this.box.style.left = Math.max(4, left) + window.scrollX + "px";
    const high = this.box.offsetHeight;
    const below = event.clientY + 14 + high > window.innerHeight;
    const top = below ? event.clientY - high - 10 : event.clientY + 14;
    this.box.style.top = Math.max(4, top) + window.scrollY + "px";
  },
  hide() {
    if (this.box) this.box.style.display = "none";
  },
};

function legend(host, entries) {
  clear(host);
  for (const [name, kind, colour] of entries) {
    const entry = node("span", {}, host);
    const style = kind === "line" || kind === "dashed" ? { borderTopColor: colour }
      : kind === "hatch" || kind === "ring" ? {} : { background: colour };
    node("i", { class: kind, style }, entry);
    entry.appendChild(document.createTextNode(name));
  }
}

// A drawing area with margins; coordinates are pixels at the width that the page has now.
function canvas(host, height, label) {
  clear(host);
  const width = Math.max(host.clientWidth, 240);
  const box = { left: 46, right: width - 10, top: 8, bottom: height - 22, width, height };
  const svg = node("svg:svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label }, host);
  return { svg, box };
}

function scale(low, high, from, to) {
  return value => from + (value - low) / (high - low || 1) * (to - from);
}

function valueAxis(svg, box, low, high) {
  const y = scale(low, high, box.bottom, box.top);
  for (const value of ticks(low, high, Math.max(Math.round((box.bottom - box.top) / 38), 2))) {
    node("svg:line", { class: "grid", x1: box.left, x2: box.right, y1: y(value), y2: y(value) }, svg);
    node("svg:text", { x: box.left - 6, y: y(value) + 4, "text-anchor": "end" }, svg, figure(value));
  }
  return y;
}

// A row per method: a dot for every episode, the mean and its interval; and a step line by duration.
function drawDots(host, spec) {
  const rows = spec.rows, narrow = host.clientWidth < 480;
  const { svg, box } = canvas(host, 34 + 34 * rows.length, spec.title);
  box.left = narrow ? 96 : 130;
  const values = rows.flatMap(row => [...row.dots, row.low, row.high]).filter(v => v !== null);
  const low = Math.min(0, ...values), high = Math.max(0, ...values) || 1;
  const x = scale(low, high + 0.03 * (high - low), box.left, box.right);
  for (const value of ticks(low, high, Math.max(Math.floor((box.right - box.left) / 80), 2))) {
    node("svg:line", { class: "grid", x1: x(value), x2: x(value), y1: box.top, y2: box.bottom }, svg);
    node("svg:text", { x: x(value), y: box.bottom + 16, "text-anchor": "middle" }, svg, figure(value));
  }
  const high_row = (box.bottom - box.top) / rows.length;
  rows.forEach((row, k) => {
    const y = box.top + (k + 0.5) * high_row;
    const label = node("svg:text", { x: box.left - 8, y: y + 4, "text-anchor": "end" }, svg, row.name);
    label.style.fill = "var(--ink)";
    row.dots.forEach((value, i) => {
      const share = row.dots.length > 1 ? i / (row.dots.length - 1) - 0.5 : 0;
      node("svg:circle", { cx: x(value), cy: y + share * 0.5 * high_row, r: 2.6, style: { fill: row.colour, opacity: 0.45 } }, svg);
    });
    if (row.low !== null && row.high !== null) {
      node("svg:line", { x1: x(row.low), x2: x(row.high), y1: y, y2: y, style: { stroke: row.colour, strokeWidth: 3 } }, svg);
    }
    node("svg:circle", { cx: x(row.mean), cy: y, r: 5, style: { fill: row.colour, stroke: "var(--bg)", strokeWidth: 1.5 } }, svg);
    const area = node("svg:rect", { x: 0, y: y - high_row / 2, width: box.width, height: high_row, style: { fill: "transparent" } }, svg);
    area.onpointermove = event => tip.show(event, row.name, [
      ["mean", figure(row.mean, spec.unit)],
      ["95 % interval", row.low === null ? "–" : `${figure(row.low)} to ${figure(row.high)}`],
      ["episodes", String(row.dots.length)],
    ]);
    area.onpointerleave = () => tip.hide();
  });
  node("svg:line", { class: "zero", x1: x(0), x2: x(0), y1: box.top, y2: box.bottom }, svg);
}

function drawSteps(host, spec) {
  const { svg, box } = canvas(host, host.clientWidth < 480 ? 200 : 260, spec.title);
  const y = valueAxis(svg, box, 0, 100);
  const x = scale(0, spec.longest, box.left, box.right);
  for (const value of ticks(0, spec.longest, Math.max(Math.floor((box.right - box.left) / 70), 2))) {
    node("svg:text", { x: x(value), y: box.bottom + 16, "text-anchor": "middle" }, svg, figure(value));
  }
  spec.lines.forEach(line => {
    let text = "";
    line.hours.forEach((hour, k) => { text += k ? `V${y(line.share[k])}H${x(hour)}` : `M${x(hour)},${y(line.share[k])}`; });
    node("svg:path", { d: text, style: { fill: "none", stroke: line.colour, strokeWidth: 2 } }, svg);
    line.points.forEach(([hour, share, low, high]) => {
      node("svg:line", { x1: x(hour), x2: x(hour), y1: y(low), y2: y(high), style: { stroke: line.colour, strokeWidth: 1.5 } }, svg);
      const dot = node("svg:circle", { cx: x(hour), cy: y(share), r: 5, style: { fill: line.colour, stroke: "var(--bg)", strokeWidth: 1.5 } }, svg);
      dot.onpointermove = event => tip.show(event, `${line.name}, ${hour} h`, [["served", figure(share, "%")], ["95 % interval", `${figure(low)} to ${figure(high)} %`]]);
      dot.onpointerleave = () => tip.hide();
    });
  });
}

"use strict";
// The log-log plot of one scene: error against time.

const NARROW = 620;
const LABEL_GAP = 15;
/// Predicted errors stretch the axis by this factor at most; what is further out is cut off at the frame.
const STRETCH = 4;

/// A logarithmic axis: pixels from values, decades and their divisions.
function logAxis(low, high, start, end) {
  const pad = Math.max(0.06 * Math.log10(high / low), 0.1);
  const [a, b] = [Math.log10(low) - pad, Math.log10(high) + pad];
  const at = (value) => start + ((Math.log10(value) - a) / (b - a)) * (end - start);
  const ticks = [];
  for (let exponent = Math.floor(a); exponent <= b; exponent++)
    for (let digit = 1; digit < 10; digit++) {
      const value = Number(`${digit}e${exponent}`);
      const log = Math.log10(value);
      if (log >= a && log <= b) ticks.push({ value, digit });
    }
  // Few decades: their divisions get labels too.
  const named = b - a < 1.2 ? [1, 2, 3, 5, 7] : b - a < 2.6 ? [1, 3] : [1];
  return { at, ticks, isNamed: (tick) => named.includes(tick.digit), low: 10 ** a, high: 10 ** b };
}

const path = (points) => points.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(2)} ${y.toFixed(2)}`).join("");

/// Moves labels apart without changing their order, each as little as a simple sweep needs.
function spread(labels, top, bottom) {
  labels.sort((a, b) => a.y - b.y);
  labels.forEach((label, i) => (label.y = Math.max(label.y, i ? labels[i - 1].y + LABEL_GAP : top)));
  for (let i = labels.length - 1, limit = bottom; i >= 0; i--, limit = labels[i + 1].y - LABEL_GAP) labels[i].y = Math.min(labels[i].y, limit);
}

function grid(group, x, y, frame) {
  for (const tick of x.ticks) group.append(svg("line", { class: tick.digit === 1 ? "decade" : "minor", x1: x.at(tick.value), x2: x.at(tick.value), y1: frame.top, y2: frame.bottom }));
  for (const tick of y.ticks) group.append(svg("line", { class: tick.digit === 1 ? "decade" : "minor", x1: frame.left, x2: frame.right, y1: y.at(tick.value), y2: y.at(tick.value) }));
}

function axisLabels(group, x, y, frame, metric) {
  for (const tick of x.ticks.filter(x.isNamed)) {
    group.append(svg("line", { class: "axis", x1: x.at(tick.value), x2: x.at(tick.value), y1: frame.bottom, y2: frame.bottom + 5 }));
    group.append(svg("text", { class: "tick", x: x.at(tick.value), y: frame.bottom + 20, "text-anchor": "middle" }, level(tick.value)));
  }
  for (const tick of y.ticks.filter(y.isNamed)) {
    group.append(svg("line", { class: "axis", x1: frame.left - 5, x2: frame.left, y1: y.at(tick.value), y2: y.at(tick.value) }));
    group.append(svg("text", { class: "tick", x: frame.left - 9, y: y.at(tick.value) + 4, "text-anchor": "end" }, level(tick.value)));
  }
  const middle = (frame.top + frame.bottom) / 2;
  group.append(svg("path", { class: "axis", d: `M${frame.left} ${frame.top}V${frame.bottom}H${frame.right}` }));
  group.append(svg("text", { class: "title", x: (frame.left + frame.right) / 2, y: frame.bottom + 42, "text-anchor": "middle" }, clockName() + unit()));
  group.append(svg("text", { class: "title", x: 15, y: middle, "text-anchor": "middle", transform: `rotate(-90 15 ${middle})` }, metric.axis));
}

/// Diagonals of equal cost, one a decade: error × time, or error² × time for roots.
function costLines(group, x, y, metric) {
  const power = metric.squared ? 1 : 2;
  const cost = (e, t) => Math.log10(e ** power * t);
  for (let decade = Math.ceil(cost(y.low, x.low)); decade <= cost(y.high, x.high); decade++) {
    const error = (t) => (10 ** decade / t) ** (1 / power);
    group.append(svg("line", { class: "cost", x1: x.at(x.low), y1: y.at(error(x.low)), x2: x.at(x.high), y2: y.at(error(x.high)) }));
  }
}

function drawCurve(group, curve, x, y, frame) {
  const look = { stroke: colour(curve.method), fill: colour(curve.method) };
  const positive = curve.points.filter((p) => p.error > 0);
  const clamp = (error) => (error > y.low ? y.at(error) : frame.bottom);
  if (state.band && positive.some((p) => p.errors[0] < p.errors[1])) {
    const high = positive.map((p) => [x.at(p.time), clamp(p.errors[1])]);
    const low = positive.map((p) => [x.at(p.time), clamp(p.errors[0])]).reverse();
    group.append(svg("path", { class: "band", fill: colour(curve.method), d: path([...high, ...low]) + "Z" }));
  }
  group.append(svg("path", { class: "curve", stroke: colour(curve.method), "stroke-dasharray": dash(curve.method), d: path(positive.map((p) => [x.at(p.time), y.at(p.error)])) }));
  for (const point of curve.points) {
    const at = x.at(point.time);
    if (point.error > 0) group.append(marker(curve.method, at, y.at(point.error), 4.2, { class: "point", ...look }));
    else group.append(svg("path", { class: "below", ...look, d: `M${at - 5} ${frame.bottom - 10}h10l-5 8z` }));
    if (state.predicted && point.predicted > 0) {
      const to = Math.min(Math.max(y.at(point.predicted), frame.top), frame.bottom);
      group.append(svg("line", { class: "guess", stroke: colour(curve.method), x1: at, x2: at, y1: clamp(point.error), y2: to }));
      if (to === y.at(point.predicted)) group.append(marker(curve.method, at, y.at(point.predicted), 4, { class: "predicted", stroke: colour(curve.method) }));
    }
  }
}

/// What a point says of itself: pairs of a name and a value.
function pointFacts(point) {
  const rows = point.rows.map((i) => data.rows[i]);
  const first = rows[0];
  const several = rows.length > 1;
  const range = ([low, high]) => (several && low < high ? ` (${number(low)} to ${number(high)})` : "");
  const facts = [["budget", first.budget]];
  if (first.spp > 0 && !first.budget.startsWith("spp")) facts.push(["samples per pixel", number(first.spp)]);
  facts.push([clockName(), seconds(point.time) + range(point.times)], [METRICS[state.metric].name, number(point.error) + range(point.errors)]);
  if (!several && state.metric === "relmse" && first.relmse_se != null) facts.push(["its standard error", number(first.relmse_se, 2)]);
  if (point.predicted != null) facts.push(["predicted by the method", number(point.predicted)]);
  facts.push(several ? ["runs", `${rows.length} (median, range)`] : ["seed", first.seed]);
  const parts = [["tree", first.tree_cpu_s], ["pass one", first.pass_one_cpu_s], ["pass two", first.pass_two_cpu_s]].filter(([, v]) => v != null);
  if (parts.length) facts.push(["CPU seconds", parts.map(([name, v]) => `${name} ${number(v)}`).join(", ")]);
  if (first.rays != null) facts.push(["rays", number(first.rays)]);
  if (first.peak_memory_bytes != null) facts.push(["memory peak", bytes(first.peak_memory_bytes)]);
  return facts;
}

const tip = document.getElementById("tip");

function showTip(curve, point, x, y) {
  const facts = pointFacts(point).map(([name, value]) => [el("dt", {}, name), el("dd", {}, value)]);
  const picture = pictureOfPoint(point) != null && el("p", {}, "Click or Enter: compare its picture");
  tip.replaceChildren(el("strong", {}, swatch(curve.method), methodName(curve.method)), el("dl", {}, facts), picture || "");
  tip.hidden = false;
  const box = tip.getBoundingClientRect();
  const left = x + 18 + box.width > innerWidth ? x - box.width - 18 : x + 18;
  tip.style.left = `${Math.max(8, left) + scrollX}px`;
  tip.style.top = `${Math.max(8, Math.min(y - box.height / 2, innerHeight - box.height - 8)) + scrollY}px`;
}

/// Pointer: the nearest point. Keys: left and right along a curve, up and down from curve to curve.
function interaction(root, ring, curves, x, y, frame) {
  const spots = curves.map((curve) => curve.points.map((point) => ({ curve, point, x: x.at(point.time), y: point.error > 0 ? y.at(point.error) : frame.bottom - 6 })));
  let [row, column] = [0, 0];
  const show = (spot) => {
    ring.setAttribute("cx", spot.x);
    ring.setAttribute("cy", spot.y);
    ring.setAttribute("stroke", colour(spot.curve.method));
    ring.setAttribute("visibility", "visible");
    const box = root.getBoundingClientRect();
    showTip(spot.curve, spot.point, box.left + spot.x, box.top + spot.y);
  };
  const hide = () => {
    ring.setAttribute("visibility", "hidden");
    tip.hidden = true;
  };
  const nearest = (event) => {
    const box = root.getBoundingClientRect();
    const distance = (spot) => Math.hypot(event.clientX - box.left - spot.x, event.clientY - box.top - spot.y);
    const best = spots.flat().reduce((a, b) => (a && distance(a) <= distance(b) ? a : b), null);
    return best && distance(best) < 36 ? best : null;
  };
  root.addEventListener("pointermove", (event) => {
    const spot = nearest(event);
    root.classList.toggle("over", Boolean(spot));
    if (spot) show(spot);
    else hide();
  });
  root.addEventListener("pointerleave", hide);
  root.addEventListener("blur", hide);
  root.addEventListener("click", (event) => {
    const spot = nearest(event);
    if (spot) openPicture(pictureOfPoint(spot.point));
  });
  root.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] }[event.key];
    if (!spots.length) return;
    if (step) {
      row = (row + step[0] + spots.length) % spots.length;
      column = Math.min(Math.max(column + step[1], 0), spots[row].length - 1);
      show(spots[row][column]);
    } else if (event.key === "Enter") openPicture(pictureOfPoint(spots[row][column].point));
    else if (event.key === "Escape") hide();
    else return;
    event.preventDefault();
  });
}

function drawPlot(host, scene) {
  tip.hidden = true;
  const chart = chartOf(scene);
  const metric = METRICS[state.metric];
  const curves = (chart?.curves ?? []).filter((curve) => !state.hidden.has(curve.method));
  const points = curves.flatMap((curve) => curve.points);
  const errors = points.flatMap((p) => [p.error, ...(state.band ? p.errors : [])]).filter((e) => e > 0);
  if (!errors.length) {
    const why = chart ? "All methods are hidden. Choose some below." : `No run of this scene has a ${metric.name}.`;
    return host.replaceChildren(el("p", { class: "empty" }, why));
  }
  const width = Math.max(300, host.clientWidth || 960);
  const height = Math.round(Math.min(Math.max(0.56 * width, 330), 580));
  const labelled = width >= NARROW;
  const longest = Math.max(...curves.map((curve) => methodName(curve.method).length));
  const frame = { left: 68, right: width - (labelled ? Math.min(24 + 8 * longest, 0.3 * width) : 12), top: 12, bottom: height - 54 };
  const times = points.map((p) => p.time);
  const x = logAxis(Math.min(...times), Math.max(...times), frame.left, frame.right);
  const [least, most] = [Math.min(...errors), Math.max(...errors)];
  const guesses = points.map((p) => (state.predicted ? p.predicted : null)).filter((e) => e > 0);
  const y = logAxis(Math.max(Math.min(least, ...guesses), least / STRETCH), Math.min(Math.max(most, ...guesses), most * STRETCH), frame.bottom, frame.top);

  const summary = `${metric.name} against ${clockName()} for ${plural(curves.length, "method")}; arrow keys go from point to point`;
  const root = svg("svg", { viewBox: `0 0 ${width} ${height}`, width, height, tabindex: 0, role: "application", "aria-label": summary });
  const clip = `clip-${data.scenes.indexOf(scene)}`;
  root.append(svg("defs", {}, svg("clipPath", { id: clip }, svg("rect", { x: frame.left, y: frame.top, width: frame.right - frame.left, height: frame.bottom - frame.top }))));
  const back = svg("g", { "clip-path": `url(#${clip})` });
  grid(back, x, y, frame);
  costLines(back, x, y, metric);
  root.append(back);
  axisLabels(root, x, y, frame, metric);
  const noise = state.metric === "relmse" ? scene.reference_relmse : null;
  if (noise > y.low && noise < y.high) {
    root.append(svg("line", { class: "noise", x1: frame.left, x2: frame.right, y1: y.at(noise), y2: y.at(noise) }));
    root.append(svg("text", { class: "noise-name", x: frame.left + 8, y: y.at(noise) - 6 }, "the references' own relMSE"));
  }
  for (const curve of curves) drawCurve(root, curve, x, y, frame);
  if (labelled) {
    const ends = curves.map((curve) => {
      const end = curve.points[curve.points.length - 1];
      const at = end.error > 0 ? y.at(end.error) : frame.bottom - 6;
      return { method: curve.method, x: x.at(end.time), from: at, y: at };
    });
    spread(ends, frame.top + 8, frame.bottom - 4);
    for (const end of ends) {
      root.append(svg("path", { class: "leader", stroke: colour(end.method), d: `M${end.x + 7} ${end.from}L${frame.right + 4} ${end.y}h6` }));
      root.append(svg("text", { class: "name", x: frame.right + 14, y: end.y + 4, style: `fill:${colour(end.method)}` }, methodName(end.method)));
    }
  }
  const ring = svg("circle", { class: "ring", r: 9, visibility: "hidden" });
  root.append(ring);
  interaction(root, ring, curves, x, y, frame);
  host.replaceChildren(root);
}

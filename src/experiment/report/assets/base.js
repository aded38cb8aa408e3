"use strict";
// Shared by the other scripts: the data, elements, numbers as text, colours and markers.

const data = JSON.parse(document.getElementById("data").textContent);
const SVG = document.getElementById("seed").namespaceURI;

const METRICS = {
  relmse: { name: "relMSE", axis: "relMSE", squared: true, help: "mean squared relative error; noise makes it fall as 1/time" },
  trimmed_relmse: { name: "trimmed relMSE", axis: "relMSE without the least certain 1 %", squared: true, help: "without the 1 % of pixels in which the references differ most" },
  relmse_off_emitters: { name: "relMSE off emitters", axis: "relMSE off emitters", squared: true, help: "without the pixels that see an emitter directly" },
  block9_rms: { name: "9-pixel block RMS", axis: "RMS relative error of 9×9-pixel blocks", squared: false, help: "error of block means: bias shows, most noise does not" },
  flip_ldr: { name: "FLIP", axis: "mean FLIP (LDR)", squared: false, help: "perceived difference at 67 pixels per degree" },
  flip_hdr: { name: "HDR-FLIP", axis: "mean FLIP (HDR)", squared: false, help: "perceived difference over all exposures at 67 pixels per degree" },
};

const state = { metric: "relmse", time: data.scenes.some((s) => s.charts[data.clock]) ? data.clock : "cpu", tree: true, passOne: true, base: 0, predicted: true, band: true, hidden: new Set() };

// Beside CPU time, of which parts can be left out.
const TIMES = { cpu: "CPU time", wall: "Wall time", "cpu-solver": "CPU time of the solver", products: "Products with the form factors" };
const unit = () => (state.time === "products" ? "" : " [s]");

function clockKey() {
  if (state.time !== "cpu") return state.time;
  if (!state.tree && !state.passOne) return "cpu-pass-two";
  if (!state.tree) return "cpu-without-tree";
  return state.passOne ? "cpu" : "cpu-without-pass-one";
}

function clockName() {
  if (state.time !== "cpu") return TIMES[state.time];
  const without = [state.tree ? "" : "tree", state.passOne ? "" : "pass one"].filter(Boolean);
  return "CPU time" + (without.length ? " without " + without.join(" and ") : "");
}

const chartOf = (scene) => scene.charts[clockKey()]?.[state.metric];

// Elements. Children that are no nodes become text, so nothing from the data is ever read as markup.
function fill(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value === true) node.setAttribute(name, "");
    else if (value !== false && value != null) node.setAttribute(name, value);
  }
  node.append(...children.flat(Infinity).filter((child) => child != null && child !== false));
  return node;
}
const el = (tag, attributes = {}, ...children) => fill(document.createElement(tag), attributes, children);
const svg = (tag, attributes = {}, ...children) => fill(document.createElementNS(SVG, tag), attributes, children);

// Numbers.
const SUPERSCRIPT = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };
const superscript = (n) => [...String(n)].map((c) => SUPERSCRIPT[c] ?? c).join("");
const minus = (text) => String(text).replace("-", "−");

/// `digits` significant digits, as a decimal where that is short and as a power of ten elsewhere.
function number(value, digits = 3) {
  if (value == null || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  let exponent = Math.floor(Math.log10(Math.abs(value)));
  if (exponent >= -3 && exponent < 5) return minus(exponent >= digits ? Math.round(value) : Number(value).toPrecision(digits));
  let mantissa = (value / 10 ** exponent).toFixed(digits - 1);
  if (Math.abs(mantissa) >= 10) mantissa = (value / 10 ** ++exponent).toFixed(digits - 1);
  return `${minus(mantissa)}×10${superscript(exponent)}`;
}

/// A round number such as 0.03 or 10⁻⁴.
function level(value) {
  const exponent = Math.floor(Math.log10(value) + 1e-9);
  const digit = Math.round(value / 10 ** exponent);
  if (exponent >= -3 && exponent <= 4) return String(Number(value.toPrecision(2)));
  return (digit === 1 ? "" : digit + "×") + "10" + superscript(exponent);
}

const seconds = (value) => (value == null ? "–" : number(value) + (state.time === "products" ? "" : " s"));
const percent = (share) => `${Math.round(100 * share)} %`;
const bytes = (value) => (value >= 1e9 ? `${(value / 1e9).toFixed(2)} GB` : `${Math.round(value / 1e6)} MB`);
const plural = (n, one, many = one + "s") => `${n} ${n === 1 ? one : many}`;

// Looks of methods: eight colours told apart by colour-blind readers, eight markers, and dashes from the ninth method on.
const COLOURS = 8;
const DASHES = ["", "7 4", "2 3", "9 3 2 3"];
const colour = (method) => `var(--c${method % COLOURS})`;
const dash = (method) => DASHES[Math.floor(method / COLOURS) % DASHES.length];

const polygon = (corners, turn) =>
  Array.from({ length: corners }, (_, i) => turn + (2 * Math.PI * i) / corners).map((a) => [Math.sin(a), -Math.cos(a)]);
const star = Array.from({ length: 10 }, (_, i) => (Math.PI * i) / 5).map((a, i) => [(i % 2 ? 0.5 : 1.2) * Math.sin(a), -(i % 2 ? 0.5 : 1.2) * Math.cos(a)]);
const SHAPES = [
  null,
  polygon(4, Math.PI / 4).map(([x, y]) => [1.2 * x, 1.2 * y]),
  polygon(3, 0).map(([x, y]) => [1.25 * x, 1.25 * y]),
  polygon(4, 0).map(([x, y]) => [1.2 * x, 1.2 * y]),
  polygon(3, Math.PI).map(([x, y]) => [1.25 * x, 1.25 * y]),
  polygon(5, 0).map(([x, y]) => [1.1 * x, 1.1 * y]),
  star,
  polygon(6, Math.PI / 6).map(([x, y]) => [1.1 * x, 1.1 * y]),
];

function marker(method, x, y, size, attributes = {}) {
  const shape = SHAPES[method % SHAPES.length];
  if (!shape) return svg("circle", { cx: x, cy: y, r: size, ...attributes });
  const points = shape.map(([dx, dy]) => `${(x + size * dx).toFixed(2)},${(y + size * dy).toFixed(2)}`).join(" ");
  return svg("polygon", { points, ...attributes });
}

/// A short piece of a method's line with its marker.
function swatch(method) {
  const look = { stroke: colour(method), fill: colour(method) };
  const line = svg("line", { x1: 0, y1: 7, x2: 26, y2: 7, "stroke-width": 2, "stroke-dasharray": dash(method), stroke: colour(method) });
  return svg("svg", { class: "swatch", width: 26, height: 14, viewBox: "0 0 26 14", "aria-hidden": "true" }, line, marker(method, 13, 7, 4, look));
}

const methodName = (method) => data.methods[method][0];
const methodIndex = (name) => data.methods.findIndex(([known]) => known === name);

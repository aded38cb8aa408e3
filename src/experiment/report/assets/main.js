"use strict";
// Puts the page together and redraws it when a control changes.

const scenesRoot = document.getElementById("scenes");
const panels = data.scenes.map((scene, i) => {
  const plot = el("div", { class: "plot" });
  const legend = el("div", { class: "legend", role: "group", "aria-label": "Methods shown" });
  const figures = el("div", { class: "figures" });
  const title = el("h2", { id: `scene-${i}` }, scene.name);
  scenesRoot.append(el("section", { class: "scene", "aria-labelledby": `scene-${i}` }, title, sceneFacts(scene), plot, legend, figures, sceneNotes(scene)));
  return { scene, plot, legend, figures };
});

function sceneFacts(scene) {
  const noise = scene.reference_relmse;
  const facts = [
    scene.file && el("span", {}, el("code", {}, scene.file)),
    scene.references.length ? el("span", {}, plural(scene.references.length, "independent reference"), noise != null && `, own relMSE ${number(noise)}`) : el("span", {}, "no reference"),
    el("span", {}, plural(data.rows.filter((r) => r.scene === scene.name).length, "row")),
  ];
  return el("p", { class: "facts" }, facts);
}

function sceneNotes(scene) {
  const list = (title, lines) => lines.length > 0 && [el("h4", {}, title), el("ul", {}, lines.map((line) => el("li", {}, line)))];
  const links = scene.plots.map((plot) => el("li", {}, plot.replace(/^plots\//, ""), " ", el("a", { href: `${plot}.svg` }, "SVG"), " ", el("a", { href: `${plot}.png` }, "PNG")));
  const parts = [list("Left out by the program", scene.left_out), list("Warnings of the reader", scene.warnings), links.length > 0 && [el("h4", {}, "Plots for papers"), el("ul", { class: "links" }, links)],
    scene.hash && el("p", { class: "hash" }, "Hash of all that was read: ", el("code", {}, scene.hash))];
  return el("div", { class: "notes" }, parts);
}

function legendButton(method) {
  const press = () => {
    if (!state.hidden.delete(method)) state.hidden.add(method);
    redraw();
  };
  const shown = !state.hidden.has(method);
  return el("button", { type: "button", "aria-pressed": String(shown), title: data.methods[method][1], onclick: press, "data-method": method }, swatch(method), methodName(method));
}

function controls() {
  const form = document.getElementById("controls");
  const present = Object.keys(METRICS).filter((key) => data.scenes.some((s) => s.charts.cpu[key]));
  if (present.length && !present.includes(state.metric)) state.metric = present[0];
  const select = (label, id, options, change) => el("label", {}, el("span", {}, label), el("select", { id, onchange: (e) => { change(e.target.value); redraw(); } }, options));
  const check = (label, id, key, title) => el("label", { class: "check", title }, el("input", { type: "checkbox", id, checked: state[key], onchange: (e) => { state[key] = e.target.checked; redraw(); } }), label);
  form.append(
    select("Error", "metric", present.map((key) => el("option", { value: key }, METRICS[key].name)), (value) => (state.metric = value)),
    select("Time", "clock", Object.keys(TIMES).filter((key) => data.scenes.some((s) => s.charts[key])).map((key) => el("option", { value: key, selected: key === state.time }, TIMES[key])), (value) => (state.time = value)),
    el("fieldset", {}, el("legend", {}, "Count"), check("tree", "count-tree", "tree", "the ray engine's tree, where a method tells it apart"), check("pass one", "count-pass-one", "passOne", "patches, direct light, form factors, solver")),
    select("Compare with", "base", data.methods.map(([name], i) => el("option", { value: i }, name)), (value) => (state.base = Number(value))),
    el("fieldset", {}, el("legend", {}, "Show"), check("spread", "show-band", "band", "smallest to largest over seeds and repeats"), check("predicted", "show-predicted", "predicted", "what methods say of their own error")),
  );
  form.addEventListener("submit", (event) => event.preventDefault());
}

function redraw() {
  for (const id of ["count-tree", "count-pass-one"]) document.getElementById(id).disabled = state.time !== "cpu";
  const active = document.activeElement?.dataset?.method;
  const host = document.activeElement?.closest?.(".scene");
  document.getElementById("overview").replaceChildren(...[overview()].flat().filter(Boolean));
  for (const { scene, plot, legend, figures } of panels) {
    drawPlot(plot, scene);
    legend.replaceChildren(...(chartOf(scene)?.curves ?? []).map((curve) => legendButton(curve.method)));
    figures.replaceChildren(...tables(scene).filter(Boolean));
  }
  if (active != null && host) host.querySelector(`button[data-method="${active}"]`)?.focus();
}

function about() {
  const environment = Object.entries(data.environment).map(([name, value]) => el("tr", {}, el("th", { scope: "row" }, name), el("td", { class: "message" }, value)));
  const methods = data.methods.map(([, what], method) => el("tr", {}, rowHead(method), el("td", { class: "message" }, what || "–")));
  const left = data.pictures_left_out;
  fill(document.getElementById("about"), { "aria-labelledby": "about-title" }, [
    el("h2", { id: "about-title" }, "How this was measured"),
    table("Methods", null, ["Method", "What it is"], methods),
    table("Machine and versions", null, ["What", "Value"], environment),
    el("h4", {}, "Reading the figures"),
    el("ul", {},
      el("li", {}, "A run is timed after its scene is loaded; judging and writing pictures is not timed. Pass one and the ray engine's tree are counted unless switched off above."),
      el("li", {}, "A point is the median over seeds and repeats of one budget; the band runs from the smallest to the largest."),
      el("li", {}, "Squared errors are products of the differences to two independent references, so the references' noise adds nothing to their mean. Close to a reference the product may be negative: a small triangle at the foot of the plot."),
      el("li", {}, "Faint diagonals join points of equal cost, error × time (for metrics that are roots: error² × time).")),
    left.length > 0 && el("h4", {}, "Pictures that are not in this page"),
    left.length > 0 && el("ul", {}, left.map((line) => el("li", {}, line))),
    el("h4", {}, "The plan"),
    el("pre", {}, data.plan),
    el("p", {}, "All rows: ", el("a", { href: "rows.csv" }, "rows.csv")),
  ]);
}

function contents() {
  const date = data.environment.date ?? data.environment.Date;
  const done = data.rows.filter((row) => row.status === "done").length;
  const failed = data.rows.length - done;
  const facts = [plural(data.scenes.length, "scene"), plural(data.methods.length, "method"), plural(done, "measured picture"), failed ? `${failed} failed` : null, date];
  document.getElementById("byline").append(facts.filter(Boolean).join(" · "));
  const links = data.scenes.map((scene, i) => el("a", { href: `#scene-${i}` }, scene.name));
  if (data.pictures.length) links.push(el("a", { href: "#viewer" }, "Compare pictures"));
  document.getElementById("contents").append(...links, el("a", { href: "#about" }, "How this was measured"));
}

contents();
controls();
about();
startViewer();
redraw();
let lastWidth = document.documentElement.clientWidth;
window.addEventListener("resize", () => {
  if (document.documentElement.clientWidth === lastWidth) return;
  lastWidth = document.documentElement.clientWidth;
  panels.forEach(({ scene, plot }) => drawPlot(plot, scene));
});

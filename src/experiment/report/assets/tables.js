"use strict";
// Tables. Every number comes from the data; only ratios to the base method are divided here.

function table(caption, note, head, rows) {
  const wide = el("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": caption });
  // Columns of words begin at the left, columns of numbers end at the right.
  const isWords = (i) => rows.some((row) => row.children[i]?.className === "message");
  const header = el("tr", {}, head.map((text, i) => el("th", { scope: "col", class: isWords(i) && "message" }, text)));
  wide.append(el("table", {}, el("thead", {}, header), el("tbody", {}, rows)));
  return el("figure", { class: "table" }, el("figcaption", {}, el("h4", {}, caption), note && el("p", {}, note)), wide);
}

const rowHead = (method) => el("th", { scope: "row" }, el("span", { class: "method" }, swatch(method), methodName(method)));
const cell = (text, under, look = "") => el("td", { class: look }, text, under && el("small", {}, under));

/// "0.42×" of a time or error and its base, with a sign where one of the two is only a bound.
function ratio(value, base, sign = "") {
  return value > 0 && base > 0 ? `${sign}${number(value / base, 2)}×` : null;
}

function reachTable(chart) {
  const base = chart.curves.find((curve) => curve.method === state.base);
  const best = chart.levels.map((_, i) => Math.min(...chart.curves.map((c) => (c.reach[i].kind === "not" ? Infinity : c.reach[i].time))));
  const rows = chart.curves.map((curve) => {
    const cells = curve.reach.map((reach, i) => {
      if (reach.kind === "not") return cell("not reached", null, "none");
      const before = reach.kind === "before";
      const other = base && base !== curve ? base.reach[i] : { kind: "not" };
      // A bound over a number is a bound; a bound over a bound is nothing.
      const sign = before ? "≤ " : other.kind === "before" ? "≥ " : "";
      const known = other.kind !== "not" && !(before && other.kind === "before");
      const look = reach.time === best[i] ? "best" : "";
      return cell((before ? "≤ " : "") + seconds(reach.time), known ? ratio(reach.time, other.time, sign) : null, look);
    });
    return el("tr", {}, rowHead(curve.method), cells);
  });
  const note = `${clockName()} from which the median error stays below, by interpolation between logarithms; never extrapolated. `
    + `Second line: ratio to ${methodName(state.base)} (below 1: faster). “≤”: the first picture is better already.`;
  return table("Time to reach an error", note, ["Method", ...chart.levels.map((v) => `${METRICS[state.metric].name} ${level(v)}`)], rows);
}

function errorTable(chart) {
  const base = chart.curves.find((curve) => curve.method === state.base);
  const best = chart.times.map((_, i) => Math.min(...chart.curves.map((c) => c.error_at[i] ?? Infinity)));
  const rows = chart.curves.map((curve) => {
    const cells = curve.error_at.map((error, i) => {
      if (error == null) return cell("–", null, "none");
      const other = base && base !== curve ? base.error_at[i] : null;
      return cell(number(error), ratio(error, other), error === best[i] ? "best" : "");
    });
    return el("tr", {}, rowHead(curve.method), cells);
  });
  const note = `Median ${METRICS[state.metric].name} after the same ${clockName()}; “–”: not measured there. Second line: ratio to `
    + `${methodName(state.base)} (below 1: better).`;
  return table("Error at equal times", note, ["Method", ...chart.times.map((v) => `${level(v)} s`)], rows);
}

function slopeCell(slope) {
  if (!slope) return cell("–", null, "none");
  const how = slope.se == null ? "2 points" : slope.runs ? `${slope.runs} runs` : `${slope.points} points`;
  const se = slope.se == null ? "" : ` ± ${slope.se.toFixed(2)}`;
  return cell(minus(slope.value.toFixed(2)) + se, how);
}

function floorCell(floor) {
  if (!floor) return cell("–", "too few points", "none");
  if (floor.distinguishable) return cell(number(floor.value), `at most ${number(floor.upper)}`, "biased");
  return cell("none seen", `at most ${number(floor.upper)}`, "none");
}

function convergenceTable(chart) {
  const squared = METRICS[state.metric].squared;
  const anyBelow = chart.curves.some((curve) => curve.below_noise);
  const rows = chart.curves.map((curve) => {
    const last = curve.points[curve.points.length - 1];
    const noise = anyBelow && cell(curve.below_noise ? plural(curve.below_noise, "row") : "–");
    return el("tr", {}, rowHead(curve.method), slopeCell(curve.slope), floorCell(curve.floor), cell(curve.cost == null ? "–" : `${number(curve.cost)} s`),
      cell(number(last.error), `after ${seconds(last.time)}`), noise);
  });
  const law = squared ? "error = floor + c/t" : "error² = floor² + c/t";
  const note = `Slope of log error over log time in the last decade, with its standard error; ${squared ? "−1" : "−½"} is pure noise. `
    + `Floor: fit of ${law} against the CPU time of pass two, robust, in relative error; “none seen” if its 95 % interval holds 0. `
    + `Cost: ${squared ? "error" : "error²"} × time of the last picture.`;
  return table("Convergence and bias", note, ["Method", "Slope", "Bias floor", "Cost", "Last error", ...(anyBelow ? ["Below reference noise"] : [])], rows);
}

function predictionTable(scene) {
  const rows = scene.predictions.map((p, method) => {
    if (!p) return null;
    return el("tr", {}, rowHead(method), cell(`${number(p.factor, 2)}×`), cell(percent(p.within_2)), cell(percent(p.within_4)), cell(p.count));
  });
  if (rows.every((row) => !row)) return null;
  const note = "What methods say of their own relMSE (open markers in the plot) over what was measured, all times and seeds together.";
  return table("Predicted against measured error", note, ["Method", "Median factor", "Within 2×", "Within 4×", "Rows"], rows.filter(Boolean));
}

function failedTable(scene) {
  if (!scene.failed.length) return null;
  const rows = scene.failed.map((i) => {
    const row = data.rows[i];
    const status = el("span", { class: "status" }, row.status);
    return el("tr", {}, rowHead(methodIndex(row.method)), cell(row.budget), cell(row.seed), cell(status), el("td", { class: "message" }, row.message || "–"));
  });
  return table(`${plural(rows.length, "run")} without a result`, "In no curve and no table above.", ["Method", "Budget", "Seed", "Status", "Message"], rows);
}

function tables(scene) {
  const chart = chartOf(scene);
  if (!chart) return [failedTable(scene)];
  return [reachTable(chart), errorTable(chart), convergenceTable(chart), predictionTable(scene), failedTable(scene)];
}

/// The head of the page: the hardest error that at least two methods reach, scene by scene.
function overview() {
  const charts = data.scenes.map(chartOf);
  const hardest = (chart) => (chart ? chart.levels.findLastIndex((_, i) => chart.curves.filter((c) => c.reach[i].kind !== "not").length >= 2) : -1);
  const columns = charts.map((chart) => ({ chart, i: hardest(chart) }));
  if (columns.every((c) => c.i < 0)) return null;
  const best = columns.map(({ chart, i }) => (i < 0 ? 0 : Math.min(...chart.curves.map((c) => (c.reach[i].kind === "not" ? Infinity : c.reach[i].time)))));
  const rows = data.methods.map((_, method) => {
    const cells = columns.map(({ chart, i }, column) => {
      const reach = i < 0 ? null : chart.curves.find((c) => c.method === method)?.reach[i];
      if (!reach) return cell("–", null, "none");
      if (reach.kind === "not") return cell("not reached", null, "none");
      const slower = reach.time / best[column];
      return cell((reach.kind === "before" ? "≤ " : "") + seconds(reach.time), slower > 1 ? `${number(slower, 2)}× the best` : "best", slower > 1 ? "" : "best");
    });
    return el("tr", {}, rowHead(method), cells);
  });
  const heads = columns.map(({ chart, i }, n) => [el("a", { href: `#scene-${n}` }, data.scenes[n].name), el("small", {}, i < 0 ? "" : `to ${METRICS[state.metric].name} ${level(chart.levels[i])}`)]);
  const note = `${clockName()} to the smallest error that at least two methods reach in each scene.`;
  return [el("h2", {}, "At a glance"), table("Time to the same error", note, ["Method", ...heads], rows)];
}

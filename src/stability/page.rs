//! The rows as a table of text, as CSV and as a page that needs nothing else.

use super::{Row, Verdict};
use std::fmt::Write;

/// Width and height of a plot [CSS pixels].
const PLOT: (f64, f64) = (260.0, 130.0);

/// Space for the labels of a plot [CSS pixels]: left, bottom.
const LABELS: (f64, f64) = (46.0, 30.0);

/// One row as a line of text: number, verdict, case, law, expected, got, error and its bound.
pub fn line(row: &Row) -> String {
    let error = match (row.error, row.bound) {
        (Some(error), Some(bound)) => format!("  error {error:.1e} of {bound:.0e}"),
        _ => String::new(),
    };
    let expected = if row.expected.is_empty() { String::new() } else { format!("  expected {}", row.expected) };
    format!("{:4}{:12}{}: {}{expected}  got {}{error}\n", row.id, row.verdict.word(), row.name, row.law, row.got)
}

/// How many rows hold, fail and are not covered.
pub fn summary(rows: &[Row]) -> String {
    let count = |verdict| rows.iter().filter(|r| r.verdict == verdict).count();
    let seconds: f64 = rows.iter().map(|r| r.seconds).sum();
    format!(
        "{} hold, {} fail, {} not covered; {seconds:.0} s",
        count(Verdict::Holds),
        count(Verdict::Fails),
        count(Verdict::NotCovered)
    )
}

/// All rows as CSV (RFC 4180).
pub fn csv(rows: &[Row]) -> String {
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
    let optional = |value: Option<f64>| value.map_or_else(String::new, |v| format!("{v:e}"));
    let mut text = "id,case,law,expected,got,error,bound,verdict,seconds,curve_axis,curve\n".to_owned();
    for row in rows {
        let curve = row.curve.as_ref().map(|c| c.points.iter().map(|(x, y)| format!("{x}:{y:e}")).collect::<Vec<_>>().join(" "));
        let fields = [
            row.id.to_owned(),
            quoted(&row.name),
            quoted(&row.law),
            quoted(&row.expected),
            quoted(&row.got),
            optional(row.error),
            optional(row.bound),
            row.verdict.word().to_owned(),
            format!("{:.3}", row.seconds),
            row.curve.as_ref().map_or("", |c| c.axis).to_owned(),
            curve.unwrap_or_default(),
        ];
        text += &(fields.join(",") + "\n");
    }
    text
}

/// A page that needs no network: the table, and a plot where a row has a curve.
pub fn html(rows: &[Row], version: &str) -> String {
    let mut body = String::new();
    for row in rows {
        let class = match row.verdict {
            Verdict::Holds => "holds",
            Verdict::Fails => "fails",
            Verdict::NotCovered => "open",
        };
        let error = match (row.error, row.bound) {
            (Some(error), Some(bound)) => format!("{error:.1e} <span>of {bound:.0e}</span>"),
            _ => String::new(),
        };
        // One point is no curve: its error stands beside it.
        let curve = row.curve.as_ref().filter(|c| c.points.len() > 1);
        let plot = curve.map(|c| plot(c.axis, &c.points, row.bound)).unwrap_or_default();
        // Writing to a String cannot fail.
        let _ = writeln!(
            body,
            "<tr class=\"{class}\"><td>{}</td><td class=\"verdict\">{}</td><td><b>{}</b><br>{}</td><td>{}</td><td>{}</td>\
             <td class=\"number\">{error}</td><td>{plot}</td></tr>",
            row.id,
            row.verdict.word(),
            escaped(&row.name),
            escaped(&row.law),
            escaped(&row.expected),
            escaped(&row.got),
        );
    }
    format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
         content=\"width=device-width\"><title>twopass stability</title><style>{STYLE}</style></head><body><h1>Stiff and extreme \
         cases</h1><p>twopass {}. {}. Each row states a law and what was got; expected values come from formulas, or from the same \
         scene stated in another way. Plots: error over work, both logarithmic; the dashed line is the bound.</p><table><thead><tr>\
         <th>case</th><th>verdict</th><th>law</th><th>expected</th><th>got</th><th>error</th><th>error over work</th></tr></thead>\
         <tbody>\n{body}</tbody></table></body></html>\n",
        escaped(version),
        escaped(&summary(rows))
    )
}

const STYLE: &str = ":root{color-scheme:light dark;--ink:#1b1f24;--paper:#fff;--rule:#d6dade;--soft:#666e78;--good:#1a7f37;--bad:#c62828;\
    --open:#9a6700;--line:#2563c9}@media(prefers-color-scheme:dark){:root{--ink:#e6e9ed;--paper:#14171b;--rule:#343a42;--soft:#9aa4b0;\
    --good:#4ac26b;--bad:#ff7b72;--open:#d8a53a;--line:#79aaff}}body{font:14px/1.45 system-ui,sans-serif;color:var(--ink);\
    background:var(--paper);margin:2rem auto;max-width:82rem;padding:0 1rem}table{border-collapse:collapse;width:100%}\
    th,td{text-align:left;vertical-align:top;padding:.45rem .6rem;border-bottom:1px solid var(--rule);overflow-wrap:break-word}\
    th{position:sticky;top:0;background:var(--paper)}td:first-child{white-space:nowrap}td:nth-child(3){min-width:16rem}td:nth-child(4){min-width:7rem}\
    td:nth-child(5){max-width:24rem}td span,.tick{color:var(--soft)}\
    .verdict,.number{white-space:nowrap;font-variant-numeric:tabular-nums}.holds .verdict{color:var(--good)}\
    .fails .verdict{color:var(--bad);font-weight:700}.open .verdict{color:var(--open)}svg{display:block}svg text{font-size:10px;\
    fill:var(--soft)}@media print{th{position:static}tr{break-inside:avoid}}";

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A curve on logarithmic axes, with the bound as a dashed line.
fn plot(axis: &str, points: &[(f64, f64)], bound: Option<f64>) -> String {
    let range = |values: &mut dyn Iterator<Item = f64>| {
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v.log10()), b.max(v.log10())));
        // Adding 0 makes -0 a 0.
        (low.floor() + 0.0, high.ceil().max(low.floor() + 1.0) + 0.0)
    };
    let x = range(&mut points.iter().map(|p| p.0));
    let y = range(&mut points.iter().map(|p| p.1).chain(bound.filter(|b| *b > 0.0)));
    let (width, height) = PLOT;
    let across = |v: f64| LABELS.0 + (v.log10() - x.0) / (x.1 - x.0) * (width - LABELS.0 - 8.0);
    let up = |v: f64| 6.0 + (y.1 - v.log10()) / (y.1 - y.0) * (height - LABELS.1 - 6.0);
    let path: Vec<String> = points.iter().map(|p| format!("{:.1},{:.1}", across(p.0), up(p.1))).collect();
    let mut svg = format!("<svg width=\"{width}\" height=\"{height}\" role=\"img\" aria-label=\"error over {axis}\">");
    let (left, bottom, right) = (LABELS.0, height - LABELS.1, width - 8.0);
    svg += &format!("<path d=\"M{left} 6V{bottom}H{right}\" fill=\"none\" stroke=\"var(--rule)\"/>");
    for (value, at) in [(y.0, bottom), (y.1, 10.0)] {
        svg += &format!("<text x=\"{}\" y=\"{:.0}\" text-anchor=\"end\">1e{value}</text>", left - 4.0, at + 3.0);
    }
    for (value, at, anchor) in [(x.0, left, "start"), (x.1, right, "end")] {
        svg += &format!("<text x=\"{at}\" y=\"{}\" text-anchor=\"{anchor}\">1e{value}</text>", bottom + 12.0);
    }
    svg +=
        &format!("<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>", 0.5 * (left + right), bottom + 24.0, escaped(axis));
    if let Some(bound) = bound.filter(|b| *b > 0.0) {
        let at = up(bound);
        svg += &format!("<path d=\"M{left} {at:.1}H{right}\" stroke=\"var(--soft)\" stroke-dasharray=\"4 3\"/>");
    }
    svg += &format!("<polyline points=\"{}\" fill=\"none\" stroke=\"var(--line)\" stroke-width=\"1.5\"/>", path.join(" "));
    for (point, place) in points.iter().zip(&path) {
        let (cx, cy) = place.split_once(',').unwrap_or(("0", "0"));
        svg += &format!(
            "<circle cx=\"{cx}\" cy=\"{cy}\" r=\"2.5\" fill=\"var(--line)\"><title>{} {}: {:.2e}</title></circle>",
            point.0,
            escaped(axis),
            point.1
        );
    }
    svg + "</svg>"
}

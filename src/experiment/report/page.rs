//! The page: one file with styles, scripts, numbers and pictures in it, and nothing fetched from anywhere.

use super::analysis::Prediction;
use super::curves::{self, Chart, Clock, METRICS, Metric};
use super::pictures::{Gallery, Picture};
use crate::experiment::{Outcome, Row, SceneRecord, Status};
use serde::Serialize;
use std::collections::BTreeMap;

const TEMPLATE: &str = include_str!("assets/page.html");
const STYLE: &str = include_str!("assets/style.css");
const SCRIPTS: [&str; 6] = [
    include_str!("assets/base.js"),
    include_str!("assets/plot.js"),
    include_str!("assets/tables.js"),
    include_str!("assets/picture.js"),
    include_str!("assets/viewer.js"),
    include_str!("assets/main.js"),
];

/// What the scripts draw: every number of the page.
#[derive(Serialize)]
struct Data<'a> {
    title: &'a str,
    plan: &'a str,
    clock: &'a str,
    environment: &'a BTreeMap<String, String>,
    methods: Vec<(String, String)>,
    rows: &'a [Row],
    scenes: Vec<SceneData<'a>>,
    pictures: &'a [Picture],
    pictures_left_out: &'a [String],
}

#[derive(Serialize)]
struct SceneData<'a> {
    #[serde(flatten)]
    record: &'a SceneRecord,
    /// By clock, then by metric.
    charts: BTreeMap<&'static str, BTreeMap<&'static str, Chart>>,
    /// By method.
    predictions: Vec<Option<Prediction>>,
    /// Rows that are not `done`.
    failed: Vec<usize>,
    /// Files of plots, without their endings, relative to the page.
    plots: &'a [String],
}

/// Methods in the order of the plan, then those that only rows name.
pub fn methods(outcome: &Outcome) -> Vec<(String, String)> {
    let mut methods = outcome.methods.clone();
    for row in &outcome.rows {
        if !methods.iter().any(|(name, _)| *name == row.method) {
            methods.push((row.method.clone(), String::new()));
        }
    }
    methods
}

/// The page's text. `plots` are the names of plot files by scene.
pub fn text(outcome: &Outcome, gallery: &Gallery, plots: &[Vec<String>]) -> String {
    let methods = methods(outcome);
    let names: Vec<String> = methods.iter().map(|(name, _)| name.clone()).collect();
    let scene = |(i, record)| scene_data(outcome, record, &names, plots.get(i).map_or(&[], Vec::as_slice));
    let data = Data {
        title: &outcome.title,
        plan: &outcome.plan,
        clock: &outcome.clock,
        environment: &outcome.environment,
        rows: &outcome.rows,
        scenes: outcome.scenes.iter().enumerate().map(scene).collect(),
        pictures: &gallery.pictures,
        pictures_left_out: &gallery.left_out,
        methods,
    };
    let json = serde_json::to_string(&data).expect("names and numbers have a JSON form");
    let block = |name: &str, i: usize, text: &str| format!("<script type=\"text/plain\" id=\"{name}-{i}\">{text}</script>\n");
    let flip = |i: usize, p: &Picture| if p.has_flip { block("flip", i, &p.flip) } else { String::new() };
    let picture = |(i, p): (usize, &Picture)| block("picture", i, &p.data) + &flip(i, p);
    let pictures: String = gallery.pictures.iter().enumerate().map(picture).collect();
    let scripts: String = SCRIPTS.iter().map(|script| format!("<script>\n{script}</script>\n")).collect();
    // In one sweep, so that nothing filled in is searched for further marks.
    fill(
        TEMPLATE,
        &[
            ("title", &html(&outcome.title)),
            ("style", STYLE),
            ("data", &inside_script(&json)),
            ("pictures", &pictures),
            ("scripts", &scripts),
        ],
    )
}

fn scene_data<'a>(outcome: &Outcome, record: &'a SceneRecord, names: &[String], plots: &'a [String]) -> SceneData<'a> {
    let charts_of = |clock: Clock| {
        let chart = |metric: &Metric| Some((metric.key, curves::chart(&outcome.rows, &record.name, names, metric, clock)?));
        (clock.key(), METRICS.iter().filter_map(chart).collect())
    };
    let failed = |(_, row): &(usize, &Row)| row.scene == record.name && row.status != Status::Done;
    SceneData {
        record,
        charts: Clock::ALL.into_iter().filter(|clock| clock.tells(&outcome.rows)).map(charts_of).collect(),
        predictions: curves::predictions(&outcome.rows, &record.name, names),
        failed: outcome.rows.iter().enumerate().filter(failed).map(|(i, _)| i).collect(),
        plots,
    }
}

/// Replaces each `{{name}}` of a template.
fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let mut parts = template.split("{{");
    let mut text = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (name, rest) = part.split_once("}}").unwrap_or(("", part));
        text.push_str(values.iter().find(|(known, _)| *known == name).map_or("", |(_, value)| value));
        text.push_str(rest);
    }
    text
}

/// Text for the contents or an attribute of an element.
pub fn html(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;").replace('\'', "&#39;")
}

/// JSON for the inside of a script element: without `<` no text of it can end the element. Valid, since `<` occurs in strings only.
fn inside_script(json: &str) -> String {
    json.replace('<', "\\u003c")
}

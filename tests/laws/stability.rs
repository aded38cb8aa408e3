//! The stiff and extreme cases: the quick ones of `twopass stability`, and what it writes.

use twopass::stability::{Row, Verdict, ids, page, run_some};

/// Those that take a second at most; the whole catalogue is a command.
const QUICK: [&str; 11] = ["B2", "B3", "B4", "B5", "B7", "B9", "B13", "B15", "B16", "B20", "B22"];

fn rows() -> Vec<Row> {
    run_some(&QUICK, &mut |_| {})
}

#[test]
fn the_catalogue_holds() {
    let rows = rows();
    let failed: String = rows.iter().filter(|r| r.verdict == Verdict::Fails).map(page::line).collect();
    assert!(failed.is_empty(), "{failed}");
    assert!(QUICK.iter().all(|id| rows.iter().any(|r| r.id == *id)), "a case gave no row");
}

#[test]
fn the_catalogue_is_complete() {
    let want: Vec<String> = (1..=24).map(|k| format!("B{k}")).collect();
    assert_eq!(ids(), want);
}

#[test]
fn table_and_page_hold_every_row() {
    let rows = run_some(&["B2", "B3", "B13"], &mut |_| {});
    let csv = page::csv(&rows);
    assert_eq!(csv.lines().count(), rows.len() + 1, "{csv}");
    assert!(csv.lines().skip(1).all(|line| line.contains(",holds,")), "{csv}");
    let html = page::html(&rows, "0");
    assert_eq!(html.matches("<tr class=").count(), rows.len());
    // Nothing from elsewhere: the page works from a file, without a network.
    assert!(!html.contains("http") && !html.contains("src=") && !html.contains("<script"), "the page asks for something");
    assert!(html.contains(&format!("{} hold, 0 fail", rows.len())));
}

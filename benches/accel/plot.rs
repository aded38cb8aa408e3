//! Time of a ray over the number of triangles, as a figure.

use plotters::element::DashedPathElement;
use plotters::prelude::*;

/// One scene.
pub struct Point {
    /// Number of triangles.
    pub n_triangles: f64,
    /// Seconds of CPU time for a ray of each kind, with the tree.
    pub by_tree: Vec<f64>,
    /// The same when every triangle is tested.
    pub by_all: Vec<f64>,
}

/// Kinds of rays, in the order of [`Point`], and their colours (Okabe and Ito's, told apart by the colour-blind too).
const KINDS: [(&str, RGBColor); 4] = [
    ("primary", RGBColor(0, 114, 178)),
    ("secondary", RGBColor(213, 94, 0)),
    ("shadow", RGBColor(0, 158, 115)),
    ("patch to patch", RGBColor(204, 121, 167)),
];

/// Writes an SVG: full lines for the tree, broken ones for brute force.
pub fn draw(path: &str, points: &[Point]) -> Result<(), Box<dyn std::error::Error>> {
    let root = SVGBackend::new(path, (760, 480)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(14)
        .x_label_area_size(44)
        .y_label_area_size(64)
        .build_cartesian_2d((30.0..150_000.0_f64).log_scale(), (1e-8..1e-2_f64).log_scale())?;
    chart
        .configure_mesh()
        .x_desc("triangles")
        .y_desc("seconds of CPU time for a ray")
        .light_line_style(WHITE)
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| format!("{y:.0e}"))
        .draw()?;
    for (index, (name, color)) in KINDS.into_iter().enumerate() {
        let tree = points.iter().map(|p| (p.n_triangles, p.by_tree[index]));
        let all = points.iter().map(|p| (p.n_triangles, p.by_all[index]));
        chart
            .draw_series(LineSeries::new(tree, color.stroke_width(2)))?
            .label(format!("{name}, tree"))
            .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 20, y)], color.stroke_width(2)));
        chart
            .draw_series(DashedLineSeries::new(all, 5, 4, color.stroke_width(2)))?
            .label(format!("{name}, every triangle"))
            .legend(move |(x, y)| DashedPathElement::new([(x, y), (x + 20, y)], 5, 4, color.stroke_width(2)));
    }
    let labels = SeriesLabelPosition::UpperLeft;
    chart.configure_series_labels().position(labels).background_style(WHITE.mix(0.8)).border_style(BLACK).draw()?;
    root.present()?;
    Ok(())
}

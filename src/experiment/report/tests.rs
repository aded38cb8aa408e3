use super::curves::{Clock, METRICS, chart};
use super::encode::{half_floats, reduced};
use super::*;
use crate::experiment::{Row, RowKind, SceneRecord, Status};
use crate::film::io::{Header, write_exr};
use crate::film::{Image, Layer};
use base64::Engine;
use std::io::Read;

/// Two methods in one scene: `path` with relmse 0.4/t, `two-pass` with a floor of 0.003 + 0.02/t after 2 s of pass one.
fn outcome() -> Outcome {
    let mut rows = Vec::new();
    for spp in [1, 2, 4, 8, 16, 32, 64] {
        for seed in 0..3_u32 {
            let spread = 1.0 + 0.1 * (f64::from(seed) - 1.0);
            let time = 0.25 * f64::from(spp);
            let row =
                Row { scene: "box".into(), budget: format!("spp={spp}"), seed: seed.into(), spp: spp.into(), ..Row::default() };
            let path =
                Row { method: "path".into(), cpu_s: time, wall_s: time / 2.0, relmse: Some(spread * 0.4 / time), ..row.clone() };
            let error = 0.003 + spread * 0.02 / time;
            let two_pass =
                Row { method: "two-pass".into(), cpu_s: 2.0 + time, wall_s: 1.5 + time / 2.0, relmse: Some(error), ..row };
            let two_pass =
                Row { pass_one_cpu_s: Some(1.5), tree_cpu_s: Some(0.5), predicted_relmse: Some(0.02 / time), ..two_pass };
            rows.extend([path, two_pass]);
        }
    }
    let failed = Row {
        scene: "box".into(),
        method: "path".into(),
        status: Status::Failed,
        message: "boom </script><b>".into(),
        ..Row::default()
    };
    rows.push(failed);
    Outcome {
        title: "Boxes </script><script>alert('no')</script> & <b>more</b>".into(),
        plan: "title = \"<!-- </SCRIPT\"\n# {{data}} stays as it is".into(),
        scenes: vec![SceneRecord { name: "box".into(), ..SceneRecord::default() }],
        methods: vec![("path".into(), "a path tracer".into()), ("two-pass".into(), "ours".into())],
        rows,
        ..Outcome::default()
    }
}

fn names() -> Vec<String> {
    vec!["path".into(), "two-pass".into()]
}

fn written(outcome: &Outcome) -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    write(outcome, folder.path()).unwrap();
    let text = std::fs::read_to_string(folder.path().join("index.html")).unwrap();
    (folder, text)
}

/// What stands between an element's start tag and `</script>`.
fn element<'a>(page: &'a str, start: &str) -> &'a str {
    page.split_once(start).unwrap().1.split_once("</script>").unwrap().0
}

#[test]
fn medians_over_seeds_make_the_curve() {
    let chart = chart(&outcome().rows, "box", &names(), &METRICS[0], Clock::Cpu).unwrap();
    let point = &chart.curves[0].points[2];
    assert_eq!((point.time, point.error), (1.0, 0.4));
    assert!((point.errors[0] - 0.36).abs() < 1e-12 && (point.errors[1] - 0.44).abs() < 1e-12);
    assert_eq!(point.rows.len(), 3);
    assert_eq!(chart.curves[0].points.len(), 7);
    let slope = chart.curves[0].slope.unwrap();
    assert!((slope.value + 1.0).abs() < 1e-9 && slope.runs == 3);
    assert!((chart.curves[0].cost.unwrap() - 0.4).abs() < 1e-12);
}

#[test]
fn clocks_leave_out_what_their_names_say() {
    let row = Row { cpu_s: 10.0, wall_s: 6.0, tree_cpu_s: Some(1.0), pass_one_cpu_s: Some(3.0), ..Row::default() };
    let row = Row { solve_cpu_s: Some(0.5), products: Some(12), ..row };
    assert_eq!(Clock::ALL.map(|c| c.seconds(&row)), [10.0, 9.0, 7.0, 6.0, 0.5, 12.0, 6.0]);
    let untold = Row { cpu_s: 10.0, wall_s: 6.0, ..Row::default() };
    assert_eq!(Clock::ALL.map(|c| c.seconds(&untold)), [10.0, 10.0, 10.0, 10.0, 10.0, 1.0, 6.0]);
    // Of the solver only rows of pass one speak.
    let tells = |kind| Clock::ALL.map(|c| c.tells(&[Row { kind, ..row.clone() }]));
    assert_eq!(tells(RowKind::PassOne), [true; 7]);
    assert_eq!(tells(RowKind::default()), [true, true, true, true, false, false, true]);
}

#[test]
fn a_floor_is_fitted_to_the_time_of_pass_two() {
    // Against all time the law 0.003 + 0.02/(t - 2) would not be one of 1/t.
    for clock in [Clock::Cpu, Clock::Wall] {
        let chart = chart(&outcome().rows, "box", &names(), &METRICS[0], clock).unwrap();
        let floor = chart.curves[1].floor.unwrap();
        assert!(floor.distinguishable && (floor.value - 0.003).abs() < 1e-6, "{floor:?}");
        assert!(!chart.curves[0].floor.unwrap().distinguishable);
    }
}

#[test]
fn pictures_of_one_run_under_one_budget_stay_apart() {
    let row = |cpu_s: f64, repeat| Row {
        scene: "box".into(),
        method: "path".into(),
        budget: "cpu=4".into(),
        cpu_s,
        repeat,
        relmse: Some(1.0 / cpu_s),
        ..Row::default()
    };
    let rows = [row(1.0, 0), row(2.0, 0), row(4.0, 0), row(1.2, 1), row(2.2, 1), row(4.2, 1)];
    let chart = chart(&rows, "box", &names(), &METRICS[0], Clock::Cpu).unwrap();
    let times: Vec<f64> = chart.curves[0].points.iter().map(|p| p.time).collect();
    assert_eq!(times, [1.1, 2.1, 4.1]);
}

#[test]
fn no_text_of_the_data_ends_a_script_or_becomes_markup() {
    let (_folder, page) = written(&outcome());
    let data: serde_json::Value = serde_json::from_str(element(&page, "id=\"data\">")).unwrap();
    assert_eq!(data["title"], outcome().title);
    assert_eq!(data["plan"], outcome().plan);
    assert_eq!(data["rows"][42]["message"], "boom </script><b>");
    assert!(!page.contains("alert('no')</script>") && !page.contains("<b>more"));
    assert!(page.contains("<title>Boxes &lt;/script&gt;"));
    // As many ends of scripts as beginnings: the data, no pictures, six scripts.
    assert_eq!(page.matches("</script>").count(), page.matches("<script").count());
    assert_eq!(page.matches("</script>").count(), 7);
    assert!(!page.contains("{{style}}") && !page.contains("{{scripts}}"));
}

#[test]
fn the_page_fetches_nothing() {
    let (_folder, page) = written(&outcome());
    assert!(page.contains("default-src 'none'"));
    for word in ["http://", "https://", "@import", "url(//", " src=", "fetch(", "XMLHttpRequest", "import("] {
        assert!(!page.contains(word), "the page has {word}");
    }
}

#[test]
fn plots_are_files_of_their_own() {
    let mut outcome = outcome();
    outcome.scenes[0].name = "box/../<1>".into();
    outcome.rows.iter_mut().for_each(|r| r.scene = "box/../<1>".into());
    let (folder, page) = written(&outcome);
    let svg = std::fs::read_to_string(folder.path().join("plots/box_____1_-relmse.svg")).unwrap();
    roxmltree::Document::parse(&svg).unwrap();
    assert!(svg.contains("box/../&lt;1&gt;"));
    let png = image::open(folder.path().join("plots/box_____1_-relmse.png")).unwrap().into_rgb8();
    assert_eq!(png.dimensions(), (2160, 1440));
    // The first method's colour is there: its curve was drawn, and so was its name in a font that is always there.
    let blue = |x: std::ops::Range<u32>| {
        x.flat_map(|x| (0..1440).map(move |y| (x, y))).filter(|&(x, y)| png.get_pixel(x, y).0 == [0, 0x72, 0xb2]).count()
    };
    assert!(blue(0..1850) > 2000 && blue(1940..2160) > 100, "{} {}", blue(0..1850), blue(1940..2160));
    assert!(page.contains("plots/box_____1_-relmse"));
}

#[test]
fn a_plot_is_made_of_nothing_at_all() {
    let (folder, page) =
        written(&Outcome { scenes: vec![SceneRecord { name: "empty".into(), ..SceneRecord::default() }], ..Outcome::default() });
    let data: serde_json::Value = serde_json::from_str(element(&page, "id=\"data\">")).unwrap();
    assert_eq!(data["scenes"][0]["charts"]["cpu"], serde_json::json!({}));
    assert_eq!(std::fs::read_dir(folder.path().join("plots")).unwrap().count(), 0);
}

fn unpack(data: &str) -> Vec<u8> {
    let packed = base64::engine::general_purpose::STANDARD.decode(data).unwrap();
    let mut bytes = Vec::new();
    flate2::read::ZlibDecoder::new(&packed[..]).read_to_end(&mut bytes).unwrap();
    bytes
}

#[test]
fn half_floats_lie_in_planes() {
    // By the format: 1 is 0x3C00, -2 is 0xC000, 65504 is 0x7BFF, 2^-24 is 0x0001, 0.5 is 0x3800.
    let image = Image::from_pixels(2, 1, vec![[1.0, -2.0, 1e9], [2.0_f32.powi(-24), 0.0, 0.5]]);
    assert_eq!(unpack(&half_floats(&image)), [0x3C, 0, 0xC0, 0, 0x7B, 0x38, 0, 1, 0, 0, 0xFF, 0]);
}

#[test]
fn reduced_pictures_are_means() {
    let image = Image::from_pixels(3, 2, [1.0, 2.0, 10.0, 3.0, 6.0, 20.0].map(|v| [v, 0.0, 2.0 * v]).to_vec());
    let small = reduced(&image, 2);
    assert_eq!((small.width(), small.height()), (2, 1));
    assert_eq!(small.pixels(), [[3.0, 0.0, 6.0], [15.0, 0.0, 30.0]]);
    assert_eq!(reduced(&image, 6), image);
}

#[test]
fn pictures_are_in_the_page_and_what_is_not_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let image = |value: f32| Image::from_pixels(4, 4, vec![[value; 3]; 16]);
    let save = |name: &str, value: f32| {
        write_exr(&folder.path().join(name), &[Layer::main(image(value))], &Header::default()).unwrap();
    };
    save("A.exr", 1.0);
    save("B.exr", 3.0);
    let mut outcome = outcome();
    outcome.scenes[0].references = vec!["A.exr".into(), "B.exr".into()];
    for (i, row) in
        outcome.rows.iter_mut().enumerate().filter(|(_, r)| r.seed == 0 && r.method == "path" && r.status == Status::Done)
    {
        row.image = format!("{i}.exr");
        if i > 0 {
            save(&row.image, i as f32);
        }
    }
    write(&outcome, folder.path()).unwrap();
    let page = std::fs::read_to_string(folder.path().join("index.html")).unwrap();
    // The reference is the mean of both: 2 is 0x4000.
    let planes = unpack(element(&page, "id=\"picture-0\">"));
    assert_eq!((planes[..48].to_vec(), planes[48..].to_vec()), (vec![0x40; 48], vec![0; 48]));
    let data: serde_json::Value = serde_json::from_str(element(&page, "id=\"data\">")).unwrap();
    // The last picture is the first of the method in the page; FLIP is far from 0 where white is 2 and the picture's value i.
    assert_eq!(data["pictures"][0]["has_flip"], false);
    assert!(page.contains("id=\"flip-1\""));
    // Of seven times six are kept. The first file is missing, so the five others come with the reference.
    assert_eq!(data["pictures"].as_array().unwrap().len(), 6);
    let left_out = data["pictures_left_out"].to_string();
    assert!(left_out.contains("spp=1 of path in box") && left_out.contains("1 pictures of other seeds"), "{left_out}");
}

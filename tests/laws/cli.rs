//! The command line as a user or a script meets it: exit codes, messages, files.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;
use twopass::film::io::{Header, read_exr, read_exr_layer, write_exr, write_png_bytes};
use twopass::film::{Image, Layer};

/// A folder of its own, in which the program runs.
pub(super) struct Place(TempDir);

impl Place {
    pub(super) fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(super) fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).expect("writable");
    }

    pub(super) fn command(&self, line: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_twopass"));
        command.args(line.split_whitespace()).current_dir(self.0.path()).stdin(Stdio::null());
        command
    }

    fn run(&self, line: &str) -> Output {
        self.command(line).output().expect("the program starts")
    }

    /// Runs, demands the exit code, and gives stdout and stderr.
    pub(super) fn expect(&self, code: i32, line: &str) -> (String, String) {
        let output = self.run(line);
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let (out, err) = (text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(code), "twopass {line}\nstdout: {out}\nstderr: {err}");
        assert!(!err.contains("panicked") && !err.contains("internal fault"), "twopass {line}\n{err}");
        (out, err)
    }

    /// Runs a line of bash, whose `ulimit` and `trap` set what a process is born with.
    pub(super) fn shell(&self, script: &str) -> Output {
        let mut command = Command::new("bash");
        command.args(["-c", script]).current_dir(self.0.path()).stdin(Stdio::null()).output().expect("bash is there")
    }

    pub(super) fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).expect("readable");
        let mut names: Vec<String> = entries.map(|e| e.expect("readable").file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }
}

pub(super) fn picture(width: usize, height: usize, value: f32) -> Image {
    Image::from_pixels(width, height, vec![[value; 3]; width * height])
}

pub(super) fn write(path: &Path, image: Image) {
    write_exr(path, &[Layer::main(image)], &Header::default()).expect("writable");
}

/// A closed unit cube, grey, with a lamp below its ceiling.
pub(super) fn room(emitter: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
  <integrator type="path"/>
  <sensor type="perspective">
    <float name="fov" value="60"/>
    <transform name="to_world"><lookat origin="0, -0.9, 0" target="0, 1, 0" up="0, 0, 1"/></transform>
    <sampler type="independent"><integer name="sample_count" value="4"/></sampler>
    <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="16"/><rfilter type="box"/></film>
  </sensor>
  <bsdf type="twosided" id="grey"><bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.5, 0.5"/></bsdf></bsdf>
  <shape type="cube"><ref id="grey"/></shape>
  <shape type="rectangle">
    <transform name="to_world"><scale value="0.3"/><rotate x="1" angle="180"/><translate z="0.95"/></transform>
    <ref id="grey"/>
    {emitter}
  </shape>
</scene>
"#
    )
}

pub(super) const LAMP: &str = r#"<emitter type="area"><rgb name="radiance" value="5, 5, 5"/></emitter>"#;

/// Coarse pass one: these tests are about the command line.
const QUICK: &str = "--patch-size 0.5 --tolerance 0.1";

fn value(lines: &str, name: &str) -> f64 {
    let line = lines.lines().find_map(|l| l.strip_prefix(&format!("{name} ")));
    line.unwrap_or_else(|| panic!("no {name} in\n{lines}")).parse().expect("a number")
}

#[test]
fn compare_prints_one_figure_a_line() {
    let place = Place::new();
    write(&place.path("i.exr"), picture(20, 10, 1.5));
    write(&place.path("a.exr"), picture(20, 10, 1.0));
    let (out, _) = place.expect(0, "compare i.exr a.exr");
    assert!((value(&out, "relmse") - 0.25 / 1.01).abs() < 1e-6, "{out}");
    assert!((value(&out, "mean_ratio_g") - 1.5).abs() < 1e-6, "{out}");
    assert!(!out.contains("trimmed") && !out.contains("off_emitters"), "{out}");
    assert!(out.contains("below_reference_noise false"), "{out}");

    let (out, _) = place.expect(0, "compare i.exr a.exr i.exr --json");
    let json: serde_json::Value = serde_json::from_str(&out).expect("JSON");
    assert_eq!(json["mse"], 0.0);
    assert_eq!(json["trimmed_relmse"], 0.0);
}

#[test]
fn compare_gives_zeros_for_equal_files() {
    let place = Place::new();
    write(&place.path("a.exr"), picture(33, 7, 0.3));
    let (out, _) = place.expect(0, "compare a.exr a.exr");
    for name in ["mse", "rmse", "relmse", "relmse_se", "block9_rms", "flip_ldr", "flip_hdr", "nan_pixels"] {
        assert_eq!(value(&out, name), 0.0, "{name}");
    }
}

#[test]
fn compare_leaves_out_what_the_mask_shows() {
    let place = Place::new();
    let mut image = picture(4, 1, 1.0);
    image.pixels_mut()[1] = [9.0; 3];
    write(&place.path("i.exr"), image);
    write(&place.path("a.exr"), picture(4, 1, 1.0));
    write_png_bytes(&place.path("m.png"), 4, 1, &[0, 0, 0, 255, 255, 255, 0, 0, 0, 0, 0, 0]).expect("writable");
    let (out, _) = place.expect(0, "compare i.exr a.exr --mask m.png --diff d.png --flip f.png");
    assert_eq!(value(&out, "mse"), 0.0);
    assert_eq!(value(&out, "flip_hdr"), 0.0, "the filters of FLIP saw what is left out");
    assert!(place.path("f.png").exists());
    assert_eq!(value(&out, "pixels"), 3.0);
    assert!(place.path("d.png").exists());
    let (out, _) = place.expect(0, "compare i.exr a.exr --emitters m.png");
    assert!(value(&out, "mse") > 1.0 && value(&out, "relmse_off_emitters") == 0.0, "{out}");
}

#[test]
fn compare_refuses_what_cannot_be_compared() {
    let place = Place::new();
    write(&place.path("a.exr"), picture(20, 10, 1.0));
    write(&place.path("b.exr"), picture(10, 20, 1.0));
    write(&place.path("nan.exr"), picture(20, 10, f32::NAN));
    place.write("text.exr", "this is no picture");
    let (_, err) = place.expect(3, "compare a.exr b.exr");
    assert!(err.contains("10x20") && err.contains("20x10"), "{err}");
    let (_, err) = place.expect(3, "compare a.exr text.exr");
    assert!(err.contains("text.exr"), "{err}");
    let (_, err) = place.expect(3, "compare missing.exr a.exr");
    assert!(err.contains("missing.exr"), "{err}");
    place.expect(3, "compare a.exr nan.exr");
    place.expect(5, "compare a.exr a.exr --diff nowhere/d.png");
    let (out, err) = place.expect(6, "compare nan.exr a.exr");
    assert_eq!(value(&out, "nan_pixels"), 200.0);
    assert!(err.contains("column 0, row 0"), "{err}");
}

#[test]
fn wrong_usage_exits_with_2() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    for line in [
        "",
        "paint room.xml",
        "render",
        "render room.xml --spp 0",
        "render room.xml --spp -3",
        "render room.xml --time 0",
        "render room.xml --time nan",
        "render room.xml --size 0x5",
        "render room.xml --size 4294967297x4",
        "render room.xml --crop 1,2,3",
        "render room.xml --crop 20,0,10,10",
        "render room.xml --method magic",
        "render room.xml --read-out twice",
        "render room.xml --method path --read-out stored",
        "render room.xml --sampler halton",
        "render room.xml --max-depth -7",
        "render room.xml --accel magic",
        "render room.xml --colour",
        "render room.xml -D angle",
        "render room.xml -D angle=3",
        "render room.xml -q -v",
        "render room.xml --plan fuller",
        "render room.xml --solver magic",
        "render room.xml --form-factors magic",
        "form-factors room.xml --by face",
        "render room.xml --light lamp=2",
        "render room.xml --solution room.sol --patch-size 1",
        "serve room.xml",
    ] {
        let (_, err) = place.expect(2, line);
        assert!(!err.trim().is_empty(), "no message: {line}");
    }
    assert_eq!(place.names(), ["room.xml"], "nothing was written");
}

#[test]
fn help_and_lists_go_to_stdout() {
    let place = Place::new();
    for (line, word) in [
        ("--help", "render"),
        ("render --help", "--spp"),
        ("--version", env!("CARGO_PKG_VERSION")),
        ("--list-methods", "two-pass-whitted"),
        ("--list-methods", "LD?S*E"),
        ("--list-methods", "unbiased"),
        ("--list-methods", "independent"),
        ("--list-methods", "Kajiya86"),
        ("render --list-methods", "path"),
    ] {
        let (out, _) = place.expect(0, line);
        assert!(out.contains(word), "{line}: {out}");
    }
}

#[test]
fn a_render_writes_picture_layers_header_and_report() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    let (out, err) = place.expect(0, &format!("render room.xml --report r.json --seed 3 {QUICK}"));
    assert!(out.is_empty() && err.contains("room.exr"), "{out}{err}");
    assert_eq!(place.names(), ["r.json", "room.exr", "room.png", "room.xml"]);
    let exr = place.path("room.exr");
    let image = read_exr(&exr).expect("readable");
    assert_eq!((image.width(), image.height()), (24, 16));
    assert!(image.pixels().iter().all(|p| p[0] > 0.0), "a closed lit room has no black pixel");
    for layer in ["direct", "indirect", "caustic", "albedo", "variance", "radiosity", "irradiance"] {
        read_exr_layer(&exr, layer, ["R", "G", "B"]).unwrap_or_else(|e| panic!("{layer}: {e}"));
    }
    read_exr_layer(&exr, "normal", ["X", "Y", "Z"]).expect("normals");
    read_exr_layer(&exr, "depth", ["Z", "Z", "Z"]).expect_err("a channel cannot be read thrice");
    let bytes = std::fs::read(&exr).expect("readable");
    let has = |name: &str| bytes.windows(name.len()).any(|w| w == name.as_bytes());
    for name in
        ["scene", "sceneHash", "rendererVersion", "method", "seed", "samples", "seconds", "worldToCamera", "estimatedRelMSE"]
    {
        assert!(has(name), "no header attribute {name}");
    }
    let report: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(place.path("r.json")).expect("readable")).expect("JSON");
    assert_eq!(report["complete"], true);
    assert_eq!(report["seed"], 3);
    assert_eq!(report["samples_per_pixel"], 4.0);
    // Four a pixel in the mean: where they go is decided by rates, which leave up to one a pixel and half over.
    let camera_rays = report["counters"]["camera_rays"].as_f64().expect("a number");
    assert!((camera_rays / f64::from(24 * 16 * 4) - 1.0).abs() < 0.05, "{camera_rays}");
    assert!(report["stages"].as_array().is_some_and(|s| s.iter().any(|s| s["name"] == "render")));
}

/// What leaving out saved is measured by a second run, and only where that is asked for.
#[test]
fn the_report_says_what_the_plan_saved() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    let saving = |flags: &str| -> (serde_json::Value, String) {
        let (_, err) = place.expect(0, &format!("render room.xml --report r.json {flags} {QUICK}"));
        let text = std::fs::read_to_string(place.path("r.json")).expect("readable");
        let report: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        (report["plan_saving"].clone(), err)
    };
    let (unmeasured, _) = saving("");
    assert!(unmeasured["measured"].is_null() && unmeasured["how"].as_str().is_some_and(|s| s.contains("--time-plan")));
    assert!(unmeasured["left_out"].as_array().is_some_and(|stages| stages.contains(&"light-choice".into())), "{unmeasured}");
    let (measured, said) = saving("--time-plan");
    let figure = |name: &str| measured["measured"][name].as_f64().unwrap_or_else(|| panic!("no {name}: {measured}"));
    assert_eq!(measured["measured"]["same_picture"], true);
    assert!((figure("full_cpu_s") - figure("lean_cpu_s") - figure("saved_cpu_s")).abs() < 1e-9);
    assert!(figure("full_cpu_s") > 0.0 && said.contains("the plan saved") && said.contains("light-choice"), "{said}");
    let (full, said) = saving("--time-plan --plan full");
    assert!(full["measured"].is_null() && said.contains("nothing was left out"), "{full}");
    let (_, err) = place.expect(2, "render room.xml --time-plan --resume");
    assert!(err.contains("--resume"), "{err}");
}

#[test]
fn flags_override_the_scene() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    place.expect(0, &format!("render room.xml -o a.exr --spp 1 -q --image-filter off --size 12x8 {QUICK}"));
    place.expect(0, &format!("render room.xml -o b --spp 1 -q --image-filter off --size 12x8 --crop 2,3,5,4 {QUICK}"));
    let (whole, part) = (read_exr(&place.path("a.exr")).expect("whole"), read_exr(&place.path("b.exr")).expect("part"));
    assert_eq!((whole.width(), part.width(), part.height()), (12, 5, 4));
    assert_eq!(part.at(1, 2), whole.at(3, 5), "a crop shows what the whole shows there");
}

#[test]
fn bad_scenes_exit_with_3_and_name_the_place() {
    let place = Place::new();
    let (_, err) = place.expect(3, "render missing.xml");
    assert!(err.contains("missing.xml"), "{err}");
    place.write("broken.xml", "<scene version=\"3.0.0\">\n  <shape type=\"cube\">\n</scene>\n");
    let (_, err) = place.expect(3, "render broken.xml");
    assert!(err.contains("broken.xml:3:"), "{err}");
    place.write("unknown.xml", &room(LAMP).replace("type=\"diffuse\"", "type=\"difuse\""));
    let (_, err) = place.expect(3, "info unknown.xml");
    assert!(err.contains("difuse") && err.contains("diffuse") && err.contains("unknown.xml:9:"), "{err}");
    // Only the broken scenes: no picture was begun.
    assert_eq!(place.names(), ["broken.xml", "unknown.xml"]);
}

#[test]
fn outputs_that_cannot_be_written_are_found_first() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    std::fs::create_dir(place.path("full.exr")).expect("a folder");
    for line in [
        "render room.xml -o nowhere/a --time 100",
        "render room.xml -o full --time 100",
        "render room.xml --report nowhere/r.json --time 100",
        "solve room.xml --report nowhere/r.json",
        "probe room.xml --points p.csv -o nowhere/p.csv",
    ] {
        let started = Instant::now();
        place.expect(5, line);
        assert!(started.elapsed() < Duration::from_secs(10), "found only after rendering: {line}");
    }
    assert_eq!(place.names(), ["full.exr", "room.xml"]);
}

#[test]
fn a_scene_without_light_is_black_and_said_so() {
    let place = Place::new();
    place.write("room.xml", &room(""));
    let (_, err) = place.expect(0, &format!("render room.xml {QUICK}"));
    assert_eq!((err.matches("warning").count(), err.matches("light").count()), (1, 1), "{err}");
    let image = read_exr(&place.path("room.exr")).expect("readable");
    assert!(image.pixels().iter().all(|p| *p == [0.0; 3]));
}

#[test]
fn solve_and_info_say_what_they_found() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    let (out, _) = place.expect(0, &format!("solve room.xml {QUICK} --report r.json"));
    assert!(value(&out, "patches") > 20.0 && out.contains("converged true"), "{out}");
    // Walls and lamp of reflectance 0.5 in a closed room: (1 + 0.5)/(1 - 0.5).
    assert!((value(&out, "condition") - 3.0).abs() < 0.01, "{out}");
    assert!(value(&out, "closure_influence") < 1e-6 && value(&out, "error_bound") < 1e-4, "{out}");
    let (out, _) = place.expect(0, "info room.xml");
    assert_eq!(value(&out, "triangles"), 14.0);
    let (out, _) = place.expect(0, "info room.xml --json");
    let json: serde_json::Value = serde_json::from_str(&out).expect("JSON");
    assert_eq!(json["lights"], 1);
}

#[test]
fn probe_writes_a_table() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    place.write("p.csv", "x,y,z,nx,ny,nz\n0,0,-0.5,0,0,1\n0,0,-0.5,0,0,-1\n");
    let (out, _) = place.expect(0, &format!("probe room.xml --points p.csv --samples 256 {QUICK}"));
    let mut lines = out.lines();
    let header = "x,y,z,nx,ny,nz,direct_r,direct_g,direct_b,total_r,total_g,total_b,illuminance,std_error";
    assert_eq!(lines.next(), Some(header));
    let rows: Vec<Vec<f64>> = lines.map(|l| l.split(',').map(|v| v.parse().expect("a number")).collect()).collect();
    assert_eq!(rows.len(), 2);
    assert!(rows[0][6] > 0.0 && rows[0][9] > rows[0][6], "facing the lamp: {:?}", rows[0]);
    assert!(rows[1][6] == 0.0 && rows[1][9] > 0.0, "facing away: {:?}", rows[1]);
    place.write("bad.csv", "x,y,z,nx,ny,nz\n0,0,0,0,0,zero\n");
    let (_, err) = place.expect(3, "probe room.xml --points bad.csv");
    assert!(err.contains("bad.csv:2:"), "{err}");
}

#[test]
fn a_closed_stdout_is_no_fault() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    let mut child = place.command("info room.xml").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("starts");
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("ends");
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn limits_are_checked_before_anything_is_computed() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    let started = Instant::now();
    place.expect(4, "render room.xml --size 2000000x2000000");
    place.expect(4, "solve room.xml --patch-size 1e-6");
    assert!(started.elapsed() < Duration::from_secs(10));
}

#[test]
fn a_room_that_keeps_all_light_has_no_steady_state() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP).replace("0.5, 0.5, 0.5", "1, 1, 1"));
    let (_, err) = place.expect(6, &format!("render room.xml --report r.json {QUICK}"));
    assert!(err.contains("steady state"), "{err}");
    let report = std::fs::read_to_string(place.path("r.json")).expect("a report");
    assert!(report.contains("\"stopped_by\": \"failed\""), "{report}");
}

/// Starts a long render, waits until a partial picture lies there, sends the signal, and gives the exit code.
fn exit_code_after(signal: nix::sys::signal::Signal, place: &Place) -> (Option<i32>, Duration) {
    place.write("room.xml", &room(LAMP));
    let line = format!("render room.xml --time 300 --partial-every 0.01 --report r.json {QUICK}");
    let mut child = place.command(&line).stderr(Stdio::null()).spawn().expect("starts");
    let started = Instant::now();
    while !place.path("room.exr").exists() {
        assert!(started.elapsed() < Duration::from_secs(120), "no partial picture");
        assert!(child.try_wait().expect("a state").is_none(), "ended by itself");
        std::thread::sleep(Duration::from_millis(20));
    }
    let sent = Instant::now();
    nix::sys::signal::kill(nix::unistd::Pid::from_raw(child.id() as i32), signal).expect("the child lives");
    let status = child.wait().expect("ends");
    (status.code(), sent.elapsed())
}

#[test]
fn a_signal_ends_the_run_and_keeps_the_picture() {
    use nix::sys::signal::Signal;
    for (signal, code) in [(Signal::SIGINT, 130), (Signal::SIGTERM, 143)] {
        let place = Place::new();
        let (got, wall) = exit_code_after(signal, &place);
        assert_eq!(got, Some(code), "{signal}");
        assert!(wall < Duration::from_secs(10), "took {wall:?}");
        assert_eq!(place.names(), ["r.json", "room.exr", "room.png", "room.resume", "room.xml"], "no temporary files are left");
        let image = read_exr(&place.path("room.exr")).expect("whole");
        assert!(image.pixels().iter().any(|p| p[0] > 0.0));
        let report = std::fs::read_to_string(place.path("r.json")).expect("a report");
        assert!(report.contains("\"complete\": false") && report.contains("\"stopped_by\": \"interrupted\""), "{report}");
    }
}

//! Experiments as a user starts them: what is kept, what is marked, what is run again.

use super::cli::{LAMP, Place, picture, room, write};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};
use twopass::experiment::{Row, RowKind, Status};
use twopass::film::io::read_exr;

/// A coarse pass one in a small room: these tests are about the experiment.
const COARSE: &str = "patch_size = 0.5\ntolerance = 0.1\n";

/// A folder with a room of 24x16 pixels and two references that fit it.
fn place() -> Place {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    write(&place.path("A.exr"), picture(24, 16, 0.2));
    write(&place.path("B.exr"), picture(24, 16, 0.25));
    place
}

/// A plan of that room, with what else it shall have.
fn plan(top: &str, methods: &str) -> String {
    format!("{top}\n[[scene]]\nname = \"room\"\nfile = \"room.xml\"\nreferences = [\"A.exr\", \"B.exr\"]\n{methods}")
}

fn external(name: &str, command: &str) -> String {
    format!("[[method]]\nname = \"{name}\"\ncommand = '''{command}'''\n")
}

fn rows(place: &Place, folder: &str) -> Vec<Row> {
    let mut reader = csv::Reader::from_path(place.path(folder).join("rows.csv")).expect("rows");
    reader.deserialize().collect::<Result<_, _>>().expect("rows as written")
}

/// What must be the same whenever a plan is run.
fn lasting(row: &Row) -> (String, String, String, u64, u32, Status, String, Option<f64>) {
    let r = row.clone();
    (r.scene, r.method, r.budget, r.seed, r.repeat, r.status, r.image, r.relmse)
}

fn named<'r>(rows: &'r [Row], method: &str) -> &'r Row {
    rows.iter().find(|r| r.method == method).unwrap_or_else(|| panic!("no row of {method}"))
}

fn value(lines: &str, name: &str) -> f64 {
    let line = lines.lines().find_map(|l| l.strip_prefix(&format!("{name} "))).expect("the figure");
    line.parse().expect("a number")
}

#[test]
fn two_runs_of_a_plan_give_the_same_pictures_with_predicted_beside_measured_errors() {
    let place = place();
    let methods =
        format!("[[method]]\nname = \"gather\"\n{COARSE}[[method]]\nname = \"classic\"\nmethod = \"two-pass-whitted\"\n{COARSE}");
    place.write("plan.toml", &plan("spp = [2, 5]\nseeds = [1, 2]", &methods));
    for folder in ["one", "two"] {
        place.expect(0, &format!("experiment plan.toml -o {folder}"));
    }
    let (one, two) = (rows(&place, "one"), rows(&place, "two"));
    assert_eq!(one.len(), 8);
    for (a, b) in one.iter().zip(&two) {
        assert_eq!(lasting(a), lasting(b));
        let image = |folder: &str, row: &Row| read_exr(&place.path(folder).join(&row.image)).expect("a picture");
        let (first, second) = (image("one", a), image("two", b));
        assert_eq!(first.pixels(), second.pixels(), "{}", a.image);
        // The row says what `compare` says of the picture that was kept.
        let (out, _) = place.expect(0, &format!("compare one/{} A.exr B.exr --json", a.image));
        let compared: serde_json::Value = serde_json::from_str(&out).expect("JSON");
        for (name, kept) in [("relmse", a.relmse), ("trimmed_relmse", a.trimmed_relmse), ("block9_rms", a.block9_rms)] {
            assert_eq!(compared[name].as_f64(), kept, "{name}");
        }
        assert!(a.predicted_relmse.is_some_and(|e| e > 0.0) && a.relmse.is_some(), "{a:?}");
        let parts = a.tree_cpu_s.unwrap() + a.pass_one_cpu_s.unwrap() + a.pass_two_cpu_s.unwrap();
        assert!((parts - a.cpu_s).abs() < 1e-9 && a.cpu_s > 0.0 && a.rays.unwrap() > 0, "{a:?}");
    }
    let json = std::fs::read_to_string(place.path("one").join("experiment.json")).expect("the outcome");
    let outcome: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    // The mean of two constant references is off by half their difference: ((0.25 - 0.2) / 2)² / (0.225² + 0.01).
    let own = 0.025_f64.powi(2) / (0.225_f64.powi(2) + 0.01);
    assert!((outcome["scenes"][0]["reference_relmse"].as_f64().unwrap() - own).abs() < 1e-8, "{}", outcome["scenes"]);
}

/// A picture of a run that goes on is the picture of a run that ended there.
#[test]
fn a_snapshot_is_the_picture_of_its_samples() {
    let place = place();
    place.write("plan.toml", &plan("cpu = [0.1, 0.2, 0.4]", &format!("[[method]]\nname = \"gather\"\n{COARSE}")));
    place.expect(0, "experiment plan.toml -o dir --threads 1");
    let rows = rows(&place, "dir");
    assert!(rows.len() > 1, "{rows:?}");
    for pair in rows.windows(2) {
        assert!(pair[0].spp < pair[1].spp && pair[0].cpu_s < pair[1].cpu_s && pair[0].rays < pair[1].rays, "{pair:?}");
    }
    let first = &rows[0];
    place.expect(0, &format!("render room.xml -o all --patch-size 0.5 --tolerance 0.1 --spp {}", first.spp));
    let kept = read_exr(&place.path("dir").join(&first.image)).expect("a snapshot");
    assert_eq!(kept.pixels(), read_exr(&place.path("all.exr")).expect("a picture").pixels());
}

#[test]
fn what_fails_is_marked_and_the_rest_goes_on() {
    let place = place();
    write(&place.path("small.exr"), picture(8, 8, 0.2));
    let mut holes = picture(24, 16, 0.2);
    holes.pixels_mut()[25] = [f32::NAN; 3];
    write(&place.path("holes.exr"), holes);
    let methods = [
        external("crash", "echo begins; echo out of paper >&2; exit 3"),
        format!("{}timeout = 0.5\n", external("slow", "sleep 60")),
        external("small", "cp {plan_dir}/small.exr {out}"),
        external("holes", "cp {plan_dir}/holes.exr {out}"),
        external("nothing", "true"),
        external("good", r#"cp {plan_dir}/A.exr {out}; echo '{"wall_s": 3, "cpu_s": 5, "tree_cpu_s": 0.5}' > {out}.json"#),
        external("mends", "test -e {plan_dir}/mended && cp {plan_dir}/A.exr {out}"),
        format!("[[method]]\nname = \"own\"\nspp = [2]\n{COARSE}"),
    ];
    place.write("plan.toml", &plan("spp = [4]", &methods.concat()));
    let (_, err) = place.expect(6, "experiment plan.toml -o dir");
    assert!(err.contains("6 of 8 rows are marked"), "{err}");
    let found = rows(&place, "dir");
    for (method, status, words) in [
        ("crash", Status::Failed, "exit code 3: begins / out of paper"),
        ("slow", Status::TimedOut, "stopped after 0.5 s"),
        ("small", Status::Unusable, "8x8 pixels, expected 24x16"),
        ("holes", Status::Unusable, "not finite at column 1, row 1"),
        ("nothing", Status::Unusable, "no picture"),
        ("good", Status::Done, ""),
        ("mends", Status::Failed, "exit code 1"),
        ("own", Status::Done, ""),
    ] {
        let row = named(&found, method);
        assert_eq!(row.status, status, "{row:?}");
        assert!(row.message.contains(words), "{row:?}");
    }
    let good = named(&found, "good");
    // I = A: (I-A)(I-B) is 0 everywhere.
    assert_eq!((good.relmse, good.wall_s, good.cpu_s, good.tree_cpu_s), (Some(0.0), 3.0, 5.0, Some(0.5)));

    place.write("mended", "");
    place.expect(6, "experiment plan.toml -o dir");
    assert_eq!(named(&rows(&place, "dir"), "mends").status, Status::Failed, "not tried again unless asked for");
    place.expect(6, "experiment plan.toml -o dir --again --methods mends,own");
    let again = rows(&place, "dir");
    assert_eq!((again.len(), named(&again, "mends").status), (8, Status::Done));
    assert_eq!(named(&again, "own"), named(&found, "own"), "what is done is not run again");
}

/// Starts an experiment whose third run waits, and gives it once that run has begun.
fn halfway(place: &Place) -> Child {
    let run = "echo {spp} >> {plan_dir}/log; if [ {spp} = 3 ] && [ ! -e {plan_dir}/pid ]; then echo $$ > {plan_dir}/pid; sleep 60; fi; \
               cp {plan_dir}/A.exr {out}";
    place.write("plan.toml", &plan("spp = [1, 2, 3, 4]", &external("theirs", run)));
    let mut child = place.command("experiment plan.toml -o dir").stderr(Stdio::null()).spawn().expect("starts");
    let begin = Instant::now();
    // Begun, and noted as running.
    let begun = || std::fs::read_to_string(place.path("pid")).is_ok_and(|pid| pid.ends_with('\n'));
    let noted = || std::fs::read_to_string(place.path("dir").join(".running")).is_ok_and(|text| !text.is_empty());
    while !(begun() && noted()) {
        assert!(begin.elapsed() < Duration::from_secs(60), "the third run does not begin");
        assert!(child.try_wait().expect("a state").is_none(), "ended by itself");
        std::thread::sleep(Duration::from_millis(10));
    }
    child
}

fn lives(pid_file: &Path) -> bool {
    let pid = std::fs::read_to_string(pid_file).expect("a number");
    std::fs::read_to_string(format!("/proc/{}/stat", pid.trim())).is_ok_and(|stat| !stat.contains(") Z"))
}

#[test]
fn a_killed_experiment_goes_on_where_it_was() {
    let place = place();
    let mut child = halfway(&place);
    child.kill().expect("it lives");
    child.wait().expect("ends");
    assert_eq!(rows(&place, "dir").len(), 2);
    assert!(lives(&place.path("pid")), "nobody was left to end the third run");

    place.expect(0, "experiment plan.toml -o dir");
    assert!(!lives(&place.path("pid")), "what was left behind is ended first");
    let log = std::fs::read_to_string(place.path("log")).expect("a log");
    assert_eq!(log.split_whitespace().collect::<Vec<_>>(), ["1", "2", "3", "3", "4"]);
    place.expect(0, "experiment plan.toml -o whole");
    let (resumed, whole) = (rows(&place, "dir"), rows(&place, "whole"));
    assert_eq!(resumed.iter().map(lasting).collect::<Vec<_>>(), whole.iter().map(lasting).collect::<Vec<_>>());

    // Another setting is another row; the old one is not lost, and not shown.
    let text = std::fs::read_to_string(place.path("plan.toml")).expect("the plan");
    place.write("plan.toml", &text.replace("cp ", "cp -f "));
    place.expect(0, "experiment plan.toml -o dir");
    assert_eq!(rows(&place, "dir").len(), 4);
    assert!(place.path("dir").join("rows.old.csv").exists());
}

#[test]
fn ctrl_c_keeps_the_rows_and_ends_what_runs() {
    let place = place();
    let mut child = halfway(&place);
    kill(Pid::from_raw(child.id() as i32), Signal::SIGINT).expect("it lives");
    assert_eq!(child.wait().expect("ends").code(), Some(130));
    assert_eq!(rows(&place, "dir").len(), 2);
    assert!(!lives(&place.path("pid")));
    assert!(place.path("dir").join("experiment.json").exists());
}

/// The same settings and seed as the reference leave no error at all; coarser ones leave some.
#[test]
fn pass_one_is_compared_with_a_fine_solution() {
    let place = place();
    let methods = "[reference_solution]\npatch_size = 0.25\ntolerance = 0.05\nseeds = [7]\n\
                   [[pass_one]]\nname = \"rays\"\npatch_size = [0.25, 1]\ntolerance = 0.05\n";
    place.write("plan.toml", &plan("seeds = [7]\npoints = 500", methods));
    place.expect(0, "experiment plan.toml -o dir");
    let rows = rows(&place, "dir");
    assert_eq!(rows.iter().map(|r| r.budget.as_str()).collect::<Vec<_>>(), ["patch_size=0.25", "patch_size=1"]);
    assert_eq!((rows[0].kind, rows[0].relmse), (RowKind::PassOne, Some(0.0)));
    assert!(rows[1].relmse.is_some_and(|e| e > 1e-3), "{:?}", rows[1]);
    assert!(rows.iter().all(|r| r.pass_one_cpu_s.is_some() && r.pass_two_cpu_s.is_none() && r.image.is_empty()));

    let (_, err) = place.expect(0, "solve room.xml --patch-size 0.5 --irradiance h.csv --points 200 --quiet");
    assert_eq!(err, "");
    let table = std::fs::read_to_string(place.path("h.csv")).expect("a table");
    assert_eq!(table.lines().count(), 201);
    // Every point lies on the walls of the cube or on its lamp.
    for line in table.lines().skip(1) {
        let v: Vec<f64> = line.split(',').take(6).map(|v| v.parse().expect("a number")).collect();
        let on_wall = (0..3).any(|c| (v[c].abs() - 1.0).abs() < 1e-6 && (v[3 + c].abs() - 1.0).abs() < 1e-6);
        assert!(on_wall || (v[2] - 0.95).abs() < 1e-6, "{line}");
    }
}

#[test]
fn a_bad_plan_is_refused_with_its_line() {
    let place = place();
    let gather = format!("[[method]]\nname = \"m\"\n{COARSE}");
    for (text, line, words) in [
        ("spp = [1\n[[scene]]\n".to_owned(), 2, ""),
        ("spp = [1]\n".to_owned(), 1, "no scene"),
        (plan("spp = [0]", &gather), 1, "whole number of 1 or more, found the number 0"),
        (plan("spp = 4", &gather), 1, "expected a list"),
        (plan("cpu = [2, 1]", &gather), 1, "ascending"),
        (plan("budget = 4\nspp = [1]", &gather), 1, "knows no \"budget\""),
        (plan("spp = [1]", "colour = 4\n"), 6, "knows no \"colour\""),
        (plan("spp = [1]", &gather).replace("B.exr", "C.exr"), 5, "no file"),
        (plan("spp = [1]", &gather).replace("room.xml", "$rooms/x.xml"), 2, "$rooms has no value"),
        (plan("spp = [1]", &format!("{gather}gather_rays = 0\n")), 6, "gather-rays"),
        (plan("spp = [1]", &format!("{gather}gatherrays = 4\n")), 6, "gatherrays"),
        (plan("spp = [1]", &format!("{gather}seed = 4\n")), 10, "set by the experiment"),
        (plan("spp = [1]", &format!("{gather}scenes = [\"hall\"]\n")), 6, "no scene \"hall\""),
        (plan("spp = [1]", &format!("{gather}{gather}")), 10, "two methods"),
        (plan("", &gather), 6, "expected a budget"),
        (plan("cpu = [1]", &external("e", "true")), 6, "spp"),
        (plan("", "[[pass_one]]\nname = \"p\"\ntolerance = [0.1]\n"), 6, "reference_solution"),
    ] {
        place.write("plan.toml", &text);
        let (_, err) = place.expect(3, "experiment plan.toml -o dir");
        assert!(err.contains(&format!("plan.toml:{line}:")) && err.contains(words), "{text}\n{err}");
    }
    assert!(!place.path("dir").exists(), "nothing is begun");
    let (_, err) = place.expect(3, "experiment none.toml -o dir");
    assert!(err.contains("none.toml"), "{err}");
    // References of another size are found before anything is run.
    write(&place.path("B.exr"), picture(8, 8, 0.2));
    place.write("plan.toml", &plan("spp = [1]", &gather));
    let (_, err) = place.expect(3, "experiment plan.toml -o dir");
    assert!(err.contains("reference B has 8x8 pixels"), "{err}");
}

#[test]
fn what_is_not_there_is_left_out_if_the_plan_allows_it() {
    let place = place();
    let methods = format!(
        "[[method]]\nname = \"m\"\n{COARSE}{}needs = \"exit 1\"\n[[scene]]\nname = \"far\"\noptional = true\nfile = \"$far/x.xml\"\n",
        external("theirs", "true")
    );
    place.write("plan.toml", &plan("spp = [1]", &methods));
    let (_, err) = place.expect(0, "experiment plan.toml -o dir");
    assert!(err.contains("left out: scene far: $far has no value") && err.contains("left out: method theirs"), "{err}");
    assert_eq!(rows(&place, "dir").len(), 1);
    let (_, err) = place.expect(2, "experiment plan.toml -o dir --methods theirs");
    assert!(err.contains("theirs"), "{err}");
}

/// Times are for this program, samples for commands of others: a scene that changes the one keeps the other.
#[test]
fn a_scene_changes_budgets_of_one_kind_and_keeps_the_other() {
    let place = place();
    let methods = format!("cpu = [0.1]\n[[method]]\nname = \"m\"\n{COARSE}{}", external("theirs", "cp A.exr {out}"));
    place.write("plan.toml", &plan("cpu = [9]\nspp = [3]", &methods));
    place.expect(0, "experiment plan.toml -o dir");
    let rows = rows(&place, "dir");
    let budgets = |name: &str| -> Vec<&str> { rows.iter().filter(|r| r.method == name).map(|r| r.budget.as_str()).collect() };
    assert_eq!((budgets("m"), budgets("theirs")), (vec!["cpu=0.1"], vec!["spp=3"]));
}

/// The default method refines pass one while pass two goes on; no snapshot may count what came after it as spent before.
#[test]
fn snapshots_claim_no_more_of_pass_one_than_they_cost() {
    let place = place();
    let methods = "[[method]]\nname = \"refined\"\n[[method]]\nname = \"path\"\nmethod = \"path\"\n";
    place.write("plan.toml", &plan("cpu = [0.05, 0.1, 0.2, 0.4]", methods));
    place.expect(0, "experiment plan.toml -o dir");
    for row in rows(&place, "dir") {
        let before = row.tree_cpu_s.unwrap_or(0.0) + row.pass_one_cpu_s.unwrap_or(0.0);
        assert!(before <= row.cpu_s && row.pass_two_cpu_s.is_none_or(|s| s >= 0.0), "{row:?}");
        assert_eq!(row.method == "path", row.pass_two_cpu_s.is_some(), "{row:?}");
    }
}

/// Plans of this repository are read to the end: a scene that they do not have is all that stops them.
#[test]
fn shipped_plans_are_valid() {
    let place = Place::new();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/plans");
    let plans: Vec<_> = folder.read_dir().expect("plans").map(|entry| entry.expect("readable").path()).collect();
    assert!(plans.len() >= 5, "{plans:?}");
    for plan in plans {
        let text = std::fs::read_to_string(&plan).expect("a plan");
        // What others' commands need may be absent here; their entries must be right all the same.
        let present: String = text.lines().filter(|line| !line.starts_with("needs = ")).map(|line| format!("{line}\n")).collect();
        let root = folder.join("../..");
        place.write("plan.toml", &present.replace("\"../../", &format!("\"{}/", root.display())));
        let (_, err) = place.expect(2, "experiment plan.toml -o dir --scenes nowhere");
        assert!(err.contains("no scene \"nowhere\""), "{}: {err}", plan.display());
    }
}

/// The run report holds a row for each snapshot, with the file and what had been spent by then.
#[test]
fn render_writes_snapshots_and_reports_them() {
    let place = place();
    let line = "render room.xml -o o --patch-size 0.5 --tolerance 0.1 --cpu-time 0.3 --snapshots-cpu 0.1,0.2 --report r.json";
    place.expect(0, line);
    let text = std::fs::read_to_string(place.path("r.json")).expect("a report");
    let report: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let snapshots = report["snapshots"].as_array().expect("a list");
    assert!(!snapshots.is_empty(), "{text}");
    for snapshot in snapshots {
        let image = read_exr(Path::new(&place.path(snapshot["file"].as_str().expect("a name")))).expect("a picture");
        assert_eq!((image.width(), image.height()), (24, 16));
        assert!(snapshot["cpu_s"].as_f64() > Some(0.0) && snapshot["samples_per_pixel"].as_f64() >= Some(1.0), "{snapshot}");
    }
    let (_, err) = place.expect(2, "render room.xml --snapshots-cpu 2,1");
    assert!(err.contains("ascending"), "{err}");
    let (out, _) = place.expect(0, "compare o.exr o.exr");
    assert_eq!(value(&out, "relmse"), 0.0);
}

//! A run among other processes: interrupted and continued, killed, on a full disk, short of memory, beside another run.

use super::cli::{LAMP, Place, room};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use twopass::film::io::{read_exr, read_exr_layer};

/// Coarse pass one: these laws are about processes.
const QUICK: &str = "--patch-size 0.5 --tolerance 0.1";

/// Longest wait for a picture on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

fn bytes(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The picture and all its layers as bits; the header knows times and differs.
fn picture_bits(path: &Path) -> Vec<u32> {
    let layers = ["direct", "indirect", "caustic", "albedo", "variance", "radiosity", "irradiance"];
    let layer = |name: &str| read_exr_layer(path, name, ["R", "G", "B"]).unwrap_or_else(|e| panic!("{name}: {e}"));
    let images = std::iter::once(read_exr(path).expect("a picture")).chain(layers.into_iter().map(layer));
    images.flat_map(|image| image.pixels().iter().flatten().map(|v| v.to_bits()).collect::<Vec<u32>>()).collect()
}

fn wait_for(path: &Path, child: &mut Child) {
    let started = Instant::now();
    while !path.exists() {
        assert!(started.elapsed() < PATIENCE, "{} did not come", path.display());
        if child.try_wait().expect("a state").is_some() {
            return;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Starts a run that writes its state after every pass, and stops it once that is there; true if it was stopped before its end.
fn interrupt(place: &Place, line: &str, signal: Signal) -> bool {
    let mut child = place.command(line).stderr(Stdio::null()).spawn().expect("starts");
    wait_for(&place.path("a.resume"), &mut child);
    // Gone already if the run has ended.
    let _ = kill(Pid::from_raw(child.id() as i32), signal);
    !child.wait().expect("ends").success()
}

/// Interrupted or killed once and again, a run gives the same bits as without, and the same counts of rays. For each method, as each has
/// a state of its own.
#[test]
fn a_resumed_run_gives_the_same_bits() {
    // Enough for several rounds, and solutions, of the default.
    for (method, spp, signals) in [
        ("two-pass", 96, [Signal::SIGKILL, Signal::SIGTERM]),
        ("two-pass --read-out final-gather", 24, [Signal::SIGTERM, Signal::SIGKILL]),
        ("path", 48, [Signal::SIGKILL, Signal::SIGINT]),
        ("photon-map", 32, [Signal::SIGKILL, Signal::SIGKILL]),
        ("sppm", 32, [Signal::SIGINT, Signal::SIGKILL]),
        ("irradiance-cache", 24, [Signal::SIGKILL, Signal::SIGINT]),
        ("bidirectional", 32, [Signal::SIGKILL, Signal::SIGTERM]),
        ("metropolis", 24, [Signal::SIGTERM, Signal::SIGKILL]),
    ] {
        let place = Place::new();
        place.write("room.xml", &room(LAMP));
        let line = format!("render room.xml --method {method} --spp {spp} --size 48x32");
        place.expect(0, &format!("{line} -q -o whole --report whole.json"));
        let stopped = interrupt(&place, &format!("{line} -o a --partial-every 1e-9"), signals[0]);
        if stopped {
            let before = bytes(&place.path("a.resume"));
            // The second time on another number of threads; it is stopped after at least one pass of its own.
            let mut child =
                place.command(&format!("{line} -q -o a --resume --threads 1 --partial-every 1e-9")).spawn().expect("starts");
            let started = Instant::now();
            while child.try_wait().expect("a state").is_none() && bytes_if_any(&place.path("a.resume")) == before {
                assert!(started.elapsed() < PATIENCE, "no pass");
                std::thread::sleep(Duration::from_millis(2));
            }
            let _ = kill(Pid::from_raw(child.id() as i32), signals[1]);
            let done = child.wait().expect("ends").success();
            if !done {
                place.expect(0, &format!("{line} -q -o a --resume --report a.json"));
                let counters = |name: &str| -> serde_json::Value {
                    let report: serde_json::Value = serde_json::from_slice(&bytes(&place.path(name))).expect("JSON");
                    report["counters"]["camera_rays"].clone()
                };
                assert_eq!(counters("a.json"), counters("whole.json"), "{method}: rays");
            }
        }
        assert!(picture_bits(&place.path("a.exr")) == picture_bits(&place.path("whole.exr")), "{method}: other bits");
        assert!(!place.path("a.resume").exists(), "{method}: the state is of no use any more");
    }
}

fn bytes_if_any(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap_or_default()
}

/// A run may be given more samples than at first; a state of another scene, other settings or a damaged one is refused and left alone.
#[test]
fn a_state_that_does_not_fit_is_refused() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    let line = format!("render room.xml {QUICK} -o a");
    let (_, err) = place.expect(3, &format!("{line} --spp 4 --resume"));
    assert!(err.contains("a.resume") && err.contains("nothing to go on from"), "{err}");
    assert!(interrupt(&place, &format!("{line} --spp 1000000 --partial-every 1e-9"), Signal::SIGTERM), "it ended");
    let state = bytes(&place.path("a.resume"));
    for other in ["--seed 1", "--size 12x8", "--max-depth 3", "--method path", "--gather-rays 2", "--solver gmres"] {
        let (_, err) = place.expect(3, &format!("{line} --spp 4 --resume {other}"));
        assert!(err.contains("another run"), "{other}: {err}");
    }
    for (at, what) in [(3, "no unfinished run"), (9, "checksum"), (60, "checksum"), (state.len() - 1, "checksum")] {
        let mut damaged = state.clone();
        damaged[at] ^= 1;
        std::fs::write(place.path("a.resume"), &damaged).expect("writable");
        let (_, err) = place.expect(3, &format!("{line} --spp 4 --resume"));
        assert!(err.contains(what), "byte {at}: {err}");
        assert!(bytes(&place.path("a.resume")) == damaged, "it was not left alone");
    }
    std::fs::write(place.path("a.resume"), &state[..state.len() / 2]).expect("writable");
    let (_, err) = place.expect(3, &format!("{line} --spp 4 --resume"));
    assert!(err.contains("cut off"), "{err}");
    std::fs::write(place.path("a.resume"), &state).expect("writable");
    place.write("room.xml", &room(&LAMP.replace("5, 5, 5", "5, 5, 6")));
    let (_, err) = place.expect(3, &format!("{line} --spp 4 --resume"));
    assert!(err.contains("another run"), "{err}");
    // Fewer samples than it has: nothing is left to do.
    place.write("room.xml", &room(LAMP));
    place.expect(0, &format!("{line} --spp 1 --resume -q"));
}

/// Killed at random instants while it writes picture after picture, a run leaves whole files. The environment variable says how often.
#[test]
fn killed_at_any_instant_files_are_whole() {
    let kills: u64 = std::env::var("TWOPASS_KILLS").map_or(6, |n| n.parse().expect("a number"));
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    place.expect(0, &format!("render room.xml {QUICK} -q -o a --spp 2 --size 128x96"));
    let old = (bytes(&place.path("a.exr")), bytes(&place.path("a.png")));
    let mut replaced = 0;
    for k in 0..kills {
        let resume = if k % 2 == 1 && place.path("a.resume").exists() { "--resume" } else { "" };
        let line = format!("render room.xml {QUICK} -q -o a --spp 1000000 --size 128x96 --partial-every 1e-9 {resume}");
        let mut child = place.command(&line).spawn().expect("starts");
        // One in four before anything is written, the rest among many writes, in no step with them.
        let before = bytes_if_any(&place.path("a.resume"));
        let started = Instant::now();
        while k % 4 != 0 && bytes_if_any(&place.path("a.resume")) == before {
            assert!(started.elapsed() < PATIENCE, "kill {k}: nothing was written");
            std::thread::sleep(Duration::from_millis(2));
        }
        std::thread::sleep(Duration::from_micros((k * 61_803) % 200_000));
        kill(Pid::from_raw(child.id() as i32), Signal::SIGKILL).expect("it runs until it is killed");
        child.wait().expect("ends");
        let image = read_exr(&place.path("a.exr")).unwrap_or_else(|e| panic!("kill {k}: {e}"));
        assert_eq!((image.width(), image.height()), (128, 96), "kill {k}");
        let png = bytes(&place.path("a.png"));
        assert!(png.starts_with(b"\x89PNG") && png.ends_with(b"IEND\xae\x42\x60\x82"), "kill {k}: half a PNG");
        replaced += u32::from(bytes(&place.path("a.exr")) != old.0 && png != old.1);
    }
    assert!(replaced > 0 || kills < 6, "no kill came after a write: the law was not tried");
    // What killed runs left behind goes with the next one, and its state can be used.
    let resume = if place.path("a.resume").exists() { "--resume" } else { "" };
    place.expect(0, &format!("render room.xml {QUICK} -q -o a --spp 1 --size 128x96 {resume}"));
    assert!(place.names().iter().all(|name| !name.starts_with('.')), "{:?}", place.names());
}

/// No file may grow beyond this: what a full disk does at the same place of the same write. Portable, where no file system can be mounted.
#[test]
fn a_file_that_cannot_grow_leaves_the_old_picture() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    let line = format!("render room.xml {QUICK} -q --spp 1 --size 64x64 -o a");
    place.expect(0, &line);
    let old = (bytes(&place.path("a.exr")), bytes(&place.path("a.png")));
    for limit in ["16", "40"] {
        // Kilobytes, in bash's blocks of 1024; SIGXFSZ is ignored, so that the write fails as on a full disk.
        let shell = format!("trap '' XFSZ; ulimit -f {limit}; exec {} {line} --seed 1", env!("CARGO_BIN_EXE_twopass"));
        let output = place.shell(&shell);
        let err = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(5), "{err}");
        assert!(err.contains("a.exr") && err.contains("cannot be written"), "{err}");
        assert!(bytes(&place.path("a.exr")) == old.0, "the old picture is gone");
        assert_eq!(place.names(), ["a.exr", "a.png", "room.xml"], "rubbish is left");
    }
}

/// The same on a file system that is really full, where this process may mount one of its own.
#[test]
fn a_full_disk_leaves_the_old_picture() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    std::fs::create_dir(place.path("disk")).expect("a folder");
    let program = env!("CARGO_BIN_EXE_twopass");
    let line = format!("{program} render room.xml {QUICK} -q --spp 1 -o disk/a");
    // A picture of 24 by 16 fits, one of 200 by 200 (240 kB and more in f32) does not.
    let script = format!(
        "mount -t tmpfs -o size=192k none disk || exit 99; {line} || exit 98; cp disk/a.exr old.exr; \
         {line} --size 200x200; code=$?; cmp disk/a.exr old.exr || exit 97; ls -A disk > left.txt; exit $code"
    );
    let output = Command::new("unshare").args(["-r", "-m", "sh", "-c", &script]).current_dir(place.path("")).output();
    let Ok(output) = output else {
        eprintln!("not tried: unshare is not there; the limit on file size stands in for it");
        return;
    };
    let err = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.code() == Some(99) || err.contains("unshare:") {
        eprintln!("not tried: no file system may be mounted here ({}); the limit on file size stands in for it", err.trim());
        return;
    }
    assert_eq!(output.status.code(), Some(5), "{err}");
    assert!(err.contains("No space left") && err.contains("a.exr"), "{err}");
    let left = std::fs::read_to_string(place.path("left.txt")).expect("a list");
    assert_eq!(left.split_whitespace().collect::<Vec<_>>(), ["a.exr", "a.png"], "rubbish is left");
}

/// Too little memory is said before it is taken, by the flag and by the system's limit on the address space.
#[test]
fn too_little_memory_is_refused_before_it_is_taken() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    for line in [
        "render room.xml --max-memory 1M --size 64x64".to_owned(),
        "render room.xml --max-memory 16M --size 200x200".to_owned(),
        "render room.xml --max-memory 16M --patch-size 0.01".to_owned(),
        "solve room.xml --max-memory 16M --patch-size 0.01".to_owned(),
    ] {
        let (_, err) = place.expect(4, &line);
        assert!(err.contains("MB") && err.contains("--max-memory"), "{line}: {err}");
    }
    assert_eq!(place.names(), ["room.xml"]);
    place.expect(0, &format!("render room.xml --max-memory 64M -q --spp 1 {QUICK}"));
    let program = env!("CARGO_BIN_EXE_twopass");
    for (line, code) in [
        ("render room.xml --size 8000x8000 --threads 2", 4),
        ("solve room.xml --patch-size 0.004 --threads 2", 4),
        ("render room.xml --spp 1 --patch-size 0.5 --tolerance 0.1 -q --threads 2", 0),
    ] {
        let output = place.shell(&format!("ulimit -v 1000000; exec {program} {line}"));
        let err = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{line}: {err}");
    }
}

/// Two runs on one output: the second is refused and the first is whole. Two outputs in one folder are no matter.
#[test]
fn two_runs_on_one_output_do_not_mix() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    let mut first =
        place.command(&format!("render room.xml {QUICK} -q -o a --spp 1000000 --partial-every 1e-9")).spawn().expect("starts");
    wait_for(&place.path("a.exr"), &mut first);
    let (_, err) = place.expect(5, &format!("render room.xml {QUICK} -o a --spp 1"));
    assert!(err.contains("another run"), "{err}");
    place.expect(0, &format!("render room.xml {QUICK} -q -o b --spp 1"));
    kill(Pid::from_raw(first.id() as i32), Signal::SIGKILL).expect("it runs");
    first.wait().expect("ends");
    // A killed run keeps no lock.
    place.expect(0, &format!("render room.xml {QUICK} -q -o a --spp 1"));
    assert!(place.names().iter().all(|name| !name.starts_with('.')), "{:?}", place.names());
}

/// Settings of the user's system that do not matter: a locale with a decimal comma, no home, a closed stdout.
#[test]
fn locale_home_and_stdout_do_not_matter() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    let line = format!("render room.xml {QUICK} -q --spp 1 -o ");
    place.expect(0, &format!("{line}a"));
    let foreign = [("LC_ALL", "de_DE.UTF-8"), ("LANG", "de_DE.UTF-8"), ("LC_NUMERIC", "de_DE.UTF-8")];
    let output = place.command(&format!("{line}b")).envs(foreign).env_remove("HOME").output().expect("starts");
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(picture_bits(&place.path("a.exr")) == picture_bits(&place.path("b.exr")), "the locale changed the picture");
    let program = env!("CARGO_BIN_EXE_twopass");
    for script in [
        "info room.xml >&-",
        "info room.xml | head -n 1 >/dev/null",
        "--list-methods | true",
        "solve room.xml --patch-size 0.5 >&-",
    ] {
        let output = place.shell(&format!("{program} {script}; exit ${{PIPESTATUS[0]}}"));
        let (code, err) = (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned());
        // A pipe that nobody reads is no fault; a stdout that was never open may be told of.
        assert!(
            matches!(code, Some(0 | 5)) && !err.contains("panicked") && !err.contains("internal fault"),
            "{script}: {code:?} {err}"
        );
    }
}

/// A folder that may not be written to is found before anything is computed.
#[test]
fn a_folder_that_is_read_only_is_found_first() {
    let place = Place::new();
    place.write("room.xml", &room(LAMP));
    // Not even root may make files there.
    let started = Instant::now();
    let (_, err) = place.expect(5, "render room.xml -o /proc/a --time 100");
    assert!(err.contains("/proc/a.exr") && started.elapsed() < Duration::from_secs(20), "{err}");
    let mut permissions = std::fs::metadata(place.path("")).expect("there").permissions();
    std::os::unix::fs::PermissionsExt::set_mode(&mut permissions, 0o555);
    std::fs::create_dir(place.path("locked")).expect("a folder");
    std::fs::set_permissions(place.path("locked"), permissions).expect("settable");
    if std::fs::write(place.path("locked/x"), "").is_err() {
        place.expect(5, "render room.xml -o locked/a --time 100");
        place.expect(5, "solve room.xml -o locked/a.sol");
    }
}

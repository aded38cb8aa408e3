//! Values and surroundings that make no sense, on the built program: rows C17 to C19, C27 and C28 of the catalogue in
//! `catalogue.rs`. A flag's value ends with 2, a value in the scene with 3, a size over a limit with 4.

use crate::catalogue::{Case, SENSOR, assert_words, expect};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A scene whose one-line sensor, on line 2, is changed.
fn sensor(from: &str, to: &str) -> Case {
    let changed = SENSOR.replacen(from, to, 1);
    assert_ne!(changed, SENSOR, "{from}");
    Case::whole(format!("<scene version='3.0.0'>\n{changed}\n</scene>\n"))
}

/// A lit cube with a coarse film.
fn room() -> Case {
    Case::new(
        "<shape type='cube'><boolean name='flip_normals' value='true'/></shape>
        <shape type='sphere'><float name='radius' value='0.3'/><emitter type='area'/></shape>\n",
    )
}

const RENDER: &str = "render scene.xml --spp 1 --patch-size 1 --tolerance 0.1";

#[test]
fn c17_film_sizes() {
    for (value, code, words) in [
        ("0", 3, "1 or more"),
        ("-5", 3, "1 or more"),
        ("4294967297", 4, "width of the film"),
        ("9223372036854775807", 4, "width of the film"),
        ("2000000", 4, "width of the film"),
        ("99999999999999999999", 3, "a whole number"),
        ("8.5", 3, "a whole number"),
    ] {
        sensor("value='8'", &format!("value='{value}'")).refused(code, &["scene.xml:2:", words]);
    }
    let square = "value='60000'/><integer name='height' value='60000'";
    sensor("value='8'/><integer name='height' value='4'", square).refused(4, &["scene.xml:2:", "60000 x 60000"]);
    let room = room();
    for (size, code) in [("0x5", 2), ("-5x4", 2), ("4294967297x4", 2), ("8", 2), ("2000000x2000000", 4)] {
        let line = format!("render scene.xml --threads 2 --size {size}");
        let time = |_| {
            let start = Instant::now();
            assert_words(
                &room.run(code, &line).1,
                &[if code == 4 { "4000000000000 pixels" } else { size.split('x').next().expect("a width") }],
                size,
            );
            start.elapsed()
        };
        // The best of several, since other work may run beside this.
        let best = (0..5).map(time).min().expect("five");
        assert!(best < Duration::from_millis(50), "{size}: {best:?}");
    }
}

#[test]
fn c18_counts_angles_and_scales() {
    let spp = |n: &str| format!("<sampler type='independent'><integer name='sample_count' value='{n}'/></sampler><film");
    for n in ["0", "-3", "4294967296"] {
        sensor("<film", &spp(n)).refused(3, &["scene.xml:2:", "sample_count", "from 1"]);
    }
    for fov in ["0", "180", "-5", "360"] {
        sensor("<film", &format!("<float name='fov' value='{fov}'/><film")).refused(3, &["scene.xml:2:", "between 0 and 180"]);
    }
    sensor("<film", "<float name='fov' value='nan'/><film").refused(3, &["scene.xml:2:", "a finite number"]);
    let depth = "<integrator type='path'><integer name='max_depth' value='-7'/></integrator>";
    Case::new(depth).refused(3, &["scene.xml:3:", "max_depth", "-1 (unlimited)"]);
    for operation in
        ["scale value='0'", "scale y='0'", "matrix value='1 0 0 0  1 0 0 0  0 0 1 0  0 0 0 1'", "scale value='1e-200'"]
    {
        let body = format!("<shape type='cube'><transform name='to_world'><{operation}/></transform></shape>");
        Case::new(&body).refused(3, &["scene.xml:3:", "to_world", "invertible"]);
    }
    sensor("<film", "<transform name='to_world'><scale value='0'/></transform><film").refused(3, &["scene.xml:2:", "invertible"]);
    let room = room();
    for flag in
        ["--spp 0", "--spp -3", "--spp 1.5", "--max-depth -7", "--time 0", "--time nan", "--patch-size 0", "--tolerance -1"]
    {
        let (_, err) = room.run(2, &format!("render scene.xml --threads 2 {flag}"));
        assert_words(&err, &flag.split(' ').collect::<Vec<_>>(), flag);
    }
}

#[test]
fn c19_reflectances_that_are_none() {
    for value in ["nan", "inf", "-nan", "1e400", "0.1, nan, 0.1"] {
        let body = format!("<bsdf type='diffuse'><rgb name='reflectance' value='{value}'/></bsdf>");
        Case::new(&body).refused(3, &["scene.xml:3:", "finite numbers"]);
    }
    for value in ["2", "-1", "0.5, 0.5, 1.0001"] {
        let body = format!("<bsdf type='diffuse'><rgb name='reflectance' value='{value}'/></bsdf>");
        Case::new(&body).refused(3, &["scene.xml:3:", "reflectance", "from 0 to 1"]);
    }
    // Wherever the value comes from, the place is where it is used.
    let body = "<default name='rho' value='0.5'/><bsdf type='diffuse'><rgb name='reflectance' value='$rho'/></bsdf>";
    let (_, err) = Case::new(body).run(3, "info scene.xml -D rho=nan");
    assert_words(&err, &["scene.xml:3:", "finite numbers", "nan"], "-D rho=nan");
}

#[test]
fn c27_any_number_of_threads() {
    let mut room = room();
    let bits = |name: &str, room: &Case| std::fs::read(room.path(name)).expect("a picture");
    room.run(0, &format!("{RENDER} -o 2 --threads 2 -q"));
    // Stacks of 2 MB are written to only where they are used, but all count: there are eight threads a processor at most.
    room = room.within(4 << 20).seconds(2);
    for n in ["0", "1", "3", "999"] {
        room.run(0, &format!("{RENDER} -o n --threads {n} -q"));
        assert_eq!(bits("2.png", &room), bits("n.png", &room), "{n} threads");
    }
    for n in ["-1", "two", "1.5", "99999999999999999999"] {
        let (_, err) = room.run(2, &format!("{RENDER} --threads {n}"));
        assert_words(&err, &[n], n);
    }
    // One processor only, as in a container.
    let mut command = Command::new("taskset");
    let line = format!("{RENDER} -o n -q");
    command.args(["-c", "0", env!("CARGO_BIN_EXE_twopass")]).args(line.split_whitespace()).current_dir(room.path(""));
    expect(0, command, &line);
    assert_eq!(bits("2.png", &room), bits("n.png", &room), "one processor");
}

#[test]
fn c28_closed_pipes_no_home_and_no_place_to_write() {
    let room = room();
    for line in ["info scene.xml", "info scene.xml --json", "--help", "--list-methods"] {
        for both in [false, true] {
            let mut command = room.command(line);
            let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("starts");
            drop(child.stdout.take());
            drop(if both { child.stderr.take() } else { None });
            let output = child.wait_with_output().expect("ends");
            assert_eq!(output.status.code(), Some(0), "{line}: {}", String::from_utf8_lossy(&output.stderr));
        }
    }
    let mut command = room.command("info none.xml");
    let mut child = command.stderr(Stdio::piped()).spawn().expect("starts");
    drop(child.stderr.take());
    assert_eq!(child.wait().expect("ends").code(), Some(3), "a message that nobody reads");

    let plain = room.accepted();
    let mut bare = room.command("info scene.xml --threads 2");
    bare.env_clear().env("PATH", "/usr/bin:/bin");
    assert_eq!(expect(0, bare, "without HOME").0, plain);
    let mut german = room.command("info scene.xml --threads 2");
    german.env("LC_ALL", "de_DE.UTF-8").env("LANG", "de_DE.UTF-8").env("LC_NUMERIC", "de_DE.UTF-8");
    assert_eq!(expect(0, german, "decimal comma").0, plain);

    // Nobody can make files there, whatever their rights.
    let scene = room.path("scene.xml");
    let mut nowhere = room.command(&RENDER.replace("scene.xml", &scene.to_string_lossy()));
    nowhere.current_dir("/proc");
    let (_, err) = expect(5, nowhere, "in a folder without files");
    assert_words(&err, &["exr", "written"], "in a folder without files");
}

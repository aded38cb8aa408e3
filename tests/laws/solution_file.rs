//! The kept solution: what may be reused is, and to the bit; what may not is not; a file that is not whole is refused and left alone.

use super::cli::Place;
use std::path::Path;
use twopass::accel::AccelKind;
use twopass::film::io::read_exr;
use twopass::load::{LoadOptions, load_scene};
use twopass::math::Rgb;
use twopass::pipeline::LampWeight;
use twopass::pipeline::keys::StageKeys;
use twopass::pipeline::solution_file::SolutionFile;
use twopass::run_report::RunReport;
use twopass::world::World;

const QUICK: &str = "--patch-size 0.25 --tolerance 0.05 --solver-tolerance 1e-9";

/// A closed grey room with two lamps and a red wall.
fn room(lamps: [&str; 2], wall: &str, eye: &str, floor: f64) -> String {
    let [left, right] = lamps;
    format!(
        r#"<scene version="3.0.0">
  <integrator type="path"/>
  <sensor type="perspective">
    <float name="fov" value="60"/>
    <transform name="to_world"><lookat origin="{eye}" target="0, 1, 0" up="0, 0, 1"/></transform>
    <sampler type="independent"><integer name="sample_count" value="2"/></sampler>
    <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="16"/><rfilter type="box"/></film>
  </sensor>
  <bsdf type="twosided" id="grey"><bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.5, 0.5"/></bsdf></bsdf>
  <bsdf type="twosided" id="wall"><bsdf type="diffuse"><rgb name="reflectance" value="{wall}"/></bsdf></bsdf>
  <shape type="cube"><ref id="grey"/></shape>
  <shape type="rectangle">
    <transform name="to_world"><scale value="{floor}"/><translate z="-0.9"/></transform>
    <ref id="wall"/>
  </shape>
  <shape type="rectangle" id="left">
    <transform name="to_world"><scale value="0.2"/><rotate x="1" angle="180"/><translate x="-0.5" z="0.95"/></transform>
    <ref id="grey"/>
    <emitter type="area"><rgb name="radiance" value="{left}"/></emitter>
  </shape>
  <shape type="rectangle" id="right">
    <transform name="to_world"><scale value="0.2"/><rotate x="1" angle="180"/><translate x="0.5" z="0.95"/></transform>
    <ref id="grey"/>
    <emitter type="area"><rgb name="radiance" value="{right}"/></emitter>
  </shape>
</scene>
"#
    )
}

const EYE: &str = "0, -0.9, 0";
const LAMPS: [&str; 2] = ["5, 5, 5", "1, 2, 4"];

fn plain() -> String {
    room(LAMPS, "0.7, 0.2, 0.1", EYE, 0.6)
}

fn report(path: &Path) -> RunReport {
    serde_json::from_str(&std::fs::read_to_string(path).expect("a report")).expect("JSON")
}

impl Place {
    /// Solves `scene` into `room.sol`; the report.
    fn solve(&self, scene: &str, flags: &str) -> RunReport {
        self.write("room.xml", scene);
        self.expect(0, &format!("solve room.xml -q -o room.sol --report r.json {flags}"));
        report(&self.path("r.json"))
    }
}

/// Counters of what was computed: patches, form factors, shadow rays, sweeps.
fn work(report: &RunReport) -> [u64; 4] {
    ["patches", "form_factors", "shadow_rays", "sweeps"].map(|name| report.counters.get(name).copied().unwrap_or(0))
}

#[test]
fn each_stage_is_done_again_only_if_something_it_depends_on_has_changed() {
    let place = Place::new();
    let first = work(&place.solve(&plain(), QUICK));
    assert!(first.iter().all(|n| *n > 0), "{first:?}");
    // Nothing has changed; nor has anything that matters when only the view has.
    assert_eq!(work(&place.solve(&plain(), QUICK)), [0; 4]);
    let from_afar = room(LAMPS, "0.7, 0.2, 0.1", "0.3, -0.8, 0.2", 0.6);
    assert_eq!(work(&place.solve(&from_afar, QUICK)), [0; 4]);
    // Another paint, a brighter lamp: only the solution, and equal to one from scratch.
    let repainted = room(LAMPS, "0.1, 0.3, 0.6", EYE, 0.6);
    let [patches, form_factors, shadow_rays, sweeps] = work(&place.solve(&repainted, QUICK));
    assert!([patches, form_factors, shadow_rays] == [0; 3] && sweeps > 0, "{patches} {form_factors} {shadow_rays} {sweeps}");
    place.expect(0, &format!("solve room.xml -q -o fresh.sol {QUICK}"));
    place.expect(0, "render room.xml -q -o kept --solution room.sol --read-out stored --spp 1");
    place.expect(0, "render room.xml -q -o fresh --solution fresh.sol --read-out stored --spp 1");
    let pixels = |name: &str| read_exr(&place.path(name)).expect("a picture").pixels().concat();
    assert_eq!(pixels("kept.exr"), pixels("fresh.exr"));
    let brighter = room(["9, 3, 5", "1, 2, 4"], "0.1, 0.3, 0.6", EYE, 0.6);
    let [patches, form_factors, shadow_rays, sweeps] = work(&place.solve(&brighter, QUICK));
    assert!([patches, form_factors, shadow_rays] == [0; 3] && sweeps > 0, "{patches} {form_factors} {shadow_rays} {sweeps}");
    // Other rays: form factors again, on the same patches. Another shape: all.
    let finer = work(&place.solve(&brighter, "--patch-size 0.25 --tolerance 0.04 --solver-tolerance 1e-9"));
    assert!(finer[0] == 0 && finer[1] > 0 && finer[3] > 0, "{finer:?}");
    let moved = work(&place.solve(&room(LAMPS, "0.7, 0.2, 0.1", EYE, 0.5), QUICK));
    assert!(moved.iter().all(|n| *n > 0), "{moved:?}");
}

#[test]
fn a_view_of_a_kept_solution_computes_nothing_of_pass_one() {
    let place = Place::new();
    place.solve(&plain(), QUICK);
    place.write("room.xml", &room(LAMPS, "0.7, 0.2, 0.1", "0.3, -0.8, 0.2", 0.6));
    for read_out in ["", "--read-out stored", "--read-out direct-stored", "--read-out final-gather"] {
        place.expect(0, &format!("render room.xml -q -o view --solution room.sol --spp 8 --report v.json {read_out}"));
        let report = report(&place.path("v.json"));
        let [patches, form_factors, _, sweeps] = work(&report);
        assert_eq!([patches, form_factors, sweeps], [0; 3], "{read_out}");
        assert_eq!(report.counters.get("form_factor_rays"), Some(&0), "{read_out}");
    }
    // The same picture as without the file, where pass one is the same.
    place.expect(0, &format!("render room.xml -q -o whole --read-out stored --spp 1 {QUICK}"));
    place.expect(0, "render room.xml -q -o view --read-out stored --spp 1 --solution room.sol");
    let pixels = |name: &str| read_exr(&place.path(name)).expect("a picture").pixels().concat();
    let (whole, view) = (pixels("whole.exr"), pixels("view.exr"));
    for (a, b) in whole.iter().zip(&view) {
        assert!((a - b).abs() <= 1e-6 * a.abs(), "{a} and {b}");
    }
}

/// Light adds up: a lamp made stronger afterwards is a lamp that was stronger to begin with.
#[test]
fn a_lamp_weighted_anew_is_as_a_fresh_solution() {
    let place = Place::new();
    place.solve(&plain(), QUICK);
    place.expect(0, "render room.xml -q -o weighted --solution room.sol --light left=0.5 --light right=2,1,0.5,3 --read-out stored --spp 1 --report w.json");
    let found = report(&place.path("w.json"));
    assert_eq!(work(&found)[3], 0, "sweeps");
    // Also what shadow rays find in pass two.
    place.expect(0, "render room.xml -q -o weighted2 --solution room.sol --light left=0.5 --light right=2,1,0.5,3 --read-out final-gather --spp 4");
    place.write("room.xml", &room(["2.5, 2.5, 2.5", "2, 2, 24"], "0.7, 0.2, 0.1", EYE, 0.6));
    place.expect(0, &format!("render room.xml -q -o fresh --read-out stored --spp 1 {QUICK}"));
    place.expect(0, &format!("render room.xml -q -o fresh2 --read-out final-gather --spp 4 {QUICK}"));
    let pixels = |name: &str| read_exr(&place.path(name)).expect("a picture").pixels().concat();
    for (a, b) in [("weighted.exr", "fresh.exr"), ("weighted2.exr", "fresh2.exr")] {
        for (a, b) in pixels(a).iter().zip(pixels(b)) {
            assert!((a - b).abs() <= 2e-6 * a.abs().max(1e-3), "{a} and {b}");
        }
    }
    place.write("room.xml", &plain());
    let (_, err) = place.expect(2, "render room.xml -q -o x --solution room.sol --light middle=2");
    assert!(err.contains("middle") && err.contains("left") && err.contains("right"), "{err}");
    let (_, err) = place.expect(2, "render room.xml -q -o x --light left=2");
    assert!(err.contains("--solution"), "{err}");
}

/// More lamps than a point looks at, one of them a checkerboard: still each has light of its own. Twice all lamps are twice the light, and that of each by
/// itself adds up to that of all.
#[test]
fn many_lamps_and_textured_ones_are_weighted_too() {
    let place = Place::new();
    let lamp = |k: usize, radiance: &str| {
        format!(
            r#"<shape type="rectangle" id="lamp{k}">
    <transform name="to_world"><scale value="0.1"/><rotate x="1" angle="180"/><translate x="{}" z="0.95"/></transform>
    <ref id="grey"/><emitter type="area">{radiance}</emitter></shape>"#,
            0.3 * k as f64 - 0.75
        )
    };
    let board = r#"<texture type="checkerboard" name="radiance"><rgb name="color0" value="30, 3, 3"/><rgb name="color1" value="0, 3, 30"/></texture>"#;
    let lamps: String =
        (0..6).map(|k| lamp(k, if k == 2 { board } else { r#"<rgb name="radiance" value="5, 4, 3"/>"# })).collect();
    let scene = plain().replace("</scene>", &(lamps + "</scene>"));
    place.solve(&scene, QUICK);
    let picture = |weights: &str| {
        place.expect(
            0,
            &format!("render room.xml -q -o seen --solution room.sol {weights} --read-out stored --spp 1 --image-filter off"),
        );
        read_exr(&place.path("seen.exr")).expect("a picture").pixels().concat()
    };
    let names: Vec<String> =
        ["left".to_owned(), "right".to_owned()].into_iter().chain((0..6).map(|k| format!("lamp{k}"))).collect();
    let all = |scale: &str| names.iter().map(|name| format!("--light {name}={scale} ")).collect::<String>();
    let (whole, twice) = (picture(""), picture(&all("2")));
    for (a, b) in whole.iter().zip(&twice) {
        assert!((2.0 * a - b).abs() <= 1e-5 * b.abs(), "{a} and twice as much {b}");
    }
    // The light of all is the sum of the light of each.
    let mut sum = vec![0.0_f32; whole.len()];
    for name in &names {
        let alone = picture(&format!("{}--light {name}=1e6", all("1e-6")));
        sum.iter_mut().zip(alone).for_each(|(sum, value)| *sum += value);
    }
    // So it is in every patch.
    let patches_of = |weights: &[LampWeight]| {
        let scene = load_scene(&place.path("room.xml"), &LoadOptions::default()).expect("a scene").scene;
        let world = World::new(scene, AccelKind::default()).expect("a world");
        let file = SolutionFile::read(&place.path("room.sol")).expect("a solution");
        let keys = StageKeys::of(world.scene(), &file.meta.settings, file.meta.seed);
        let field = file.whole(&keys).expect("of this scene").weighted(&world, weights).field;
        (0..field.patches.len()).map(|i| field.irradiance_of(i)).collect::<Vec<Rgb>>()
    };
    let all_patches = patches_of(&[]);
    let mut by_lamp = vec![Rgb::BLACK; all_patches.len()];
    for name in &names {
        let weight =
            |other: &String| LampWeight { name: other.clone(), factor: Rgb::grey(if other == name { 1.0 } else { 0.0 }) };
        let alone = patches_of(&names.iter().map(weight).collect::<Vec<_>>());
        by_lamp.iter_mut().zip(alone).for_each(|(sum, value)| *sum += value);
    }
    for (a, b) in all_patches.iter().zip(&by_lamp) {
        assert!((*a - *b).map(f64::abs).max() <= 1e-12 * a.max(), "{a:?} of all in a patch, {b:?} one by one");
    }
    // Interpolation keeps within what patches around a point have, which is no linear law: beside a lamp it cuts off what the plane of its light alone
    // overshoots by, where the light of all may not. Without that bound no value was off by more than 7.2e-6. With it those few are, the others
    // are as close, and the mean is.
    let mut apart: Vec<f32> = whole.iter().zip(&sum).map(|(a, b)| (a - b).abs() / a.abs().max(1e-3)).collect();
    apart.sort_by(f32::total_cmp);
    assert!(apart[apart.len() * 9 / 10] <= 1e-4, "{} apart in a tenth of the picture", apart[apart.len() * 9 / 10]);
    let mean = |of: &[f32]| of.iter().map(|v| f64::from(*v)).sum::<f64>() / of.len() as f64;
    let (together, one_by_one) = (mean(&whole), mean(&sum));
    assert!((together / one_by_one - 1.0).abs() < 2e-3, "{together} of all, {one_by_one} one by one");
    assert!(picture(&format!("{}--light lamp2=1e6", all("1e-6"))).iter().any(|v| *v > 1e-3), "the checkerboard shines");
}

/// A mirror's light is that of all lamps together: a solution for each of them would be for nothing.
#[test]
fn where_no_lamp_can_be_weighted_all_have_one_solution() {
    let place = Place::new();
    let sweeps = |scene: &str, output: &str| {
        place.write("room.xml", scene);
        place.expect(0, &format!("solve room.xml -q {QUICK} {output} --report r.json"));
        work(&report(&place.path("r.json")))[3]
    };
    let mirror = r#"<shape type="rectangle"><transform name="to_world"><scale value="0.3"/><translate z="-0.8"/></transform>
  <bsdf type="twosided"><bsdf type="conductor"/></bsdf></shape></scene>"#;
    let mirrored = plain().replace("</scene>", mirror);
    assert!(sweeps(&plain(), "-o plain.sol") > sweeps(&plain(), ""), "each lamp has its own");
    assert_eq!(sweeps(&mirrored, "-o mirrored.sol"), sweeps(&mirrored, ""));
    let (_, err) = place.expect(2, "render room.xml -q -o x --solution mirrored.sol --light left=2");
    assert!(err.contains("all lights together"), "{err}");
}

#[test]
fn files_that_are_stale_cut_off_damaged_or_foreign_are_refused_and_left_alone() {
    let place = Place::new();
    place.solve(&plain(), QUICK);
    let good = std::fs::read(place.path("room.sol")).expect("a solution");
    let refused = |bytes: &[u8], word: &str| {
        std::fs::write(place.path("room.sol"), bytes).expect("writable");
        for line in
            ["render room.xml -q -o x --solution room.sol --spp 1".to_owned(), format!("solve room.xml -q -o room.sol {QUICK}")]
        {
            let (_, err) = place.expect(3, &line);
            assert!(err.contains("room.sol") && err.contains(word), "{line}: {err}");
            assert_eq!(std::fs::read(place.path("room.sol")).expect("still there"), bytes, "{line}");
        }
        assert!(!place.path("x.exr").exists());
    };
    refused(b"", "no solution");
    refused(b"<scene/> and more than eight bytes", "no solution");
    for length in [9, 20, good.len() / 2, good.len() - 1] {
        refused(&good[..length], "cut off");
    }
    let mut longer = good.clone();
    longer.push(0);
    refused(&longer, "after its end");
    let mut later = good.clone();
    later[8] = 99;
    refused(&later, "version 99");
    // One bit anywhere but in the head: in a key, in contents of each section, in the last checksum.
    for at in [30, 70, good.len() / 10, good.len() / 2, good.len() - 200, good.len() - 1] {
        let mut flipped = good.clone();
        flipped[at] ^= 0x10;
        refused(&flipped, "room.sol");
    }
    // Whole, but of a scene that has changed since: not for a view, though a start for a new solution.
    std::fs::write(place.path("room.sol"), &good).expect("writable");
    for (scene, word) in [
        (room(LAMPS, "0.7, 0.2, 0.1", EYE, 0.5), "geometry"),
        (room(LAMPS, "0.6, 0.2, 0.1", EYE, 0.6), "reflectance"),
        (room(["5, 5, 6", "1, 2, 4"], "0.7, 0.2, 0.1", EYE, 0.6), "light"),
    ] {
        place.write("room.xml", &scene);
        let (_, err) = place.expect(3, "render room.xml -q -o x --solution room.sol --spp 1");
        assert!(err.contains(word) && err.contains("changed"), "{err}");
    }
    assert_eq!(std::fs::read(place.path("room.sol")).expect("still there"), good);
    place.expect(3, "render room.xml -q -o x --solution none.sol");
}

#[test]
fn the_file_is_the_same_for_one_and_two_threads() {
    let place = Place::new();
    place.solve(&plain(), &format!("{QUICK} --threads 1"));
    let one = std::fs::read(place.path("room.sol")).expect("a solution");
    place.expect(0, &format!("solve room.xml -q -o two.sol --threads 2 {QUICK}"));
    assert!(one == std::fs::read(place.path("two.sol")).expect("a solution"));
}

/// Whenever the process dies, the file is the old one or the new one.
#[test]
fn a_killed_solve_leaves_an_old_file_or_a_new_one() {
    let place = Place::new();
    place.solve(&plain(), QUICK);
    let old = std::fs::read(place.path("room.sol")).expect("a solution");
    place.write("room.xml", &room(LAMPS, "0.1, 0.3, 0.6", EYE, 0.6));
    place.expect(0, &format!("solve room.xml -q -o new.sol {QUICK}"));
    let new = std::fs::read(place.path("new.sol")).expect("a solution");
    let mut kept = [0, 0];
    for delay in (0..40).map(|k| 3 * k) {
        std::fs::write(place.path("room.sol"), &old).expect("writable");
        let mut command = place.command(&format!("solve room.xml -q -o room.sol {QUICK}"));
        let mut child = command.stdout(std::process::Stdio::null()).spawn().expect("starts");
        std::thread::sleep(std::time::Duration::from_millis(delay));
        child.kill().expect("SIGKILL");
        child.wait().expect("ended");
        let found = std::fs::read(place.path("room.sol")).expect("never without a file");
        assert!(found == old || found == new, "killed after {delay} ms: neither the old file nor the new one");
        kept[usize::from(found == new)] += 1;
    }
    println!("killed 40 times: {kept:?} old and new files");
}

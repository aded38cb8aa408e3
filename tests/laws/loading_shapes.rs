//! Geometry of shapes against points that Mitsuba 3.9.1 reports for rays at the same shapes.

use crate::loading::{Fixture, corners, scene};
use twopass::load::LoadErrorKind;
use twopass::math::{DVec3, Vec2};
use twopass::scene::{Scene, ShapeSurface};

/// Normal and uv of shape `index` where a ray along -`from` passes nearest to `point`, by interpolation over the triangle nearest to
/// it; the distance to that triangle must be below `within`.
fn surface_at(scene: &Scene, index: usize, point: DVec3, within: f64) -> (DVec3, Vec2) {
    let shape = &scene.shapes[index];
    let (mut best, mut nearest) = (None, f64::INFINITY);
    for triangle in corners(scene, shape) {
        let [a, b, c] = triangle.map(|c| c.0);
        let area = (b - a).cross(c - a);
        let weight = |p: DVec3, q: DVec3| area.dot((p - point).cross(q - point)) / area.length_squared();
        let w = [weight(b, c), weight(c, a), weight(a, b)];
        let distance = area.normalize().dot(point - a).abs();
        if w.iter().all(|w| *w > -1e-6) && distance < nearest {
            nearest = distance;
            let mut normal = area.normalize();
            if triangle[0].1.is_some() {
                normal = (0..3).map(|k| w[k] * triangle[k].1.expect("all have one").as_dvec3()).sum::<DVec3>().normalize();
            }
            let uv = (0..3).map(|k| w[k] as f32 * triangle[k].2).sum();
            best = Some((normal, uv));
        }
    }
    assert!(nearest < within, "{}: {point} is {nearest} from the surface", shape.id);
    best.expect("a triangle above the point")
}

fn expect(scene: &Scene, index: usize, point: [f64; 3], normal: [f64; 3], uv: [f32; 2], within: f64) {
    let (n, t) = surface_at(scene, index, point.into(), within);
    let (normal, uv) = (DVec3::from(normal), Vec2::from(uv));
    assert!(
        (n - normal).length() < 2.0 * within.max(1e-5),
        "{}: normal {n} at {point:?}, expected {normal}",
        scene.shapes[index].id
    );
    assert!((t - uv).length() < 2.0 * within.max(1e-5) as f32, "{}: uv {t} at {point:?}, expected {uv}", scene.shapes[index].id);
}

/// A prism of 64 sides leaves the cylinder by 1 - cos(pi/64) of its radius at most, plus as much for the area.
const FACETS: f64 = 2.5e-3;

#[test]
fn cylinders_are_where_mitsuba_puts_them() {
    let body = "<shape type='cylinder'/>
        <shape type='cylinder'><boolean name='flip_normals' value='true'/></shape>
        <shape type='cylinder'><point name='p0' x='0' y='0' z='-1'/><point name='p1' x='1' y='2' z='1'/>
            <float name='radius' value='.5'/></shape>
        <shape type='cylinder'><transform name='to_world'><scale x='-1'/></transform></shape>
        <shape type='cylinder'><transform name='to_world'><scale x='2' z='3'/></transform></shape>";
    let scene = scene(body);
    for (point, normal, uv) in [
        ([0.979796, 0.2, 0.3], [0.979796, 0.2, 0.0], [0.032047, 0.3]),
        ([-0.979796, 0.2, 0.3], [-0.979796, 0.2, 0.0], [0.467953, 0.3]),
        ([0.2, -0.979796, 0.7], [0.2, -0.979796, 0.0], [0.782047, 0.7]),
    ] {
        expect(&scene, 0, point, normal, uv, FACETS);
        expect(&scene, 1, point, normal.map(|v| -v), uv, FACETS);
        // Mirrored in x, the angle runs the other way round: u becomes 1/2 - u.
        expect(&scene, 3, point, normal, [(0.5 - uv[0]).rem_euclid(1.0), uv[1]], FACETS);
    }
    for (point, normal, uv) in [
        ([1.030330, 1.0, 0.0], [0.942809, -0.235702, -0.235702], [0.977416, 0.558926]),
        ([0.5, 1.748132, 0.1], [-0.376947, 0.742369, -0.553895], [0.292879, 0.688474]),
        ([0.5, 0.9, -0.748132], [0.376947, 0.553895, -0.742369], [0.161954, 0.311526]),
    ] {
        expect(&scene, 2, point, normal, uv, FACETS);
    }
    expect(&scene, 4, [1.959592, 0.2, 0.3], [0.925820, 0.377964, 0.0], [0.032047, 0.1], 2.0 * FACETS);
}

#[test]
fn a_cylinder_needs_two_ends_and_a_radius() {
    for (body, part) in [
        ("<shape type='cylinder'><point name='p1' x='0' y='0' z='0'/></shape>", "\"p1\" must be another point"),
        ("<shape type='cylinder'><float name='radius' value='0'/></shape>", "above 0"),
    ] {
        let error = Fixture::new(body).load().expect_err("must be refused").to_string();
        assert!(error.contains(part), "{error}");
    }
}

#[test]
fn faces_of_a_cube_have_mitsubas_texture_coordinates() {
    let scene = scene("<shape type='cube'/><shape type='cube'><boolean name='flip_normals' value='true'/></shape>");
    for (point, normal, uv) in [
        ([0.3, 0.4, 1.0], [0.0, 0.0, 1.0], [0.70, 0.65]),
        ([0.3, 0.4, -1.0], [0.0, 0.0, -1.0], [0.30, 0.65]),
        ([1.0, 0.3, 0.4], [1.0, 0.0, 0.0], [0.65, 0.30]),
        ([-1.0, 0.3, 0.4], [-1.0, 0.0, 0.0], [0.65, 0.70]),
        ([0.3, 1.0, 0.4], [0.0, 1.0, 0.0], [0.35, 0.30]),
        ([0.3, -1.0, 0.4], [0.0, -1.0, 0.0], [0.70, 0.65]),
    ] {
        expect(&scene, 0, point, normal, uv, 1e-6);
        expect(&scene, 1, point, normal.map(|v| -v), uv, 1e-6);
    }
}

#[test]
fn disks_and_rectangles_flip_and_mirror_as_in_mitsuba() {
    let flip = "<boolean name='flip_normals' value='true'/>";
    let mirror = "<transform name='to_world'><scale x='-1'/></transform>";
    let shape = |kind: &str, extra: &str| format!("<shape type='{kind}'>{extra}</shape>");
    let both = format!("{flip}{mirror}");
    for (kind, uv, mirrored) in [("rectangle", [0.65, 0.7], [0.35, 0.7]), ("disk", [0.5, 0.147584], [0.5, 0.352416])] {
        for (extra, side, uv) in [("", 1.0, uv), (flip, -1.0, uv), (mirror, 1.0, mirrored), (&both, -1.0, mirrored)] {
            let scene = scene(&shape(kind, extra));
            expect(&scene, 0, [0.3, 0.4, 0.0], [0.0, 0.0, side], uv, if kind == "disk" { 0.01 } else { 1e-6 });
        }
    }
}

#[test]
fn spheres_stay_exact_where_nobody_can_tell_the_difference() {
    let flip = "<boolean name='flip_normals' value='true'/>";
    let mirror = "<transform name='to_world'><scale x='-1'/></transform>";
    let turn = "<transform name='to_world'><rotate x='1' angle='90'/></transform>";
    let both = "<bsdf type='twosided'><bsdf type='diffuse'/></bsdf>";
    let checks = "<bsdf type='diffuse'><texture type='checkerboard' name='reflectance'/></bsdf>";
    let lamp = "<emitter type='area'/>";
    for (parts, exact, outward) in [
        (vec![flip], false, false),
        (vec![mirror], false, false),
        (vec![mirror, flip], true, true),
        (vec![flip, both], true, true),
        (vec![flip, both, lamp], false, false),
        (vec![turn], true, true),
        (vec![turn, checks], false, true),
        (vec![checks], true, true),
    ] {
        let scene = scene(&format!("<shape type='sphere'>{}</shape>", parts.concat()));
        assert_eq!(matches!(scene.shapes[0].surface, ShapeSurface::Sphere(_)), exact, "{parts:?}");
        if !exact {
            let (n, _) = surface_at(&scene, 0, DVec3::new(0.3, 0.4, 0.866025), 2e-3);
            assert_eq!(n.z > 0.0, outward, "{parts:?}");
        }
    }
    // Turned about x by 90 degrees, (0.3, 0.4, 0.866) was (0.3, 0.866, -0.4): phi = atan2(0.866, 0.3), theta = acos(-0.4).
    let scene = scene(&format!("<shape type='sphere'>{turn}{checks}</shape>"));
    let uv = [0.866025_f32.atan2(0.3) / std::f32::consts::TAU, (-0.4_f32).acos() / std::f32::consts::PI];
    expect(&scene, 0, [0.3, 0.4, 0.866025], [0.3, 0.4, 0.866025], uv, 2e-3);
}

/// A group "g" of a rectangle and what else `members` says, and its instances by their operations.
fn instances(members: &str, operations: &[&str]) -> String {
    let group = format!("<shape type='shapegroup' id='g'><shape type='rectangle' id='r'/>{members}</shape>");
    let instance = |o: &&str| format!("<shape type='instance'><ref id='g'/><transform name='to_world'>{o}</transform></shape>");
    group + &operations.iter().map(instance).collect::<String>()
}

#[test]
fn instances_are_placed_after_their_group() {
    let operations = ["", "<scale z='-1'/>", "<scale x='-1'/>", "<scale value='2'/><rotate y='1' angle='90'/><translate x='7'/>"];
    let scene = scene(&instances("<shape type='sphere' id='s'><point name='center' x='3' y='0' z='0'/></shape>", &operations));
    let ids: Vec<_> = scene.shapes.iter().map(|s| s.id.as_str()).collect();
    assert_eq!(ids.len(), 8, "two shapes in each of four instances, and no group by itself: {ids:?}");
    assert!(ids[0].ends_with("/r") && ids[1].ends_with("/s"), "{ids:?}");
    // As Mitsuba says: normals follow the transform, so a mirroring in the plane of the rectangle leaves them alone.
    expect(&scene, 0, [0.3, 0.4, 0.0], [0.0, 0.0, 1.0], [0.65, 0.7], 1e-6);
    expect(&scene, 2, [0.3, 0.4, 0.0], [0.0, 0.0, -1.0], [0.65, 0.7], 1e-6);
    expect(&scene, 4, [0.3, 0.4, 0.0], [0.0, 0.0, 1.0], [0.35, 0.7], 1e-6);
    // (0.3, 0.4, 0) doubled, then +z turns to +x and +x to -z.
    expect(&scene, 6, [7.0, 0.8, -0.6], [1.0, 0.0, 0.0], [0.65, 0.7], 1e-6);
    let ShapeSurface::Sphere(sphere) = &scene.shapes[7].surface else { panic!("still exact") };
    assert!((sphere.center.as_dvec3() + scene.origin - DVec3::new(7.0, 0.0, -6.0)).length() < 1e-6 && sphere.radius == 2.0);
}

#[test]
fn far_instances_keep_their_digits() {
    let scene = scene(&instances("", &["<translate x='1000000'/>", "<translate x='1000001'/>"]));
    let left = |index: usize| corners(&scene, &scene.shapes[index])[0][0].0.x;
    assert_eq!(left(1) - left(0), 1.0);
}

#[test]
fn a_group_without_an_instance_is_not_seen() {
    let scene = scene(&instances("", &[]));
    assert!(scene.shapes.is_empty());
}

#[test]
fn triangles_of_instances_are_counted_before_they_are_made() {
    // Each in a place of its own: what repeats another triangle would be dropped.
    let places: Vec<String> = (0..100).map(|i| format!("<translate x='{}'/>", 3 * i)).collect();
    let places: Vec<&str> = places.iter().map(String::as_str).collect();
    let mut fixture = Fixture::new(&instances("<shape type='cube'/>", &places));
    fixture.options.limits.triangles = 1400;
    assert_eq!(fixture.scene().n_triangles(), 1400, "2 and 12 in each instance");
    fixture.options.limits.triangles = 1399;
    let error = fixture.load().expect_err("one too many");
    assert!(matches!(error.kind, LoadErrorKind::OverLimit { limit: 1399, found: 1400, .. }) && error.at.is_some(), "{error}");
}

#[test]
fn groups_hold_neither_groups_nor_emitters() {
    let nested = "<shape type='shapegroup' id='h'><shape type='instance'><ref id='g'/></shape></shape>";
    for (body, part) in [
        (instances("<shape type='cube'><emitter type='area'/></shape>", &[]), "an emitter inside a shapegroup"),
        (instances("<shape type='shapegroup'/>", &[]), "inside a shapegroup"),
        (instances("", &[]) + nested, "inside a shapegroup"),
        (instances("<shape type='instance'><ref id='g'/></shape>", &[""]), "inside a shapegroup"),
        ("<shape type='instance'/>".to_owned(), "needs a reference to a shapegroup"),
        ("<shape type='instance'><shape type='cube'/></shape>".to_owned(), "expected a shapegroup"),
        (instances("", &[]) + "<shape type='instance'><ref id='g'/><bsdf type='diffuse'/></shape>", "not supported"),
    ] {
        let error = Fixture::new(&body).load().expect_err("must be refused").to_string();
        assert!(error.contains(part), "{body}: {error}");
    }
}

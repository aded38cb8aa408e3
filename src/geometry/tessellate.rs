//! Analytic shapes as triangles, in f64, before the scene is recentred.

use crate::math::{DAffine3, DVec3, Vec2, Vec3};

/// Triangles in world coordinates, as a reader hands them over.
#[derive(Debug, Clone, Default)]
pub struct Triangles {
    /// Vertex positions in world coordinates.
    pub positions: Vec<DVec3>,
    /// Shading normals; empty: none.
    pub normals: Vec<Vec3>,
    /// Texture coordinates; empty: none.
    pub uvs: Vec<Vec2>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
}

impl Triangles {
    /// Reverses the winding, and with it the geometric normals.
    pub fn flip(&mut self) {
        self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
}

/// Normals transform by the inverse transpose; a mirroring `to_world` turns the cross product but not such a normal, so the
/// winding of an analytic shape is reversed to keep its normal.
fn keep_normal(mut shape: Triangles, to_world: &DAffine3) -> Triangles {
    if to_world.matrix3.determinant() < 0.0 {
        shape.flip();
    }
    shape
}

/// The square [-1, 1]² at z = 0 with normal +z and uv = (p + 1)/2.
pub fn rectangle(to_world: &DAffine3) -> Triangles {
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let shape = Triangles {
        positions: corners.map(|(x, y)| to_world.transform_point3(DVec3::new(x, y, 0.0))).to_vec(),
        normals: Vec::new(),
        uvs: corners.map(|(x, y)| Vec2::new((x as f32 + 1.0) / 2.0, (y as f32 + 1.0) / 2.0)).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    };
    keep_normal(shape, to_world)
}

/// The cube [-1, 1]³ with outward normals; each face has uv in the unit square, turned as in Mitsuba.
pub fn cube(to_world: &DAffine3) -> Triangles {
    // Of each face: outward normal, then the directions in which u and v grow.
    const FACES: [[DVec3; 3]; 6] = [
        [DVec3::X, DVec3::Y, DVec3::NEG_Z],
        [DVec3::NEG_X, DVec3::Y, DVec3::Z],
        [DVec3::Y, DVec3::NEG_X, DVec3::NEG_Z],
        [DVec3::NEG_Y, DVec3::Z, DVec3::X],
        [DVec3::Z, DVec3::Y, DVec3::X],
        [DVec3::NEG_Z, DVec3::NEG_Y, DVec3::X],
    ];
    let mut shape = Triangles::default();
    for [normal, along_u, along_v] in FACES {
        let base = shape.positions.len() as u32;
        for (u, v) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            shape.positions.push(to_world.transform_point3(normal + u * along_u + v * along_v));
            shape.uvs.push(Vec2::new((u as f32 + 1.0) / 2.0, (v as f32 + 1.0) / 2.0));
        }
        let outward = along_u.cross(along_v).dot(normal) > 0.0;
        let faces = if outward { [[0, 1, 2], [0, 2, 3]] } else { [[0, 2, 1], [0, 3, 2]] };
        shape.triangles.extend(faces.map(|t| t.map(|i: u32| base + i)));
    }
    keep_normal(shape, to_world)
}

/// The unit disk at z = 0 with normal +z as a fan of `sides` triangles.
///
/// The rim is moved out so that the polygon has the area of the circle; uv = (r, phi/2pi).
pub fn disk(to_world: &DAffine3, sides: u32) -> Triangles {
    let step = std::f64::consts::TAU / f64::from(sides);
    let radius = (step / step.sin()).sqrt();
    let mut shape = Triangles::default();
    for i in 0..sides {
        let base = shape.positions.len() as u32;
        let rim = |k: u32| {
            let (s, c) = (f64::from(k % sides) * step).sin_cos();
            to_world.transform_point3(DVec3::new(radius * c, radius * s, 0.0))
        };
        let phi = |k: f32| k / sides as f32;
        shape.positions.extend([to_world.transform_point3(DVec3::ZERO), rim(i), rim(i + 1)]);
        shape.uvs.extend([
            Vec2::new(0.0, phi(i as f32 + 0.5)),
            Vec2::new(1.0, phi(i as f32)),
            Vec2::new(1.0, phi(i as f32 + 1.0)),
        ]);
        shape.triangles.push([base, base + 1, base + 2]);
    }
    keep_normal(shape, to_world)
}

/// The mantle of a cylinder from `p0` to `p1` without caps, as a prism of `sides` rectangles with smooth outward normals.
///
/// Its radius is enlarged so that the prism has the area of the mantle before `to_world` is applied. uv = (phi/2pi, share of the
/// way from `p0` to `p1`); phi is measured in the frame that Mitsuba gives the axis (Duff et al. 2017, "Building an Orthonormal
/// Basis, Revisited"). No triangles if the ends coincide.
pub fn cylinder(to_world: &DAffine3, p0: DVec3, p1: DVec3, radius: f64, sides: u32) -> Triangles {
    let Some(axis) = (p1 - p0).try_normalize() else { return Triangles::default() };
    let (x, y) = axis.any_orthonormal_pair();
    let half_step = std::f64::consts::PI / f64::from(sides);
    let radius = radius * half_step / half_step.sin();
    let normal_to_world = to_world.matrix3.inverse().transpose();
    let mut shape = Triangles::default();
    for column in 0..=sides {
        let (s, c) = (2.0 * half_step * f64::from(column % sides)).sin_cos();
        let outward = x * c + y * s;
        for (v, end) in [(0.0, p0), (1.0, p1)] {
            shape.positions.push(to_world.transform_point3(end + radius * outward));
            shape.normals.push((normal_to_world * outward).normalize_or_zero().as_vec3());
            shape.uvs.push(Vec2::new(column as f32 / sides as f32, v));
        }
    }
    for a in (0..sides).map(|column| 2 * column) {
        shape.triangles.extend([[a, a + 2, a + 3], [a, a + 3, a + 1]]);
    }
    keep_normal(shape, to_world)
}

/// The unit sphere as `bands` rings of triangles with smooth normals, uv = (phi/2pi, theta/pi).
///
/// The radius is enlarged so that the polyhedron has the area 4 pi before `to_world` is applied.
pub fn sphere(to_world: &DAffine3, bands: u32) -> Triangles {
    let (rings, columns) = (bands, 2 * bands);
    let direction = |ring: u32, column: u32| {
        let (sin_theta, cos_theta) = (std::f64::consts::PI * f64::from(ring) / f64::from(rings)).sin_cos();
        let (sin_phi, cos_phi) = (std::f64::consts::TAU * f64::from(column % columns) / f64::from(columns)).sin_cos();
        DVec3::new(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta)
    };
    let mut shape = Triangles::default();
    let normal_to_world = to_world.matrix3.inverse().transpose();
    for ring in 0..=rings {
        for column in 0..=columns {
            let d = direction(ring, column);
            shape.positions.push(d);
            shape.normals.push((normal_to_world * d).normalize_or_zero().as_vec3());
            shape.uvs.push(Vec2::new(column as f32 / columns as f32, ring as f32 / rings as f32));
        }
    }
    for ring in 0..rings {
        for column in 0..columns {
            let a = ring * (columns + 1) + column;
            let b = a + columns + 1;
            // At the poles one of the two triangles of a cell has no area.
            shape.triangles.extend((ring + 1 < rings).then_some([a + 1, b, b + 1]));
            shape.triangles.extend((ring > 0).then_some([a, b, a + 1]));
        }
    }
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| shape.positions[i as usize]);
        0.5 * (b - a).cross(c - a).length()
    };
    let radius = (4.0 * std::f64::consts::PI / shape.triangles.iter().map(area).sum::<f64>()).sqrt();
    shape.positions.iter_mut().for_each(|p| *p = to_world.transform_point3(radius * *p));
    keep_normal(shape, to_world)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area_vectors(t: &Triangles) -> Vec<DVec3> {
        let area = |[a, b, c]: &[u32; 3]| {
            let p = |i: &u32| t.positions[*i as usize];
            0.5 * (p(b) - p(a)).cross(p(c) - p(a))
        };
        t.triangles.iter().map(area).collect()
    }

    #[test]
    fn shapes_have_their_areas_and_normals_also_when_mirrored() {
        for mirror in [1.0, -1.0] {
            let m = DAffine3::from_scale(DVec3::new(mirror, 1.0, 1.0));
            let up: DVec3 = area_vectors(&rectangle(&m)).into_iter().sum();
            assert!((up - DVec3::Z * 4.0).length() < 1e-12, "rectangle {up}");
            let up: DVec3 = area_vectors(&disk(&m, 64)).into_iter().sum();
            assert!((up - DVec3::Z * std::f64::consts::PI).length() < 1e-12, "disk {up}");
            let c = cube(&m);
            let outward = c.triangles.iter().zip(area_vectors(&c)).all(|(t, a)| c.positions[t[0] as usize].dot(a) > 0.0);
            assert!(outward, "a cube face points inward (mirror {mirror})");
            let s = sphere(&m, 8);
            let areas = area_vectors(&s);
            let total: f64 = areas.iter().map(|a| a.length()).sum();
            assert!((total - 4.0 * std::f64::consts::PI).abs() < 1e-12, "sphere area {total}");
            let outward = s.triangles.iter().zip(&areas).all(|(t, a)| s.normals[t[0] as usize].as_dvec3().dot(*a) > 0.0);
            assert!(outward, "a sphere face points inward (mirror {mirror})");
            let c = cylinder(&m, DVec3::new(0.0, 0.0, -1.0), DVec3::new(1.0, 2.0, 1.0), 0.5, 16);
            let areas = area_vectors(&c);
            let total: f64 = areas.iter().map(|a| a.length()).sum();
            assert!((total - std::f64::consts::TAU * 0.5 * 3.0).abs() < 1e-12, "cylinder area {total}");
            let outward = c.triangles.iter().zip(&areas).all(|(t, a)| c.normals[t[0] as usize].as_dvec3().dot(*a) > 0.0);
            assert!(outward, "a cylinder face points inward (mirror {mirror})");
        }
    }
}

//! What is known of each patch once the elements exist: sides, areas, normals, reflectance.

use super::{PatchId, PatchMesh};
use crate::material::Texture;
use crate::math::{CompensatedSum, Rgb, Sampler, Vec2, Vec3};
use crate::world::{All, World};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Points at which a textured reflectance is read to average it over a patch.
const TEXTURE_POINTS: u64 = 64;

struct Measured {
    area: f64,
    shares: Vec<f32>,
    centroid: Vec3,
    normal: Vec3,
    shape: usize,
    rho: Rgb,
    emission: Rgb,
}

impl PatchMesh {
    /// Fills the arrays and gives each element a patch for every side that reflects or emits.
    pub(super) fn measure(&mut self, world: &World) {
        let measured: Vec<Measured> = (0..self.elements.len()).into_par_iter().map(|e| self.measure_element(world, e)).collect();
        self.piece_share = vec![1.0; self.pieces.len()];
        for (e, m) in measured.into_iter().enumerate() {
            let start = self.elements[e].pieces.start as usize;
            self.piece_share[start..start + m.shares.len()].copy_from_slice(&m.shares);
            if m.area <= 0.0 {
                continue;
            }
            let shape = &world.scene().shapes[m.shape];
            let surface = world.scene().material_of(shape);
            self.elements[e].front = Some(self.add_patch(e, true, &m, m.rho, m.emission * PI));
            if surface.two_sided && surface.material.has_diffuse() || surface.material.has_diffuse_below() {
                self.elements[e].back = Some(self.add_patch(e, false, &m, m.rho, Rgb::BLACK));
            }
        }
    }

    /// Reflectances and emission anew, of patches that were made for the same shapes under other paint or light.
    pub fn measure_light(&mut self, world: &World) {
        let measured: Vec<(Rgb, Rgb)> = (0..self.len())
            .into_par_iter()
            .map(|i| {
                let m = self.measure_element(world, self.element_of[i] as usize);
                (m.rho, if self.side[i] { m.emission * PI } else { Rgb::BLACK })
            })
            .collect();
        (self.rho, self.exitance) = measured.into_iter().unzip();
    }

    fn add_patch(&mut self, element: usize, front: bool, m: &Measured, rho: Rgb, exitance: Rgb) -> PatchId {
        let id = PatchId(self.area.len() as u32);
        self.area.push(m.area);
        self.centroid.push(m.centroid);
        self.normal.push(if front { m.normal } else { -m.normal });
        self.rho.push(rho);
        self.exitance.push(exitance);
        self.element_of.push(element as u32);
        self.side.push(front);
        id
    }

    fn measure_element(&self, world: &World, element: usize) -> Measured {
        let range = self.elements[element].pieces.clone();
        let (mut area, mut running) = (CompensatedSum::default(), Vec::with_capacity(range.len()));
        let (mut centroid, mut normal) = (glam::DVec3::ZERO, glam::DVec3::ZERO);
        let mut shape = 0;
        for piece in range.start as usize..range.end as usize {
            let a = self.piece_area(world, piece);
            area.add(a);
            running.push(area.value());
            let middle = self.on_piece::<All>(world, piece, Vec2::new(2.0 / 3.0, 2.0 / 3.0), true);
            centroid += middle.point.as_dvec3() * a;
            normal += middle.ng.as_dvec3() * a;
            shape = middle.shape as usize;
        }
        let total = area.value();
        let shares: Vec<f32> = running.iter().map(|r| if total > 0.0 { (r / total) as f32 } else { 1.0 }).collect();
        let mut measured = Measured {
            area: total,
            shares,
            centroid: if total > 0.0 { (centroid / total).as_vec3() } else { Vec3::ZERO },
            normal: normal.normalize_or_zero().as_vec3(),
            shape,
            rho: Rgb::BLACK,
            emission: Rgb::BLACK,
        };
        let shape = &world.scene().shapes[shape];
        let material = &world.scene().material_of(shape).material;
        (measured.rho, measured.emission) = match (material.uniform_diffuse_reflectance(), &shape.emission) {
            (Some(rho), Texture::Constant(radiance)) => (rho, *radiance),
            _ => self.textured_means(world, element, &measured, |uv| (material.diffuse_reflectance(uv), shape.emitted(uv))),
        };
        measured
    }

    /// Means of a reflectance and a radiance over an element, in linear light.
    fn textured_means(&self, world: &World, element: usize, m: &Measured, at: impl Fn(Vec2) -> (Rgb, Rgb)) -> (Rgb, Rgb) {
        let start = self.elements[element].pieces.start as usize;
        let (mut rho, mut emission) = (Rgb::BLACK, Rgb::BLACK);
        for i in 0..TEXTURE_POINTS {
            let mut u = Sampler::new(0, element as u64, i).next_2d();
            let k = m.shares.partition_point(|&s| s <= u.x).min(m.shares.len() - 1);
            let before = if k == 0 { 0.0 } else { m.shares[k - 1] };
            u.x = ((u.x - before) / (m.shares[k] - before)).clamp(0.0, 1.0 - f32::EPSILON);
            let values = at(self.on_piece::<All>(world, start + k, u, true).uv);
            rho += values.0;
            emission += values.1;
        }
        (rho / TEXTURE_POINTS as f64, emission / TEXTURE_POINTS as f64)
    }
}

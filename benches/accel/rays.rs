//! Four kinds of rays of a global-illumination renderer.

use std::f32::consts::PI;

use twopass::accel::{AccelKind, build};
use twopass::geometry::{Ray, Soup, offset_origin, triangle};
use twopass::math::{Frame, Sampler, Vec3};

/// The rays of one scene.
pub struct RaySets {
    primary: Vec<Ray>,
    secondary: Vec<Ray>,
    shadow: Vec<Ray>,
    patch: Vec<Ray>,
}

impl RaySets {
    /// About `side * side` rays of each kind; `side` is a power of two.
    ///
    /// The camera looks into the scene's box from within; the light is a square under its ceiling.
    pub fn new(soup: &std::sync::Arc<Soup>, side: u32) -> Self {
        let bounds = soup.bounds();
        let (low, size) = (bounds.min, bounds.max - bounds.min);
        let engine = build(soup.clone(), AccelKind::Obvhs).expect("always there");
        let eye = low + size * Vec3::new(0.5, 0.45, 0.04);
        let primary: Vec<Ray> = (0..side * side)
            .map(|code| {
                let (x, y) = (even_bits(code) as f32 + 0.5, even_bits(code >> 1) as f32 + 0.5);
                let film = Vec3::new(2.0 * x / side as f32 - 1.0, 1.0 - 2.0 * y / side as f32, 1.5);
                Ray::new(eye, (film * Vec3::new(size.x, size.x, size.x.max(1e-6))).normalize())
            })
            .collect();
        let (mut secondary, mut shadow) = (Vec::new(), Vec::new());
        for (index, ray) in primary.iter().enumerate() {
            let Some(hit) = engine.intersect(ray) else { continue };
            let [a, b, c] = soup.corners(hit.primitive as usize);
            let normal = triangle::normal(a, b, c);
            let normal = if normal.dot(ray.direction) > 0.0 { -normal } else { normal };
            let point = offset_origin(ray.at(hit.t), size * 1e-6, normal, normal);
            let mut sampler = Sampler::new(1, index as u64, 0);
            secondary.push(Ray::new(point, cosine(normal, &mut sampler)));
            let light = low + size * Vec3::new(0.35 + 0.3 * sampler.next_1d(), 0.98, 0.35 + 0.3 * sampler.next_1d());
            shadow.push(Ray::between(point, light));
        }
        Self { primary, secondary, shadow, patch: patch_rays(soup, side * side) }
    }

    /// Name, rays, and whether any hit is asked for.
    pub fn each(&self) -> impl Iterator<Item = (&'static str, &[Ray], bool)> {
        [
            ("primary", self.primary.as_slice(), false),
            ("secondary", self.secondary.as_slice(), false),
            ("shadow", self.shadow.as_slice(), true),
            ("patch", self.patch.as_slice(), true),
        ]
        .into_iter()
    }
}

/// The even bits of a Morton code.
fn even_bits(code: u32) -> u32 {
    (0..16).fold(0, |value, bit| value | (code >> (2 * bit) & 1) << bit)
}

fn cosine(normal: Vec3, sampler: &mut Sampler) -> Vec3 {
    let (u, v) = (sampler.next_1d(), sampler.next_1d());
    let (r, phi) = (u.sqrt(), 2.0 * PI * v);
    Frame::new(normal).to_world(Vec3::new(r * phi.cos(), r * phi.sin(), (1.0 - u).max(0.0).sqrt()))
}

/// Rays between random points of random triangles, by area; 64 partners for each source triangle.
fn patch_rays(soup: &Soup, n_rays: u32) -> Vec<Ray> {
    let areas = (0..soup.triangles.len()).scan(0.0, |sum, i| {
        let [a, b, c] = soup.corners(i);
        *sum += triangle::area_vector(a, b, c).length();
        Some(*sum)
    });
    let sums: Vec<f64> = areas.collect();
    let total = *sums.last().expect("a scene has triangles");
    let pick = |sampler: &mut Sampler| {
        let index = sums.partition_point(|&s| s < f64::from(sampler.next_1d()) * total);
        index.min(sums.len() - 1)
    };
    let point = |index: usize, sampler: &mut Sampler| {
        let [a, b, c] = soup.corners(index);
        let (r, v) = (sampler.next_1d().sqrt(), sampler.next_1d());
        a * (1.0 - r) + b * (r * (1.0 - v)) + c * (r * v)
    };
    (0..n_rays)
        .map(|index| {
            let mut of_source = Sampler::new(2, u64::from(index / 64), 0);
            let source = pick(&mut of_source);
            let mut sampler = Sampler::new(3, u64::from(index), 0);
            let target = pick(&mut sampler);
            let (from, to) = (point(source, &mut sampler), point(target, &mut sampler));
            let direction = to - from;
            // The ends stay off both surfaces.
            Ray { t_min: 1e-4, t_max: 1.0 - 1e-4, ..Ray::new(from, direction) }
        })
        .collect()
}

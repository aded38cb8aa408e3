//! Eight-wide tree over obvhs' binary one, with triangles packed by up to sixteen corners.
//!
//! One traversal ([`kernel`]) serves three sets of vector operations: AVX-512 or AVX2, chosen at run time where the processor has
//! them, and portable arrays. All do the same f32 operations in the same order, so they give the same bits. No fused multiply-add is used:
//! it would break the triangle test's consistency between neighbours, and the box test's `(plane - origin) * inverse` keeps its
//! relative accuracy far from the origin, which the fused form `plane * inverse - origin * inverse` does not.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "x86_64")]
mod batch;
mod collapse;
mod kernel;
mod layout;
#[cfg(target_arch = "x86_64")]
mod packet;
mod portable;

use std::sync::Arc;

use super::bvh::Draft;
use super::query::Query;
use super::{Accel, Hit, KnownOccluders, Ray, Soup};
use layout::{Child, Node, Packet};

/// Deepest wide tree that is traversed; a deeper one is built anew over a balanced binary tree.
const MAX_DEPTH: usize = 32;

/// The default engine.
pub struct Wide {
    soup: Arc<Soup>,
    nodes: Vec<Node>,
    packets: Vec<Packet>,
    operations: Operations,
}

/// Vector operations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Operations {
    Portable,
    Avx2,
    Avx512,
}

impl Wide {
    /// Builds the tree and chooses the vector operations.
    pub fn new(soup: Arc<Soup>) -> Self {
        let collapsed = collapse::collapse(&Draft::build(&soup), &soup);
        let collapsed =
            if collapsed.depth > MAX_DEPTH { collapse::collapse(&Draft::build_balanced(&soup), &soup) } else { collapsed };
        Self { soup, nodes: collapsed.nodes, packets: collapsed.packets, operations: best_operations() }
    }

    /// The same engine by these operations, if the processor has them.
    #[cfg(test)]
    fn by(self, operations: Operations) -> Option<Self> {
        let has = match operations {
            Operations::Portable => true,
            Operations::Avx2 => self.operations != Operations::Portable,
            Operations::Avx512 => self.operations == Operations::Avx512,
        };
        has.then_some(Self { operations, ..self })
    }
}

#[cfg(target_arch = "x86_64")]
fn best_operations() -> Operations {
    if avx512::is_supported() {
        Operations::Avx512
    } else if avx2::is_supported() {
        Operations::Avx2
    } else {
        Operations::Portable
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn best_operations() -> Operations {
    Operations::Portable
}

impl Accel for Wide {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        match self.operations {
            #[cfg(target_arch = "x86_64")]
            Operations::Avx512 => avx512::nearest(self, ray),
            #[cfg(target_arch = "x86_64")]
            Operations::Avx2 => avx2::nearest(self, ray),
            _ => kernel::traverse::<portable::Portable, false>(self, &Query::new(ray)?, Child::ROOT, None),
        }
    }

    fn occluded(&self, ray: &Ray) -> bool {
        match self.operations {
            #[cfg(target_arch = "x86_64")]
            Operations::Avx512 => avx512::any(self, ray),
            #[cfg(target_arch = "x86_64")]
            Operations::Avx2 => avx2::any(self, ray),
            _ => Query::new(ray)
                .is_some_and(|query| kernel::traverse::<portable::Portable, true>(self, &query, Child::ROOT, None).is_some()),
        }
    }

    fn occluded_as_known(&self, ray: &Ray, known: &mut KnownOccluders) -> bool {
        match self.operations {
            #[cfg(target_arch = "x86_64")]
            Operations::Avx512 => avx512::any_as_known(self, ray, known),
            #[cfg(target_arch = "x86_64")]
            Operations::Avx2 => avx2::any_as_known(self, ray, known),
            _ => Query::new(ray).is_some_and(|query| kernel::is_hidden::<portable::Portable>(self, &query, known)),
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn intersect_batch(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), hits.len(), "one hit for each ray");
        if self.operations != Operations::Portable {
            batch::nearest(self, rays, hits);
        } else {
            rays.iter().zip(hits).for_each(|(ray, hit)| *hit = self.intersect(ray));
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn occluded_batch(&self, rays: &[Ray], occluded: &mut [bool]) {
        assert_eq!(rays.len(), occluded.len(), "one answer for each ray");
        if self.operations != Operations::Portable {
            batch::any(self, rays, occluded);
        } else {
            rays.iter().zip(occluded).for_each(|(ray, answer)| *answer = self.occluded(ray));
        }
    }

    fn memory_bytes(&self) -> usize {
        std::mem::size_of_val(self.nodes.as_slice()) + std::mem::size_of_val(self.packets.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Sphere;
    use crate::math::{Sampler, Vec3};

    const ALL: [Operations; 3] = [Operations::Portable, Operations::Avx2, Operations::Avx512];

    fn point(sampler: &mut Sampler) -> Vec3 {
        Vec3::new(sampler.next_1d(), sampler.next_1d(), sampler.next_1d())
    }

    /// Triangles and spheres of all sizes, some sharing edges.
    fn mixture(n: u32) -> Soup {
        let mut soup = Soup::default();
        for i in 0..n {
            let mut s = Sampler::new(7, u64::from(i), 0);
            let (p, size) = (point(&mut s), s.next_1d().powi(3));
            soup.vertices.extend([p, p + size * (point(&mut s) - 0.5), p + size * (point(&mut s) - 0.5)]);
            soup.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
            soup.triangles.push([3 * i, 3 * i + 2, (3 * i + 3) % (3 * n)]);
            if i % 5 == 0 {
                soup.spheres.push(Sphere { center: point(&mut s), radius: 0.001 + 0.05 * s.next_1d() });
            }
        }
        soup
    }

    #[test]
    fn all_vector_operations_give_the_same_bits_as_the_binary_tree() {
        // The largest is collapsed in parts.
        let sizes: &[u32] = if cfg!(miri) { &[0, 1, 2, 5, 33] } else { &[0, 1, 2, 5, 33, 500, 33_000] };
        for &n in sizes {
            let soup = Arc::new(mixture(n));
            let engines: Vec<Wide> = ALL.into_iter().filter_map(|operations| Wide::new(soup.clone()).by(operations)).collect();
            let binary = crate::accel::binary::Binary::new(soup);
            let mut known = vec![KnownOccluders::default(); engines.len()];
            for i in 0..if cfg!(miri) { 20 } else { 20_000 } {
                let mut s = Sampler::new(8, i, 0);
                let (origin, direction) = (2.0 * point(&mut s) - 0.5, point(&mut s) - 0.5);
                let ray = Ray { t_max: 4.0 * s.next_1d(), ..Ray::new(origin, direction) };
                let hit = binary.intersect(&ray);
                for engine in &engines {
                    assert_eq!(engine.intersect(&ray), hit, "{:?}, {n}: {ray:?}", engine.operations);
                    assert_eq!(engine.occluded(&ray), hit.is_some(), "{:?}, {n}: {ray:?}", engine.operations);
                }
                // Of all that the rays before have met.
                for (engine, known) in engines.iter().zip(&mut known) {
                    assert_eq!(engine.occluded_as_known(&ray, known), hit.is_some(), "{:?}, {n}: {ray:?}", engine.operations);
                }
                let Some(hit) = hit else { continue };
                let (ends_there, ends_behind) = (Ray { t_max: hit.t, ..ray }, Ray { t_max: hit.t.next_up(), ..ray });
                for engine in &engines {
                    assert_eq!(engine.intersect(&ends_there), None, "the far end is open, {n}: {ray:?}");
                    assert_eq!(engine.intersect(&ends_behind), Some(hit), "{n}: {ray:?}");
                }
            }
        }
    }

    #[test]
    fn a_batch_gives_the_same_bits_as_its_rays_one_by_one() {
        let cases = [(0, 0.1), (1, 0.1), (5, 0.5), (33, 2.0), (500, 0.02), (500, 0.2), (500, 2.0)];
        for (n, spread) in cases.into_iter().filter(|case| !cfg!(miri) || case.0 < 33) {
            let mut soup = mixture(n);
            // Everything twice, so that each hit has a tie.
            soup.triangles.extend_from_within(..);
            soup.spheres.extend_from_within(..);
            let soup = Arc::new(soup);
            let engine = Wide::new(soup.clone());
            let engines: Vec<Wide> = ALL.into_iter().filter_map(|operations| Wide::new(soup.clone()).by(operations)).collect();
            for n_rays in [0, 1, 2, 7, 8, 9, 31, 32, 33, 255, 256, 257, 5000].into_iter().filter(|&n| !cfg!(miri) || n < 10) {
                let mut axis = Sampler::new(9, n_rays, 0);
                let (from, towards) = (2.0 * point(&mut axis) - 0.5, point(&mut axis) - 0.5);
                let ray = |i: u64| {
                    let mut s = Sampler::new(10, i, 0);
                    let (origin, direction) = (from + 0.1 * point(&mut s), towards + spread * (point(&mut s) - 0.5));
                    let t_max = if i.is_multiple_of(11) { f32::NAN } else { 4.0 * s.next_1d() };
                    Ray { t_max, ..Ray::new(origin, direction) }
                };
                let rays: Vec<Ray> = (0..n_rays).map(ray).collect();
                let expected: Vec<Option<Hit>> = rays.iter().map(|ray| engine.intersect(ray)).collect();
                for batches in &engines {
                    let (mut hits, mut occluded) = (vec![None; rays.len()], vec![true; rays.len()]);
                    batches.intersect_batch(&rays, &mut hits);
                    batches.occluded_batch(&rays, &mut occluded);
                    for (((ray, hit), occluded), &expected) in rays.iter().zip(hits).zip(occluded).zip(&expected) {
                        let which = batches.operations;
                        let found = (hit, occluded);
                        assert_eq!(found, (expected, expected.is_some()), "{which:?}, {n} triangles, spread {spread}: {ray:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_finely_cut_wall_shares_its_corners() {
        // Of k by k squares each corner belongs to six triangles: packets should be at least half full, of 320 bytes each, and the
        // nodes of 256 bytes on top have seven children on the average or more: 320 / 8 * (1 + 256 / 320 / 6) bytes a triangle.
        let k = if cfg!(miri) { 12_u32 } else { 60 };
        let mut soup = Soup::default();
        soup.vertices.extend((0..=k).flat_map(|i| (0..=k).map(move |j| Vec3::new(i as f32, 0.0, j as f32))));
        for (i, j) in (0..k).flat_map(|i| (0..k).map(move |j| (i, j))) {
            let at = |di: u32, dj: u32| (i + di) * (k + 1) + j + dj;
            soup.triangles.extend([[at(0, 0), at(1, 0), at(1, 1)], [at(0, 0), at(1, 1), at(0, 1)]]);
        }
        let n_triangles = soup.triangles.len();
        let bytes = Wide::new(Arc::new(soup)).memory_bytes() as f64 / n_triangles as f64;
        assert!(bytes <= 40.0 * (1.0 + 256.0 / 320.0 / 6.0), "{bytes} bytes a triangle");
    }

    #[test]
    fn a_tree_deeper_than_the_stack_is_balanced_anew() {
        // Boxes nested in each other, each twice the size of the one before: clustering makes a chain.
        let mut soup = Soup::default();
        for i in 0..110 {
            let size = 2.0_f32.powi(i - 80);
            let base = soup.vertices.len() as u32;
            soup.vertices.extend([Vec3::ZERO, Vec3::new(size, 0.0, size), Vec3::new(0.0, size, size)]);
            soup.triangles.push([base, base + 1, base + 2]);
        }
        let soup = Arc::new(soup);
        let engine = Wide::new(soup.clone());
        let ray = Ray::new(Vec3::new(2e-8, 2e-8, 1.0), -Vec3::Z);
        assert_eq!(engine.intersect(&ray), crate::accel::binary::Binary::new(soup.clone()).intersect(&ray));
        assert!(engine.intersect(&ray).is_some());
        let balanced = collapse::collapse(&Draft::build_balanced(&soup), &soup);
        assert!(balanced.depth <= 4, "{}", balanced.depth);
    }
}

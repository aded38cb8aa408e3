//! Every engine behind the same two closures; conversion of rays is inside the measured time.

use std::sync::Arc;
use std::time::Duration;

use obvhs::BvhBuildParams;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::RayHit;
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;
use twopass::accel::{AccelKind, build};
use twopass::geometry::{Hit, Ray, Soup};

/// Sums over the answers keep the compiler from dropping the work.
type Query = Box<dyn Fn(&[Ray]) -> u64>;

/// What is measured.
pub struct Engine {
    pub name: String,
    pub memory: usize,
    pub intersect: Query,
    pub occluded: Query,
}

fn count(hit: Option<Hit>) -> u64 {
    hit.map_or(0, |h| u64::from(h.primitive) + 1)
}

/// An engine of the crate, one ray at a time.
pub fn of_kind(soup: &Arc<Soup>, kind: AccelKind) -> Engine {
    let engine: Arc<dyn twopass::accel::Accel> = Arc::from(build(soup.clone(), kind).expect("engine is in this build"));
    let other = engine.clone();
    Engine {
        name: kind.to_string(),
        memory: engine.memory_bytes(),
        intersect: Box::new(move |rays| rays.iter().map(|r| count(engine.intersect(r))).sum()),
        occluded: Box::new(move |rays| rays.iter().map(|r| u64::from(other.occluded(r))).sum()),
    }
}

/// Rays one at a time.
pub fn single_engines(soup: &Arc<Soup>) -> Vec<Engine> {
    let mut engines = Vec::new();
    #[cfg(feature = "embree")]
    {
        engines.push(Engine { name: "embree robust".into(), ..of_kind(soup, AccelKind::Embree) });
        engines.push(embree::fast(soup));
    }
    engines.push(of_kind(soup, AccelKind::Obvhs));
    // What obvhs itself offers: its medium preset, and the same without the search limit that spoils flat walls.
    let medium = BvhBuildParams::medium_build();
    let safe = BvhBuildParams { search_depth_threshold: 0, ..medium };
    engines.push(obvhs_bvh2("obvhs bvh2 medium", soup, medium));
    engines.push(obvhs_bvh2("obvhs bvh2 medium, safe", soup, safe));
    engines.push(obvhs_cwbvh("obvhs cwbvh medium", soup, medium));
    engines.push(obvhs_cwbvh("obvhs cwbvh medium, safe", soup, safe));
    engines
}

/// Rays in batches.
#[cfg_attr(not(feature = "embree"), expect(clippy::vec_init_then_push, reason = "with Embree others come first"))]
pub fn batch_engines(soup: &Arc<Soup>) -> Vec<Engine> {
    let mut engines = Vec::new();
    #[cfg(feature = "embree")]
    engines.extend(embree::batches(soup));
    engines.push(Engine { name: "obvhs, single".into(), ..of_kind(soup, AccelKind::Obvhs) });
    engines.push(batched("obvhs, batch", soup, AccelKind::Obvhs));
    engines
}

/// Rays in a batch: a camera tile of 64 by 64.
const BATCH: usize = 4096;

fn batched(name: &str, soup: &Arc<Soup>, kind: AccelKind) -> Engine {
    let engine: Arc<dyn twopass::accel::Accel> = Arc::from(build(soup.clone(), kind).expect("engine is in this build"));
    let other = engine.clone();
    Engine {
        name: name.into(),
        memory: engine.memory_bytes(),
        intersect: Box::new(move |rays| {
            let mut hits = vec![None; BATCH];
            rays.chunks(BATCH)
                .map(|rays| {
                    engine.intersect_batch(rays, &mut hits[..rays.len()]);
                    hits[..rays.len()].iter().map(|&h| count(h)).sum::<u64>()
                })
                .sum()
        }),
        occluded: Box::new(move |rays| {
            let mut answers = vec![false; BATCH];
            rays.chunks(BATCH)
                .map(|rays| {
                    other.occluded_batch(rays, &mut answers[..rays.len()]);
                    answers[..rays.len()].iter().map(|&a| u64::from(a)).sum::<u64>()
                })
                .sum()
        }),
    }
}

fn obvhs_triangles(soup: &Soup) -> Vec<Triangle> {
    (0..soup.triangles.len())
        .map(|i| {
            let [v0, v1, v2] = soup.corners(i).map(Into::into);
            Triangle { v0, v1, v2 }
        })
        .collect()
}

fn to_obvhs(ray: &Ray) -> obvhs::ray::Ray {
    obvhs::ray::Ray::new(ray.origin.into(), ray.direction.into(), ray.t_min, ray.t_max)
}

fn packed(triangles: &[Triangle], order: &[u32]) -> Arc<Vec<RtTriangle>> {
    Arc::new(order.iter().map(|&i| RtTriangle::from(&triangles[i as usize])).collect())
}

macro_rules! obvhs_engine {
    ($function:ident, $build:path) => {
        fn $function(name: &str, soup: &Arc<Soup>, params: BvhBuildParams) -> Engine {
            let triangles = obvhs_triangles(soup);
            let tree = Arc::new($build(&triangles, params, &mut Duration::default()));
            let packed = packed(&triangles, &tree.primitive_indices);
            let (tree_2, packed_2) = (tree.clone(), packed.clone());
            let memory = size_of_val(tree.nodes.as_slice()) + size_of_val(packed.as_slice());
            Engine {
                name: name.into(),
                memory,
                intersect: Box::new(move |rays| {
                    let one = |ray: &Ray| {
                        let mut hit = RayHit::none();
                        let met = tree.ray_traverse(to_obvhs(ray), &mut hit, |r, i| packed[i].intersect(r));
                        if met { u64::from(hit.primitive_id) + 1 } else { 0 }
                    };
                    rays.iter().map(one).sum()
                }),
                occluded: Box::new(move |rays| {
                    let one = |ray: &Ray| tree_2.ray_traverse_miss(to_obvhs(ray), |r, i| packed_2[i].intersect(r));
                    rays.iter().map(|r| u64::from(!one(r))).sum()
                }),
            }
        }
    };
}

obvhs_engine!(obvhs_bvh2, build_bvh2_from_tris);
obvhs_engine!(obvhs_cwbvh, build_cwbvh_from_tris);

#[cfg(feature = "embree")]
mod embree {
    use super::*;
    use twopass::accel::Accel;
    use twopass::accel::embree::{BatchForm, Embree, Mode};

    pub fn fast(soup: &Arc<Soup>) -> Engine {
        let engine = Arc::new(Embree::new(soup.clone(), Mode::Fast).expect("Embree builds"));
        let other = engine.clone();
        Engine {
            name: "embree, not robust".into(),
            memory: engine.memory_bytes(),
            intersect: Box::new(move |rays| rays.iter().map(|r| count(engine.intersect(r))).sum()),
            occluded: Box::new(move |rays| rays.iter().map(|r| u64::from(other.occluded(r))).sum()),
        }
    }

    pub fn batches(soup: &Arc<Soup>) -> Vec<Engine> {
        let engine = Arc::new(Embree::new(soup.clone(), Mode::Robust).expect("Embree builds"));
        let forms = [
            ("embree x16 coherent", BatchForm::Packets, true),
            ("embree x16 incoherent", BatchForm::Packets, false),
            ("embree stream coherent", BatchForm::Stream, true),
            ("embree stream incoherent", BatchForm::Stream, false),
        ];
        forms
            .map(|(name, form, coherent)| {
                let (engine, other) = (engine.clone(), engine.clone());
                Engine {
                    name: name.into(),
                    memory: engine.memory_bytes(),
                    intersect: Box::new(move |rays| {
                        let mut hits = vec![None; BATCH];
                        rays.chunks(BATCH)
                            .map(|rays| {
                                engine.intersect_batch_as(rays, &mut hits[..rays.len()], form, coherent);
                                hits[..rays.len()].iter().map(|&h| count(h)).sum::<u64>()
                            })
                            .sum()
                    }),
                    occluded: Box::new(move |rays| {
                        let mut answers = vec![false; BATCH];
                        rays.chunks(BATCH)
                            .map(|rays| {
                                other.occluded_batch_as(rays, &mut answers[..rays.len()], form, coherent);
                                answers[..rays.len()].iter().map(|&a| u64::from(a)).sum::<u64>()
                            })
                            .sum()
                    }),
                }
            })
            .into()
    }
}

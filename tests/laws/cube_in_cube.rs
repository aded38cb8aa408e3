//! A cube in a cube, 654 squares: form factors with something in between, against values made without this program.
//!
//! `tests/data/cube_in_cube/make.py` made them and tells how. `benches/form_factors.rs` times the same pairs.

use std::collections::HashMap;
use twopass::accel::AccelKind;
use twopass::form_factor::blockers::Blockers;
use twopass::form_factor::pairs::{PairSettings, Row, Surface, transfers};
use twopass::form_factor::polygon::Polygon;
use twopass::geometry::tessellate;
use twopass::material::{Material, MaterialId, Surface as Paint, Texture};
use twopass::math::{DAffine3, DMat3, DVec2, DVec3, Rgb};
use twopass::progress::silent;
use twopass::scene::camera::FovAxis;
use twopass::scene::{Camera, FilmSettings, Scene, SceneSource, ShapeSource, SurfaceSource};
use twopass::world::World;

const TRANSFERS: &str = include_str!("../data/cube_in_cube/transfers.csv");

/// The scene of twelve squares that blockers come from, and the squares that they are cut into.
pub struct Cubes {
    world: World,
    /// Squares of the walls, 10 x 10 each, and of the faces of the inner cube, 3 x 3 each; by centre in units of 1/60 about the middle.
    pub squares: Vec<(Polygon, [i32; 3])>,
    exact: HashMap<[i32; 6], f64>,
}

/// How far form factors are off.
pub struct Errors {
    /// |1 - row sum|, the largest.
    pub row_sum: f64,
    /// Root of the sum of squared errors over that of squares, of all F_ij.
    pub frobenius: f64,
    /// Largest error of an A_i F_ij over what is exchanged with nothing between, and over itself where that is above a hundredth of it. Shares
    /// in the table are known to about 1e-5, which is a thousandth of such an entry.
    pub of_free: f64,
    pub of_entry: f64,
    /// Over itself where that is above a thousandth.
    pub of_small: f64,
    /// Largest F_ij, and ordered pairs above zero.
    pub largest: f64,
    pub pairs: usize,
}

impl Cubes {
    pub fn new() -> Self {
        let (o, x, y, z) = (DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z);
        let walls = [[o, y, z], [x, z, y], [o, z, x], [y, x, z], [o, x, y], [z, y, x]];
        let (mut shapes, mut squares) = (Vec::new(), Vec::new());
        for [c, e1, e2] in walls {
            for (corner, e1, e2, n) in [(c, e1, e2, 10), (DVec3::splat(0.25) + 0.5 * c, 0.5 * e2, 0.5 * e1, 3)] {
                let place = DAffine3 {
                    matrix3: DMat3::from_cols(0.5 * e1, 0.5 * e2, e1.cross(e2).normalize()),
                    translation: corner + 0.5 * (e1 + e2),
                };
                shapes.push(ShapeSource {
                    id: format!("wall{}", shapes.len()),
                    surface: SurfaceSource::Triangles(tessellate::rectangle(&place)),
                    material: MaterialId(0),
                    emission: Texture::Constant(Rgb::BLACK),
                });
                // In coordinates of the scene, whose origin is the middle.
                let at = |i: i32, j: i32| {
                    corner + e1 * (f64::from(i) / f64::from(n)) + e2 * (f64::from(j) / f64::from(n)) - DVec3::splat(0.5)
                };
                for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                    let square = Polygon::new(&[at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]).expect("an area");
                    let centre = (square.center() * 60.0).round().as_ivec3().to_array();
                    squares.push((square, centre));
                }
            }
        }
        let grey = Paint {
            name: "grey".to_owned(),
            material: Material::Diffuse { reflectance: Texture::Constant(Rgb::grey(0.5)) },
            two_sided: false,
            relief: None,
        };
        let camera = Camera {
            to_scene: DAffine3::from_translation(DVec3::splat(0.1)),
            tan_half_fov: 0.5,
            fov_axis: FovAxis::X,
            principal_point: DVec2::ZERO,
            near_clip: 1e-3,
            far_clip: 10.0,
        };
        let film = FilmSettings { width: 4, height: 4, sample_count: 1, max_depth: None };
        let source = SceneSource {
            name: "cube in cube".to_owned(),
            camera,
            film,
            shapes,
            materials: vec![grey],
            lights: Vec::new(),
            environment: None,
            warnings: Vec::new(),
        };
        let world = World::new(Scene::new(source).expect("a valid scene"), AccelKind::default()).expect("a world");
        assert!((world.scene().origin - DVec3::splat(0.5)).length() < 1e-12, "the origin is the middle");
        let row = |line: &str| {
            let fields: Vec<f64> = line.split(',').map(|f| f.parse().expect("a number")).collect();
            (std::array::from_fn(|k| fields[k] as i32), fields[6] * fields[7])
        };
        Self { world, squares, exact: TRANSFERS.lines().skip(1).map(row).collect() }
    }

    /// A_i F_ij as the table has it, 0 where it has none.
    fn exact(&self, i: usize, j: usize) -> f64 {
        let (a, b) = (self.squares[i].1, self.squares[j].1);
        let mut least = [i32::MAX; 6];
        for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            for signs in 0..8 {
                let image = |c: [i32; 3], k: usize| if signs >> k & 1 == 1 { -c[order[k]] } else { c[order[k]] };
                for (p, q) in [(a, b), (b, a)] {
                    least = least.min(std::array::from_fn(|k| if k < 3 { image(p, k) } else { image(q, k - 3) }));
                }
            }
        }
        self.exact.get(&least).copied().unwrap_or(0.0)
    }

    /// All exchanges by the analytic method.
    pub fn transfers(&self, tolerance: f64) -> Vec<Row> {
        let surfaces: Vec<Surface> = self.squares.iter().map(|(s, _)| Surface::of_facets(vec![s.clone()])).collect();
        let settings = PairSettings { tolerance, kernel_tolerance: 0.03 * tolerance, seed: 1 };
        transfers(&self.world, &Blockers::new(&self.world), &surfaces, &settings, &mut silent).expect("not stopped")
    }

    pub fn errors(&self, rows: &[Row]) -> Errors {
        let n = self.squares.len();
        let mut got = vec![0.0; n * n];
        for (i, row) in rows.iter().enumerate() {
            row.iter().for_each(|(j, t)| (got[i * n + *j as usize], got[*j as usize * n + i]) = (t.value, t.value));
        }
        let mut errors =
            Errors { row_sum: 0.0, frobenius: 0.0, of_free: 0.0, of_entry: 0.0, of_small: 0.0, largest: 0.0, pairs: 0 };
        let (mut off, mut norm) = (0.0, 0.0);
        for i in 0..n {
            let (mut sum, area) = (0.0, self.squares[i].0.area());
            for j in 0..n {
                let (found, want) = (got[i * n + j], self.exact(i, j));
                sum += found / area;
                off += ((found - want) / area).powi(2);
                norm += (want / area).powi(2);
                errors.largest = errors.largest.max(found / area);
                errors.pairs += usize::from(found > 0.0);
                if i < j && (found > 0.0 || want > 0.0) {
                    let free = self.squares[i].0.transfer(&self.squares[j].0, 1e-8);
                    errors.of_free = errors.of_free.max((found - want).abs() / free);
                    if want > 0.001 * free {
                        errors.of_small = errors.of_small.max((found / want - 1.0).abs());
                    }
                    if want > 0.01 * free {
                        errors.of_entry = errors.of_entry.max((found / want - 1.0).abs());
                    }
                }
            }
            errors.row_sum = errors.row_sum.max((sum - 1.0).abs());
        }
        errors.frobenius = f64::sqrt(off / norm);
        errors
    }
}

/// All 654 x 654 within 2e-4 in the Frobenius norm, rows within 1e-4 of one before anything is corrected, no form factor above one. No exchange is off
/// by more than the tolerance of what there is with nothing between, or four times that for small ones; nor by more than a hundredth of itself, if more
/// than a hundredth of it is visible.
#[test]
fn form_factors_past_a_cube_agree_with_a_million_segments_a_pair() {
    let cubes = Cubes::new();
    let Errors { row_sum, frobenius, of_entry, of_small, of_free, largest, .. } = cubes.errors(&cubes.transfers(1e-3));
    println!(
        "rows {row_sum:.2e}, Frobenius {frobenius:.2e}, entry {of_entry:.2e}, faint ones {of_small:.2e}, of the unobstructed {of_free:.2e}"
    );
    assert!(row_sum <= 1e-4, "a row sums to 1 but for {row_sum}");
    assert!(frobenius <= 2e-4, "{frobenius} in the Frobenius norm");
    assert!(of_free <= 4e-3, "an exchange is off by {of_free} of the unobstructed one");
    assert!(of_entry <= 1e-2, "an exchange is off by {of_entry} of itself");
    assert!(largest <= 1.0, "{largest}");
}

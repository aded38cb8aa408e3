//! Small scenes made in memory.

use twopass::geometry::tessellate;
use twopass::integrator::drive::{Budget, Clocks};
use twopass::material::{Material, MaterialId, Surface, Texture};
use twopass::math::{DAffine3, DVec2, DVec3, Rgb};
use twopass::pipeline::{RenderSettings, Rendered, render};
use twopass::progress::silent;
use twopass::run_report::process_cpu_seconds;
use twopass::scene::camera::FovAxis;
use twopass::scene::{Camera, FilmSettings, LightSource, Scene, SceneSource, ShapeSource, SurfaceSource};

/// A scene under construction.
pub struct Room {
    pub source: SceneSource,
}

impl Room {
    /// An empty scene whose camera stands at `eye` and looks at `target`, 90 degrees wide, with a square film of `size` pixels.
    pub fn new(eye: DVec3, target: DVec3, size: usize) -> Self {
        let forward = (target - eye).normalize();
        let up = if forward.y.abs() > 0.9 { DVec3::Z } else { DVec3::Y };
        let left = up.cross(forward).normalize();
        let matrix = glam::DMat3::from_cols(left, forward.cross(left), forward);
        let camera = Camera {
            to_scene: DAffine3 { matrix3: matrix, translation: eye },
            tan_half_fov: 45.0_f64.to_radians().tan(),
            fov_axis: FovAxis::X,
            principal_point: DVec2::ZERO,
            near_clip: 1e-4,
            far_clip: 1e7,
        };
        let film = FilmSettings { width: size, height: size, sample_count: 16, max_depth: None };
        let source = SceneSource {
            name: "test".to_owned(),
            camera,
            film,
            shapes: Vec::new(),
            materials: Vec::new(),
            lights: Vec::new(),
            environment: None,
            warnings: Vec::new(),
        };
        Room { source }
    }

    pub fn material(&mut self, material: Material, two_sided: bool) -> MaterialId {
        self.source.materials.push(Surface { name: "test".to_owned(), material, two_sided, relief: None });
        MaterialId(self.source.materials.len() as u32 - 1)
    }

    pub fn grey(&mut self, rho: f64) -> MaterialId {
        self.material(Material::Diffuse { reflectance: Texture::Constant(Rgb::grey(rho)) }, false)
    }

    pub fn mirror(&mut self, reflectance: f64) -> MaterialId {
        self.material(Material::Conductor { index: None, reflectance: Texture::grey(reflectance) }, true)
    }

    pub fn glass(&mut self, eta: f64) -> MaterialId {
        self.material(Material::Dielectric { eta, reflectance: Texture::grey(1.0), transmittance: Texture::grey(1.0) }, false)
    }

    pub fn add(&mut self, surface: SurfaceSource, material: MaterialId, emission: f64) {
        let id = format!("shape{}", self.source.shapes.len());
        self.source.shapes.push(ShapeSource { id, surface, material, emission: Texture::Constant(Rgb::grey(emission)) });
    }

    /// A quadrilateral by a corner and two edges; its normal is `e1 x e2`.
    pub fn quad(&mut self, corner: DVec3, e1: DVec3, e2: DVec3, material: MaterialId, emission: f64) {
        let matrix = glam::DMat3::from_cols(0.5 * e1, 0.5 * e2, e1.cross(e2).normalize());
        let to_world = DAffine3 { matrix3: matrix, translation: corner + 0.5 * e1 + 0.5 * e2 };
        self.add(SurfaceSource::Triangles(tessellate::rectangle(&to_world)), material, emission);
    }

    /// A convex polygon, its corners counter-clockwise as seen from its front.
    pub fn polygon(&mut self, corners: &[DVec3], material: MaterialId, emission: f64) {
        let triangles = (1..corners.len() as u32 - 1).map(|k| [0, k, k + 1]).collect();
        let shape = tessellate::Triangles { positions: corners.to_vec(), normals: Vec::new(), uvs: Vec::new(), triangles };
        self.add(SurfaceSource::Triangles(shape), material, emission);
    }

    /// The box between two corners, seen from inside; each wall its own shape in the order -x, +x, -y, +y, -z, +z.
    pub fn walls(&mut self, low: DVec3, high: DVec3, materials: [MaterialId; 6], emission: [f64; 6]) {
        let d = high - low;
        let (x, y, z) = (DVec3::X * d.x, DVec3::Y * d.y, DVec3::Z * d.z);
        let faces = [(low, y, z), (low + x, z, y), (low, z, x), (low + y, x, z), (low, x, y), (low + z, y, x)];
        for (i, (corner, e1, e2)) in faces.into_iter().enumerate() {
            self.quad(corner, e1, e2, materials[i], emission[i]);
        }
    }

    pub fn sphere(&mut self, center: DVec3, radius: f64, material: MaterialId, emission: f64) {
        self.add(SurfaceSource::Sphere { center, radius }, material, emission);
    }

    pub fn point_light(&mut self, position: DVec3, intensity: f64) {
        self.source.lights.push(LightSource::Point { position, intensity: Rgb::grey(intensity) });
    }

    pub fn scene(&self) -> Scene {
        Scene::new(self.source.clone()).expect("a test scene is valid")
    }
}

/// A closed cube of side 2 around the origin whose walls all emit radiance 1 and reflect `rho`.
pub fn furnace(rho: f64) -> Room {
    let mut room = Room::new(DVec3::new(0.2, 0.1, -0.7), DVec3::new(0.0, -0.1, 1.0), 16);
    let grey = room.grey(rho);
    room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), [grey; 6], [1.0; 6]);
    room
}

/// Settings of a quick render: `spp` samples and large patches of the given size.
pub fn quick(spp: u32, patch_size: f64) -> RenderSettings {
    let mut settings = RenderSettings { budget: Budget { spp: Some(spp), ..Budget::default() }, ..RenderSettings::default() };
    settings.pass_one.patches.patch_size = Some(patch_size);
    settings
}

/// Renders without anybody watching.
pub fn run(scene: Scene, settings: &RenderSettings) -> Rendered {
    render(scene, settings, &Clocks::start(process_cpu_seconds), &mut silent, &mut |_, _, _| {}).expect("renders")
}

/// Probability below which a chi² test fails: a correct sampler fails once in ten thousand seeds, and the seeds are fixed.
const SIGNIFICANCE: f64 = 1e-4;

/// Fails unless `got` is `want` within a relative tolerance.
pub fn close(what: &str, got: f64, want: f64, relative: f64) {
    assert!((got / want - 1.0).abs() <= relative, "{what}: {got}, expected {want} within {relative}");
}

/// The value that chi² with `degrees` of freedom exceeds with probability [`SIGNIFICANCE`], by Wilson and Hilferty's (1931) cube
/// root; 3.719 is the normal quantile.
fn chi2_limit(degrees: usize) -> f64 {
    assert_eq!(SIGNIFICANCE, 1e-4);
    let k = degrees as f64;
    k * (1.0 - 2.0 / (9.0 * k) + 3.719 * (2.0 / (9.0 * k)).sqrt()).powi(3)
}

/// Pearson's test of counts against expectations; cells that expect less than five are pooled.
pub fn assert_chi2(what: &str, counts: &[u64], expected: &[f64]) {
    let (mut chi2, mut cells, mut pooled) = (0.0, 0, (0.0, 0.0));
    for (&count, &e) in counts.iter().zip(expected) {
        if e < 5.0 {
            pooled = (pooled.0 + count as f64, pooled.1 + e);
        } else {
            chi2 += (count as f64 - e).powi(2) / e;
            cells += 1;
        }
    }
    if pooled.1 >= 5.0 {
        chi2 += (pooled.0 - pooled.1).powi(2) / pooled.1;
        cells += 1;
    } else {
        assert!(pooled.0 <= pooled.1 + 6.0 * pooled.1.sqrt() + 6.0, "{what}: {} in cells that expect {}", pooled.0, pooled.1);
    }
    assert!(cells > 1 && chi2 < chi2_limit(cells - 1), "{what}: chi² {chi2} over {cells} cells, limit {}", chi2_limit(cells - 1));
}

//! Small scenes made in memory, and how they are rendered.

use crate::accel::AccelKind;
use crate::film::Image;
use crate::geometry::tessellate::{self, Triangles};
use crate::integrator::drive::{Budget, Clocks};
use crate::integrator::{IntegratorSettings, ReadOut};
use crate::light::Environment;
use crate::material::{Material, MaterialId, Surface, Texture};
use crate::math::{DAffine3, DVec2, DVec3, Rgb};
use crate::pipeline::probe::Prober;
use crate::pipeline::{PipelineError, RenderSettings, Rendered, Solved, StageCosts, render, solve_world};
use crate::progress::silent;
use crate::run_report::process_cpu_seconds;
use crate::scene::camera::FovAxis;
use crate::scene::{Camera, FilmSettings, LightSource, Scene, SceneError, SceneSource, ShapeSource, SurfaceSource};
use crate::world::{DirectSampling, EmitterPartition, World};
use glam::DMat3;

/// A scene under construction.
#[derive(Clone)]
pub struct Room {
    /// What has been put in.
    pub source: SceneSource,
}

impl Room {
    /// An empty scene whose camera stands at `eye`, looks at `target`, is 90 degrees wide and has `size` by `size` pixels.
    pub fn new(eye: DVec3, target: DVec3, size: usize) -> Self {
        let forward = (target - eye).normalize_or(DVec3::Z);
        let up = if forward.y.abs() > 0.9 { DVec3::Z } else { DVec3::Y };
        let left = up.cross(forward).normalize();
        let camera = Camera {
            to_scene: DAffine3 { matrix3: DMat3::from_cols(left, forward.cross(left), forward), translation: eye },
            tan_half_fov: 45.0_f64.to_radians().tan(),
            fov_axis: FovAxis::X,
            principal_point: DVec2::ZERO,
            near_clip: 1e-4,
            far_clip: 1e7,
        };
        let film = FilmSettings { width: size, height: size, sample_count: 16, max_depth: None };
        let (name, environment) = ("stability".to_owned(), None);
        let (shapes, materials, lights, warnings) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Room { source: SceneSource { name, camera, film, shapes, materials, lights, environment, warnings } }
    }

    /// Adds a material.
    pub fn material(&mut self, material: Material, two_sided: bool) -> MaterialId {
        self.source.materials.push(Surface { name: "stability".to_owned(), material, two_sided, relief: None });
        MaterialId(self.source.materials.len() as u32 - 1)
    }

    /// A diffuse grey that reflects on its front.
    pub fn grey(&mut self, rho: f64) -> MaterialId {
        self.material(Material::Diffuse { reflectance: Texture::Constant(Rgb::grey(rho)) }, false)
    }

    /// A diffuse grey that reflects on both sides.
    pub fn two_sided(&mut self, rho: f64) -> MaterialId {
        self.material(Material::Diffuse { reflectance: Texture::Constant(Rgb::grey(rho)) }, true)
    }

    /// A mirror of one reflectance at all angles.
    pub fn mirror(&mut self, reflectance: f64) -> MaterialId {
        self.material(Material::Conductor { index: None, reflectance: Texture::grey(reflectance) }, true)
    }

    /// Clear glass; `eta` is its index over that of what lies on the side of the normal.
    pub fn glass(&mut self, eta: f64) -> MaterialId {
        self.material(Material::Dielectric { eta, reflectance: Texture::grey(1.0), transmittance: Texture::grey(1.0) }, false)
    }

    /// Adds a shape that emits the radiance `emission` from its front.
    pub fn add(&mut self, surface: SurfaceSource, material: MaterialId, emission: f64) {
        let id = format!("shape{}", self.source.shapes.len());
        let emission = Texture::Constant(Rgb::grey(emission));
        self.source.shapes.push(ShapeSource { id, surface, material, emission });
    }

    /// A quadrilateral by a corner and two edges; its normal is `e1 x e2`.
    pub fn quad(&mut self, corner: DVec3, e1: DVec3, e2: DVec3, material: MaterialId, emission: f64) {
        self.add(SurfaceSource::Triangles(rectangle(corner, e1, e2)), material, emission);
    }

    /// The box between two corners seen from inside: walls -x, +x, -y, +y, -z, +z.
    pub fn walls(&mut self, low: DVec3, high: DVec3, material: MaterialId, emission: [f64; 6]) {
        for (i, (corner, e1, e2)) in faces(low, high).into_iter().enumerate() {
            self.quad(corner, e1, e2, material, emission[i]);
        }
    }

    /// An exact sphere.
    pub fn sphere(&mut self, center: DVec3, radius: f64, material: MaterialId) {
        self.add(SurfaceSource::Sphere { center, radius }, material, 0.0);
    }

    /// A point light [W/sr].
    pub fn point_light(&mut self, position: DVec3, intensity: f64) {
        self.source.lights.push(LightSource::Point { position, intensity: Rgb::grey(intensity) });
    }

    /// Surroundings of one radiance.
    pub fn surround(&mut self, radiance: f64) {
        self.source.environment = Some(Environment::Uniform(Rgb::grey(radiance)));
    }

    /// Every length times `scale` and then moved by `offset`, the camera with it. Radiances stay; intensities grow with the square.
    pub fn moved(&self, scale: f64, offset: DVec3) -> Room {
        let place = |p: DVec3| p * scale + offset;
        let mut room = self.clone();
        for shape in &mut room.source.shapes {
            match &mut shape.surface {
                SurfaceSource::Triangles(t) => t.positions.iter_mut().for_each(|p| *p = place(*p)),
                SurfaceSource::Sphere { center, radius } => (*center, *radius) = (place(*center), *radius * scale),
            }
        }
        for light in &mut room.source.lights {
            if let LightSource::Point { position, intensity } = light {
                (*position, *intensity) = (place(*position), *intensity * (scale * scale));
            }
        }
        let camera = &mut room.source.camera;
        camera.to_scene.translation = place(camera.to_scene.translation);
        (camera.near_clip, camera.far_clip) = (camera.near_clip * scale, camera.far_clip * scale);
        room
    }

    /// The scene.
    ///
    /// # Errors
    /// As [`Scene::new`].
    pub fn scene(&self) -> Result<Scene, SceneError> {
        Scene::new(self.source.clone())
    }
}

/// Two triangles by a corner and two edges.
pub fn rectangle(corner: DVec3, e1: DVec3, e2: DVec3) -> Triangles {
    let matrix3 = DMat3::from_cols(0.5 * e1, 0.5 * e2, e1.cross(e2).normalize_or(DVec3::Z));
    tessellate::rectangle(&DAffine3 { matrix3, translation: corner + 0.5 * e1 + 0.5 * e2 })
}

/// Corner and edges of the six faces of a box, normals inwards.
pub fn faces(low: DVec3, high: DVec3) -> [(DVec3, DVec3, DVec3); 6] {
    let d = high - low;
    let (x, y, z) = (DVec3::X * d.x, DVec3::Y * d.y, DVec3::Z * d.z);
    [(low, y, z), (low + x, z, y), (low, z, x), (low + y, x, z), (low, x, y), (low + z, y, x)]
}

/// A closed cube of side 2 around the origin whose walls all emit radiance 1 and reflect `rho`.
pub fn furnace(rho: f64) -> Room {
    let mut room = Room::new(DVec3::new(0.2, 0.1, -0.7), DVec3::new(0.0, -0.1, 1.0), 16);
    let grey = room.grey(rho);
    room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), grey, [1.0; 6]);
    room
}

/// A cube with a lamp, a block, a mirror ball and a glass ball: something of everything.
pub fn furnished(size: usize) -> Room {
    let mut room = Room::new(DVec3::new(0.0, 0.0, -0.9), DVec3::Z, size);
    let (grey, mirror, glass) = (room.grey(0.6), room.mirror(0.9), room.glass(1.5));
    room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), grey, [0.0; 6]);
    room.quad(DVec3::new(-0.3, 0.99, -0.3), DVec3::X * 0.6, DVec3::Z * 0.6, grey, 5.0);
    let block = DAffine3::from_translation(DVec3::new(0.3, -0.7, 0.3)) * DAffine3::from_scale(DVec3::splat(0.3));
    room.add(SurfaceSource::Triangles(tessellate::cube(&block)), grey, 0.0);
    room.sphere(DVec3::new(-0.4, -0.6, 0.4), 0.35, mirror);
    room.sphere(DVec3::new(-0.3, -0.7, -0.4), 0.2, glass);
    room
}

/// A plain room with a lamp under its ceiling.
pub fn lit(rho: f64, size: usize) -> Room {
    let mut room = Room::new(DVec3::new(0.0, 0.0, -0.9), DVec3::Z, size);
    let grey = room.grey(rho);
    room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), grey, [0.0; 6]);
    room.quad(DVec3::new(-0.3, 0.99, -0.3), DVec3::X * 0.6, DVec3::Z * 0.6, grey, 5.0);
    room
}

/// Settings of a quick render: `spp` samples and patches of the given size.
pub fn quick(spp: u32, patch_size: f64) -> RenderSettings {
    let mut settings = RenderSettings { budget: Budget { spp: Some(spp), ..Budget::default() }, ..RenderSettings::default() };
    settings.pass_one.patches.patch_size = Some(patch_size);
    settings
}

/// Renders without anybody watching.
///
/// # Errors
/// As [`render`].
pub fn picture(scene: Scene, settings: &RenderSettings) -> Result<Rendered, PipelineError> {
    render(scene, settings, &Clocks::start(process_cpu_seconds), &mut silent, &mut |_, _, _| {})
}

/// Pass one with all emitters left to form factors: its source then has no noise where rows are closed.
///
/// # Errors
/// As [`solve_world`].
pub fn solve_gathered(scene: Scene, settings: &RenderSettings) -> Result<Solved, PipelineError> {
    let partition = EmitterPartition::new(&scene, 0.0);
    let world = World::with_partition(scene, AccelKind::default(), partition)?;
    solve_world(world, settings, StageCosts::default(), &mut silent)
}

/// Radiance that arrives at `from` against `direction`, green.
///
/// # Errors
/// As [`solve_world`].
pub fn radiance(scene: Scene, max_depth: Option<u32>, from: DVec3, direction: DVec3, samples: u64) -> Result<f64, PipelineError> {
    let solved = crate::pipeline::solve(scene, &quick(1, 0.5), &mut silent)?;
    let settings = probing(max_depth);
    let prober = Prober { world: &solved.world, pass_one: &solved.pass_one, settings, samples };
    Ok(prober.radiance(&[(from, direction)]).0[0].total.g)
}

/// How probes read pass one.
pub fn probing(max_depth: Option<u32>) -> IntegratorSettings {
    IntegratorSettings {
        read_out: ReadOut::FinalGather,
        max_depth,
        gather_rays: 4,
        direct: DirectSampling::default(),
        seed: 1,
        sampler: crate::math::SamplerKind::Sobol,
    }
}

/// Mean over pixels and channels.
pub fn mean(image: &Image) -> f64 {
    image.pixels().iter().flatten().map(|v| f64::from(*v)).sum::<f64>() / (3 * image.pixels().len()) as f64
}

/// True if no pixel is NaN or infinite.
pub fn is_finite(image: &Image) -> bool {
    image.pixels().iter().flatten().all(|v| v.is_finite())
}

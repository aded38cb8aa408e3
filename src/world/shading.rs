//! A hit seen through its material: what scatters there, in world directions.

use super::{All, DirectSampling, Stages, SurfaceInteraction, World};
use crate::material::{Lobe, Lobes, Material, Relief, Scattering};
use crate::math::{Frame, Rgb, Vec2, Vec3};

/// The material at a hit, in the frame it is meant in.
pub struct Shading<'a> {
    si: &'a SurfaceInteraction,
    /// The material.
    pub material: &'a Material,
    frame: Frame,
    /// Unit direction to the viewer in the material's frame.
    pub wo: Vec3,
    /// True if the material's +z points away from the viewer's side: on the back of what is not two-sided.
    flipped: bool,
    /// What bends the normal, how it is bent, and the frame it was bent in.
    relief: Option<(&'a Relief, Vec3, Frame)>,
}

/// A direction by the glossy lobes.
#[derive(Debug, Clone, Copy)]
pub struct GlossyRay {
    /// Unit direction in world space.
    pub direction: Vec3,
    /// Glossy f |cos theta| over `pdf`.
    pub weight: Rgb,
    /// Density per steradian.
    pub pdf: f64,
}

/// A direction by the whole material.
#[derive(Debug, Clone, Copy)]
pub struct ScatteredRay {
    /// Unit direction in world space.
    pub direction: Vec3,
    /// f |cos theta| over the density; of an ideal direction, the factor on radiance over the probability of its choice.
    pub weight: Rgb,
    /// Density per steradian; `None` for an ideal direction.
    pub density: Option<f64>,
    /// True if it goes on as if nothing were there.
    pub straight: bool,
    /// Index on the light's side over that on the viewer's; 1 unless refracted.
    pub eta: f64,
}

impl World {
    /// The material at `si`. On the back of a one-sided opaque surface nothing of it scatters.
    #[inline]
    pub fn shading<'a>(&'a self, si: &'a SurfaceInteraction) -> Shading<'a> {
        self.shading_by::<All>(si)
    }

    /// As [`Self::shading`], by code that holds the stages `K`.
    #[inline]
    pub fn shading_by<'a, K: Stages>(&'a self, si: &'a SurfaceInteraction) -> Shading<'a> {
        let surface = self.scene.material_of(&self.scene.shapes[si.shape as usize]);
        let mut frame = si.shading_frame();
        let mut relief = None;
        if K::UV && self.oriented[self.scene.shapes[si.shape as usize].material.0 as usize] {
            let (du, dv) = self.tangents(si);
            frame = self.textured_frame(si, frame.n, du);
            if let Some(map) = &surface.relief {
                let [wo, du, dv, ng] = [si.wo, du, dv, si.ng].map(|v| frame.to_local(v));
                let bent = map.perturb(si.uv, wo, du, dv, ng);
                relief = Some((map, bent, frame));
                let s = (du - bent * bent.dot(du)).try_normalize().unwrap_or_else(|| Frame::new(bent).s);
                let [s, t, n] = [s, bent.cross(s), bent].map(|v| frame.to_world(v));
                frame = Frame { s, t, n };
            }
        }
        let mut wo = frame.to_local(si.wo);
        // The interaction's normals face the viewer; a boundary needs to know that the viewer is inside.
        let flipped = !si.front && !surface.two_sided;
        if flipped {
            wo.z = -wo.z;
        }
        Shading { si, material: &surface.material, frame, wo, flipped, relief }
    }
}

impl Shading<'_> {
    /// True if some of the light is reflected diffusely on the side of the viewer.
    #[inline]
    pub fn has_diffuse(&self) -> bool {
        self.material.has_diffuse() && (!self.flipped || self.material.is_transmissive())
    }

    /// True if there are glossy lobes on the side of the viewer.
    #[inline]
    pub fn has_glossy(&self) -> bool {
        self.material.has_glossy() && (!self.flipped || self.material.is_transmissive())
    }

    /// Reflectance, if this is nothing but a Lambertian surface with its own normals, seen from its reflecting side: what it does then
    /// follows from few numbers.
    #[inline]
    pub fn plain(&self) -> Option<Rgb> {
        match self.material {
            Material::Diffuse { reflectance } if self.relief.is_none() && !self.flipped => Some(reflectance.at(self.si.uv)),
            _ => None,
        }
    }

    /// Directional albedo of the diffuse part: a uniform irradiance H is sent to the viewer as the radiance of this times H/pi.
    #[inline]
    pub fn diffuse_reflectance(&self) -> Rgb {
        if self.has_diffuse() { self.material.diffuse_toward(self.wo, self.si.uv) } else { Rgb::BLACK }
    }

    /// What the diffuse part sends out of light from `direction`, over what it sends out of light that comes from everywhere: 1 for a
    /// Lambertian surface; a coat lets more in at steep angles than at grazing ones. By reciprocity the albedo towards a
    /// direction is also that of light from there.
    #[inline]
    pub fn acceptance(&self, direction: Vec3) -> Rgb {
        if self.material.is_lambertian() {
            return Rgb::WHITE;
        }
        let (Some(wi), mean) = (self.to_local(direction), self.material.diffuse_reflectance(self.si.uv)) else {
            return Rgb::BLACK;
        };
        let toward = self.material.diffuse_toward(wi, self.si.uv);
        let over = |a: f64, b: f64| if b > 0.0 { a / b } else { 1.0 };
        Rgb::new(over(toward.r, mean.r), over(toward.g, mean.g), over(toward.b, mean.b))
    }

    /// Unit normal that irradiance is about.
    #[inline]
    pub fn normal(&self) -> Vec3 {
        self.frame.n
    }

    /// Normal of the only side from which light can be scattered to the viewer; `None` if both sides can.
    #[inline]
    pub fn receiver(&self) -> Option<Vec3> {
        (!self.material.is_transmissive()).then_some(self.frame.n)
    }

    /// f |cos theta| of the lobes that are not ideal, for light that comes from `direction`. Black if a bent normal and the face itself
    /// disagree on the side: nothing shines through the back of a face.
    #[inline]
    pub fn eval(&self, direction: Vec3) -> Scattering {
        match self.to_local(direction) {
            Some(wi) => {
                let mut scattering = self.material.eval(self.wo, wi, self.si.uv);
                if self.relief.is_some() {
                    let factor = self.shadowing(direction);
                    scattering.diffuse = scattering.diffuse * factor;
                    scattering.glossy = scattering.glossy * factor;
                }
                scattering
            }
            None => Scattering::default(),
        }
    }

    /// Density per steradian with which [`Self::sample_glossy`] finds `direction`.
    #[inline]
    pub fn glossy_pdf(&self, direction: Vec3) -> f64 {
        self.to_local(direction).map_or(0.0, |wi| self.material.glossy_pdf(self.wo, wi, self.si.uv))
    }

    /// A direction by the glossy lobes.
    #[inline]
    pub fn sample_glossy(&self, u: Vec2, choice: f32) -> Option<GlossyRay> {
        let sample = self.material.sample_glossy(self.wo, self.si.uv, u, choice)?;
        let (direction, z) = self.to_world(sample.wi);
        ((direction.dot(self.si.ng) > 0.0) == (z > 0.0)).then_some(GlossyRay {
            direction,
            weight: sample.weight * self.shadowing(direction),
            pdf: sample.pdf,
        })
    }

    /// A direction by the whole material, ideal lobes included.
    #[inline]
    pub fn sample(&self, u: Vec2, choice: f32) -> Option<ScatteredRay> {
        let sample = self.material.sample(self.wo, self.si.uv, u, choice)?;
        if sample.delta {
            let straight = sample.wi == -self.wo;
            let transmits = (sample.wi.z > 0.0) != (self.wo.z > 0.0);
            let direction = if straight { -self.si.wo } else { self.ideal_direction(sample.wi, transmits)? };
            return Some(ScatteredRay { direction, weight: sample.weight, density: None, straight, eta: sample.eta });
        }
        let (direction, z) = self.to_world(sample.wi);
        ((direction.dot(self.si.ng) > 0.0) == (z > 0.0)).then(|| ScatteredRay {
            direction,
            weight: sample.weight * self.shadowing(direction),
            density: Some(sample.pdf),
            straight: false,
            eta: sample.eta,
        })
    }

    /// Density per steradian with which [`Self::sample`] finds `direction`, ideal lobes left out.
    #[inline]
    pub fn pdf(&self, direction: Vec3) -> f64 {
        self.to_local(direction).map_or(0.0, |wi| self.material.pdf(self.wo, wi, self.si.uv))
    }

    /// Share of the light that the glossy lobes send to the viewer when it comes from everywhere.
    #[inline]
    pub fn glossy_albedo(&self) -> Rgb {
        if self.has_glossy() { self.material.glossy_albedo(self.wo, self.si.uv) } else { Rgb::BLACK }
    }

    /// The ideal lobes.
    #[inline]
    pub fn lobes(&self) -> Lobes {
        self.material.lobes(self.wo, self.si.uv)
    }

    /// World direction of `lobe`; `None` if a bent normal would send it to the wrong side of the surface.
    #[inline]
    pub fn direction(&self, lobe: &Lobe) -> Option<Vec3> {
        if self.is_straight(lobe) {
            return Some(-self.si.wo);
        }
        self.ideal_direction(lobe.wi, lobe.transmits)
    }

    #[inline]
    fn ideal_direction(&self, wi: Vec3, transmits: bool) -> Option<Vec3> {
        let (direction, _) = self.to_world(wi);
        if (direction.dot(self.si.ng) < 0.0) == transmits {
            return Some(direction);
        }
        // A bent normal sent the direction to the wrong side: use the geometric normal for a reflection, give up otherwise.
        (!transmits).then(|| 2.0 * self.si.wo.dot(self.si.ng) * self.si.ng - self.si.wo)
    }

    /// True if `lobe` goes on as if nothing were there.
    #[inline]
    pub fn is_straight(&self, lobe: &Lobe) -> bool {
        lobe.goes_straight(self.wo)
    }

    /// Share of the light that passes straight.
    #[inline]
    pub fn straight_share(&self) -> Rgb {
        self.material.straight_transmittance(self.wo, self.si.uv)
    }

    /// How many shadow rays a surface needs that only a walk has met: one, since its light is seen in a mean.
    pub const IN_PASSING: DirectSampling = DirectSampling { lights_per_point: 1, sky_rays: 1, in_passing: true };

    /// What a relief leaves of light from `direction`.
    #[inline]
    fn shadowing(&self, direction: Vec3) -> f64 {
        self.relief.as_ref().map_or(1.0, |(relief, bent, unbent)| relief.shadowing(*bent, unbent.to_local(direction)))
    }

    #[inline]
    fn to_local(&self, direction: Vec3) -> Option<Vec3> {
        let mut wi = self.frame.to_local(direction);
        if (wi.z > 0.0) != (direction.dot(self.si.ng) > 0.0) {
            return None;
        }
        if self.flipped {
            wi.z = -wi.z;
        }
        Some(wi)
    }

    /// World direction, and its component along the frame's normal on the viewer's side.
    #[inline]
    fn to_world(&self, mut wi: Vec3) -> (Vec3, f32) {
        if self.flipped {
            wi.z = -wi.z;
        }
        (self.frame.to_world(wi), wi.z)
    }
}

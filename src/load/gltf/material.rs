//! A glTF material to a [`Surface`] and the radiance it emits.

use super::super::error::LoadErrorKind;
use super::super::files::Files;
use super::super::picture::{self, Picture};
use super::buffers::{Buffers, fetch, malformed};
use crate::material::principled::Parameters;
use crate::material::texture::{Bitmap, Filter, Wrap};
use crate::material::{Material, Principled, Surface, Texture};
use crate::math::Rgb;
use gltf::material::AlphaMode;
use gltf::texture::{Info, MagFilter, WrappingMode};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

/// Index of refraction where a file gives none, by the extension's definition.
const DEFAULT_INDEX: f64 = 1.5;

/// Decoded images by their index in the file.
pub(super) type Pictures = BTreeMap<usize, Picture>;

/// Decodes the images that materials in use show, side by side; the first fault in the order of images is told.
pub(super) fn decode(materials: &[gltf::Material<'_>], buffers: &Buffers<'_>, files: &Files) -> Result<Pictures, LoadErrorKind> {
    let maps = materials.iter().flat_map(|m| {
        let pbr = m.pbr_metallic_roughness();
        [pbr.base_color_texture(), pbr.metallic_roughness_texture(), m.emissive_texture()]
    });
    let images: BTreeMap<usize, gltf::image::Image<'_>> =
        maps.flatten().map(|info| info.texture().source()).map(|image| (image.index(), image)).collect();
    let images: Vec<_> = images.into_iter().collect();
    let decoded: Vec<_> = images.par_iter().map(|(index, image)| Ok((*index, read(image, buffers, files)?))).collect();
    decoded.into_iter().collect()
}

fn read(image: &gltf::image::Image<'_>, buffers: &Buffers<'_>, files: &Files) -> Result<Picture, LoadErrorKind> {
    let name = format!("image {}", image.index());
    match image.source() {
        gltf::image::Source::View { view, .. } => picture::decode(buffers.view(&view)?, Path::new(&name), false, files),
        gltf::image::Source::Uri { uri, .. } => {
            let name = if uri.starts_with("data:") { &name } else { uri };
            picture::decode(&fetch(uri, files, files.limits.image_bytes)?, Path::new(name), false, files)
        }
    }
}

/// A material of the renderer for one of a glTF, and the radiance it emits.
///
/// To be extended with the materials: what glTF describes and [`Material`] has no form for is decided here and nowhere else.
pub(super) fn surface(
    material: &gltf::Material<'_>,
    pictures: &Pictures,
    warnings: &mut Vec<String>,
) -> Result<(Surface, Texture), LoadErrorKind> {
    let name = match (material.name(), material.index()) {
        (Some(name), _) => name.to_owned(),
        (None, Some(index)) => format!("material {index}"),
        (None, None) => "default".to_owned(),
    };
    let mut note = |what: &str| warnings.push(format!("material \"{name}\": {what}"));
    let pbr = material.pbr_metallic_roughness();
    let [r, g, b, alpha] = pbr.base_color_factor().map(f64::from);
    let factor = color([r, g, b], "baseColorFactor", 1.0)?;
    let base = match pbr.base_color_texture() {
        None => Texture::Constant(factor),
        Some(info) => texture(&info, pictures, factor)?,
    };
    let strength = f64::from(material.emissive_strength().unwrap_or(1.0));
    let glow = color(material.emissive_factor().map(f64::from), "emissiveFactor", 1.0)? * strength;
    if !glow.is_finite() || glow.min() < 0.0 {
        return Err(malformed("an emissiveStrength of 0 or more", format!("{strength}")));
    }
    let emission = match material.emissive_texture() {
        Some(info) if !glow.is_black() => texture(&info, pictures, glow)?,
        _ => Texture::Constant(glow),
    };
    let transmission = material.transmission().map_or(0.0, |t| t.transmission_factor());
    let eta = material.ior().map(f64::from).filter(|n| *n >= 1.0).unwrap_or(DEFAULT_INDEX);
    let is_solid = material.volume().is_some_and(|v| v.thickness_factor() > 0.0);
    let mut two_sided = material.double_sided();
    let mut form = if transmission >= 0.5 {
        two_sided = false;
        // Without a volume the surface is a thin wall, which does not bend light.
        let (reflectance, transmittance) = (Texture::WHITE, base);
        if is_solid {
            Material::Dielectric { eta, reflectance, transmittance }
        } else {
            Material::ThinDielectric { eta, reflectance, transmittance }
        }
    } else {
        let (roughness, metallic) = match pbr.metallic_roughness_texture() {
            None => (grey(pbr.roughness_factor()), grey(pbr.metallic_factor())),
            // Roughness lies in the green channel, metal in the blue one.
            Some(info) => {
                let (rough, metal) = (f64::from(pbr.roughness_factor()), f64::from(pbr.metallic_factor()));
                let both = texture(&info, pictures, Rgb::WHITE)?;
                (both.map(&|c| Rgb::grey(c.g * rough)), both.map(&|c| Rgb::grey(c.b * metal)))
            }
        };
        Material::Principled(Box::new(Principled::new(Parameters::of_base(base, roughness, metallic, eta))))
    };
    match material.alpha_mode() {
        AlphaMode::Opaque => {}
        AlphaMode::Blend if alpha < 1.0 => {
            let inner = Box::new(if two_sided { Material::TwoSided(Box::new(form)) } else { form });
            form = Material::Mask { opacity: Texture::Constant(Rgb::grey(alpha)), inner };
            two_sided = false;
        }
        AlphaMode::Blend | AlphaMode::Mask => note("the alpha channel of its picture plays no part"),
    }
    if material.normal_texture().is_some() {
        note("its normal map plays no part");
    }
    Ok((Surface { name, material: form, two_sided, relief: None }, emission))
}

fn grey(value: f32) -> Texture {
    Texture::Constant(Rgb::grey(f64::from(value).clamp(0.0, 1.0)))
}

fn color(channels: [f64; 3], name: &str, most: f64) -> Result<Rgb, LoadErrorKind> {
    if channels.iter().all(|v| (0.0..=most).contains(v)) {
        Ok(Rgb::new(channels[0], channels[1], channels[2]))
    } else {
        Err(malformed(format!("a {name} with every channel from 0 to {most}"), format!("{channels:?}")))
    }
}

fn texture(info: &Info<'_>, pictures: &Pictures, factor: Rgb) -> Result<Texture, LoadErrorKind> {
    let source = info.texture().source().index();
    let Picture { width, height, texels } = pictures[&source].clone();
    if let Some(i) = texels.iter().position(|t| !t.iter().all(|v| (0.0..=1.0).contains(v))) {
        let found = format!("{:?} at ({}, {}) of image {source}", texels.at(i), i % width, i / width);
        return Err(malformed("texels with every channel from 0 to 1", found));
    }
    let sampler = info.texture().sampler();
    let wrap = match sampler.wrap_s() {
        WrappingMode::ClampToEdge => Wrap::Clamp,
        WrappingMode::MirroredRepeat => Wrap::Mirror,
        WrappingMode::Repeat => Wrap::Repeat,
    };
    let filter = if sampler.mag_filter() == Some(MagFilter::Nearest) { Filter::Nearest } else { Filter::Bilinear };
    let to_uv = match info.texture_transform() {
        None => Bitmap::IDENTITY,
        // KHR_texture_transform: scaled, then turned counter-clockwise as seen (v points down), then moved.
        Some(t) => {
            let ([su, sv], [ou, ov]) = (t.scale(), t.offset());
            let (s, c) = t.rotation().sin_cos();
            [[c * su, s * sv, ou], [-s * su, c * sv, ov]]
        }
    };
    let bitmap = Texture::Bitmap(Bitmap { width, height, texels, filter, wrap, to_uv });
    Ok(if factor == Rgb::WHITE { bitmap } else { bitmap.map(&|rho| rho * factor) })
}

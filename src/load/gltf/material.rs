//! A glTF material to a [`Surface`] and the radiance it emits.

use super::super::error::LoadErrorKind;
use super::super::files::Files;
use super::super::picture::{self, Picture};
use super::buffers::{Buffers, fetch, malformed};
use crate::material::texture::{Bitmap, Filter, Wrap};
use crate::material::{Material, Surface, Texture};
use crate::math::Rgb;
use gltf::material::AlphaMode;
use gltf::texture::{Info, MagFilter, WrappingMode};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

/// Index of refraction where a file gives none, by the extension's definition.
const DEFAULT_INDEX: f64 = 1.5;

/// Roughness up to which a metal is drawn as a mirror.
const MIRROR_ROUGHNESS: f32 = 0.3;

/// Decoded images by their index in the file.
pub(super) type Pictures = BTreeMap<usize, Picture>;

/// Decodes the images that materials in use show, side by side; the first fault in the order of images is told.
pub(super) fn decode(materials: &[gltf::Material<'_>], buffers: &Buffers<'_>, files: &Files) -> Result<Pictures, LoadErrorKind> {
    let maps = materials.iter().flat_map(|m| [m.pbr_metallic_roughness().base_color_texture(), m.emissive_texture()]);
    let images: BTreeMap<usize, gltf::image::Image<'_>> =
        maps.flatten().map(|info| info.texture().source()).map(|image| (image.index(), image)).collect();
    let images: Vec<_> = images.into_iter().collect();
    let decoded: Vec<_> = images.par_iter().map(|(index, image)| Ok((*index, read(image, buffers, files)?))).collect();
    decoded.into_iter().collect()
}

fn read(image: &gltf::image::Image<'_>, buffers: &Buffers<'_>, files: &Files) -> Result<Picture, LoadErrorKind> {
    let limits = &files.limits;
    let name = format!("image {}", image.index());
    match image.source() {
        gltf::image::Source::View { view, .. } => picture::decode(buffers.view(&view)?, Path::new(&name), false, limits),
        gltf::image::Source::Uri { uri, .. } => {
            let name = if uri.starts_with("data:") { &name } else { uri };
            picture::decode(&fetch(uri, files, limits.image_bytes)?, Path::new(name), false, limits)
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
) -> Result<(Surface, Rgb), LoadErrorKind> {
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
    let mut emission = color(material.emissive_factor().map(f64::from), "emissiveFactor", 1.0)? * strength;
    if !emission.is_finite() || emission.min() < 0.0 {
        return Err(malformed("an emissiveStrength of 0 or more", format!("{strength}")));
    }
    if let Some(info) = material.emissive_texture()
        && !emission.is_black()
    {
        emission *= texture(&info, pictures, Rgb::WHITE)?.mean();
        note("its textured emission is rendered as the texture's mean");
    }
    let transmission = material.transmission().map_or(0.0, |t| t.transmission_factor());
    let eta = material.ior().map(f64::from).filter(|n| *n >= 1.0).unwrap_or(DEFAULT_INDEX);
    let is_solid = material.volume().is_some_and(|v| v.thickness_factor() > 0.0);
    let form = if transmission >= 0.5 {
        // Without a volume the surface is a thin wall, which does not bend light.
        let (reflectance, transmittance) = (Rgb::WHITE, base.mean());
        if is_solid {
            Material::Dielectric { eta, reflectance, transmittance }
        } else {
            Material::ThinDielectric { eta, reflectance, transmittance }
        }
    } else if material.alpha_mode() == AlphaMode::Blend && alpha < 0.5 {
        Material::ThinDielectric { eta: 1.0, reflectance: Rgb::WHITE, transmittance: Rgb::WHITE }
    } else if pbr.metallic_factor() >= 0.5
        && pbr.roughness_factor() <= MIRROR_ROUGHNESS
        && pbr.base_color_texture().is_none()
        && pbr.metallic_roughness_texture().is_none()
    {
        Material::Conductor { index: None, reflectance: factor }
    } else {
        if pbr.metallic_factor() >= 0.5 && pbr.metallic_roughness_texture().is_none() {
            note("a rough metal is rendered as a diffuse surface");
        }
        Material::Diffuse { reflectance: base }
    };
    if material.alpha_mode() != AlphaMode::Opaque {
        note(&format!("its opacity is rendered as {}", if form.is_transmissive() { "0" } else { "1" }));
    }
    if material.normal_texture().is_some() {
        note("its normal map plays no part");
    }
    let two_sided = material.double_sided() && !form.is_transmissive();
    Ok((Surface { name, material: form, two_sided }, emission))
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
        let found = format!("{:?} at ({}, {}) of image {source}", texels[i], i % width, i / width);
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
    Ok(if factor == Rgb::WHITE { bitmap } else { bitmap.map(|rho| rho * factor) })
}

//! Each physical law is a test.

mod accel_conformance;
mod accel_random;
mod architecture;
mod bad_input;
mod catalogue;
mod catalogue_corpus;
mod catalogue_images;
mod catalogue_meshes;
mod catalogue_values;
mod cli;
mod emitters;
mod engines;
mod furnace;
mod glossy;
mod invariance;
mod light;
mod loading;
mod loading_gltf;
mod loading_materials;
mod loading_meshes;
mod loading_models;
mod loading_shapes;
mod material_laws;
mod patches;
mod specular;
mod support;

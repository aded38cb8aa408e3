//! Each physical law is a test.

mod accel_conformance;
mod architecture;
mod bad_input;
mod catalogue;
mod catalogue_corpus;
mod catalogue_images;
mod catalogue_meshes;
mod catalogue_values;
mod cli;
mod emitters;
mod furnace;
mod glossy;
mod invariance;
mod lamps;
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

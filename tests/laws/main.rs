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
mod furnace;
mod invariance;
mod light;
mod loading;
mod loading_materials;
mod patches;
mod specular;
mod support;

//! Each physical law is a test.

mod furnace;
mod invariance;
mod light;
mod patches;
mod specular;
mod support;

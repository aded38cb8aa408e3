//! Each physical law is a test.

mod accel_conformance;
mod architecture;
mod cli;
mod furnace;
mod invariance;
mod light;
mod patches;
mod specular;
mod support;

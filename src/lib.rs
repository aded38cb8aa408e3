//! Hybrid two-pass global illumination.
//!
//! Pass one solves diffuse radiosity over the scene's patches, B = E + rho F B. Pass two traces rays in Whitted's manner,
//! I = I_local + Kr R + Kt T, and gathers the radiosity at diffuse hits.
//!
//! | symbol | name | unit | type |
//! |---|---|---|---|
//! | L | radiance | W m⁻² sr⁻¹ | [`math::Rgb`] |
//! | B | radiosity | W m⁻² | [`math::Rgb`] |
//! | E | exitance (emitted radiosity) | W m⁻² | [`math::Rgb`] |
//! | H | irradiance | W m⁻² | [`math::Rgb`] |
//! | rho | reflectance | 1 | [`math::Rgb`] |
//! | F_ij | form factor from i to j | 1 | `f64`, stored as `f32` |
//! | A | area | m² | `f64` |
//! | I | intensity | W sr⁻¹ | [`math::Rgb`] |
//!
//! Modules in reading order: [`geometry`], [`accel`], [`material`], [`light`], [`scene`], [`load`], [`world`], [`patch`],
//! [`form_factor`], [`radiosity`], [`integrator`], [`plan`], [`pipeline`].

pub mod accel;
pub mod experiment;
pub mod film;
pub mod form_factor;
pub mod geometry;
pub mod integrator;
pub mod light;
pub mod load;
pub mod material;
pub mod math;
pub mod metrics;
pub mod patch;
pub mod pipeline;
pub mod plan;
pub mod progress;
pub mod radiosity;
pub mod run_report;
pub mod scene;
pub mod stability;
pub mod world;

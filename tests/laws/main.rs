//! Physical and geometric laws across modules.

mod accel_conformance;

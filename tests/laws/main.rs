//! Each physical law is a test.

mod furnace;
mod support;

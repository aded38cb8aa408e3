//! Laws across modules, a line a module.

mod bad_input;
mod loading;
mod loading_materials;

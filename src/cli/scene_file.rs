//! From the scene named on the command line to a loaded scene.

use super::args::{Common, SceneArgs};
use super::exit::Failure;
use super::output::say;
use std::path::{Path, PathBuf};
use twopass::load::{LoadOptions, LoadedScene, load_scene_seen};
use twopass::scene::SceneSource;

/// The file that is meant: a folder stands for the scene.xml in it.
pub fn resolve(scene: &Path) -> PathBuf {
    if scene.is_dir() { scene.join("scene.xml") } else { scene.to_owned() }
}

/// Default name of the output: the scene's folder for a scene.xml, else the file's name without its extension.
pub fn default_name(scene: &Path) -> String {
    let file = resolve(scene);
    let stem = file.file_stem();
    let absolute = std::path::absolute(&file).unwrap_or_else(|_| file.clone());
    let folder = absolute.parent().and_then(Path::file_name);
    let name = folder.filter(|_| stem.is_some_and(|s| s == "scene")).or(stem);
    name.map_or_else(|| "scene".to_owned(), |n| n.to_string_lossy().into_owned())
}

/// Loads the scene and says what the reader warns of.
pub fn load(common: &Common, scene: &Path, source: &SceneArgs) -> Result<LoadedScene, Failure> {
    load_seen(common, scene, source, |_| {})
}

/// As [`load`]; `look` sees what was read before it becomes a scene.
pub fn load_seen(
    common: &Common,
    scene: &Path,
    source: &SceneArgs,
    look: impl FnOnce(&SceneSource),
) -> Result<LoadedScene, Failure> {
    let options = LoadOptions {
        defines: source.define.iter().map(|d| (d.name.clone(), d.value.clone())).collect(),
        allow_paths: common.allow_path.clone(),
        ..LoadOptions::default()
    };
    let loaded = load_scene_seen(&resolve(scene), &options, look)?;
    for warning in &loaded.scene.warnings {
        say(common, &format!("warning: {warning}"));
    }
    Ok(loaded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_name_is_the_folders_or_the_files() {
        for (scene, name) in
            [("scenes/cornell-box/scene.xml", "cornell-box"), ("rooms/kitchen.xml", "kitchen"), ("kitchen.v2.xml", "kitchen.v2")]
        {
            assert_eq!(default_name(Path::new(scene)), name, "{scene}");
        }
        let here = std::env::current_dir().unwrap();
        assert_eq!(default_name(Path::new("scene.xml")), here.file_name().unwrap().to_string_lossy());
    }
}

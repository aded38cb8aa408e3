//! Methods of others: a command line, and what its process says of its own times.
//!
//! The command is run by `sh -c`. Words in braces are replaced, quoted for the shell: `{scene}`, `{out}` (the EXR to be written), `{spp}`,
//! `{seed}`, `{width}`, `{height}`, `{threads}`, `{plan_dir}` (the folder of the plan), `{defines}` (`-D NAME=VALUE` for each).
//!
//! A process that wants start-up, compilation or its reader left out of its times writes `{out}.json`, a JSON object of which every key may
//! be absent: `wall_s` and `cpu_s` (all that is to be judged), `load_cpu_s`, `tree_cpu_s`, `pass_one_cpu_s`, `pass_two_cpu_s`, `spp`, `rays`,
//! `peak_memory_bytes`, `predicted_relmse`. Without it the times are those of the whole process, start to end.

use super::child::Ended;
use super::row::Row;
use serde::Deserialize;
use std::path::Path;

/// Values for the words in braces.
#[derive(Debug, Clone)]
pub struct Words<'a> {
    /// The scene's file.
    pub scene: &'a Path,
    /// The picture to be written.
    pub out: &'a Path,
    /// Samples per pixel.
    pub spp: u32,
    /// Seed.
    pub seed: u64,
    /// Size of the picture in pixels.
    pub size: (usize, usize),
    /// Threads.
    pub threads: usize,
    /// Folder of the plan.
    pub plan_dir: &'a Path,
    /// Values for the scene's parameters.
    pub defines: &'a [(String, String)],
}

/// The command with its words replaced.
pub fn fill(template: &str, words: &Words<'_>) -> String {
    let defines: Vec<String> = words.defines.iter().map(|(n, v)| format!("-D {}", quoted(&format!("{n}={v}")))).collect();
    let replaced = [
        ("{scene}", quoted(&words.scene.to_string_lossy())),
        ("{out}", quoted(&words.out.to_string_lossy())),
        ("{plan_dir}", quoted(&words.plan_dir.to_string_lossy())),
        ("{spp}", words.spp.to_string()),
        ("{seed}", words.seed.to_string()),
        ("{width}", words.size.0.to_string()),
        ("{height}", words.size.1.to_string()),
        ("{threads}", words.threads.to_string()),
        ("{defines}", defines.join(" ")),
    ];
    // In one pass, so that what a value holds is not replaced again.
    let mut filled = String::new();
    let mut rest = template;
    while let Some(at) = rest.find('{') {
        filled.push_str(&rest[..at]);
        rest = &rest[at..];
        match replaced.iter().find(|(word, _)| rest.starts_with(word)) {
            Some((word, value)) => {
                filled.push_str(value);
                rest = &rest[word.len()..];
            }
            None => {
                filled.push('{');
                rest = &rest[1..];
            }
        }
    }
    filled + rest
}

/// A word as the shell reads it back.
fn quoted(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+=:,@".contains(c);
    if !text.is_empty() && text.chars().all(plain) { text.to_owned() } else { format!("'{}'", text.replace('\'', r"'\''")) }
}

/// What a process says of itself.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Said {
    wall_s: Option<f64>,
    cpu_s: Option<f64>,
    load_cpu_s: Option<f64>,
    tree_cpu_s: Option<f64>,
    pass_one_cpu_s: Option<f64>,
    pass_two_cpu_s: Option<f64>,
    spp: Option<f64>,
    rays: Option<u64>,
    peak_memory_bytes: Option<u64>,
    predicted_relmse: Option<f64>,
}

/// Fills in the row's times: those that the process wrote beside its picture, or else those of the process.
///
/// # Errors
/// If its file is there but cannot be read: a sentence.
pub fn measure(row: &mut Row, ended: &Ended, said: &Path, spp: u32) -> Result<(), String> {
    let said: Said = match std::fs::read(said) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Said::default(),
        Err(error) => return Err(format!("its JSON file cannot be read: {error}")),
        Ok(bytes) => serde_json::from_slice(&bytes).map_err(|error| format!("its JSON file is not as expected: {error}"))?,
    };
    row.wall_s = said.wall_s.unwrap_or(ended.wall_s);
    row.cpu_s = said.cpu_s.unwrap_or(ended.cpu_s);
    row.load_cpu_s = said.load_cpu_s.unwrap_or(0.0);
    row.tree_cpu_s = said.tree_cpu_s;
    row.pass_one_cpu_s = said.pass_one_cpu_s;
    row.pass_two_cpu_s = said.pass_two_cpu_s;
    row.spp = said.spp.unwrap_or(f64::from(spp));
    row.rays = said.rays;
    row.peak_memory_bytes = said.peak_memory_bytes;
    row.predicted_relmse = said.predicted_relmse;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_replaced_once_and_quoted() {
        let words = Words {
            scene: Path::new("/a b/{seed}.xml"),
            out: Path::new("/o/x.exr"),
            spp: 4,
            seed: 7,
            size: (8, 6),
            threads: 2,
            plan_dir: Path::new("/it's"),
            defines: &[("angle".to_owned(), "0 1".to_owned())],
        };
        let filled = fill("r {plan_dir}/x {scene} {spp} ${HOME} {out} {width}x{height} {seed} {defines} {", &words);
        assert_eq!(filled, r"r '/it'\''s'/x '/a b/{seed}.xml' 4 ${HOME} /o/x.exr 8x6 7 -D 'angle=0 1' {");
    }
}

//! Who may use whom, and what no source file may hold. ARCHITECTURE.md says why; this file sees that it stays so.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Which top-level modules each may use. `math` and `progress` are open to all; a module may use itself.
///
/// `patch` and `radiosity` see the `world`: a patch is measured by rays, and the field is read at hits.
const MAY_USE: &[(&str, &[&str])] = &[
    ("math", &[]),
    ("progress", &[]),
    ("geometry", &[]),
    ("film", &[]),
    ("accel", &["geometry"]),
    ("material", &["geometry", "film"]),
    ("light", &["geometry", "film", "material"]),
    ("scene", &["geometry", "material", "light", "film"]),
    ("load", &["scene", "geometry", "material", "light", "film"]),
    ("world", &["scene", "accel", "geometry", "material", "light", "film"]),
    ("patch", &["world", "scene", "geometry", "material"]),
    ("form_factor", &["world", "patch", "geometry", "accel"]),
    ("radiosity", &["world", "form_factor", "patch", "geometry"]),
    ("plan", &["scene", "patch", "world"]),
    ("integrator", &["world", "radiosity", "film", "scene", "accel", "geometry", "material", "light"]),
    ("run_report", &["film"]),
    ("metrics", &["film"]),
    ("denoise", &["film"]),
    ("pipeline", ALL),
    ("experiment", ALL),
    ("stability", ALL),
    ("serve", ALL),
    ("cli", ALL),
    ("main", ALL),
];

/// All modules, for those at the top.
const ALL: &[&str] = &["*"];

/// Solvers see numbers, never triangles: only these files of `radiosity` may use other modules.
const NOT_SOLVERS: [&str; 4] = ["mod.rs", "field.rs", "system.rs", "interpolation.rs"];

/// Longest source file in lines.
const LONGEST: usize = 500;

/// The program: the only part that may speak to a terminal.
const PROGRAM: [&str; 2] = ["cli", "main"];

/// What the library never uses.
const TERMINAL: [&str; 9] =
    ["println!", "eprintln!", "print!", "eprint!", "clap::", "indicatif::", "miette::", "io::stdout", "io::stderr"];

/// A source file by its path from `src`, with forward slashes.
struct Source {
    path: String,
    text: String,
}

impl Source {
    /// Top-level module it belongs to.
    fn module(&self) -> &str {
        let first = self.path.split('/').next().unwrap_or_default();
        first.strip_suffix(".rs").unwrap_or(first)
    }

    fn file_name(&self) -> &str {
        self.path.rsplit('/').next().unwrap_or_default()
    }

    fn is_test(&self) -> bool {
        self.file_name() == "tests.rs"
    }

    /// Lines that run outside tests, numbered from 1, without comments and the contents of strings.
    fn code(&self) -> Vec<(usize, String)> {
        if self.is_test() {
            return Vec::new();
        }
        let lines = self.text.lines().enumerate().map(|(i, line)| (i + 1, without_comment_and_strings(line)));
        // Test modules stand at the end of a file.
        lines.take_while(|(_, line)| line.trim() != "#[cfg(test)]").collect()
    }
}

fn without_comment_and_strings(line: &str) -> String {
    let (mut kept, mut in_string, mut before) = (String::new(), false, ' ');
    for c in line.chars() {
        if c == '"' && before != '\\' && before != '\'' {
            in_string = !in_string;
        } else if !in_string {
            kept.push(c);
        }
        if kept.ends_with("//") {
            kept.truncate(kept.len() - 2);
            break;
        }
        before = c;
    }
    kept
}

/// Top-level modules named after `crate::` in a line of code.
fn modules_used(line: &str) -> Vec<String> {
    let name = |text: &str| text.trim_start().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let mut used = Vec::new();
    for rest in line.split("crate::").skip(1) {
        match rest.strip_prefix('{') {
            // `use crate::{a::b, c}`: what stands at the first level of the braces.
            Some(list) => {
                let mut depth = 0;
                for part in list.split_inclusive([',', '{', '}']) {
                    if depth == 0 {
                        used.push(name(part));
                    }
                    depth += i32::from(part.ends_with('{')) - i32::from(part.ends_with('}'));
                }
            }
            None => used.push(name(rest)),
        }
    }
    // Macros and items of the crate's root have no module of their own.
    used.retain(|m| !m.is_empty() && MAY_USE.iter().any(|(known, _)| known == m));
    used
}

fn forbidden_edges(source: &Source) -> Vec<String> {
    let module = source.module();
    if module == "lib" {
        return Vec::new();
    }
    let Some((_, allowed)) = MAY_USE.iter().find(|(known, _)| *known == module) else {
        return vec![format!("{}: module {module} is not in the table", source.path)];
    };
    let is_solver = module == "radiosity" && !NOT_SOLVERS.contains(&source.file_name());
    let allowed: &[&str] = if is_solver { &[] } else { allowed };
    let ok = |m: &str| m == module || m == "math" || m == "progress" || allowed.contains(&"*") || allowed.contains(&m);
    let lines = source.code();
    let edges = lines.iter().flat_map(|(n, line)| modules_used(line).into_iter().map(move |m| (*n, m)));
    edges.filter(|(_, m)| !ok(m)).map(|(n, m)| format!("{}:{n}: {module} may not use {m}", source.path)).collect()
}

fn has_word(line: &str, word: &str) -> bool {
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    line.match_indices(word).any(|(at, _)| {
        !line[..at].chars().next_back().is_some_and(is_part) && !line[at + word.len()..].chars().next().is_some_and(is_part)
    })
}

fn forbidden_code(source: &Source) -> Vec<String> {
    let in_program = PROGRAM.contains(&source.module());
    let mut found = Vec::new();
    for (n, line) in source.code() {
        let mut report = |what: &str| found.push(format!("{}:{n}: {what}", source.path));
        if line.contains(".unwrap()") {
            report("unwrap outside tests");
        }
        if has_word(&line, "unsafe") && source.module() != "accel" {
            report("unsafe outside accel");
        }
        if let Some(name) = TERMINAL
            .iter()
            .find(|name| !in_program && has_word(&line, name.trim_end_matches(['!', ':'])) && line.contains(**name))
        {
            report(&format!("the library does not use {name}"));
        }
    }
    found
}

fn too_long(source: &Source) -> Option<String> {
    let lines = source.text.lines().count();
    (lines > LONGEST).then(|| format!("{}: {lines} lines, more than {LONGEST}", source.path))
}

fn sources(root: &str) -> Vec<Source> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(root);
    let mut files = Vec::new();
    collect(&root, &mut files);
    files.sort();
    let relative = |path: &Path| path.strip_prefix(&root).expect("found below it").to_string_lossy().replace('\\', "/");
    files.iter().map(|p| Source { path: relative(p), text: std::fs::read_to_string(p).expect("readable") }).collect()
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("readable") {
        let path = entry.expect("readable").path();
        // Build outputs are nobody's text.
        if path.is_dir() && path.file_name().is_some_and(|name| name != "target") {
            collect(&path, files);
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
}

fn assert_none(found: Vec<String>) {
    assert!(found.is_empty(), "\n{}\n", found.join("\n"));
}

#[test]
fn modules_use_only_what_the_table_allows() {
    let sources = sources("src");
    assert!(sources.len() > 20, "found only {} files", sources.len());
    assert_none(sources.iter().flat_map(forbidden_edges).collect());
}

#[test]
fn the_table_has_no_cycle() {
    let table: BTreeMap<&str, &[&str]> = MAY_USE.iter().copied().collect();
    // A module is settled when all that it may use is: if a round settles nothing, the rest is a cycle.
    let mut settled: Vec<&str> = table.iter().filter(|(_, used)| used.contains(&"*")).map(|(m, _)| *m).collect();
    while settled.len() < table.len() {
        let next = |m: &&str| !settled.contains(m) && table[*m].iter().all(|u| settled.contains(u));
        let ready: Vec<&str> = table.keys().copied().filter(|m| next(m)).collect();
        assert!(!ready.is_empty(), "a cycle among those beyond {settled:?}");
        settled.extend(ready);
    }
}

#[test]
fn no_file_is_longer_than_one_can_read() {
    let all = ["src", "tests"].into_iter().flat_map(sources);
    assert_none(all.filter_map(|s| too_long(&s)).collect());
}

#[test]
fn the_library_neither_panics_carelessly_nor_speaks() {
    assert_none(sources("src").iter().flat_map(forbidden_code).collect());
}

/// The laws above on text that breaks them.
#[test]
fn each_law_fails_on_a_seeded_fault() {
    let source = |path: &str, text: &str| Source { path: path.to_owned(), text: text.to_owned() };
    for (path, line) in [
        ("geometry/mesh.rs", "use crate::scene::Scene;"),
        ("accel/bvh.rs", "fn f(w: &crate::world::World) {}"),
        ("film/io.rs", "use crate::{math::Rgb, load};"),
        ("radiosity/gauss_seidel.rs", "use crate::patch::PatchMesh;"),
        ("metrics/mod.rs", "    pub fn g() { crate::pipeline::render() }"),
        ("strange/mod.rs", "use crate::math::Rgb;"),
    ] {
        assert_eq!(forbidden_edges(&source(path, line)).len(), 1, "{path}: {line}");
    }
    for (path, line) in [
        ("world/mod.rs", "let x = y.unwrap();"),
        ("math/mod.rs", "unsafe { f() }"),
        ("load/mod.rs", "println!(\"{x}\");"),
        ("film/io.rs", "use std::io::stderr;"),
    ] {
        assert_eq!(forbidden_code(&source(path, line)).len(), 1, "{path}: {line}");
    }
    assert!(too_long(&source("a.rs", &"\n".repeat(LONGEST + 1))).is_some());

    let innocent =
        "//! crate::scene unwrap() unsafe\nlet s = \"x.unwrap() // crate::world\"; // println!\n#[cfg(test)]\nx.unwrap()";
    assert_none(forbidden_code(&source("math/mod.rs", innocent)));
    assert_none(forbidden_edges(&source("math/mod.rs", innocent)));
    assert_none(forbidden_code(&source("math/mod.rs", "#![deny(unsafe_code)]\nwriteln!(file, \"\")")));
}

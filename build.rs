//! Finds Embree 3 when the feature `embree` asks for it, and says what to install when it is not there. Tells the program its commit.

use std::path::{Path, PathBuf};
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=EMBREE_LIB_DIR");
    println!(
        "cargo::rustc-env=TWOPASS_COMMIT={}",
        git(&["rev-parse", "--short=12", "HEAD"]).unwrap_or_else(|| "no commit".to_owned())
    );
    // The log of HEAD grows with every commit; a file that is not there would mean a build each time.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]).filter(|log| Path::new(log).exists()) {
        println!("cargo::rerun-if-changed={log}");
    }
    if std::env::var_os("CARGO_FEATURE_EMBREE").is_none() {
        return;
    }
    match find("libembree3.so") {
        Some(folder) => {
            println!("cargo::rustc-link-search=native={}", folder.display());
            println!("cargo::rustc-link-lib=dylib=embree3");
        }
        None => println!("cargo::error={}", what_is_missing()),
    }
}

/// What git says, if there is a git and a repository.
fn git(words: &[&str]) -> Option<String> {
    let output = Command::new("git").args(words).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    (output.status.success() && !text.trim().is_empty()).then(|| text.trim().to_owned())
}

/// First folder that holds the library; a folder named by the user comes first.
fn find(library: &str) -> Option<PathBuf> {
    let multiarch = format!("/usr/lib/{}-linux-gnu", std::env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_default());
    let named = std::env::var_os("EMBREE_LIB_DIR").map(PathBuf::from);
    let usual = [multiarch.as_str(), "/usr/lib64", "/usr/lib", "/usr/local/lib64", "/usr/local/lib"];
    named.into_iter().chain(usual.iter().map(PathBuf::from)).find(|folder| Path::new(folder).join(library).exists())
}

fn what_is_missing() -> String {
    let advice = "the feature `embree` needs Embree 3: `apt-get install libembree-dev` on Debian 12, or set EMBREE_LIB_DIR to the \
                  folder of libembree3.so, or build without `--features embree`";
    match find("libembree4.so") {
        Some(folder) => format!("found Embree 4 in {}, whose interface is another; {advice}", folder.display()),
        None => format!("libembree3.so was not found; {advice}"),
    }
}

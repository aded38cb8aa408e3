#![no_main]

use std::sync::LazyLock;
use tempfile::TempDir;

static FOLDER: LazyLock<TempDir> = LazyLock::new(|| TempDir::new().expect("a temporary folder"));

libfuzzer_sys::fuzz_target!(init: twopass_fuzz::let_guarded_panics_pass(), |bytes: &[u8]| {
    twopass::load::fuzz::model(bytes, FOLDER.path());
});

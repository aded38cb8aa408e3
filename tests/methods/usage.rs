//! Settings that cannot be meant are usage errors, told before the scene is read.

use std::process::{Command, Stdio};

#[test]
fn bad_settings_of_methods_exit_with_2_and_say_what_was_expected() {
    for (flags, said) in [
        ("--method sppm --photons 0", "1 or more"),
        ("--method photon-map --photons -5", "1 or more"),
        ("--method photon-map --photons 99999999999", "1 or more"),
        ("--method metropolis --chains 0", "1 or more"),
        ("--method metropolis --large-steps 0", "above 0"),
        ("--method metropolis --large-steps 1.5", "1 at most"),
        ("--method metropolis --large-steps nan", "above 0"),
        ("--method metropolis --chain-steps 0", "above 0"),
        ("--method metropolis --chain-brightness -1", "above 0"),
        ("--method bidirectional --heuristic best", "power"),
        ("--method irradiance-cache --ambient-bounces -1", "0 or more"),
        ("--method irradiance-cache --ambient-accuracy 0", "above 0"),
        ("--method irradiance-cache --ambient-divisions 0", "1 or more"),
        ("--method whitted-only --ambient -1", "0 or more"),
        ("--method path --paths L(DE", "regular expression"),
        ("--method path --paths LXE", "L, S, M, D, E"),
        ("--method two-pass-planar --reflections 0", "1 to 8"),
        ("--method two-pass-planar --reflections 9", "1 to 8"),
        ("--method two-pass-planar --form-factors hierarchical", "virtual rooms"),
        ("--method two-pass-planar --solution a.sol", "two-pass-general"),
        ("--method path --read-out stored", "no first pass"),
        ("--method two-pass-general --read-out final-gather", "one way only"),
        ("--method radiosity-only", "radiosity"),
    ] {
        let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/furnace/scene.xml");
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut command = Command::new(env!("CARGO_BIN_EXE_twopass"));
        command.args(["render", scene]).args(flags.split_whitespace()).current_dir(folder.path()).stdin(Stdio::null());
        let output = command.output().expect("the program starts");
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{flags}: {text}");
        assert!(text.contains(said), "{flags}: {text}, expected it to say {said:?}");
        assert_eq!(folder.path().read_dir().expect("readable").count(), 0, "{flags}: nothing is written");
    }
}

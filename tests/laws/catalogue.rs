//! Bad input on the built program, row by row of a catalogue (C1 and so on): exit code, place, words; never a panic.
//!
//! Every run has one second of processor time and 256 MB of writable memory, both enforced by the system: a program that asks for
//! more is ended by it, so that its exit code is wrong.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Writable memory of a run [KB], touched or not.
pub const MEMORY_KB: u64 = 256 << 10;

/// A sensor in one line, so that places can be counted.
pub const SENSOR: &str = "<sensor type='perspective'><film type='hdrfilm'><integer name='width' value='8'/>\
                          <integer name='height' value='4'/><rfilter type='box'/></film></sensor>";

/// A scene whose `body` begins on line 3.
pub fn scene(body: &str) -> String {
    format!("<scene version='3.0.0'>\n{SENSOR}\n{body}</scene>\n")
}

/// A folder in which the program runs.
pub struct Case {
    folder: TempDir,
    memory_kb: u64,
    seconds: u32,
}

impl Case {
    /// With the file `scene.xml` of exactly this content.
    pub fn whole(text: impl AsRef<[u8]>) -> Self {
        Self { folder: TempDir::new().expect("a temporary folder"), memory_kb: MEMORY_KB, seconds: 1 }.with("scene.xml", text)
    }

    /// With a scene whose `body` begins on line 3.
    pub fn new(body: &str) -> Self {
        Self::whole(scene(body))
    }

    /// The same with one more file.
    pub fn with(self, name: &str, contents: impl AsRef<[u8]>) -> Self {
        std::fs::write(self.path(name), contents).expect("written");
        self
    }

    /// The same with less memory.
    pub fn within(mut self, kb: u64) -> Self {
        self.memory_kb = kb;
        self
    }

    /// The same with more processor time.
    pub fn seconds(mut self, seconds: u32) -> Self {
        self.seconds = seconds;
        self
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The program under its limits, with these words on its command line.
    pub fn command(&self, line: &str) -> Command {
        let mut command = Command::new("sh");
        command.arg("-c").arg(format!("ulimit -d {} && ulimit -t {} && exec \"$@\"", self.memory_kb, self.seconds)).arg("sh");
        command.arg(env!("CARGO_BIN_EXE_twopass")).args(line.split_whitespace());
        command.current_dir(self.folder.path()).stdin(Stdio::null());
        command
    }

    /// Runs and demands the exit code; gives stdout and stderr.
    pub fn run(&self, code: i32, line: &str) -> (String, String) {
        expect(code, self.command(line), line)
    }

    /// `info` of the scene must end with `code`, naming the place and all of these words.
    pub fn refused(&self, code: i32, words: &[&str]) -> String {
        let (_, err) = self.run(code, "info scene.xml --threads 2");
        assert_words(&err, words, "info");
        err
    }

    /// `info` of the scene must succeed; gives its figures.
    pub fn accepted(&self) -> String {
        self.run(0, "info scene.xml --threads 2").0
    }
}

/// Runs a command and demands its exit code and that nothing speaks of a panic.
pub fn expect(code: i32, mut command: Command, line: &str) -> (String, String) {
    let start = Instant::now();
    let Output { status, stdout, stderr } = command.output().expect("the program starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (out, err) = (text(&stdout), text(&stderr));
    assert_eq!(status.code(), Some(code), "twopass {line}: {status}\nstdout: {out}\nstderr: {err}");
    // A run takes one second of processor time at most; this finds those that wait.
    assert!(start.elapsed() < Duration::from_secs(30), "twopass {line} took {:?}", start.elapsed());
    assert!(
        !["panic", "internal fault", "backtrace", "memory allocation"].iter().any(|w| err.contains(w)),
        "twopass {line}: {err}"
    );
    (out, err)
}

pub fn assert_words(message: &str, words: &[&str], what: &str) {
    for word in words {
        assert!(message.contains(word), "{what}: expected {word:?} in\n{message}");
    }
}

/// An OBJ shape in `m.obj`, and so on.
pub fn mesh_shape(name: &str) -> String {
    let kind = Path::new(name).extension().expect("an extension").to_string_lossy();
    format!("<shape type='{kind}'><string name='filename' value='{name}'/></shape>\n")
}

#[test]
fn c1_broken_xml_has_line_and_column() {
    Case::whole("").refused(3, &["scene.xml:1:1", "well-formed XML"]);
    Case::whole("\n\nhello").refused(3, &["scene.xml:3:", "well-formed XML"]);
    let text = scene("<shape type='cube'/>\n");
    for cut in [1, 10, 24, text.len() / 2, text.len() - 3, text.trim_end().len() - 1] {
        let line = 1 + text[..cut].matches('\n').count();
        Case::whole(&text[..cut]).refused(3, &[&format!("scene.xml:{line}:"), "expected"]);
    }
    Case::whole(b"\x7fELF\x02\x01\x01\x00\xff\xfe").refused(3, &["scene.xml", "UTF-8", "offset 8"]);
    Case::whole(b"MZ\x00\x00").refused(3, &["scene.xml:1:", "XML"]);
}

#[test]
fn c2_document_types_are_refused_at_once() {
    let entities: String = (1..10).map(|i| format!("<!ENTITY l{i} '{}'>", format!("&l{};", i - 1).repeat(10))).collect();
    let laughs = format!("<!DOCTYPE s [<!ENTITY l0 'ha'>{entities}]>\n<scene version='3.0.0'>&l9;</scene>");
    let secret = "root:x:0:0";
    let external = "<!DOCTYPE s [<!ENTITY e SYSTEM 'file:///etc/passwd'>]>\n<scene version='3.0.0'>&e;</scene>";
    let parameter = "<!DOCTYPE s SYSTEM 'http://localhost/x.dtd'>\n<scene version='3.0.0'/>";
    for text in [laughs.as_str(), external, parameter] {
        let case = Case::whole(text).within(10 << 10);
        let (_, err) = case.run(3, "info scene.xml --threads 1");
        assert_words(&err, &["scene.xml:1:", "DTD"], text);
        assert!(!err.contains(secret), "{err}");
        // The best of several, since other work may run beside this.
        let time = |_| {
            let start = Instant::now();
            twopass::load::load_scene(&case.path("scene.xml"), &Default::default()).expect_err("a DTD");
            start.elapsed()
        };
        let best = (0..5).map(time).min().expect("five");
        assert!(best < Duration::from_millis(10), "{best:?}");
    }
}

#[test]
fn c3_deep_nesting_is_over_a_limit() {
    for n in [257, 20_000, 500_000] {
        let text = format!("<scene version='3.0.0'>{}{}</scene>", "<bsdf type='twosided'>".repeat(n), "</bsdf>".repeat(n));
        Case::whole(text).refused(4, &["scene.xml:1:", "depth", "limit of 256"]);
    }
}

/// Half the stack that a thread has: readers recurse, and builds without optimisation have large frames.
#[test]
fn c3_nesting_up_to_the_limit_fits_a_small_stack() {
    for plugin in ["twosided", "mask", "bumpmap", "normalmap", "blendbsdf"] {
        let open = format!("<bsdf type='{plugin}'>");
        let nested = format!("{}<bsdf type='diffuse'/>{}", open.repeat(254), "</bsdf>".repeat(254));
        let case = Case::new(&nested);
        let load = move || twopass::load::load_scene(&case.path("scene.xml"), &Default::default()).map(|_| ());
        let thread = std::thread::Builder::new().stack_size(1 << 20).spawn(load).expect("a thread");
        // Some materials may hold another so deep, some may not; what counts is that there is an answer.
        let _ = thread.join().expect("no overflow");
    }
}

#[test]
fn c4_includes_end_in_depth_and_in_number() {
    let include = |name: &str| format!("<scene version='3.0.0'>\n<include filename='{name}'/></scene>");
    Case::whole(include("scene.xml")).refused(3, &["scene.xml:2:1", "contains itself"]);
    Case::whole(include("b.xml")).with("b.xml", include("scene.xml")).refused(3, &["b.xml:2:1", "contains itself"]);
    let chain =
        (1..=20).fold(Case::whole(include("1.xml")), |c, i| c.with(&format!("{i}.xml"), include(&format!("{}.xml", i + 1))));
    chain.refused(4, &["15.xml:2:1", "depth of includes", "limit of 15"]);
    // Each file includes the next twice, or ten times: 2^14 and 10^14 inclusions, were they all made.
    for n in [2, 10] {
        let line = |i: usize| format!("<include filename='{}.xml'/>", i + 1).repeat(n);
        let fan = (0..14).fold(Case::whole(""), |case, i| {
            let name = if i == 0 { "scene.xml".to_owned() } else { format!("{i}.xml") };
            case.with(&name, format!("<scene version='3.0.0'>{}</scene>", line(i)))
        });
        fan.with("14.xml", "<scene version='3.0.0'></scene>").refused(4, &[".xml:1:", "number of includes", "limit of 1000"]);
    }
    // Few but large: the bytes of all of them count.
    let part = format!("<scene version='3.0.0'><!--{}--></scene>", "x".repeat(1 << 20));
    let many = "<include filename='part.xml'/>".repeat(70);
    Case::whole(format!("<scene version='3.0.0'>{many}</scene>"))
        .with("part.xml", part)
        .refused(4, &["part.xml", "size of", "bytes"]);
}

#[test]
fn c5_paths_stay_in_the_folder_unless_allowed() {
    let outside = TempDir::new().expect("a folder");
    let secret = outside.path().join("secret.obj");
    std::fs::write(&secret, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n# classified\n").expect("written");
    let absolute = secret.to_string_lossy().into_owned();
    let up = format!("../{}/secret.obj", outside.path().file_name().expect("a name").to_string_lossy());
    let allow = format!("info scene.xml --threads 2 --allow-path {}", outside.path().display());
    for name in [absolute.as_str(), &up, "link.obj", "folder/secret.obj"] {
        let case = Case::new(&mesh_shape(name));
        std::os::unix::fs::symlink(&secret, case.path("link.obj")).expect("linked");
        std::os::unix::fs::symlink(outside.path(), case.path("folder")).expect("linked");
        let err = case.refused(3, &["scene.xml:3:", "outside the scene's folder"]);
        assert!(!err.contains("classified"), "{err}");
        case.run(0, &allow);
    }
    // Links inside the folder lead where they lead; allowing one folder opens no other.
    let inside = Case::new(&mesh_shape("link.obj")).with("m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    std::os::unix::fs::symlink("m.obj", inside.path("link.obj")).expect("linked");
    inside.accepted();
    for name in ["../../../../../../../../etc/passwd", "/etc/passwd"] {
        for body in [mesh_shape("m.obj").replace("m.obj", name), format!("<include filename='{name}'/>")] {
            let (_, err) = Case::new(&body).run(3, &allow);
            assert_words(&err, &["scene.xml:3:", "etc/passwd", "outside the scene's folder"], name);
            assert!(!err.contains("root:"), "{err}");
        }
    }
    // A folder that only begins like an allowed one.
    let case = Case::new(&mesh_shape(&absolute));
    let (_, err) = case.run(3, &format!("info scene.xml --allow-path {}", case.path("").display()));
    assert_words(&err, &["outside"], "another folder");
    let (_, err) = case.run(3, "info scene.xml --allow-path nowhere");
    assert_words(&err, &["nowhere"], "a folder that does not exist");
}

#[test]
fn c6_missing_and_strange_files_are_named() {
    let (_, err) = Case::whole("").run(3, "info none.xml");
    assert_words(&err, &["none.xml", "cannot read"], "scene");
    Case::new(&mesh_shape("none.obj")).refused(3, &["scene.xml:3:19", "none.obj", "cannot read"]);
    Case::new("<include filename='none.xml'/>").refused(3, &["scene.xml:3:10", "none.xml"]);
    let case = Case::new(&mesh_shape("m.obj"));
    std::os::unix::fs::symlink("m.obj", case.path("m.obj")).expect("linked");
    case.refused(3, &["scene.xml:3:19", "m.obj"]);
    // A pipe that nobody writes to: opening it would wait for ever.
    let case = Case::new(&mesh_shape("m.ply"));
    nix::unistd::mkfifo(&case.path("m.ply"), nix::sys::stat::Mode::S_IRUSR).expect("a pipe");
    case.refused(3, &["scene.xml:3:19", "m.ply", "not a regular file"]);
    let (_, err) = case.run(3, "info /dev/zero");
    assert_words(&err, &["/dev/zero", "not a regular file"], "device");
}

#[test]
fn c7_unknown_names_come_with_the_near_ones() {
    for (body, words) in [
        ("<shape type='sphear'/>", ["scene.xml:3:1", "sphear", "sphere"]),
        ("<bsdf type='difuse'/>", ["scene.xml:3:1", "difuse", "diffuse"]),
        ("\n<shape type='sphere'><float name='raduis' value='1'/></shape>", ["scene.xml:4:22", "raduis", "radius"]),
        ("<shape type='cube'><floaf name='x' value='1'/></shape>", ["scene.xml:3:20", "floaf", "float"]),
        ("<shape type='cube' colour='red'/>", ["scene.xml:3:20", "colour", "shape"]),
        ("<shape type='cube'><ref id='red'/></shape><bsdf type='diffuse' id='rde'/>", ["scene.xml:3:20", "red", "rde"]),
    ] {
        Case::new(body).refused(3, &words);
    }
}

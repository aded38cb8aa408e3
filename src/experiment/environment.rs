//! The machine and the versions under which an experiment was measured.

use std::collections::BTreeMap;
use std::fs::read_to_string;
use std::time::SystemTime;

/// Version and commit of this program.
pub fn program() -> String {
    format!("twopass {} ({})", env!("CARGO_PKG_VERSION"), env!("TWOPASS_COMMIT"))
}

/// What is known of the machine, by name.
pub fn describe(threads: usize) -> BTreeMap<String, String> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = if threads == 0 { cores } else { threads };
    let unknown = || "unknown".to_owned();
    let entries = [
        ("cpu", cpu_model().unwrap_or_else(unknown)),
        ("cores", cores.to_string()),
        ("threads", threads.to_string()),
        ("memory", memory().unwrap_or_else(unknown)),
        ("os", operating_system().unwrap_or_else(|| std::env::consts::OS.to_owned())),
        ("kernel", read_to_string("/proc/sys/kernel/osrelease").map_or_else(|_| unknown(), |s| s.trim().to_owned())),
        ("architecture", std::env::consts::ARCH.to_owned()),
        ("program", program()),
        ("date", humantime::format_rfc3339_seconds(SystemTime::now()).to_string()),
        ("load_average", load_average().to_string()),
    ];
    entries.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

/// Load average of the last minute; 0 if the system does not tell.
pub fn load_average() -> f64 {
    let text = read_to_string("/proc/loadavg").unwrap_or_default();
    text.split(' ').next().and_then(|v| v.parse().ok()).unwrap_or(0.0)
}

fn cpu_model() -> Option<String> {
    let text = read_to_string("/proc/cpuinfo").ok()?;
    value_of(&text, "model name", ':')
}

fn memory() -> Option<String> {
    let text = read_to_string("/proc/meminfo").ok()?;
    let kib: f64 = value_of(&text, "MemTotal", ':')?.trim_end_matches(" kB").parse().ok()?;
    Some(format!("{:.1} GiB", kib / 1024.0 / 1024.0))
}

fn operating_system() -> Option<String> {
    let text = read_to_string("/etc/os-release").ok()?;
    Some(value_of(&text, "PRETTY_NAME", '=')?.trim_matches('"').to_owned())
}

/// The value of the first line that begins with `name`.
fn value_of(text: &str, name: &str, separator: char) -> Option<String> {
    let line = text.lines().find(|line| line.starts_with(name))?;
    Some(line.split_once(separator)?.1.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_machine_has_a_name() {
        let all = describe(3);
        assert_eq!(all["threads"], "3");
        assert!(all["date"].starts_with("20") && all["date"].ends_with('Z'), "{}", all["date"]);
        assert!(all["program"].starts_with("twopass "), "{}", all["program"]);
        assert_eq!(value_of("a: 1\nmodel name\t: Z 80\n", "model name", ':').as_deref(), Some("Z 80"));
    }
}

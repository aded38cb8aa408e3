//! A process that is timed, limited and never left behind.

use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::signal::{Signal, killpg};
use nix::sys::time::TimeValLike;
use nix::unistd::Pid;
use std::fs::File;
use std::io;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

/// How often a waiting experiment looks whether it was asked to stop.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Longest part of a process's last words that a row keeps, in characters.
const LONGEST_MESSAGE: usize = 300;

/// How a process ended.
#[derive(Debug)]
pub struct Ended {
    /// Why.
    pub how: How,
    /// Seconds from its start to its end.
    pub wall_s: f64,
    /// CPU seconds of it and of those processes of its own for which it waited.
    pub cpu_s: f64,
    /// The last lines that it wrote.
    pub last_words: String,
}

/// Why a process ended.
#[derive(Debug, PartialEq, Eq)]
pub enum How {
    /// By itself, with success.
    Well,
    /// By itself with this exit code, or by a signal.
    Badly(String),
    /// Killed after its time limit.
    TimedOut,
    /// Killed because the experiment was asked to stop.
    Stopped,
}

/// Runs a process to its end, alone in a process group, which is killed as a whole when the limit is over or `stopped` says so. What it
/// writes goes to the file `log`; `started` hears its number.
///
/// # Errors
/// If the process cannot be started.
pub fn run(
    command: &mut Command,
    limit: Duration,
    log: &Path,
    started: impl FnOnce(u32),
    stopped: &dyn Fn() -> bool,
) -> io::Result<Ended> {
    let words = File::create(log)?;
    command.stdin(Stdio::null()).stdout(words.try_clone()?).stderr(words).process_group(0);
    let (cpu_before, begin) = (cpu_of_children(), Instant::now());
    let mut child = command.spawn()?;
    let group = Pid::from_raw(child.id() as i32);
    started(child.id());
    let (sender, receiver) = mpsc::channel();
    // A thread that waits sees the end at once and costs nothing meanwhile.
    let waiter = std::thread::spawn(move || {
        let status = child.wait();
        let _ = sender.send((Instant::now(), status));
    });
    let mut killed = None;
    let (end, status) = loop {
        match receiver.recv_timeout(LOOK_EVERY.min(limit)) {
            Ok(ended) => break ended,
            Err(_) if killed.is_some() => {}
            Err(_) if stopped() => killed = kill(group, How::Stopped),
            Err(_) if begin.elapsed() >= limit => killed = kill(group, How::TimedOut),
            Err(_) => {}
        }
    };
    let _ = waiter.join();
    // Whatever it left running in its group would disturb the next one. That there is nothing is the rule.
    let _ = killpg(group, Signal::SIGKILL);
    let how = match killed {
        Some(how) => how,
        None => verdict(status?),
    };
    Ok(Ended { how, wall_s: (end - begin).as_secs_f64(), cpu_s: cpu_of_children() - cpu_before, last_words: last_words(log) })
}

fn kill(group: Pid, how: How) -> Option<How> {
    let _ = killpg(group, Signal::SIGKILL);
    Some(how)
}

fn verdict(status: ExitStatus) -> How {
    match (status.success(), status.code(), status.signal()) {
        (true, ..) => How::Well,
        (_, Some(code), _) => How::Badly(format!("exit code {code}")),
        (_, None, signal) => How::Badly(format!("killed by signal {}", signal.unwrap_or(0))),
    }
}

/// CPU seconds of all processes that were waited for so far. Runs follow each other, so a difference belongs to one of them.
fn cpu_of_children() -> f64 {
    let seconds = |time: nix::sys::time::TimeVal| time.num_microseconds() as f64 * 1e-6;
    getrusage(UsageWho::RUSAGE_CHILDREN).map_or(0.0, |u| seconds(u.user_time()) + seconds(u.system_time()))
}

/// The end of a log, as one line.
fn last_words(log: &Path) -> String {
    let bytes = std::fs::read(log).unwrap_or_default();
    let text = String::from_utf8_lossy(&bytes[bytes.len().saturating_sub(4096)..]).into_owned();
    let lines: Vec<&str> = text.lines().map(|l| l.trim().trim_start_matches('×').trim()).filter(|l| !l.is_empty()).collect();
    let line = lines[lines.len().saturating_sub(3)..].join(" / ");
    let skip = line.chars().count().saturating_sub(LONGEST_MESSAGE);
    line.chars().skip(skip).collect()
}

/// A process by number and the moment of its start, so that a number that was given anew is not mistaken for it.
pub fn identity(pid: u32) -> Option<String> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name in parentheses may hold anything; the start is the 20th field after it (proc(5), field 22).
    let started = stat.rsplit_once(')')?.1.split_whitespace().nth(19)?;
    Some(format!("{pid} {started}"))
}

/// Kills the group of a process that an experiment left behind when it was killed itself.
pub fn kill_left_behind(identity_then: &str) {
    let pid = identity_then.split(' ').next().and_then(|pid| pid.parse::<u32>().ok());
    if let Some(pid) = pid.filter(|pid| identity(*pid).as_deref() == Some(identity_then)) {
        let _ = killpg(Pid::from_raw(pid as i32), Signal::SIGKILL);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str, limit: f64, stopped: bool) -> Ended {
        let folder = tempfile::tempdir().unwrap();
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        run(&mut command, Duration::from_secs_f64(limit), &folder.path().join("log"), |_| {}, &|| stopped).unwrap()
    }

    #[test]
    fn the_way_it_ended_is_told_with_its_last_words() {
        assert_eq!(shell("exit 0", 10.0, false).how, How::Well);
        let ended = shell("echo first; echo second >&2; exit 3", 10.0, false);
        assert_eq!((ended.how, ended.last_words.as_str()), (How::Badly("exit code 3".into()), "first / second"));
        assert_eq!(shell("kill -9 $$", 10.0, false).how, How::Badly("killed by signal 9".into()));
        assert_eq!(shell("sleep 60", 10.0, true).how, How::Stopped);
    }

    /// A grandchild in the same group dies with it, and the end does not wait for it.
    #[test]
    fn the_time_limit_takes_the_whole_group() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("pid");
        let ended = shell(&format!("sleep 60 & echo $! > {}; wait", file.display()), 0.5, false);
        assert_eq!(ended.how, How::TimedOut);
        assert!(ended.wall_s < 10.0, "{}", ended.wall_s);
        let pid: u32 = std::fs::read_to_string(&file).unwrap().trim().parse().unwrap();
        // Whoever inherits it may take a moment to see its end; a zombie is dead.
        let lives = || std::fs::read_to_string(format!("/proc/{pid}/stat")).is_ok_and(|s| !s.contains(") Z"));
        let begin = Instant::now();
        while lives() && begin.elapsed() < Duration::from_secs(5) {
            std::thread::sleep(Duration::from_millis(20));
        }
        assert!(!lives(), "the grandchild lives");
    }

    #[test]
    fn a_number_given_anew_is_another_process() {
        let mut child = Command::new("sleep").arg("60").process_group(0).spawn().unwrap();
        let named = identity(child.id()).unwrap();
        kill_left_behind(&format!("{} 1", child.id()));
        assert!(child.try_wait().unwrap().is_none());
        kill_left_behind(&named);
        assert_eq!(child.wait().unwrap().signal(), Some(9));
    }
}

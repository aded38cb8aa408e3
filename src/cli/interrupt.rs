//! Ctrl-C and SIGTERM: the first one asks the run to stop, a second one ends the program at once.

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// A signal that stops a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// Ctrl-C.
    Interrupt,
    /// A polite kill.
    Terminate,
}

impl Signal {
    /// 128 plus the signal's number, as shells expect.
    pub fn exit_code(self) -> u8 {
        match self {
            Signal::Interrupt => 130,
            Signal::Terminate => 143,
        }
    }

    /// In words.
    pub fn describe(self) -> &'static str {
        match self {
            Signal::Interrupt => "interrupted",
            Signal::Terminate => "terminated",
        }
    }

    fn number(self) -> i32 {
        match self {
            Signal::Interrupt => SIGINT,
            Signal::Terminate => SIGTERM,
        }
    }
}

/// Remembers the first signal that arrived.
#[derive(Debug, Clone, Default)]
pub struct Interrupt {
    received: Arc<AtomicUsize>,
}

impl Interrupt {
    /// Listens from now on. If the system refuses, signals end the program as usual.
    pub fn listen() -> Self {
        let interrupt = Self::default();
        for signal in [Signal::Interrupt, Signal::Terminate] {
            let (number, seen) = (signal.number(), Arc::new(AtomicBool::new(false)));
            // Handlers run in the order of registration: the second signal finds the flag that the first one set.
            let _ = flag::register_conditional_shutdown(number, signal.exit_code().into(), Arc::clone(&seen));
            let _ = flag::register(number, seen);
            let _ = flag::register_usize(number, Arc::clone(&interrupt.received), number as usize);
        }
        interrupt
    }

    /// The signal that asked to stop, if one did.
    pub fn signal(&self) -> Option<Signal> {
        let number = self.received.load(Ordering::Relaxed);
        [Signal::Interrupt, Signal::Terminate].into_iter().find(|s| s.number() as usize == number)
    }
}

//! Decoders that may panic on hostile bytes.

use std::cell::Cell;
use std::panic::{UnwindSafe, catch_unwind};

thread_local! {
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// Runs a decoder; `None` if it panics. It must do all its work on this thread: a panic in a pool's thread ends the program.
pub fn guarded<T>(decode: impl FnOnce() -> T + UnwindSafe) -> Option<T> {
    let outer = GUARDED.replace(true);
    let result = catch_unwind(decode);
    GUARDED.set(outer);
    result.ok()
}

/// True on a thread inside [`guarded`]: a panic there becomes an error with a message of its own, so that a panic hook can keep
/// silent.
pub fn in_guarded_decoder() -> bool {
    GUARDED.get()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_nothing_and_the_mark_is_taken_back() {
        assert_eq!(guarded(|| 7), Some(7));
        assert!(
            guarded(|| assert!(in_guarded_decoder() && guarded::<()>(|| panic!("inner")).is_none() && in_guarded_decoder()))
                .is_some()
        );
        assert!(guarded::<()>(|| panic!("as it should")).is_none());
        assert!(!in_guarded_decoder());
    }
}

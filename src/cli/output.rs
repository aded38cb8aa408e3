//! What the program says: results on stdout, talk on stderr.

use super::args::Common;
use super::exit::Failure;
use std::io::{ErrorKind, Write};

/// Prints a result. A reader that has gone away (`| head`) is no failure.
pub fn print(text: &str) -> Result<(), Failure> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Failure::Stdout(error)),
        _ => Ok(()),
    }
}

/// Says something on stderr unless asked to be quiet. Whether anyone listens does not matter.
pub fn say(common: &Common, text: &str) {
    if !common.quiet {
        let _ = writeln!(std::io::stderr(), "{text}");
    }
}

/// A number for people and scripts: 0 as such, others with seven digits.
pub fn number(value: f64) -> String {
    if value == 0.0 { "0".to_owned() } else { format!("{value:.6e}") }
}

/// A number for people: six digits, without an exponent where it is short.
pub fn short(value: f64) -> String {
    format!("{value:.5e}").parse::<f64>().map_or_else(|_| value.to_string(), |v| v.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_but_exact_enough() {
        assert_eq!((number(0.0).as_str(), number(-0.5).as_str()), ("0", "-5.000000e-1"));
        assert_eq!((short(0.1 + 0.2).as_str(), short(12345678.0).as_str(), short(f64::NAN).as_str()), ("0.3", "12345700", "NaN"));
    }
}

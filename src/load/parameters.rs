//! `$name` in attribute values: defaults from the file, overridden from the command line.

use super::error::{LoadErrorKind, near};
use std::cell::Cell;
use std::collections::BTreeMap;

/// Parameters that have a value so far.
#[derive(Debug)]
pub(super) struct Parameters {
    known: BTreeMap<String, Parameter>,
    /// Bytes that all replacements together may still make: values that contain values grow without bound.
    left: Cell<u64>,
    limit: u64,
}

#[derive(Debug)]
struct Parameter {
    value: String,
    /// The scene mentions it.
    used: Cell<bool>,
    given: bool,
}

impl Parameters {
    /// Parameters given on the command line, of which the last of equal names counts; and a limit on the bytes made.
    pub fn new(defines: &[(String, String)], limit: u64) -> Self {
        let parameter = |value: &String| Parameter { value: value.clone(), used: Cell::new(false), given: true };
        let known = defines.iter().map(|(name, value)| (name.clone(), parameter(value))).collect();
        Self { known, left: Cell::new(limit), limit }
    }

    /// `<default>`: a value unless there is one.
    pub fn default(&mut self, name: String, value: String) {
        let new = || Parameter { value, used: Cell::new(true), given: false };
        self.known.entry(name).or_insert_with(new).used.set(true);
    }

    /// `text` with every `$name` replaced. The name is the longest run of letters, digits and underscores.
    pub fn substitute(&self, text: &str) -> Result<String, LoadErrorKind> {
        let mut pieces = text.split('$');
        let mut result = pieces.next().unwrap_or_default().to_owned();
        for piece in pieces {
            let end = piece.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(piece.len());
            let (name, rest) = piece.split_at(end);
            let parameter = self.known.get(name).ok_or_else(|| self.undefined(name))?;
            parameter.used.set(true);
            self.spend(parameter.value.len() as u64)?;
            result.push_str(&parameter.value);
            result.push_str(rest);
        }
        Ok(result)
    }

    /// An error if the command line gave a parameter that the scene does not have.
    pub fn all_used(&self) -> Result<(), LoadErrorKind> {
        match self.known.iter().find(|(_, p)| !p.used.get()) {
            None => Ok(()),
            Some((name, _)) => Err(LoadErrorKind::UnusedDefine { name: name.clone(), near: near(name, self.names(false)) }),
        }
    }

    fn spend(&self, bytes: u64) -> Result<(), LoadErrorKind> {
        let over = || LoadErrorKind::OverLimit {
            what: "bytes that replace parameters".to_owned(),
            limit: self.limit,
            found: self.limit - self.left.get() + bytes,
        };
        self.left.set(self.left.get().checked_sub(bytes).ok_or_else(over)?);
        Ok(())
    }

    fn undefined(&self, name: &str) -> LoadErrorKind {
        LoadErrorKind::UndefinedParameter { name: name.to_owned(), near: near(name, self.names(true)) }
    }

    fn names(&self, given_too: bool) -> impl Iterator<Item = &str> {
        self.known.iter().filter(move |(_, p)| given_too || !p.given || p.used.get()).map(|(name, _)| name.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn given_values_override_defaults_and_must_be_used() {
        let define = |n: &str, v: &str| (n.to_owned(), v.to_owned());
        let mut p = Parameters::new(&[define("a", "1"), define("a", "2"), define("b", "3")], 100);
        p.default("a".to_owned(), "9".to_owned());
        p.default("c".to_owned(), "4".to_owned());
        assert_eq!(p.substitute("x$a,$c$c y").expect("known"), "x2,44 y");
        assert!(matches!(p.substitute("$ab"), Err(LoadErrorKind::UndefinedParameter { name, .. }) if name == "ab"));
        assert!(matches!(p.all_used(), Err(LoadErrorKind::UnusedDefine { name, .. }) if name == "b"));
        p.substitute("$b").expect("known");
        assert!(p.all_used().is_ok());
    }

    #[test]
    fn values_within_values_are_bounded() {
        let mut p = Parameters::new(&[], 1000);
        p.default("a".to_owned(), "ha".to_owned());
        let error = (0..10).find_map(|_| match p.substitute("$a$a$a$a") {
            Ok(value) => {
                p.known.clear();
                p.default("a".to_owned(), value);
                None
            }
            Err(error) => Some(error),
        });
        assert!(matches!(error, Some(LoadErrorKind::OverLimit { limit: 1000, .. })), "{error:?}");
    }
}

//! `$name` in attribute values: defaults from the file, overridden from the command line.

use super::error::{LoadErrorKind, near};
use std::cell::Cell;

/// Parameters that have a value so far.
#[derive(Debug)]
pub(super) struct Parameters {
    known: Vec<Parameter>,
}

#[derive(Debug)]
struct Parameter {
    name: String,
    value: String,
    /// The scene mentions it.
    used: Cell<bool>,
    given: bool,
}

impl Parameters {
    /// Parameters given on the command line; the last of equal names counts.
    pub fn new(defines: &[(String, String)]) -> Self {
        let mut known: Vec<Parameter> = Vec::new();
        for (name, value) in defines {
            known.retain(|p| p.name != *name);
            known.push(Parameter { name: name.clone(), value: value.clone(), used: Cell::new(false), given: true });
        }
        Self { known }
    }

    /// `<default>`: a value unless there is one.
    pub fn default(&mut self, name: String, value: String) {
        match self.known.iter().find(|p| p.name == name) {
            Some(parameter) => parameter.used.set(true),
            None => self.known.push(Parameter { name, value, used: Cell::new(true), given: false }),
        }
    }

    /// `text` with every `$name` replaced. The name is the longest run of letters, digits and underscores.
    pub fn substitute(&self, text: &str) -> Result<String, LoadErrorKind> {
        let mut pieces = text.split('$');
        let mut result = pieces.next().unwrap_or_default().to_owned();
        for piece in pieces {
            let end = piece.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(piece.len());
            let (name, rest) = piece.split_at(end);
            let parameter = self.known.iter().find(|p| p.name == name).ok_or_else(|| self.undefined(name))?;
            parameter.used.set(true);
            result.push_str(&parameter.value);
            result.push_str(rest);
        }
        Ok(result)
    }

    /// An error if the command line gave a parameter that the scene does not have.
    pub fn all_used(&self) -> Result<(), LoadErrorKind> {
        match self.known.iter().find(|p| !p.used.get()) {
            None => Ok(()),
            Some(p) => Err(LoadErrorKind::UnusedDefine { name: p.name.clone(), near: near(&p.name, self.names(false)) }),
        }
    }

    fn undefined(&self, name: &str) -> LoadErrorKind {
        LoadErrorKind::UndefinedParameter { name: name.to_owned(), near: near(name, self.names(true)) }
    }

    fn names(&self, given_too: bool) -> impl Iterator<Item = &str> {
        self.known.iter().filter(move |p| given_too || !p.given || p.used.get()).map(|p| p.name.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn given_values_override_defaults_and_must_be_used() {
        let define = |n: &str, v: &str| (n.to_owned(), v.to_owned());
        let mut p = Parameters::new(&[define("a", "1"), define("a", "2"), define("b", "3")]);
        p.default("a".to_owned(), "9".to_owned());
        p.default("c".to_owned(), "4".to_owned());
        assert_eq!(p.substitute("x$a,$c$c y").expect("known"), "x2,44 y");
        assert!(matches!(p.substitute("$ab"), Err(LoadErrorKind::UndefinedParameter { name, .. }) if name == "ab"));
        assert!(matches!(p.all_used(), Err(LoadErrorKind::UnusedDefine { name, .. }) if name == "b"));
        p.substitute("$b").expect("known");
        assert!(p.all_used().is_ok());
    }
}

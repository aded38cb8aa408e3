//! A TOML table read key by key: every value knows its line, and what nobody asked for is refused.

use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// What is wrong in a plan, and on which line (from 1).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// The line.
    pub line: usize,
    /// What is wrong there and what was expected.
    pub detail: String,
}

impl Fault {
    /// A fault on a line.
    pub fn new(line: usize, detail: impl Into<String>) -> Self {
        Self { line, detail: detail.into() }
    }
}

/// Line of a byte of the text, from 1.
pub fn line_of(text: &str, byte: usize) -> usize {
    1 + text.as_bytes().iter().take(byte).filter(|b| **b == b'\n').count()
}

/// A value with its key and line.
#[derive(Clone)]
pub struct Field<'t> {
    text: &'t str,
    /// The key.
    pub key: String,
    /// The line of the value.
    pub line: usize,
    value: &'t DeValue<'t>,
}

/// A table of which entries are taken one by one.
pub struct Table<'t> {
    /// What it describes, for messages: `[[scene]]`.
    what: String,
    /// Line of its beginning.
    pub line: usize,
    entries: Vec<Field<'t>>,
}

impl<'t> Table<'t> {
    /// The table `what`, which begins at `line`.
    pub fn new(text: &'t str, what: &str, line: usize, table: &'t DeTable<'t>) -> Self {
        let field = |(key, value): (&'t Spanned<_>, &'t Spanned<DeValue<'t>>)| {
            let key: &std::borrow::Cow<'_, str> = key.get_ref();
            Field { text, key: key.to_string(), line: line_of(text, value.span().start), value: value.get_ref() }
        };
        Self { what: what.to_owned(), line, entries: table.iter().map(field).collect() }
    }

    /// Takes an entry out.
    pub fn take(&mut self, key: &str) -> Option<Field<'t>> {
        let at = self.entries.iter().position(|field| field.key == key)?;
        Some(self.entries.remove(at))
    }

    /// Takes an entry and reads it.
    pub fn read<T>(&mut self, key: &str, read: impl FnOnce(&Field<'t>) -> Result<T, Fault>) -> Result<Option<T>, Fault> {
        self.take(key).map(|field| read(&field)).transpose()
    }

    /// Takes an entry that must be there.
    pub fn need<T>(&mut self, key: &str, read: impl FnOnce(&Field<'t>) -> Result<T, Fault>) -> Result<T, Fault> {
        match self.take(key) {
            Some(field) => read(&field),
            None => Err(Fault::new(self.line, format!("{} has no {key}", self.what))),
        }
    }

    /// Entries that nobody has taken.
    pub fn rest(self) -> Vec<Field<'t>> {
        self.entries
    }

    /// Refuses entries that nobody has taken; `known` are those that may stand here.
    pub fn finish(self, known: &[&str]) -> Result<(), Fault> {
        match self.entries.first() {
            None => Ok(()),
            Some(field) => {
                let known = known.join(", ");
                Err(Fault::new(field.line, format!("{} knows no \"{}\"; expected one of {known}", self.what, field.key)))
            }
        }
    }
}

impl<'t> Field<'t> {
    /// A fault of this value.
    pub fn expected(&self, what: &str) -> Fault {
        Fault::new(self.line, format!("{}: expected {what}, found {}", self.key, describe(self.value)))
    }

    /// A text that is not empty.
    pub fn text(&self) -> Result<String, Fault> {
        match self.value {
            DeValue::String(text) if !text.trim().is_empty() => Ok(text.to_string()),
            _ => Err(self.expected("a text")),
        }
    }

    /// A finite number above 0.
    pub fn positive(&self) -> Result<f64, Fault> {
        let number = match self.value {
            DeValue::Integer(n) if n.radix() == 10 => n.as_str().parse::<f64>().ok(),
            DeValue::Float(n) => n.as_str().parse::<f64>().ok(),
            _ => None,
        };
        number.filter(|n| n.is_finite() && *n > 0.0).ok_or_else(|| self.expected("a number above 0"))
    }

    /// A whole number of at least `least`.
    pub fn whole(&self, least: u64) -> Result<u64, Fault> {
        let number = match self.value {
            DeValue::Integer(n) => u64::from_str_radix(n.as_str(), n.radix()).ok(),
            _ => None,
        };
        number.filter(|n| *n >= least).ok_or_else(|| self.expected(&format!("a whole number of {least} or more")))
    }

    /// The same, of 32 bits.
    pub fn count(&self) -> Result<u32, Fault> {
        u32::try_from(self.whole(1)?).map_err(|_| self.expected("a whole number of 32 bits"))
    }

    /// True or false.
    pub fn truth(&self) -> Result<bool, Fault> {
        match self.value {
            DeValue::Boolean(value) => Ok(*value),
            _ => Err(self.expected("true or false")),
        }
    }

    /// A value as it would be typed on a command line: text, number or truth.
    pub fn word(&self) -> Result<String, Fault> {
        match self.value {
            DeValue::String(text) => Ok(text.to_string()),
            DeValue::Integer(n) => Ok(n.to_string()),
            DeValue::Float(n) => Ok(n.as_str().to_owned()),
            DeValue::Boolean(value) => Ok(value.to_string()),
            _ => Err(self.expected("a text or a number")),
        }
    }

    /// A list of at least one value.
    pub fn list<T>(&self, read: impl Fn(&Field<'t>) -> Result<T, Fault>) -> Result<Vec<T>, Fault> {
        match self.value {
            DeValue::Array(values) if !values.is_empty() => values.iter().map(|v| read(&self.item(v))).collect(),
            _ => Err(self.expected("a list of at least one value")),
        }
    }

    /// A list, or a single value as a list of one.
    pub fn one_or_more<T>(&self, read: impl Fn(&Field<'t>) -> Result<T, Fault>) -> Result<Vec<T>, Fault> {
        match self.value {
            DeValue::Array(_) => self.list(read),
            _ => Ok(vec![read(self)?]),
        }
    }

    /// An ascending list of numbers above 0.
    pub fn ascending(&self) -> Result<Vec<f64>, Fault> {
        let numbers = self.list(Field::positive)?;
        if numbers.windows(2).all(|pair| pair[0] < pair[1]) { Ok(numbers) } else { Err(self.expected("ascending numbers")) }
    }

    /// A table.
    pub fn table(&self, what: &str) -> Result<Table<'t>, Fault> {
        match self.value {
            DeValue::Table(table) => Ok(Table::new(self.text, what, self.line, table)),
            _ => Err(self.expected(&format!("a table, as {what}"))),
        }
    }

    fn item(&self, value: &'t Spanned<DeValue<'t>>) -> Field<'t> {
        let line = line_of(self.text, value.span().start);
        Field { text: self.text, key: self.key.clone(), line, value: value.get_ref() }
    }
}

fn describe(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("the text \"{text}\""),
        DeValue::Integer(n) => format!("the number {n}"),
        DeValue::Float(n) => format!("the number {n}"),
        DeValue::Boolean(value) => value.to_string(),
        DeValue::Datetime(_) => "a date".to_owned(),
        DeValue::Array(values) if values.is_empty() => "an empty list".to_owned(),
        DeValue::Array(_) => "a list".to_owned(),
        DeValue::Table(_) => "a table".to_owned(),
    }
}

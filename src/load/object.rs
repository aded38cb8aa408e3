//! Objects of a scene file: typed properties that know their place, and know whether somebody asked for them.

use super::error::{LoadError, LoadErrorKind, Place, near};
use crate::math::{DAffine3, DVec3, Rgb};
use std::cell::{Cell, RefCell};
use std::collections::HashMap;

/// Kind of an object: the XML element's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Class(pub &'static str);

impl Class {
    pub const SCENE: Class = Class("scene");
    pub const INTEGRATOR: Class = Class("integrator");
    pub const SENSOR: Class = Class("sensor");
    pub const FILM: Class = Class("film");
    pub const RFILTER: Class = Class("rfilter");
    pub const SAMPLER: Class = Class("sampler");
    pub const SHAPE: Class = Class("shape");
    pub const BSDF: Class = Class("bsdf");
    pub const TEXTURE: Class = Class("texture");
    pub const EMITTER: Class = Class("emitter");
    /// A spectrum by a model; one by its value is no object.
    pub const SPECTRUM: Class = Class("spectrum");

    /// All elements that are objects.
    pub const ALL: [Class; 13] = [
        Self::SCENE,
        Self::INTEGRATOR,
        Self::SENSOR,
        Self::FILM,
        Self::RFILTER,
        Self::SAMPLER,
        Self::SHAPE,
        Self::BSDF,
        Self::TEXTURE,
        Self::EMITTER,
        Self::SPECTRUM,
        Class("medium"),
        Class("phase"),
    ];
}

/// One object with its properties.
#[derive(Debug)]
pub(super) struct Object {
    pub class: Class,
    /// Its `type`.
    pub plugin: String,
    pub id: Option<String>,
    pub place: Place,
    pub properties: Vec<Property>,
    /// Names that were asked for, to help with a misspelt one.
    asked: RefCell<Vec<&'static str>>,
}

/// A property: named, unless it is a child object or a reference.
#[derive(Debug)]
pub(super) struct Property {
    pub name: String,
    pub value: Value,
    pub place: Place,
    pub used: Cell<bool>,
}

/// A property's value.
#[derive(Debug)]
pub(super) enum Value {
    Integer(i64),
    Float(f64),
    Boolean(bool),
    Text(String),
    /// `<rgb>`: linear sRGB.
    Rgb(Rgb),
    /// `<spectrum>` that is the same at all wavelengths.
    Uniform(f64),
    /// `<spectrum>` by values at growing wavelengths [nm].
    Spectrum(Vec<(f64, f64)>),
    /// `<point>` or `<vector>`.
    Point(DVec3),
    Transform(DAffine3),
    Object(Object),
    /// `<ref>`: an id.
    Reference(String),
}

/// A value and where it was written.
#[derive(Debug, Clone)]
pub(super) struct At<T> {
    pub value: T,
    pub place: Place,
}

/// Objects by id.
pub(super) type Ids<'a> = HashMap<&'a str, &'a Object>;

impl Property {
    pub fn new(name: String, value: Value, place: Place) -> Self {
        Self { name, value, place, used: Cell::new(false) }
    }

    /// The error that this property must be `expected`.
    pub fn must_be(&self, expected: &str) -> LoadError {
        let (name, expected, found) = (self.name.clone(), expected.to_owned(), self.value.describe());
        self.place.error(LoadErrorKind::Value { name, expected, found })
    }
}

impl Value {
    pub fn describe(&self) -> String {
        match self {
            Value::Integer(v) => v.to_string(),
            Value::Float(v) => v.to_string(),
            Value::Boolean(v) => v.to_string(),
            Value::Text(v) => format!("\"{v}\""),
            Value::Rgb(c) => format!("rgb {}, {}, {}", c.r, c.g, c.b),
            Value::Uniform(v) => format!("spectrum {v}"),
            Value::Spectrum(samples) => format!("a spectrum of {} wavelengths", samples.len()),
            Value::Point(p) => format!("point {}, {}, {}", p.x, p.y, p.z),
            Value::Transform(_) => "a transform".to_owned(),
            Value::Object(o) => o.describe(),
            Value::Reference(id) => format!("a reference to \"{id}\""),
        }
    }
}

impl Object {
    pub fn new(class: Class, plugin: String, id: Option<String>, place: Place) -> Self {
        Self { class, plugin, id, place, properties: Vec::new(), asked: RefCell::default() }
    }

    /// What the object is, for messages.
    pub fn describe(&self) -> String {
        match (&self.id, self.class == Class::SCENE) {
            (_, true) => "the scene".to_owned(),
            (Some(id), _) => format!("{} \"{id}\" ({})", self.class.0, self.plugin),
            (None, _) => format!("{} \"{}\"", self.class.0, self.plugin),
        }
    }

    /// The property `name`, which counts as used from now on.
    pub fn get(&self, name: &'static str) -> Option<&Property> {
        self.asked.borrow_mut().push(name);
        let property = self.properties.iter().find(|p| p.name == name)?;
        property.used.set(true);
        Some(property)
    }

    fn typed<T>(&self, name: &'static str, kind: &str, read: impl Fn(&Value) -> Option<T>) -> Result<Option<At<T>>, LoadError> {
        let Some(property) = self.get(name) else { return Ok(None) };
        let value = read(&property.value).ok_or_else(|| property.must_be(kind))?;
        Ok(Some(At { value, place: property.place.clone() }))
    }

    /// A number, for which an integer will do.
    pub fn float(&self, name: &'static str) -> Result<Option<At<f64>>, LoadError> {
        self.typed(name, "a number", |v| match v {
            Value::Float(v) => Some(*v),
            Value::Integer(v) => Some(*v as f64),
            _ => None,
        })
    }

    /// A number that satisfies `allowed`, in words `expected`; or `default`.
    pub fn float_in(
        &self,
        name: &'static str,
        default: f64,
        allowed: impl Fn(f64) -> bool,
        expected: &str,
    ) -> Result<f64, LoadError> {
        match self.float(name)? {
            None => Ok(default),
            Some(v) if allowed(v.value) => Ok(v.value),
            Some(v) => Err(v.must_be(name, expected)),
        }
    }

    /// A whole number.
    pub fn integer(&self, name: &'static str) -> Result<Option<At<i64>>, LoadError> {
        self.typed(name, "a whole number", |v| match v {
            Value::Integer(v) => Some(*v),
            _ => None,
        })
    }

    /// True or false.
    pub fn boolean(&self, name: &'static str, default: bool) -> Result<bool, LoadError> {
        let read = |v: &Value| match v {
            Value::Boolean(v) => Some(*v),
            _ => None,
        };
        Ok(self.typed(name, "true or false", read)?.map_or(default, |v| v.value))
    }

    /// Text.
    pub fn text(&self, name: &'static str) -> Result<Option<At<&str>>, LoadError> {
        let Some(property) = self.get(name) else { return Ok(None) };
        match &property.value {
            Value::Text(text) => Ok(Some(At { value: text, place: property.place.clone() })),
            _ => Err(property.must_be("a string")),
        }
    }

    /// Text that must be there.
    pub fn needed_text(&self, name: &'static str) -> Result<At<&str>, LoadError> {
        self.text(name)?.ok_or_else(|| self.lacks(&format!("the string \"{name}\"")))
    }

    /// One of a list of words; the first is the default.
    pub fn choice<T: Copy>(&self, name: &'static str, choices: &[(&str, T)]) -> Result<T, LoadError> {
        let Some(text) = self.text(name)? else { return Ok(choices[0].1) };
        let word = text.value.to_ascii_lowercase();
        choices.iter().find(|(w, _)| *w == word).map(|(_, t)| *t).ok_or_else(|| {
            let words: Vec<_> = choices.iter().map(|(w, _)| *w).collect();
            text.must_be(name, &format!("one of {}", words.join(", ")))
        })
    }

    /// A point or vector.
    pub fn point(&self, name: &'static str) -> Result<Option<At<DVec3>>, LoadError> {
        self.typed(name, "a point", |v| match v {
            Value::Point(p) => Some(*p),
            _ => None,
        })
    }

    /// An invertible transform; the identity if none is given.
    pub fn transform(&self, name: &'static str) -> Result<DAffine3, LoadError> {
        let read = |v: &Value| match v {
            Value::Transform(m) => Some(*m),
            _ => None,
        };
        let Some(m) = self.typed(name, "a transform", read)? else { return Ok(DAffine3::IDENTITY) };
        if is_singular(&m.value) {
            let expected = "an invertible transform".to_owned();
            let found = "one that flattens space".to_owned();
            return Err(m.place.error(LoadErrorKind::Value { name: name.to_owned(), expected, found }));
        }
        Ok(m.value)
    }

    /// Child objects of one class, written in place or referred to.
    pub fn children<'a>(&'a self, ids: &Ids<'a>, class: Class) -> Vec<(&'a Property, &'a Object)> {
        let object_of = |p: &'a Property| match &p.value {
            Value::Object(o) => Some(o),
            // References are resolved when the file is read.
            Value::Reference(id) => ids.get(id.as_str()).copied(),
            _ => None,
        };
        let found = self.properties.iter().filter_map(|p| Some((p, object_of(p)?))).filter(|(_, o)| o.class == class);
        found.inspect(|(p, _)| p.used.set(true)).collect()
    }

    /// At most one child object of a class.
    pub fn child<'a>(&'a self, ids: &Ids<'a>, class: Class) -> Result<Option<&'a Object>, LoadError> {
        let children = self.children(ids, class);
        if let Some((property, _)) = children.get(1) {
            let found = format!("a second {}", class.0);
            let name = self.describe();
            let expected = format!("the parent of one {} at most", class.0);
            return Err(property.place.error(LoadErrorKind::Value { name, expected, found }));
        }
        Ok(children.first().map(|(_, o)| *o))
    }

    /// Marks properties that have no bearing on the picture as used.
    pub fn ignore(&self, names: &[&'static str]) {
        for name in names {
            self.get(name);
        }
    }

    /// The error that the object lacks `what`.
    pub fn lacks(&self, what: &str) -> LoadError {
        self.place.error(LoadErrorKind::Missing { owner: self.describe(), what: what.to_owned() })
    }

    /// An error unless every property was asked for.
    pub fn finish(&self) -> Result<(), LoadError> {
        let Some(left) = self.properties.iter().find(|p| !p.used.get()) else { return Ok(()) };
        Err(left.place.error(match &left.value {
            Value::Object(child) => LoadErrorKind::Unsupported { what: format!("{} in {}", child.describe(), self.describe()) },
            Value::Reference(id) => {
                LoadErrorKind::Unsupported { what: format!("the reference to \"{id}\" in {}", self.describe()) }
            }
            _ => {
                let near = near(&left.name, self.asked.borrow().iter().copied());
                LoadErrorKind::UnusedProperty { owner: self.describe(), name: left.name.clone(), near }
            }
        }))
    }
}

impl<T: std::fmt::Display> At<T> {
    /// The error that the property `name` must be `expected`.
    pub fn must_be(&self, name: &str, expected: &str) -> LoadError {
        let (name, expected, found) = (name.to_owned(), expected.to_owned(), self.value.to_string());
        self.place.error(LoadErrorKind::Value { name, expected, found })
    }
}

/// True if the linear part has no inverse worth the name: its determinant is lost in the rounding of its columns' product.
fn is_singular(m: &DAffine3) -> bool {
    let c = m.matrix3;
    let volume = c.x_axis.length() * c.y_axis.length() * c.z_axis.length();
    !(c.determinant().abs() > 1e-14 * volume && volume.is_finite())
}

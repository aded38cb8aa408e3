//! XML text to [`Object`]s: values are parsed, `$name` replaced, `<include>` followed, references checked.
//!
//! What the properties mean is not known here, only their types.

use super::error::{LoadError, LoadErrorKind, Place, SourceText, near, position, short};
use super::files::Files;
use super::object::{At, Class, Ids, Object, Property, Value};
use super::parameters::Parameters;
use super::{scan, transform, upgrade};
use crate::math::{DAffine3, DVec3, Rgb};
use roxmltree::{Document, Node};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const VALUE_TAGS: [&str; 9] = ["integer", "float", "boolean", "string", "rgb", "spectrum", "point", "vector", "transform"];

/// A scene file and all that it includes.
#[derive(Debug)]
pub(super) struct Tree {
    pub root: Object,
    aliases: Vec<(At<String>, String)>,
}

impl Tree {
    /// Reads the scene file at `path` with the parameters given on the command line.
    pub fn read(files: &Files, path: &Path, defines: &[(String, String)]) -> Result<Tree, LoadError> {
        let source = files.read_text(path, files.limits.xml_bytes).map_err(|kind| kind.in_file(path))?;
        Self::of_text(files, source, defines)
    }

    /// Reads the text of a scene file.
    pub fn of_text(files: &Files, source: SourceText, defines: &[(String, String)]) -> Result<Tree, LoadError> {
        let path = source.path.clone();
        let mut reader = Reader {
            files,
            parameters: Parameters::new(defines, files.limits.xml_bytes),
            open: Vec::new(),
            n_includes: 0,
            bytes: 0,
            upgrade: false,
            aliases: Vec::new(),
        };
        let mut scene = reader.file(source, 0)?;
        let is_scene = scene.len() == 1 && matches!(&scene[0].value, Value::Object(o) if o.class == Class::SCENE);
        let Some(Property { value: Value::Object(root), .. }) = scene.pop().filter(|_| is_scene) else {
            let (expected, found) = ("the element <scene>".to_owned(), "another".to_owned());
            return Err(LoadErrorKind::Malformed { expected, found }.in_file(&path));
        };
        reader.parameters.all_used().map_err(|kind| kind.in_file(&path))?;
        Ok(Tree { root, aliases: reader.aliases })
    }

    /// Objects by id; every id is unique and every reference leads somewhere.
    pub fn index(&self) -> Result<Ids<'_>, LoadError> {
        let mut ids = Ids::new();
        collect(&self.root, &mut ids)?;
        for (target, name) in &self.aliases {
            let object = *ids.get(target.value.as_str()).ok_or_else(|| unknown(&target.place, &target.value, &ids))?;
            if ids.insert(name, object).is_some() {
                return Err(target.place.error(LoadErrorKind::DuplicateId { id: name.clone() }));
            }
        }
        check_references(&self.root, &ids)?;
        Ok(ids)
    }
}

fn collect<'a>(object: &'a Object, ids: &mut Ids<'a>) -> Result<(), LoadError> {
    if let Some(id) = &object.id
        && ids.insert(id, object).is_some()
    {
        return Err(object.place.error(LoadErrorKind::DuplicateId { id: id.clone() }));
    }
    children(object).try_for_each(|child| collect(child, ids))
}

fn check_references(object: &Object, ids: &Ids<'_>) -> Result<(), LoadError> {
    for property in &object.properties {
        if let Value::Reference(id) = &property.value
            && !ids.contains_key(id.as_str())
        {
            return Err(unknown(&property.place, id, ids));
        }
    }
    children(object).try_for_each(|child| check_references(child, ids))
}

fn children(object: &Object) -> impl Iterator<Item = &Object> {
    object.properties.iter().filter_map(|p| match &p.value {
        Value::Object(child) => Some(child),
        _ => None,
    })
}

fn unknown(place: &Place, id: &str, ids: &Ids<'_>) -> LoadError {
    place.error(LoadErrorKind::UnknownReference { id: id.to_owned(), near: near(id, ids.keys().copied()) })
}

struct Reader<'f> {
    files: &'f Files,
    parameters: Parameters,
    /// Files being read, the scene file first: a file among them must not be included again.
    open: Vec<PathBuf>,
    n_includes: u64,
    bytes: u64,
    /// The file is older than version 2 and its names are brought up to date.
    upgrade: bool,
    aliases: Vec<(At<String>, String)>,
}

impl Reader<'_> {
    /// The root element of a file: an object, or the properties of an included `<scene>`.
    fn file(&mut self, source: SourceText, depth: usize) -> Result<Vec<Property>, LoadError> {
        let limits = self.files.limits;
        self.bytes += source.text.len() as u64;
        let source = Arc::new(source);
        if let Some(excess) = scan::excess(&source.text, limits.depth, limits.attributes) {
            let scan::Excess { offset, what, limit } = excess;
            return Err(over_limit(&Place { source, offset }, what, limit));
        }
        // No DTD: entities could expand without bound or name files of the system.
        let options = roxmltree::ParsingOptions { allow_dtd: false, nodes_limit: limits.xml_nodes, ..Default::default() };
        let document =
            Document::parse_with_options(&source.text, options).map_err(|e| syntax_error(&e, &source, limits.xml_nodes))?;
        let root = document.root_element();
        let version = root.attribute("version");
        let upgrade_of_parent = self.upgrade;
        // An included part without a version is as old as the file that includes it; a scene without one counts as new.
        self.upgrade = version.map_or(upgrade_of_parent, upgrade::is_old);
        self.open.push(source.path.clone());
        let properties = if depth > 0 && root.tag_name().name() == "scene" {
            let place = Place { source: source.clone(), offset: root.range().start };
            let mut holder = Object::new(Class::SCENE, "scene".to_owned(), None, place);
            self.fill(&mut holder, root, &source, depth)?;
            holder.properties
        } else {
            vec![self.object(root, &source, depth + 1)?]
        };
        self.open.pop();
        self.upgrade = upgrade_of_parent;
        Ok(properties)
    }

    /// An element of a class with all that it holds. `object`, `fill` and `element` call each other as deep as a file nests, so
    /// what else takes room on the stack has functions of its own, which must not be inlined.
    fn object(&mut self, node: Node<'_, '_>, source: &Arc<SourceText>, depth: usize) -> Result<Property, LoadError> {
        let (name, mut object) = self.head(node, source)?;
        self.fill(&mut object, node, source, depth)?;
        if self.upgrade {
            upgrade::object(&mut object);
        }
        let place = object.place.clone();
        Ok(Property::new(name, Value::Object(object), place))
    }

    /// An object without its children, and the name under which it is a property.
    #[inline(never)]
    fn head(&self, node: Node<'_, '_>, source: &Arc<SourceText>) -> Result<(String, Object), LoadError> {
        let mut tag = self.tag(node, source)?;
        let class = Class::ALL.into_iter().find(|c| c.0 == tag.name).ok_or_else(|| unknown_element(&tag))?;
        let plugin = if class == Class::SCENE {
            drop(tag.optional("version"));
            "scene".to_owned()
        } else {
            tag.needed("type")?.value
        };
        let id = tag.optional("id").map(|id| id.value);
        let name = tag.optional("name").map_or(String::new(), |n| self.property_name(n.value));
        Ok((name, Object::new(class, plugin, id, tag.finish()?)))
    }

    /// Reads the child elements of `node` into `object`.
    fn fill(&mut self, object: &mut Object, node: Node<'_, '_>, source: &Arc<SourceText>, depth: usize) -> Result<(), LoadError> {
        let mut names: HashSet<String> = object.properties.iter().map(|p| p.name.clone()).collect();
        for child in node.children() {
            if self.is_element(child, source, depth)? {
                let properties = self.element(child, source, depth)?;
                add(object, &mut names, properties)?;
            }
        }
        Ok(())
    }

    /// False for comments and white space; an error for text, and for an element that lies too deep.
    #[inline(never)]
    fn is_element(&self, node: Node<'_, '_>, source: &Arc<SourceText>, depth: usize) -> Result<bool, LoadError> {
        let place = || Place { source: source.clone(), offset: node.range().start };
        let text = node.text().filter(|_| node.is_text()).unwrap_or_default().trim();
        if !text.is_empty() {
            let found = format!("the text \"{}\"", short(text));
            return Err(place().error(LoadErrorKind::UnknownElement { found, near: Vec::new() }));
        }
        if node.is_element() && depth >= self.files.limits.depth {
            return Err(over_limit(&place(), "depth of nested elements", self.files.limits.depth));
        }
        Ok(node.is_element())
    }

    fn element(&mut self, node: Node<'_, '_>, source: &Arc<SourceText>, depth: usize) -> Result<Vec<Property>, LoadError> {
        let name = node.tag_name().name();
        let by_value = VALUE_TAGS.contains(&name) && !(name == Class::SPECTRUM.0 && node.has_attribute("type"));
        if !by_value && Class::ALL.iter().any(|c| c.0 == name) {
            self.object(node, source, depth + 1).map(|object| vec![object])
        } else {
            self.plain_element(node, source, depth)
        }
    }

    /// An element that is no object.
    #[inline(never)]
    fn plain_element(&mut self, node: Node<'_, '_>, source: &Arc<SourceText>, depth: usize) -> Result<Vec<Property>, LoadError> {
        let name = node.tag_name().name();
        let mut tag = self.tag(node, source)?;
        match name {
            "default" => {
                let (name, value) = (tag.needed("name")?, tag.needed("value")?);
                self.parameters.default(name.value, value.value);
                tag.finish()?;
                Ok(Vec::new())
            }
            "alias" => {
                let (id, name) = (tag.needed("id")?, tag.needed("as")?);
                self.aliases.push((id, name.value));
                tag.finish()?;
                Ok(Vec::new())
            }
            "include" => self.include(tag, depth),
            "ref" => {
                let id = tag.needed("id")?.value;
                let name = tag.optional("name").map_or(String::new(), |n| self.property_name(n.value));
                Ok(vec![Property::new(name, Value::Reference(id), tag.finish()?)])
            }
            "transform" => {
                let name = self.property_name(tag.needed("name")?.value);
                let place = tag.finish()?;
                Ok(vec![Property::new(name, Value::Transform(self.transform(node, source)?), place)])
            }
            _ if VALUE_TAGS.contains(&name) => {
                let name = self.property_name(tag.needed("name")?.value);
                let value = value(&mut tag)?;
                Ok(vec![Property::new(name, value, tag.finish()?)])
            }
            _ => Err(unknown_element(&tag)),
        }
    }

    fn include(&mut self, mut tag: Tag, depth: usize) -> Result<Vec<Property>, LoadError> {
        let file = tag.needed("filename")?;
        let place = tag.finish()?;
        let path = self.files.resolve(&file.value).map_err(|kind| file.place.error(kind))?;
        if self.open.contains(&path) {
            return Err(place.error(LoadErrorKind::Cycle { what: format!("the file {}", path.display()) }));
        }
        self.n_includes += 1;
        let limits = &self.files.limits;
        let over = |what: &str, limit, found| place.error(LoadErrorKind::OverLimit { what: what.to_owned(), limit, found });
        if self.open.len() > limits.include_depth {
            return Err(over("depth of includes", limits.include_depth as u64, self.open.len() as u64));
        }
        if self.n_includes > limits.includes {
            return Err(over("number of includes", limits.includes, self.n_includes));
        }
        let source = self.files.read_text(&path, limits.xml_bytes - self.bytes).map_err(|kind| kind.in_file(&path))?;
        self.file(source, depth)
    }

    fn transform(&self, node: Node<'_, '_>, source: &Arc<SourceText>) -> Result<DAffine3, LoadError> {
        let mut all = DAffine3::IDENTITY;
        for child in node.children().filter(Node::is_element) {
            let mut tag = self.tag(child, source)?;
            let step = operation(&mut tag)?;
            tag.finish()?;
            all = step * all;
        }
        Ok(all)
    }

    /// Name and attributes of an element, with `$name` replaced.
    fn tag(&self, node: Node<'_, '_>, source: &Arc<SourceText>) -> Result<Tag, LoadError> {
        let at = |offset| Place { source: source.clone(), offset };
        let attribute = |a: roxmltree::Attribute<'_, '_>| {
            let place = at(a.range().start);
            let value = self.parameters.substitute(a.value()).map_err(|kind| place.error(kind))?;
            Ok((a.name().to_owned(), At { value, place }))
        };
        let attributes = node.attributes().map(attribute).collect::<Result<_, LoadError>>()?;
        Ok(Tag { name: node.tag_name().name().to_owned(), place: at(node.range().start), attributes })
    }

    fn property_name(&self, name: String) -> String {
        if self.upgrade { upgrade::snake_case(&name) } else { name }
    }
}

/// Adds properties to an object, each name once.
#[inline(never)]
fn add(object: &mut Object, names: &mut HashSet<String>, properties: Vec<Property>) -> Result<(), LoadError> {
    for property in properties {
        if !property.name.is_empty() && !names.insert(property.name.clone()) {
            let (expected, found) = (format!("\"{}\" once in {}", property.name, object.describe()), "it again".to_owned());
            return Err(property.place.error(LoadErrorKind::Malformed { expected, found }));
        }
        object.properties.push(property);
    }
    Ok(())
}

/// An element's attributes; each must be taken.
struct Tag {
    name: String,
    place: Place,
    attributes: Vec<(String, At<String>)>,
}

impl Tag {
    fn optional(&mut self, name: &str) -> Option<At<String>> {
        let index = self.attributes.iter().position(|(n, _)| n == name)?;
        Some(self.attributes.swap_remove(index).1)
    }

    fn needed(&mut self, name: &str) -> Result<At<String>, LoadError> {
        self.optional(name).ok_or_else(|| {
            let kind = LoadErrorKind::Missing { owner: format!("<{}>", self.name), what: format!("the attribute \"{name}\"") };
            self.place.error(kind)
        })
    }

    /// The element's place, if no attribute is left over.
    fn finish(self) -> Result<Place, LoadError> {
        match self.attributes.first() {
            None => Ok(self.place),
            Some((name, value)) => {
                let found = format!("the attribute \"{name}\" of <{}>", self.name);
                Err(value.place.error(LoadErrorKind::UnknownElement { found, near: Vec::new() }))
            }
        }
    }

    /// The components x, y, z, each with a default, or all of them from `value`.
    fn vector(&mut self, default: f64, spread: bool) -> Result<DVec3, LoadError> {
        if let Some(value) = self.optional("value") {
            return match transform::numbers(&value.value).as_deref() {
                Some(&[x, y, z]) => Ok(DVec3::new(x, y, z)),
                Some(&[x]) if spread => Ok(DVec3::splat(x)),
                _ => Err(value.must_be("value", if spread { "one or three finite numbers" } else { "three finite numbers" })),
            };
        }
        let mut v = DVec3::splat(default);
        for (i, name) in ["x", "y", "z"].into_iter().enumerate() {
            if let Some(text) = self.optional(name) {
                v[i] = number(&text, name)?;
            }
        }
        Ok(v)
    }
}

fn number(text: &At<String>, name: &str) -> Result<f64, LoadError> {
    let value = text.value.trim().parse().ok().filter(|v: &f64| v.is_finite());
    value.ok_or_else(|| text.must_be(name, "a finite number"))
}

/// The value of a simple element.
fn value(tag: &mut Tag) -> Result<Value, LoadError> {
    if matches!(tag.name.as_str(), "point" | "vector") {
        return Ok(Value::Point(tag.vector(0.0, false)?));
    }
    if tag.name == "spectrum" && tag.attributes.iter().any(|(n, _)| n == "filename") {
        return Err(tag.place.error(LoadErrorKind::Unsupported { what: "a spectrum from a file".to_owned() }));
    }
    let text = tag.needed("value")?;
    match tag.name.as_str() {
        "integer" => {
            let value = text.value.trim().parse().map_err(|_| text.must_be("value", "a whole number"))?;
            Ok(Value::Integer(value))
        }
        "float" => Ok(Value::Float(number(&text, "value")?)),
        "boolean" => match text.value.trim().to_ascii_lowercase().as_str() {
            "true" => Ok(Value::Boolean(true)),
            "false" => Ok(Value::Boolean(false)),
            _ => Err(text.must_be("value", "true or false")),
        },
        "string" => Ok(Value::Text(text.value)),
        "rgb" => match transform::numbers(&text.value).as_deref() {
            Some(&[r, g, b]) => Ok(Value::Rgb(Rgb::new(r, g, b))),
            Some(&[grey]) => Ok(Value::Rgb(Rgb::grey(grey))),
            _ => Err(text.must_be("value", "one or three finite numbers of linear sRGB")),
        },
        _ => match transform::numbers(&text.value).as_deref() {
            Some(&[value]) => Ok(Value::Uniform(value)),
            _ => spectrum(&text.value).map(Value::Spectrum).ok_or_else(|| {
                text.must_be("value", "one finite number, or wavelength:value for two or more growing wavelengths")
            }),
        },
    }
}

/// Pairs such as `400:0.1, 700:0.3`, two or more, by growing wavelength.
fn spectrum(text: &str) -> Option<Vec<(f64, f64)>> {
    let pairs = text.split(|c: char| c == ',' || c.is_ascii_whitespace()).filter(|t| !t.is_empty()).map(|pair| {
        let (wavelength, value) = pair.split_once(':')?;
        match (transform::numbers(wavelength).as_deref(), transform::numbers(value).as_deref()) {
            (Some(&[wavelength]), Some(&[value])) => Some((wavelength, value)),
            _ => None,
        }
    });
    let pairs: Vec<_> = pairs.collect::<Option<_>>()?;
    (pairs.len() > 1 && pairs.is_sorted_by(|a, b| a.0 < b.0)).then_some(pairs)
}

/// One operation of a `<transform>`.
fn operation(tag: &mut Tag) -> Result<DAffine3, LoadError> {
    match tag.name.as_str() {
        "translate" => Ok(DAffine3::from_translation(tag.vector(0.0, false)?)),
        "scale" => Ok(DAffine3::from_scale(tag.vector(1.0, true)?)),
        "rotate" => {
            let angle = tag.needed("angle")?;
            let angle = number(&angle, "angle")?;
            let axis = tag.vector(0.0, false)?;
            transform::rotate(axis, angle).ok_or_else(|| {
                let (expected, found) = ("an axis of rotation".to_owned(), "0, 0, 0".to_owned());
                tag.place.error(LoadErrorKind::Value { name: "rotate".to_owned(), expected, found })
            })
        }
        "matrix" => {
            let text = tag.needed("value")?;
            let numbers = transform::numbers(&text.value).ok_or_else(|| text.must_be("value", "finite numbers"))?;
            transform::matrix(&numbers).map_err(|expected| text.must_be("value", expected))
        }
        "lookat" | "lookAt" => {
            let mut point = |name| {
                let text = tag.needed(name)?;
                match transform::numbers(&text.value).as_deref() {
                    Some(&[x, y, z]) => Ok(DVec3::new(x, y, z)),
                    _ => Err(text.must_be(name, "three finite numbers")),
                }
            };
            let (origin, target, up) = (point("origin")?, point("target")?, point("up")?);
            transform::look_at(origin, target, up).ok_or_else(|| {
                let expected = "an origin and a target apart, and an up vector across the view".to_owned();
                let found = format!("origin {origin}, target {target}, up {up}");
                tag.place.error(LoadErrorKind::Value { name: "lookat".to_owned(), expected, found })
            })
        }
        _ => Err(unknown_element_among(tag, ["translate", "rotate", "scale", "matrix", "lookat"])),
    }
}

fn unknown_element(tag: &Tag) -> LoadError {
    let structure = ["default", "include", "alias", "ref"];
    unknown_element_among(tag, Class::ALL.iter().map(|c| c.0).chain(VALUE_TAGS).chain(structure))
}

fn unknown_element_among<'a>(tag: &'a Tag, known: impl IntoIterator<Item = &'a str>) -> LoadError {
    let (found, near) = (format!("the element <{}>", short(&tag.name)), near(&tag.name, known));
    tag.place.error(LoadErrorKind::UnknownElement { found, near })
}

fn over_limit(place: &Place, what: &str, limit: usize) -> LoadError {
    let (limit, found) = (limit as u64, limit as u64 + 1);
    place.error(LoadErrorKind::OverLimit { what: what.to_owned(), limit, found })
}

fn syntax_error(error: &roxmltree::Error, source: &Arc<SourceText>, nodes: u32) -> LoadError {
    use roxmltree::Error::{NoRootNode, UnclosedRootNode, UnexpectedEndOfStream};
    let text = &source.text;
    let offset = match error {
        // The parser has no place for what is missing at the end.
        NoRootNode | UnclosedRootNode | UnexpectedEndOfStream => text.len(),
        _ => {
            let at = error.pos();
            let line_start: usize = text.split_inclusive('\n').take(at.row as usize - 1).map(str::len).sum();
            let before = (at.col as usize).saturating_sub(1);
            line_start + text[line_start..].chars().take(before).map(char::len_utf8).sum::<usize>()
        }
    };
    let kind = match error {
        roxmltree::Error::NodesLimitReached => {
            let (limit, found) = (u64::from(nodes), u64::from(nodes) + 1);
            LoadErrorKind::OverLimit { what: "number of XML nodes".to_owned(), limit, found }
        }
        roxmltree::Error::DtdDetected => LoadErrorKind::Unsupported { what: "a document type definition (DTD)".to_owned() },
        // The parser's words end in the place, which is told apart.
        _ => {
            let words = error.to_string();
            let found = words.rsplit_once(" at ").map_or(words.as_str(), |(w, _)| w).to_owned();
            LoadErrorKind::Malformed { expected: "well-formed XML".to_owned(), found }
        }
    };
    LoadError { file: source.path.as_path().into(), at: Some(position(text.as_bytes(), offset)), kind }
}

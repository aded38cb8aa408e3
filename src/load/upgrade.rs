//! Files of Mitsuba 0.5 and 0.6: their names, brought up to date by the rules of Mitsuba 3 itself.

use super::object::{Class, Object, Property, Value};
use crate::math::{DAffine3, DVec3};

/// True for a version before 2.
pub(super) fn is_old(version: &str) -> bool {
    version.trim().split('.').next().and_then(|major| major.parse::<u32>().ok()).is_some_and(|major| major < 2)
}

/// `toWorld` to `to_world`, `intIOR` to `int_ior`: an underscore where a capital follows a small letter.
pub(super) fn snake_case(name: &str) -> String {
    let mut result = String::with_capacity(name.len() + 4);
    let mut after_small = false;
    for c in name.chars() {
        if c.is_ascii_uppercase() && after_small {
            result.push('_');
        }
        after_small = c.is_ascii_lowercase();
        // A name that begins with a capital stays as it is, as Mitsuba leaves it.
        result.push(if result.is_empty() { c } else { c.to_ascii_lowercase() });
    }
    result
}

/// Renames what has another name today, drops what has none, and folds texture offsets and scales into `to_uv`.
pub(super) fn object(object: &mut Object) {
    if matches!(object.plugin.as_str(), "conductor" | "roughconductor") {
        object.properties.retain(|p| p.name != "ext_eta");
    }
    if object.class == Class::BSDF && object.plugin == "diffuse" {
        let old = object.properties.iter_mut().find(|p| p.name == "diffuse_reflectance");
        old.into_iter().for_each(|p| p.name = "reflectance".to_owned());
    }
    let of = |name: &str| object.properties.iter().find(|p| p.name == name);
    let number = |name: &str, default: f64| match of(name).map(|p| &p.value) {
        Some(Value::Float(v)) => *v,
        Some(Value::Integer(v)) => *v as f64,
        _ => default,
    };
    let names = ["uscale", "vscale", "uoffset", "voffset"];
    let Some(place) = names.iter().find_map(|n| of(n)).map(|p| p.place.clone()) else { return };
    let scale = DVec3::new(number("uscale", 1.0), number("vscale", 1.0), 1.0);
    let offset = DVec3::new(number("uoffset", 0.0), number("voffset", 0.0), 0.0);
    object.properties.retain(|p| !names.contains(&p.name.as_str()));
    let to_uv = DAffine3::from_scale(scale) * DAffine3::from_translation(offset);
    object.properties.push(Property::new("to_uv".to_owned(), Value::Transform(to_uv), place));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_names_become_new_ones() {
        for (old, new) in [("toWorld", "to_world"), ("intIOR", "int_ior"), ("fovAxis", "fov_axis"), ("alphaU", "alpha_u")] {
            assert_eq!(snake_case(old), new);
        }
        assert!(is_old("0.6.0") && is_old("0.5") && !is_old("3.0.0") && !is_old("2.1.0"));
    }
}

//! Wavefront MTL: the materials of an OBJ file, with the fields of the physically based extension (Pr, Pm).
//!
//! Statements without a bearing on the picture (Ka, sharpness, bump maps, ...) are passed over.

use super::error::short;
use super::mesh::MeshFault;
use crate::math::Rgb;

/// One `newmtl`.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Mtl {
    pub name: String,
    /// Kd: diffuse colour.
    pub diffuse: Option<Rgb>,
    /// Ks: colour of the highlight, or of a mirror.
    pub specular: Option<Rgb>,
    /// Ke: emitted radiance.
    pub emission: Option<Rgb>,
    /// Tf: factor on transmitted light.
    pub filter: Option<Rgb>,
    /// Ns: Phong's exponent.
    pub shininess: Option<f64>,
    /// Ni: index of refraction.
    pub index: Option<f64>,
    /// d, or 1 - Tr: 1 is opaque.
    pub opacity: Option<f64>,
    /// illum: 0 to 10.
    pub model: Option<u32>,
    /// Pr: roughness, the square root of a microfacet alpha.
    pub roughness: Option<f64>,
    /// Pm: 1 is a metal.
    pub metallic: Option<f64>,
    pub diffuse_map: Option<Map>,
    pub emission_map: Option<Map>,
    /// There is a map of opacity.
    pub has_opacity_map: bool,
}

/// An image on a surface.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Map {
    /// As written, with forward slashes.
    pub file: String,
    /// Byte offset of its line.
    pub offset: usize,
    /// -s: factors on u and v.
    pub scale: [f64; 2],
    /// -o: added to u and v.
    pub shift: [f64; 2],
    /// -clamp on: the border goes on outside, instead of the image again.
    pub clamp: bool,
}

/// Reads an MTL file.
pub(super) fn parse(bytes: &[u8]) -> Result<Vec<Mtl>, MeshFault> {
    let mut all: Vec<Mtl> = Vec::new();
    let mut offset = 0;
    for (index, line) in bytes.split(|b| *b == b'\n').enumerate() {
        let text = String::from_utf8_lossy(line);
        statement(text.trim(), offset, &mut all)
            .map_err(|(expected, found)| MeshFault::new(Some(offset), expected, format!("line {}: {found}", index + 1)))?;
        offset += line.len() + 1;
    }
    Ok(all)
}

/// What was expected, and what was found.
type Fault = (String, String);

fn statement(line: &str, offset: usize, all: &mut Vec<Mtl>) -> Result<(), Fault> {
    let (word, rest) = line.split_once(|c: char| c.is_ascii_whitespace()).unwrap_or((line, ""));
    let rest = rest.trim();
    if word == "newmtl" {
        all.push(Mtl { name: rest.to_owned(), ..Mtl::default() });
        return Ok(());
    }
    let known = ["Kd", "Ks", "Ke", "Tf", "Ns", "Ni", "d", "Tr", "illum", "Pr", "Pm", "map_Kd", "map_Ke", "map_d", "map_Tr"];
    if !known.contains(&word) {
        return Ok(());
    }
    let Some(mtl) = all.last_mut() else { return Err(("newmtl first".to_owned(), format!("\"{word}\""))) };
    let unit = |v: f64| (0.0..=1.0).contains(&v);
    match word {
        "Kd" => mtl.diffuse = Some(color(rest, unit, "from 0 to 1")?),
        "Tf" => mtl.filter = Some(color(rest, unit, "from 0 to 1")?),
        // Exporters write highlights brighter than white.
        "Ks" => mtl.specular = Some(color(rest, |v| v >= 0.0, "0 or more")?),
        "Ke" => mtl.emission = Some(color(rest, |v| v >= 0.0, "0 or more")?),
        "Ns" => mtl.shininess = Some(number(rest, |v| v >= 0.0, "0 or more")?),
        "Ni" => mtl.index = Some(number(rest, |v| v > 0.0, "above 0")?),
        "d" => mtl.opacity = Some(number(rest.trim_start_matches("-halo").trim(), unit, "from 0 to 1")?),
        // Where a file gives both, they say the same or the first is meant.
        "Tr" => mtl.opacity = mtl.opacity.or(Some(1.0 - number(rest, unit, "from 0 to 1")?)),
        "Pr" => mtl.roughness = Some(number(rest, unit, "from 0 to 1")?),
        "Pm" => mtl.metallic = Some(number(rest, unit, "from 0 to 1")?),
        "illum" => {
            mtl.model = Some(number(rest, |v| v.fract() == 0.0 && (0.0..=10.0).contains(&v), "a whole number to 10")? as u32)
        }
        "map_Kd" => mtl.diffuse_map = Some(map(rest, offset)?),
        "map_Ke" => mtl.emission_map = Some(map(rest, offset)?),
        _ => mtl.has_opacity_map = true,
    }
    Ok(())
}

fn number(text: &str, allowed: impl Fn(f64) -> bool, expected: &str) -> Result<f64, Fault> {
    let value = text.parse().ok().filter(|v: &f64| v.is_finite() && allowed(*v));
    value.ok_or_else(|| (format!("a number {expected}"), format!("\"{}\"", short(text))))
}

/// Three channels, or one for all.
fn color(text: &str, allowed: impl Fn(f64) -> bool, expected: &str) -> Result<Rgb, Fault> {
    let fault = || (format!("a colour with every channel {expected}"), format!("\"{}\"", short(text)));
    let channels: Result<Vec<f64>, _> = text.split_ascii_whitespace().map(|w| number(w, &allowed, expected)).collect();
    match channels.map_err(|_| fault())?.as_slice() {
        [r, g, b] => Ok(Rgb::new(*r, *g, *b)),
        [v] => Ok(Rgb::grey(*v)),
        _ => Err(fault()),
    }
}

/// Options and the name of an image, which may contain spaces.
fn map(text: &str, offset: usize) -> Result<Map, Fault> {
    let mut map = Map { file: String::new(), offset, scale: [1.0; 2], shift: [0.0; 2], clamp: false };
    let mut rest = text;
    while let Some(option) = rest.strip_prefix('-') {
        let mut words = option.split_ascii_whitespace();
        let name = words.next().unwrap_or_default();
        let most = match name {
            "s" | "o" | "t" => 3,
            "mm" => 2,
            "clamp" | "bm" | "boost" | "blendu" | "blendv" | "texres" | "imfchan" | "cc" | "type" => 1,
            _ => return Err(("an option of a map".to_owned(), format!("\"-{}\"", short(name)))),
        };
        let is_word = matches!(name, "clamp" | "blendu" | "blendv" | "imfchan" | "cc" | "type");
        // Up to as many numbers as the option takes; the second and third are optional.
        let values: Vec<&str> = words.take(most).take_while(|w| is_word || w.parse::<f64>().is_ok()).collect();
        let numbers: Vec<f64> = values.iter().filter_map(|w| w.parse().ok()).collect();
        match name {
            "s" => map.scale.iter_mut().zip(&numbers).for_each(|(s, n)| *s = *n),
            "o" => map.shift.iter_mut().zip(&numbers).for_each(|(s, n)| *s = *n),
            "clamp" => map.clamp = values == ["on"],
            _ => {}
        }
        rest = after(rest, values.last().unwrap_or(&name)).trim_start();
    }
    if rest.is_empty() {
        return Err(("the name of an image".to_owned(), "none".to_owned()));
    }
    map.file = rest.replace('\\', "/");
    Ok(map)
}

/// What stands behind `word`, which is a part of `text`.
fn after<'t>(text: &'t str, word: &str) -> &'t str {
    let start = word.as_ptr() as usize - text.as_ptr() as usize;
    &text[start + word.len()..]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statements_fill_the_latest_material() {
        let text = b"# by hand\nnewmtl a b\n\tKd .5 0.25 1\r\nKs 2\nNs 98\nTr 0.75\nnewmtl c\nKe 3 2 1\nillum 7\nNi 1.33\nPm 1\nPr .2\nbump x.png\n";
        let all = parse(text).expect("valid");
        let first = Mtl {
            name: "a b".to_owned(),
            diffuse: Some(Rgb::new(0.5, 0.25, 1.0)),
            specular: Some(Rgb::grey(2.0)),
            shininess: Some(98.0),
            opacity: Some(0.25),
            ..Mtl::default()
        };
        let second = Mtl {
            name: "c".to_owned(),
            emission: Some(Rgb::new(3.0, 2.0, 1.0)),
            model: Some(7),
            index: Some(1.33),
            metallic: Some(1.0),
            roughness: Some(0.2),
            ..Mtl::default()
        };
        assert_eq!(all, [first, second]);
    }

    #[test]
    fn maps_take_options_and_names_with_spaces() {
        for (line, file, scale, shift, clamp) in [
            ("map_Kd a b.png", "a b.png", [1.0, 1.0], [0.0, 0.0], false),
            ("map_Kd -s 2 3 1 -o -.5 .25 tex\\a b.png", "tex/a b.png", [2.0, 3.0], [-0.5, 0.25], false),
            ("map_Kd -clamp on -bm 1 -s 4 a.png", "a.png", [4.0, 1.0], [0.0, 0.0], true),
        ] {
            let all = parse(format!("newmtl m\n{line}\n").as_bytes()).expect(line);
            let map = Map { file: file.to_owned(), offset: 9, scale, shift, clamp };
            assert_eq!(all[0].diffuse_map, Some(map), "{line}");
        }
    }

    #[test]
    fn faults_name_their_line() {
        for (line, part) in [
            ("Kd 1 2 3", "every channel from 0 to 1"),
            ("Kd spectral a.rfl", "colour"),
            ("Kd .5 .5", "colour"),
            ("Ke -1 0 0", "0 or more"),
            ("d nan", "from 0 to 1"),
            ("Ni 0", "above 0"),
            ("illum 2.5", "whole number"),
            ("map_Kd", "name of an image"),
            ("map_Kd -s 1 1 1", "name of an image"),
            ("map_Kd -foo 1 a.png", "option"),
        ] {
            let fault = parse(format!("newmtl m\n{line}\n").as_bytes()).expect_err(line);
            assert_eq!(fault.offset, Some(9), "{line}");
            let message = fault.kind.to_string();
            assert!(message.contains(part) && message.contains("line 2"), "{line}: {message}");
        }
        assert!(parse(b"Kd 1 1 1\n").expect_err("no material").kind.to_string().contains("newmtl"));
    }
}

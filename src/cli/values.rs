//! Values of flags: text to number, with a message that says what was expected.

use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit};
use std::str::FromStr;
use twopass::form_factor::FormFactorMethod;
use twopass::integrator::bidirectional::Heuristic;
use twopass::integrator::{Method, ReadOut};
use twopass::math::{Rgb, SamplerKind};
use twopass::pipeline::LampWeight;
use twopass::radiosity::Solver;

/// `name=value`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Define {
    /// Name of a scene parameter.
    pub name: String,
    /// Its value.
    pub value: String,
}

impl FromStr for Define {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once('=') {
            Some((name, value)) if !name.is_empty() => Ok(Self { name: name.to_owned(), value: value.to_owned() }),
            _ => Err("expected NAME=VALUE".to_owned()),
        }
    }
}

/// Width and height in pixels, both at least 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    /// Width.
    pub width: usize,
    /// Height.
    pub height: usize,
}

impl FromStr for Size {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let side = |s: &str| s.parse::<u32>().ok().filter(|n| *n > 0).map(|n| n as usize);
        let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some((side(w)?, side(h)?)));
        sides.map(|(width, height)| Self { width, height }).ok_or_else(|| "expected WxH, such as 640x480".to_owned())
    }
}

/// Left, top, width, height in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Crop(pub [usize; 4]);

/// Parses `X,Y,W,H`.
pub fn parse_crop(text: &str) -> Result<Crop, String> {
    let numbers: Option<Vec<usize>> = text.split(',').map(|s| s.trim().parse::<u32>().ok().map(|n| n as usize)).collect();
    match numbers.as_deref() {
        Some(&[x, y, width, height]) if width > 0 && height > 0 => Ok(Crop([x, y, width, height])),
        _ => Err("expected X,Y,W,H in pixels, W and H at least 1".to_owned()),
    }
}

/// A limit of light path edges; `None`: unlimited.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Depth(pub Option<u32>);

/// Parses a depth: -1 is unlimited.
pub fn parse_depth(text: &str) -> Result<Depth, String> {
    match text.parse::<i64>() {
        Ok(-1) => Ok(Depth(None)),
        Ok(n) => u32::try_from(n).map(|n| Depth(Some(n))).map_err(|_| "expected -1 (unlimited) or 0 and up".to_owned()),
        Err(_) => Err("expected a whole number".to_owned()),
    }
}

/// Parses a whole number of 0 or more.
pub fn parse_whole<T: FromStr>(text: &str) -> Result<T, String> {
    text.parse().map_err(|_| format!("expected a whole number of 0 or more, of {} bits at most", 8 * size_of::<T>()))
}

/// Parses a whole number of 1 or more.
pub fn parse_count<T: FromStr + PartialEq + Default>(text: &str) -> Result<T, String> {
    let count = text.parse().ok().filter(|n| *n != T::default());
    count.ok_or_else(|| format!("expected a whole number of 1 or more, of {} bits at most", 8 * size_of::<T>()))
}

/// Parses a finite number above 0.
pub fn parse_positive(text: &str) -> Result<f64, String> {
    parse_finite(text).ok().filter(|v| *v > 0.0).ok_or_else(|| "expected a number above 0".to_owned())
}

/// Parses how many mirrors a way may pass in a row.
pub fn parse_reflections(text: &str) -> Result<u32, String> {
    let most = 1..=8;
    text.parse().ok().filter(|n| most.contains(n)).ok_or_else(|| "expected a whole number from 1 to 8".to_owned())
}

/// Parses a number above 0 and up to 1.
pub fn parse_share(text: &str) -> Result<f64, String> {
    parse_positive(text).ok().filter(|v| *v <= 1.0).ok_or_else(|| "expected a number above 0, 1 at most".to_owned())
}

/// Parses a finite number of 0 or more.
pub fn parse_from_zero(text: &str) -> Result<f64, String> {
    parse_finite(text).ok().filter(|v| *v >= 0.0).ok_or_else(|| "expected a number of 0 or more".to_owned())
}

/// Parses a finite number.
pub fn parse_finite(text: &str) -> Result<f64, String> {
    text.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| "expected a finite number".to_owned())
}

/// Parses the name of a method.
pub fn parse_method(text: &str) -> Result<Method, String> {
    let names = Method::ALL.map(Method::name).join(", ");
    Method::ALL.into_iter().find(|m| m.name() == text).ok_or_else(|| format!("expected one of {names}"))
}

/// Parses a number of bytes; K, M and G stand for 1024 and its powers.
pub fn parse_bytes(text: &str) -> Result<u64, String> {
    let (digits, unit) = match text.char_indices().last() {
        Some((at, 'K' | 'k')) => (&text[..at], 1 << 10),
        Some((at, 'M' | 'm')) => (&text[..at], 1 << 20),
        Some((at, 'G' | 'g')) => (&text[..at], 1 << 30),
        _ => (text, 1_u64),
    };
    let bytes = digits.parse::<u64>().ok().filter(|n| *n > 0).and_then(|n| n.checked_mul(unit));
    bytes.ok_or_else(|| "expected a number of bytes above 0, with K, M or G behind it if you like".to_owned())
}

/// Bytes of memory that this machine has, as far as it tells.
pub fn physical_memory() -> Option<u64> {
    [installed_memory(), address_space_left()].into_iter().flatten().min()
}

/// What a limit on the address space (`ulimit -v`) leaves to this process [bytes].
fn address_space_left() -> Option<u64> {
    let (limit, _) = getrlimit(Resource::RLIMIT_AS).ok()?;
    let taken = std::fs::read_to_string("/proc/self/statm").ok()?;
    let pages: u64 = taken.split(' ').next()?.parse().ok()?;
    (limit != RLIM_INFINITY).then(|| limit.saturating_sub(4096 * pages))
}

fn installed_memory() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kilobytes| 1024 * kilobytes)
}

/// Parses the name of a method of form factors.
pub fn parse_form_factors(text: &str) -> Result<FormFactorMethod, String> {
    let names = FormFactorMethod::ALL.map(FormFactorMethod::name).join(", ");
    FormFactorMethod::by_name(text).ok_or_else(|| format!("expected one of {names}"))
}

/// Parses the name of a read-out.
pub fn parse_read_out(text: &str) -> Result<ReadOut, String> {
    match text {
        "stored" => Ok(ReadOut::Stored),
        "direct-stored" => Ok(ReadOut::DirectStored),
        "final-gather" => Ok(ReadOut::FinalGather),
        "progressive" => Ok(ReadOut::Progressive),
        _ => Err("expected stored, direct-stored, final-gather or progressive".to_owned()),
    }
}

/// Parses the name of a sampler.
pub fn parse_sampler(text: &str) -> Result<SamplerKind, String> {
    let names = SamplerKind::ALL.map(SamplerKind::name).join(", ");
    SamplerKind::ALL.into_iter().find(|m| m.name() == text).ok_or_else(|| format!("expected one of {names}"))
}

/// Parses `on` or `off`.
pub fn parse_switch(text: &str) -> Result<bool, String> {
    match text {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err("expected on or off".to_owned()),
    }
}

/// Parses the name of a solver.
pub fn parse_solver(text: &str) -> Result<Solver, String> {
    let names = Solver::ALL.map(Solver::name).join(", ");
    Solver::ALL.into_iter().find(|s| s.name() == text).ok_or_else(|| format!("expected one of {names}"))
}

/// Parses `ID=SCALE` or `ID=SCALE,R,G,B`; all are factors of 0 or more.
pub fn parse_light(text: &str) -> Result<LampWeight, String> {
    let expected = || "expected ID=SCALE or ID=SCALE,R,G,B, each of 0 or more".to_owned();
    // An id may hold an equals sign, a number does not.
    let (name, factors) = text.rsplit_once('=').filter(|(name, _)| !name.is_empty()).ok_or_else(expected)?;
    let factors: Vec<f64> =
        factors.split(',').map(|f| parse_finite(f).ok().filter(|f| *f >= 0.0)).collect::<Option<_>>().ok_or_else(expected)?;
    let factor = match factors[..] {
        [scale] => Rgb::grey(scale),
        [scale, r, g, b] => Rgb::new(r, g, b) * scale,
        _ => return Err(expected()),
    };
    Ok(LampWeight { name: name.to_owned(), factor })
}

/// Parses the name of a heuristic.
pub fn parse_heuristic(text: &str) -> Result<Heuristic, String> {
    Heuristic::ALL.into_iter().find(|h| h.name() == text).ok_or_else(|| "expected power or balance".to_owned())
}

/// Name of a read-out, as it is typed.
pub fn read_out_name(read_out: ReadOut) -> &'static str {
    match read_out {
        ReadOut::Stored => "stored",
        ReadOut::DirectStored => "direct-stored",
        ReadOut::FinalGather => "final-gather",
        ReadOut::Progressive => "progressive",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_crops() {
        assert_eq!("640x480".parse(), Ok(Size { width: 640, height: 480 }));
        for bad in ["640", "0x1", "1x0", "-5x3", "4294967297x1", "x", "1x2x3", ""] {
            assert!(bad.parse::<Size>().is_err(), "{bad}");
        }
        assert_eq!(parse_crop("1,2,3,4"), Ok(Crop([1, 2, 3, 4])));
        for bad in ["1,2,3", "1,2,0,4", "1,2,3,-4", "1,2,3,4,5", "a,b,c,d"] {
            assert!(parse_crop(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn numbers_that_mean_nothing_are_refused() {
        for bad in ["0", "-1", "nan", "inf", "1e400", "", "ten"] {
            assert!(parse_positive(bad).is_err(), "{bad}");
        }
        assert_eq!(parse_positive("1e-3"), Ok(1e-3));
        assert_eq!(parse_finite("-2.5"), Ok(-2.5));
        assert_eq!(parse_depth("-1"), Ok(Depth(None)));
        assert_eq!(parse_depth("5"), Ok(Depth(Some(5))));
        assert!(parse_depth("-7").is_err() && parse_depth("4294967296").is_err());
    }

    #[test]
    fn defines_keep_what_follows_the_first_equals_sign() {
        assert_eq!("a=b=c".parse(), Ok(Define { name: "a".into(), value: "b=c".into() }));
        assert!("a".parse::<Define>().is_err() && "=1".parse::<Define>().is_err());
    }

    /// 1 G = 1024³ bytes.
    #[test]
    fn numbers_of_bytes() {
        for (text, want) in [("512", 512), ("4K", 4096), ("3m", 3 << 20), ("6G", 6 << 30)] {
            assert_eq!(parse_bytes(text), Ok(want), "{text}");
        }
        for bad in ["", "G", "0", "-1", "1.5G", "1T", "99999999999999999999", "18446744073709551615K"] {
            assert!(parse_bytes(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn weights_of_lights() {
        let weight = |name: &str, factor: Rgb| Ok(LampWeight { name: name.into(), factor });
        assert_eq!(parse_light("lamp=0.5"), weight("lamp", Rgb::grey(0.5)));
        assert_eq!(parse_light("a=b=2,1,0,3"), weight("a=b", Rgb::new(2.0, 0.0, 6.0)));
        for bad in ["lamp", "=2", "lamp=", "lamp=-1", "lamp=1,2", "lamp=1,2,3", "lamp=1,2,3,4,5", "lamp=nan", "lamp=1,1,1,-1"] {
            assert!(parse_light(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn names_of_methods_are_those_of_the_table() {
        for method in Method::ALL {
            assert_eq!(parse_method(method.name()), Ok(method));
        }
        for solver in Solver::ALL {
            assert_eq!(parse_solver(solver.name()), Ok(solver));
        }
        assert!(parse_solver("magic").unwrap_err().contains("bicgstab"));
        assert!(parse_method("magic").unwrap_err().contains("two-pass-whitted"));
    }
}

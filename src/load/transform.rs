//! `<transform>`: operations in document order, each applied after those before it; points are columns, matrices row-major.

use crate::math::{DAffine3, DVec3};
use glam::{DMat3, DQuat};

/// Numbers separated by commas or white space, all finite.
pub(super) fn numbers(text: &str) -> Option<Vec<f64>> {
    let tokens = text.split(|c: char| c == ',' || c.is_ascii_whitespace()).filter(|t| !t.is_empty());
    tokens.map(|t| t.parse().ok().filter(|v: &f64| v.is_finite())).collect()
}

/// A rotation by `degrees` about `axis`; `None` if the axis has no direction.
pub(super) fn rotate(axis: DVec3, degrees: f64) -> Option<DAffine3> {
    let axis = axis.try_normalize()?;
    Some(DAffine3::from_quat(DQuat::from_axis_angle(axis, degrees.to_radians())))
}

/// The camera frame at `origin` that looks at `target`: columns up x dir (image left), up, dir. `None` if `up` does not help.
pub(super) fn look_at(origin: DVec3, target: DVec3, up: DVec3) -> Option<DAffine3> {
    let direction = (target - origin).try_normalize()?;
    let left = up.try_normalize()?.cross(direction);
    // An up vector along the view leaves only rounding errors.
    let left = (left.length() > 1e-9).then(|| left.normalize())?;
    let up = direction.cross(left);
    Some(DAffine3::from_mat3_translation(DMat3::from_cols(left, up, direction), origin))
}

/// A matrix of 16 numbers, or of 9 for the linear part; `Err` says what is wrong.
pub(super) fn matrix(n: &[f64]) -> Result<DAffine3, &'static str> {
    const EXPECTED: &str = "16 numbers, or 9";
    let (linear, translation) = match n.len() {
        9 => ([n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8]], DVec3::ZERO),
        16 if n[12..] == [0.0, 0.0, 0.0, 1.0] => {
            ([n[0], n[1], n[2], n[4], n[5], n[6], n[8], n[9], n[10]], DVec3::new(n[3], n[7], n[11]))
        }
        16 => return Err("an affine matrix (last row 0 0 0 1)"),
        _ => return Err(EXPECTED),
    };
    Ok(DAffine3::from_mat3_translation(DMat3::from_cols_array(&linear).transpose(), translation))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn look_at_puts_plus_x_to_the_image_left() {
        let m = look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 2.0, 7.0), DVec3::Y).expect("a frame");
        assert_eq!(m.matrix3, DMat3::IDENTITY, "looking along +z with +y up is the camera's own frame");
        assert_eq!(m.translation, DVec3::new(1.0, 2.0, 3.0));
        assert!(look_at(DVec3::ZERO, DVec3::Y, DVec3::Y).is_none());
    }

    #[test]
    fn matrices_are_row_major() {
        let m = matrix(&numbers("1 2 3 4, 5 6 7 8, 9 10 11 12, 0 0 0 1").expect("numbers")).expect("a matrix");
        assert_eq!(m.transform_point3(DVec3::new(1.0, 0.0, 0.0)), DVec3::new(5.0, 13.0, 21.0));
    }

    #[test]
    fn rotations_are_right_handed() {
        let turned = rotate(DVec3::Z, 90.0).expect("an axis").transform_vector3(DVec3::X);
        assert!((turned - DVec3::Y).length() < 1e-15, "{turned}");
    }

    #[test]
    fn numbers_take_commas_and_spaces_and_refuse_the_rest() {
        assert_eq!(numbers(" 1, 2\t3e-1,"), Some(vec![1.0, 2.0, 0.3]));
        for bad in ["1 x", "nan", "inf", "1e400", "#ff0000"] {
            assert_eq!(numbers(bad), None, "{bad}");
        }
    }
}

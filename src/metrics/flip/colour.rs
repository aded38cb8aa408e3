//! Colours as FLIP compares them.
//!
//! Linear sRGB becomes tristimulus values X, Y, Z relative to the white of the screen (D65), so that white is (1, 1, 1). Filters act
//! on the opponent channels (Y, X − Y, Y − Z), a linear map of it: YCxCz without its constants, which filters that keep a constant
//! leave alone. Distances are measured in CIELAB with chroma scaled by lightness.

/// Linear sRGB to X, Y, Z relative to white: IEC 61966-2-1 primaries, D65 at chromaticity (0.3127, 0.3290), each row divided by its
/// sum. Rational, from the primaries (FLIP 2020, section 4.1, and its authors' program).
const TO_RELATIVE_XYZ: [[f32; 3]; 3] = {
    const X: f64 = 10135552.0 + 8788810.0 + 4435075.0;
    const Y: f64 = 2613072.0 + 8788810.0 + 887015.0;
    const Z: f64 = 1425312.0 + 8788810.0 + 70074185.0;
    [
        [(10135552.0 / X) as f32, (8788810.0 / X) as f32, (4435075.0 / X) as f32],
        [(2613072.0 / Y) as f32, (8788810.0 / Y) as f32, (887015.0 / Y) as f32],
        [(1425312.0 / Z) as f32, (8788810.0 / Z) as f32, (70074185.0 / Z) as f32],
    ]
};

/// Inverse of [`TO_RELATIVE_XYZ`].
const FROM_RELATIVE_XYZ: [[f32; 3]; 3] = inverse(TO_RELATIVE_XYZ);

/// Below this share of white, the cube root of CIELAB goes on as a straight line: (6/29)³.
const LINEAR_BELOW: f32 = 216.0 / 24389.0;

/// Luminance, red against green, blue against yellow.
#[derive(Clone, Copy)]
pub(super) struct Opponent(pub [f32; 3]);

impl Opponent {
    /// Of a linear sRGB colour.
    pub fn of(rgb: [f32; 3]) -> Self {
        let [x, y, z] = product(&TO_RELATIVE_XYZ, rgb);
        Self([y, x - y, y - z])
    }

    fn relative_xyz(self) -> [f32; 3] {
        let [y, red, blue] = self.0;
        [y + red, y, y - blue]
    }
}

/// Lightness and the two chroma coordinates of CIELAB, the latter times lightness/100: colours look paler in the dark (Hunt 1952).
pub(super) struct PerceivedColour([f32; 3]);

impl PerceivedColour {
    /// Of a filtered colour, which is first cut to what a screen can show.
    pub fn of(filtered: Opponent) -> Self {
        let shown = product(&FROM_RELATIVE_XYZ, filtered.relative_xyz()).map(|v| v.clamp(0.0, 1.0));
        let [x, y, z] = product(&TO_RELATIVE_XYZ, shown).map(cie_root);
        let lightness = 116.0 * y - 16.0;
        Self([lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z)])
    }

    /// HyAB: the difference in lightness plus the distance in chroma (Abasi, Amani Tehran, Fairchild 2020).
    pub fn distance(&self, other: &Self) -> f32 {
        let [lightness, a, b] = std::array::from_fn(|c| self.0[c] - other.0[c]);
        lightness.abs() + (a * a + b * b).sqrt()
    }
}

/// The function f of CIELAB (CIE 15).
fn cie_root(t: f32) -> f32 {
    if t > LINEAR_BELOW { t.cbrt() } else { t * (841.0 / 108.0) + 4.0 / 29.0 }
}

/// Luminance of a linear sRGB colour (Rec. 709 weights).
pub(super) fn luminance(rgb: [f32; 3]) -> f32 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}

fn product(matrix: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// Cofactors over the determinant, in f64.
const fn inverse(m: [[f32; 3]; 3]) -> [[f32; 3]; 3] {
    let mut out = [[0.0; 3]; 3];
    let mut determinant = 0.0;
    let mut row = 0;
    while row < 3 {
        let mut column = 0;
        while column < 3 {
            let (r1, r2, c1, c2) = ((row + 1) % 3, (row + 2) % 3, (column + 1) % 3, (column + 2) % 3);
            out[column][row] = m[r1][c1] as f64 * m[r2][c2] as f64 - m[r1][c2] as f64 * m[r2][c1] as f64;
            if row == 0 {
                determinant += m[0][column] as f64 * out[column][0];
            }
            column += 1;
        }
        row += 1;
    }
    let mut result = [[0.0_f32; 3]; 3];
    let mut i = 0;
    while i < 9 {
        result[i / 3][i % 3] = (out[i / 3][i % 3] / determinant) as f32;
        i += 1;
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    /// White is (1, 1, 1) and has no chroma; CIELAB of the primaries: B. Lindbloom's calculator, D65, e.g. green (87.735, -86.18,
    /// 83.18).
    #[test]
    fn colours_have_their_coordinates_in_cielab() {
        let white = PerceivedColour::of(Opponent::of([1.0; 3]));
        assert!((white.0[0] - 100.0).abs() < 1e-3 && white.0[1].abs() < 1e-3 && white.0[2].abs() < 1e-3, "{:?}", white.0);
        let [lightness, a, b] = PerceivedColour::of(Opponent::of([0.0, 1.0, 0.0])).0;
        assert!((lightness - 87.735).abs() < 0.01, "{lightness}");
        assert!((a / 0.87735 + 86.18).abs() < 0.05 && (b / 0.87735 - 83.18).abs() < 0.05, "{a} {b}");
    }
}

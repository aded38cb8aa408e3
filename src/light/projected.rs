//! Flat lamps sampled by projected solid angle: what a diffuse receiver sees of a lamp that nothing hides has (almost) no variance.
//!
//! A convex polygon above the receiver's horizon, projected onto the unit sphere and from there straight down onto the disk of
//! the receiver, is bounded by arcs of ellipses about the middle of the disk; its area there is its unoccluded irradiance
//! [Peters21]. As there, it is divided by azimuth at its corners into sectors between two ellipses. Peters finds the azimuth by
//! Newton's iteration on the exact area, which takes a dozen arc tangents; here the density along the azimuth is linear between
//! a few nodes of a sector, a warp of the primary square in the sense of [Hart20]. The density of a direction accounts for what is
//! lost: samples vary by half a per cent (median over random lamps) to five (99th centile).

use super::Receiver;
use crate::geometry::triangle;
use crate::math::{DVec2, DVec3, Vec2, Vec3};

/// Lamps of more faces are sampled by area: each face that is turned to the receiver costs some 100 ns.
const MOST_FACES: usize = 8;

/// A lamp whose radius is below this share of its distance is sampled by area, which is as good there: over its surface the
/// receiver's cosine, the lamp's cosine and the squared distance change by some 2 %.
const FAR: f64 = 1.0 / 128.0;

/// The same for receivers in passing. On the Cornell box paths are then 0.83 times as dear and their squared error is 1.02 times as large.
const FAR_IN_PASSING: f64 = 1.0 / 4.0;

/// A sector is cut in two where the middle of its outer border, as a chord, has a squared length below this share of its ends', as
/// happens beyond some 45 degrees.
const WIDE: f64 = 0.85;

/// Pieces of a sector over which its density is taken to be linear.
const PIECES: usize = 4;

/// A face that needs more sectors than this is met too closely.
const MOST_SECTORS: usize = 64;

/// Least cosine to the axis at which a corner may lie for a receiver that faces all ways.
const LEAST_COSINE: f64 = 0.3;

/// The flat faces of a lamp of constant radiance.
#[derive(Debug, Clone)]
pub struct Faces {
    faces: Vec<Face>,
    /// Face of each triangle.
    face_of: Vec<u32>,
    center: DVec3,
    radius: f64,
}

/// A convex polygon that shines to one side.
#[derive(Debug, Clone)]
struct Face {
    /// Corners, clockwise as seen from the side that shines, so that the polygon lies left of its edges in the receiver's sky.
    corners: [DVec3; 4],
    /// Number of them: 3 or 4.
    count: usize,
    /// Unit normal of that side.
    normal: DVec3,
    /// How far a ray must end before it, per coordinate.
    error: f32,
}

/// A direction to a lamp.
#[derive(Debug, Clone, Copy)]
pub struct Toward {
    /// Unit direction.
    pub direction: DVec3,
    /// Density per steradian.
    pub pdf: f64,
    /// Point of the lamp.
    pub position: DVec3,
    /// Unit normal there.
    pub normal: DVec3,
    /// Bound on the rounding of the point, per coordinate.
    pub error: f32,
}

/// The faces of a lamp in the sky of one receiver.
pub struct Seen<'a> {
    faces: &'a Faces,
    point: DVec3,
    frame: [DVec3; 3],
    sectors: Vec<Sector>,
    /// Sum of the weights of all sectors: the projected solid angle [sr], about.
    total: f64,
}

/// Part of a face between two azimuths less than a right angle apart, and between its outer and its inner edge there.
#[derive(Debug, Clone, Copy)]
struct Sector {
    face: u32,
    /// True if the inner border is the zenith.
    open: bool,
    from: Border,
    to: Border,
    half_sine: f64,
    /// Area on the disk per t at equal steps: half the difference of the squared radii times the change of azimuth.
    nodes: [f64; PIECES + 1],
}

/// Where a sector begins or ends. Between, all three are linear in t.
#[derive(Debug, Clone, Copy)]
struct Border {
    /// Horizontal vector to that azimuth.
    d: DVec2,
    /// Height above it of the outer edge, which is the lower one.
    outer: f64,
    /// Height of the inner edge.
    inner: f64,
}

#[inline]
fn lerp(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

impl Faces {
    /// The faces of a lamp: its triangles, those that form a convex quadrilateral together as one. `None` if there are too many.
    pub fn of(triangles: &[[Vec3; 3]]) -> Option<Self> {
        if triangles.is_empty() || triangles.len() > 2 * MOST_FACES {
            return None;
        }
        let mut face_of = vec![u32::MAX; triangles.len()];
        let mut faces: Vec<Face> = Vec::new();
        for i in 0..triangles.len() {
            if face_of[i] != u32::MAX {
                continue;
            }
            face_of[i] = faces.len() as u32;
            let partner = (i + 1..triangles.len()).filter(|&j| face_of[j] == u32::MAX);
            let joined = partner.filter_map(|j| Some((j, Face::of_two(&triangles[i], &triangles[j])?))).next();
            faces.push(match joined {
                Some((j, face)) => {
                    face_of[j] = faces.len() as u32;
                    face
                }
                None => Face::of_triangle(&triangles[i])?,
            });
        }
        let corners = || triangles.iter().flatten().map(|p| p.as_dvec3());
        let center = corners().sum::<DVec3>() / (3 * triangles.len()) as f64;
        let radius = corners().map(|p| p.distance(center)).fold(0.0, f64::max);
        (faces.len() <= MOST_FACES).then_some(Self { faces, face_of, center, radius })
    }

    /// The lamp in the sky of a receiver at `point`. For one that faces all ways solid angle counts about as it is. Empty: nothing of it shines there. `None`: to be sampled by area.
    // Inlined by force, with what it calls: copies of what it returns cost 30 ns.
    #[inline(always)]
    pub fn seen_from(&self, point: Vec3, receiver: Receiver) -> Option<Seen<'_>> {
        let point = point.as_dvec3();
        let to_center = self.center - point;
        let distance2 = to_center.length_squared();
        let far = if receiver.in_passing { FAR_IN_PASSING } else { FAR };
        if self.radius * self.radius < far * far * distance2 {
            return None;
        }
        let axis = match receiver.normal {
            Some(n) => n.as_dvec3().normalize(),
            None => to_center / distance2.sqrt(),
        };
        let mut seen = Seen { faces: self, point, frame: frame(axis), sectors: Vec::with_capacity(6), total: 0.0 };
        for (i, face) in self.faces.iter().enumerate() {
            // Within rounding of its plane a point lies on the face, as those of the lamp itself do, and does not see it: seen from the least
            // height above, it would fill the sky.
            if face.normal.dot(point - face.corners[0]) > f64::from(face.error) {
                seen.add(i as u32, face, receiver.normal.is_none())?;
            }
        }
        seen.total.is_finite().then_some(seen)
    }
}

impl Face {
    fn of_triangle(&[a, b, c]: &[Vec3; 3]) -> Option<Self> {
        let normal = triangle::area_vector(a, b, c).try_normalize()?;
        let corners = [a, c, b, b].map(|p| p.as_dvec3());
        Some(Self { corners, count: 3, normal, error: 2.0 * triangle::leaving_error(a, b, c) })
    }

    /// The quadrilateral of two triangles that share an edge, if it is flat and convex.
    fn of_two(one: &[Vec3; 3], two: &[Vec3; 3]) -> Option<Self> {
        // Turn both so that the shared edge is (a, b) of the first and (b, a) of the second.
        let turned = |t: &[Vec3; 3], k: usize| [t[k], t[(k + 1) % 3], t[(k + 2) % 3]];
        let pairs = (0..9).map(|k| (turned(one, k / 3), turned(two, k % 3)));
        let ([a, b, c], [_, _, d]) = pairs.into_iter().find(|(s, t)| s[0] == t[1] && s[1] == t[0])?;
        let normal = (triangle::area_vector(a, b, c) + triangle::area_vector(b, a, d)).try_normalize()?;
        let error = triangle::leaving_error(a, b, c).max(triangle::leaving_error(b, a, d));
        let corners = [a, d, b, c].map(|p| p.as_dvec3());
        let middle = (corners[0] + corners[1] + corners[2] + corners[3]) / 4.0;
        let flat = corners.iter().all(|p| (*p - middle).dot(normal).abs() <= f64::from(error));
        let turn = |k: usize| {
            let [p, q, r] = [0, 1, 2].map(|i| corners[(k + i) % 4]);
            let (e, f) = (q - p, r - q);
            e.cross(f).dot(normal) / (e.length() * f.length())
        };
        let convex = (0..4).all(|k| turn(k) > 1e-3);
        let corners = [corners[0], corners[3], corners[2], corners[1]];
        (flat && convex).then_some(Self { corners, count: 4, normal, error: 3.0 * error })
    }
}

/// Two tangents and the unit vector `n` itself (Duff et al. 2017), in f64.
#[inline]
fn frame(n: DVec3) -> [DVec3; 3] {
    let sign = 1.0_f64.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    [DVec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), DVec3::new(b, sign + n.y * n.y * a, -n.y), n]
}

impl Seen<'_> {
    /// Adds a face that is turned to the receiver. `None` where rounding leaves nothing to divide by, or, for a receiver that faces all
    /// ways, where the face reaches too far from the axis.
    #[inline(always)]
    fn add(&mut self, index: u32, face: &Face, all_ways: bool) -> Option<()> {
        let [s, t, n] = self.frame;
        let mut sky = Polygon::default();
        let mut lowest = f64::INFINITY;
        for &corner in &face.corners[..face.count] {
            let v = corner - self.point;
            let v = DVec3::new(v.dot(s), v.dot(t), v.dot(n));
            lowest = lowest.min(if all_ways { v.z - LEAST_COSINE * v.length() } else { v.z });
            sky.push(v);
        }
        if lowest < 0.0 {
            if all_ways {
                return None;
            }
            sky = sky.above_horizon();
            if sky.count < 3 {
                return Some(());
            }
        }
        self.add_polygon(index, &sky)
    }

    /// Divides a convex polygon above the horizon into sectors.
    #[inline(always)]
    fn add_polygon(&mut self, face: u32, sky: &Polygon) -> Option<()> {
        let count = sky.count;
        let next = |k: usize| if k + 1 == count { 0 } else { k + 1 };
        let before = |k: usize| if k == 0 { count - 1 } else { k - 1 };
        // Edges along which the azimuth grows have the polygon on the side of the zenith: they are outer borders. One bit each.
        let rising = (0..count).fold(0_u32, |bits, k| bits | u32::from(sky.xy(k).perp_dot(sky.xy(next(k))) > 0.0) << k);
        let n_rising = rising.count_ones() as usize;
        if n_rising == count {
            // The zenith lies inside.
            for k in 0..count {
                let [a, b] = [k, next(k)].map(|k| Border::corner(sky.corners[k]));
                self.push(face, a, b, true)?;
            }
            return Some(());
        }
        // Seen from the zenith the polygon lies within half a turn: outer borders lead from the least azimuth to the greatest, inner
        // ones back. Rounding breaks this only where next to nothing is seen.
        let starts = rising & !(rising << 1 | rising >> (count - 1));
        if starts.count_ones() != 1 {
            return None;
        }
        let first = starts.trailing_zeros() as usize;
        let last = (first + n_rising) % count;
        let (mut outer, mut inner) = (first, first);
        let mut from = Border::corner(sky.corners[first]);
        loop {
            let (o, i) = (next(outer), before(inner));
            if o == last && i == last {
                return self.push(face, from, Border::corner(sky.corners[last]), false);
            }
            // The border whose next corner comes first goes on there; the other is met between two corners.
            let to = if o != last && (i == last || sky.xy(o).perp_dot(sky.xy(i)) >= 0.0) {
                let v = sky.corners[o];
                let height = height_between(sky.corners[inner], sky.corners[i], v.truncate());
                outer = o;
                Border::new(v.truncate(), v.z, height.max(v.z))
            } else {
                let v = sky.corners[i];
                let height = height_between(sky.corners[outer], sky.corners[o], v.truncate());
                inner = i;
                Border::new(v.truncate(), height.min(v.z), v.z)
            };
            self.push(face, from, to, false)?;
            from = to;
        }
    }

    /// Adds a sector, cut where it is wide.
    #[inline]
    fn push(&mut self, face: u32, from: Border, to: Border, open: bool) -> Option<()> {
        let sine = from.d.perp_dot(to.d);
        if sine <= 0.0 {
            return sine.is_finite().then_some(());
        }
        let middle = from.halfway(&to);
        if middle.length2() < WIDE * from.length2().min(to.length2()) {
            return self.push_halves(face, from, to, open);
        }
        let mut sector = Sector { face, from, to, open, half_sine: 0.5 * sine, nodes: [0.0; PIECES + 1] };
        for k in 0..=PIECES {
            sector.nodes[k] = sector.density(k as f64 / PIECES as f64);
        }
        self.total += sector.weight();
        self.sectors.push(sector);
        Some(())
    }

    #[cold]
    fn push_halves(&mut self, face: u32, from: Border, to: Border, open: bool) -> Option<()> {
        let middle = from.halfway(&to);
        let middle =
            if open { Border::corner(middle.d.extend(middle.outer)) } else { Border::new(middle.d, middle.outer, middle.inner) };
        // Borders half a turn apart leave no middle, and the zenith on an edge.
        if !middle.d.is_finite() || self.sectors.len() > MOST_SECTORS {
            return None;
        }
        self.push(face, from, middle, open)?;
        self.push(face, middle, to, open)
    }

    /// A direction to the lamp; its density over the disk of the receiver is almost constant. `None` if rounding leads nowhere.
    #[inline]
    pub fn sample(&self, u: Vec2) -> Option<Toward> {
        let mut rest = f64::from(u.x) * self.total;
        let mut sector = self.sectors.first()?;
        for candidate in &self.sectors {
            sector = candidate;
            let weight = sector.weight();
            if rest < weight {
                break;
            }
            rest -= weight;
        }
        let (t, linear) = sector.invert(rest);
        let at = sector.from.lerp(&sector.to, t);
        let length2 = at.d.length_squared();
        let far = 1.0 / (length2 + at.outer * at.outer);
        let near = if sector.open { 0.0 } else { 1.0 / (length2 + at.inner * at.inner) };
        let top = if sector.open { 1.0 } else { at.inner * at.inner * near };
        let y = f64::from(u.y);
        // Uniform in the squared radius, which over the squared length of d is `near` to `far`.
        let xy = at.d * lerp(near, far, y).sqrt();
        let z = lerp(top, at.outer * at.outer * far, y).sqrt();
        let [x_axis, y_axis, n] = self.frame;
        let direction = x_axis * xy.x + y_axis * xy.y + n * z;
        let face = &self.faces.faces[sector.face as usize];
        let distance = face.normal.dot(face.corners[0] - self.point) / face.normal.dot(direction);
        let pdf = z * linear / (sector.density(t) * self.total);
        (pdf > 0.0 && pdf.is_finite() && distance > 0.0 && distance.is_finite()).then(|| Toward {
            direction,
            pdf,
            position: self.point + direction * distance,
            normal: face.normal,
            error: face.error,
        })
    }

    /// Density per steradian with which [`Seen::sample`] finds `direction`, which meets triangle `index` of the lamp.
    #[inline]
    pub fn pdf(&self, direction: Vec3, index: usize) -> f64 {
        let direction = direction.as_dvec3();
        let [x_axis, y_axis, n] = self.frame;
        let (d, z) = (DVec2::new(direction.dot(x_axis), direction.dot(y_axis)), direction.dot(n));
        let face = self.faces.face_of[index];
        let sectors = self.sectors.iter().filter(|s| s.face == face).map(|s| (s, s.from.d.perp_dot(d), d.perp_dot(s.to.d)));
        // On a border rounding decides, and either side is right.
        let Some((sector, before, after)) = sectors.max_by(|a, b| a.1.min(a.2).total_cmp(&b.1.min(b.2))) else { return 0.0 };
        let (before, after) = (before.max(0.0), after.max(0.0));
        if z <= 0.0 || before + after <= 0.0 {
            return 0.0;
        }
        let t = before / (before + after);
        let density = sector.density(t);
        if density > 0.0 { z * sector.linear(t) / (density * self.total) } else { 0.0 }
    }
}

/// Corners of a convex polygon in the receiver's frame.
#[derive(Clone, Copy, Default)]
struct Polygon {
    corners: [DVec3; 6],
    count: usize,
}

impl Polygon {
    #[inline]
    fn push(&mut self, v: DVec3) {
        self.corners[self.count] = v;
        self.count += 1;
    }

    #[inline]
    fn xy(&self, k: usize) -> DVec2 {
        self.corners[k].truncate()
    }

    /// The part with z of 0 or more.
    fn above_horizon(&self) -> Self {
        let mut kept = Self::default();
        for k in 0..self.count {
            let (a, b) = (self.corners[k], self.corners[(k + 1) % self.count]);
            if a.z >= 0.0 {
                kept.push(a);
            }
            if (a.z > 0.0 && b.z < 0.0) || (a.z < 0.0 && b.z > 0.0) {
                let xy = (a.truncate() * b.z - b.truncate() * a.z) / (b.z - a.z);
                kept.push(xy.extend(0.0));
            }
        }
        kept
    }
}

/// Height of the plane through the receiver and two corners above the horizontal vector `d` between them.
#[inline]
fn height_between(a: DVec3, b: DVec3, d: DVec2) -> f64 {
    let (before, after) = (a.truncate().perp_dot(d).abs(), d.perp_dot(b.truncate()).abs());
    let whole = a.truncate().perp_dot(b.truncate()).abs();
    if whole > 0.0 { (after * a.z + before * b.z) / whole } else { a.z.max(b.z) }
}

impl Border {
    /// The horizontal vector `d` with the heights above it, scaled so that both lie near the unit sphere: then the density along a
    /// sector changes least.
    #[inline]
    fn new(d: DVec2, outer: f64, inner: f64) -> Self {
        let length2 = d.length_squared();
        let scale = 1.0 / (length2 + outer * inner).sqrt();
        Self { d: d * scale, outer: outer * scale, inner: inner * scale }
    }

    /// At a corner where the outer and the inner border meet, or where the outer is all there is.
    #[inline]
    fn corner(v: DVec3) -> Self {
        let v = v / v.length();
        Self { d: v.truncate(), outer: v.z, inner: v.z }
    }

    #[inline]
    fn halfway(&self, to: &Self) -> Self {
        self.lerp(to, 0.5)
    }

    #[inline]
    fn lerp(&self, to: &Self, t: f64) -> Self {
        Self { d: self.d + (to.d - self.d) * t, outer: lerp(self.outer, to.outer, t), inner: lerp(self.inner, to.inner, t) }
    }

    #[inline]
    fn length2(&self) -> f64 {
        self.d.length_squared() + self.outer * self.outer
    }
}

impl Sector {
    /// Area on the disk per t.
    #[inline]
    fn density(&self, t: f64) -> f64 {
        let at = self.from.lerp(&self.to, t);
        let length2 = at.d.length_squared();
        let far = length2 + at.outer * at.outer;
        if self.open {
            return self.half_sine / far;
        }
        // 1/(d² + outer²) - 1/(d² + inner²) without the cancellation.
        self.half_sine * (at.inner - at.outer) * (at.inner + at.outer) / (far * (length2 + at.inner * at.inner))
    }

    /// Integral of the density that is linear between the nodes.
    #[inline]
    fn weight(&self) -> f64 {
        let ends = 0.5 * (self.nodes[0] + self.nodes[PIECES]);
        (ends + self.nodes[1..PIECES].iter().sum::<f64>()) / PIECES as f64
    }

    /// That density at `t`.
    #[inline]
    fn linear(&self, t: f64) -> f64 {
        let x = t * PIECES as f64;
        let k = (x as usize).min(PIECES - 1);
        lerp(self.nodes[k], self.nodes[k + 1], x - k as f64)
    }

    /// The t below which the integral of that density is `weight`, and the density there.
    #[inline]
    fn invert(&self, weight: f64) -> (f64, f64) {
        let mut rest = weight * (2 * PIECES) as f64;
        let mut k = 0;
        let pair = |k: usize| self.nodes[k] + self.nodes[k + 1];
        while k + 1 < PIECES && rest >= pair(k) {
            rest -= pair(k);
            k += 1;
        }
        let (a, b) = (self.nodes[k], self.nodes[k + 1]);
        let root = (a * a + (b - a) * rest.min(a + b)).max(0.0).sqrt();
        let x = (rest / (a + root)).min(1.0);
        ((k as f64 + x) / PIECES as f64, root)
    }
}

//! A tree over many lights: picks one by its likely contribution at a point, in time that grows with their logarithm.
//!
//! After [ContyKulla18] and [PBRT4], but with eight children a node, which are weighed at once, and with a look into all large
//! nodes nearby before the first choice, which in a room full of lamps lowers the variance several times.

use super::Light;
use super::bounds::EmissionBounds;
use crate::math::Vec3;
use wide::{CmpGe, CmpGt, CmpLe, f32x8};

/// Children of a node.
const WIDTH: usize = 8;

/// Most nodes that are looked into before the first choice.
const CUT: usize = 32;

/// Nodes are looked into whose ball has a radius above this share of its distance.
const NEAR: f32 = 0.35;

/// Slots into which each axis is cut to find a split.
const SLOTS: usize = 12;

/// Slack on squared sines of bounding angles: rounding must not make a light at the rim of a cone or horizon impossible.
const SLACK: f32 = 1e-8;

/// Least factor for a direction in which light may leave; it keeps grazing and dim parts of a cone possible.
const LEAST_COSINE: f32 = 0.02;

/// Lights by their index in the caller's list, with their bounds.
type Group = Vec<(u32, EmissionBounds)>;

/// Where a light stands: its node and which child it is.
#[derive(Debug, Clone, Copy)]
struct Place {
    node: u32,
    child: u32,
}

/// What a child of a node is.
#[derive(Debug, Clone, Copy)]
enum Child {
    /// Another node.
    Node(u32),
    /// A light, by its index in the caller's list.
    Light(u32),
}

/// Up to eight groups of lights, one array for each property, so that all are weighed at once.
#[derive(Debug, Clone)]
struct Node {
    center: [[f32; WIDTH]; 3],
    /// Squared radius of the ball around the box.
    radius2: [f32; WIDTH],
    axis: [[f32; WIDTH]; 3],
    cos_normals: [f32; WIDTH],
    sin_normals: [f32; WIDTH],
    cos_emission: [f32; WIDTH],
    /// 0 where there is no child.
    strength: [f32; WIDTH],
    children: Vec<Child>,
    parent: Option<Place>,
}

/// Picks lights by their likely contribution. Suns and surroundings, which have no place, stand beside the tree.
#[derive(Debug, Clone)]
pub struct LightTree {
    /// The root is the first; empty: no light has a place.
    nodes: Vec<Node>,
    /// Lights beside the tree, with their index in the caller's list.
    beside: Vec<(u32, Light)>,
    /// Where each light of the caller's list stands; `None`: beside the tree or not in it.
    places: Vec<Option<Place>>,
}

impl LightTree {
    /// A tree over those of `lights` that `subset` names; dark ones are left out.
    pub fn new(lights: &[Light], subset: &[usize]) -> Self {
        let mut tree = Self { nodes: Vec::new(), beside: Vec::new(), places: vec![None; lights.len()] };
        let mut placed = Vec::with_capacity(subset.len());
        for &i in subset {
            match (&lights[i], EmissionBounds::of(&lights[i])) {
                (_, Some(bounds)) => placed.push((i as u32, bounds)),
                (light @ (Light::Directional(_) | Light::Environment(_)), None) if !light.is_dark() => {
                    tree.beside.push((i as u32, light.clone()));
                }
                _ => {}
            }
        }
        if !placed.is_empty() {
            tree.build(placed, None);
        }
        tree
    }

    /// Adds the node of a group and all below it; its index.
    fn build(&mut self, lights: Group, parent: Option<Place>) -> u32 {
        let index = self.nodes.len() as u32;
        let mut groups = vec![lights];
        while groups.len() < WIDTH {
            // The group that costs most is split next.
            let costs = groups.iter().enumerate().filter(|(_, g)| g.len() > 1).map(|(i, g)| (i, union(g).cost()));
            let Some((dearest, _)) = costs.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
            let (a, b) = split(groups.swap_remove(dearest));
            groups.extend([a, b]);
        }
        let bounds: Vec<EmissionBounds> = groups.iter().map(|g| union(g)).collect();
        self.nodes.push(Node::new(&bounds, parent));
        for (child, group) in groups.into_iter().enumerate() {
            let place = Place { node: index, child: child as u32 };
            let child = if let [(light, _)] = group[..] {
                self.places[light as usize] = Some(place);
                Child::Light(light)
            } else {
                Child::Node(self.build(group, Some(place)))
            };
            self.nodes[index as usize].children.push(child);
        }
        index
    }

    /// The tree as seen from `point` by a receiver with normal `n` (`None`: one that faces all ways). Made once for all picks there.
    #[inline]
    pub fn view(&self, point: Vec3, n: Option<Vec3>) -> LightView<'_> {
        let cut = (!self.nodes.is_empty()).then(|| Cut::new(&self.nodes, point, n));
        let shares = self.shares(n, cut.as_ref());
        LightView { tree: self, point, n, cut, shares }
    }

    /// One pick of [`LightTree::view`].
    #[inline]
    pub fn pick(&self, point: Vec3, n: Option<Vec3>, u: f32) -> Option<(usize, f64, f32)> {
        self.view(point, n).pick(u)
    }

    /// One probability of [`LightTree::view`].
    pub fn probability(&self, point: Vec3, n: Option<Vec3>, light: usize) -> f64 {
        self.view(point, n).probability(light)
    }

    /// How picks are shared among the lights beside the tree and the tree: half of them evenly, half by rough irradiance, since
    /// what is rough about it, visibility, differs most between a sun and a lamp.
    #[inline]
    fn shares(&self, n: Option<Vec3>, cut: Option<&Cut>) -> Shares {
        let tree = cut.map_or(0.0, |cut| cut.entries[0].total());
        if self.beside.is_empty() {
            return Shares { tree: if tree > 0.0 { 1.0 } else { 0.0 }, each: Vec::new() };
        }
        // A receiver that faces all ways gets from the sun what one gets that faces it.
        let importance = |light: &Light| match (light, n) {
            (_, Some(n)) => light.importance(Vec3::ZERO, n),
            (Light::Directional(l), None) => l.irradiance.luminance(),
            (Light::Environment(e), None) => 2.0 * std::f64::consts::PI * e.mean().luminance(),
            _ => 0.0,
        };
        let mut each: Vec<f64> = self.beside.iter().map(|(_, l)| importance(l)).collect();
        let total = tree + each.iter().sum::<f64>();
        let active = each.iter().chain([&tree]).filter(|w| **w > 0.0).count() as f64;
        let share = |w: f64| if w > 0.0 { 0.5 / active + 0.5 * w / total } else { 0.0 };
        each.iter_mut().for_each(|w| *w = share(*w));
        Shares { tree: share(tree), each }
    }
}

/// A [`LightTree`] as seen from one receiver.
pub struct LightView<'a> {
    tree: &'a LightTree,
    point: Vec3,
    n: Option<Vec3>,
    /// `None` if no light has a place.
    cut: Option<Cut>,
    shares: Shares,
}

impl LightView<'_> {
    /// A light by its likely contribution, the probability of that choice, and `u` made uniform again for another use. `None` if
    /// no light can contribute. Growing `u` passes the lights in a fixed order, so that evenly spaced ones pick evenly.
    #[inline]
    pub fn pick(&self, u: f32) -> Option<(usize, f64, f32)> {
        let (tree, shares) = (self.tree, &self.shares);
        let mut u = f64::from(u);
        for (&share, (light, _)) in shares.each.iter().zip(&tree.beside) {
            if u < share {
                return Some((*light as usize, share, shrink(u / share)));
            }
            u -= share;
        }
        let Some(cut) = self.cut.as_ref().filter(|_| shares.tree > 0.0) else {
            // Rounding led past the last light beside the tree, or there is none.
            let k = shares.each.iter().rposition(|s| *s > 0.0)?;
            return Some((tree.beside[k].0 as usize, shares.each[k], 0.0));
        };
        let mut u = (u / shares.tree).min(1.0 - f64::EPSILON);
        let mut probability = shares.tree;
        let mut weighed = cut.entries[0];
        loop {
            let (child, share, rest) = weighed.choose(u);
            probability *= share;
            u = rest;
            weighed = match (tree.nodes[weighed.node as usize].children[child], weighed.entry[child]) {
                (Child::Light(light), _) => return Some((light as usize, probability, shrink(u))),
                (Child::Node(next), 0) => self.weigh(next),
                (Child::Node(_), entry) => cut.entries[entry as usize],
            };
        }
    }

    /// Probability with which [`LightView::pick`] finds `light`; 0 if never.
    pub fn probability(&self, light: usize) -> f64 {
        let (tree, shares) = (self.tree, &self.shares);
        if let Some(k) = tree.beside.iter().position(|(l, _)| *l as usize == light) {
            return shares.each[k];
        }
        let (Some(&Some(mut place)), Some(cut)) = (tree.places.get(light), &self.cut) else { return 0.0 };
        let mut probability = shares.tree;
        while probability > 0.0 {
            let in_cut = cut.entries[..cut.len].iter().find(|e| e.node == place.node);
            let weighed = in_cut.copied().unwrap_or_else(|| self.weigh(place.node));
            probability *= weighed.each[place.child as usize] / weighed.total();
            match tree.nodes[place.node as usize].parent {
                Some(parent) => place = parent,
                None => return probability,
            }
        }
        0.0
    }

    /// The weights of a node below the cut, or its strengths if all are 0: whoever came here takes some light, even though none
    /// contributes, so that probabilities still sum to 1.
    #[inline]
    fn weigh(&self, node: u32) -> Weighed {
        let of = |each: [f32; WIDTH]| Weighed { node, each: each.map(f64::from), entry: [0; WIDTH] };
        let weighed = of(self.tree.nodes[node as usize].weights(self.point, self.n).0);
        if weighed.total() > 0.0 { weighed } else { of(self.tree.nodes[node as usize].strength) }
    }
}

/// Probabilities of the tree and of each light beside it.
struct Shares {
    tree: f64,
    each: Vec<f64>,
}

/// A node whose children have been weighed.
#[derive(Clone, Copy)]
struct Weighed {
    node: u32,
    each: [f64; WIDTH],
    /// Which entry of the cut stands for each child; 0, the root's: none does.
    entry: [u8; WIDTH],
}

impl Weighed {
    fn total(&self) -> f64 {
        self.each.iter().sum()
    }

    /// A child by weight, its probability, and `u` stretched.
    #[inline]
    fn choose(&self, u: f64) -> (usize, f64, f64) {
        let total = self.total();
        let mut rest = u * total;
        let mut last = (0, 0.0);
        for (i, &w) in self.each.iter().enumerate() {
            if w > 0.0 {
                if rest < w {
                    return (i, w / total, rest / w);
                }
                rest -= w;
                last = (i, w / total);
            }
        }
        (last.0, last.1, 1.0 - f64::EPSILON)
    }
}

/// The upper part of a tree as seen from a receiver: nodes that look small are weighed as one, larger ones by their children.
///
/// A ball that holds the receiver says nothing about what its lights send there; looking inside before the first choice does.
struct Cut {
    entries: [Weighed; CUT],
    len: usize,
}

impl Cut {
    fn new(nodes: &[Node], point: Vec3, n: Option<Vec3>) -> Self {
        let weigh = |node: u32| {
            let (each, near) = nodes[node as usize].weights(point, n);
            (Weighed { node, each: each.map(f64::from), entry: [0; WIDTH] }, near)
        };
        let (root, near) = weigh(0);
        let mut cut = Self { entries: [root; CUT], len: 1 };
        let mut nears = [near; CUT];
        let mut parents = [(0_u8, 0_u8); CUT];
        let mut at = 0;
        while at < cut.len {
            for child in 0..nodes[cut.entries[at].node as usize].children.len() {
                let Child::Node(next) = nodes[cut.entries[at].node as usize].children[child] else { continue };
                if nears[at][child] > 0.0 && cut.entries[at].each[child] > 0.0 && cut.len < CUT {
                    cut.entries[at].entry[child] = cut.len as u8;
                    parents[cut.len] = (at as u8, child as u8);
                    (cut.entries[cut.len], nears[cut.len]) = weigh(next);
                    cut.len += 1;
                }
            }
            at += 1;
        }
        // Children stand behind their parents: from the end, each sum is complete when it is handed up.
        for at in (1..cut.len).rev() {
            let (parent, child) = parents[at];
            cut.entries[parent as usize].each[child as usize] = cut.entries[at].total();
        }
        cut
    }
}

#[inline]
fn shrink(u: f64) -> f32 {
    (u as f32).clamp(0.0, 1.0 - f32::EPSILON)
}

impl Node {
    fn new(bounds: &[EmissionBounds], parent: Option<Place>) -> Self {
        let none = [0.0; WIDTH];
        let mut node = Self {
            center: [none; 3],
            radius2: none,
            axis: [none; 3],
            cos_normals: none,
            sin_normals: none,
            cos_emission: none,
            strength: none,
            children: Vec::with_capacity(bounds.len()),
            parent,
        };
        for (i, b) in bounds.iter().enumerate() {
            let center = b.bounds.center();
            for axis in 0..3 {
                node.center[axis][i] = center[axis];
                node.axis[axis][i] = b.axis[axis] as f32;
            }
            // Rounding of the centre must not leave a corner outside.
            let radius = 0.5 * b.bounds.diagonal() * (1.0 + 4.0 * f32::EPSILON);
            node.radius2[i] = radius * radius;
            node.cos_normals[i] = b.normals.cos() as f32;
            node.sin_normals[i] = b.normals.sin() as f32;
            node.cos_emission[i] = b.emission.cos() as f32;
            node.strength[i] = b.strength as f32;
        }
        node
    }

    /// Rough irradiance from each child at `point`, with receiver `n`; 0 only where the truth is [ContyKulla18]. And
    /// which children are near: the ball around them looks large from there.
    ///
    /// All children at once. Angles are subtracted by their sines and cosines.
    #[inline]
    fn weights(&self, point: Vec3, n: Option<Vec3>) -> ([f32; WIDTH], [f32; WIDTH]) {
        let (zero, one) = (f32x8::ZERO, f32x8::ONE);
        let of = |a: [f32; WIDTH]| f32x8::from(a);
        let dx = f32x8::splat(point.x) - of(self.center[0]);
        let dy = f32x8::splat(point.y) - of(self.center[1]);
        let dz = f32x8::splat(point.z) - of(self.center[2]);
        let d2 = (dx * dx + dy * dy + dz * dz).fast_max(f32x8::splat(1e-16));
        let inverse = one / d2.sqrt();
        let sine = |cos: f32x8| (one - cos * cos).fast_max(zero).sqrt();
        // The angle under which the ball appears; from inside, any.
        let radius2 = of(self.radius2);
        let inside = d2.cmp_le(radius2);
        let sin2_ball = (radius2 / d2 + f32x8::splat(SLACK)).fast_min(one);
        let sin_ball = inside.blend(zero, sin2_ball.sqrt());
        let cos_ball = inside.blend(-one, (one - sin2_ball).sqrt());
        let widened = |cos: f32x8, sin: f32x8| cos.cmp_ge(cos_ball).blend(one, cos * cos_ball + sin * sin_ball);
        // From the axis to the direction towards the point, less the spread of the normals, less the ball.
        let cos = (of(self.axis[0]) * dx + of(self.axis[1]) * dy + of(self.axis[2]) * dz) * inverse;
        let sin = sine(cos);
        let (cos_o, sin_o) = (of(self.cos_normals), of(self.sin_normals));
        let within = cos.cmp_ge(cos_o);
        let beyond = within.blend(one, cos * cos_o + sin * sin_o);
        let sin_beyond = within.blend(zero, sin * cos_o - cos * sin_o);
        let leaving = widened(beyond, sin_beyond);
        let leaves = leaving.cmp_ge(of(self.cos_emission) - f32x8::splat(1e-6));
        // The best cosine of any part says what is possible; the middle's, what is likely.
        let likely = |best: f32x8, middle: f32x8| f32x8::splat(0.5) * (best + middle.fast_max(zero));
        let mut weight = of(self.strength) * likely(leaving, beyond).fast_max(f32x8::splat(LEAST_COSINE));
        if let Some(n) = n {
            // The receiver's horizon, widened by the ball.
            let cos = -(f32x8::splat(n.x) * dx + f32x8::splat(n.y) * dy + f32x8::splat(n.z) * dz) * inverse;
            let best = widened(cos, sine(cos)).fast_max(zero);
            weight *= best.cmp_gt(zero).blend(likely(best, cos), zero);
        }
        // Nearer than its size a group is as far away as it is large.
        weight /= d2.fast_max(radius2);
        let near = (radius2 - f32x8::splat(NEAR * NEAR) * d2).to_array();
        (leaves.blend(weight, zero).to_array(), near)
    }
}

fn union(lights: &[(u32, EmissionBounds)]) -> EmissionBounds {
    let mut all = lights.iter().map(|(_, b)| *b);
    let first = all.next().expect("a group has a light");
    all.fold(first, |sum, b| sum.union(&b))
}

/// Divides a group of two or more where the sum of the costs of both parts is least.
fn split(mut lights: Group) -> (Group, Group) {
    let center = |b: &EmissionBounds, axis: usize| b.bounds.center()[axis];
    let mut best: Option<(f64, usize, f32)> = None;
    for axis in 0..3 {
        let ends = lights.iter().map(|(_, b)| center(b, axis));
        let (low, high) = ends.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), c| (l.min(c), h.max(c)));
        if low >= high {
            continue;
        }
        let slot = |c: f32| (((c - low) / (high - low) * SLOTS as f32) as usize).min(SLOTS - 1);
        let mut slots: [Option<EmissionBounds>; SLOTS] = [None; SLOTS];
        for (_, b) in &lights {
            let s = &mut slots[slot(center(b, axis))];
            *s = Some(s.map_or(*b, |sum| sum.union(b)));
        }
        let sum = |part: &[Option<EmissionBounds>]| part.iter().flatten().copied().reduce(|a, b| a.union(&b));
        for cut in 1..SLOTS {
            if let (Some(a), Some(b)) = (sum(&slots[..cut]), sum(&slots[cut..])) {
                let cost = a.cost() + b.cost();
                if best.is_none_or(|(least, ..)| cost < least) {
                    best = Some((cost, axis, low + (high - low) * cut as f32 / SLOTS as f32));
                }
            }
        }
    }
    if let Some((_, axis, at)) = best {
        let (a, b): (Vec<_>, Vec<_>) = lights.iter().partition(|(_, b)| center(b, axis) < at);
        if !a.is_empty() && !b.is_empty() {
            return (a, b);
        }
    }
    // All in one place: any half will do.
    let half = lights.split_off(lights.len() / 2);
    (lights, half)
}

#[cfg(test)]
mod tests;

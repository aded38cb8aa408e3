//! Scenes made here: a box with tessellated walls, and furnished rooms of any number of triangles.

use std::sync::Arc;

use twopass::geometry::Soup;
use twopass::math::{Sampler, Vec3};

/// Name and triangles; without the large ones if `small`.
pub fn all(small: bool) -> Vec<(String, Arc<Soup>)> {
    let mut scenes =
        vec![("box, walls in one piece".to_owned(), Arc::new(cornell(1))), ("tessellated box".to_owned(), Arc::new(cornell(17)))];
    if !small {
        scenes.push(("finely tessellated box".to_owned(), Arc::new(cornell(53))));
        scenes.push(("furnished room".to_owned(), Arc::new(room(64, 8))));
        scenes.push(("finely furnished room".to_owned(), Arc::new(room(150, 12))));
    }
    scenes
}

/// The triangles of an OBJ file.
pub fn from_file(path: &str) -> (String, Arc<Soup>) {
    let options = tobj::LoadOptions { triangulate: true, single_index: true, ..tobj::LoadOptions::default() };
    let (models, _) = tobj::load_obj(path, &options).unwrap_or_else(|error| panic!("{path}: {error}, expected an OBJ file"));
    let mut soup = Soup::default();
    for model in models {
        let base = soup.vertices.len() as u32;
        soup.vertices.extend(model.mesh.positions.chunks_exact(3).map(|p| Vec3::new(p[0] as f32, p[1] as f32, p[2] as f32)));
        soup.triangles.extend(model.mesh.indices.chunks_exact(3).map(|t| [t[0] + base, t[1] + base, t[2] + base]));
    }
    (path.to_owned(), Arc::new(soup))
}

/// A unit room with two boxes in it, all 18 faces cut into `k * k` squares.
pub fn cornell(k: u32) -> Soup {
    let mut soup = Soup::default();
    add_box(&mut soup, Vec3::ZERO, Vec3::ONE, k);
    add_box(&mut soup, Vec3::new(0.13, 0.0, 0.36), Vec3::new(0.42, 0.59, 0.65), k);
    add_box(&mut soup, Vec3::new(0.53, 0.0, 0.13), Vec3::new(0.82, 0.3, 0.42), k);
    soup
}

/// A room of 6 by 3 by 8 with tables, shelves of books, and `n` knobbly balls and vases with `m`, `3 m` or `5 m` rows.
pub fn room(n: u32, m: u32) -> Soup {
    let mut soup = Soup::default();
    let size = Vec3::new(6.0, 3.0, 8.0);
    add_box(&mut soup, Vec3::ZERO, size, 12);
    for table in 0..6 {
        let at = Vec3::new(1.0 + 1.7 * (table % 3) as f32, 0.0, 2.0 + 3.0 * (table / 3) as f32);
        add_box(&mut soup, at + Vec3::new(-0.5, 0.72, -0.4), at + Vec3::new(0.5, 0.76, 0.4), 4);
        for (x, z) in [(-0.46, -0.36), (0.42, -0.36), (-0.46, 0.32), (0.42, 0.32)] {
            add_box(&mut soup, at + Vec3::new(x, 0.0, z), at + Vec3::new(x + 0.04, 0.72, z + 0.04), 1);
        }
    }
    for book in 0..1200 {
        let (shelf, place) = (book / 120, book % 120);
        let mut s = Sampler::new(4, book, 0);
        let from = Vec3::new(5.7, 0.2 + 0.25 * shelf as f32, 0.5 + 0.055 * place as f32);
        add_box(&mut soup, from, from + Vec3::new(0.14 + 0.06 * s.next_1d(), 0.15 + 0.07 * s.next_1d(), 0.05), 1);
    }
    for ball in 0..n {
        let mut s = Sampler::new(5, u64::from(ball), 0);
        let radius = 0.06 + 0.22 * s.next_1d() * s.next_1d();
        let center = Vec3::new(0.4 + 5.0 * s.next_1d(), radius + 2.4 * s.next_1d().powi(2), 0.9 + 6.6 * s.next_1d());
        add_ball(&mut soup, center, radius, 2.0 + 6.0 * s.next_1d(), m + 2 * m * (ball % 3));
    }
    soup
}

/// An axis-aligned box, each face in `k * k` squares.
fn add_box(soup: &mut Soup, low: Vec3, high: Vec3, k: u32) {
    for axis in 0..3 {
        for side in [low, high] {
            let base = soup.vertices.len() as u32;
            for (i, j) in (0..=k).flat_map(|i| (0..=k).map(move |j| (i, j))) {
                let mut p = side;
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                p[u] = low[u] + (high[u] - low[u]) * (i as f32 / k as f32);
                p[v] = low[v] + (high[v] - low[v]) * (j as f32 / k as f32);
                soup.vertices.push(p);
            }
            add_grid(soup, base, k, k);
        }
    }
}

/// A ball with waves on it, of `m` rows.
fn add_ball(soup: &mut Soup, center: Vec3, radius: f32, waves: f32, m: u32) {
    let base = soup.vertices.len() as u32;
    for (i, j) in (0..=m).flat_map(|i| (0..=2 * m).map(move |j| (i, j))) {
        let theta = std::f32::consts::PI * i as f32 / m as f32;
        let phi = std::f32::consts::PI * (j % (2 * m)) as f32 / m as f32;
        let wave = 1.0 + 0.08 * (waves * theta).sin() * (waves.floor() * phi).cos() * theta.sin();
        let direction = Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin());
        soup.vertices.push(center + direction * (radius * wave));
    }
    add_grid(soup, base, m, 2 * m);
}

/// Triangles over `(rows + 1) * (columns + 1)` vertices from `base`.
fn add_grid(soup: &mut Soup, base: u32, rows: u32, columns: u32) {
    for (i, j) in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
        let at = |di: u32, dj: u32| base + (i + di) * (columns + 1) + j + dj;
        soup.triangles.extend([[at(0, 0), at(1, 0), at(1, 1)], [at(0, 0), at(1, 1), at(0, 1)]]);
    }
}

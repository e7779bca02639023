//! The nearest point of triangles in any number of dimensions.
//!
//! ```text
//! p(q) = argmin_{p in some triangle} |q - p|,   p = β_a a + β_b b + β_c c,  β ≥ 0,  Σ β = 1
//! u·w = (|q - a|² - |q - b|² + u·u) / 2         u = b - a, v = c - a, w = q - a
//! ```
//!
//! The corners are the rows of an embedding, n × k. The squared distances of a few queries to all
//! corners come from blocked matrix products; with the lengths of the edges they give the distance
//! to a whole triangle without looking at its k coordinates again. A triangle is looked at only if
//! its nearest corner is within the best distance plus what no point of the triangle is further
//! from a corner than (its longest edge over √3). Those that are nearest up to rounding are measured
//! again in all coordinates; among equals the lowest face wins. The result is what trying every
//! face would give, and depends neither on the size of the blocks nor on the number of threads.
//!
//! Memory: two copies of the embedding, and a column of distances for each of the few queries.

use faer::{Accum, Mat, MatRef, Par, linalg::matmul::matmul};
use rayon::prelude::*;

/// Distances a task holds at a time, if that is between the two numbers of queries below.
const DISTANCES_PER_BLOCK: usize = 1 << 22;
const FEWEST_QUERIES: usize = 16;
const MOST_QUERIES: usize = 128;
/// Independent sums, so that they fill vector registers.
const LANES: usize = 8;
/// No point of a triangle is further from its nearest corner than its longest edge over √3: the
/// radius of the smallest circle around an equilateral one, with room for rounding.
const REACH: f64 = 0.577_350_27;

/// Triangles of an embedding, ready for queries.
pub(crate) struct Triangles<'a> {
    faces: &'a [[u32; 3]],
    /// Corners as columns, k × n.
    corners: Mat<f64>,
    squared_norms: Vec<f64>,
    largest_squared_norm: f64,
    /// For every face u·u, u·v, v·v of the edges u, v at its first corner.
    products: Vec<[f64; 3]>,
    /// For every vertex, how far from it points of its faces can be that have it as nearest corner.
    reach: Vec<f64>,
    /// Where the faces of every vertex begin in `faces_of_vertex`.
    first: Vec<u32>,
    faces_of_vertex: Vec<u32>,
}

/// The nearest point found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Nearest {
    pub(crate) face: u32,
    pub(crate) barycentric: [f64; 3],
    pub(crate) distance: f64,
}

impl<'a> Triangles<'a> {
    /// Rows of `embedding` are the corners; there is a face and every index exists.
    pub(crate) fn new(faces: &'a [[u32; 3]], embedding: MatRef<'_, f64>) -> Self {
        let corners = embedding.transpose().to_owned();
        let n = corners.ncols();
        let squared_norms: Vec<f64> = (0..n).map(|v| squared_norm(&corners, v)).collect();
        let mut products = Vec::with_capacity(faces.len());
        let mut reach = vec![0.0_f64; n];
        let mut first = vec![0_u32; n + 1];
        for face in faces {
            let [a, b, c] = face.map(|v| corners.col_as_slice(v as usize));
            let [uu, uv, vv] = [dot_from(a, b, b), dot_from(a, b, c), dot_from(a, c, c)];
            products.push([uu, uv, vv]);
            let longest = [vv, dot_from(b, c, c)]
                .into_iter()
                .fold(uu, f64::max)
                .sqrt();
            for &v in face {
                reach[v as usize] = reach[v as usize].max(REACH * longest);
                first[v as usize + 1] += 1;
            }
        }
        for v in 0..n {
            first[v + 1] += first[v];
        }
        let mut next = first.clone();
        let mut faces_of_vertex = vec![0; 3 * faces.len()];
        for (face, corners) in faces.iter().enumerate() {
            for &v in corners {
                faces_of_vertex[next[v as usize] as usize] = face as u32;
                next[v as usize] += 1;
            }
        }
        Self {
            faces,
            corners,
            largest_squared_norm: squared_norms.iter().copied().fold(0.0, f64::max),
            squared_norms,
            products,
            reach,
            first,
            faces_of_vertex,
        }
    }

    /// The nearest point for every row of `queries`.
    pub(crate) fn nearest(&self, queries: MatRef<'_, f64>) -> Vec<Nearest> {
        let queries = queries.transpose().to_owned();
        let n = self.corners.ncols();
        let per_block = (DISTANCES_PER_BLOCK / n.max(1)).clamp(FEWEST_QUERIES, MOST_QUERIES);
        let blank = Nearest {
            face: 0,
            barycentric: [1.0, 0.0, 0.0],
            distance: f64::INFINITY,
        };
        let mut found = vec![blank; queries.ncols()];
        found.par_chunks_mut(per_block).enumerate().for_each_init(
            || (Mat::zeros(n, per_block), Vec::new()),
            |(distances, candidates), (block, out)| {
                let start = block * per_block;
                matmul(
                    distances.as_mut().subcols_mut(0, out.len()),
                    Accum::Replace,
                    self.corners.transpose(),
                    queries.subcols(start, out.len()),
                    -2.0,
                    Par::Seq,
                );
                for (i, slot) in out.iter_mut().enumerate() {
                    let squared_norm = squared_norm(&queries, start + i);
                    let squared = distances.col_as_slice_mut(i);
                    for (d, norm) in squared.iter_mut().zip(&self.squared_norms) {
                        *d += norm + squared_norm;
                    }
                    let slack = self.slack(squared_norm);
                    self.collect_candidates(squared, slack, candidates);
                    let query = queries.col_as_slice(start + i);
                    for &(_, face) in candidates.iter() {
                        let found = self.project(query, face);
                        if (found.distance, found.face) < (slot.distance, slot.face) {
                            *slot = found;
                        }
                    }
                }
            },
        );
        found
    }

    /// Bound on the rounding error of squared distances made from products of k terms, and of what
    /// follows from three of them.
    fn slack(&self, squared_norm: f64) -> f64 {
        let magnitude = squared_norm + self.largest_squared_norm;
        32.0 * (self.corners.nrows() + 4) as f64 * f64::EPSILON * magnitude
    }

    /// Faces that may be nearest to a query, given its squared distances to all corners.
    fn collect_candidates(&self, squared: &[f64], slack: f64, candidates: &mut Vec<(f64, u32)>) {
        candidates.clear();
        let mut best = f64::INFINITY;
        if let Some(start) = self.nearest_vertex_with_a_face(squared) {
            self.try_faces_of(start, squared, slack, (&mut best, candidates));
        }
        for (vertex, (&d, &reach)) in squared.iter().zip(&self.reach).enumerate() {
            // d is at most the square of (√best + reach).
            let limit = best + slack + reach * reach;
            let rest = d - limit;
            if rest <= slack || rest * rest <= 4.0 * reach * reach * (best + 2.0 * slack) {
                self.try_faces_of(vertex, squared, slack, (&mut best, candidates));
            }
        }
        candidates.sort_unstable_by_key(|&(_, face)| face);
        candidates.dedup_by_key(|&mut (_, face)| face);
        candidates.retain(|&(d, _)| d <= best + slack);
    }

    fn nearest_vertex_with_a_face(&self, squared: &[f64]) -> Option<usize> {
        let mut smallest = (f64::INFINITY, None);
        for (vertex, &d) in squared.iter().enumerate() {
            if d < smallest.0 && self.first[vertex] < self.first[vertex + 1] {
                smallest = (d, Some(vertex));
            }
        }
        smallest.1
    }

    /// Looks at the faces of a vertex that have no nearer corner.
    fn try_faces_of(
        &self,
        vertex: usize,
        squared: &[f64],
        slack: f64,
        (best, candidates): (&mut f64, &mut Vec<(f64, u32)>),
    ) {
        let range = self.first[vertex] as usize..self.first[vertex + 1] as usize;
        for &face in &self.faces_of_vertex[range] {
            let d = self.faces[face as usize].map(|v| squared[v as usize]);
            if d.iter().any(|&other| other < squared[vertex]) {
                continue;
            }
            let products = self.products[face as usize];
            let along = [
                0.5 * (d[0] - d[1] + products[0]),
                0.5 * (d[0] - d[2] + products[2]),
            ];
            let [_, s, t] = nearest_in_triangle(products, along);
            let distance = d[0] + excess(products, along, [s, t]);
            if distance <= *best + slack {
                candidates.push((distance, face));
                *best = if distance < *best { distance } else { *best };
            }
        }
    }

    /// The nearest point of one face, in all coordinates.
    fn project(&self, query: &[f64], face: u32) -> Nearest {
        let [a, b, c] = self.faces[face as usize].map(|v| self.corners.col_as_slice(v as usize));
        let along = [dot_from(a, b, query), dot_from(a, c, query)];
        let barycentric = nearest_in_triangle(self.products[face as usize], along);
        let [r, s, t] = barycentric;
        let corners = a.iter().zip(b).zip(c).zip(query);
        let squared: f64 = corners
            .map(|(((x, y), z), q)| {
                let difference = r * (x - q) + s * (y - q) + t * (z - q);
                difference * difference
            })
            .sum();
        Nearest {
            face,
            barycentric,
            distance: squared.sqrt(),
        }
    }
}

/// The nearest point of one triangle in space.
pub(crate) fn nearest_in_space(corners: &[[f64; 3]; 3], query: &[f64; 3]) -> [f64; 3] {
    let [a, b, c] = corners;
    nearest_in_triangle(
        [dot_from(a, b, b), dot_from(a, b, c), dot_from(a, c, c)],
        [dot_from(a, b, query), dot_from(a, c, query)],
    )
}

/// Barycentric coordinates of the point of a triangle nearest to q.
///
/// Given are the products of the edges u = b - a and v = c - a, (u·u, u·v, v·v), and those with
/// w = q - a, (u·w, v·w).
fn nearest_in_triangle([uu, uv, vv]: [f64; 3], [uw, vw]: [f64; 2]) -> [f64; 3] {
    let determinant = uu * vv - uv * uv;
    if determinant > f64::EPSILON * uu * vv {
        let s = (vv * uw - uv * vw) / determinant;
        let t = (uu * vw - uv * uw) / determinant;
        if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
            return [1.0 - s - t, s, t];
        }
    }
    // On an edge: the best of the three.
    let share = |along: f64, length: f64| {
        if length > 0.0 {
            (along / length).clamp(0.0, 1.0)
        } else {
            0.0
        }
    };
    let s = share(uw, uu);
    let t = share(vw, vv);
    let r = share(vw - uv - uw + uu, uu - 2.0 * uv + vv);
    let f =
        |s: f64, t: f64| s * s * uu + 2.0 * s * t * uv + t * t * vv - 2.0 * s * uw - 2.0 * t * vw;
    let mut best = (f(s, 0.0), [1.0 - s, s, 0.0]);
    for (value, point) in [
        (f(0.0, t), [1.0 - t, 0.0, t]),
        (f(1.0 - r, r), [0.0, 1.0 - r, r]),
    ] {
        if value < best.0 {
            best = (value, point);
        }
    }
    best.1
}

/// |q - p|² - |w|² for p = a + s u + t v.
fn excess([uu, uv, vv]: [f64; 3], [uw, vw]: [f64; 2], [s, t]: [f64; 2]) -> f64 {
    s * s * uu + 2.0 * s * t * uv + t * t * vv - 2.0 * s * uw - 2.0 * t * vw
}

fn squared_norm(points: &Mat<f64>, index: usize) -> f64 {
    points.col_as_slice(index).iter().map(|x| x * x).sum()
}

/// (x - origin)·(y - origin).
fn dot_from(origin: &[f64], x: &[f64], y: &[f64]) -> f64 {
    let mut lanes = [0.0; LANES];
    let chunks = origin
        .chunks(LANES)
        .zip(x.chunks(LANES))
        .zip(y.chunks(LANES));
    for ((origin, x), y) in chunks {
        for (((lane, o), x), y) in lanes.iter_mut().zip(origin).zip(x).zip(y) {
            *lane += (x - o) * (y - o);
        }
    }
    lanes.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(n_rows: usize, n_columns: usize, mut state: u64) -> Mat<f64> {
        Mat::from_fn(n_rows, n_columns, |_, _| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        })
    }

    /// Faces that a small generator picks, some with a repeated corner.
    fn faces(n_faces: usize, n_vertices: u32) -> Vec<[u32; 3]> {
        let picks = numbers(n_faces, 3, 9);
        let pick = |i: usize, j: usize| ((picks[(i, j)] + 0.5) * f64::from(n_vertices)) as u32;
        (0..n_faces)
            .map(|i| {
                [
                    pick(i, 0),
                    pick(i, 1),
                    pick(i, if i % 50 == 0 { 1 } else { 2 }),
                ]
            })
            .collect()
    }

    #[test]
    fn the_search_finds_what_trying_every_face_finds() {
        for dimension in [2, 7, 33] {
            let faces = faces(700, 300);
            let embedding = numbers(300, dimension, 1);
            let queries = numbers(90, dimension, 2);
            let triangles = Triangles::new(&faces, embedding.as_ref());
            let found = triangles.nearest(queries.as_ref());
            for (row, found) in found.iter().enumerate() {
                let query: Vec<f64> = (0..dimension).map(|j| queries[(row, j)]).collect();
                let best = (0..700)
                    .map(|f| triangles.project(&query, f))
                    .min_by(|a, b| a.distance.total_cmp(&b.distance).then(a.face.cmp(&b.face)));
                assert_eq!(Some(*found), best);
            }
        }
    }

    #[test]
    fn no_point_of_the_triangle_is_nearer() {
        let points = numbers(400, 4, 5);
        for i in 0..100 {
            let row = |r: usize| -> Vec<f64> { (0..4).map(|j| points[(4 * i + r, j)]).collect() };
            let corners = Mat::from_fn(3, 4, |r, j| row(r)[j]);
            let triangles = Triangles::new(&[[0, 1, 2]], corners.as_ref());
            let query = row(3);
            let found = triangles.project(&query, 0);
            assert!((found.barycentric.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            assert!(found.barycentric.iter().all(|&b| b >= -1e-12));
            for s in 0..=20 {
                for t in 0..=20 - s {
                    let (s, t) = (f64::from(s) / 20.0, f64::from(t) / 20.0);
                    let squared: f64 = (0..4)
                        .map(|j| {
                            let p = (1.0 - s - t) * row(0)[j] + s * row(1)[j] + t * row(2)[j];
                            (p - query[j]).powi(2)
                        })
                        .sum();
                    assert!(found.distance <= squared.sqrt() + 1e-12);
                }
            }
        }
    }

    #[test]
    fn corners_are_met_exactly_and_collapsed_faces_do_no_harm() {
        let corners = Mat::from_fn(3, 5, |i, j| {
            [0.1, 0.7, -0.3][i] * (j as f64 + 1.3).powi(i as i32)
        });
        for faces in [[[0, 1, 2]], [[1, 1, 1]], [[0, 1, 1]]] {
            let triangles = Triangles::new(&faces, corners.as_ref());
            let found = triangles.nearest(corners.as_ref());
            assert!(
                found
                    .iter()
                    .all(|f| f.barycentric.iter().all(|b| b.is_finite()))
            );
            assert!(found[1].distance <= 0.0);
        }
        let triangles = Triangles::new(&[[0, 1, 2]], corners.as_ref());
        let found = triangles.nearest(corners.as_ref());
        for (i, nearest) in found.iter().enumerate() {
            assert!((nearest.barycentric[i] - 1.0).abs() <= 0.0, "{nearest:?}");
        }
    }
}

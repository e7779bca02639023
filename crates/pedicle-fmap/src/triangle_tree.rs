//! The nearest point of triangles in any number of dimensions.
//!
//! ```text
//! p(q) = argmin_{p in some triangle} |q - p|,   p = β_a a + β_b b + β_c c,  β ≥ 0,  Σ β = 1
//! ```
//!
//! The corners are the rows of an embedding, n × k; memory is that of the embedding. The faces sit in
//! a tree of balls. A ball is passed over if |q - centre| - radius exceeds the best distance so
//! far, a triangle if |q - a| less its longest edge at a does; both sums are broken off as soon as
//! that is certain. The search is exact: it returns what trying every face would, and among
//! equally near faces the lowest.

use faer::{Mat, MatRef};
use rayon::prelude::*;

/// Faces in a leaf of the tree.
const FACES_PER_LEAF: usize = 8;
/// Coordinates summed between two looks at the limit.
const CHUNK: usize = 16;
/// Independent sums, so that they fill vector registers.
const LANES: usize = 8;
/// Relative room for rounding in a bound before something is passed over.
const ROUNDING: f64 = 1e-10;
/// Queries a task takes.
const QUERIES_PER_BLOCK: usize = 64;

/// Triangles of an embedding, ready for queries.
pub(crate) struct TriangleTree<'a> {
    faces: &'a [[u32; 3]],
    /// Corners as columns, k × n.
    corners: Mat<f64>,
    /// For every face u·u, u·v, v·v of the edges u, v at its first corner.
    products: Vec<[f64; 3]>,
    /// Faces in the order of the leaves.
    order: Vec<u32>,
    nodes: Vec<Node>,
    /// Centres of the balls, one a column.
    centers: Vec<f64>,
}

struct Node {
    /// Range in the order of the faces.
    first: u32,
    last: u32,
    radius: f64,
    /// The two halves; none in a leaf.
    children: Option<[u32; 2]>,
}

/// The nearest point found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Nearest {
    pub(crate) face: u32,
    pub(crate) barycentric: [f64; 3],
    pub(crate) distance: f64,
}

impl<'a> TriangleTree<'a> {
    /// Rows of `embedding` are the corners; there is a face and every index exists.
    pub(crate) fn new(faces: &'a [[u32; 3]], embedding: MatRef<'_, f64>) -> Self {
        let mut tree = Self {
            faces,
            corners: embedding.transpose().to_owned(),
            products: Vec::with_capacity(faces.len()),
            order: (0..faces.len() as u32).collect(),
            nodes: Vec::new(),
            centers: Vec::new(),
        };
        for &face in faces {
            let [a, b, c] = face.map(|v| tree.corner(v));
            let products = [dot_from(a, b, b), dot_from(a, b, c), dot_from(a, c, c)];
            tree.products.push(products);
        }
        tree.build(0, faces.len());
        tree
    }

    /// The nearest point for every row of `queries`; `guess` is a vertex to begin with.
    pub(crate) fn nearest(&self, queries: MatRef<'_, f64>, guess: &[u32]) -> Vec<Nearest> {
        let face_of_vertex = self.a_face_of_every_vertex();
        let queries = queries.transpose().to_owned();
        let mut found = vec![None; guess.len()];
        found
            .par_chunks_mut(QUERIES_PER_BLOCK)
            .enumerate()
            .for_each(|(block, out)| {
                for (i, slot) in out.iter_mut().enumerate() {
                    let row = block * QUERIES_PER_BLOCK + i;
                    let query = queries.col_as_slice(row);
                    let start = face_of_vertex[guess[row] as usize];
                    let mut best = self.project(query, start, f64::INFINITY);
                    self.search(query, 0, &mut best);
                    *slot = best;
                }
            });
        // A query always has an answer: without a limit the first face is measured to the end.
        found.into_iter().flatten().collect()
    }

    /// Some face at every vertex; face 0 where there is none.
    fn a_face_of_every_vertex(&self) -> Vec<u32> {
        let mut of_vertex = vec![0; self.corners.ncols()];
        for (face, corners) in self.faces.iter().enumerate().rev() {
            for &v in corners {
                of_vertex[v as usize] = face as u32;
            }
        }
        of_vertex
    }

    fn corner(&self, vertex: u32) -> &[f64] {
        self.corners.col_as_slice(vertex as usize)
    }

    fn dimension(&self) -> usize {
        self.corners.nrows()
    }

    /// Adds the node of a range of `order`, halved along its widest coordinate, and its halves.
    fn build(&mut self, first: usize, last: usize) -> u32 {
        let index = self.nodes.len();
        let (mean, widest) = self.spread(first, last);
        let squared = |v: u32| dot_from(&mean, self.corner(v), self.corner(v));
        let corners = self.order[first..last]
            .iter()
            .flat_map(|&f| self.faces[f as usize]);
        let radius = corners.map(squared).fold(0.0, f64::max).sqrt();
        self.centers.extend_from_slice(&mean);
        self.nodes.push(Node {
            first: first as u32,
            last: last as u32,
            radius: radius * (1.0 + ROUNDING),
            children: None,
        });
        if last - first > FACES_PER_LEAF {
            let middle = first.midpoint(last);
            let (faces, corners) = (self.faces, &self.corners);
            let height = |f: u32| -> f64 {
                faces[f as usize]
                    .iter()
                    .map(|&v| corners[(widest, v as usize)])
                    .sum()
            };
            self.order[first..last].select_nth_unstable_by(middle - first, |&f, &g| {
                height(f).total_cmp(&height(g)).then(f.cmp(&g))
            });
            let children = [self.build(first, middle), self.build(middle, last)];
            self.nodes[index].children = Some(children);
        }
        index as u32
    }

    /// Mean of the corners in a range, and the coordinate in which they spread most.
    fn spread(&self, first: usize, last: usize) -> (Vec<f64>, usize) {
        let k = self.dimension();
        let (mut sum, mut squares) = (vec![0.0; k], vec![0.0; k]);
        for &face in &self.order[first..last] {
            for &v in &self.faces[face as usize] {
                for (i, x) in self.corner(v).iter().enumerate() {
                    sum[i] += x;
                    squares[i] += x * x;
                }
            }
        }
        let count = 3.0 * (last - first) as f64;
        let variance = |i: usize| squares[i] / count - (sum[i] / count).powi(2);
        let widest = (0..k).max_by(|&i, &j| variance(i).total_cmp(&variance(j)));
        (sum.iter().map(|s| s / count).collect(), widest.unwrap_or(0))
    }

    fn search(&self, query: &[f64], index: u32, best: &mut Option<Nearest>) {
        let node = &self.nodes[index as usize];
        let Some(children) = node.children else {
            for &face in &self.order[node.first as usize..node.last as usize] {
                let limit = best.map_or(f64::INFINITY, |b| b.distance);
                if let Some(found) = self.project(query, face, limit)
                    && best.is_none_or(|b| (found.distance, found.face) < (b.distance, b.face))
                {
                    *best = Some(found);
                }
            }
            return;
        };
        let limit = best.map_or(f64::INFINITY, |b| b.distance);
        let mut gaps = children.map(|child| (self.gap(query, child, limit), child));
        if gaps[1].0 < gaps[0].0 {
            gaps.swap(0, 1);
        }
        for (gap, child) in gaps {
            // The limit may have fallen since.
            if gap <= best.map_or(f64::INFINITY, |b| widened(b.distance)) {
                self.search(query, child, best);
            }
        }
    }

    /// |q - centre| - radius, or infinity if it is beyond the limit.
    fn gap(&self, query: &[f64], node: u32, limit: f64) -> f64 {
        let k = self.dimension();
        let radius = self.nodes[node as usize].radius;
        let center = &self.centers[node as usize * k..(node as usize + 1) * k];
        let reach = widened(limit + radius);
        within(query, center, reach * reach).map_or(f64::INFINITY, |d| d.sqrt() - radius)
    }

    /// The nearest point of one face, or none if it is certainly further than the limit.
    fn project(&self, query: &[f64], face: u32, limit: f64) -> Option<Nearest> {
        let [a, b, c] = self.faces[face as usize].map(|v| self.corner(v));
        let products = self.products[face as usize];
        let longest = if products[0] > products[2] {
            products[0]
        } else {
            products[2]
        };
        let reach = widened(limit + longest.sqrt());
        within(query, a, reach * reach)?;
        let along = [dot_from(a, b, query), dot_from(a, c, query)];
        let barycentric = nearest_in_triangle(products, along);
        let [s, t, r] = barycentric;
        let corners = a.iter().zip(b).zip(c).zip(query);
        let squared: f64 = corners
            .map(|(((x, y), z), q)| {
                let difference = s * (x - q) + t * (y - q) + r * (z - q);
                difference * difference
            })
            .sum();
        Some(Nearest {
            face,
            barycentric,
            distance: squared.sqrt(),
        })
    }
}

/// Barycentric coordinates of the point of a triangle nearest to q.
///
/// Given are the products of the edges u = b - a and v = c - a, (u·u, u·v, v·v), and those with
/// w = q - a, (u·w, v·w). The squared distance less |w|² is
/// f(s, t) = s² u·u + 2 s t u·v + t² v·v - 2 s u·w - 2 t v·w.
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

fn widened(limit: f64) -> f64 {
    limit * (1.0 + ROUNDING)
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

/// |a - b|², or none as soon as it is beyond the limit.
fn within(a: &[f64], b: &[f64], limit: f64) -> Option<f64> {
    let mut lanes = [0.0; LANES];
    for (a, b) in a.chunks(CHUNK).zip(b.chunks(CHUNK)) {
        for (a, b) in a.chunks(LANES).zip(b.chunks(LANES)) {
            for ((lane, x), y) in lanes.iter_mut().zip(a).zip(b) {
                *lane += (x - y) * (x - y);
            }
        }
        if lanes.iter().sum::<f64>() > limit {
            return None;
        }
    }
    Some(lanes.iter().sum())
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
    fn the_tree_finds_what_trying_every_face_finds() {
        for dimension in [2, 7, 33] {
            let faces = faces(700, 300);
            let embedding = numbers(300, dimension, 1);
            let queries = numbers(90, dimension, 2);
            let tree = TriangleTree::new(&faces, embedding.as_ref());
            let guess: Vec<u32> = (0..90).map(|i| i * 3).collect();
            let found = tree.nearest(queries.as_ref(), &guess);
            for (row, found) in found.iter().enumerate() {
                let query: Vec<f64> = (0..dimension).map(|j| queries[(row, j)]).collect();
                let best = (0..700)
                    .filter_map(|f| tree.project(&query, f, f64::INFINITY))
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
            let tree = TriangleTree::new(&[[0, 1, 2]], corners.as_ref());
            let query = row(3);
            let found = tree.project(&query, 0, f64::INFINITY).unwrap();
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
            let tree = TriangleTree::new(&faces, corners.as_ref());
            let found = tree.nearest(corners.as_ref(), &[0, 1, 2]);
            assert!(
                found
                    .iter()
                    .all(|f| f.barycentric.iter().all(|b| b.is_finite()))
            );
            assert!(found[1].distance <= 0.0);
        }
        let tree = TriangleTree::new(&[[0, 1, 2]], corners.as_ref());
        let found = tree.nearest(corners.as_ref(), &[0, 0, 0]);
        for (i, nearest) in found.iter().enumerate() {
            assert!((nearest.barycentric[i] - 1.0).abs() <= 0.0, "{nearest:?}");
        }
    }
}

//! Operators on functions made from one function f, in the first k modes of a basis.
//!
//! ```text
//! multiplication   M(f) = Φᵀ M diag(f) Φ                                     k × k, symmetric
//! orientation      Ω(f) = Φᵀ S_f Φ,
//!                  (S_f h)(i) = Σ_{triangles at i} (area/3) ⟨n × ∇f, ∇h⟩     k × k
//! ```
//!
//! A map that carries f to g and products to products satisfies C M(f) = M(g) C (Nogneng &
//! Ovsjanikov 2017, eq. 5); one that keeps the orientation satisfies C Ω(f) = Ω(g) C, one that
//! reverses it C Ω(f) = -Ω(g) C (Ren, Poulenard, Wonka & Ovsjanikov 2018, section 4).
//!
//! On a triangle (a, b, c) the area and the normal cancel: with the gradients of the hat functions
//! put in, (area/3) ⟨n × ∇f, ∇h⟩ = (h_a (f_c - f_b) + h_b (f_a - f_c) + h_c (f_b - f_a)) / 6. Only
//! the order of the corners enters, so slivers do no harm; Ω changes sign with the faces' order.
//!
//! Summed by half-edges a → b with the third corner c, S_f falls into an antisymmetric part with
//! (f_a + f_b - 2 f_c) / 12 at (a, b) and a symmetric one in which the two half-edges of an edge
//! cancel: of a closed mesh nothing is left of it. So one product gives both operators,
//!
//! ```text
//! Z = Φᵀ (M diag(f) + s S_f⁻) Φ,    M(f) = (Z + Zᵀ) / 2,    Ω⁻(f) = (Z - Zᵀ) / 2s
//! ```
//!
//! with a power of two s that makes both parts about equally large.

use faer::{Mat, MatRef};
use pedicle_mesh::TriMesh;

use crate::linear::add_product;

/// Vertices a product takes: they stay in the cache, and the order of summation is fixed.
const VERTICES_PER_BLOCK: usize = 256;

/// Makes the operators of functions on one shape.
pub(crate) struct OperatorMaker<'a> {
    /// Φᵀ, k × n: the values at a vertex side by side.
    functions: Mat<f64>,
    mass: &'a [f64],
    edges: Edges,
}

/// The operators of one function, k × k.
pub(crate) struct FunctionOperators {
    /// M(f).
    pub(crate) multiplication: Mat<f64>,
    /// Ω(f).
    pub(crate) orientation: Mat<f64>,
}

/// A third corner: of a half-edge from the lower end of its edge to the higher one (sign 1) or
/// back (-1).
struct Wing {
    sign: f64,
    corner: u32,
}

/// The edges of a mesh with what lies beside them.
struct Edges {
    /// Lower and higher end.
    ends: Vec<[u32; 2]>,
    /// Start of every edge's wings.
    starts: Vec<usize>,
    wings: Vec<Wing>,
    /// Start of every vertex's links.
    link_starts: Vec<usize>,
    /// (other end, edge, sign of S_f⁻ there).
    links: Vec<(u32, u32, f64)>,
    /// Edges with more half-edges one way than the other, and how many more.
    open: Vec<(u32, f64)>,
}

impl<'a> OperatorMaker<'a> {
    pub(crate) fn new(functions: MatRef<'_, f64>, mass: &'a [f64], mesh: &TriMesh) -> Self {
        Self {
            functions: functions.transpose().to_owned(),
            mass,
            edges: Edges::new(mesh),
        }
    }

    /// M(f) and Ω(f) for a function given at the vertices.
    pub(crate) fn of(&self, f: &[f64]) -> FunctionOperators {
        let (k, n) = self.functions.shape();
        let mut turns = self.edges.antisymmetric_entries(f);
        let squares = |values: &mut dyn Iterator<Item = f64>| values.map(|x| x * x).sum::<f64>();
        let of_mass = squares(&mut self.mass.iter().zip(f).map(|(m, f)| m * f));
        let of_turns = 2.0 * squares(&mut turns.iter().copied());
        let scale = balancing_power_of_two(of_mass, of_turns);
        turns.iter_mut().for_each(|turn| *turn *= scale);

        let mut z = Mat::zeros(k, k);
        let mut rows = vec![0.0; k * VERTICES_PER_BLOCK.min(n)];
        let arch = pulp::Arch::new();
        for first in (0..n).step_by(VERTICES_PER_BLOCK) {
            let count = VERTICES_PER_BLOCK.min(n - first);
            arch.dispatch(Rows {
                maker: self,
                f,
                turns: &turns,
                first,
                out: &mut rows[..k * count],
            });
            let functions = self.functions.subcols(first, count);
            let rows = MatRef::from_column_major_slice(&rows[..k * count], k, count);
            add_product(&mut z, 1.0, functions, rows.transpose());
        }
        let mut orientation = self.symmetric_orientation(f);
        let multiplication = Mat::from_fn(k, k, |i, j| {
            orientation[(i, j)] += 0.5 / scale * (z[(i, j)] - z[(j, i)]);
            0.5 * (z[(i, j)] + z[(j, i)])
        });
        FunctionOperators {
            multiplication,
            orientation,
        }
    }

    /// Φᵀ S_f⁺ Φ: what half-edges without a partner leave.
    ///
    /// A half-edge a → b gives (f_a - f_b) / 12 at (a, b) and (b, a), -f_b / 6 at a and f_a / 6 at b.
    fn symmetric_orientation(&self, f: &[f64]) -> Mat<f64> {
        let k = self.functions.nrows();
        let mut operator = Mat::zeros(k, k);
        let (mut left, mut right) = (Mat::zeros(k, 0), Mat::zeros(k, 0));
        for some in self.edges.open.chunks(VERTICES_PER_BLOCK / 2) {
            left.resize_with(k, 2 * some.len(), |_, _| 0.0);
            right.resize_with(k, 2 * some.len(), |_, _| 0.0);
            for (i, &(edge, excess)) in some.iter().enumerate() {
                let [a, b] = self.edges.ends[edge as usize].map(|v| v as usize);
                let beside = excess * (f[a] - f[b]) / 12.0;
                let (at_a, at_b) = (-excess * f[b] / 6.0, excess * f[a] / 6.0);
                for l in 0..k {
                    let (phi_a, phi_b) = (self.functions[(l, a)], self.functions[(l, b)]);
                    left[(l, 2 * i)] = phi_a;
                    left[(l, 2 * i + 1)] = phi_b;
                    right[(l, 2 * i)] = at_a * phi_a + beside * phi_b;
                    right[(l, 2 * i + 1)] = beside * phi_a + at_b * phi_b;
                }
            }
            let (left, right) = (left.as_ref(), right.as_ref());
            let used = 2 * some.len();
            let right = right.subcols(0, used).transpose();
            add_product(&mut operator, 1.0, left.subcols(0, used), right);
        }
        operator
    }
}

impl Edges {
    fn new(mesh: &TriMesh) -> Self {
        // (lower end, higher end, sign, third corner), in the order of edges and faces.
        let mut half_edges = Vec::with_capacity(3 * mesh.n_faces());
        for face in mesh.faces() {
            for i in 0..3 {
                let (a, b, c) = (face[i], face[(i + 1) % 3], face[(i + 2) % 3]);
                // A face that uses a vertex twice has no area and gives nothing.
                if a != b {
                    half_edges.push((a.min(b), a.max(b), if a < b { 1.0 } else { -1.0 }, c));
                }
            }
        }
        half_edges.sort_by_key(|&(a, b, ..)| (a, b));
        let mut edges = Self {
            ends: Vec::new(),
            starts: Vec::new(),
            wings: Vec::with_capacity(half_edges.len()),
            link_starts: vec![0; mesh.n_vertices() + 1],
            links: Vec::new(),
            open: Vec::new(),
        };
        for of_edge in half_edges.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
            let excess: f64 = of_edge.iter().map(|half| half.2).sum();
            if excess.abs() > 0.5 {
                edges.open.push((edges.ends.len() as u32, excess));
            }
            edges.ends.push([of_edge[0].0, of_edge[0].1]);
            edges.starts.push(edges.wings.len());
            let wings = of_edge.iter().map(|&(_, _, sign, corner)| Wing { sign, corner });
            edges.wings.extend(wings);
        }
        edges.starts.push(edges.wings.len());
        edges.link();
        edges
    }

    fn link(&mut self) {
        for &end in self.ends.iter().flatten() {
            self.link_starts[end as usize + 1] += 1;
        }
        for v in 1..self.link_starts.len() {
            self.link_starts[v] += self.link_starts[v - 1];
        }
        let mut next = self.link_starts.clone();
        self.links = vec![(0, 0, 0.0); 2 * self.ends.len()];
        for (edge, &[low, high]) in self.ends.iter().enumerate() {
            for (own, other, sign) in [(low, high, 1.0), (high, low, -1.0)] {
                let place = &mut next[own as usize];
                self.links[*place] = (other, edge as u32, sign);
                *place += 1;
            }
        }
    }

    /// S_f⁻ at (lower end, higher end) of every edge.
    fn antisymmetric_entries(&self, f: &[f64]) -> Vec<f64> {
        let wings = self.starts.windows(2).map(|range| &self.wings[range[0]..range[1]]);
        let edges = self.ends.iter().zip(wings);
        edges
            .map(|(ends, wings)| {
                let [a, b] = ends.map(|v| f[v as usize]);
                let turn = |wing: &Wing| wing.sign * (a + b - 2.0 * f[wing.corner as usize]);
                wings.iter().map(turn).sum::<f64>() / 12.0
            })
            .collect()
    }
}

/// 2^i with 2^i √of_turns ≈ √of_mass; 1 where one of them is nothing.
fn balancing_power_of_two(of_mass: f64, of_turns: f64) -> f64 {
    let ratio = of_mass / of_turns;
    if ratio > 0.0 && ratio.is_finite() {
        (0.5 * ratio.log2()).round().exp2()
    } else {
        1.0
    }
}

/// Rows of (M diag(f) + s S_f⁻) Φ, compiled for wide registers where the processor has them.
struct Rows<'a> {
    maker: &'a OperatorMaker<'a>,
    f: &'a [f64],
    /// s S_f⁻ of every edge.
    turns: &'a [f64],
    first: usize,
    /// k numbers a vertex.
    out: &'a mut [f64],
}

impl pulp::WithSimd for Rows<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let (functions, edges) = (&self.maker.functions, &self.maker.edges);
        let rows = self.out.chunks_exact_mut(functions.nrows());
        for (vertex, row) in (self.first..).zip(rows) {
            let own = self.maker.mass[vertex] * self.f[vertex];
            for (r, x) in row.iter_mut().zip(functions.col_as_slice(vertex)) {
                *r = own * x;
            }
            let links = edges.link_starts[vertex]..edges.link_starts[vertex + 1];
            for &(other, edge, sign) in &edges.links[links] {
                let turn = sign * self.turns[edge as usize];
                let other = functions.col_as_slice(other as usize);
                for (r, x) in row.iter_mut().zip(other) {
                    *r = turn.mul_add(*x, *r);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::linear::product;

    /// Two triangles of a square, one of them bent up, and a flap at their common edge.
    fn faces() -> Vec<[u32; 3]> {
        vec![[0, 1, 2], [0, 2, 3], [4, 0, 2], [5, 5, 1]]
    }

    fn mesh(faces: Vec<[u32; 3]>) -> TriMesh {
        let vertices = (0..6)
            .map(|i| Point3::new((i as f64).sin(), (2.0 * i as f64).cos(), 0.3 * i as f64))
            .collect();
        TriMesh::new(vertices, faces).unwrap()
    }

    /// Sums the definition face by face.
    fn by_definition(mesh: &TriMesh, functions: &Mat<f64>, f: &[f64]) -> Mat<f64> {
        let n = mesh.n_vertices();
        let mut turn = Mat::<f64>::zeros(n, n);
        for &[a, b, c] in mesh.faces() {
            let [fa, fb, fc] = [a, b, c].map(|v| f[v as usize]);
            for i in [a, b, c] {
                turn[(i as usize, a as usize)] += (fc - fb) / 6.0;
                turn[(i as usize, b as usize)] += (fa - fc) / 6.0;
                turn[(i as usize, c as usize)] += (fb - fa) / 6.0;
            }
        }
        let turned = product(turn.as_ref(), functions.as_ref());
        product(functions.transpose(), turned.as_ref())
    }

    #[test]
    fn both_operators_are_those_of_the_definition_on_open_closed_and_branching_meshes() {
        let closed = vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
        let functions = Mat::from_fn(6, 4, |i, j| (1.0 + i as f64 * (j as f64 + 0.7)).sin());
        let f: Vec<f64> = (0..6).map(|i| (3.0 * i as f64 + 0.4).cos()).collect();
        let mass: Vec<f64> = (0..6).map(|i| 40.0 + i as f64).collect();
        for (faces, is_closed) in [(closed, true), (faces(), false)] {
            let mesh = mesh(faces);
            let maker = OperatorMaker::new(functions.as_ref(), &mass, &mesh);
            assert_eq!(maker.edges.open.is_empty(), is_closed);
            let found = maker.of(&f);
            let expected = by_definition(&mesh, &functions, &f);
            assert!((&found.orientation - &expected).norm_max() < 1e-14);
            let weighted = Mat::from_fn(6, 4, |i, j| mass[i] * f[i] * functions[(i, j)]);
            let expected = product(functions.transpose(), weighted.as_ref());
            assert!((&found.multiplication - &expected).norm_max() < 1e-12);
        }
    }
}

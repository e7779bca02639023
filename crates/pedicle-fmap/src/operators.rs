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

use crate::{
    edges::{Edges, breadth_first},
    linear::add_product,
};

/// Vertices a product takes: they stay in the cache, and the order of summation is fixed.
const VERTICES_PER_PRODUCT: usize = 256;
/// Numbers that are worked on side by side, in registers.
const WIDTH: usize = 8;

/// Some functions at one vertex.
type Block = [f64; WIDTH];

/// Makes the operators of functions on one shape.
pub(crate) struct OperatorMaker {
    /// Number of functions k.
    count: usize,
    /// The vertex at every position: neighbours stand near each other.
    order: Vec<u32>,
    /// By position from here on. Φᵀ: the values at a vertex side by side, in blocks of [`WIDTH`] numbers, zeros at the end.
    functions: Vec<Block>,
    mass: Vec<f64>,
    edges: Edges,
}

/// The operators of one function, k × k.
pub(crate) struct FunctionOperators {
    /// M(f).
    pub(crate) multiplication: Mat<f64>,
    /// Ω(f).
    pub(crate) orientation: Mat<f64>,
}

impl OperatorMaker {
    pub(crate) fn new(functions: MatRef<'_, f64>, mass: &[f64], mesh: &TriMesh) -> Self {
        let (n, count) = functions.shape();
        let order = breadth_first(mesh.faces(), n);
        let n_blocks = count.div_ceil(WIDTH);
        let mut blocks = vec![[0.0; WIDTH]; n * n_blocks];
        // A few columns at a time: they fit a cache, and fill whole lines of it.
        for block in 0..n_blocks {
            let columns: Vec<_> = (block * WIDTH..count.min((block + 1) * WIDTH))
                .map(|j| functions.col(j))
                .collect();
            for (blocks, &vertex) in blocks.chunks_exact_mut(n_blocks).zip(&order) {
                for (value, column) in blocks[block].iter_mut().zip(&columns) {
                    *value = column[vertex as usize];
                }
            }
        }
        let mut position = vec![0; n];
        for (p, &vertex) in order.iter().enumerate() {
            position[vertex as usize] = p as u32;
        }
        let faces = mesh.faces().iter();
        let faces: Vec<[u32; 3]> = faces
            .map(|face| face.map(|v| position[v as usize]))
            .collect();
        Self {
            count,
            functions: blocks,
            mass: order.iter().map(|&vertex| mass[vertex as usize]).collect(),
            edges: Edges::new(&faces, n),
            order,
        }
    }

    /// Whether Ω(f) is antisymmetric: every edge has as many half-edges one way as the other.
    pub(crate) fn is_closed(&self) -> bool {
        self.edges.open.is_empty()
    }

    /// Φᵀ, k × n.
    fn functions(&self) -> MatRef<'_, f64> {
        self.columns(&self.functions).subrows(0, self.count)
    }

    /// One column a vertex, zeros at the end.
    fn columns<'b>(&self, blocks: &'b [Block]) -> MatRef<'b, f64> {
        let rows = WIDTH * self.count.div_ceil(WIDTH);
        let numbers = blocks.as_flattened();
        MatRef::from_column_major_slice(numbers, rows, numbers.len() / rows)
    }

    /// M(f) and Ω(f) for a function given at the vertices.
    pub(crate) fn of(&self, f: &[f64]) -> FunctionOperators {
        let (k, n) = (self.count, self.mass.len());
        let f: Vec<f64> = self
            .order
            .iter()
            .map(|&vertex| f[vertex as usize])
            .collect();
        let mut turns = self.edges.antisymmetric_entries(&f);
        let of_mass: f64 = self.mass.iter().zip(&f).map(|(m, f)| (m * f).powi(2)).sum();
        let of_turns: f64 = turns.iter().map(|turn| 2.0 * turn * turn).sum();
        let scale = balancing_power_of_two(of_mass, of_turns);
        turns.iter_mut().for_each(|turn| *turn *= scale);

        let n_blocks = k.div_ceil(WIDTH);
        let mut z = Mat::zeros(k, k);
        let mut rows = vec![[0.0; WIDTH]; n_blocks * VERTICES_PER_PRODUCT.min(n)];
        let arch = pulp::Arch::new();
        for first in (0..n).step_by(VERTICES_PER_PRODUCT) {
            let count = VERTICES_PER_PRODUCT.min(n - first);
            let rows = &mut rows[..n_blocks * count];
            arch.dispatch(Rows {
                maker: self,
                f: &f,
                turns: &turns,
                first,
                out: rows,
            });
            let functions = self.functions().subcols(first, count);
            let rows = self.columns(rows).subrows(0, k);
            add_product(&mut z, 1.0, functions, rows.transpose());
        }
        let mut orientation = self.symmetric_orientation(&f);
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
        let (k, functions) = (self.count, self.functions());
        let mut operator = Mat::zeros(k, k);
        let (mut left, mut right) = (Mat::zeros(k, 0), Mat::zeros(k, 0));
        for some in self.edges.open.chunks(VERTICES_PER_PRODUCT / 2) {
            left.resize_with(k, 2 * some.len(), |_, _| 0.0);
            right.resize_with(k, 2 * some.len(), |_, _| 0.0);
            for (i, &(edge, excess)) in some.iter().enumerate() {
                let [a, b] = self.edges.ends[edge as usize].map(|v| v as usize);
                let beside = excess * (f[a] - f[b]) / 12.0;
                let (at_a, at_b) = (-excess * f[b] / 6.0, excess * f[a] / 6.0);
                for l in 0..k {
                    let (phi_a, phi_b) = (functions[(l, a)], functions[(l, b)]);
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
    maker: &'a OperatorMaker,
    f: &'a [f64],
    /// s S_f⁻ of every edge.
    turns: &'a [f64],
    first: usize,
    /// The blocks of every vertex.
    out: &'a mut [Block],
}

impl pulp::WithSimd for Rows<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let (maker, edges) = (self.maker, &self.maker.edges);
        let n_blocks = maker.count.div_ceil(WIDTH);
        let rows = self.out.chunks_exact_mut(n_blocks);
        let mut turns = Vec::new();
        for (vertex, row) in (self.first..).zip(rows) {
            let own = maker.mass[vertex] * self.f[vertex];
            let links = edges.link_starts[vertex]..edges.link_starts[vertex + 1];
            turns.clear();
            turns.extend(edges.links[links].iter().map(|link| {
                let first = link.other as usize * n_blocks;
                (first, link.sign * self.turns[link.edge as usize])
            }));
            for (i, out) in row.iter_mut().enumerate() {
                let mut sum =
                    plus_scaled([0.0; WIDTH], own, &maker.functions[vertex * n_blocks + i]);
                for &(first, turn) in &turns {
                    sum = plus_scaled(sum, turn, &maker.functions[first + i]);
                }
                *out = sum;
            }
        }
    }
}

/// sum + factor block, by value: in memory the compiler would have to go entry by entry.
#[inline(always)]
fn plus_scaled(sum: Block, factor: f64, block: &Block) -> Block {
    let mut out = sum;
    for lane in 0..WIDTH {
        out[lane] = factor.mul_add(block[lane], out[lane]);
    }
    out
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

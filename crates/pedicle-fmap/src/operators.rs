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

use faer::{Mat, MatRef};
use pedicle_mesh::TriMesh;

use crate::linear::{add_product, product};

/// Faces a product takes: they stay in the cache, and the order of summation is fixed.
const FACES_PER_BLOCK: usize = 2048;

/// M(f) for a function given at the vertices.
pub(crate) fn multiplication(functions: MatRef<'_, f64>, mass: &[f64], f: &[f64]) -> Mat<f64> {
    let weighted = Mat::from_fn(functions.nrows(), functions.ncols(), |i, j| {
        mass[i] * f[i] * functions[(i, j)]
    });
    product(functions.transpose(), weighted.as_ref())
}

/// The functions of a shape gathered face by face, for Ω of many functions: 32 k bytes a face.
pub(crate) struct FaceFunctions<'a> {
    mesh: &'a TriMesh,
    /// Values at the three corners, n_faces × k each.
    corners: [Mat<f64>; 3],
    /// Their sums.
    sums: Mat<f64>,
}

impl<'a> FaceFunctions<'a> {
    pub(crate) fn new(functions: MatRef<'_, f64>, mesh: &'a TriMesh) -> Self {
        let (n, k) = (mesh.n_faces(), functions.ncols());
        let at = |corner: usize| {
            let mut values = Mat::zeros(n, k);
            for j in 0..k {
                let column = functions.col(j);
                let faces = values.col_as_slice_mut(j).iter_mut().zip(mesh.faces());
                faces.for_each(|(value, face)| *value = column[face[corner] as usize]);
            }
            values
        };
        let corners = [at(0), at(1), at(2)];
        let sums = &corners[0] + &corners[1] + &corners[2];
        Self {
            mesh,
            corners,
            sums,
        }
    }

    /// Ω(f) for a function given at the vertices.
    pub(crate) fn orientation(&self, f: &[f64]) -> Mat<f64> {
        let (n, k) = self.sums.shape();
        let faces = self.mesh.faces().iter();
        let differences: Vec<[f64; 3]> = faces
            .map(|face| {
                let [a, b, c] = face.map(|v| f[v as usize]);
                [(c - b) / 6.0, (a - c) / 6.0, (b - a) / 6.0]
            })
            .collect();
        let mut operator = Mat::zeros(k, k);
        for first in (0..n).step_by(FACES_PER_BLOCK) {
            let count = FACES_PER_BLOCK.min(n - first);
            let mut turned = Mat::zeros(count, k);
            for j in 0..k {
                let [a, b, c] = [0, 1, 2].map(|corner| {
                    let column = self.corners[corner].col_as_slice(j);
                    &column[first..first + count]
                });
                let differences = &differences[first..first + count];
                let out = turned.col_as_slice_mut(j).iter_mut().zip(differences);
                for (((value, d), h_a), (h_b, h_c)) in out.zip(a).zip(b.iter().zip(c)) {
                    *value = h_a * d[0] + h_b * d[1] + h_c * d[2];
                }
            }
            let sums = self.sums.subrows(first, count);
            add_product(&mut operator, 1.0, sums.transpose(), turned.as_ref());
        }
        operator
    }
}

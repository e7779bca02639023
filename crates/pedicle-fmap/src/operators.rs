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

/// Faces whose rows are held at a time: bounds the memory, fixes the order of summation.
const FACES_PER_BLOCK: usize = 2048;

/// M(f) for a function given at the vertices.
pub(crate) fn multiplication(functions: MatRef<'_, f64>, mass: &[f64], f: &[f64]) -> Mat<f64> {
    let weighted = Mat::from_fn(functions.nrows(), functions.ncols(), |i, j| {
        mass[i] * f[i] * functions[(i, j)]
    });
    product(functions.transpose(), weighted.as_ref())
}

/// Ω(f) for a function given at the vertices.
pub(crate) fn orientation(functions: MatRef<'_, f64>, mesh: &TriMesh, f: &[f64]) -> Mat<f64> {
    let k = functions.ncols();
    let mut operator = Mat::zeros(k, k);
    for faces in mesh.faces().chunks(FACES_PER_BLOCK) {
        let mut sum = Mat::zeros(faces.len(), k);
        let mut turned = Mat::zeros(faces.len(), k);
        for j in 0..k {
            let column = functions.col(j);
            let sum = sum.col_as_slice_mut(j);
            let turned = turned.col_as_slice_mut(j);
            for (row, corners) in faces.iter().enumerate() {
                let [a, b, c] = corners.map(|v| v as usize);
                let (h_a, h_b, h_c) = (column[a], column[b], column[c]);
                sum[row] = h_a + h_b + h_c;
                turned[row] =
                    (h_a * (f[c] - f[b]) + h_b * (f[a] - f[c]) + h_c * (f[b] - f[a])) / 6.0;
            }
        }
        add_product(&mut operator, 1.0, sum.transpose(), turned.as_ref());
    }
    operator
}

//! Commutators with operators of many pairs of functions, from as few operators as span them.
//!
//! ```text
//! Σ_p ‖C M_s(f_p) - M_t(g_p) C‖² / norm_p²  =  Σ_i ‖C S_i - T_i C‖²
//! ```
//!
//! M and Ω are linear in the function, and the sum of squares does not change when its terms are
//! mixed by an orthogonal matrix. Signatures overlap a lot, so the pairs (f_p, g_p), and then the
//! pairs of operators, are mixed into their principal directions, and directions that hold less
//! than [`NEGLIGIBLE`] of the largest are left out. Fifty signatures come down to about half.

use faer::{Mat, MatRef, Side as Triangle};
use rayon::prelude::*;

use crate::{
    Shape,
    convert::functions,
    energy::Commutator,
    linear::{add_scaled, dot, product},
    operators::{FaceFunctions, multiplication},
};

/// Share of the largest squared norm below which a direction is left out: 1e-6 in norm, far below
/// what descriptors are known to, and above the rounding of the products that find it.
const NEGLIGIBLE: f64 = 1e-12;

/// Pairs of functions, mixed into their principal directions.
pub(crate) struct FunctionPairs<'a> {
    source: &'a Shape<'a>,
    target: &'a Shape<'a>,
    /// (k_target, k_source).
    size: (usize, usize),
    /// Directions, one a column.
    source_functions: Mat<f64>,
    target_functions: Mat<f64>,
    /// Function p = Σ_i mixture(i, p) direction i.
    mixture: Mat<f64>,
}

/// What is made of a function.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum OperatorKind {
    /// M(f), symmetric.
    Multiplication,
    /// Ω(f).
    Orientation,
}

/// Makes operators of functions on one shape.
enum Maker<'a> {
    Multiplication(MatRef<'a, f64>, &'a [f64]),
    Orientation(FaceFunctions<'a>),
}

impl OperatorKind {
    fn on<'a>(self, shape: &'a Shape<'a>, count: usize) -> Maker<'a> {
        let functions = functions(shape.basis, count);
        match self {
            Self::Multiplication => Maker::Multiplication(functions, &shape.basis.mass),
            Self::Orientation => Maker::Orientation(FaceFunctions::new(functions, shape.mesh)),
        }
    }
}

impl Maker<'_> {
    fn of(&self, f: &[f64]) -> Mat<f64> {
        match self {
            Self::Multiplication(functions, mass) => multiplication(*functions, mass, f),
            Self::Orientation(faces) => faces.orientation(f),
        }
    }
}

impl<'a> FunctionPairs<'a> {
    /// The pairs in some columns of the descriptors.
    pub(crate) fn new(
        (source, target): (&'a Shape<'a>, &'a Shape<'a>),
        size: (usize, usize),
        columns: &[usize],
    ) -> Self {
        let choose = |shape: &Shape<'_>| {
            Mat::from_fn(shape.descriptors.nrows(), columns.len(), |i, p| {
                shape.descriptors[(i, columns[p])]
            })
        };
        let (mut f, mut g) = (choose(source), choose(target));
        // The scale of a pair is no matter: its operators are divided by their norm later.
        for p in 0..columns.len() {
            let norm = f.col(p).norm_l2().hypot(g.col(p).norm_l2());
            if norm > 0.0 {
                for functions in [&mut f, &mut g] {
                    let column = functions.col_as_slice_mut(p);
                    column.iter_mut().for_each(|value| *value /= norm);
                }
            }
        }
        let gram = product(f.transpose(), f.as_ref()) + product(g.transpose(), g.as_ref());
        let directions = principal_directions(&gram);
        Self {
            source,
            target,
            size,
            source_functions: product(f.as_ref(), directions.as_ref()),
            target_functions: product(g.as_ref(), directions.as_ref()),
            mixture: directions.transpose().to_owned(),
        }
    }

    /// The terms ½ w ‖C S - σ T C‖² of all pairs, every pair divided by its joint norm.
    pub(crate) fn commutators(
        &self,
        weight: f64,
        sign: f64,
        kind: OperatorKind,
    ) -> Vec<Commutator> {
        let (source_of, target_of) = (
            kind.on(self.source, self.size.1),
            kind.on(self.target, self.size.0),
        );
        let pairs: Vec<(Mat<f64>, Mat<f64>)> = (0..self.mixture.nrows())
            .into_par_iter()
            .map(|i| {
                let f = self.source_functions.col_as_slice(i);
                let g = self.target_functions.col_as_slice(i);
                (source_of.of(f), target_of.of(g))
            })
            .collect();
        let n = pairs.len();
        let mut gram = Mat::zeros(n, n);
        for i in 0..n {
            for j in 0..=i {
                let value = dot(&pairs[i].0, &pairs[j].0) + dot(&pairs[i].1, &pairs[j].1);
                gram[(i, j)] = value;
                gram[(j, i)] = value;
            }
        }
        let mut scaled = self.mixture.clone();
        for p in 0..scaled.ncols() {
            let column = scaled.col_mut(p);
            let squared = column.as_ref().transpose() * &gram * column.as_ref();
            if squared > 0.0 {
                let factor = (2.0 / squared).sqrt();
                let column = scaled.col_as_slice_mut(p);
                column.iter_mut().for_each(|value| *value *= factor);
            }
        }
        let between = product(
            scaled.transpose(),
            product(gram.as_ref(), scaled.as_ref()).as_ref(),
        );
        let mixed = product(scaled.as_ref(), principal_directions(&between).as_ref());
        let mix = |i: usize| {
            let (k_target, k_source) = self.size;
            let mut source = Mat::zeros(k_source, k_source);
            let mut target = Mat::zeros(k_target, k_target);
            for (factor, (s, t)) in mixed.col_as_slice(i).iter().zip(&pairs) {
                add_scaled(&mut source, *factor, s);
                add_scaled(&mut target, *factor, t);
            }
            Commutator {
                weight,
                source,
                target,
                sign,
                is_symmetric: kind == OperatorKind::Multiplication,
            }
        };
        (0..mixed.ncols()).into_par_iter().map(mix).collect()
    }
}

/// Orthonormal eigenvectors of a Gram matrix that matter, one a column, largest first; all unit
/// vectors if they cannot be found.
fn principal_directions(gram: &Mat<f64>) -> Mat<f64> {
    let n = gram.nrows();
    let Ok(eigen) = gram.self_adjoint_eigen(Triangle::Lower) else {
        return Mat::identity(n, n);
    };
    let values: Vec<f64> = (0..n).map(|i| eigen.S().column_vector()[i]).collect();
    let largest = values.last().copied().unwrap_or(0.0);
    let kept: Vec<usize> = (0..n)
        .rev()
        .filter(|&i| values[i] > NEGLIGIBLE * largest)
        .collect();
    Mat::from_fn(n, kept.len(), |i, j| eigen.U()[(i, kept[j])])
}

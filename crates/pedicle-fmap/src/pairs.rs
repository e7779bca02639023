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
    commutators::{Commutators, Symmetry},
    convert::functions,
    linear::{add_product, product},
    operators::{FunctionOperators, OperatorMaker},
    stack::Stack,
};

/// Share of the largest squared norm below which a direction is left out: 1e-4 in norm. Descriptors
/// of two shapes agree to some percent, and the energy changes by 1e-8 of itself.
const NEGLIGIBLE: f64 = 1e-8;

/// Pairs of functions, mixed into their principal directions.
struct FunctionPairs {
    /// Directions, one a column, of the source and of the target.
    directions: [Mat<f64>; 2],
    /// Function p = Σ_i mixture(i, p) direction i.
    mixture: Mat<f64>,
}

/// The operators of all directions on one shape.
struct ShapeOperators {
    multiplications: Stack,
    orientations: Stack,
    /// Whether the orientation operators are antisymmetric.
    is_closed: bool,
}

/// What of the operators of some descriptors enters the energy.
pub(crate) struct CommutatorOptions<'a> {
    /// Functions of the target and of the source.
    pub(crate) size: (usize, usize),
    /// Columns of the descriptors.
    pub(crate) columns: &'a [usize],
    /// Weight of the multiplication operators, over the number of columns; 0 leaves them out.
    pub(crate) multiplication: f64,
    /// Weight of the orientation operators, over the number of columns; 0 leaves them out.
    pub(crate) orientation: f64,
    /// -1 if the map turns the orientation round.
    pub(crate) sign: f64,
}

/// The terms of the multiplication operators and of the orientation operators, every pair divided
/// by its joint norm.
pub(crate) fn commutators(
    (source, target): (&Shape<'_>, &Shape<'_>),
    options: &CommutatorOptions<'_>,
) -> [Option<Commutators>; 2] {
    if options.multiplication <= 0.0 && options.orientation <= 0.0 {
        return [None, None];
    }
    let pairs = FunctionPairs::new((source, target), options.columns);
    let (k_target, k_source) = options.size;
    let [of_source, of_target] = &pairs.directions;
    let (of_source, of_target) = rayon::join(
        || operators(source, k_source, of_source),
        || operators(target, k_target, of_target),
    );
    let some = |weight: f64, sign: f64, symmetry: Symmetry, operators: [&Stack; 2]| {
        (weight > 0.0).then(|| {
            let [source, target] = mixed(&pairs.mixture, operators);
            Commutators {
                weight,
                sign,
                source,
                target,
                symmetry,
            }
        })
    };
    let multiplications = [&of_source.multiplications, &of_target.multiplications];
    let orientations = [&of_source.orientations, &of_target.orientations];
    let symmetry = if of_source.is_closed && of_target.is_closed {
        Symmetry::Antisymmetric
    } else {
        Symmetry::None
    };
    [
        some(
            options.multiplication,
            1.0,
            Symmetry::Symmetric,
            multiplications,
        ),
        some(options.orientation, options.sign, symmetry, orientations),
    ]
}

impl FunctionPairs {
    /// The pairs in some columns of the descriptors.
    fn new((source, target): (&Shape<'_>, &Shape<'_>), columns: &[usize]) -> Self {
        let choose = |shape: &Shape<'_>| {
            let mut chosen = Mat::zeros(shape.descriptors.nrows(), columns.len());
            for (p, &column) in columns.iter().enumerate() {
                let from = shape.descriptors.col_as_slice(column);
                chosen.col_as_slice_mut(p).copy_from_slice(from);
            }
            chosen
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
        let directions = principal_directions(&joint_gram([f.as_ref(), g.as_ref()]));
        Self {
            directions: [&f, &g].map(|functions| product(functions.as_ref(), directions.as_ref())),
            mixture: directions.transpose().to_owned(),
        }
    }
}

/// M and Ω of every direction, in the first functions of a shape.
fn operators(shape: &Shape<'_>, count: usize, directions: &Mat<f64>) -> ShapeOperators {
    let maker = OperatorMaker::new(functions(shape.basis, count), &shape.basis.mass, shape.mesh);
    let made: Vec<FunctionOperators> = (0..directions.ncols())
        .into_par_iter()
        .map(|i| maker.of(directions.col_as_slice(i)))
        .collect();
    ShapeOperators {
        multiplications: Stack::new(count, made.iter().map(|of| &of.multiplication)),
        orientations: Stack::new(count, made.iter().map(|of| &of.orientation)),
        is_closed: maker.is_closed(),
    }
}

/// Operators of as few mixtures as span those of the functions, the pairs of which have norm 1.
fn mixed(mixture: &Mat<f64>, operators: [&Stack; 2]) -> [Stack; 2] {
    let gram = joint_gram(operators.map(Stack::columns));
    let mut scaled = mixture.clone();
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
    let mix = product(scaled.as_ref(), principal_directions(&between).as_ref());
    operators.map(|stack| stack.mixed(mix.as_ref()))
}

/// AᵀA + BᵀB.
fn joint_gram([a, b]: [MatRef<'_, f64>; 2]) -> Mat<f64> {
    let mut gram = product(a.transpose(), a);
    add_product(&mut gram, 1.0, b.transpose(), b);
    gram
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

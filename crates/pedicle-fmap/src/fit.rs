//! The functional map of least energy.
//!
//! ```text
//! ∇E(C) = H(C) - w_d B Aᵀ = 0
//! row i without commutators:   (w_d A Aᵀ + w_l diag(D_i) + …) c_i = w_d A b_i
//! ```
//!
//! Without commutators the energy separates into k_target symmetric positive definite systems of
//! size k_source, solved by Cholesky. With them the normal equations are solved without ever
//! forming H, by conjugate gradients on vec C. The preconditioner is the exact block diagonal of H,
//! one block a row of C: for a commutator with S and T it is
//! (S - σ T_ii)(S - σ T_ii)ᵀ + Σ_{j≠i} T_ji².

use faer::{
    Mat, Side as Triangle,
    linalg::solvers::{DenseSolveCore, Llt},
    prelude::Solve,
};
use rayon::prelude::*;

use crate::{
    Energy, EnergyTerms, EnergyWeights, FmapError, FunctionalMap, LaplacianMask, OperatorColumns,
    OrientationBehaviour, Shape,
    linear::{add_scaled, dot},
    stack::Stack,
};

/// How a map is fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct FitOptions {
    /// Number of functions of the source, 60.
    pub n_source: usize,
    /// Number of functions of the target, 60.
    pub n_target: usize,
    /// Weights of the terms of the energy.
    pub weights: EnergyWeights,
    /// Which pairs of modes the Laplacian term leaves alone; resolvent, γ = 0.5.
    pub mask: LaplacianMask,
    /// What the map does to the orientation; it is kept.
    pub orientation: OrientationBehaviour,
    /// Descriptors from which operators are made; 10, evenly spread.
    pub operator_columns: OperatorColumns,
    /// Norm of the gradient, relative to that at C = 0, at which the iteration ends, 1e-8.
    pub tolerance: f64,
    /// Largest number of conjugate gradient steps, 1000.
    pub max_iterations: usize,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            n_source: 60,
            n_target: 60,
            weights: EnergyWeights::default(),
            mask: LaplacianMask::default(),
            orientation: OrientationBehaviour::default(),
            operator_columns: OperatorColumns::default(),
            tolerance: 1e-8,
            max_iterations: 1000,
        }
    }
}

/// Why a fit ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FitTermination {
    /// The energy separates by rows and was minimised directly.
    Direct,
    /// The gradient fell below the tolerance.
    Converged,
    /// The limit of iterations came first; see the norm of the gradient.
    IterationLimit,
}

/// A fitted map and how the fit went.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The map of least energy.
    pub map: FunctionalMap,
    /// The weighted terms of the energy at the map.
    pub energies: EnergyTerms,
    /// Norm of the gradient at the map, relative to that at C = 0.
    pub gradient_norm: f64,
    /// Conjugate gradient steps taken; 0 for a direct solution.
    pub iterations: usize,
    /// Why the fit ended.
    pub termination: FitTermination,
}

/// Fits the map from the functions of the source to those of the target.
///
/// # Errors
/// [`FmapError`] if sizes do not fit, a number is not finite, an option makes no sense, or the
/// descriptors of both shapes are zero in the basis.
pub fn fit(source: &Shape<'_>, target: &Shape<'_>, options: &FitOptions) -> Result<Fit, FmapError> {
    if !(options.tolerance > 0.0 && options.tolerance < 1.0) {
        return Err(FmapError::InvalidOption {
            option: "tolerance",
            value: options.tolerance,
            requirement: "it must lie in (0, 1)",
        });
    }
    let energy = Energy::new(source, target, options)?;
    minimize(&energy, options.tolerance, options.max_iterations)
}

/// Minimises an energy that has been built already.
///
/// # Errors
/// [`FmapError::Decomposition`] if a block of the preconditioner is not positive definite,
/// [`FmapError::Empty`] if the descriptors of one shape are zero in the basis.
pub fn minimize(energy: &Energy, tolerance: f64, max_iterations: usize) -> Result<Fit, FmapError> {
    let right_side = energy.linear_part();
    let scale = right_side.norm_l2();
    if scale <= 0.0 {
        return Err(FmapError::Empty {
            what: "descriptors that both bases can represent",
        });
    }
    let blocks = RowBlocks::new(energy)?;
    let mut c = blocks.solve(&right_side);
    let (iterations, termination) = if energy.commutator_hessian.is_none() {
        (0, FitTermination::Direct)
    } else {
        conjugate_gradients(
            energy,
            &blocks.inverses(),
            &mut c,
            (tolerance * scale, max_iterations),
        )
    };
    let gradient_norm = energy.gradient(&c).norm_l2() / scale;
    Ok(Fit {
        energies: energy.value(&c),
        map: FunctionalMap { matrix: c },
        gradient_norm,
        iterations,
        termination,
    })
}

/// Preconditioned conjugate gradients from the start given in `c`.
fn conjugate_gradients(
    energy: &Energy,
    preconditioner: &RowInverses,
    c: &mut Mat<f64>,
    (threshold, max_iterations): (f64, usize),
) -> (usize, FitTermination) {
    let mut residual = energy.gradient(c);
    residual *= faer::Scale(-1.0);
    let mut preconditioned = preconditioner.times(&residual);
    let mut direction = preconditioned.clone();
    let mut product = dot(&residual, &preconditioned);
    for iteration in 0..max_iterations {
        if residual.norm_l2() <= threshold {
            return (iteration, FitTermination::Converged);
        }
        let curved = energy.hessian_times(&direction);
        let curvature = dot(&direction, &curved);
        if curvature <= 0.0 {
            // Rounding has used up the direction: no further descent is possible.
            return (iteration, FitTermination::IterationLimit);
        }
        let step = product / curvature;
        add_scaled(c, step, &direction);
        add_scaled(&mut residual, -step, &curved);
        preconditioned = preconditioner.times(&residual);
        let next = dot(&residual, &preconditioned);
        let ratio = next / product;
        product = next;
        direction *= faer::Scale(ratio);
        add_scaled(&mut direction, 1.0, &preconditioned);
    }
    if residual.norm_l2() <= threshold {
        (max_iterations, FitTermination::Converged)
    } else {
        (max_iterations, FitTermination::IterationLimit)
    }
}

/// The block diagonal of the Hessian, factored: one k_source × k_source block a row of C.
struct RowBlocks {
    factors: Vec<Llt<f64>>,
}

/// The inverses of [`RowBlocks`], for many products.
struct RowInverses {
    blocks: Stack,
}

impl RowBlocks {
    fn new(energy: &Energy) -> Result<Self, FmapError> {
        let (n_rows, n) = energy.size();
        let hessian = energy.commutator_hessian.as_ref();
        let own = hessian.map(|hessian| (hessian.row_blocks(), &hessian.target_squares));
        let factor = |row: usize| {
            let mut block = energy.shared_block.clone();
            if let Some((own, squares)) = &own {
                for j in 0..n {
                    for i in 0..n {
                        block[(i, j)] += own[(row, i + n * j)];
                    }
                    block[(j, j)] += squares[(row, row)];
                }
            }
            for j in 0..n {
                block[(j, j)] += energy.diagonal_weight(row, j);
            }
            block
                .llt(Triangle::Lower)
                .map_err(|_| FmapError::Decomposition {
                    what: "the normal equations of one row",
                    rows: n,
                    columns: n,
                })
        };
        let factors = (0..n_rows).into_par_iter().map(factor);
        Ok(Self {
            factors: factors.collect::<Result<_, _>>()?,
        })
    }

    /// Solves the system of every row.
    fn solve(&self, right_side: &Mat<f64>) -> Mat<f64> {
        let mut rows = right_side.transpose().to_owned();
        for (i, factor) in self.factors.iter().enumerate() {
            factor.solve_in_place(rows.subcols_mut(i, 1));
        }
        rows.transpose().to_owned()
    }

    fn inverses(&self) -> RowInverses {
        let inverses = self.factors.par_iter().map(Llt::inverse);
        let inverses: Vec<Mat<f64>> = inverses.collect();
        RowInverses {
            blocks: Stack::new(inverses.first().map_or(1, Mat::nrows), inverses.iter()),
        }
    }
}

impl RowInverses {
    /// Multiplies every row with the inverse of its block.
    fn times(&self, right_side: &Mat<f64>) -> Mat<f64> {
        pulp::Arch::new().dispatch(TimesRows {
            blocks: &self.blocks,
            rows: right_side.transpose().to_owned(),
        })
    }
}

/// [`RowInverses::times`], compiled for wide registers where the processor has them.
struct TimesRows<'a> {
    blocks: &'a Stack,
    /// One row of the right-hand side a column.
    rows: Mat<f64>,
}

impl pulp::WithSimd for TimesRows<'_> {
    type Output = Mat<f64>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Mat<f64> {
        let n = self.blocks.size;
        let mut solved = Mat::zeros(n, self.rows.ncols());
        for i in 0..self.blocks.count {
            let solved = solved.col_as_slice_mut(i);
            let columns = self.blocks.values_of(i).chunks_exact(n);
            for (column, x) in columns.zip(self.rows.col_as_slice(i)) {
                for (sum, entry) in solved.iter_mut().zip(column) {
                    *sum = x.mul_add(*entry, *sum);
                }
            }
        }
        solved.transpose().to_owned()
    }
}

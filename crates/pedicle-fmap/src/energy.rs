//! The energy of a functional map: its terms, its value and its exact gradient.
//!
//! ```text
//! E(C) =   ½ w_d ‖C A - B‖²                           descriptors
//!        + ½ w_l Σ_ij D_ij C_ij²                      commutes with the Laplacians
//!        + ½ w_c mean_f ‖C M_s(f) - M_t(g) C‖²        commutes with multiplication by descriptors
//!        + ½ w_o mean_f ‖C Ω_s(f) ∓ Ω_t(g) C‖²        keeps or reverses the orientation
//!        + ½ w_n ‖C‖² / k_source                      a trace of regularisation
//! ```
//!
//! A, B are the coefficients of the descriptors, k × p. Every term is free of units and of the
//! number of descriptors, so that weights carry over: A and B are divided by the root mean square
//! of their norms, so is every pair of operators, and ‖D‖_F = 1. Quadratic in C and convex.
//!
//! Ovsjanikov et al. 2012; Nogneng & Ovsjanikov 2017; Ren et al. 2018, 2019.

use faer::Mat;

use crate::{
    FitOptions, FmapError, LaplacianMask, Shape, Side,
    commutators::{CommutatorHessian, Commutators},
    convert::{check_basis, functions},
    linear::{add_product, add_scaled, dot, product},
    map::{check_finite, check_size},
    mask::laplacian_mask,
    pairs::{CommutatorOptions, commutators},
};

/// Weights of the terms of the energy; a weight of 0 leaves the term out.
///
/// The defaults are measured on a lumbar spine of 3 500 faces with 1 mm of noise; any weight of
/// the Laplacians from 0.1 to 10 and of the orientation from 0.01 to 0.1 does nearly as well.
/// Without the orientation single vertebrae come out left-right reversed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnergyWeights {
    /// Weight of the descriptors, 1; positive.
    pub descriptors: f64,
    /// Weight of commutativity with the Laplacians, 1.
    pub laplacian: f64,
    /// Weight of commutativity with multiplication by descriptors, 0.03.
    pub descriptor_commutativity: f64,
    /// Weight of the orientation, 0.03. The faces of both meshes must be ordered consistently.
    pub orientation: f64,
    /// Weight of the norm of C, 1e-8: picks the smallest of maps that are equally good.
    pub norm: f64,
}

impl Default for EnergyWeights {
    fn default() -> Self {
        Self {
            descriptors: 1.0,
            laplacian: 1.0,
            descriptor_commutativity: 0.03,
            orientation: 0.03,
            norm: 1e-8,
        }
    }
}

/// What a map does to the orientation of the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OrientationBehaviour {
    /// Left stays left.
    #[default]
    Preserving,
    /// Left becomes right, as in a mirror.
    Reversing,
}

/// Descriptor columns from which operators are made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum OperatorColumns {
    /// So many, evenly spread over all columns (all of them if there are fewer).
    Spread(usize),
    /// These columns.
    Listed(Vec<usize>),
}

impl Default for OperatorColumns {
    fn default() -> Self {
        Self::Spread(10)
    }
}

/// The weighted terms of the energy of one map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnergyTerms {
    /// Descriptors.
    pub descriptors: f64,
    /// Commutativity with the Laplacians.
    pub laplacian: f64,
    /// Commutativity with multiplication by descriptors.
    pub descriptor_commutativity: f64,
    /// Orientation.
    pub orientation: f64,
    /// Norm of C.
    pub norm: f64,
}

impl EnergyTerms {
    /// The energy: the sum of the terms.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.descriptors
            + self.laplacian
            + self.descriptor_commutativity
            + self.orientation
            + self.norm
    }
}

/// The energy for one pair of shapes, ready to be evaluated at any C.
#[derive(Debug, Clone)]
pub struct Energy {
    pub(crate) descriptor_weight: f64,
    pub(crate) source_coefficients: Mat<f64>,
    pub(crate) target_coefficients: Mat<f64>,
    laplacian_weight: f64,
    mask: Mat<f64>,
    norm_weight: f64,
    multiplications: Option<Commutators>,
    orientations: Option<Commutators>,
    /// w_d A Aᵀ + Σ w S Sᵀ: what the blocks of all rows of C have in common.
    pub(crate) shared_block: Mat<f64>,
    /// None if there are no commutators.
    pub(crate) commutator_hessian: Option<CommutatorHessian>,
}

impl Energy {
    /// Builds the energy of maps from the first `n_source` to the first `n_target` functions.
    ///
    /// `tolerance` and `max_iterations` of the options are not used here.
    ///
    /// # Errors
    /// [`FmapError`] if sizes do not fit, a number is not finite or an option makes no sense.
    pub fn new(
        source: &Shape<'_>,
        target: &Shape<'_>,
        options: &FitOptions,
    ) -> Result<Self, FmapError> {
        let (n_target, n_source) = (options.n_target, options.n_source);
        check_shape(source, Side::Source, n_source)?;
        check_shape(target, Side::Target, n_target)?;
        check_size(
            "descriptor columns of the target",
            target.descriptors.ncols(),
            source.descriptors.ncols(),
        )?;
        check_options(options)?;
        let weights = &options.weights;
        let mut a = coefficients(source, n_source);
        let mut b = coefficients(target, n_target);
        divide_by_joint_norm(&mut a, &mut b);

        let columns = operator_columns(&options.operator_columns, source.descriptors.ncols())?;
        let sign = match options.orientation {
            OrientationBehaviour::Preserving => 1.0,
            OrientationBehaviour::Reversing => -1.0,
        };
        let share = 1.0 / columns.len() as f64;
        let [multiplications, orientations] = commutators(
            (source, target),
            &CommutatorOptions {
                size: (n_target, n_source),
                columns: &columns,
                multiplication: weights.descriptor_commutativity * share,
                orientation: weights.orientation * share,
                sign,
            },
        );
        let all: Vec<&Commutators> = [&multiplications, &orientations]
            .into_iter()
            .flatten()
            .collect();
        let hessian = CommutatorHessian::new(&all, (n_target, n_source));
        let mut shared_block = hessian.source_squares.clone();
        let weight = weights.descriptors;
        add_product(&mut shared_block, weight, a.as_ref(), a.transpose());
        Ok(Self {
            shared_block,
            commutator_hessian: (!all.is_empty()).then_some(hessian),
            descriptor_weight: weights.descriptors,
            source_coefficients: a,
            target_coefficients: b,
            laplacian_weight: weights.laplacian,
            mask: laplacian_mask(
                source.basis,
                target.basis,
                (n_target, n_source),
                options.mask,
            ),
            norm_weight: weights.norm / n_source as f64,
            multiplications,
            orientations,
        })
    }

    /// (k_target, k_source), the size of C.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        (self.mask.nrows(), self.mask.ncols())
    }

    /// The weighted terms at C.
    ///
    /// # Panics
    /// If C does not have the size of the energy.
    #[must_use]
    pub fn value(&self, c: &Mat<f64>) -> EnergyTerms {
        self.assert_size(c);
        let mut misfit = product(c.as_ref(), self.source_coefficients.as_ref());
        add_scaled(&mut misfit, -1.0, &self.target_coefficients);
        let mut masked = 0.0;
        for j in 0..c.ncols() {
            let pairs = self.mask.col_as_slice(j).iter().zip(c.col_as_slice(j));
            masked += pairs.map(|(d, x)| d * x * x).sum::<f64>();
        }
        let of = |commutators: &Option<Commutators>| {
            commutators.as_ref().map_or(0.0, |some| some.energy(c))
        };
        EnergyTerms {
            descriptors: 0.5 * self.descriptor_weight * dot(&misfit, &misfit),
            laplacian: 0.5 * self.laplacian_weight * masked,
            descriptor_commutativity: of(&self.multiplications),
            orientation: of(&self.orientations),
            norm: 0.5 * self.norm_weight * dot(c, c),
        }
    }

    /// ∂E/∂C, of the size of C.
    ///
    /// # Panics
    /// If C does not have the size of the energy.
    #[must_use]
    pub fn gradient(&self, c: &Mat<f64>) -> Mat<f64> {
        let mut gradient = self.hessian_times(c);
        add_scaled(&mut gradient, -1.0, &self.linear_part());
        gradient
    }

    /// The part of the gradient that is linear in C.
    pub(crate) fn hessian_times(&self, c: &Mat<f64>) -> Mat<f64> {
        self.assert_size(c);
        let mut out = product(c.as_ref(), self.shared_block.as_ref());
        for j in 0..c.ncols() {
            let entries = out.col_as_slice_mut(j).iter_mut();
            for ((i, entry), c) in entries.enumerate().zip(c.col_as_slice(j)) {
                *entry += self.diagonal_weight(i, j) * c;
            }
        }
        if let Some(commutators) = &self.commutator_hessian {
            commutators.add_times(c, &mut out);
        }
        out
    }

    /// w_d B Aᵀ: minus the gradient at C = 0.
    pub(crate) fn linear_part(&self) -> Mat<f64> {
        let (rows, columns) = self.size();
        let mut out = Mat::zeros(rows, columns);
        add_product(
            &mut out,
            self.descriptor_weight,
            self.target_coefficients.as_ref(),
            self.source_coefficients.transpose(),
        );
        out
    }

    /// The weight of C_ij² in the terms that look at single entries.
    pub(crate) fn diagonal_weight(&self, i: usize, j: usize) -> f64 {
        self.laplacian_weight * self.mask[(i, j)] + self.norm_weight
    }

    fn assert_size(&self, c: &Mat<f64>) {
        assert_eq!(
            (c.nrows(), c.ncols()),
            self.size(),
            "C: k_target × k_source"
        );
    }
}

fn coefficients(shape: &Shape<'_>, count: usize) -> Mat<f64> {
    let mut weighted = shape.descriptors.clone();
    for j in 0..weighted.ncols() {
        let column = weighted.col_as_slice_mut(j);
        for (value, mass) in column.iter_mut().zip(&shape.basis.mass) {
            *value *= mass;
        }
    }
    product(functions(shape.basis, count).transpose(), weighted.as_ref())
}

/// Divides both by √((‖S‖² + ‖T‖²) / 2): one factor, so that the pair stays comparable.
fn divide_by_joint_norm(source: &mut Mat<f64>, target: &mut Mat<f64>) {
    let norm = source.norm_l2().hypot(target.norm_l2()) / 2.0_f64.sqrt();
    if norm > 0.0 {
        for matrix in [source, target] {
            for j in 0..matrix.ncols() {
                for value in matrix.col_as_slice_mut(j) {
                    *value /= norm;
                }
            }
        }
    }
}

fn operator_columns(choice: &OperatorColumns, n_columns: usize) -> Result<Vec<usize>, FmapError> {
    let columns: Vec<usize> = match choice {
        OperatorColumns::Spread(count) => {
            let count = (*count).min(n_columns);
            (0..count)
                .map(|i| (2 * i + 1) * n_columns / (2 * count))
                .collect()
        }
        OperatorColumns::Listed(columns) => columns.clone(),
    };
    if columns.is_empty() {
        return Err(FmapError::Empty {
            what: "descriptor columns for operators",
        });
    }
    match columns.iter().find(|&&column| column >= n_columns) {
        Some(&column) => Err(FmapError::ColumnOutOfRange { column, n_columns }),
        None => Ok(columns),
    }
}

fn check_shape(shape: &Shape<'_>, side: Side, requested: usize) -> Result<(), FmapError> {
    let (vertices, rows, descriptors) = match side {
        Side::Source => (
            "vertices of the source mesh",
            "descriptor rows of the source",
            "descriptors of the source",
        ),
        Side::Target => (
            "vertices of the target mesh",
            "descriptor rows of the target",
            "descriptors of the target",
        ),
    };
    check_basis(shape.basis, side, requested)?;
    let n = shape.basis.n_vertices();
    check_size(vertices, shape.mesh.n_vertices(), n)?;
    check_size(rows, shape.descriptors.nrows(), n)?;
    if shape.descriptors.ncols() == 0 {
        return Err(FmapError::Empty { what: descriptors });
    }
    check_finite(descriptors, shape.descriptors)
}

fn check_options(options: &FitOptions) -> Result<(), FmapError> {
    let weights = &options.weights;
    let not_negative = [
        ("weights.laplacian", weights.laplacian),
        (
            "weights.descriptor_commutativity",
            weights.descriptor_commutativity,
        ),
        ("weights.orientation", weights.orientation),
    ];
    for (option, value) in not_negative {
        if !(value.is_finite() && value >= 0.0) {
            return Err(FmapError::InvalidOption {
                option,
                value,
                requirement: "it must be finite and not negative",
            });
        }
    }
    let positive = [
        ("weights.descriptors", weights.descriptors),
        ("weights.norm", weights.norm),
    ];
    for (option, value) in positive {
        if !(value.is_finite() && value > 0.0) {
            return Err(FmapError::InvalidOption {
                option,
                value,
                requirement: "it must be finite and positive",
            });
        }
    }
    if let LaplacianMask::Resolvent { gamma } = options.mask
        && !(gamma > 0.0 && gamma <= 1.0)
    {
        return Err(FmapError::InvalidOption {
            option: "mask.gamma",
            value: gamma,
            requirement: "it must lie in (0, 1]",
        });
    }
    Ok(())
}

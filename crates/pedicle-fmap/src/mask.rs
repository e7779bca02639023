//! Masks D that penalise entries of C between modes that do not belong together.
//!
//! ```text
//! E(C) = ½ Σ_ij D_ij C_ij²            D: k_target × k_source, ‖D‖_F = 1
//!
//! standard    D_ij = (μ_i - λ_j)²
//! resolvent   D_ij = (μ_i^γ/(μ_i^2γ + 1) - λ_j^γ/(λ_j^2γ + 1))² + (1/(μ_i^2γ + 1) - 1/(λ_j^2γ + 1))²
//! slanted     D_ij = (exp(-0.03 √(i² + j²)) |n × ((i, j) - (1, 1))|)²,  n ∥ (slope, 1)
//! ```
//!
//! μ are the eigenvalues of the target and λ those of the source, both divided by one joint
//! maximum, so the unit of length does not matter. Eigenvalues of the null spaces count as exactly
//! zero: the whole null × null block is free. The standard mask is the commutator ‖C Λ - Μ C‖².
//!
//! Ovsjanikov et al. 2012, section 5; Ren, Panine, Wonka & Ovsjanikov 2019, section 4; Rodolà,
//! Cosmo, Bronstein, Torsello & Cremers 2017, section 4.1. The slope is the number of eigenvalues of
//! the target per eigenvalue of the source below the smaller of the two maxima, so it holds for a
//! part on either side: by Weyl's law it estimates the ratio of the areas.

use faer::Mat;
use pedicle_spectral::LaplaceBasis;

/// Decay of the slanted mask with the index (Rodolà et al. 2017).
const SLANTED_DECAY: f64 = 0.03;

/// Which pairs of modes the Laplacian term leaves alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LaplacianMask {
    /// The commutator with the Laplacians itself.
    Standard,
    /// The commutator with their resolvents; better behaved at high frequencies.
    Resolvent {
        /// Power of the eigenvalues, 1; in (0, 1], 0.5 in the publication.
        gamma: f64,
    },
    /// A slanted diagonal, for a part on a whole.
    Slanted,
}

impl Default for LaplacianMask {
    fn default() -> Self {
        Self::Resolvent { gamma: 0.5 }
    }
}

/// The mask D for the first functions of two bases, k_target × k_source, ‖D‖_F = 1.
///
/// Zero if every pair of modes is as good as any other.
///
/// # Panics
/// If a basis has fewer functions than asked for.
#[must_use]
pub fn laplacian_mask(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    (n_target, n_source): (usize, usize),
    kind: LaplacianMask,
) -> Mat<f64> {
    let lambda = clean(source, n_source);
    let mu = clean(target, n_target);
    let joint = lambda.iter().chain(&mu).copied().fold(0.0, f64::max);
    let unit = if joint > 0.0 { joint } else { 1.0 };
    let scaled = |values: &[f64]| values.iter().map(|v| v / unit).collect::<Vec<_>>();
    let (lambda, mu) = (scaled(&lambda), scaled(&mu));
    let mut mask = match kind {
        LaplacianMask::Standard => {
            Mat::from_fn(n_target, n_source, |i, j| (mu[i] - lambda[j]).powi(2))
        }
        LaplacianMask::Resolvent { gamma } => {
            let (mu, lambda) = (resolvent(&mu, gamma), resolvent(&lambda, gamma));
            Mat::from_fn(n_target, n_source, |i, j| {
                (mu[i].0 - lambda[j].0).powi(2) + (mu[i].1 - lambda[j].1).powi(2)
            })
        }
        LaplacianMask::Slanted => {
            let slope = slope(&lambda, &mu);
            let length = slope.hypot(1.0);
            let free = (target.null_dimension, source.null_dimension);
            Mat::from_fn(n_target, n_source, |i, j| {
                if i < free.0 && j < free.1 {
                    return 0.0;
                }
                let distance = (slope * j as f64 - i as f64).abs() / length;
                let decay = (-SLANTED_DECAY * (i as f64 + 1.0).hypot(j as f64 + 1.0)).exp();
                (decay * distance).powi(2)
            })
        }
    };
    let norm = mask.norm_l2();
    if norm > 0.0 {
        for j in 0..n_source {
            for value in mask.col_as_slice_mut(j) {
                *value /= norm;
            }
        }
    }
    mask
}

/// Eigenvalues with those of the null space at exactly zero.
fn clean(basis: &LaplaceBasis, count: usize) -> Vec<f64> {
    basis.eigenvalues[..count]
        .iter()
        .enumerate()
        .map(|(i, &value)| {
            if i < basis.null_dimension {
                0.0
            } else {
                value.max(0.0)
            }
        })
        .collect()
}

/// Real and imaginary part of the resolvent of Λ^γ at i.
fn resolvent(values: &[f64], gamma: f64) -> Vec<(f64, f64)> {
    values
        .iter()
        .map(|v| {
            let power = v.powf(gamma);
            let denominator = power * power + 1.0;
            (power / denominator, 1.0 / denominator)
        })
        .collect()
}

/// Modes of the target per mode of the source, over the common part of the spectra.
fn slope(lambda: &[f64], mu: &[f64]) -> f64 {
    let last = |values: &[f64]| values.last().copied().unwrap_or(0.0);
    let common = last(lambda).min(last(mu));
    let below = |values: &[f64]| values.iter().filter(|&&v| v <= common).count().max(1) as f64;
    below(mu) / below(lambda)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn basis(eigenvalues: Vec<f64>, null_dimension: usize) -> LaplaceBasis {
        LaplaceBasis {
            eigenfunctions: Mat::identity(eigenvalues.len(), eigenvalues.len()),
            mass: vec![1.0; eigenvalues.len()],
            eigenvalues,
            null_dimension,
        }
    }

    const KINDS: [LaplacianMask; 3] = [
        LaplacianMask::Standard,
        LaplacianMask::Resolvent { gamma: 0.5 },
        LaplacianMask::Slanted,
    ];

    #[test]
    fn equal_spectra_leave_the_diagonal_and_the_null_space_free() {
        // Two null values, given as a solver gives them.
        let values: Vec<f64> = (0..12).map(|i| (i as f64 - 1.0).max(-1e-17)).collect();
        let basis = basis(values, 2);
        for kind in KINDS {
            let mask = laplacian_mask(&basis, &basis, (12, 12), kind);
            for i in 0..12 {
                assert!(mask[(i, i)].abs() < 1e-15, "{kind:?}");
            }
            assert!(mask[(0, 1)].abs() < 1e-15 && mask[(1, 0)].abs() < 1e-15);
            assert!(mask[(0, 5)] > 0.0 && mask[(5, 0)] > 0.0);
            assert!((mask.norm_l2() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn the_unit_of_length_does_not_matter() {
        let (source, target) = (
            basis((0..9).map(f64::from).collect(), 1),
            basis((0..14).map(|i| 0.7 * f64::from(i)).collect(), 1),
        );
        for kind in KINDS {
            let once = laplacian_mask(&source, &target, (14, 9), kind);
            for scale in [1e-6, 1e6] {
                let scaled =
                    |b: &LaplaceBasis| basis(b.eigenvalues.iter().map(|v| v * scale).collect(), 1);
                let again = laplacian_mask(&scaled(&source), &scaled(&target), (14, 9), kind);
                assert!((&once - &again).norm_l2() < 1e-12);
            }
        }
    }

    #[test]
    fn exchanging_the_shapes_transposes_the_mask() {
        let (source, target) = (
            basis((0..9).map(f64::from).collect(), 1),
            basis((0..14).map(|i| 0.4 * f64::from(i)).collect(), 1),
        );
        for kind in KINDS {
            let there = laplacian_mask(&source, &target, (14, 9), kind);
            let back = laplacian_mask(&target, &source, (9, 14), kind);
            assert!((there.transpose() - back).norm_l2() < 1e-12, "{kind:?}");
        }
    }

    #[test]
    fn a_part_of_half_the_area_gets_a_slope_of_one_half() {
        // Weyl: a part with half the area has half as many modes below a bound.
        let whole = basis((0..40).map(f64::from).collect(), 1);
        let part = basis((0..30).map(|i| 2.0 * f64::from(i)).collect(), 1);
        let mask = laplacian_mask(&whole, &part, (30, 40), LaplacianMask::Slanted);
        let column = mask.col_as_slice(30);
        let lowest = (0..30)
            .min_by(|&a, &b| column[a].total_cmp(&column[b]))
            .unwrap();
        assert!((14..=16).contains(&lowest), "row {lowest}");
    }
}

//! Times and energies at which the signatures are sampled, chosen once for both shapes.
//!
//! ```text
//! t_j  log-spaced from 4 ln10 / λ_max to 4 ln10 / λ_min                    (mm²)
//! e_j  evenly spaced from ln λ_min + 2s to ln λ_max - 2s,
//!      s = 7 (e_last - e_first) / n
//! ```
//!
//! λ_min is the first eigenvalue above the null space, λ_max the last of the basis. Two shapes
//! share the interval that both spectra cover: the larger λ_min and the smaller λ_max. The
//! definition of s refers to the shrunken interval of energies; solved for s it reads
//! s = 7 (ln λ_max - ln λ_min) / (n + 28), which leaves a proper interval for every n.
//!
//! Sun, Ovsjanikov & Guibas 2009, section 5; Aubry, Schlickewei & Cremers 2011, section 4.

use pedicle_spectral::LaplaceBasis;

use crate::DescriptorError;

/// 4 ln 10: the heat of a mode with λ t equal to it has fallen to 10⁻⁴ (Sun et al. 2009).
const DECAY: f64 = 4.0 * std::f64::consts::LN_10;
/// Spread of the wave kernel in steps of energy (Aubry et al. 2011).
const SPREAD_IN_STEPS: f64 = 7.0;
/// Distance of the outermost energies from the ends of the spectrum, in spreads.
const MARGIN_IN_SPREADS: f64 = 2.0;
/// Functions needed above the null space: two, or the interval is a point.
const NEEDED_ABOVE_NULL_SPACE: usize = 2;

/// Diffusion times in mm², ascending.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatTimes {
    times: Vec<f64>,
}

/// Logarithmic energies, ascending, and the spread of the kernel about them.
#[derive(Debug, Clone, PartialEq)]
pub struct WaveEnergies {
    energies: Vec<f64>,
    spread: f64,
}

impl HeatTimes {
    /// Takes times in mm² as they are.
    ///
    /// # Errors
    /// [`DescriptorError`] if there are none or one is not positive and finite.
    pub fn new(times: Vec<f64>) -> Result<Self, DescriptorError> {
        check_samples(&times, |t| t.is_finite() && t > 0.0)?;
        Ok(Self { times })
    }

    /// `n` times that suit both shapes. Swapping the shapes changes nothing.
    ///
    /// # Errors
    /// [`DescriptorError`] if `n` is 0, a basis has fewer than two functions above its null
    /// space, or the two spectra have no interval in common.
    pub fn joint(
        source: &LaplaceBasis,
        target: &LaplaceBasis,
        n: usize,
    ) -> Result<Self, DescriptorError> {
        let (lower, upper) = joint_interval(source, target)?;
        let first = (DECAY / upper).ln();
        let last = (DECAY / lower).ln();
        let times = evenly_spaced(first, last, n).map(f64::exp).collect();
        Self::new(times)
    }

    /// The times in mm².
    #[must_use]
    pub fn as_slice(&self) -> &[f64] {
        &self.times
    }
}

impl WaveEnergies {
    /// Takes logarithmic energies (ln of 1/mm²) and the spread as they are.
    ///
    /// # Errors
    /// [`DescriptorError`] if there are none, one is not finite, or the spread is not positive.
    pub fn new(energies: Vec<f64>, spread: f64) -> Result<Self, DescriptorError> {
        check_samples(&energies, f64::is_finite)?;
        if !(spread.is_finite() && spread > 0.0) {
            return Err(DescriptorError::InvalidSpread { spread });
        }
        Ok(Self { energies, spread })
    }

    /// `n` energies that suit both shapes. Swapping the shapes changes nothing.
    ///
    /// # Errors
    /// [`DescriptorError`] if `n` is 0, a basis has fewer than two functions above its null
    /// space, or the two spectra have no interval in common.
    pub fn joint(
        source: &LaplaceBasis,
        target: &LaplaceBasis,
        n: usize,
    ) -> Result<Self, DescriptorError> {
        let (lower, upper) = joint_interval(source, target)?;
        let margins = 2.0 * MARGIN_IN_SPREADS * SPREAD_IN_STEPS;
        let spread = SPREAD_IN_STEPS * (upper.ln() - lower.ln()) / (n as f64 + margins);
        let first = lower.ln() + MARGIN_IN_SPREADS * spread;
        let last = upper.ln() - MARGIN_IN_SPREADS * spread;
        Self::new(evenly_spaced(first, last, n).collect(), spread)
    }

    /// The logarithmic energies.
    #[must_use]
    pub fn as_slice(&self) -> &[f64] {
        &self.energies
    }

    /// Standard deviation of the kernel, in units of ln λ.
    #[must_use]
    pub fn spread(&self) -> f64 {
        self.spread
    }
}

fn check_samples(samples: &[f64], valid: impl Fn(f64) -> bool) -> Result<(), DescriptorError> {
    if samples.is_empty() {
        return Err(DescriptorError::NoSamples);
    }
    match samples.iter().position(|&value| !valid(value)) {
        Some(index) => Err(DescriptorError::InvalidSample {
            index,
            value: samples[index],
        }),
        None => Ok(()),
    }
}

/// A single sample sits in the middle, two or more include both ends.
fn evenly_spaced(first: f64, last: f64, n: usize) -> impl Iterator<Item = f64> {
    (0..n).map(move |j| {
        let fraction = if n > 1 {
            j as f64 / (n - 1) as f64
        } else {
            0.5
        };
        first + fraction * (last - first)
    })
}

fn joint_interval(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
) -> Result<(f64, f64), DescriptorError> {
    let (source_lower, source_upper) = interval(source)?;
    let (target_lower, target_upper) = interval(target)?;
    // Both checked finite, so the maximum and the minimum are plain.
    let lower = source_lower.max(target_lower);
    let upper = source_upper.min(target_upper);
    if lower < upper {
        Ok((lower, upper))
    } else {
        Err(DescriptorError::DisjointSpectra { lower, upper })
    }
}

fn interval(basis: &LaplaceBasis) -> Result<(f64, f64), DescriptorError> {
    let n_functions = basis.n_functions();
    let first = basis.null_dimension;
    if n_functions < first + NEEDED_ABOVE_NULL_SPACE {
        return Err(DescriptorError::NothingAboveNullSpace {
            n_functions,
            null_dimension: first,
            needed: NEEDED_ABOVE_NULL_SPACE,
        });
    }
    for index in [first, n_functions - 1] {
        let value = basis.eigenvalues[index];
        if !(value.is_finite() && value > 0.0) {
            return Err(DescriptorError::InvalidEigenvalue { index, value });
        }
    }
    Ok((basis.eigenvalues[first], basis.eigenvalues[n_functions - 1]))
}

//! Whether the covariances are honest, for people.
//!
//! `e = δᵀ Σ⁻¹ δ` of every valid vertebra of a noisy target: χ² with six degrees of freedom if they
//! are.

use super::score::ScenarioScore;

/// Degrees of freedom of a pose.
const FREEDOM: f64 = 6.0;
/// χ² with six degrees of freedom exceeds this in 5 % of all cases.
const QUANTILE_95: f64 = 12.592;

/// A line on the normalised errors; empty if there is none. Poses in a wrong minimum are counted among
/// the invalid, not here.
pub(super) fn calibration(scores: &[ScenarioScore]) -> String {
    let errors: Vec<f64> = scores
        .iter()
        .filter(|score| score.scenario.cell.noise_mm() > 0.0)
        .flat_map(|score| &score.vertebrae)
        .filter(|v| v.valid && v.normalized_error.is_finite())
        .map(|v| v.normalized_error)
        .collect();
    if errors.is_empty() {
        return String::new();
    }
    let n = errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / n / FREEDOM;
    let above = errors.iter().filter(|&&e| e > QUANTILE_95).count() as f64 / n;
    format!(
        "covariances of {n} valid vertebrae: normalised error squared over 6 is {mean:.2} on average \
         (1 if honest), {:.1} % above the 95 % quantile of χ² (5 % if honest)",
        100.0 * above
    )
}

//! A shift just above the wanted eigenvalues, found by counting.
//!
//! ```text
//! N(λ) ≈ λ A / 4π
//! ```
//!
//! Weyl's law for the number of eigenvalues below λ on a surface of area A gives the first guess;
//! the inertia of the factorisation gives the true number. The guess is scaled by the size of W, so
//! that the unit of neither matrix matters. Weyl 1911.

use crate::SpectralError;
use crate::block::Block;
use crate::parallel::map;

/// Diagonal of the cotangent matrix on equilateral triangles, 6 / √3.
const EQUILATERAL_DIAGONAL: f64 = 3.464_101_615_137_754_6;
/// Counts between the number asked for and this many times it (and a few more) are accepted at once.
const ACCEPTED_EXCESS: f64 = 0.35;
/// A guess from elsewhere is not followed further from Weyl's law than by this factor.
const FAR_OFF: f64 = 10.0;
/// Number of counts after which any number that is large enough is accepted.
const MAX_PATIENT_COUNTS: usize = 6;
/// Number of counts after which the search gives up.
const MAX_COUNTS: usize = 80;

/// A shift with the counts of all blocks.
pub(crate) struct CountedShift {
    pub(crate) shift: f64,
    pub(crate) n_below: usize,
    /// Number below it in every block.
    pub(crate) counts: Vec<usize>,
    /// Number of shifts that were tried.
    pub(crate) n_tried: usize,
}

/// Finds a shift with at least `n_pairs` eigenvalues below it, and few more.
///
/// A first guess from elsewhere is followed if it is not far from Weyl's law.
pub(crate) fn find_shift(
    blocks: &[Block],
    n_pairs: usize,
    guess: Option<f64>,
) -> Result<CountedShift, SpectralError> {
    let k = n_pairs as f64;
    let accepted = n_pairs + 8 + (ACCEPTED_EXCESS * k) as usize;
    let aim = aimed_count(n_pairs);
    let law = weyl_guess(blocks, aim);
    let mut shift = guess.unwrap_or(law).clamp(law / FAR_OFF, law * FAR_OFF);
    let mut too_low: Option<(f64, usize)> = None;
    let mut high_enough: Option<CountedShift> = None;
    for n_tried in 1..=MAX_COUNTS {
        let counts = map(blocks.iter().collect(), |_, block| block.count_below(shift));
        let counts = match counts.into_iter().collect::<Result<Vec<_>, _>>() {
            Ok(counts) => counts,
            // An eigenvalue was hit.
            Err(SpectralError::Factorization { .. }) if n_tried < MAX_COUNTS => {
                shift *= 1.0 + 1e-3;
                continue;
            }
            Err(error) => return Err(error),
        };
        let n_below = counts.iter().sum();
        if n_below < n_pairs {
            too_low = Some((shift, n_below));
        } else {
            high_enough = Some(CountedShift {
                shift,
                n_below,
                counts,
                n_tried,
            });
            if n_below <= accepted {
                break;
            }
        }
        let high = high_enough.as_ref().map(|h| (h.shift, h.n_below));
        if high.is_some() && n_tried >= MAX_PATIENT_COUNTS {
            break;
        }
        shift = next_guess(too_low, high, aim);
    }
    high_enough.ok_or_else(|| SpectralError::Factorization {
        first_row: 0,
        shift,
        reason: format!("no shift was found with {n_pairs} eigenvalues below it"),
    })
}

/// Number of eigenvalues that should be below the shift.
pub(crate) fn aimed_count(n_pairs: usize) -> f64 {
    let k = n_pairs as f64;
    k + 2.0 + 0.4 * ACCEPTED_EXCESS * k
}

fn weyl_guess(blocks: &[Block], n: f64) -> f64 {
    let area: f64 = blocks.iter().flat_map(|b| &b.pencil().mass).sum();
    let mut diagonal: Vec<f64> = blocks
        .iter()
        .flat_map(|b| b.pencil().diagonal.iter().map(|d| d.abs()))
        .collect();
    // The median, because a single sliver can make the mean as large as it likes.
    let middle = diagonal.len() / 2;
    let (_, &mut median, _) = diagonal.select_nth_unstable_by(middle, f64::total_cmp);
    let size = if median > 0.0 { median } else { 1.0 };
    4.0 * std::f64::consts::PI * n / area * (size / EQUILATERAL_DIAGONAL)
}

/// Interpolates log N over log λ between what is known, or goes on by Weyl's law.
fn next_guess(too_low: Option<(f64, usize)>, high: Option<(f64, usize)>, aim: f64) -> f64 {
    let logs = |(shift, count): (f64, usize)| (shift.ln(), (count.max(1) as f64).ln());
    match (too_low.map(logs), high.map(logs)) {
        (Some((low, n_low)), Some((high, n_high))) => {
            let share = (aim.ln() - n_low) / (n_high - n_low);
            // Away from both ends, so that the bracket shrinks for sure.
            (low + (high - low) * share.clamp(0.1, 0.9)).exp()
        }
        (Some((low, n_low)), None) => (low + (aim.ln() - n_low).clamp(0.2, 3.0)).exp(),
        (None, Some((high, n_high))) => (high + (aim.ln() - n_high).clamp(-3.0, -0.2)).exp(),
        (None, None) => 1.0,
    }
}

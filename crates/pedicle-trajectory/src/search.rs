//! Derivative-free maximisation.
//!
//! Steps along single coordinates first; where none helps, along pairs of them, because turning
//! a line about its entry changes an offset and a slope together. The step is halved where
//! neither helps. No random numbers: the same score gives the same answer.

/// Largest number of rounds.
const MAX_ROUNDS: usize = 300;

/// Climbs from `start`; `steps` is the first and the last step.
///
/// Returns the best value and where it is.
pub(crate) fn climb<const N: usize>(
    start: [f64; N],
    steps: (f64, f64),
    score: impl Fn(&[f64; N]) -> f64,
) -> (f64, [f64; N]) {
    let (mut step, last) = steps;
    let (mut best, mut at) = (score(&start), start);
    for _ in 0..MAX_ROUNDS {
        let before = best;
        for i in 0..N {
            for sign in [step, -step] {
                let mut candidate = at;
                candidate[i] += sign;
                let value = score(&candidate);
                if value > best {
                    (best, at) = (value, candidate);
                    break;
                }
            }
        }
        if best > before {
            continue;
        }
        if let Some(found) = climb_pair(at, step, best, &score) {
            (best, at) = found;
            continue;
        }
        step *= 0.5;
        if step < last {
            break;
        }
    }
    (best, at)
}

/// The first step along two coordinates that is better than `best`.
fn climb_pair<const N: usize>(
    at: [f64; N],
    step: f64,
    best: f64,
    score: &impl Fn(&[f64; N]) -> f64,
) -> Option<(f64, [f64; N])> {
    for i in 0..N {
        for j in i + 1..N {
            for (a, b) in [(step, step), (step, -step), (-step, step), (-step, -step)] {
                let mut candidate = at;
                candidate[i] += a;
                candidate[j] += b;
                let value = score(&candidate);
                if value > best {
                    return Some((value, candidate));
                }
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_top_of_a_narrow_ridge() {
        // The ridge runs diagonally: single coordinates alone would stop on its flank.
        let score = |v: &[f64; 2]| -(v[0] - v[1]).abs() * 10.0 - (v[0] + v[1] - 4.0).abs();
        let (value, at) = climb([-7.0, 3.0], (1.0, 1e-4), score);
        assert!(value > -1e-2, "value {value}");
        assert!(
            (at[0] - 2.0).abs() < 1e-2 && (at[1] - 2.0).abs() < 1e-2,
            "{at:?}"
        );
    }

    #[test]
    fn stays_where_nothing_is_better() {
        let (value, at) = climb([1.0, 2.0], (1.0, 0.1), |_| f64::NEG_INFINITY);
        assert_eq!(
            (value, at),
            (f64::NEG_INFINITY, [1.0, 2.0]),
            "nowhere to go"
        );
    }
}

//! What accepting more would cost: the probabilities that a screw of a valid vertebra had breached the cortex.
//!
//! Whoever accepts a share of the valid vertebrae and knows nothing but these probabilities does best to take the least endangered ones. How many breaches
//! theirs add up to is what no verdict can avoid on average.

use comfy_table::presets::UTF8_FULL_CONDENSED;

use super::report::{new_table, share};
use super::score::VertebraScore;

/// Shares of the valid that are asked for, %.
const SHARES: [f64; 7] = [94.0, 95.0, 96.0, 97.0, 98.0, 99.0, 100.0];

/// The probability that any screw of a vertebra breaches, of those that are valid and were judged, the least first.
pub(super) fn of_valid(vertebrae: &[&VertebraScore]) -> Vec<f64> {
    let valid = vertebrae.iter().filter(|v| v.valid);
    let judged = valid.map(|v| v.breach_probability).filter(|p| !p.is_nan());
    let mut found: Vec<f64> = judged.map(rounded).collect();
    found.sort_by(f64::total_cmp);
    found
}

/// To two digits, which is more than such a number knows.
fn rounded(probability: f64) -> f64 {
    format!("{probability:.1e}").parse().unwrap_or(probability)
}

/// The table of all that were valid, given their probabilities in any order.
pub(super) fn table(mut probabilities: Vec<f64>) -> Option<String> {
    if probabilities.is_empty() {
        return None;
    }
    probabilities.sort_by(f64::total_cmp);
    let header = [
        "of the valid, the least endangered",
        "vertebrae",
        "largest probability of a breach",
        "breaches on average, in all",
    ];
    let mut table = new_table(UTF8_FULL_CONDENSED, header.map(String::from).to_vec());
    let n = probabilities.len();
    for percent in SHARES {
        let n_taken = (percent / 100.0 * n as f64).round() as usize;
        let taken = &probabilities[..n_taken.min(n)];
        table.add_row(vec![
            format!("{percent:.0} %"),
            share(taken.len(), n),
            format!("{:.3} %", 100.0 * taken.last().copied().unwrap_or(0.0)),
            format!("{:.2}", taken.iter().sum::<f64>()),
        ]);
    }
    Some(table.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_endangered_come_first() {
        assert_eq!(table(Vec::new()), None);
        let mut probabilities = vec![0.001; 94];
        probabilities.extend([0.5, 0.002, 0.002, 0.01, 0.1, 0.002]);
        let text = table(probabilities).unwrap();
        let row = |start: &str| {
            let line = text.lines().find(|line| line.contains(start)).unwrap();
            line.split(['│', '┆'])
                .map(str::trim)
                .map(String::from)
                .collect::<Vec<_>>()
        };
        assert!(row(" 94 % ").contains(&"0.100 %".to_owned()), "{text}");
        assert!(row(" 97 % ").contains(&"0.10".to_owned()), "{text}");
        assert!(row(" 98 % ").contains(&"1.000 %".to_owned()), "{text}");
        assert!(row(" 100 % ").contains(&"0.71".to_owned()), "{text}");
    }

    #[test]
    fn probabilities_keep_two_digits() {
        for (told, kept) in [(0.001_234, 0.0012), (0.0, 0.0), (3.456e-9, 3.5e-9)] {
            assert!((rounded(told) - kept).abs() < 1e-15, "{}", rounded(told));
        }
    }
}

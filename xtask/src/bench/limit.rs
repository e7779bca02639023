//! Upper confidence limit of a rate of which k in n were seen.
//!
//! ```text
//! Σ_{i ≤ k} C(n, i) p^i (1 - p)^(n - i) = 0.05
//! ```
//!
//! p is the exact one-sided 95 % limit of Clopper & Pearson 1934; for k = 0 it is 1 - 0.05^(1/n).

/// Chance of an even rarer outcome at the limit.
const RISK: f64 = 0.05;
/// Halvings of the bracket: to the last digit.
const N_HALVINGS: usize = 200;

/// The exact upper 95 % limit of the rate; 1 if nothing was tried.
pub(super) fn upper_limit(k: usize, n: usize) -> f64 {
    if k >= n {
        return 1.0;
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..N_HALVINGS {
        let middle = 0.5 * (low + high);
        if at_most(k, n, middle) > RISK {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Chance of at most k in n at the rate p, by logarithms: the single terms underflow.
fn at_most(k: usize, n: usize, p: f64) -> f64 {
    let mut log_term = n as f64 * (-p).ln_1p();
    let mut sum = log_term.exp();
    for i in 1..=k {
        log_term += ((n - i + 1) as f64 / i as f64).ln() + p.ln() - (-p).ln_1p();
        sum += log_term.exp();
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_is_the_exact_one() {
        for n in [1, 10, 450, 10_000] {
            let exact = 1.0 - 0.05_f64.powf(1.0 / n as f64);
            assert!((upper_limit(0, n) / exact - 1.0).abs() < 1e-9, "0 of {n}");
        }
        // Tables of Clopper and Pearson: 1 of 10 and 5 of 100, one-sided 95 %.
        for (k, n, expected) in [(1, 10, 0.3942), (5, 100, 0.1023)] {
            let found = upper_limit(k, n);
            assert!((found - expected).abs() < 1e-4, "{k} of {n}: {found}");
        }
        let all = [upper_limit(3, 3), upper_limit(0, 0)];
        assert!(all.iter().all(|p| (p - 1.0).abs() < 1e-15), "{all:?}");
    }
}

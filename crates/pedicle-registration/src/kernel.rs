//! Robust kernels and the scale of residuals.
//!
//! With u = r / s, a kernel has a cost ρ(u), an influence ψ = ρ' and a weight ψ(u)/u.
//!
//! ```text
//! Tukey           ρ = c²/6 (1 - (1 - u²/c²)³),  weight (1 - u²/c²)², both constant past c
//! Geman-McClure   ρ = u²/2 / (1 + u²/c²),       weight 1 / (1 + u²/c²)²
//! squares         ρ = u²/2,                     weight 1
//! ```
//!
//! Beaton & Tukey 1974; Geman & McClure 1987; Huber 1981. The scale s is the median of |r| over
//! 0.6745, then the truncated standard deviation about it, made consistent for the normal law.

/// How residuals are weighted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum RobustKernel {
    /// Tukey's biweight, 95 per cent efficient on normal noise; nothing past 4.685 s counts.
    #[default]
    Tukey,
    /// Geman-McClure; far points keep a vanishing weight, which widens the basin.
    GemanMcClure,
    /// Plain least squares within the gate.
    Squares,
}

/// Tukey's constant for 95 per cent efficiency.
const TUKEY: f64 = 4.685;

/// Geman-McClure's constant for about 95 per cent efficiency on normal noise.
const GEMAN_MCCLURE: f64 = 3.5;

/// Residuals past this many s tell nothing about the noise of the rest.
const NOISE_SUPPORT: f64 = 5.0;

/// Median of |u| for the standard normal law.
const NORMAL_MEDIAN: f64 = 0.674_489_750_196_082;

/// Truncation of the second scale estimate, in s: keeps 98.8 per cent of normal residuals.
const TRUNCATION: f64 = 2.5;

/// Rounds of the second estimate. It converges linearly, by a factor of about 3 a round.
const SCALE_ROUNDS: usize = 12;

impl RobustKernel {
    /// ρ(u).
    pub(crate) fn cost(self, u: f64) -> f64 {
        let square = u * u;
        match self {
            Self::Tukey => {
                let c2 = TUKEY * TUKEY;
                let rest = (1.0 - square / c2).max(0.0);
                c2 / 6.0 * (1.0 - rest * rest * rest)
            }
            // Dividing by u² first would lose u = 0; infinity is handled by the caller's gate.
            Self::GemanMcClure => 0.5 * square / (1.0 + square / GEMAN_MCCLURE.powi(2)),
            Self::Squares => 0.5 * square,
        }
    }

    /// ψ(u)/u.
    pub(crate) fn weight(self, u: f64) -> f64 {
        match self {
            Self::Tukey => (1.0 - (u / TUKEY).powi(2)).max(0.0).powi(2),
            Self::GemanMcClure => (1.0 + (u / GEMAN_MCCLURE).powi(2)).powi(-2),
            Self::Squares => 1.0,
        }
    }

    /// ψ'(u).
    pub(crate) fn curvature(self, u: f64) -> f64 {
        match self {
            Self::Tukey => {
                let v = (u / TUKEY).powi(2);
                if v < 1.0 {
                    (1.0 - v) * (1.0 - 5.0 * v)
                } else {
                    0.0
                }
            }
            Self::GemanMcClure => {
                let v = (u / GEMAN_MCCLURE).powi(2);
                (1.0 - 3.0 * v) / (1.0 + v).powi(3)
            }
            Self::Squares => 1.0,
        }
    }

    /// |u| up to which a point takes part in the covariance.
    pub(crate) fn support(self) -> f64 {
        match self {
            Self::Tukey => TUKEY,
            Self::GemanMcClure => NOISE_SUPPORT,
            Self::Squares => f64::INFINITY,
        }
    }
}

/// Scale of absolute residuals none of which exceeds `gate`. Reorders its input; 0 if empty.
pub(crate) fn robust_scale(absolute: &mut [f64], gate: f64) -> f64 {
    if absolute.is_empty() {
        return 0.0;
    }
    let middle = absolute.len() / 2;
    let median = *absolute.select_nth_unstable_by(middle, f64::total_cmp).1;
    let mut scale = median / NORMAL_MEDIAN;
    // With a share of outliers the median lies too far out in the inliers; truncating there and
    // correcting for what normal residuals would lose removes most of that.
    for _ in 0..SCALE_ROUNDS {
        let cut = (TRUNCATION * scale).min(gate);
        let (mut n, mut sum) = (0_usize, 0.0);
        for r in absolute.iter().filter(|r| **r <= cut) {
            n += 1;
            sum += r * r;
        }
        if n == 0 || scale <= 0.0 {
            break;
        }
        let next = (sum / n as f64 / truncated_variance(cut / scale)).sqrt();
        let change = (next - scale).abs();
        // Never above the median's estimate: that one already errs upwards.
        scale = next.min(1.5 * median / NORMAL_MEDIAN);
        if change <= 1e-6 * scale {
            break;
        }
    }
    scale
}

/// Variance of the standard normal law cut at ±k, `1 - 2 k φ(k) / (2 Φ(k) - 1)`.
fn truncated_variance(k: f64) -> f64 {
    // Below half a standard deviation the residuals are uniform and say nothing about s.
    let k = k.max(0.5);
    let density = (-0.5 * k * k).exp() / (2.0 * std::f64::consts::PI).sqrt();
    1.0 - 2.0 * k * density / normal_probability(k)
}

/// P(|u| ≤ k) of the standard normal law, Simpson's rule on 32 intervals: 1e-7 for k ≤ 2.5.
fn normal_probability(k: f64) -> f64 {
    const N: usize = 32;
    let h = k / N as f64;
    let f = |i: usize| (-0.5 * (i as f64 * h).powi(2)).exp();
    let inner: f64 = (1..N)
        .map(|i| if i % 2 == 1 { 4.0 * f(i) } else { 2.0 * f(i) })
        .sum();
    2.0 * h / 3.0 * (f(0) + inner + f(N)) / (2.0 * std::f64::consts::PI).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [RobustKernel; 3] = [
        RobustKernel::Tukey,
        RobustKernel::GemanMcClure,
        RobustKernel::Squares,
    ];

    #[test]
    fn influence_is_the_slope_of_the_cost_and_curvature_that_of_the_influence() {
        let h = 1e-5;
        for kernel in ALL {
            for i in 0..60 {
                let u = 0.1 * f64::from(i) + 0.03;
                let slope = (kernel.cost(u + h) - kernel.cost(u - h)) / (2.0 * h);
                let influence = |u: f64| u * kernel.weight(u);
                assert!(
                    (slope - influence(u)).abs() < 1e-8,
                    "{kernel:?} at {u}: {slope}"
                );
                let bend = (influence(u + h) - influence(u - h)) / (2.0 * h);
                assert!(
                    (bend - kernel.curvature(u)).abs() < 1e-8,
                    "{kernel:?} at {u}: {bend}"
                );
            }
        }
    }

    #[test]
    fn normal_probability_is_right() {
        for (k, p) in [
            (1.0, 0.682_689_492_137),
            (2.0, 0.954_499_736_104),
            (2.5, 0.987_580_669_348),
        ] {
            assert!((normal_probability(k) - p).abs() < 1e-7, "at {k}");
        }
    }

    /// Quantiles of the normal law by bisection.
    fn normal_residuals(n: usize) -> Vec<f64> {
        (0..n)
            .map(|i| {
                let p = (i as f64 + 0.5) / n as f64;
                let (mut low, mut high) = (0.0, 6.0);
                for _ in 0..50 {
                    let middle = 0.5 * (low + high);
                    if normal_probability(middle) < p {
                        low = middle
                    } else {
                        high = middle
                    }
                }
                low
            })
            .collect()
    }

    #[test]
    fn the_scale_of_normal_residuals_is_their_standard_deviation() {
        for (unit, gate) in [(1e-3, 1.0), (1.0, 100.0), (1e3, 2e3), (1.0, 2.0)] {
            let mut r: Vec<f64> = normal_residuals(2000).iter().map(|u| u * unit).collect();
            r.retain(|r| *r <= gate);
            let scale = robust_scale(&mut r, gate);
            assert!(
                (scale / unit - 1.0).abs() < 0.01,
                "unit {unit}, gate {gate}: {scale}"
            );
        }
    }

    #[test]
    fn a_third_of_outliers_hardly_moves_the_scale() {
        let mut r = normal_residuals(700);
        r.extend((0..300).map(|i| 3.0 + 27.0 * f64::from(i) / 300.0));
        let scale = robust_scale(&mut r, 40.0);
        assert!((0.95..1.15).contains(&scale), "scale {scale}");
    }

    #[test]
    fn empty_and_exact_residuals_have_no_scale() {
        assert!(robust_scale(&mut [], 1.0) <= 0.0, "nothing has no scale");
        assert!(
            robust_scale(&mut [0.0; 9], 1.0) <= 0.0,
            "exact residuals have no scale"
        );
    }
}

//! Ticks at round numbers.

use super::Scale;

/// Range of data on one axis, and how it is drawn.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Axis {
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) scale: Scale,
}

impl Axis {
    /// Around finite values, and around what else must be seen.
    pub(crate) fn around(values: impl IntoIterator<Item = f64>, scale: Scale) -> Self {
        let usable = |v: &f64| v.is_finite() && (scale == Scale::Linear || *v > 0.0);
        let (low, high) = values.into_iter().filter(usable).fold(
            (f64::INFINITY, f64::NEG_INFINITY),
            |(low, high), v| {
                (
                    if v < low { v } else { low },
                    if v > high { v } else { high },
                )
            },
        );
        let (low, high) = if low.is_finite() {
            (low, high)
        } else {
            (0.1, 1.0)
        };
        match scale {
            Scale::Linear => {
                let room = if high > low { 0.06 * (high - low) } else { 0.5 };
                // Zero is an end, not a value to keep away from.
                let low_end = if low >= 0.0 && low < 0.3 * high {
                    0.0
                } else {
                    low - room
                };
                Self {
                    low: low_end,
                    high: high + room,
                    scale,
                }
            }
            Scale::Log => Self {
                low: low / 1.3,
                high: high * 1.3,
                scale,
            },
        }
    }

    /// 0 at the low end, 1 at the high end; what lies outside is brought to the end.
    pub(crate) fn share(&self, value: f64) -> f64 {
        let t = match self.scale {
            Scale::Linear => (value - self.low) / (self.high - self.low),
            Scale::Log => {
                let value = if value > self.low { value } else { self.low };
                (value / self.low).ln() / (self.high / self.low).ln()
            }
        };
        t.clamp(0.0, 1.0)
    }

    /// Places of the ticks and their words.
    pub(crate) fn ticks(&self, wanted: usize) -> Vec<(f64, String)> {
        match self.scale {
            Scale::Linear => self.linear_ticks(wanted),
            Scale::Log => self.log_ticks(),
        }
    }

    fn linear_ticks(&self, wanted: usize) -> Vec<(f64, String)> {
        let raw = (self.high - self.low) / wanted.max(1) as f64;
        let power = 10f64.powf(raw.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .into_iter()
            .map(|m| m * power)
            .find(|step| *step >= raw)
            .unwrap_or(10.0 * power);
        let digits = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
        let first = (self.low / step - 1e-9).ceil() as i64;
        let last = (self.high / step + 1e-9).floor() as i64;
        (first..=last)
            .map(|k| (k as f64 * step, format!("{:.digits$}", k as f64 * step)))
            .map(|(at, words)| (at, words.replace('-', "−")))
            .collect()
    }

    fn log_ticks(&self) -> Vec<(f64, String)> {
        let (first, last) = (
            self.low.log10().floor() as i32,
            self.high.log10().ceil() as i32,
        );
        let decades = last - first;
        let marks: &[f64] = if decades <= 3 {
            &[1.0, 2.0, 5.0]
        } else {
            &[1.0]
        };
        let stride = usize::try_from(decades / 8 + 1).unwrap_or(1);
        (first..=last)
            .step_by(stride)
            .flat_map(|e| marks.iter().map(move |m| m * 10f64.powi(e)))
            .filter(|v| *v >= self.low * 0.999 && *v <= self.high * 1.001)
            .map(|v| (v, short(v)))
            .collect()
    }
}

/// A power of ten or a short decimal.
fn short(v: f64) -> String {
    if (1e-3..1e5).contains(&v) {
        format!("{v}")
    } else {
        format!("{v:.0e}").replace('-', "−")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let axis = Axis::around([-1.3, 4.7], Scale::Linear);
        let words: Vec<String> = axis.ticks(5).into_iter().map(|t| t.1).collect();
        assert_eq!(words, ["0", "2", "4"], "steps of two");
        let axis = Axis::around([0.08, 3.4, f64::NAN, 0.0], Scale::Log);
        let words: Vec<String> = axis.ticks(5).into_iter().map(|t| t.1).collect();
        assert_eq!(
            words,
            ["0.1", "0.2", "0.5", "1", "2"],
            "0 and NaN are left out"
        );
        assert!(axis.share(0.0).abs() < 1e-12, "0 lies at the end");
    }
}

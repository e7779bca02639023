//! Weighted distributions of errors and ratios.
//!
//! ```text
//! mean = Σ w_i x_i / Σ w_i,   share within t = Σ_{x_i ≤ t} w_i / Σ w_i
//! ```

use crate::FmapError;

/// Values with their weights, such as errors at vertices with areas.
///
/// Values may be infinite where two components have no distance; the mean is infinite then.
#[derive(Debug, Clone, PartialEq)]
pub struct Distribution {
    /// The values, in the order of the vertices or edges they belong to.
    pub values: Vec<f64>,
    /// The weight of each: not negative, positive in sum.
    pub weights: Vec<f64>,
    /// Indices of the values from the smallest up.
    ascending: Vec<u32>,
}

impl Distribution {
    /// Takes values and weights.
    ///
    /// # Errors
    /// [`FmapError`] if there is none, their numbers differ, a value is NaN, or a weight is
    /// negative or not finite. Weights that are all 0 count as 1 each.
    pub fn new(values: Vec<f64>, mut weights: Vec<f64>) -> Result<Self, FmapError> {
        if values.is_empty() {
            return Err(FmapError::Empty {
                what: "values of a distribution",
            });
        }
        crate::map::check_size("weights of a distribution", weights.len(), values.len())?;
        let bad = |what, row, value| FmapError::NonFinite {
            what,
            row,
            column: 0,
            value,
        };
        if let Some(i) = values.iter().position(|x| x.is_nan()) {
            return Err(bad("values of a distribution", i, values[i]));
        }
        if let Some(i) = weights.iter().position(|w| !w.is_finite() || *w < 0.0) {
            return Err(bad("weights of a distribution", i, weights[i]));
        }
        if weights.iter().sum::<f64>() <= 0.0 {
            weights.fill(1.0);
        }
        let mut ascending: Vec<u32> = (0..values.len() as u32).collect();
        ascending.sort_by(|&i, &j| values[i as usize].total_cmp(&values[j as usize]));
        Ok(Self {
            values,
            weights,
            ascending,
        })
    }

    /// The weighted mean; infinite if a value with a weight is.
    #[must_use]
    pub fn mean(&self) -> f64 {
        let pairs = self.values.iter().zip(&self.weights);
        let sum: f64 = pairs.filter(|(_, w)| **w > 0.0).map(|(x, w)| x * w).sum();
        sum / self.total()
    }

    /// The value below which half of the weight lies.
    #[must_use]
    pub fn median(&self) -> f64 {
        self.quantile(0.5)
    }

    /// The smallest value up to which at least this share of the weight lies; shares outside
    /// 0 to 1 count as the nearest of the two.
    #[must_use]
    pub fn quantile(&self, share: f64) -> f64 {
        let wanted = share * self.total();
        let mut sum = 0.0;
        let mut last = None;
        for &i in &self.ascending {
            if self.weights[i as usize] > 0.0 {
                sum += self.weights[i as usize];
                last = Some(self.values[i as usize]);
                if sum >= wanted {
                    break;
                }
            }
        }
        // Some weight is positive, so some value was met.
        last.unwrap_or(f64::NAN)
    }

    /// The largest value that has a weight.
    #[must_use]
    pub fn max(&self) -> f64 {
        self.quantile(f64::INFINITY)
    }

    /// Share of the weight with values up to a threshold, 0 to 1.
    #[must_use]
    pub fn share_within(&self, threshold: f64) -> f64 {
        let pairs = self.values.iter().zip(&self.weights);
        let inside: f64 = pairs
            .filter(|(x, _)| **x <= threshold)
            .map(|(_, w)| w)
            .sum();
        inside / self.total()
    }

    /// The cumulative curve: [`Distribution::share_within`] of every threshold.
    #[must_use]
    pub fn curve(&self, thresholds: &[f64]) -> Vec<f64> {
        thresholds.iter().map(|&t| self.share_within(t)).collect()
    }

    fn total(&self) -> f64 {
        self.weights.iter().sum()
    }
}

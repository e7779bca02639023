//! The suites beyond the published one: which cells they have and which scenarios.
//!
//! A scenario is a cell, a draw and a seed. As in [`scenario`](crate::Scenario), everything random
//! in it comes from streams derived from those numbers alone, so any subset, in any order and on
//! any number of threads, gives the same bytes as the whole suite.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::scenario::mix;
use crate::{Deformation, MotionRange, PAPER_NOISE_MM, SensorForm, Stress, SuiteCell};

/// Noise of the targets of [`Suite::Resampled`], standard deviation of every coordinate, mm.
pub const RESAMPLED_NOISE_MM: [f64; 4] = [0.0, 0.5, 1.0, 2.0];
/// Noise of the targets of [`Suite::Motion`], mm.
pub const MOTION_NOISE_MM: [f64; 3] = [0.5, 1.0, 2.0];
/// Range noise of the cameras of [`Suite::Sensor`] at 500 mm, mm.
pub const SENSOR_NOISE_MM: [f64; 3] = [0.3, 0.6, 1.0];
/// Shares of the bone in view that soft tissue covers in [`Suite::Sensor`].
pub const SENSOR_COVER: [f64; 3] = [0.0, 0.2, 0.4];

/// A family of scenarios.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Suite {
    /// The published scenarios.
    Paper,
    /// The same deformations; the target has a triangulation of its own.
    Resampled,
    /// Every disc bends and gives way.
    Motion,
    /// What a depth camera above the open wound sees.
    Sensor,
    /// Much noise, little surface, wrong landmarks, another patient.
    Stress,
}

impl Suite {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Paper,
        Self::Resampled,
        Self::Motion,
        Self::Sensor,
        Self::Stress,
    ];

    /// Its cells, in the order they are reported in.
    #[must_use]
    pub fn cells(self) -> Vec<SuiteCell> {
        let of_all = |noises: &[f64], cell: &dyn Fn(Deformation, f64) -> SuiteCell| {
            Deformation::ALL
                .into_iter()
                .flat_map(|deformation| noises.iter().map(move |&noise| (deformation, noise)))
                .map(|(deformation, noise)| cell(deformation, noise))
                .collect()
        };
        match self {
            Self::Paper => of_all(&PAPER_NOISE_MM, &|deformation, noise_mm| SuiteCell::Paper {
                deformation,
                noise_mm,
            }),
            Self::Resampled => of_all(&RESAMPLED_NOISE_MM, &|deformation, noise_mm| {
                SuiteCell::Resampled {
                    deformation,
                    noise_mm,
                }
            }),
            Self::Motion => MotionRange::ALL
                .into_iter()
                .flat_map(|range| {
                    MOTION_NOISE_MM.map(|noise_mm| SuiteCell::Motion { range, noise_mm })
                })
                .collect(),
            Self::Sensor => sensor_cells(),
            Self::Stress => stress_cells(),
        }
    }
}

impl std::fmt::Display for Suite {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Paper => "paper",
            Self::Resampled => "resampled",
            Self::Motion => "motion",
            Self::Sensor => "sensor",
            Self::Stress => "stress",
        })
    }
}

fn sensor_cells() -> Vec<SuiteCell> {
    let mut cells = Vec::new();
    for form in SensorForm::ALL {
        for cover in SENSOR_COVER {
            cells.extend(SENSOR_NOISE_MM.map(|noise_mm| SuiteCell::Sensor {
                form,
                cover,
                noise_mm,
            }));
        }
    }
    cells
}

fn stress_cells() -> Vec<SuiteCell> {
    let noises = |stress: Stress| -> &[f64] {
        match stress {
            Stress::Whole | Stress::Partial => &[2.0, 3.0],
            Stress::NoLandmark => &[0.0, 0.5],
            Stress::OtherPatient => &[0.5, 2.0, 3.0],
            _ => &[0.5],
        }
    };
    Stress::ALL
        .into_iter()
        .flat_map(|stress| {
            let cell = move |&noise_mm: &f64| SuiteCell::Stress { stress, noise_mm };
            noises(stress).iter().map(cell)
        })
        .collect()
}

/// One simulated case of any suite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SuiteScenario {
    /// What it has in common with the other draws.
    pub cell: SuiteCell,
    /// Number of the draw, from 0.
    pub draw: u32,
    /// Seed of the suite.
    pub seed: u64,
}

impl std::fmt::Display for SuiteScenario {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, draw {}", self.cell, self.draw)
    }
}

/// The scenarios of a suite, cells outermost and draws innermost.
#[must_use]
pub fn suite_scenarios(suite: Suite, seed: u64, n_draws: u32) -> Vec<SuiteScenario> {
    suite
        .cells()
        .into_iter()
        .flat_map(|cell| (0..n_draws).map(move |draw| SuiteScenario { cell, draw, seed }))
        .collect()
}

/// The seed of one subject of a cohort: of its shape and of its scenarios. Cohorts of different
/// seeds share no subject.
#[must_use]
pub fn subject_seed(cohort_seed: u64, subject: u32) -> u64 {
    [COHORT_SALT, cohort_seed, u64::from(subject)]
        .into_iter()
        .fold(0, |key, word| mix(key ^ word))
}

/// Sets the seeds of subjects apart from every other number.
const COHORT_SALT: u64 = 0x636f_686f_7274_0001;

/// What a stream of random numbers is for. A change in one leaves the others as they are.
#[derive(Debug, Clone, Copy)]
pub(crate) enum SuiteStream {
    Placement = 1,
    Landmarks,
    Cut,
    Noise,
    Order,
    Resampling,
    Bends,
    Faults,
    Camera,
    SoftTissue,
    Pixels,
    Patient,
}

/// Sets the streams of the suites apart from those of the published one.
const SALT: u64 = 0x7375_6974_6573_0001;

impl SuiteScenario {
    /// A number that no other scenario has.
    pub(crate) fn key(&self) -> u64 {
        let words = [SALT, self.seed, u64::from(self.draw)];
        words
            .into_iter()
            .chain(self.cell.words())
            .fold(0, |key, word| mix(key ^ word))
    }

    /// The generator of one of the scenario's streams.
    pub(crate) fn rng(&self, stream: SuiteStream) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::seed_from_u64(self.key());
        rng.set_stream(stream as u64);
        rng
    }
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::*;

    #[test]
    fn every_scenario_and_stream_has_its_own_numbers() {
        let mut first: Vec<u64> = Vec::new();
        for suite in Suite::ALL {
            for scenario in suite_scenarios(suite, 7, 5) {
                for stream in [
                    SuiteStream::Placement,
                    SuiteStream::Noise,
                    SuiteStream::Pixels,
                ] {
                    first.push(scenario.rng(stream).next_u64());
                }
            }
        }
        let n = first.len();
        first.sort_unstable();
        first.dedup();
        assert_eq!(first.len(), n, "two streams start alike");
    }
}

//! Which suites are run, and on which spines.

use std::path::Path;

use clap::ValueEnum;
use pedicle_simulation::{CameraNoise, Suite, subject_seed};

use super::case::{self, Case, Given};
use crate::XtaskError;

/// What `--suite` names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum SuiteChoice {
    /// Rigid, non-rigid and partial targets with noise of 0, 0.5 and 1 mm, as published.
    Paper,
    /// The same, with noise up to 2 mm, and a triangulation of its own for every target.
    Resampled,
    /// Motion in every disc: within physiological limits, up to 15° and up to 25° a level.
    Motion,
    /// What a depth camera above the open wound sees.
    Sensor,
    /// Much noise, little surface, wrong landmarks, missing levels, another patient.
    Stress,
    /// All of them, one after the other.
    All,
}

impl SuiteChoice {
    pub(super) fn suites(self) -> Vec<Suite> {
        match self {
            Self::Paper => vec![Suite::Paper],
            Self::Resampled => vec![Suite::Resampled],
            Self::Motion => vec![Suite::Motion],
            Self::Sensor => vec![Suite::Sensor],
            Self::Stress => vec![Suite::Stress],
            Self::All => Suite::ALL.to_vec(),
        }
    }
}

/// What `--camera-noise` names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum CameraNoiseChoice {
    /// Larger where the surface is steep, independent from pixel to pixel, as in the suite.
    Grazing,
    /// The same along every ray.
    Even,
    /// Larger where the surface is steep; neighbouring pixels err alike.
    Smooth,
    /// The same over more pixels.
    Broad,
}

impl CameraNoiseChoice {
    pub(super) fn law(self) -> CameraNoise {
        match self {
            Self::Grazing => CameraNoise::Grazing,
            Self::Even => CameraNoise::Even,
            Self::Smooth => CameraNoise::Smooth,
            Self::Broad => CameraNoise::Broad,
        }
    }
}

/// Where one spine comes from.
pub(super) enum Spine<'a> {
    /// Files.
    Files {
        path: &'a Path,
        given: Given<'a>,
        seed: u64,
    },
    /// A person of a cohort, with the seed of its shape and of its scenarios.
    Subject { name: String, seed: u64 },
}

impl Spine<'_> {
    /// The persons of a cohort.
    pub(super) fn cohort(seed: u64, n_subjects: u32) -> Vec<Self> {
        (0..n_subjects)
            .map(|subject| Self::Subject {
                name: format!("subject {}", subject + 1),
                seed: subject_seed(seed, subject),
            })
            .collect()
    }

    /// The seed of its scenarios.
    pub(super) fn seed(&self) -> u64 {
        match self {
            Self::Files { seed, .. } | Self::Subject { seed, .. } => *seed,
        }
    }

    pub(super) fn load(&self) -> Result<Case, XtaskError> {
        match self {
            Self::Files { path, given, .. } => case::load(path, given),
            Self::Subject { name, seed } => case::subject(name.clone(), *seed),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn people_used_for_tuning_are_never_reported() {
        let seeds = |seed| {
            Spine::cohort(seed, 50)
                .iter()
                .map(Spine::seed)
                .collect::<Vec<_>>()
        };
        let reported = seeds(20_260_101);
        for tuning in [0, 1, 999] {
            let tuned = seeds(tuning);
            assert!(
                tuned.iter().all(|seed| !reported.contains(seed)),
                "{tuning}"
            );
        }
        assert_eq!(
            reported[..20],
            seeds(20_260_101)[..20],
            "the same people again"
        );
        assert_eq!(SuiteChoice::All.suites().len(), 5, "every suite");
    }
}

//! Whether the transfer of a vertebra can be vouched for, and if not, why.

use nalgebra::Isometry3;
use pedicle_trajectory::Level;

use crate::VerdictOptions;

/// One reason not to vouch for a vertebra. Its text is a sentence for the user.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
#[allow(
    missing_docs,
    reason = "fields are the numbers of the sentence of the variant"
)]
pub enum Rejection {
    /// Nothing could be fitted.
    NoFit { n_points: usize },
    /// Too few target points lie on the vertebra.
    TooFewPoints { n_points: usize, min: usize },
    /// Too little of its posterior surface is seen.
    TooLittleSeen { share: f64, min: f64 },
    /// Too many of its points do not lie on its surface.
    PoorFit { explained_share: f64, min: f64 },
    /// The target is too noisy.
    Noisy { noise_mm: f64, max_mm: f64 },
    /// The surface seen does not fix its position.
    PositionUncertain { std_mm: f64, max_mm: f64 },
    /// The surface seen does not fix its orientation.
    OrientationUncertain { std_rad: f64, max_rad: f64 },
    /// Another pose explains the target nearly as well.
    Ambiguous { margin: f64, min: f64 },
    /// It is turned against its neighbour farther than a spine allows.
    TurnedAgainstNeighbour {
        neighbour: Level,
        turn_rad: f64,
        max_rad: f64,
    },
    /// It lies far from where the user put its landmark.
    FarFromLandmark { distance_mm: f64, max_mm: f64 },
}

impl std::fmt::Display for Rejection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NoFit { n_points } => {
                write!(
                    f,
                    "no fit was possible: {n_points} target points near the vertebra"
                )
            }
            Self::TooFewPoints { n_points, min } => {
                write!(
                    f,
                    "too few target points on the vertebra ({n_points}, at least {min} needed)"
                )
            }
            Self::TooLittleSeen { share, min } => write!(
                f,
                "too little surface seen ({:.0} % of the posterior side, at least {:.0} % needed)",
                100.0 * share,
                100.0 * min
            ),
            Self::PoorFit {
                explained_share,
                min,
            } => write!(
                f,
                "the surface does not fit ({:.0} % of the points explained, at least {:.0} % needed)",
                100.0 * explained_share,
                100.0 * min
            ),
            Self::Noisy { noise_mm, max_mm } => {
                write!(
                    f,
                    "the target is too noisy ({noise_mm:.2} mm, at most {max_mm:.2} mm)"
                )
            }
            Self::PositionUncertain { std_mm, max_mm } => write!(
                f,
                "the surface seen does not fix the position (± {std_mm:.2} mm, at most {max_mm:.2} mm)"
            ),
            Self::OrientationUncertain { std_rad, max_rad } => write!(
                f,
                "the surface seen does not fix the orientation (± {:.1}°, at most {:.1}°)",
                std_rad.to_degrees(),
                max_rad.to_degrees()
            ),
            Self::Ambiguous { margin, min } => write!(
                f,
                "another pose fits nearly as well ({:.0} % worse, at least {:.0} % needed)",
                100.0 * margin,
                100.0 * min
            ),
            Self::TurnedAgainstNeighbour {
                neighbour,
                turn_rad,
                max_rad,
            } => write!(
                f,
                "turned by {:.0}° against {neighbour} compared with the plan (at most {:.0}°)",
                turn_rad.to_degrees(),
                max_rad.to_degrees()
            ),
            Self::FarFromLandmark {
                distance_mm,
                max_mm,
            } => write!(
                f,
                "{distance_mm:.1} mm from its landmark (at most {max_mm:.0} mm): check the landmarks"
            ),
        }
    }
}

/// The figures that the verdict on one vertebra rests on.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Evidence {
    pub(crate) n_points: usize,
    pub(crate) posterior_coverage: f64,
    pub(crate) explained_share: f64,
    pub(crate) noise_mm: f64,
    /// Standard deviations of position and orientation; none if there is no fit.
    pub(crate) std_mm_rad: Option<(f64, f64)>,
    pub(crate) alternative_margin: f64,
    pub(crate) landmark_distance_mm: f64,
}

/// Every reason not to accept.
pub(crate) fn rejections(evidence: &Evidence, options: &VerdictOptions) -> Vec<Rejection> {
    let Some((std_mm, std_rad)) = evidence.std_mm_rad else {
        return vec![Rejection::NoFit {
            n_points: evidence.n_points,
        }];
    };
    let mut found = Vec::new();
    // Each test asks for what is wanted, so that a NaN is never accepted.
    let mut demand = |holds: bool, reason: Rejection| {
        if !holds {
            found.push(reason);
        }
    };
    demand(
        evidence.n_points >= options.min_points,
        Rejection::TooFewPoints {
            n_points: evidence.n_points,
            min: options.min_points,
        },
    );
    demand(
        evidence.posterior_coverage >= options.min_posterior_coverage,
        Rejection::TooLittleSeen {
            share: evidence.posterior_coverage,
            min: options.min_posterior_coverage,
        },
    );
    demand(
        evidence.explained_share >= options.min_explained_share,
        Rejection::PoorFit {
            explained_share: evidence.explained_share,
            min: options.min_explained_share,
        },
    );
    demand(
        evidence.noise_mm <= options.max_noise_mm,
        Rejection::Noisy {
            noise_mm: evidence.noise_mm,
            max_mm: options.max_noise_mm,
        },
    );
    demand(
        std_mm <= options.max_translation_std_mm,
        Rejection::PositionUncertain {
            std_mm,
            max_mm: options.max_translation_std_mm,
        },
    );
    demand(
        std_rad <= options.max_rotation_std_rad,
        Rejection::OrientationUncertain {
            std_rad,
            max_rad: options.max_rotation_std_rad,
        },
    );
    demand(
        evidence.alternative_margin >= options.min_alternative_margin,
        Rejection::Ambiguous {
            margin: evidence.alternative_margin,
            min: options.min_alternative_margin,
        },
    );
    demand(
        evidence.landmark_distance_mm <= options.max_landmark_distance_mm,
        Rejection::FarFromLandmark {
            distance_mm: evidence.landmark_distance_mm,
            max_mm: options.max_landmark_distance_mm,
        },
    );
    found
}

/// A vertebra turned too far against its neighbour, both `target_from_source`.
pub(crate) fn chain_rejection(
    own: &Isometry3<f64>,
    other: &Isometry3<f64>,
    neighbour: Level,
    options: &VerdictOptions,
) -> Option<Rejection> {
    let turn_rad = (own.rotation.inverse() * other.rotation).angle();
    let max_rad = options.max_neighbour_turn_rad;
    (turn_rad > max_rad).then_some(Rejection::TurnedAgainstNeighbour {
        neighbour,
        turn_rad,
        max_rad,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Makes one figure of good evidence bad.
    type Spoil = Box<dyn Fn(&mut Evidence)>;

    fn good() -> Evidence {
        Evidence {
            n_points: 300,
            posterior_coverage: 0.9,
            explained_share: 0.98,
            noise_mm: 0.5,
            std_mm_rad: Some((0.1, 0.003)),
            alternative_margin: 0.4,
            landmark_distance_mm: 4.0,
        }
    }

    #[test]
    fn a_turn_beyond_the_limit_names_the_neighbour() {
        let options = VerdictOptions::default();
        let turned = |angle| Isometry3::rotation(nalgebra::Vector3::new(0.0, angle, 0.0));
        let judge =
            |angle| chain_rejection(&turned(0.2), &turned(0.2 + angle), Level::L2, &options);
        assert_eq!(judge(0.5), None, "within the limit");
        let reason = judge(1.0).expect("57° is too much").to_string();
        assert!(reason.contains("57°") && reason.contains("L2"), "{reason}");
    }

    #[test]
    fn good_evidence_is_accepted() {
        assert_eq!(rejections(&good(), &VerdictOptions::default()), vec![]);
    }

    #[test]
    fn each_figure_alone_rejects_with_its_own_reason() {
        let cases: Vec<(&str, Spoil)> = vec![
            ("too few target points", Box::new(|e| e.n_points = 10)),
            (
                "too little surface seen (12 %",
                Box::new(|e| e.posterior_coverage = 0.12),
            ),
            ("does not fit", Box::new(|e| e.explained_share = 0.5)),
            ("too noisy", Box::new(|e| e.noise_mm = 5.0)),
            (
                "fix the position",
                Box::new(|e| e.std_mm_rad = Some((2.0, 0.003))),
            ),
            (
                "fix the orientation",
                Box::new(|e| e.std_mm_rad = Some((0.1, 0.3))),
            ),
            ("another pose", Box::new(|e| e.alternative_margin = 0.01)),
            (
                "from its landmark",
                Box::new(|e| e.landmark_distance_mm = 40.0),
            ),
            ("no fit", Box::new(|e| e.std_mm_rad = None)),
            (
                "fix the position",
                Box::new(|e| e.std_mm_rad = Some((f64::NAN, 0.003))),
            ),
        ];
        for (words, spoil) in cases {
            let mut evidence = good();
            spoil(&mut evidence);
            let found = rejections(&evidence, &VerdictOptions::default());
            assert_eq!(found.len(), 1, "{words}: {found:?}");
            assert!(
                found[0].to_string().contains(words),
                "'{}' has no '{words}'",
                found[0]
            );
        }
    }
}

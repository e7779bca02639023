//! The reasons not to vouch for a vertebra, in words that a user can act on.

use pedicle_trajectory::Level;

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
    /// A camera saw too little of it bare: soft tissue may lie like bone.
    TooLittleBare { area_mm2: f64, min_mm2: f64 },
    /// The points of a camera lie too far apart to tell bone from soft tissue.
    TooSparse,
    /// Noise hides its bumps, and its points do not tell its shape otherwise.
    ShapeUnknown { n_points: usize },
    /// Too many of its points do not lie on its surface.
    PoorFit { explained_share: f64, min: f64 },
    /// The target is too noisy.
    Noisy {
        noise_mm: f64,
        max_mm: f64,
        /// So many pixels of the camera tell as much as one; 1 where they err independently.
        n_alike: f64,
    },
    /// The surface seen does not fix its position.
    PositionUncertain { std_mm: f64, max_mm: f64 },
    /// The surface seen does not fix its orientation.
    OrientationUncertain { std_rad: f64, max_rad: f64 },
    /// Another pose explains the target nearly as well.
    Ambiguous { margin: f64, min: f64 },
    /// The surface seen does not fix where a planned screw goes.
    ScrewUncertain { std_mm: f64, max_mm: f64 },
    /// A planned screw has too little room for this uncertainty.
    BreachLikely { probability: f64, max: f64 },
    /// Its points are noisier than those of the other vertebrae: it may be another vertebra.
    NoisierThanOthers { noise_mm: f64, others_mm: f64 },
    /// Its points lie farther from its surface than the sensor errs: some of them are not bone.
    NoisierThanSensor {
        noise_mm: f64,
        max_mm: f64,
        sensor_mm: f64,
    },
    /// A part of the target belongs to no vertebra: the levels may be shifted.
    UnexplainedSurface { share: f64, max: f64 },
    /// With all levels shifted by one the target is explained as well.
    LevelAmbiguous { margin: f64, min: f64 },
    /// It is nearer to or farther from its neighbour than a spine allows.
    SpacedWrongly {
        neighbour: Level,
        distance_mm: f64,
        expected_mm: f64,
    },
    /// It is turned against its neighbour farther than a spine allows.
    TurnedAgainstNeighbour {
        neighbour: Level,
        turn_rad: f64,
        max_rad: f64,
    },
    /// Neighbouring points are off in the same direction: the bone has another shape.
    ShapeDiffers { misfit_mm: f64, patch_mm: f64 },
    /// The shapes of all vertebrae that are trusted otherwise differ together.
    SpineDiffers { misfit_mm: f64, patch_mm: f64 },
    /// All bones together look more like another person's than like the plan's: logarithm of the Bayes factor, and
    /// by how much they are larger along their left, anterior and up axes.
    BonesDiffer {
        log_bayes_factor: f64,
        larger: [f64; 3],
    },
    /// Points too few or too noisy to tell whose bones they are.
    ShapeNotTold { log_bayes_factor: f64, max: f64 },
    /// One bone has another shape than the plan's, or is not where it was put.
    BoneDiffers { log_bayes_factor: f64, max: f64 },
    /// The camera saw through where the bone would be.
    SeenThrough { share: f64, max: f64 },
    /// The camera saw points behind the bone, which would hide them.
    BehindBone { share: f64, max: f64 },
    /// The same of the bones of the whole spine.
    BehindSpine { share: f64, max: f64 },
    /// Most other vertebrae before a camera do not fit what it saw.
    OthersDiffer { n_differ: usize, n_others: usize },
    /// Too much of what lies close to the bone lies a little in front of it.
    Hidden { share: f64, max: f64 },
    /// It lies far from where the user put its landmark.
    FarFromLandmark { distance_mm: f64, max_mm: f64 },
}

impl Rejection {
    /// Whether this says that the points are another bone's, or none's.
    pub(crate) fn is_about_shape(&self) -> bool {
        matches!(
            self,
            Self::NoisierThanOthers { .. }
                | Self::NoisierThanSensor { .. }
                | Self::ShapeDiffers { .. }
                | Self::SeenThrough { .. }
                | Self::BehindBone { .. }
        )
    }

    /// Whether this says how well the pose is known, and nothing against it.
    pub(crate) fn is_about_precision(&self) -> bool {
        matches!(
            self,
            Self::Noisy { .. }
                | Self::PositionUncertain { .. }
                | Self::OrientationUncertain { .. }
                | Self::ScrewUncertain { .. }
                | Self::BreachLikely { .. }
        )
    }
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
            Self::TooSparse => write!(
                f,
                "the camera's points lie too far apart to tell bone from soft tissue: measure more densely"
            ),
            Self::ShapeUnknown { n_points } => write!(
                f,
                "{n_points} points do not tell at this noise whose bone it is: show more of it, or less noisily"
            ),
            Self::TooLittleBare { area_mm2, min_mm2 } => write!(
                f,
                "too little bare bone seen ({area_mm2:.0} mm², at least {min_mm2:.0} mm² needed): clean it"
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
            Self::Noisy {
                noise_mm,
                max_mm,
                n_alike,
            } => {
                write!(
                    f,
                    "the target is too noisy ({noise_mm:.2} mm, at most {max_mm:.2} mm)"
                )?;
                if *n_alike > 1.0 {
                    write!(
                        f,
                        ": {n_alike:.0} pixels tell as much as one, for neighbours err alike: give the points unfiltered"
                    )?;
                }
                Ok(())
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
            Self::ScrewUncertain { std_mm, max_mm } => write!(
                f,
                "the surface seen does not fix where a screw goes (± {std_mm:.2} mm, at most {max_mm:.2} mm)"
            ),
            Self::BreachLikely { probability, max } => write!(
                f,
                "a planned screw breaches the cortex with a probability of {:.2} % (at most {:.2} %)",
                100.0 * probability,
                100.0 * max
            ),
            Self::NoisierThanOthers {
                noise_mm,
                others_mm,
            } => write!(
                f,
                "its points are noisier than those of the other vertebrae ({noise_mm:.2} mm against \
                 {others_mm:.2} mm): it may be another vertebra"
            ),
            Self::NoisierThanSensor {
                noise_mm,
                max_mm,
                sensor_mm,
            } => write!(
                f,
                "its points lie {noise_mm:.2} mm off its surface (at most {max_mm:.2} mm), but the sensor errs by \
                 {sensor_mm:.2} mm only: soft tissue may have been taken for bone"
            ),
            Self::UnexplainedSurface { share, max } => write!(
                f,
                "{:.0} % of the target belong to no vertebra of the plan (at most {:.0} %): check the \
                 levels of the landmarks",
                100.0 * share,
                100.0 * max
            ),
            Self::LevelAmbiguous { margin, min } => write!(
                f,
                "all levels shifted by one fit nearly as well ({:.0} % worse, at least {:.0} % needed): \
                 check the levels of the landmarks",
                100.0 * margin,
                100.0 * min
            ),
            Self::SpacedWrongly {
                neighbour,
                distance_mm,
                expected_mm,
            } => write!(
                f,
                "{distance_mm:.0} mm from {neighbour}, in the plan {expected_mm:.0} mm"
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
            Self::ShapeDiffers {
                misfit_mm,
                patch_mm,
            } => write!(
                f,
                "the shape differs from the plan's by {misfit_mm:.2} mm over patches of {patch_mm:.0} mm: \
                 is this the right patient and level, and is it bare bone?"
            ),
            Self::SpineDiffers {
                misfit_mm,
                patch_mm,
            } => write!(
                f,
                "the shapes of all vertebrae together differ from the plan's by {misfit_mm:.2} mm over \
                 patches of {patch_mm:.0} mm: is this the right patient?"
            ),
            Self::BonesDiffer {
                log_bayes_factor,
                larger,
            } => write!(
                f,
                "what is seen is {} times likelier of another person's bones than of the plan's ({:+.1} % to the side, \
                 {:+.1} % in depth, {:+.1} % in height): is this the right patient?",
                times(*log_bayes_factor),
                100.0 * larger[0],
                100.0 * larger[1],
                100.0 * larger[2]
            ),
            Self::ShapeNotTold {
                log_bayes_factor,
                max,
            } => write!(
                f,
                "what is seen is only {} times likelier of the plan's bones than of another person's ({} times needed): \
                 show more of them, or less noisily, and is this the right patient?",
                times(-log_bayes_factor),
                times(-max)
            ),
            Self::BoneDiffers {
                log_bayes_factor,
                max,
            } => write!(
                f,
                "what is seen of the bone is {} times likelier of another one (at most {} times): is this the right \
                 patient and level?",
                times(*log_bayes_factor),
                times(*max)
            ),
            Self::SeenThrough { share, max } => write!(
                f,
                "the camera saw through {:.0} % of where the bone would be (at most {:.0} %)",
                100.0 * share,
                100.0 * max
            ),
            Self::BehindBone { share, max } => write!(
                f,
                "{:.2} % of what was measured on the bone lies behind it (at most {:.2} %): is this the right level?",
                100.0 * share,
                100.0 * max
            ),
            Self::BehindSpine { share, max } => write!(
                f,
                "of most vertebrae {:.2} % and more of what was measured on them lies behind them (at most {:.2} %): \
                 is this the right patient?",
                100.0 * share,
                100.0 * max
            ),
            Self::OthersDiffer { n_differ, n_others } => write!(
                f,
                "{n_differ} of the other {n_others} vertebrae do not fit what the camera saw: is this the right patient?"
            ),
            Self::Hidden { share, max } => write!(
                f,
                "{:.0} % of what was measured close to the bone lies in front of it (at most {:.0} %): \
                 clean it",
                100.0 * share,
                100.0 * max
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

/// How many times likelier a natural logarithm says, in a word.
fn times(logarithm: f64) -> String {
    let times = logarithm.exp();
    if times < 10.0 {
        format!("{times:.1}")
    } else if times < 10_000.0 {
        format!("{times:.0}")
    } else {
        "thousands of".to_owned()
    }
}

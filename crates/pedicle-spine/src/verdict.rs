//! Whether the transfer of a vertebra can be vouched for, and if not, why.

use nalgebra::{Isometry3, Point3};
use pedicle_trajectory::Level;

use crate::VerdictOptions;
use crate::finish::TELLS_TISSUE_MM;
use crate::misfit::{Misfit, PATCH_MM};
use crate::rejection::Rejection;

/// The figures that the verdict on one vertebra rests on.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Evidence {
    pub(crate) n_points: usize,
    pub(crate) posterior_coverage: f64,
    pub(crate) explained_share: f64,
    pub(crate) noise_mm: f64,
    /// Median noise of all vertebrae.
    pub(crate) others_noise_mm: f64,
    /// The same of a whole target; of a frame the vertebra's own, for those that are lost fit to anything.
    pub(crate) target_noise_mm: f64,
    /// Noise of the second quietest of the other vertebrae.
    pub(crate) quiet_noise_mm: f64,
    /// Whether a camera is known that saw the points.
    pub(crate) is_from_camera: bool,
    /// Whether its points are weighed by what they probably are. Those of a tracker are not.
    pub(crate) tells_tissue: bool,
    /// Standard deviations; none if there is no fit.
    pub(crate) deviations: Option<Deviations>,
    pub(crate) unexplained_share: f64,
    pub(crate) level_margin: f64,
    /// Whether the names of the landmarks agree with the levels found.
    pub(crate) landmarks_support_levels: bool,
    pub(crate) alternative_margin: f64,
    /// None without a landmark.
    pub(crate) landmark_distance_mm: Option<f64>,
    pub(crate) misfit: Misfit,
    /// Share of the bone that the camera saw through.
    pub(crate) seen_through: f64,
    /// Of the points close to it the share in front of it.
    pub(crate) hidden_share: f64,
    /// Noise of the target estimated from it alone.
    pub(crate) sensor_noise_mm: Option<f64>,
    /// Area of the bare bone that a camera saw, mm²; none without a camera, and where its points lie too far apart.
    pub(crate) bare_area_mm2: Option<f64>,
}

/// Standard deviations of a pose in the worst direction: of the vertebra's centroid, of its
/// orientation, and of the worst end of a planned screw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Deviations {
    pub(crate) position_mm: f64,
    pub(crate) orientation_rad: f64,
    pub(crate) screw_mm: f64,
    /// Largest probability that a screw breaches the cortex.
    pub(crate) breach_probability: f64,
}

/// Vertebrae this much noisier than the median may be other vertebrae: a wrong level fits to
/// about one and a half to three times the noise of the right one.
const MAX_NOISE_RATIO: f64 = 1.35;
/// And at least this much, mm: without noise the ratio means nothing.
const MIN_NOISE_EXCESS_MM: f64 = 0.15;

/// The noise of one bone of a target at the limit may be larger by this factor.
const MAX_OWN_NOISE_RATIO: f64 = 1.1;

/// Right poses fit to 0.8 to 1.1 of the noise of the sensor, wrong ones among tissue to 1.05 and more.
const MAX_SENSOR_RATIO: f64 = 1.15;
/// Where bone is told from tissue by patches, right poses fit to 0.85 to 1.05 of it, some of the wrong ones to 1.09.
const MAX_TOLD_RATIO: f64 = 1.08;
/// The estimate from patches may be too low by this factor, as the quieter bones of the spine show: at a noise of 0.8 to
/// 1 mm it is by 8 to 12 %.
const MAX_QUIET_RATIO: f64 = 1.15;
/// What the steps of the sensor add to its noise, mm.
const SENSOR_FLOOR_MM: f64 = 0.03;

/// Noise of the sensor as its points and the quieter bones show it: tissue makes single bones noisier, and a patch of
/// few noisy points is smoother than the bone.
fn sensor_shown_mm(sensor_mm: f64, quiet_noise_mm: f64) -> f64 {
    let most_mm = MAX_QUIET_RATIO * sensor_mm;
    if quiet_noise_mm > most_mm {
        most_mm
    } else if quiet_noise_mm > sensor_mm {
        quiet_noise_mm
    } else {
        sensor_mm
    }
}

/// The second smallest of some noises; NaN of fewer than two.
pub(crate) fn second_smallest(mut noises_mm: Vec<f64>) -> f64 {
    noises_mm.retain(|x| !x.is_nan());
    noises_mm.sort_by(f64::total_cmp);
    noises_mm.get(1).copied().unwrap_or(f64::NAN)
}

/// Every reason not to accept.
pub(crate) fn rejections(evidence: &Evidence, options: &VerdictOptions) -> Vec<Rejection> {
    let Some(deviations) = evidence.deviations else {
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
    let max_noise_mm = if evidence.is_from_camera {
        options.max_noise_of_camera_mm
    } else {
        options.max_noise_mm
    };
    // One bone of a noisy target may fit by chance as if it were not.
    let own_mm = evidence.noise_mm / MAX_OWN_NOISE_RATIO;
    let noise_mm = if evidence.target_noise_mm > own_mm {
        evidence.target_noise_mm
    } else {
        own_mm
    };
    demand(
        noise_mm <= max_noise_mm,
        Rejection::Noisy {
            noise_mm,
            max_mm: max_noise_mm,
        },
    );
    let Deviations {
        position_mm: std_mm,
        orientation_rad: std_rad,
        screw_mm,
        breach_probability,
    } = deviations;
    let others_mm = evidence.others_noise_mm;
    demand(
        evidence.noise_mm <= MAX_NOISE_RATIO * others_mm
            || evidence.noise_mm <= others_mm + MIN_NOISE_EXCESS_MM,
        Rejection::NoisierThanOthers {
            noise_mm: evidence.noise_mm,
            others_mm,
        },
    );
    demand(
        evidence.unexplained_share <= options.max_unexplained_share,
        Rejection::UnexplainedSurface {
            share: evidence.unexplained_share,
            max: options.max_unexplained_share,
        },
    );
    let min_level_margin = if evidence.landmarks_support_levels {
        options.min_level_margin_with_landmarks
    } else {
        options.min_level_margin
    };
    demand(
        evidence.level_margin >= min_level_margin,
        Rejection::LevelAmbiguous {
            margin: evidence.level_margin,
            min: min_level_margin,
        },
    );
    demand(
        screw_mm <= options.max_screw_std_mm,
        Rejection::ScrewUncertain {
            std_mm: screw_mm,
            max_mm: options.max_screw_std_mm,
        },
    );
    demand(
        breach_probability <= options.max_breach_probability,
        Rejection::BreachLikely {
            probability: breach_probability,
            max: options.max_breach_probability,
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
    let min_margin = if evidence.is_from_camera {
        options.min_alternative_margin_of_camera
    } else {
        options.min_alternative_margin
    };
    demand(
        evidence.alternative_margin >= min_margin,
        Rejection::Ambiguous {
            margin: evidence.alternative_margin,
            min: min_margin,
        },
    );
    if evidence.is_from_camera {
        match evidence.bare_area_mm2 {
            Some(area_mm2) => demand(
                area_mm2 >= options.min_bare_area_mm2,
                Rejection::TooLittleBare {
                    area_mm2,
                    min_mm2: options.min_bare_area_mm2,
                },
            ),
            None => demand(false, Rejection::TooSparse),
        }
    }
    let misfit = evidence.misfit;
    if let Some(sensor_mm) = evidence.sensor_noise_mm {
        let is_told = evidence.tells_tissue && sensor_mm <= TELLS_TISSUE_MM;
        let shown_mm = sensor_shown_mm(sensor_mm, evidence.quiet_noise_mm);
        let most_mm = if is_told {
            MAX_TOLD_RATIO * shown_mm
        } else {
            MAX_SENSOR_RATIO * shown_mm + SENSOR_FLOOR_MM
        };
        demand(
            evidence.noise_mm <= most_mm,
            Rejection::NoisierThanSensor {
                noise_mm: evidence.noise_mm,
                sensor_mm,
            },
        );
    }
    let max_misfit_mm = match evidence.sensor_noise_mm {
        Some(_) => options.max_misfit_of_sensor_mm,
        None => options.max_misfit_mm,
    };
    demand(
        misfit.beyond_noise_mm2(options.misfit_in_sigma) <= max_misfit_mm * max_misfit_mm,
        Rejection::ShapeDiffers {
            misfit_mm: misfit.depth_mm(),
            patch_mm: PATCH_MM,
        },
    );
    demand(
        evidence.seen_through <= options.max_seen_through,
        Rejection::SeenThrough {
            share: evidence.seen_through,
            max: options.max_seen_through,
        },
    );
    demand(
        evidence.hidden_share <= options.max_hidden_share,
        Rejection::Hidden {
            share: evidence.hidden_share,
            max: options.max_hidden_share,
        },
    );
    if let Some(distance_mm) = evidence.landmark_distance_mm {
        demand(
            distance_mm <= options.max_landmark_distance_mm,
            Rejection::FarFromLandmark {
                distance_mm,
                max_mm: options.max_landmark_distance_mm,
            },
        );
    }
    found
}

/// What the shapes of all vertebrae that are trusted otherwise say together: bumps that noise hides on
/// one bone show on five.
pub(crate) fn pooled_rejection(misfits: &[Misfit], options: &VerdictOptions) -> Option<Rejection> {
    if misfits.is_empty() {
        return None;
    }
    let pooled = Misfit::pooled(misfits);
    let holds = pooled.beyond_noise_mm2(options.pooled_misfit_in_sigma)
        <= options.max_misfit_mm * options.max_misfit_mm;
    (!holds).then(|| Rejection::SpineDiffers {
        misfit_mm: pooled.depth_mm(),
        patch_mm: PATCH_MM,
    })
}

/// What the chain says of a vertebra and a neighbour that are both trusted otherwise: each as
/// `target_from_source` and its centroid in the source.
pub(crate) fn chain_rejections(
    own: (&Isometry3<f64>, &Point3<f64>),
    other: (&Isometry3<f64>, &Point3<f64>),
    neighbour: Level,
    options: &VerdictOptions,
) -> Vec<Rejection> {
    let mut found = Vec::new();
    let turn_rad = (own.0.rotation.inverse() * other.0.rotation).angle();
    let max_rad = options.max_neighbour_turn_rad;
    if turn_rad > max_rad {
        found.push(Rejection::TurnedAgainstNeighbour {
            neighbour,
            turn_rad,
            max_rad,
        });
    }
    let expected_mm = (own.1 - other.1).norm();
    let distance_mm = (own.0 * own.1 - other.0 * other.1).norm();
    if (distance_mm - expected_mm).abs() > options.max_neighbour_shift_mm {
        found.push(Rejection::SpacedWrongly {
            neighbour,
            distance_mm,
            expected_mm,
        });
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Makes one figure of good evidence bad.
    type Spoil = Box<dyn Fn(&mut Evidence)>;

    const GOOD: Deviations = Deviations {
        position_mm: 0.1,
        orientation_rad: 0.003,
        screw_mm: 0.2,
        breach_probability: 1e-6,
    };

    const NOISE_ONLY: Misfit = Misfit {
        covariance_mm2: 0.002,
        by_noise_mm2: 0.001,
        deviation_mm2: 0.005,
        pairs_over_variance: 1.0,
        n_pairs: 500,
    };

    fn good() -> Evidence {
        Evidence {
            n_points: 300,
            posterior_coverage: 0.9,
            explained_share: 0.98,
            noise_mm: 0.5,
            others_noise_mm: 0.5,
            target_noise_mm: 0.5,
            quiet_noise_mm: 0.5,
            is_from_camera: false,
            tells_tissue: false,
            deviations: Some(GOOD),
            unexplained_share: 0.01,
            level_margin: 0.5,
            landmarks_support_levels: true,
            alternative_margin: 0.4,
            landmark_distance_mm: Some(4.0),
            misfit: NOISE_ONLY,
            seen_through: 0.0,
            hidden_share: 0.0,
            sensor_noise_mm: None,
            bare_area_mm2: None,
        }
    }

    #[test]
    fn the_chain_names_the_neighbour() {
        let options = VerdictOptions::default();
        let centroids = (Point3::origin(), Point3::new(0.0, 0.0, -35.0));
        let judge = |angle: f64, shift: f64| {
            let rotated = Isometry3::rotation(nalgebra::Vector3::new(0.0, 0.0, angle));
            let moved = nalgebra::Translation3::new(0.0, 0.0, shift) * rotated;
            let own = Isometry3::identity();
            chain_rejections(
                (&own, &centroids.0),
                (&moved, &centroids.1),
                Level::L2,
                &options,
            )
        };
        assert_eq!(judge(0.5, 5.0), vec![], "within the limits");
        let words = |found: Vec<Rejection>| -> Vec<String> {
            found.iter().map(ToString::to_string).collect()
        };
        let turned = words(judge(1.0, 0.0));
        assert!(
            turned.len() == 1 && turned[0].contains("57° against L2"),
            "{turned:?}"
        );
        let shifted = words(judge(0.0, -20.0));
        assert!(
            shifted.len() == 1 && shifted[0].contains("55 mm from L2"),
            "{shifted:?}"
        );
    }

    #[test]
    fn good_evidence_is_accepted() {
        assert_eq!(rejections(&good(), &VerdictOptions::default()), vec![]);
    }

    #[test]
    fn bumps_that_noise_hides_on_one_bone_show_on_all() {
        let options = VerdictOptions::default();
        let hidden = Misfit {
            covariance_mm2: 0.4,
            by_noise_mm2: 0.2,
            deviation_mm2: 0.1,
            ..NOISE_ONLY
        };
        assert_eq!(pooled_rejection(&[hidden], &options), None, "one alone");
        let found = pooled_rejection(&[hidden; 5], &options).map(|r| r.to_string());
        assert!(found.is_some_and(|r| r.contains("together")), "all five");
        assert_eq!(pooled_rejection(&[NOISE_ONLY; 5], &options), None, "noise");
        assert_eq!(pooled_rejection(&[], &options), None, "nobody is trusted");
    }

    #[test]
    fn landmarks_lend_the_levels_support_and_never_outweigh_the_shape() {
        let options = VerdictOptions::default();
        let judged = |margin: f64, supported: bool| {
            let evidence = Evidence {
                level_margin: margin,
                landmarks_support_levels: supported,
                ..good()
            };
            rejections(&evidence, &options).len()
        };
        assert_eq!(judged(0.05, true), 0, "shape and names agree");
        assert_eq!(judged(0.05, false), 1, "the shape alone is not sure");
        assert_eq!(judged(0.01, true), 1, "names alone are not enough");
        assert_eq!(judged(0.2, false), 0, "the shape is sure");
    }

    #[test]
    fn a_sensor_errs_as_its_patches_or_the_quieter_bones_show() {
        let judged = |quiet_noise_mm: f64| {
            let evidence = Evidence {
                is_from_camera: true,
                tells_tissue: true,
                bare_area_mm2: Some(1500.0),
                alternative_margin: 0.4,
                sensor_noise_mm: Some(0.45),
                quiet_noise_mm,
                ..good()
            };
            rejections(&evidence, &VerdictOptions::default()).len()
        };
        assert_eq!(judged(0.45), 1, "only this bone is noisier than the sensor");
        assert_eq!(judged(0.49), 0, "the sensor is noisier than its patches");
        assert_eq!(judged(f64::NAN), 1, "no other bone tells");
        let quiet = |noises: &[f64]| second_smallest(noises.to_vec());
        assert!((quiet(&[0.9, f64::NAN, 0.5, 0.7]) - 0.7).abs() < 1e-12);
        assert!(quiet(&[0.9]).is_nan());
    }

    #[test]
    fn a_noisy_target_is_refused_even_where_a_bone_fits_by_chance() {
        let evidence = Evidence {
            others_noise_mm: 2.7,
            target_noise_mm: 2.7,
            noise_mm: 2.1,
            ..good()
        };
        let found = rejections(&evidence, &VerdictOptions::default());
        assert!(
            found.len() == 1 && found[0].to_string().contains("2.70 mm"),
            "{found:?}"
        );
    }

    #[test]
    fn each_figure_alone_rejects_with_its_own_reason() {
        let with = |deviations| -> Spoil { Box::new(move |e| e.deviations = Some(deviations)) };
        let cases: Vec<(&str, Spoil)> = vec![
            ("too few target points", Box::new(|e| e.n_points = 10)),
            (
                "too little surface seen (12 %",
                Box::new(|e| e.posterior_coverage = 0.12),
            ),
            ("does not fit", Box::new(|e| e.explained_share = 0.5)),
            (
                "too noisy",
                Box::new(|e| (e.noise_mm, e.others_noise_mm, e.target_noise_mm) = (5.0, 5.0, 5.0)),
            ),
            ("noisier than those", Box::new(|e| e.noise_mm = 0.9)),
            (
                "belong to no vertebra",
                Box::new(|e| e.unexplained_share = 0.2),
            ),
            ("shifted by one", Box::new(|e| e.level_margin = 0.0)),
            (
                "breaches the cortex",
                with(Deviations {
                    breach_probability: 0.3,
                    ..GOOD
                }),
            ),
            (
                "taken for bone",
                Box::new(|e| e.sensor_noise_mm = Some(0.25)),
            ),
            ("in front of", Box::new(|e| e.hidden_share = 0.8)),
            (
                "bare bone seen (250 mm²",
                Box::new(|e| (e.is_from_camera, e.bare_area_mm2) = (true, Some(250.0))),
            ),
            (
                "measure more densely",
                Box::new(|e| e.is_from_camera = true),
            ),
            (
                "too noisy (1.70 mm, at most 1.50 mm)",
                Box::new(|e| {
                    (e.is_from_camera, e.bare_area_mm2) = (true, Some(1500.0));
                    (e.noise_mm, e.others_noise_mm, e.target_noise_mm) = (1.7, 1.7, 1.7);
                }),
            ),
            (
                "another pose",
                Box::new(|e| {
                    (e.is_from_camera, e.bare_area_mm2) = (true, Some(1500.0));
                    e.alternative_margin = 0.12;
                }),
            ),
            (
                "taken for bone",
                Box::new(|e| {
                    (e.is_from_camera, e.tells_tissue) = (true, true);
                    (e.bare_area_mm2, e.sensor_noise_mm) = (Some(1500.0), Some(0.45));
                    e.quiet_noise_mm = 0.45;
                }),
            ),
            ("saw through 12 %", Box::new(|e| e.seen_through = 0.12)),
            ("right patient", Box::new(|e| e.misfit.covariance_mm2 = 0.5)),
            (
                "right patient",
                Box::new(|e| e.misfit.covariance_mm2 = f64::NAN),
            ),
            (
                "fix the position",
                with(Deviations {
                    position_mm: 2.0,
                    ..GOOD
                }),
            ),
            (
                "fix the position",
                with(Deviations {
                    position_mm: f64::NAN,
                    ..GOOD
                }),
            ),
            (
                "fix the orientation",
                with(Deviations {
                    orientation_rad: 0.3,
                    ..GOOD
                }),
            ),
            (
                "where a screw goes",
                with(Deviations {
                    screw_mm: 3.0,
                    ..GOOD
                }),
            ),
            ("another pose", Box::new(|e| e.alternative_margin = 0.01)),
            (
                "from its landmark",
                Box::new(|e| e.landmark_distance_mm = Some(40.0)),
            ),
            ("no fit", Box::new(|e| e.deviations = None)),
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

//! Whether the transfer of a vertebra can be vouched for, and if not, why.

use crate::VerdictOptions;
use crate::evidence::{Deviations, Evidence};
use crate::margin::{MARGIN_MM, MARGIN_RAD};
use crate::misfit::PATCH_MM;
use crate::rejection::Rejection;
use crate::verdict_noise::{noise_of_sensor, noise_of_target};

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
    for reason in noise_of_target(evidence, options) {
        demand(false, reason);
    }
    let Deviations {
        position_mm,
        orientation_rad,
        screw_mm,
        breach_probability,
    } = deviations;
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
    let (std_mm, std_rad) = (position_mm.worst(), orientation_rad.worst());
    let (max_mm, max_rad) = if evidence.tells_tissue {
        (
            options.max_translation_std_along_rays_mm,
            options.max_rotation_std_along_rays_rad,
        )
    } else {
        (options.max_translation_std_mm, options.max_rotation_std_rad)
    };
    let max_mm = position_mm.worst_allowed(MARGIN_MM, max_mm);
    let max_rad = orientation_rad.worst_allowed(MARGIN_RAD, max_rad);
    demand(
        std_mm <= max_mm,
        Rejection::PositionUncertain { std_mm, max_mm },
    );
    demand(
        std_rad <= max_rad,
        Rejection::OrientationUncertain { std_rad, max_rad },
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
        if let Some(share) = evidence.behind_share {
            let max = max_behind_share(evidence.bare_area_mm2, options);
            demand(share <= max, Rejection::BehindBone { share, max });
        }
    }
    let misfit = evidence.misfit;
    if let Some(reason) = noise_of_sensor(evidence) {
        demand(false, reason);
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
    // Two names that changed places, or moved on by a level: the shape is sure where it would be without any name.
    // A camera sees too little for that.
    let is_wrong_name = evidence.landmark_is_of_another
        && !evidence.is_from_camera
        && evidence.level_margin >= options.min_level_margin;
    if let Some(distance_mm) = evidence.landmark_distance_mm.filter(|_| !is_wrong_name) {
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

/// The less bone was seen, the less of what was measured may lie behind it: half as much on the first area as on the second and more, mm².
const BEHIND_BY_AREA_MM2: [f64; 2] = [400.0, 1200.0];

/// Largest share of the points behind a bone of which so much was seen bare.
pub(crate) fn max_behind_share(bare_area_mm2: Option<f64>, options: &VerdictOptions) -> f64 {
    let [little, much] = BEHIND_BY_AREA_MM2;
    let of_area = |area_mm2: f64| ((area_mm2 - little) / (much - little)).clamp(0.0, 1.0);
    let share = bare_area_mm2.map_or(0.0, of_area);
    options.max_behind_share * 0.5 * (1.0 + share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::margin::Spread;
    use crate::misfit::Misfit;
    use crate::verdict_noise::second_smallest;
    use nalgebra::{Matrix3, Vector3};

    /// Makes one figure of good evidence bad.
    type Spoil = Box<dyn Fn(&mut Evidence)>;

    const GOOD: Deviations = Deviations {
        position_mm: Spread::alike(0.1),
        orientation_rad: Spread::alike(0.003),
        screw_mm: 0.2,
        breach_probability: 1e-6,
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
            landmark_is_of_another: false,
            misfit: Misfit::NOISE_ONLY,
            seen_through: 0.0,
            hidden_share: 0.0,
            n_alike: 1.0,
            sensor_noise_mm: None,
            bare_area_mm2: None,
            behind_share: None,
        }
    }

    #[test]
    fn good_evidence_is_accepted() {
        assert_eq!(rejections(&good(), &VerdictOptions::default()), vec![]);
    }

    #[test]
    fn a_camera_whose_pixels_err_alike_may_be_less_noisy() {
        let judged = |n_alike: f64| {
            let seen = Evidence {
                is_from_camera: true,
                noise_mm: 1.2,
                target_noise_mm: 1.2,
                bare_area_mm2: Some(900.0),
                behind_share: Some(0.0),
                n_alike,
                ..good()
            };
            rejections(&seen, &VerdictOptions::default())
        };
        let noisy = |found: &[Rejection]| {
            let words = found.iter().map(ToString::to_string);
            words
                .filter(|w| w.contains("too noisy"))
                .collect::<Vec<_>>()
        };
        assert!(noisy(&judged(1.0)).is_empty());
        let words = noisy(&judged(4.0)).concat();
        assert!(
            words.contains("at most 1.10 mm") && words.contains("4 pixels"),
            "{words}"
        );
    }

    #[test]
    fn deviations_are_held_against_the_margins_in_all_directions() {
        let along = |worst: f64| {
            Spread::of(&Matrix3::from_diagonal(&Vector3::new(
                0.0,
                worst * worst,
                0.0,
            )))
        };
        let n_reasons = |deviations: Deviations, tells_tissue: bool| {
            let evidence = Evidence {
                deviations: Some(deviations),
                tells_tissue,
                ..good()
            };
            rejections(&evidence, &VerdictOptions::default()).len()
        };
        let position = |position_mm: Spread, tells_tissue| {
            n_reasons(
                Deviations {
                    position_mm,
                    ..GOOD
                },
                tells_tissue,
            )
        };
        assert_eq!(position(along(0.755), false), 0, "in one direction");
        assert_eq!(position(along(0.77), false), 1);
        assert_eq!(position(Spread::alike(0.615), false), 0, "in all");
        assert_eq!(position(Spread::alike(0.63), false), 1);
        assert_eq!(position(along(0.57), true), 0, "along rays");
        assert_eq!(position(along(0.59), true), 1);
        let orientation = |degrees: f64| {
            let orientation_rad = along(degrees.to_radians());
            n_reasons(
                Deviations {
                    orientation_rad,
                    ..GOOD
                },
                false,
            )
        };
        assert_eq!((orientation(2.13), orientation(2.2)), (0, 1));
    }

    #[test]
    fn the_less_bone_is_bare_the_less_may_lie_behind_it() {
        let options = VerdictOptions::default();
        for (area_mm2, most) in [
            (400.0, 0.006),
            (800.0, 0.009),
            (1200.0, 0.012),
            (2000.0, 0.012),
        ] {
            let judged = |share: f64| {
                let seen = Evidence {
                    is_from_camera: true,
                    bare_area_mm2: Some(area_mm2),
                    behind_share: Some(share),
                    ..good()
                };
                rejections(&seen, &options)
            };
            assert_eq!(judged(most - 1e-6), vec![]);
            let words = judged(most + 1e-6);
            assert!(
                matches!(words[..], [Rejection::BehindBone { .. }]),
                "{words:?}"
            );
        }
        let least = max_behind_share(None, &options);
        assert!(
            (least - 0.006).abs() < 1e-12,
            "nothing is known to be bare: {least}"
        );
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
    fn a_wrong_name_needs_a_shape_that_is_sure_of_the_levels() {
        let judged = |margin: f64, is_of_another: bool| {
            let evidence = Evidence {
                level_margin: margin,
                landmark_distance_mm: Some(36.0),
                landmark_is_of_another: is_of_another,
                ..good()
            };
            rejections(&evidence, &VerdictOptions::default()).len()
        };
        assert_eq!(judged(0.2, true), 0, "the shape is sure");
        assert_eq!(judged(0.1, true), 1, "other names support it, no more");
        assert_eq!(judged(f64::NAN, true), 2, "nothing is known");
        assert_eq!(judged(0.5, false), 1, "far from every vertebra");
        let seen = Evidence {
            is_from_camera: true,
            bare_area_mm2: Some(1500.0),
            landmark_distance_mm: Some(36.0),
            landmark_is_of_another: true,
            ..good()
        };
        let found = rejections(&seen, &VerdictOptions::default());
        assert_eq!(found.len(), 1, "a camera sees too little: {found:?}");
    }

    #[test]
    fn a_sensor_errs_as_its_patches_or_the_quieter_bones_show() {
        let judged = |quiet_noise_mm: f64| {
            let evidence = Evidence {
                is_from_camera: true,
                bare_area_mm2: Some(1500.0),
                alternative_margin: 0.4,
                sensor_noise_mm: Some(0.4),
                quiet_noise_mm,
                ..good()
            };
            rejections(&evidence, &VerdictOptions::default()).len()
        };
        assert_eq!(judged(0.4), 1, "only this bone is noisier than the sensor");
        assert_eq!(judged(0.45), 0, "the sensor is noisier than its patches");
        assert_eq!(judged(f64::NAN), 1, "no other bone tells");
        let quiet = |noises: &[f64]| second_smallest(noises.to_vec());
        assert!((quiet(&[0.9, f64::NAN, 0.5, 0.7]) - 0.7).abs() < 1e-12);
        assert!(quiet(&[0.9]).is_nan());
    }

    #[test]
    fn much_bare_bone_may_have_thin_tissue_beside_it() {
        let judged = |area_mm2: f64| {
            let evidence = Evidence {
                is_from_camera: true,
                tells_tissue: true,
                bare_area_mm2: Some(area_mm2),
                behind_share: Some(0.002),
                sensor_noise_mm: Some(0.42),
                ..good()
            };
            rejections(&evidence, &VerdictOptions::default()).len()
        };
        assert_eq!(judged(1500.0), 0, "0.50 mm of 0.42 mm");
        assert_eq!(judged(450.0), 1, "the same on little bone");
    }

    #[test]
    fn a_noisy_target_is_refused_even_where_a_bone_fits_by_chance() {
        let evidence = Evidence {
            others_noise_mm: 3.7,
            target_noise_mm: 3.7,
            noise_mm: 3.1,
            ..good()
        };
        let found = rejections(&evidence, &VerdictOptions::default());
        assert!(
            found.len() == 1 && found[0].to_string().contains("3.70 mm"),
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
                "too noisy (2.40 mm, at most 2.20 mm)",
                Box::new(|e| {
                    (e.is_from_camera, e.bare_area_mm2) = (true, Some(1500.0));
                    (e.noise_mm, e.others_noise_mm, e.target_noise_mm) = (2.4, 2.4, 2.4);
                }),
            ),
            (
                "another pose",
                Box::new(|e| {
                    (e.is_from_camera, e.bare_area_mm2) = (true, Some(1500.0));
                    e.alternative_margin = 0.09;
                }),
            ),
            (
                "taken for bone",
                Box::new(|e| {
                    (e.is_from_camera, e.tells_tissue) = (true, true);
                    (e.bare_area_mm2, e.sensor_noise_mm) = (Some(1500.0), Some(0.35));
                }),
            ),
            (
                "taken for bone",
                Box::new(|e| {
                    (e.is_from_camera, e.tells_tissue) = (true, true);
                    // Enough where much bare bone is seen, not where little is.
                    (e.bare_area_mm2, e.sensor_noise_mm) = (Some(450.0), Some(0.42));
                }),
            ),
            (
                "4.00 % of what was measured on the bone lies behind it",
                Box::new(|e| {
                    (e.is_from_camera, e.bare_area_mm2) = (true, Some(1500.0));
                    e.behind_share = Some(0.04);
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
                    position_mm: Spread::alike(2.0),
                    ..GOOD
                }),
            ),
            (
                "fix the position",
                with(Deviations {
                    position_mm: Spread::alike(f64::NAN),
                    ..GOOD
                }),
            ),
            (
                "fix the orientation",
                with(Deviations {
                    orientation_rad: Spread::alike(0.3),
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

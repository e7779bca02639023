//! What vertebrae say of each other: the shapes of all, and neighbours of a chain.

use nalgebra::{Isometry3, Point3};
use pedicle_trajectory::Level;

use crate::misfit::{Misfit, PATCH_MM};
use crate::rejection::Rejection;
use crate::verdict_noise::median;
use crate::{SpineChange, VerdictOptions};

/// What the shapes of all vertebrae that are trusted otherwise say together: bumps that noise hides on
/// one bone show on five.
pub(crate) fn pooled_rejection(
    misfits: &[Misfit],
    is_along_rays: bool,
    options: &VerdictOptions,
) -> Option<Rejection> {
    if misfits.is_empty() {
        return None;
    }
    let pooled = Misfit::pooled(misfits);
    let (max_mm, in_sigma) = if is_along_rays {
        (options.max_pooled_misfit_of_camera_mm, 0.0)
    } else {
        (options.max_misfit_mm, options.pooled_misfit_in_sigma)
    };
    let holds = pooled.beyond_noise_mm2(in_sigma) <= max_mm * max_mm;
    (!holds).then(|| Rejection::SpineDiffers {
        misfit_mm: pooled.depth_mm(),
        patch_mm: PATCH_MM,
    })
}

/// Whether the points tell that the bones are the plan's where noise hides their bumps: nothing is told of none and of a NaN.
pub(crate) fn shape_rejection(
    change: Option<&SpineChange>,
    options: &VerdictOptions,
) -> Option<Rejection> {
    let told = change.filter(|change| change.largest_log_bayes_factor.is_finite());
    let Some(change) = told else {
        return Some(Rejection::ShapeNotTold {
            log_bayes_factor: 0.0,
            max: options.max_log_bayes_factor,
        });
    };
    let largest = change.largest_log_bayes_factor;
    if largest > options.max_log_bayes_factor_of_any {
        return Some(Rejection::BonesDiffer {
            log_bayes_factor: largest,
            larger: change.larger.into(),
        });
    }
    let (log_bayes_factor, max) = (change.log_bayes_factor, options.max_log_bayes_factor);
    (log_bayes_factor > max).then_some(Rejection::ShapeNotTold {
        log_bayes_factor,
        max,
    })
}

/// The same of one bone by itself, if anything is known of its shape.
pub(crate) fn bone_rejection(
    log_bayes_factor: Option<f64>,
    n_points: usize,
    options: &VerdictOptions,
) -> Option<Rejection> {
    let max = options.max_log_bayes_factor_of_bone;
    match log_bayes_factor {
        None => Some(Rejection::ShapeUnknown { n_points }),
        Some(log_bayes_factor) => {
            let holds = log_bayes_factor <= max;
            (!holds).then_some(Rejection::BoneDiffers {
                log_bayes_factor,
                max,
            })
        }
    }
}

/// The more noise, the less lies clearly behind the bones of another patient: of the limit so much less, 1/mm.
const FALL_PER_MM: f64 = 0.4;
/// And never less than this share of it.
const LEAST_OF_LIMIT: f64 = 0.4;

/// Whether a camera saw points behind most of the bones, as it does of another patient: from the shares of the vertebrae
/// with a fit and the noise of the sensor.
pub(crate) fn behind_rejection(
    shares: Vec<f64>,
    noise_mm: f64,
    options: &VerdictOptions,
) -> Option<Rejection> {
    if shares.is_empty() {
        return None;
    }
    let part = (1.0 - FALL_PER_MM * noise_mm).clamp(LEAST_OF_LIMIT, 1.0);
    let (share, max) = (median(shares), part * options.max_behind_share_of_spine);
    let holds = share <= max;
    (!holds).then_some(Rejection::BehindSpine { share, max })
}

/// Whether most of the other vertebrae with a fit do not fit what a camera saw, as those of another patient do not: what is said of a
/// vertebra that does.
pub(crate) fn others_rejection(n_differ: usize, n_others: usize) -> Option<Rejection> {
    (2 * n_differ > n_others).then_some(Rejection::OthersDiffer { n_differ, n_others })
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

    #[test]
    fn a_bone_of_another_shape_or_of_none_that_is_known_is_refused() {
        let judged = |log_bayes_factor| {
            let found = bone_rejection(log_bayes_factor, 200, &VerdictOptions::default());
            found.map(|reason| reason.to_string())
        };
        assert_eq!(judged(Some(-1.0)), None);
        assert_eq!(judged(Some(1.9)), None);
        let other = judged(Some(3.0)).unwrap_or_default();
        assert!(
            other.contains("20 times likelier of another one"),
            "{other}"
        );
        assert!(judged(Some(f64::NAN)).is_some(), "a NaN never holds");
        let unknown = judged(None).unwrap_or_default();
        assert!(unknown.contains("200 points do not tell"), "{unknown}");
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
    fn bumps_that_noise_hides_on_one_bone_show_on_all() {
        let options = VerdictOptions::default();
        let hidden = Misfit {
            covariance_mm2: 0.4,
            by_noise_mm2: 0.2,
            deviation_mm2: 0.1,
            ..Misfit::NOISE_ONLY
        };
        assert_eq!(
            pooled_rejection(&[hidden], false, &options),
            None,
            "one alone"
        );
        let found = pooled_rejection(&[hidden; 5], false, &options).map(|r| r.to_string());
        assert!(found.is_some_and(|r| r.contains("together")), "all five");
        assert_eq!(
            pooled_rejection(&[Misfit::NOISE_ONLY; 5], false, &options),
            None,
            "noise"
        );
        assert_eq!(
            pooled_rejection(&[], false, &options),
            None,
            "nobody is trusted"
        );
    }

    #[test]
    fn along_rays_noise_hides_no_bumps() {
        let options = VerdictOptions::default();
        let bumpy = Misfit {
            covariance_mm2: 0.03,
            by_noise_mm2: 0.0,
            deviation_mm2: 0.02,
            ..Misfit::NOISE_ONLY
        };
        assert!(pooled_rejection(&[bumpy; 5], true, &options).is_some());
        assert_eq!(pooled_rejection(&[bumpy; 5], false, &options), None);
    }

    #[test]
    fn another_shape_is_said_and_so_is_a_nan() {
        let options = VerdictOptions::default();
        let judged = |log_bayes_factor| {
            let change = SpineChange {
                log_bayes_factor,
                largest_log_bayes_factor: 0.5 * log_bayes_factor,
                larger: nalgebra::Vector3::new(0.03, 0.0, 0.01),
            };
            shape_rejection(Some(&change), &options).map(|r| r.to_string())
        };
        assert_eq!(judged(-12.0), None, "the plan's bones");
        assert!(judged(-1.0).is_some_and(|r| r.contains("less noisily")));
        assert!(judged(6.0).is_some_and(|r| r.contains("right patient")));
        assert!(judged(f64::NAN).is_some_and(|r| r.contains("only 1.0 times")));
        assert!(shape_rejection(None, &options).is_some());
    }

    #[test]
    fn a_vertebra_alone_among_others_that_do_not_fit_is_refused() {
        assert!(
            others_rejection(3, 4).is_some_and(|r| r.to_string().starts_with("3 of the other 4"))
        );
        assert!(others_rejection(2, 3).is_some());
        assert_eq!(
            others_rejection(2, 4),
            None,
            "half of them may lie under tissue"
        );
        assert_eq!(others_rejection(0, 0), None);
    }

    #[test]
    fn points_behind_most_bones_are_of_another_patient() {
        let options = VerdictOptions::default();
        let judged = |shares: &[f64], noise_mm| {
            behind_rejection(shares.to_vec(), noise_mm, &options).map(|r| r.to_string())
        };
        let one_wrong = [0.001, 0.0, 0.3, 0.002, 0.001];
        assert_eq!(judged(&one_wrong, 0.3), None, "one bone was not found");
        let found = judged(&[0.1, 0.02, 0.05, 0.0, 0.2], 0.3);
        assert!(found.is_some_and(|r| r.contains("right patient")), "most");
        let few = [0.005; 5];
        assert_eq!(judged(&few, 0.3), None, "at little noise");
        assert!(judged(&few, 1.5).is_some(), "at much noise less is seen");
        assert_eq!(judged(&[], 0.3), None, "no camera");
    }
}

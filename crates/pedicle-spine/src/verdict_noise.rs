//! What the noise of a fit says against it: the target's, the other vertebrae's, the sensor's own.

use crate::VerdictOptions;
use crate::evidence::Evidence;
use crate::rejection::Rejection;

/// Vertebrae this much noisier than the median may be other vertebrae: a wrong level fits to
/// about one and a half to three times the noise of the right one.
const MAX_NOISE_RATIO: f64 = 1.35;
/// And at least this much, mm: without noise the ratio means nothing.
const MIN_NOISE_EXCESS_MM: f64 = 0.15;

/// The noise of one bone of a target at the limit may be larger by this factor.
const MAX_OWN_NOISE_RATIO: f64 = 1.1;

/// Right poses fit to 0.8 to 1.1 of the noise of the sensor, wrong ones among tissue to 1.05 and more.
const MAX_SENSOR_RATIO: f64 = 1.15;
/// Along the rays of a camera right poses fit to 0.85 to 1.1 of it,
const MAX_TOLD_RATIO: f64 = 1.1;
/// and thin tissue beside the bone and a surface of triangles add so much, mm, of an area in mm² and less, and of another and
/// more: wrong poses among tissue fit to 1.05 and more, but most of them rest on little bone.
const MORE_MM: [(f64, f64); 2] = [(400.0, 0.1), (900.0, 0.25)];
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

/// The middle value; NaN of none.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.retain(|x| !x.is_nan());
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// The second smallest of some noises; NaN of fewer than two.
pub(crate) fn second_smallest(mut noises_mm: Vec<f64>) -> f64 {
    noises_mm.retain(|x| !x.is_nan());
    noises_mm.sort_by(f64::total_cmp);
    noises_mm.get(1).copied().unwrap_or(f64::NAN)
}

/// Against the limit of the target and against the other vertebrae. A NaN never holds.
pub(crate) fn noise_of_target(evidence: &Evidence, options: &VerdictOptions) -> Vec<Rejection> {
    let max_mm = if evidence.is_from_camera {
        // Fewer points tell as little of the shape as noisier ones.
        options.max_noise_of_camera_mm / evidence.n_alike.sqrt()
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
    let is_quiet = noise_mm <= max_mm;
    let others_mm = evidence.others_noise_mm;
    let is_as_others = evidence.noise_mm <= MAX_NOISE_RATIO * others_mm
        || evidence.noise_mm <= others_mm + MIN_NOISE_EXCESS_MM;
    let of_target = (!is_quiet).then_some(Rejection::Noisy {
        noise_mm,
        max_mm,
        n_alike: evidence.n_alike,
    });
    let of_others = (!is_as_others).then_some(Rejection::NoisierThanOthers {
        noise_mm: evidence.noise_mm,
        others_mm,
    });
    of_target.into_iter().chain(of_others).collect()
}

/// The largest noise along rays for an area of bare bone.
fn most_along_rays_mm(sensor_mm: f64, area_mm2: f64) -> f64 {
    let [(little, least_mm), (much, most_mm)] = MORE_MM;
    let share = ((area_mm2 - little) / (much - little)).clamp(0.0, 1.0);
    (MAX_TOLD_RATIO * sensor_mm).hypot(least_mm + share * (most_mm - least_mm))
}

/// Against what the sensor errs by, where its points tell that. A NaN never holds.
pub(crate) fn noise_of_sensor(evidence: &Evidence) -> Option<Rejection> {
    let sensor_mm = evidence.sensor_noise_mm?;
    let most_mm = match evidence.bare_area_mm2 {
        Some(area_mm2) if evidence.tells_tissue => most_along_rays_mm(sensor_mm, area_mm2),
        _ => {
            let shown_mm = sensor_shown_mm(sensor_mm, evidence.quiet_noise_mm);
            MAX_SENSOR_RATIO * shown_mm + SENSOR_FLOOR_MM
        }
    };
    let holds = evidence.noise_mm <= most_mm;
    (!holds).then_some(Rejection::NoisierThanSensor {
        noise_mm: evidence.noise_mm,
        max_mm: most_mm,
        sensor_mm,
    })
}

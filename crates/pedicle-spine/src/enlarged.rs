//! What a covariance of the first order leaves out.
//!
//! ```text
//! C' = C (1 + 0.12 σ)² g
//! ```
//!
//! σ is the noise of the fit in mm, 0 of a fit that is not of the first order ([`crate::blurred_bone`]), g what correlated residuals do to sums ([`crate::misfit`]).

use pedicle_registration::PoseCovariance;

use crate::errs_alike::ErrsAlike;
use crate::misfit::Misfit;
use crate::sensor::Sensor;

/// First-order covariances are too small on noisy targets, by about this much per millimetre of
/// noise. With it the normalised error squared over 6 was 0.83 to 1.19 on meshes at 0.5 to 2 mm.
const INFLATION_PER_MM: f64 = 0.12;

/// A camera whose rays are not used errs along them and more at small angles: errors of valid poses were this much
/// larger than their covariances said.
const INFLATION_OF_CAMERA: f64 = 1.15;

/// Up to this noise of a camera bone is told from tissue by distances to the closest places, mm.
const TELLS_TISSUE_MM: f64 = 1.0;
/// Where soft tissue is seen close to the bone and the noise is larger, some is taken for bone: errors were two to three
/// times as large again. From this share of the points close to the bone on in full.
const TISSUE_SHARE: f64 = 0.05;
/// What it adds to the factor.
const INFLATION_OF_TISSUE: f64 = 2.0;

/// By how much the errors of a camera whose rays are not used exceed those of the first order.
fn inflation_of_camera(noise_mm: f64, hidden_share: f64) -> f64 {
    if noise_mm <= TELLS_TISSUE_MM {
        return INFLATION_OF_CAMERA;
    }
    let tissue = (hidden_share / TISSUE_SHARE).clamp(0.0, 1.0);
    INFLATION_OF_CAMERA * (1.0 + INFLATION_OF_TISSUE * tissue)
}

/// What correlated residuals do to a covariance in which pixels that err alike are already: these make n of every one, and what is left of m² adds to
/// that. Where they are not told, they may be the m² themselves.
fn grown_beside(alike: &ErrsAlike, misfit: &Misfit) -> f64 {
    let n = alike.n_alike_of_many;
    let grown = misfit.inflation(misfit.by_noise_mm2);
    if alike.is_told() {
        1.0 + (grown - 1.0) / n
    } else if grown > n {
        grown / n
    } else {
        1.0
    }
}

/// The covariance with what the first order and independent residuals leave out.
pub(crate) fn enlarged(
    covariance: &PoseCovariance,
    (noise_mm, hidden_share): (f64, f64),
    sensor: &Sensor<'_>,
    misfit: &Misfit,
) -> PoseCovariance {
    let factor = 1.0 + INFLATION_PER_MM * noise_mm;
    // What noise does through the curvature is in the first factor or in the covariance already, but where a sensor is known it does more.
    let (factor, grown) = match (sensor.picture, sensor.noise_mm) {
        (Some(picture), _) => (factor, grown_beside(&picture.alike, misfit)),
        (None, Some(sensor_mm)) => (
            inflation_of_camera(sensor_mm, hidden_share) * factor,
            misfit.inflation(0.0),
        ),
        (None, None) => (factor, misfit.inflation(misfit.by_noise_mm2)),
    };
    PoseCovariance {
        matrix: covariance.matrix * (factor * factor * grown),
        center: covariance.center,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_that_err_alike_count_once() {
        let bumps = |by_noise_mm2| Misfit {
            covariance_mm2: 2.005,
            by_noise_mm2,
            deviation_mm2: 0.005,
            pairs_over_variance: 1.0,
            n_pairs: 500,
        };
        let told = ErrsAlike {
            length_mm: 1.0,
            n_alike_of_many: 4.0,
            ..ErrsAlike::INDEPENDENT
        };
        // Var Σ r = n σ² (4 + 2), of which 4 are in the covariance.
        assert!((grown_beside(&told, &bumps(1.0)) - 1.5).abs() < 1e-12);
        assert!((grown_beside(&told, &bumps(2.0)) - 1.0).abs() < 1e-12);
        let hidden = ErrsAlike {
            length_mm: 0.0,
            ..told
        };
        assert!((grown_beside(&hidden, &bumps(0.0)) - 1.25).abs() < 1e-12);
        let alone = ErrsAlike::INDEPENDENT;
        assert!((grown_beside(&alone, &bumps(0.0)) - 5.0).abs() < 1e-12);
    }
}

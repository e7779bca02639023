//! What is known of the sensor, and how far from a bone its points may lie.

use nalgebra::Point3;

use crate::along_rays::CameraView;
use crate::free_space::FreeSpace;
use crate::local_shape::Local;

/// The gate in standard deviations of the noise: farther points are not this vertebra's.
const GATE_IN_SIGMA: f64 = 5.0;
/// Smallest gate of the first round and bounds of the later ones, mm.
pub(crate) const GATE_MM: (f64, f64) = (4.0, 10.0);
/// The same two where the noise is known from the target alone: soft tissue a few millimetres from
/// the bone is then told apart.
const KNOWN_GATE_IN_SIGMA: f64 = 4.5;
const KNOWN_GATE_MM: (f64, f64) = (1.2, 10.0);
/// The fitted noise is this much larger than the sensor's own, the median of patches: it grows where
/// the surface is seen at a small angle.
const SENSOR_TO_SURFACE: f64 = 1.15;

/// What is known of the sensor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sensor<'a> {
    /// Noise estimated from the target alone, mm.
    pub(crate) noise_mm: Option<f64>,
    pub(crate) free_space: Option<&'a FreeSpace>,
    /// What its points tell of themselves along its rays.
    pub(crate) picture: Option<&'a Local>,
}

impl<'a> Sensor<'a> {
    /// What a camera saw, if its points are dense enough to make a picture.
    pub(crate) fn view_of(&self, positions: &'a [Point3<f64>]) -> Option<CameraView<'a>> {
        let picture = self.picture?;
        Some(CameraView {
            camera_mm: self.free_space?.camera_mm(),
            positions,
            normals: &picture.normals,
            patches: &picture.patches,
            noise_mm: picture.noise_mm,
            alike: picture.alike,
        })
    }

    /// The noise that the sensor answers for: tissue taken for bone makes the residuals larger.
    pub(crate) fn believable_mm(&self, fitted_mm: f64) -> f64 {
        match self.noise_mm {
            Some(sensor_mm) if SENSOR_TO_SURFACE * sensor_mm < fitted_mm => {
                SENSOR_TO_SURFACE * sensor_mm
            }
            _ => fitted_mm,
        }
    }

    /// The gate of the last fits.
    pub(crate) fn gate_mm(&self, fitted_noise_mm: f64) -> f64 {
        match self.noise_mm {
            Some(noise_mm) => {
                (KNOWN_GATE_IN_SIGMA * noise_mm).clamp(KNOWN_GATE_MM.0, KNOWN_GATE_MM.1)
            }
            None => (GATE_IN_SIGMA * fitted_noise_mm).clamp(GATE_MM.0, GATE_MM.1),
        }
    }
}

//! Frames of a depth camera over an open wound that breathes.
//!
//! ```text
//! q = T D(t)⁻¹ (W_i(t) B_i p),   W_i = turn by a sin(ω t - i δ) about the centroid of i · shift by s sin(ω t - i δ)
//! ```
//!
//! B_i is the motion in the discs of the suite `sensor`, W_i the breathing of vertebra i, which lags
//! behind its upper neighbour by δ; soft tissue goes with the middle vertebra. D is the drift of the camera, T the
//! rigid motion of the published suite: points are told in a frame that goes with the camera. Lengths in mm, angles in
//! rad, times in s.

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use pedicle_mesh::TriMesh;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rand_distr::Normal;

use crate::camera::{Camera, DepthImage};
use crate::landmarks::{named, touched};
use crate::motion::bends;
use crate::scene::{Scene, Wound};
use crate::sensor::truths;
use crate::simulate::placement;
use crate::soft_tissue::grown;
use crate::suite::SuiteStream;
use crate::suite_simulate::noise_of;
use crate::{
    CameraNoise, MotionRange, SensorView, SimulationError, SpineCase, SuiteCell, SuiteScenario,
    SuiteTarget, TargetSurface,
};

/// Amplitude of the breathing of every vertebra, mm and rad (3°).
const BREATH: (f64, f64) = (3.0, 0.0524);
/// Time of one breath, s: 15 a minute.
const BREATH_S: f64 = 4.0;
/// Every vertebra breathes later than the one above by this angle of the cycle, rad.
const LAG_RAD: f64 = 0.3;
/// The camera drifts to and fro by this much, mm and rad (3°), along each axis.
const DRIFT: (f64, f64) = (10.0, 0.0524);
/// Time of one drift, s.
const DRIFT_S: f64 = 17.0;

/// A wound, its soft tissue and a camera, from which frames are taken at any time.
#[derive(Debug)]
pub struct SensorSequence<'a> {
    case: &'a SpineCase,
    scenario: SuiteScenario,
    bends: Vec<Isometry3<f64>>,
    wound: Wound,
    camera: Camera,
    tissue: Option<TriMesh>,
    placement: Isometry3<f64>,
    noise: Normal<f64>,
    noise_mm: f64,
}

impl<'a> SensorSequence<'a> {
    /// The scene of a scenario of the suite `sensor`, seen by a camera whose pixels are so fine that
    /// a frame has about `n_points` points.
    ///
    /// # Errors
    /// [`SimulationError`] if the scenario is of another suite, its noise is negative or not finite, or
    /// nothing is seen.
    pub fn new(
        case: &'a SpineCase,
        scenario: &SuiteScenario,
        n_points: usize,
    ) -> Result<Self, SimulationError> {
        let SuiteCell::Sensor {
            cover, noise_mm, ..
        } = scenario.cell
        else {
            return Err(SimulationError::NoSensor {
                suite: scenario.cell.suite(),
            });
        };
        let range = MotionRange::Physiological;
        let bends = bends(case, range, &mut scenario.rng(SuiteStream::Bends))?;
        let mut view = scenario.rng(SuiteStream::Camera);
        let wound = Wound::draw(case, &bends, &mut view)?;
        let camera = Camera::draw(&wound, &mut view);
        let bare = Scene::new(case, &bends, None)?;
        let mut growth = scenario.rng(SuiteStream::SoftTissue);
        let tissue = grown(&bare, &wound, cover, &mut growth)?;
        let mut sequence = Self {
            case,
            scenario: *scenario,
            bends,
            wound,
            camera,
            tissue,
            placement: placement(case, &mut scenario.rng(SuiteStream::Placement))?,
            noise: noise_of(noise_mm)?,
            noise_mm,
        };
        let n_seen = sequence.image(0.0)?.pixels.iter().flatten().count();
        if n_seen == 0 {
            return Err(SimulationError::NothingSeen);
        }
        // Points grow with the square of the pixels along a line.
        let finer = (n_seen as f64 / n_points.max(1) as f64).sqrt();
        sequence.camera = sequence.camera.with_pitch(sequence.camera.pitch * finer);
        Ok(sequence)
    }

    /// What the camera gives at a time, as a cloud in random order, with the landmarks as touched then.
    ///
    /// # Errors
    /// [`SimulationError::NothingSeen`], or an index that cannot be made.
    pub fn frame(&self, time_s: f64) -> Result<SuiteTarget, SimulationError> {
        let image = self.image(time_s)?;
        let target_from_scene = self.placement * drift(&self.wound, time_s).inverse();
        let mut pixels: Vec<_> = image.pixels.into_iter().flatten().collect();
        if pixels.is_empty() {
            return Err(SimulationError::NothingSeen);
        }
        pixels.shuffle(&mut self.rng(SuiteStream::Order, time_s));
        let points = pixels
            .iter()
            .map(|pixel| target_from_scene * pixel.measured)
            .collect();
        let poses: Vec<Isometry3<f64>> = self
            .moved(time_s)
            .iter()
            .map(|motion| target_from_scene * motion)
            .collect();
        let mut touches = self.rng(SuiteStream::Landmarks, time_s);
        let positions = touched(self.case, &poses, &mut touches);
        let shown = pixels.iter().map(|pixel| pixel.shows);
        let truth = truths(self.case, &poses, shown, &target_from_scene);
        Ok(SuiteTarget {
            surface: TargetSurface::Cloud(points),
            source_landmarks: named(self.case, self.case.landmark_positions()),
            target_landmarks: named(self.case, &positions),
            view: Some(SensorView {
                camera_mm: self.placement * self.camera.center,
                forward: self.placement * self.camera.forward,
                pixel_pitch: self.camera.pitch,
            }),
            noise_mm: self.camera.surface_noise_mm(self.noise_mm),
            truth,
        })
    }

    fn image(&self, time_s: f64) -> Result<DepthImage, SimulationError> {
        let moved = self.moved(time_s);
        let middle = moved.len() / 2;
        let tissue = self.tissue.as_ref().map(|tissue| {
            let motion = moved[middle] * self.bends[middle].inverse();
            tissue.transformed(&motion)
        });
        let scene = Scene::new(self.case, &moved, tissue.as_ref())?;
        let camera = self.camera.moved(&drift(&self.wound, time_s));
        let mut pixels = self.rng(SuiteStream::Pixels, time_s);
        Ok(camera.image(
            &scene,
            &self.wound,
            (&self.noise, CameraNoise::default()),
            &mut pixels,
        ))
    }

    /// The motions of all vertebrae in the frame of the source.
    fn moved(&self, time_s: f64) -> Vec<Isometry3<f64>> {
        let axis = Unit::new_normalize(self.wound.left + 0.4 * self.wound.up);
        let along = (self.wound.posterior + 0.5 * self.wound.up).normalize();
        let vertebrae = self.case.vertebrae().iter().zip(&self.bends).enumerate();
        vertebrae
            .map(|(v, (vertebra, bend))| {
                let cycle = std::f64::consts::TAU * time_s / BREATH_S - LAG_RAD * v as f64;
                let rotation = UnitQuaternion::from_axis_angle(&axis, BREATH.1 * cycle.sin());
                let shift = along * (BREATH.0 * cycle.sin());
                about(&(bend * vertebra.mesh.centroid()), &rotation, &shift) * bend
            })
            .collect()
    }

    /// A generator of its own for every stream and time.
    fn rng(&self, stream: SuiteStream, time_s: f64) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::seed_from_u64(self.scenario.key() ^ time_s.to_bits());
        rng.set_stream(stream as u64);
        rng
    }
}

/// The drift of the camera since time zero, in the frame of the scene.
fn drift(wound: &Wound, time_s: f64) -> Isometry3<f64> {
    let wave = (std::f64::consts::TAU * time_s / DRIFT_S).sin();
    let axis = Unit::new_normalize(wound.left + wound.up + wound.posterior);
    let rotation = UnitQuaternion::from_axis_angle(&axis, DRIFT.1 * wave);
    let shift = (wound.left - wound.up + wound.posterior) * (DRIFT.0 * wave);
    about(&wound.origin, &rotation, &shift)
}

/// A turn about a point, then a shift.
fn about(
    center: &Point3<f64>,
    rotation: &UnitQuaternion<f64>,
    shift: &Vector3<f64>,
) -> Isometry3<f64> {
    let translation = Translation3::from(center.coords - rotation * center.coords + shift);
    Isometry3::from_parts(translation, *rotation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        MeshingOptions, PhantomParameters, SensorForm, Suite, generate_phantom, suite_scenarios,
    };

    #[test]
    fn frames_have_the_points_asked_for_and_lie_on_the_bone_told() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let case = phantom.spine_case(3_500).unwrap();
        let scenario = suite_scenarios(Suite::Sensor, 3, 1)
            .into_iter()
            .find(|s| {
                s.cell
                    == SuiteCell::Sensor {
                        form: SensorForm::Cloud,
                        cover: 0.2,
                        noise_mm: 0.6,
                    }
            })
            .expect("a cell of the suite");
        let sequence = SensorSequence::new(&case, &scenario, 6_000).unwrap();
        let frames = [0.0, 1.0].map(|time_s| sequence.frame(time_s).unwrap());
        assert_eq!(frames[0], sequence.frame(0.0).unwrap(), "the same again");
        for frame in &frames {
            let n = frame.surface.points().len();
            assert!(n.abs_diff(6_000) < 600, "{n} points");
            for truth in &frame.truth {
                let truth = &truth.vertebra;
                let seen = truth.target_points.iter().zip(&truth.target_vertices);
                let worst = seen
                    .map(|(p, &i)| (p - frame.surface.points()[i as usize]).norm())
                    .fold(0.0, |most, d| if d > most { d } else { most });
                assert!(worst < 25.0, "noise of a grazing ray, not {worst} mm");
            }
        }
        // A quarter of a breath and a part of the drift.
        let [a, b] = frames.map(|frame| frame.truth[0].vertebra.clone());
        let error = a.error_of(&b.target_from_source);
        assert!(
            (1.0..25.0).contains(&error.translation_mm),
            "{} mm",
            error.translation_mm
        );
    }
}

//! One scenario carried out on a spine.
//!
//! For vertebra i, counted from the lowest (i = 1), a target point is
//!
//! ```text
//! q = T R (B_i p) + n,   B_i: turn by (i - 1) · 5° about the spine axis
//! ```
//!
//! B_i is the identity in the rigid scenarios. The spine axis is the line from the centroid of the
//! lowest to the centroid of the highest vertebra; the turn is right-handed seen from above. R
//! turns about the centroid of the whole spine by R = R_z R_y R_x with three angles uniform in
//! ±30°, T moves by t uniform in ±2 M along each axis with M the largest side of the spine's box.
//! n is N(0, σ²) on every coordinate. Lengths in mm, angles in rad.

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use pedicle_mesh::{TriMesh, concatenate};
use pedicle_trajectory::{Landmark, Landmarks, Level};
use rand::seq::SliceRandom;
use rand::{Rng, RngExt};
use rand_distr::{Distribution, Normal, UnitBall};

use crate::cut::Cut;
use crate::scenario::Stream;
use crate::{Deformation, Scenario, SimulationError, SpineCase};

/// Turn from one vertebra to the next in the non-rigid scenarios, degrees.
const TURN_PER_LEVEL_DEG: f64 = 5.0;
/// Largest Euler angle of the rigid motion, degrees.
const LARGEST_EULER_DEG: f64 = 30.0;
/// Largest translation along an axis over the largest dimension of the spine.
const LARGEST_SHIFT_RATIO: f64 = 2.0;
/// Largest distance between the two landmarks of a pair, mm.
pub(crate) const LARGEST_LANDMARK_ERROR_MM: f64 = 5.0;

/// What is true about one vertebra of a simulated target. No method may look at it.
#[derive(Debug, Clone, PartialEq)]
pub struct VertebraTruth {
    /// Its level.
    pub level: Level,
    /// The true pose.
    pub target_from_source: Isometry3<f64>,
    /// Centroid of the source mesh, mm: where the linear error is measured.
    pub source_centroid: Point3<f64>,
    /// The target's vertices of this vertebra without noise, in the target frame, mm.
    pub target_points: Vec<Point3<f64>>,
    /// Unit normals of the uncut surface at `target_points`, in the target frame.
    pub target_normals: Vec<Vector3<f64>>,
    /// The source vertex that each of `target_points` comes from.
    pub source_vertices: Vec<u32>,
    /// The index in the target mesh of each of `target_points`.
    pub target_vertices: Vec<u32>,
}

/// A simulated intra-operative surface with its truth.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedTarget {
    /// All vertebrae in one unlabelled mesh; vertices, faces and the first corners of the faces
    /// are in random order. Target frame, mm.
    pub mesh: TriMesh,
    /// The landmarks as planned, in the source frame, mm.
    pub source_landmarks: Landmarks,
    /// The landmarks as touched: each is off by a random vector, uniform in a ball of 5 mm.
    /// Target frame, mm.
    pub target_landmarks: Landmarks,
    /// One a vertebra, from the top down.
    pub truth: Vec<VertebraTruth>,
}

/// Carries a scenario out.
///
/// # Errors
/// [`SimulationError`] for noise that is negative or not finite, or a cut that leaves nothing.
pub fn simulate(case: &SpineCase, scenario: &Scenario) -> Result<SimulatedTarget, SimulationError> {
    let out_of_range = SimulationError::NoiseOutOfRange {
        noise_mm: scenario.noise_mm,
    };
    if !(scenario.noise_mm >= 0.0 && scenario.noise_mm.is_finite()) {
        return Err(out_of_range);
    }
    let normal = Normal::new(0.0, scenario.noise_mm).map_err(|_| out_of_range)?;
    let poses = poses(case, scenario)?;
    let cut = match scenario.deformation {
        Deformation::Partial => Some(Cut::draw(&mut scenario.rng(Stream::Cut))),
        Deformation::Rigid | Deformation::NonRigid => None,
    };

    let mut parts = Vec::new();
    let mut truth = Vec::new();
    for ((vertebra, axes), pose) in case.vertebrae().iter().zip(case.axes()).zip(&poses) {
        let normals = vertebra.mesh.vertex_normals();
        let (part, source_vertices) = match &cut {
            Some(cut) => {
                let kept = cut.keep_back(&vertebra.mesh, vertebra.level, axes)?;
                (kept.mesh, kept.source_vertex)
            }
            None => {
                let all = (0..vertebra.mesh.n_vertices() as u32).collect();
                (vertebra.mesh.clone(), all)
            }
        };
        let part = part.transformed(pose);
        truth.push(VertebraTruth {
            level: vertebra.level,
            target_from_source: *pose,
            source_centroid: vertebra.mesh.centroid(),
            target_points: part.vertices().to_vec(),
            target_normals: source_vertices
                .iter()
                .map(|&v| pose * normals[v as usize])
                .collect(),
            source_vertices,
            target_vertices: Vec::new(),
        });
        parts.push(part);
    }

    let ordered = concatenate(&parts.iter().collect::<Vec<_>>())?;
    let mut noise = scenario.rng(Stream::Noise);
    let vertices = ordered
        .vertices()
        .iter()
        .map(|p| p + Vector3::from_fn(|_, _| normal.sample(&mut noise)))
        .collect();
    let (mesh, new_index) = shuffled(
        vertices,
        ordered.faces().to_vec(),
        &mut scenario.rng(Stream::Order),
    )?;
    let mut indices = new_index.into_iter();
    for vertebra in &mut truth {
        let n = vertebra.target_points.len();
        vertebra.target_vertices = indices.by_ref().take(n).collect();
    }
    let (source_landmarks, target_landmarks) = landmark_pairs(case, scenario, &poses);
    Ok(SimulatedTarget {
        mesh,
        source_landmarks,
        target_landmarks,
        truth,
    })
}

/// `target_from_source` of every vertebra, from the top down.
fn poses(case: &SpineCase, scenario: &Scenario) -> Result<Vec<Isometry3<f64>>, SimulationError> {
    let placement = placement(case, &mut scenario.rng(Stream::Motion))?;
    let turns = turns(case, scenario.deformation)?;
    Ok(turns.into_iter().map(|turn| placement * turn).collect())
}

/// The rigid motion T R of the whole spine.
pub(crate) fn placement(
    case: &SpineCase,
    rng: &mut impl Rng,
) -> Result<Isometry3<f64>, SimulationError> {
    let meshes: Vec<&TriMesh> = case.vertebrae().iter().map(|v| &v.mesh).collect();
    let spine = concatenate(&meshes)?;
    let (low, high) = spine.bounding_box();
    Ok(rigid_motion(&spine.centroid(), (high - low).max(), rng))
}

/// The turns B_i about the spine axis, from the top down.
pub(crate) fn turns(
    case: &SpineCase,
    deformation: Deformation,
) -> Result<Vec<Isometry3<f64>>, SimulationError> {
    let (foot, axis) = case.axis_through_ends()?;
    let n = case.vertebrae().len();
    let step = match deformation {
        Deformation::Rigid => 0.0,
        Deformation::NonRigid | Deformation::Partial => TURN_PER_LEVEL_DEG.to_radians(),
    };
    Ok((0..n)
        .map(|from_top| {
            let above_lowest = (n - 1 - from_top) as f64;
            let turn =
                UnitQuaternion::from_axis_angle(&Unit::new_unchecked(axis), above_lowest * step);
            turn_about(&foot, turn)
        })
        .collect())
}

fn rigid_motion(center: &Point3<f64>, largest_mm: f64, rng: &mut impl Rng) -> Isometry3<f64> {
    let reach = LARGEST_SHIFT_RATIO * largest_mm;
    let shift = Vector3::from_fn(|_, _| rng.random_range(-reach..=reach));
    let limit = LARGEST_EULER_DEG.to_radians();
    let [x, y, z] = std::array::from_fn(|_| rng.random_range(-limit..=limit));
    let turn = UnitQuaternion::from_euler_angles(x, y, z);
    Translation3::from(shift) * turn_about(center, turn)
}

pub(crate) fn turn_about(center: &Point3<f64>, turn: UnitQuaternion<f64>) -> Isometry3<f64> {
    let back = turn * center.coords;
    Isometry3::from_parts(Translation3::from(center.coords - back), turn)
}

/// The mesh in random order and, for every old vertex, its new index.
pub(crate) fn shuffled(
    vertices: Vec<Point3<f64>>,
    mut faces: Vec<[u32; 3]>,
    rng: &mut impl Rng,
) -> Result<(TriMesh, Vec<u32>), SimulationError> {
    let mut old_index: Vec<u32> = (0..vertices.len() as u32).collect();
    old_index.shuffle(rng);
    let mut new_index = vec![0; vertices.len()];
    for (new, &old) in old_index.iter().enumerate() {
        new_index[old as usize] = new as u32;
    }
    faces.shuffle(rng);
    for face in &mut faces {
        *face = face.map(|v| new_index[v as usize]);
        face.rotate_left(rng.random_range(0..3));
    }
    let vertices = old_index
        .iter()
        .map(|&old| vertices[old as usize])
        .collect();
    Ok((TriMesh::new(vertices, faces)?, new_index))
}

fn landmark_pairs(
    case: &SpineCase,
    scenario: &Scenario,
    poses: &[Isometry3<f64>],
) -> (Landmarks, Landmarks) {
    let mut rng = scenario.rng(Stream::Landmarks);
    let mut source = Landmarks::default();
    let mut target = Landmarks::default();
    let positions = case.landmark_positions().iter();
    for ((vertebra, position), pose) in case.vertebrae().iter().zip(positions).zip(poses) {
        let level = vertebra.level;
        let unit: [f64; 3] = UnitBall.sample(&mut rng);
        let error = Vector3::from(unit) * LARGEST_LANDMARK_ERROR_MM;
        source.landmarks.push(Landmark {
            level,
            position_mm: *position,
        });
        target.landmarks.push(Landmark {
            level,
            position_mm: pose * position + error,
        });
    }
    (source, target)
}

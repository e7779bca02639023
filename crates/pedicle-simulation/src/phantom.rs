//! The phantom spine: five vertebrae with surfaces, landmarks and the truth about their pedicles.
//!
//! Frame: x to the patient's right, y to the front (anterior), z up (superior), in mm (RAS). The
//! origin is the centre of the body of L3 and its mid-plane is level; lordosis tilts the others.

use nalgebra::{Point3, Unit, Vector3};
use pedicle_mesh::TriMesh;
use pedicle_trajectory::{Landmark, Landmarks, Level, Plan, Side, Trajectory};

use crate::meshing::mesh_vertebra;
use crate::spine::SpineShape;
use crate::{MeshingOptions, PhantomParameters, SimulationError, SpineCase};

/// Diameter of the planned screws where the pedicle is wide enough, mm (5 to 6 as published).
const LARGEST_SCREW_MM: f64 = 6.0;
/// The smallest usual lumbar screw, mm; what is thinner is a guide wire or a pilot drill.
const SMALLEST_SCREW_MM: f64 = 4.0;
/// The thinnest guide wire, mm.
const THINNEST_WIRE_MM: f64 = 2.0;
/// Screws and wires come in steps of this diameter, mm.
const SCREW_STEP_MM: f64 = 0.5;
/// Bone to keep between the screw and the cortex at the isthmus, mm.
const ISTHMUS_CLEARANCE_MM: f64 = 1.8;
/// The same of the smallest screw and of wires: the least of usual planning limits, mm.
const LEAST_CLEARANCE_MM: f64 = 1.0;
/// Length of the planned screws, mm.
const SCREW_LENGTH_MM: f64 = 45.0;
/// Bone to keep in front of the tip, measured along the axis, mm.
const TIP_CLEARANCE_MM: f64 = 5.0;
/// Bone to keep around the axis at the tip, mm: the largest radius and half a millimetre.
const TIP_ROOM_MM: f64 = 3.5;
/// Step in which the usable depth is looked for, mm.
const DEPTH_STEP_MM: f64 = 0.25;
/// How far from the isthmus the axis is followed to the surface, mm.
const AXIS_REACH_MM: f64 = 80.0;

/// What is known about one pedicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PedicleTruth {
    /// The side.
    pub side: Side,
    /// Centre of the narrowest section, mm.
    pub isthmus_center: Point3<f64>,
    /// Axis from the back to the front.
    pub axis: Unit<Vector3<f64>>,
    /// Direction in which the width is measured, to the patient's right, square to the axis.
    pub width_direction: Unit<Vector3<f64>>,
    /// Width of the narrowest section, mm.
    pub width_mm: f64,
    /// Height of the narrowest section, mm.
    pub height_mm: f64,
    /// Where the axis enters the bone at the back, mm.
    pub entry: Point3<f64>,
    /// Where the axis leaves the bone at the front of the body, mm.
    pub exit: Point3<f64>,
    /// Depth below the entry to which the axis keeps 3.5 mm of bone around it and 5 mm of bone
    /// in front, mm.
    pub usable_depth_mm: f64,
}

/// One vertebra of the phantom.
#[derive(Debug, Clone, PartialEq)]
pub struct PhantomVertebra {
    /// Its level.
    pub level: Level,
    /// Its surface: closed, manifold, one component, faces counter-clockwise from outside.
    pub mesh: TriMesh,
    /// The top of the spinous process, on the surface, mm.
    pub landmark: Point3<f64>,
    /// Left and right, in the order of [`Side`].
    pub pedicles: [PedicleTruth; 2],
}

/// A phantom spine, L1 to L5, in one frame: x right, y anterior, z superior, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct Phantom {
    /// From the top down.
    pub vertebrae: Vec<PhantomVertebra>,
}

/// Builds the five vertebrae.
///
/// The surfaces lie on the exact implicit solid to about 1e-9 mm at the vertices; the pedicles'
/// isthmus, axis, width and height are those of the solid.
///
/// # Errors
/// [`SimulationError`] for a dimension or an option outside its range, or for dimensions that fit
/// together so badly that no closed surface comes out.
pub fn generate_phantom(
    parameters: &PhantomParameters,
    meshing: &MeshingOptions,
) -> Result<Phantom, SimulationError> {
    parameters.validate()?;
    meshing.validate()?;
    let spine = SpineShape::new(parameters);
    let vertebrae = Level::ALL
        .into_iter()
        .map(|level| {
            let pose = &spine.poses[level.index()];
            let tip = spinous_tip(&spine, level).ok_or(SimulationError::LandmarkMissesSurface {
                level,
                reach_mm: AXIS_REACH_MM,
            })?;
            Ok(PhantomVertebra {
                level,
                mesh: mesh_vertebra(&spine, level, meshing)?,
                landmark: pose * tip,
                pedicles: [
                    pedicle_truth(&spine, level, Side::Left)?,
                    pedicle_truth(&spine, level, Side::Right)?,
                ],
            })
        })
        .collect::<Result<_, SimulationError>>()?;
    Ok(Phantom { vertebrae })
}

/// Top of the spinous process in the vertebra's own frame; none where a neighbour's takes its place.
fn spinous_tip(spine: &SpineShape, level: Level) -> Option<Point3<f64>> {
    let spinous = &spine.vertebrae[level.index()].spinous;
    let along_mm = spine.crossing(level, &spinous.inside, &spinous.outward, AXIS_REACH_MM)?;
    Some(spinous.inside + spinous.outward * along_mm)
}

/// Whether every spinous process of these dimensions has its end.
pub(crate) fn has_all_tips(parameters: &PhantomParameters) -> bool {
    let spine = SpineShape::new(parameters);
    Level::ALL
        .into_iter()
        .all(|level| spinous_tip(&spine, level).is_some())
}

fn pedicle_truth(
    spine: &SpineShape,
    level: Level,
    side: Side,
) -> Result<PedicleTruth, SimulationError> {
    let pose = &spine.poses[level.index()];
    let pedicle = &spine.vertebrae[level.index()].pedicles[side as usize];
    let surface = |direction: Vector3<f64>| {
        spine
            .crossing(level, &pedicle.isthmus, &direction, AXIS_REACH_MM)
            .ok_or(SimulationError::AxisMissesSurface {
                level,
                side,
                reach_mm: AXIS_REACH_MM,
            })
    };
    let axis = pedicle.axis.into_inner();
    let behind = surface(-axis)?;
    let ahead = surface(axis)?;
    let mut usable = ahead - TIP_CLEARANCE_MM;
    while usable > 0.0 && spine.distance(level, &(pedicle.isthmus + axis * usable)) > -TIP_ROOM_MM {
        usable -= DEPTH_STEP_MM;
    }
    Ok(PedicleTruth {
        side,
        isthmus_center: pose * pedicle.isthmus,
        axis: pose * pedicle.axis,
        width_direction: Unit::new_normalize(pose * pedicle.across),
        width_mm: 2.0 * pedicle.radii[0],
        height_mm: 2.0 * pedicle.radii[1],
        entry: pose * (pedicle.isthmus - axis * behind),
        exit: pose * (pedicle.isthmus + axis * ahead),
        usable_depth_mm: behind + usable,
    })
}

impl PedicleTruth {
    /// The largest usual screw that leaves 1.8 mm of bone at the isthmus, 6 mm at most; where that is less than 4 mm, the
    /// thickest that leaves 1 mm: a screw of 4 mm, or a guide wire of 2 mm and more. In steps of 0.5 mm.
    #[must_use]
    pub fn screw_diameter_mm(&self) -> f64 {
        let narrowest_mm = self.width_mm.min(self.height_mm);
        let leaving = |clearance_mm: f64| {
            let room_mm = narrowest_mm - 2.0 * clearance_mm;
            (room_mm / SCREW_STEP_MM + 1e-9).floor() * SCREW_STEP_MM
        };
        let usual = leaving(ISTHMUS_CLEARANCE_MM);
        if usual < SMALLEST_SCREW_MM {
            leaving(LEAST_CLEARANCE_MM).clamp(THINNEST_WIRE_MM, SMALLEST_SCREW_MM)
        } else {
            usual.clamp(SMALLEST_SCREW_MM, LARGEST_SCREW_MM)
        }
    }

    /// Depth of the isthmus below the entry along the axis, mm.
    #[must_use]
    pub fn isthmus_depth_mm(&self) -> f64 {
        (self.isthmus_center - self.entry).norm()
    }

    /// The screw along the axis: 45 mm long, or shorter where the bone does not allow it.
    #[must_use]
    pub fn trajectory(&self, level: Level) -> Trajectory {
        Trajectory {
            level,
            side: self.side,
            entry_mm: self.entry,
            tip_mm: self.entry + self.axis.into_inner() * SCREW_LENGTH_MM.min(self.usable_depth_mm),
            diameter_mm: self.screw_diameter_mm(),
        }
    }
}

impl Phantom {
    /// Two screws a vertebra, or wires where none fits, along the true axes, from the top down, left before right.
    #[must_use]
    pub fn plan(&self) -> Plan {
        Plan {
            trajectories: self
                .vertebrae
                .iter()
                .flat_map(|v| v.pedicles.map(|pedicle| pedicle.trajectory(v.level)))
                .collect(),
        }
    }

    /// The phantom as a case to simulate with, simplified to `n_faces` faces in all (3 500 in the
    /// suite `paper`).
    ///
    /// # Errors
    /// [`SimulationError`] if the surfaces cannot be simplified that far.
    pub fn spine_case(&self, n_faces: usize) -> Result<SpineCase, SimulationError> {
        let surfaces = self
            .vertebrae
            .iter()
            .map(|v| (v.level, v.mesh.clone()))
            .collect();
        SpineCase::from_surfaces(surfaces, &self.landmarks(), n_faces)
    }

    /// The tops of the spinous processes.
    #[must_use]
    pub fn landmarks(&self) -> Landmarks {
        Landmarks {
            landmarks: self
                .vertebrae
                .iter()
                .map(|v| Landmark {
                    level: v.level,
                    position_mm: v.landmark,
                })
                .collect(),
        }
    }
}

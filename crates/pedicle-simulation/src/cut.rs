//! The cut of the partial scenarios: the front half of the spine is taken away.
//!
//! An open posterior approach exposes the back of every vertebra. The cut therefore follows the
//! spine as a hand that selects the exposed half does, and not one flat plane, which in a lordotic
//! spine would leave one vertebra whole and another empty: every vertebra is cut by a frontal
//! plane of its own, square to its own anterior direction, where whole faces with half of its area lie
//! behind it. All planes of a draw share an offset along the anterior direction, uniform in ±5 mm, and
//! two tilts, about the left-right direction and about the spine, each uniform in ±10°.
//!
//! A face remains if all three corners are behind the plane. There are no new vertices, corners
//! that no face uses are dropped, and fragments that come off stay, as they would in an open
//! wound.

use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};
use pedicle_mesh::{SubMesh, TriMesh};
use pedicle_trajectory::Level;
use rand::{Rng, RngExt};

use crate::SimulationError;
use crate::case::VertebraAxes;

/// Share of a vertebra's area behind its plane before offset and tilt.
const HALF: f64 = 0.5;
/// Largest offset of the cut, mm.
const LARGEST_OFFSET_MM: f64 = 5.0;
/// Largest tilt of the cut about either direction, degrees.
const LARGEST_TILT_DEG: f64 = 10.0;

/// What the planes of one draw have in common.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cut {
    share: f64,
    offset_mm: f64,
    lean_rad: f64,
    turn_rad: f64,
}

impl Cut {
    pub(crate) fn draw(rng: &mut impl Rng) -> Self {
        let tilt = LARGEST_TILT_DEG.to_radians();
        Self {
            share: HALF,
            offset_mm: rng.random_range(-LARGEST_OFFSET_MM..=LARGEST_OFFSET_MM),
            lean_rad: rng.random_range(-tilt..=tilt),
            turn_rad: rng.random_range(-tilt..=tilt),
        }
    }

    /// The cut that leaves this share of the area behind the upright plane, without offset or
    /// tilt.
    pub(crate) fn upright(share: f64) -> Self {
        Self {
            share,
            offset_mm: 0.0,
            lean_rad: 0.0,
            turn_rad: 0.0,
        }
    }

    /// What remains of the surface of a vertebra.
    pub(crate) fn keep_back(
        &self,
        mesh: &TriMesh,
        level: Level,
        axes: &VertebraAxes,
    ) -> Result<SubMesh, SimulationError> {
        let left = Unit::new_normalize(axes.up.cross(&axes.anterior));
        let up = Unit::new_normalize(axes.up);
        let normal = UnitQuaternion::from_axis_angle(&up, self.turn_rad)
            * UnitQuaternion::from_axis_angle(&left, self.lean_rad)
            * axes.anterior;
        let point = area_point(mesh, &axes.anterior, self.share) + axes.anterior * self.offset_mm;
        let behind: Vec<bool> = mesh
            .vertices()
            .iter()
            .map(|p| (p - point).dot(&normal) <= 0.0)
            .collect();
        let kept: Vec<u32> = (0..mesh.n_faces() as u32)
            .filter(|&face| {
                mesh.faces()[face as usize]
                    .iter()
                    .all(|&v| behind[v as usize])
            })
            .collect();
        if kept.is_empty() {
            return Err(SimulationError::NothingLeft {
                level,
                n_faces: mesh.n_faces(),
                n_faces_left: 0,
            });
        }
        Ok(mesh.submesh_of_faces(&kept)?)
    }
}

/// The centroid, moved along `anterior` to where whole faces with this share of the area lie
/// behind.
fn area_point(mesh: &TriMesh, anterior: &Vector3<f64>, share: f64) -> Point3<f64> {
    let centroid = mesh.centroid();
    let mut faces: Vec<(f64, f64)> = (0..mesh.n_faces())
        .map(|face| {
            let corners = mesh.triangle(face).map(|p| (p - centroid).dot(anterior));
            let foremost = corners.into_iter().fold(f64::NEG_INFINITY, f64::max);
            (foremost, mesh.face_area(face))
        })
        .collect();
    faces.sort_by(|a, b| a.0.total_cmp(&b.0));
    let enough = share * mesh.area();
    let mut behind = 0.0;
    let along = faces
        .iter()
        .find(|(_, area)| {
            behind += area;
            behind >= enough
        })
        .map_or(0.0, |face| face.0);
    centroid + anterior * along
}

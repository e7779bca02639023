//! The target told apart into vertebrae, and its distances from them.

use nalgebra::{Isometry3, Point3};
use pedicle_mesh::{SurfaceIndex, TriMesh};
use pedicle_report::Geometry;
use pedicle_spine::{SourceVertebra, SpineModel, TargetSurface, Transfer};

/// Edge of the tetrahedron that stands for a point of a cloud, mm.
const POINT_SIZE_MM: f64 = 0.7;
/// Tetrahedron with its middle at the origin.
const TETRAHEDRON: [[f64; 3]; 4] = [
    [1.0, 1.0, 1.0],
    [-1.0, -1.0, 1.0],
    [-1.0, 1.0, -1.0],
    [1.0, -1.0, -1.0],
];
const TETRAHEDRON_FACES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

/// What is nearest to a point of the target.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nearest {
    /// Index of the vertebra.
    pub(super) vertebra: usize,
    /// Distance from its surface, mm.
    pub(super) distance_mm: f64,
    /// The closest point of it, in the source frame, mm.
    pub(super) in_source: Point3<f64>,
}

/// The nearest bone of every point of the target.
pub(super) fn nearest_bone(
    points: &[Point3<f64>],
    source: &[SourceVertebra],
    model: &SpineModel,
    transfer: &Transfer,
) -> Vec<Nearest> {
    let bones: Vec<Bone<'_>> = source
        .iter()
        .zip(&transfer.vertebrae)
        .enumerate()
        .map(|(vertebra, (bone, found))| {
            let (low, high) = bone.surface.bounding_box();
            Bone {
                vertebra,
                index: model.surface(bone.level),
                source_from_target: found.target_from_source.inverse(),
                low,
                high,
            }
        })
        .collect();
    points.iter().map(|p| nearest(p, &bones)).collect()
}

struct Bone<'a> {
    vertebra: usize,
    index: &'a SurfaceIndex,
    source_from_target: Isometry3<f64>,
    low: Point3<f64>,
    high: Point3<f64>,
}

/// Bones whose box is farther away than what was found are not asked.
fn nearest(p: &Point3<f64>, bones: &[Bone<'_>]) -> Nearest {
    let mut candidates: Vec<(f64, Point3<f64>, &Bone<'_>)> = bones
        .iter()
        .map(|bone| {
            let q = bone.source_from_target * p;
            let clamped = q.sup(&bone.low).inf(&bone.high);
            ((q - clamped).norm(), q, bone)
        })
        .collect();
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut best = Nearest {
        vertebra: 0,
        distance_mm: f64::INFINITY,
        in_source: *p,
    };
    for (box_distance, q, bone) in candidates {
        if box_distance >= best.distance_mm {
            break;
        }
        let closest = bone.index.closest_point(&q).point;
        let distance_mm = (closest - q).norm();
        if distance_mm < best.distance_mm {
            best = Nearest {
                vertebra: bone.vertebra,
                distance_mm,
                in_source: closest,
            };
        }
    }
    best
}

/// Points of a target.
pub(super) fn points_of(surface: &TargetSurface) -> &[Point3<f64>] {
    match surface {
        TargetSurface::Mesh(mesh) => mesh.vertices(),
        TargetSurface::Cloud(points) => points,
    }
}

/// The surface of one vertebra of the target, and the target's vertex behind each of its own.
pub(super) fn part_of_target(
    surface: &TargetSurface,
    nearest: &[Nearest],
    vertebra: usize,
) -> (Geometry, Vec<u32>) {
    match surface {
        TargetSurface::Mesh(mesh) => part_of_mesh(mesh, nearest, vertebra),
        TargetSurface::Cloud(points) => tetrahedra(points, nearest, vertebra),
    }
}

/// The faces most of whose corners belong to the vertebra.
fn part_of_mesh(mesh: &TriMesh, nearest: &[Nearest], vertebra: usize) -> (Geometry, Vec<u32>) {
    let owner = |v: u32| nearest[v as usize].vertebra;
    let faces: Vec<[u32; 3]> = mesh
        .faces()
        .iter()
        .copied()
        .filter(|face| {
            let [a, b, c] = face.map(owner);
            let most = if b == c { b } else { a };
            most == vertebra
        })
        .collect();
    let mut new_of_old = vec![u32::MAX; mesh.n_vertices()];
    let mut kept = Vec::new();
    let faces = faces
        .iter()
        .map(|face| {
            face.map(|v| {
                let new = &mut new_of_old[v as usize];
                if *new == u32::MAX {
                    *new = kept.len() as u32;
                    kept.push(v);
                }
                *new
            })
        })
        .collect();
    let geometry = Geometry {
        vertices: kept.iter().map(|&v| mesh.vertices()[v as usize]).collect(),
        faces,
        colorings: Vec::new(),
    };
    (geometry, kept)
}

fn tetrahedra(
    points: &[Point3<f64>],
    nearest: &[Nearest],
    vertebra: usize,
) -> (Geometry, Vec<u32>) {
    let mut geometry = Geometry::default();
    let mut kept = Vec::new();
    let half = POINT_SIZE_MM / 8f64.sqrt();
    for (v, p) in points.iter().enumerate() {
        if nearest[v].vertebra != vertebra {
            continue;
        }
        let first = geometry.vertices.len() as u32;
        for corner in TETRAHEDRON {
            geometry
                .vertices
                .push(p + nalgebra::Vector3::from(corner) * half);
            kept.push(v as u32);
        }
        let faces = TETRAHEDRON_FACES.map(|face| face.map(|k| first + k));
        geometry.faces.extend(faces);
    }
    (geometry, kept)
}

/// A round number above nearly all values, for the end of a colour scale.
pub(super) fn scale_end(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let at = sorted.len().saturating_sub(1) * 98 / 100;
    let high = sorted.get(at).copied().unwrap_or(0.0);
    let steps = [0.1, 0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0];
    steps
        .into_iter()
        .find(|step| *step >= high)
        .unwrap_or(100.0)
}

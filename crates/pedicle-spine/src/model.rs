//! The pre-operative spine, prepared once and used for any number of targets.

use std::sync::Arc;

use nalgebra::Point3;
use pedicle_mesh::{SurfaceIndex, TriMesh, concatenate};
use pedicle_trajectory::{
    AnatomicalFrame, Landmarks, Level, Pedicle, Plan, Side, anatomical_frames,
};
use rayon::prelude::*;

use crate::bends::Bends;
use crate::bone::BoneSurface;
use crate::free_space::Patch;
use crate::map_shape::{MapShape, clean, restrict, simplified};
use crate::shape_basis::ShapeBasis;
use crate::uncertainty::Anatomy;
use crate::{MapOptions, Shape, SpineError};

/// Farthest that a landmark may lie from its surface, mm.
pub const MAX_LANDMARK_DISTANCE_MM: f64 = 50.0;
/// Farthest that a planned trajectory may lie from its vertebra, mm. An entry may float some
/// millimetres above the bone; a neighbour's vertebra is some 35 mm away.
pub const MAX_PLAN_DISTANCE_MM: f64 = 15.0;

/// Entries lie 10 to 30 mm beside the mirror plane; this far across it they are on the wrong
/// side, whatever the error of the plane, mm.
const MAX_ACROSS_MM: f64 = 5.0;

/// Diagonals of the bounding boxes of five lumbar vertebrae, mm, from a small child's spine to
/// the tallest, with room for oblique frames.
const SOURCE_SIZE_MM: (f64, f64) = (80.0, 600.0);

/// One vertebra as it comes from the CT.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceVertebra {
    /// Its level.
    pub level: Level,
    /// Its surface in the source frame, mm.
    pub surface: TriMesh,
}

/// One vertebra ready for registration.
#[derive(Debug)]
pub(crate) struct Vertebra {
    pub(crate) level: Level,
    pub(crate) bone: BoneSurface,
    /// The surface simplified for the map: good enough to search with, and much faster.
    pub(crate) coarse: BoneSurface,
    pub(crate) frame: AnatomicalFrame,
    pub(crate) landmark: Point3<f64>,
    pub(crate) area_mm2: f64,
    /// Surface points that tell how much of the vertebra a target shows.
    pub(crate) samples: Vec<Point3<f64>>,
    /// Whether each of them faces a posterior approach.
    pub(crate) is_posterior: Vec<bool>,
    /// The surface in pieces of about equal area.
    pub(crate) patches: Vec<Patch>,
    /// Its surface ready for rays.
    pub(crate) index: Arc<SurfaceIndex>,
    /// Its pedicles, as far as they can be measured.
    pub(crate) anatomy: Anatomy,
    /// How its surface bends.
    pub(crate) bends: Bends,
    /// How another person's bones may differ, the same at every level.
    pub(crate) shape_basis: Arc<ShapeBasis>,
}

/// The source spine: five vertebrae with their search structures and bases.
#[derive(Debug)]
pub struct SpineModel {
    pub(crate) vertebrae: Vec<Vertebra>,
    pub(crate) whole: SourceView,
    pub(crate) posterior: SourceView,
    pub(crate) diagonal_mm: f64,
    pub(crate) map_options: MapOptions,
}

/// The source as the map sees it: all of it, or what a posterior approach exposes.
#[derive(Debug)]
pub(crate) struct SourceView {
    pub(crate) shape: MapShape,
    /// Index of the vertebra of every vertex.
    pub(crate) vertebra_of_vertex: Vec<u8>,
}

impl SpineModel {
    /// Checks and prepares a spine. `landmarks` holds the top of each spinous process.
    ///
    /// # Errors
    /// [`SpineError`] if a level or a landmark is missing or doubled, a landmark is far from
    /// its vertebra, or a surface cannot be prepared for the map.
    pub fn new(
        vertebrae: Vec<SourceVertebra>,
        landmarks: &Landmarks,
        options: &MapOptions,
    ) -> Result<Self, SpineError> {
        options.check()?;
        let mut vertebrae = sorted_by_level(vertebrae)?;
        for vertebra in &mut vertebrae {
            vertebra.surface = clean(&vertebra.surface, Shape::Source)?.0;
        }
        let landmark_points = landmarks_by_level(landmarks, Shape::Source)?;
        let pairs: Vec<(Level, &TriMesh)> =
            vertebrae.iter().map(|v| (v.level, &v.surface)).collect();
        let frames = anatomical_frames(&pairs)?;

        let surfaces: Vec<&TriMesh> = vertebrae.iter().map(|v| &v.surface).collect();
        let spine = concatenate(&surfaces).map_err(mesh_error)?;
        let (low, high) = spine.bounding_box();
        let diagonal_mm = (high - low).norm();
        if !(SOURCE_SIZE_MM.0..=SOURCE_SIZE_MM.1).contains(&diagonal_mm) {
            return Err(SpineError::SourceSize {
                source_mm: diagonal_mm,
                min_mm: SOURCE_SIZE_MM.0,
                max_mm: SOURCE_SIZE_MM.1,
            });
        }
        let starts: Vec<usize> = surfaces
            .iter()
            .scan(0, |sum, mesh| {
                *sum += mesh.n_vertices();
                Some(*sum)
            })
            .collect();
        let vertebra_of = |v: u32| starts.partition_point(|&end| end <= v as usize) as u8;

        let whole_mesh = simplified(&spine, options, Shape::Source)?;
        let whole_owner: Vec<u8> = whole_mesh
            .original_vertex
            .iter()
            .map(|&v| vertebra_of(v))
            .collect();
        let exposed: Vec<u32> = (0..whole_mesh.mesh.n_faces() as u32)
            .filter(|&f| {
                let corners = whole_mesh.mesh.triangle(f as usize);
                let vertebra = whole_owner[whole_mesh.mesh.faces()[f as usize][0] as usize];
                let frame = &frames[vertebra as usize];
                corners.iter().all(|p| is_exposed(p, frame))
            })
            .collect();
        let posterior_mesh = restrict(&whole_mesh, &exposed)?;
        let posterior_owner = posterior_mesh
            .original_vertex
            .iter()
            .map(|&v| vertebra_of(v))
            .collect();
        let whole = SourceView {
            shape: MapShape::new(whole_mesh.mesh, options, Shape::Source)?,
            vertebra_of_vertex: whole_owner,
        };
        let posterior = SourceView {
            shape: MapShape::new(posterior_mesh.mesh, options, Shape::Source)?,
            vertebra_of_vertex: posterior_owner,
        };

        let basis = ShapeBasis::new(surfaces.iter().copied().zip(&frames))?;
        let basis = Arc::new(basis);
        let prepared = vertebrae
            .par_iter()
            .zip(frames)
            .zip(landmark_points)
            .enumerate()
            .map(|(v, ((vertebra, frame), landmark))| {
                prepared(v, vertebra, (frame, &basis), landmark, &whole)
            })
            .collect::<Result<Vec<Vertebra>, SpineError>>()?;
        Ok(Self {
            vertebrae: prepared,
            whole,
            posterior,
            diagonal_mm,
            map_options: options.clone(),
        })
    }

    /// The levels in order, from the top down.
    #[must_use]
    pub fn levels(&self) -> Vec<Level> {
        self.vertebrae.iter().map(|v| v.level).collect()
    }

    /// Area-weighted centroid of a vertebra's surface in the source frame.
    #[must_use]
    pub fn centroid(&self, level: Level) -> Point3<f64> {
        self.vertebrae[level.index()].bone.centroid()
    }

    /// Anatomical directions of a vertebra in the source frame.
    #[must_use]
    pub fn frame(&self, level: Level) -> &AnatomicalFrame {
        &self.vertebrae[level.index()].frame
    }

    /// A pedicle in the source frame; none where it could not be measured.
    #[must_use]
    pub fn pedicle(&self, level: Level, side: Side) -> Option<&Pedicle> {
        self.vertebrae[level.index()].anatomy.pedicle(side)
    }

    /// The full-resolution surface of a vertebra, ready for queries.
    #[must_use]
    pub fn surface(&self, level: Level) -> &SurfaceIndex {
        &self.vertebrae[level.index()].index
    }

    /// Whether every trajectory of a plan lies on the vertebra and the side that it names.
    ///
    /// # Errors
    /// [`SpineError::EmptyPlan`], [`SpineError::PlanOffSpine`] or [`SpineError::PlanSide`].
    pub fn check_plan(&self, plan: &Plan) -> Result<(), SpineError> {
        if plan.trajectories.is_empty() {
            return Err(SpineError::EmptyPlan);
        }
        for trajectory in &plan.trajectories {
            let bone = &self.vertebrae[trajectory.level.index()].bone;
            let (entry, tip) = (trajectory.entry_mm, trajectory.tip_mm);
            let distance_mm = [entry, nalgebra::center(&entry, &tip), tip]
                .iter()
                .map(|p| bone.distance_outside_mm(p))
                .fold(0.0, |worst, d| if d > worst { d } else { worst });
            if distance_mm > MAX_PLAN_DISTANCE_MM || distance_mm.is_nan() {
                return Err(SpineError::PlanOffSpine {
                    level: trajectory.level,
                    side: trajectory.side,
                    distance_mm,
                    max_distance_mm: MAX_PLAN_DISTANCE_MM,
                });
            }
            let frame = &self.vertebrae[trajectory.level.index()].frame;
            let distance_mm = -trajectory.side.sign() * frame.coordinates(&entry).x;
            if distance_mm > MAX_ACROSS_MM {
                return Err(SpineError::PlanSide {
                    level: trajectory.level,
                    side: trajectory.side,
                    distance_mm,
                });
            }
        }
        Ok(())
    }
}

/// A posterior approach exposes what lies behind the centroid of the vertebra's surface, which
/// splits the surface into halves of about equal area.
fn is_exposed(point: &Point3<f64>, frame: &AnatomicalFrame) -> bool {
    (point - frame.origin).dot(&frame.anterior) < 0.0
}

/// The vertices with their normals, each with its share of the area.
fn patches_of(mesh: &TriMesh) -> Vec<Patch> {
    let area_mm2 = mesh.area() / mesh.n_vertices() as f64;
    mesh.vertices()
        .iter()
        .zip(mesh.vertex_normals())
        .map(|(&point, normal)| Patch {
            point,
            normal,
            area_mm2,
        })
        .collect()
}

/// What the registration needs of one vertebra: the `v`-th of the spine `whole`.
fn prepared(
    v: usize,
    vertebra: &SourceVertebra,
    (frame, basis): (AnatomicalFrame, &Arc<ShapeBasis>),
    landmark: Point3<f64>,
    whole: &SourceView,
) -> Result<Vertebra, SpineError> {
    let bone = BoneSurface::new(&vertebra.surface)?;
    let index = Arc::new(SurfaceIndex::new(&vertebra.surface).map_err(mesh_error)?);
    let coarse_mesh = part_of(whole, v as u8)?;
    check_landmark(&bone, &landmark, vertebra.level)?;
    let vertices = whole.shape.mesh.vertices().iter();
    let samples: Vec<Point3<f64>> = vertices
        .zip(&whole.vertebra_of_vertex)
        .filter(|(_, owner)| **owner as usize == v)
        .map(|(p, _)| *p)
        .collect();
    Ok(Vertebra {
        level: vertebra.level,
        bends: Bends::of(&bone)?,
        bone,
        coarse: BoneSurface::new(&coarse_mesh)?,
        anatomy: Anatomy::new(&vertebra.surface, Arc::clone(&index), &frame),
        index,
        landmark,
        area_mm2: vertebra.surface.area(),
        is_posterior: samples.iter().map(|p| is_exposed(p, &frame)).collect(),
        samples,
        patches: patches_of(&coarse_mesh),
        shape_basis: Arc::clone(basis),
        frame,
    })
}

/// The simplified surface of one vertebra.
fn part_of(whole: &SourceView, vertebra: u8) -> Result<TriMesh, SpineError> {
    let mesh = &whole.shape.mesh;
    let faces: Vec<u32> = (0..mesh.n_faces() as u32)
        .filter(|&f| {
            let corner = mesh.faces()[f as usize][0];
            whole.vertebra_of_vertex[corner as usize] == vertebra
        })
        .collect();
    Ok(mesh.submesh_of_faces(&faces).map_err(mesh_error)?.mesh)
}

fn mesh_error(error: pedicle_mesh::MeshError) -> SpineError {
    SpineError::Mesh {
        shape: Shape::Source,
        error,
    }
}

fn sorted_by_level(mut vertebrae: Vec<SourceVertebra>) -> Result<Vec<SourceVertebra>, SpineError> {
    vertebrae.sort_by_key(|v| v.level);
    if let Some(pair) = vertebrae
        .windows(2)
        .find(|pair| pair[0].level == pair[1].level)
    {
        return Err(SpineError::DoubledLevel {
            level: pair[0].level,
        });
    }
    let missing = Level::ALL
        .into_iter()
        .find(|level| !vertebrae.iter().any(|v| v.level == *level));
    missing.map_or(Ok(vertebrae), |level| {
        Err(SpineError::MissingLevel { level })
    })
}

/// One landmark for each of L1 to L5, in this order.
fn landmarks_by_level(landmarks: &Landmarks, shape: Shape) -> Result<Vec<Point3<f64>>, SpineError> {
    Level::ALL
        .into_iter()
        .zip(given_by_level(landmarks, shape)?)
        .map(|(level, landmark)| landmark.ok_or(SpineError::MissingLandmark { shape, level }))
        .collect()
}

/// The landmarks of L1 to L5, in this order, as far as they are given.
pub(crate) fn given_by_level(
    landmarks: &Landmarks,
    shape: Shape,
) -> Result<Vec<Option<Point3<f64>>>, SpineError> {
    let mut points = Vec::with_capacity(Level::ALL.len());
    for level in Level::ALL {
        let mut of_level = landmarks.landmarks.iter().filter(|l| l.level == level);
        let Some(landmark) = of_level.next() else {
            points.push(None);
            continue;
        };
        if of_level.next().is_some() {
            return Err(SpineError::DoubledLandmark { shape, level });
        }
        if !landmark.position_mm.coords.iter().all(|c| c.is_finite()) {
            return Err(SpineError::NonFiniteLandmark { shape, level });
        }
        points.push(Some(landmark.position_mm));
    }
    Ok(points)
}

fn check_landmark(
    bone: &BoneSurface,
    landmark: &Point3<f64>,
    level: Level,
) -> Result<(), SpineError> {
    let distance_mm = bone.vertex_distance_mm(landmark);
    if distance_mm > MAX_LANDMARK_DISTANCE_MM {
        return Err(SpineError::LandmarkFarFromSurface {
            shape: Shape::Source,
            level,
            distance_mm,
            max_distance_mm: MAX_LANDMARK_DISTANCE_MM,
        });
    }
    Ok(())
}

//! The open wound: bones where they have moved to, soft tissue, and the window between the
//! retractors.
//!
//! ```text
//! (u, v, w) = ((p - o)·left, (p - o)·up, (p - o)·posterior)
//! ```
//!
//! o lies in the middle of the tips of the spinous processes. The window is a rectangle in u and v
//! with upright walls, open at the height of the skin. Lengths in mm; all in the frame of the source
//! after the motion of the vertebrae.

use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_mesh::{RayHit, SurfaceIndex, TriMesh, concatenate};
use rand::{Rng, RngExt};

use crate::coverage::is_posterior;
use crate::{SimulationError, SpineCase};

/// Width of the window, mm.
const WIDTH_MM: [f64; 2] = [60.0, 120.0];
/// How far the window's middle may lie off the midline, mm.
const LARGEST_OFFSET_MM: f64 = 5.0;
/// The window reaches beyond the highest and the lowest landmark by this much, mm.
const BEYOND_LANDMARKS_MM: f64 = 25.0;
/// The skin lies this far behind the most prominent spinous process, mm.
const SKIN_MM: f64 = 15.0;

/// The frame of the wound and its window.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wound {
    pub(crate) origin: Point3<f64>,
    pub(crate) left: Vector3<f64>,
    pub(crate) up: Vector3<f64>,
    pub(crate) posterior: Vector3<f64>,
    /// Half of the window along u and v, mm.
    pub(crate) half: [f64; 2],
    /// Height of the skin along w, mm.
    pub(crate) skin: f64,
}

impl Wound {
    /// The wound over the landmarks of a spine whose vertebrae have moved by `bends`.
    pub(crate) fn draw(
        case: &SpineCase,
        bends: &[Isometry3<f64>],
        rng: &mut impl Rng,
    ) -> Result<Self, SimulationError> {
        let landmarks: Vec<Point3<f64>> = case
            .landmark_positions()
            .iter()
            .zip(bends)
            .map(|(p, bend)| bend * p)
            .collect();
        let (_, up) = case.axis_through_ends()?;
        let sum: Vector3<f64> = case.axes().iter().map(|axes| axes.anterior).sum();
        let forward = sum - up * sum.dot(&up);
        let anterior = forward
            .try_normalize(1e-6)
            .ok_or(SimulationError::DegenerateDirection {
                direction: "anterior",
                distance_mm: forward.norm(),
            })?;
        let mut wound = Self {
            origin: landmarks[0],
            left: up.cross(&anterior),
            up,
            posterior: -anterior,
            half: [0.0; 2],
            skin: 0.0,
        };
        let local: Vec<[f64; 3]> = landmarks.iter().map(|p| wound.local(p)).collect();
        let range = |k: usize| {
            local.iter().fold((f64::MAX, f64::MIN), |(low, high), x| {
                (
                    if x[k] < low { x[k] } else { low },
                    if x[k] > high { x[k] } else { high },
                )
            })
        };
        let ([low_u, high_u], [low_v, high_v], [low_w, high_w]) = {
            let pair = |(a, b)| [a, b];
            (pair(range(0)), pair(range(1)), pair(range(2)))
        };
        let offset = rng.random_range(-LARGEST_OFFSET_MM..=LARGEST_OFFSET_MM);
        let middle = [
            0.5 * (low_u + high_u) + offset,
            0.5 * (low_v + high_v),
            0.5 * (low_w + high_w),
        ];
        wound.origin = wound.global(middle);
        wound.half = [
            0.5 * rng.random_range(WIDTH_MM[0]..=WIDTH_MM[1]),
            0.5 * (high_v - low_v) + BEYOND_LANDMARKS_MM,
        ];
        wound.skin = 0.5 * (high_w - low_w) + SKIN_MM;
        Ok(wound)
    }

    pub(crate) fn local(&self, p: &Point3<f64>) -> [f64; 3] {
        let d = p - self.origin;
        [d.dot(&self.left), d.dot(&self.up), d.dot(&self.posterior)]
    }

    pub(crate) fn global(&self, [u, v, w]: [f64; 3]) -> Point3<f64> {
        self.origin + self.left * u + self.up * v + self.posterior * w
    }

    /// Whether a point lies between the walls of the window.
    pub(crate) fn is_between_walls(&self, p: &Point3<f64>) -> bool {
        let [u, v, _] = self.local(p);
        u.abs() <= self.half[0] && v.abs() <= self.half[1]
    }

    /// Whether the ray enters the wound through its window in the skin.
    pub(crate) fn is_entered(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> bool {
        let sink = -direction.dot(&self.posterior);
        let above = self.local(origin)[2] - self.skin;
        sink > 0.0 && self.is_between_walls(&(origin + direction * (above / sink)))
    }
}

/// What a ray can meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Material {
    /// A vertebra, by its place in the case, behind its centroid.
    Bone(usize),
    /// Bone in front of that: it lies under ligaments and muscles that are not modelled.
    DeepBone,
    /// Soft tissue left on the bone.
    SoftTissue,
}

/// Everything that stops rays, in one hierarchy.
pub(crate) struct Scene<'a> {
    case: &'a SpineCase,
    bends: &'a [Isometry3<f64>],
    centroids: Vec<Point3<f64>>,
    index: SurfaceIndex,
    /// The first face behind each vertebra's.
    ends: Vec<usize>,
}

impl<'a> Scene<'a> {
    pub(crate) fn new(
        case: &'a SpineCase,
        bends: &'a [Isometry3<f64>],
        soft_tissue: Option<&TriMesh>,
    ) -> Result<Self, SimulationError> {
        let bones: Vec<TriMesh> = case
            .vertebrae()
            .iter()
            .zip(bends)
            .map(|(vertebra, bend)| vertebra.surface.transformed(bend))
            .collect();
        let mut end = 0;
        let ends = bones
            .iter()
            .map(|bone| {
                end += bone.n_faces();
                end
            })
            .collect();
        let all: Vec<&TriMesh> = bones.iter().chain(soft_tissue).collect();
        let centroids = case.vertebrae().iter().map(|v| v.mesh.centroid()).collect();
        Ok(Self {
            case,
            bends,
            centroids,
            index: SurfaceIndex::new(&concatenate(&all)?)?,
            ends,
        })
    }

    /// The first thing on the way.
    pub(crate) fn cast(
        &self,
        origin: &Point3<f64>,
        direction: &Vector3<f64>,
        reach_mm: f64,
    ) -> Option<(RayHit, Material)> {
        let hit = self.index.cast_ray(origin, direction, reach_mm)?;
        let vertebra = self.ends.partition_point(|&end| end <= hit.face as usize);
        let material = if vertebra == self.ends.len() {
            Material::SoftTissue
        } else {
            let p = self.bends[vertebra].inverse_transform_point(&hit.point);
            let centroid = &self.centroids[vertebra];
            if is_posterior(&p, centroid, &self.case.axes()[vertebra]) {
                Material::Bone(vertebra)
            } else {
                Material::DeepBone
            }
        };
        Some((hit, material))
    }
}

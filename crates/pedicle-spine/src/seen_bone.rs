//! A bone as a camera sees it: where the ray of a measured point meets its surface.
//!
//! ```text
//! r = (p - q) · n,   q = first place of the surface on the ray from the camera through p
//! ```
//!
//! A camera errs along its rays, so r has mean zero under the right pose; where it errs more on steep surfaces, by one over
//! the cosine as is taken here, r varies as much on steep surfaces as on flat ones. The distance to the closest place of the
//! surface has not: a point moved along a ray by more than the bone is curved lies closer to some other place,
//! and outside a curved bone on average. Lengths in mm.

use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_mesh::SurfaceIndex;
use rayon::prelude::*;

use crate::bone::BoneSurface;
use crate::model::Vertebra;
use crate::scoring::{MIN_POINTS_A_TASK, UNASSIGNED};

/// Surfaces seen at a smaller cosine tell nothing: a small change of the pose moves the place seen far along them.
const LEAST_COSINE: f64 = 0.2;

/// A bone whose surface rays can be shot at.
#[derive(Clone, Copy)]
pub(crate) struct SeenBone<'a> {
    pub(crate) bone: &'a BoneSurface,
    pub(crate) index: &'a SurfaceIndex,
}

/// A camera before a bone in some pose, in the frame of the bone.
pub(crate) struct Sight<'a> {
    seen: SeenBone<'a>,
    source_from_target: Isometry3<f64>,
    camera: Point3<f64>,
}

/// Where the ray of a point meets the bone, source frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RayHit {
    pub(crate) point: Point3<f64>,
    /// Unit length, towards the camera.
    pub(crate) normal: Vector3<f64>,
    /// r, positive if the measured point lies in front of the bone.
    pub(crate) residual_mm: f64,
    /// Of the angle between the normal and the ray.
    pub(crate) cosine: f64,
    /// From the camera to the bone.
    pub(crate) range_mm: f64,
}

impl<'a> SeenBone<'a> {
    pub(crate) fn of(vertebra: &'a Vertebra) -> Self {
        Self {
            bone: &vertebra.bone,
            index: &vertebra.index,
        }
    }

    /// The bone in a pose before a camera, given in the target frame.
    pub(crate) fn before(self, camera_mm: &Point3<f64>, pose: &Isometry3<f64>) -> Sight<'a> {
        let source_from_target = pose.inverse();
        Sight {
            seen: self,
            camera: source_from_target * camera_mm,
            source_from_target,
        }
    }
}

impl Sight<'_> {
    /// How far two places of the bone lie apart as the camera sees it: across the ray to the first.
    pub(crate) fn apart_mm(&self, a: &Point3<f64>, b: &Point3<f64>) -> f64 {
        let ray = (a - self.camera).normalize();
        (b - a).cross(&ray).norm()
    }

    /// Where the ray of a measured point of the target frame meets the bone; none if it passes it, meets it too steeply or
    /// farther from the point than `reach_mm`.
    pub(crate) fn hit(&self, point: &Point3<f64>, reach_mm: f64) -> Option<RayHit> {
        let local = self.source_from_target * point;
        let bone = self.seen.bone;
        let steepest_mm = reach_mm / LEAST_COSINE;
        let way = local - self.camera;
        let measured_mm = way.norm();
        let ray = way / measured_mm;
        // The ray must pass the ball around the bone.
        let to_center = bone.centroid() - self.camera;
        let along_mm = to_center.dot(&ray);
        let radius_mm = bone.radius_mm();
        if (to_center - ray * along_mm).norm_squared() > radius_mm * radius_mm
            || (measured_mm - along_mm).abs() > radius_mm + steepest_mm
        {
            return None;
        }
        let hit = self
            .seen
            .index
            .cast_ray(&self.camera, &ray, measured_mm + steepest_mm)?;
        let normal = bone.normal_at(hit.face, &hit.point).unwrap_or(hit.normal);
        let cosine = -normal.dot(&ray);
        let residual_mm = cosine * (hit.distance_mm - measured_mm);
        (cosine >= LEAST_COSINE && residual_mm.abs() <= reach_mm).then_some(RayHit {
            point: hit.point,
            normal,
            residual_mm,
            cosine,
            range_mm: hit.distance_mm,
        })
    }
}

/// The vertebra that the ray of every point meets first, if the point lies within `reach_mm` of it.
pub(crate) fn first_met(
    vertebrae: &[Vertebra],
    poses: &[Isometry3<f64>],
    points: &[Point3<f64>],
    (camera_mm, reach_mm): (&Point3<f64>, f64),
) -> Vec<u8> {
    let sights: Vec<Sight<'_>> = vertebrae
        .iter()
        .zip(poses)
        .map(|(vertebra, pose)| SeenBone::of(vertebra).before(camera_mm, pose))
        .collect();
    points
        .par_iter()
        .with_min_len(MIN_POINTS_A_TASK)
        .map(|p| {
            let mut first = (UNASSIGNED, f64::INFINITY);
            for (v, sight) in sights.iter().enumerate() {
                if let Some(hit) = sight.hit(p, reach_mm)
                    && hit.range_mm < first.1
                {
                    first = (v as u8, hit.range_mm);
                }
            }
            first.0
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pedicle_mesh::TriMesh;

    /// A square of 40 mm in the plane y = 0 that looks along y.
    fn square() -> TriMesh {
        let corners = [(-20.0, -20.0), (20.0, -20.0), (20.0, 20.0), (-20.0, 20.0)];
        let vertices = corners.map(|(x, z)| Point3::new(x, 0.0, z)).to_vec();
        TriMesh::new(vertices, vec![[0, 2, 1], [0, 3, 2]]).unwrap()
    }

    #[test]
    fn distances_are_along_the_ray_and_at_right_angles_to_the_surface() {
        let mesh = square();
        let bone = BoneSurface::new(&mesh).unwrap();
        let index = SurfaceIndex::new(&mesh).unwrap();
        let seen = SeenBone {
            bone: &bone,
            index: &index,
        };
        let pose = Isometry3::new(Vector3::new(3.0, -8.0, 5.0), Vector3::new(0.4, 0.2, -1.0));
        // 45° to the normal.
        let camera = Point3::new(100.0, 100.0, 0.0);
        let sight = seen.before(&(pose * camera), &pose);
        for along_mm in [-2.0, 0.0, 3.0] {
            let ray = (Point3::origin() - camera).normalize();
            let point = Point3::origin() + ray * along_mm;
            let hit = sight
                .hit(&(pose * point), 10.0)
                .expect("the ray meets the square");
            let expected = -along_mm * 0.5f64.sqrt();
            assert!(
                (hit.residual_mm - expected).abs() < 1e-9 && hit.point.coords.norm() < 1e-9,
                "{along_mm} mm along the ray: {hit:?}"
            );
            assert!((hit.cosine - 0.5f64.sqrt()).abs() < 1e-12, "{hit:?}");
        }
        let beside = pose * Point3::new(-40.0, 0.0, 0.0);
        assert!(sight.hit(&beside, 10.0).is_none(), "the ray passes it");
        let behind = pose * Point3::new(-19.0, -19.0, 0.0);
        assert!(sight.hit(&behind, 10.0).is_none(), "too far behind it");
        let from_below = seen.before(&(pose * Point3::new(0.0, -100.0, 0.0)), &pose);
        let middle = pose * Point3::origin();
        assert!(from_below.hit(&middle, 10.0).is_none(), "its back");
        let flat = seen.before(&(pose * Point3::new(100.0, 10.0, 0.0)), &pose);
        assert!(flat.hit(&middle, 10.0).is_none(), "too steep a surface");
    }
}

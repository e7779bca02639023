//! What the points of a camera tell of themselves: neighbours in the picture, normals, noise.
//!
//! ```text
//! ρ(s, t) = a + b s + c t + d s² + e s t + f t²,   σ = median over patches of cos θ × deviation of ρ
//! ```
//!
//! ρ is the range, s and t the place in the picture, in mm at the distance of the points; a patch are the 24 points
//! nearest there. A camera errs along its rays, so neither who is whose neighbour nor s and t depend on
//! the noise: unlike with patches of nearest points in space, which prefer points that err alike, slope and noise are
//! told without bias. The normal follows from b and c of a plane, θ is its angle against the ray.

use kiddo::ImmutableKdTree;
use nalgebra::{Matrix3, Matrix6, Point3, Vector3, Vector6};
use rayon::prelude::*;

use crate::errs_alike::{ErrsAlike, Patch};
use crate::free_space::image_axes;
use crate::local_shape::{Local, PATCH_NEIGHBORS, PointArea, patch_of, tree_of};
use crate::verdict_noise::median;
use crate::{SensorView, SpineError};

/// Unknowns of the quadric.
const QUADRIC_UNKNOWNS: usize = 6;
/// Points at which the noise is estimated.
const NOISE_SAMPLES: usize = 400;
/// Grazing rays are no noisier than at this cosine.
const LEAST_COSINE: f64 = 0.2;

/// A picture made of points.
struct Picture {
    /// To the right of it.
    right: Vector3<f64>,
    /// s and t of every point, mm, and a zero.
    places: Vec<Point3<f64>>,
    /// Of the places, mm.
    depth_mm: f64,
    /// From the camera, mm.
    ranges: Vec<f64>,
    /// Unit vectors from the camera.
    rays: Vec<Vector3<f64>>,
    tree: ImmutableKdTree<f64, 3>,
}

impl Picture {
    /// None without points in front of the camera.
    fn new(points: &[Point3<f64>], view: &SensorView) -> Result<Option<Self>, SpineError> {
        let ways: Vec<Vector3<f64>> = points.iter().map(|p| p - view.camera_mm).collect();
        let sum: Vector3<f64> = ways.iter().sum();
        let Some(forward) = sum.try_normalize(f64::MIN_POSITIVE) else {
            return Ok(None);
        };
        let depths: Vec<f64> = ways.iter().map(|way| way.dot(&forward)).collect();
        if !depths.iter().all(|&depth| depth > 0.0) {
            return Ok(None);
        }
        let [right, down, _] = image_axes(&forward);
        let depth_mm = median(depths.clone());
        let places: Vec<Point3<f64>> = ways
            .iter()
            .zip(&depths)
            .map(|(way, depth)| {
                let scale = depth_mm / depth;
                Point3::new(scale * way.dot(&right), scale * way.dot(&down), 0.0)
            })
            .collect();
        let tree = tree_of(&places)?;
        let ranges: Vec<f64> = ways.iter().map(Vector3::norm).collect();
        Ok(Some(Self {
            right,
            places,
            depth_mm,
            rays: ways.iter().zip(&ranges).map(|(w, r)| w / *r).collect(),
            ranges,
            tree,
        }))
    }

    /// The points nearest to one in the picture, the nearest first, and how far the last one is, mm.
    fn patch(&self, p: usize) -> (Vec<u32>, f64) {
        let patch = patch_of(&self.tree, &self.places[p]);
        let radius_mm = patch.last().map_or(f64::INFINITY, |(d, _)| d.sqrt());
        (patch.into_iter().map(|(_, i)| i).collect(), radius_mm)
    }

    /// Ranges around a point over places relative to it, stretched to its own distance.
    fn around(&self, p: usize, patch: &[u32]) -> Patch {
        let own = self.places[p];
        let scale = self.ranges[p] / self.depth_mm;
        patch
            .iter()
            .map(|&q| {
                let aside = self.places[q as usize] - own;
                (scale * aside.x, scale * aside.y, self.ranges[q as usize])
            })
            .collect()
    }

    /// Towards the camera. Where no plane has a slope, towards the camera itself.
    fn normal(&self, p: usize, patch: &[u32]) -> Vector3<f64> {
        let ray = self.rays[p];
        let (b, c, _) = slope(&self.around(p, patch)).unwrap_or((0.0, 0.0, 0.0));
        let right = (self.right - ray * ray.dot(&self.right)).normalize();
        let down = ray.cross(&right);
        (right * b + down * c - ray).normalize()
    }

    /// Deviation of a patch along the normal, mm.
    fn noise_mm(&self, p: usize, patch: &[u32]) -> Option<f64> {
        let around = self.around(p, patch);
        let (b, c, spread) = slope(&around)?;
        let deviation_mm = quadric_deviation(&around)?;
        // Noise alone has a slope as well.
        let squared = b * b + c * c - spread * deviation_mm * deviation_mm;
        let squared = if squared > 0.0 { squared } else { 0.0 };
        let cosine = 1.0 / (1.0 + squared).sqrt();
        let cosine = if cosine > LEAST_COSINE {
            cosine
        } else {
            LEAST_COSINE
        };
        Some(cosine * deviation_mm)
    }
}

/// None if the points lie so far apart that half of the patches are larger than this radius.
pub(crate) fn image_shape(
    points: &[Point3<f64>],
    view: &SensorView,
    largest_patch_mm: f64,
) -> Result<Option<Local>, SpineError> {
    let Some(picture) = Picture::new(points, view)? else {
        return Ok(None);
    };
    let (patches, radii): (Vec<Vec<u32>>, Vec<f64>) = (0..points.len())
        .into_par_iter()
        .map(|p| picture.patch(p))
        .unzip();
    let radius_mm = median(radii);
    if radius_mm.is_nan() || radius_mm > largest_patch_mm {
        return Ok(None);
    }
    let normals = patches
        .par_iter()
        .enumerate()
        .map(|(p, patch)| picture.normal(p, patch))
        .collect();
    let stride = points.len().div_ceil(NOISE_SAMPLES).max(1);
    let noise: Vec<f64> = (0..points.len())
        .step_by(stride)
        .filter_map(|p| picture.noise_mm(p, &patches[p]))
        .collect();
    let around: Vec<Patch> = (0..points.len())
        .step_by(stride)
        .map(|p| picture.around(p, &patches[p]))
        .collect();
    let mm2 = std::f64::consts::PI * radius_mm * radius_mm / PATCH_NEIGHBORS as f64;
    let alike = ErrsAlike::of_patches(&around, mm2);
    Ok(Some(Local {
        noise_mm: alike.noise_ratio * median(noise),
        alike,
        area_of_point: PointArea {
            mm2,
            depth_mm: picture.depth_mm,
        },
        normals,
        patches,
    }))
}

/// b and c of the plane, and the variance of both together over that of the ranges, 1/mm².
fn slope(patch: &Patch) -> Option<(f64, f64, f64)> {
    let mean = patch.iter().fold(0.0, |sum, (.., range)| sum + range) / patch.len().max(1) as f64;
    let mut matrix = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for &(s, t, range) in patch {
        let row = Vector3::new(1.0, s, t);
        matrix.ger(1.0, &row, &row, 1.0);
        right += row * (range - mean);
    }
    let inverse = matrix.cholesky()?.inverse();
    let solution = inverse * right;
    Some((solution[1], solution[2], inverse[(1, 1)] + inverse[(2, 2)]))
}

/// Deviation of the ranges from their best quadric, corrected for its unknowns.
fn quadric_deviation(patch: &Patch) -> Option<f64> {
    if patch.len() <= QUADRIC_UNKNOWNS {
        return None;
    }
    let mean = patch.iter().fold(0.0, |sum, (.., range)| sum + range) / patch.len() as f64;
    let mut matrix = Matrix6::zeros();
    let mut right = Vector6::zeros();
    let mut sum = 0.0;
    for &(s, t, range) in patch {
        let w = range - mean;
        let row = Vector6::new(1.0, s, t, s * s, s * t, t * t);
        matrix.ger(1.0, &row, &row, 1.0);
        right += row * w;
        sum += w * w;
    }
    let rest = sum - matrix.cholesky()?.solve(&right).dot(&right);
    let rest = if rest > 0.0 { rest } else { 0.0 };
    Some((rest / (patch.len() - QUADRIC_UNKNOWNS) as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::local_shape::local_shape;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const NOISE_MM: f64 = 1.5;

    /// A plane turned by 40° against a camera at the origin, 500 mm away, with noise along the rays.
    fn plane() -> (Vec<Point3<f64>>, Vector3<f64>) {
        let (sine, cosine) = 40f64.to_radians().sin_cos();
        let normal = Vector3::new(sine, 0.0, -cosine);
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut normal_draw = || (0..12).map(|_| rng.random_range(0.0..1.0)).sum::<f64>() - 6.0;
        let points = (0..60 * 60)
            .map(|k| {
                let (i, j) = (f64::from(k % 60) - 30.0, f64::from(k / 60) - 30.0);
                let ray = Vector3::new(0.002 * i, 0.002 * j, 1.0).normalize();
                let steep = -normal.dot(&ray);
                let range = 500.0 * cosine / steep + NOISE_MM * normal_draw() / steep;
                Point3::from(ray * range)
            })
            .collect();
        (points, normal)
    }

    #[test]
    fn slope_and_noise_are_told_without_bias() {
        let (points, normal) = plane();
        let view = SensorView {
            camera_mm: Point3::origin(),
        };
        let found = image_shape(&points, &view, 5.0).unwrap().expect("dense");
        let ratio = found.noise_mm / NOISE_MM;
        assert!((0.93..1.05).contains(&ratio), "{ratio} of the noise");
        let in_space = local_shape(&points, 5.0).unwrap().expect("dense");
        let biased = in_space.noise_mm / NOISE_MM;
        assert!(biased < 0.9, "neighbours in space tell {biased} of it");
        let mean = found.normals.iter().sum::<Vector3<f64>>().normalize();
        let off = mean.angle(&normal).to_degrees();
        assert!(off < 2.0, "the mean normal is {off}° off");
        assert!(
            found
                .patches
                .iter()
                .enumerate()
                .all(|(p, patch)| patch[0] == p as u32),
            "a point is the nearest to itself"
        );
        let spacing_mm2 = 1.0;
        assert!(
            (found.area_of_point.mm2 / spacing_mm2 - 1.0).abs() < 0.15,
            "a point stands for {} mm²",
            found.area_of_point.mm2
        );
    }

    #[test]
    fn no_picture_of_points_that_lie_apart_or_around_the_camera() {
        let (points, _) = plane();
        let at = |camera_mm| SensorView { camera_mm };
        let far = image_shape(&points, &at(Point3::origin()), 1.0).unwrap();
        assert!(far.is_none(), "patches of more than 1 mm");
        let amid = image_shape(&points, &at(points[1800]), 5.0).unwrap();
        assert!(amid.is_none(), "the camera stands among the points");
    }
}

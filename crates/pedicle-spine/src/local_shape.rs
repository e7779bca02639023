//! What dense points tell of themselves: which of them float alone, their normals, their noise.
//!
//! ```text
//! alone: mean distance to the 8 nearest points > 3 × its median over all points
//! σ = median over patches of |z - a - bx - cy - dx² - exy - fy²|, corrected for six unknowns
//! ```
//!
//! Points of a camera that float alone are flying pixels between front and back; after Rusu et al. 2008,
//! with the median in place of mean and deviation, which the very points to remove would inflate. A patch
//! is the 24 points nearest to one; x, y and z are along its own axes. Lengths in mm.

use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Matrix3, Matrix6, Point3, Vector3, Vector6};
use rayon::prelude::*;

use crate::SpineError;
use crate::errs_alike::ErrsAlike;
use crate::points::PointSet;
use crate::verdict_noise::median;

/// Neighbours whose mean distance tells whether a point floats alone.
const NEIGHBORS: usize = 8;
/// Times the median from which on it does.
const ALONE_RATIO: f64 = 3.0;
/// Neighbours that a quadric and a plane are fitted to.
pub(crate) const PATCH_NEIGHBORS: usize = 24;
/// Unknowns of the quadric.
const QUADRIC_UNKNOWNS: usize = 6;
/// Points at which the noise is estimated.
const NOISE_SAMPLES: usize = 400;

pub(crate) fn tree_of(points: &[Point3<f64>]) -> Result<ImmutableKdTree<f64, 3>, SpineError> {
    let rows: Vec<[f64; 3]> = points.iter().map(|p| p.coords.into()).collect();
    ImmutableKdTree::new_from_slice(&rows).map_err(|e| SpineError::Index {
        reason: format!("{e:?}"),
    })
}

/// The points of a patch, the nearest first, with their squared distances.
pub(crate) fn patch_of(tree: &ImmutableKdTree<f64, 3>, p: &Point3<f64>) -> Vec<(f64, u32)> {
    let row: [f64; 3] = p.coords.into();
    let wanted = NonZero::<usize>::MIN.saturating_add(PATCH_NEIGHBORS - 1);
    let found = tree
        .query(&row)
        .nearest_n::<SquaredEuclidean<f64>>(wanted)
        .execute();
    let mut patch: Vec<(f64, u32)> = found
        .into_iter()
        .map(|item| (item.distance, item.item))
        .collect();
    // Ties may come in any order, and sums depend on it.
    patch.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    patch
}

/// Indices of the points that do not float alone.
pub(crate) fn not_alone(points: &[Point3<f64>]) -> Result<Vec<usize>, SpineError> {
    let tree = tree_of(points)?;
    let wanted = NonZero::<usize>::MIN.saturating_add(NEIGHBORS);
    let spread: Vec<f64> = points
        .par_iter()
        .map(|p| {
            let row: [f64; 3] = p.coords.into();
            let found = tree
                .query(&row)
                .nearest_n::<SquaredEuclidean<f64>>(wanted)
                .execute();
            let sum: f64 = found.into_iter().map(|item| item.distance.sqrt()).sum();
            sum / NEIGHBORS as f64
        })
        .collect();
    let limit = ALONE_RATIO * median(spread.clone());
    Ok((0..points.len())
        .filter(|&p| is_in_company(spread[p], limit))
        .collect())
}

/// Points that all coincide are nobody's outliers.
fn is_in_company(spread_mm: f64, limit_mm: f64) -> bool {
    spread_mm <= limit_mm || limit_mm <= 0.0
}

/// Area that a point of a picture stands for, across its ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PointArea {
    pub(crate) mm2: f64,
    /// At this depth; it grows with its square.
    pub(crate) depth_mm: f64,
}

impl PointArea {
    /// Without a camera.
    const UNKNOWN: Self = Self {
        mm2: f64::NAN,
        depth_mm: f64::NAN,
    };
}

/// The noise of dense points and their normals.
#[derive(Debug)]
pub(crate) struct Local {
    /// Median over samples of the deviation of a patch from its own best quadric
    /// z = a + bx + cy + dx² + exy + fy², corrected for its six unknowns.
    pub(crate) noise_mm: f64,
    /// How far neighbours err alike; independent where no picture tells.
    pub(crate) alike: ErrsAlike,
    pub(crate) normals: Vec<Vector3<f64>>,
    pub(crate) patches: Vec<Vec<u32>>,
    pub(crate) area_of_point: PointArea,
}

/// What is around a point.
struct Around {
    /// Distance of the farthest point of its patch.
    radius_mm: f64,
    /// Mean distance of its nearest points.
    spread_mm: f64,
    /// Itself among them, the nearest first.
    patch: Vec<u32>,
}

/// Points in which patches are looked for.
struct Patches<'a> {
    points: &'a [Point3<f64>],
    tree: ImmutableKdTree<f64, 3>,
}

impl<'a> Patches<'a> {
    fn new(points: &'a [Point3<f64>]) -> Result<Self, SpineError> {
        let tree = tree_of(points)?;
        Ok(Self { points, tree })
    }

    /// The nearest points of one.
    fn around(&self, p: &Point3<f64>) -> Around {
        let patch = patch_of(&self.tree, p);
        // The point itself is the first.
        let nearest = patch.iter().take(NEIGHBORS + 1);
        let sum_mm: f64 = nearest.map(|(squared, _)| squared.sqrt()).sum();
        Around {
            radius_mm: patch.last().map_or(f64::INFINITY, |(d, _)| d.sqrt()),
            spread_mm: sum_mm / NEIGHBORS as f64,
            patch: patch.into_iter().map(|(_, i)| i).collect(),
        }
    }

    fn positions(&self, patch: &[u32]) -> Vec<Point3<f64>> {
        patch.iter().map(|&i| self.points[i as usize]).collect()
    }

    /// Median noise of some patches; none if half of them are larger than this radius.
    fn noise_mm(&self, largest_patch_mm: f64) -> Option<f64> {
        let stride = self.points.len().div_ceil(NOISE_SAMPLES).max(1);
        let samples: Vec<&Point3<f64>> = self.points.iter().step_by(stride).collect();
        let (radii, noise): (Vec<f64>, Vec<f64>) = samples
            .into_par_iter()
            .filter_map(|p| {
                let around = self.around(p);
                let positions = self.positions(&around.patch);
                Some((around.radius_mm, quadric_deviation(&positions)?))
            })
            .unzip();
        (median(radii) <= largest_patch_mm).then(|| median(noise))
    }
}

/// The noise of dense points alone; none if half of their patches are larger than this radius.
pub(crate) fn noise_of_points(
    points: &[Point3<f64>],
    largest_patch_mm: f64,
) -> Result<Option<f64>, SpineError> {
    Ok(Patches::new(points)?.noise_mm(largest_patch_mm))
}

/// None if the points lie so far apart that half of the patches are larger than this radius.
pub(crate) fn local_shape(
    points: &[Point3<f64>],
    largest_patch_mm: f64,
) -> Result<Option<Local>, SpineError> {
    let patches = Patches::new(points)?;
    let Some(noise_mm) = patches.noise_mm(largest_patch_mm) else {
        return Ok(None);
    };
    let (normals, patches) = points
        .par_iter()
        .map(|p| {
            let patch = patches.around(p).patch;
            (normal_of(&patches.positions(&patch)), patch)
        })
        .unzip();
    Ok(Some(Local {
        alike: ErrsAlike::INDEPENDENT,
        noise_mm,
        normals,
        patches,
        area_of_point: PointArea::UNKNOWN,
    }))
}

/// Points, if wished without those that float alone, with normals and patches if half of the patches are no
/// larger than this radius. One look at the neighbours for everything.
pub(crate) fn shaped(
    points: &[Point3<f64>],
    largest_patch_mm: f64,
    drops_alone: bool,
) -> Result<PointSet, SpineError> {
    let patches = Patches::new(points)?;
    let around: Vec<Around> = points.par_iter().map(|p| patches.around(p)).collect();
    let limit_mm = ALONE_RATIO * median(around.iter().map(|a| a.spread_mm).collect());
    let is_dense = median(around.iter().map(|a| a.radius_mm).collect()) <= largest_patch_mm;
    let mut places = vec![None; points.len()];
    let mut kept = Vec::with_capacity(points.len());
    for (p, around) in around.into_iter().enumerate() {
        if !drops_alone || is_in_company(around.spread_mm, limit_mm) {
            places[p] = Some(kept.len() as u32);
            kept.push((p, around.patch));
        }
    }
    let mut found = PointSet {
        positions: kept.iter().map(|(p, _)| points[*p]).collect(),
        ..PointSet::default()
    };
    if is_dense {
        let shapes = kept.into_par_iter().map(|(_, mut patch)| {
            patch.retain(|&q| places[q as usize].is_some());
            let normal = normal_of(&patches.positions(&patch));
            let patch = patch.into_iter().filter_map(|q| places[q as usize]);
            (normal, patch.collect::<Vec<u32>>())
        });
        (found.normals, found.patches) = shapes.unzip();
    }
    Ok(found)
}

fn normal_of(patch: &[Point3<f64>]) -> Vector3<f64> {
    plane_of(patch).1.column(0).into_owned()
}

/// The mean of some points and the axes of their spread: the normal of their plane and two in it.
fn plane_of(patch: &[Point3<f64>]) -> (Vector3<f64>, Matrix3<f64>) {
    let n = patch.len().max(1) as f64;
    let mean = patch.iter().map(|p| p.coords).sum::<Vector3<f64>>() / n;
    let scatter: Matrix3<f64> = patch
        .iter()
        .map(|p| (p.coords - mean) * (p.coords - mean).transpose())
        .sum();
    let eigen = scatter.symmetric_eigen();
    let low = eigen.eigenvalues.imin();
    let axes = [0, 1, 2].map(|k| eigen.eigenvectors.column((low + k) % 3).into_owned());
    (mean, Matrix3::from_columns(&axes))
}

fn quadric_deviation(patch: &[Point3<f64>]) -> Option<f64> {
    let n = patch.len();
    if n <= QUADRIC_UNKNOWNS {
        return None;
    }
    let (mean, axes) = plane_of(patch);
    let mut normal_matrix = Matrix6::zeros();
    let mut right = Vector6::zeros();
    let mut sum = 0.0;
    for p in patch {
        let d = p.coords - mean;
        let (w, u, v) = (
            d.dot(&axes.column(0)),
            d.dot(&axes.column(1)),
            d.dot(&axes.column(2)),
        );
        let row = Vector6::new(1.0, u, v, u * u, u * v, v * v);
        normal_matrix.ger(1.0, &row, &row, 1.0);
        right += row * w;
        sum += w * w;
    }
    let solution = normal_matrix.cholesky()?.solve(&right);
    let rest = sum - solution.dot(&right);
    let rest = if rest > 0.0 { rest } else { 0.0 };
    Some((rest / (n - QUADRIC_UNKNOWNS) as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bumpy sheet of points a millimetre apart, and one far in front of it.
    fn sheet() -> Vec<Point3<f64>> {
        let mut points: Vec<Point3<f64>> = (0..900)
            .map(|i| {
                let (x, y) = (f64::from(i % 30), f64::from(i / 30));
                Point3::new(
                    x,
                    y,
                    0.01 * (x - y) * (x - y) + 0.3 * (7.1 * x + 3.3 * y).sin(),
                )
            })
            .collect();
        points.insert(100, Point3::new(15.0, 15.0, 40.0));
        points
    }

    #[test]
    fn one_look_at_the_neighbours_gives_what_several_give() {
        let points = sheet();
        let kept = not_alone(&points).unwrap();
        assert_eq!(kept.len(), 900, "one floats alone");
        let positions: Vec<Point3<f64>> = kept.iter().map(|&p| points[p]).collect();
        let local = local_shape(&positions, 5.0).unwrap().expect("dense");
        let found = shaped(&points, 5.0, true).unwrap();
        assert_eq!(found.positions, positions, "without the one");
        assert_eq!(found.patches, local.patches, "the same patches");
        assert_eq!(found.normals, local.normals, "the same normals");
        let noise_mm = noise_of_points(&positions, 5.0).unwrap();
        assert_eq!(noise_mm, Some(local.noise_mm), "the same noise");

        let all = shaped(&points, 5.0, false).unwrap();
        assert_eq!(all.positions, points, "nobody is dropped");
        let coarse = shaped(&points, 2.0, true).unwrap();
        assert!(coarse.normals.is_empty(), "too far apart for normals");
        assert_eq!(noise_of_points(&points, 2.0).unwrap(), None, "nor noise");
    }
}

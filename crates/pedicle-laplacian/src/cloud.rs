//! Triangles for a cloud of points.
//!
//! Every point takes its k nearest neighbours, the plane of the two largest principal axes, and the
//! Delaunay triangulation of these points in the plane; the triangles at the point itself are kept.
//! Where the triangulations of the three corners agree, a triangle occurs three times, so that each
//! occurrence counts a third. Lengths are those in space. Sharp & Crane 2020, section 5.

use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

use crate::OperatorError;
use crate::star::{PlanePoint, delaunay_star};

/// Fewest points that make a surface, and fewest neighbours that make a fan.
pub(crate) const MIN_POINTS: usize = 3;

/// Largest weight that breaks ties among points on one circle, as a share of the squared distance
/// from a point to its nearest neighbour: far above rounding, far below what changes a spectrum.
const TIE_WEIGHT: f64 = 1e-6;

/// A neighbour whose offset in the plane is less than this share of its distance lies over the point.
const OVERHEAD: f64 = 1e-2;

/// The cloud with one point at each place.
pub(crate) struct DistinctPoints {
    /// Positions, in the order of the input.
    pub(crate) positions: Vec<Point3<f64>>,
    /// For every distinct point, its first index in the input.
    pub(crate) source: Vec<u32>,
    /// For every point of the input, its distinct point.
    pub(crate) distinct_of: Vec<u32>,
}

/// Checks a cloud and merges points at the same place.
pub(crate) fn distinct_points(points: &[Point3<f64>]) -> Result<DistinctPoints, OperatorError> {
    if let Some(point) = points.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        let [x, y, z] = [0, 1, 2].map(|axis| points[point][axis]);
        return Err(OperatorError::NonFinitePoint { point, x, y, z });
    }
    // Adding 0 makes -0 equal to 0 for the total order.
    let key = |i: u32| points[i as usize].coords.map(|c| c + 0.0);
    let compare = |&a: &u32, &b: &u32| {
        let (p, q) = (key(a), key(b));
        let axes = (0..3).map(|axis| p[axis].total_cmp(&q[axis]));
        axes.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
    };
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    order.sort_unstable_by(|a, b| compare(a, b).then(a.cmp(b)));
    let mut first_of = vec![0; points.len()];
    for group in order.chunk_by(|a, b| compare(a, b).is_eq()) {
        for &point in group {
            first_of[point as usize] = group[0];
        }
    }
    let mut distinct = DistinctPoints {
        positions: Vec::new(),
        source: Vec::new(),
        distinct_of: Vec::with_capacity(points.len()),
    };
    for (point, &first) in first_of.iter().enumerate() {
        if first as usize == point {
            distinct.distinct_of.push(distinct.source.len() as u32);
            distinct.source.push(first);
            distinct.positions.push(points[point]);
        } else {
            distinct
                .distinct_of
                .push(distinct.distinct_of[first as usize]);
        }
    }
    if distinct.source.len() < MIN_POINTS {
        return Err(OperatorError::TooFewPoints {
            n_points: distinct.source.len(),
            min: MIN_POINTS,
        });
    }
    Ok(distinct)
}

/// The triangles of all points, corners ascending; most occur three times.
pub(crate) fn local_triangles(
    points: &[Point3<f64>],
    n_neighbors: usize,
) -> Result<Vec<[u32; 3]>, OperatorError> {
    let neighbors = nearest_neighbors(points, n_neighbors)?;
    let k = neighbors.len() / points.len();
    let weights: Vec<f64> = (0..points.len())
        .map(|i| {
            let nearest = points[neighbors[i * k] as usize] - points[i];
            TIE_WEIGHT * nearest.norm_squared() * scattered(i as u64)
        })
        .collect();
    let mut triangles = Vec::with_capacity(6 * points.len());
    let mut in_plane = Vec::with_capacity(k);
    for (i, around) in neighbors.chunks_exact(k).enumerate() {
        let [u, v] = tangent_axes(points, i, around);
        in_plane.clear();
        for &j in around {
            let offset = points[j as usize] - points[i];
            let place = [offset.dot(&u), offset.dot(&v)];
            if place[0].hypot(place[1]) > OVERHEAD * offset.norm() {
                in_plane.push(PlanePoint {
                    place,
                    relative_weight: weights[j as usize] - weights[i],
                    index: j,
                });
            }
        }
        delaunay_star(&in_plane, |a, b| {
            // Copies of a triangle must turn alike for the tufted cover to lay them on each other.
            let mut corners = [i as u32, a, b];
            corners.sort_unstable();
            triangles.push(corners);
        });
    }
    if triangles.is_empty() {
        return Err(OperatorError::NoTriangles {
            n_points: points.len(),
        });
    }
    Ok(triangles)
}

/// The nearest neighbours of every point, by distance, then index; the same number for each.
fn nearest_neighbors(
    points: &[Point3<f64>],
    n_neighbors: usize,
) -> Result<Vec<u32>, OperatorError> {
    let extent_mm = extent(points);
    let squared = extent_mm * extent_mm;
    if !(squared.is_finite() && squared * f64::EPSILON > f64::MIN_POSITIVE) {
        return Err(OperatorError::Extent { extent_mm });
    }
    let coordinates: Vec<[f64; 3]> = points.iter().map(|p| [p.x, p.y, p.z]).collect();
    let tree: ImmutableKdTree<f64, 3> =
        ImmutableKdTree::new_from_slice(&coordinates).map_err(|error| {
            OperatorError::NeighborSearch {
                reason: error.to_string(),
            }
        })?;
    let k = n_neighbors.min(points.len() - 1);
    // The point itself comes first and is dropped.
    let wanted = NonZero::<usize>::MIN.saturating_add(k);
    let mut neighbors = Vec::with_capacity(k * points.len());
    let mut found: Vec<(f64, u32)> = Vec::with_capacity(k + 1);
    for (i, point) in coordinates.iter().enumerate() {
        found.clear();
        let nearest = tree.query(point).nearest_n::<SquaredEuclidean<f64>>(wanted);
        let others = nearest.execute().into_iter();
        let others = others.map(|item| (item.distance, item.item));
        found.extend(others.filter(|&(_, j)| j as usize != i));
        found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.truncate(k);
        if found.len() != k {
            return Err(OperatorError::NeighborSearch {
                reason: format!("point {i} has {} neighbours instead of {k}", found.len()),
            });
        }
        neighbors.extend(found.iter().map(|&(_, j)| j));
    }
    Ok(neighbors)
}

/// Diagonal of the bounding box.
fn extent(points: &[Point3<f64>]) -> f64 {
    let (mut low, mut high) = (points[0].coords, points[0].coords);
    for p in points {
        (low, high) = (low.inf(&p.coords), high.sup(&p.coords));
    }
    (high - low).norm()
}

/// Two orthonormal axes of the plane that fits a point and its neighbours best.
fn tangent_axes(points: &[Point3<f64>], i: usize, around: &[u32]) -> [Vector3<f64>; 2] {
    let offsets = || around.iter().map(|&j| points[j as usize] - points[i]);
    let mean = offsets().sum::<Vector3<f64>>() / (around.len() + 1) as f64;
    // The point itself has the offset 0.
    let spread = offsets().fold(mean * mean.transpose(), |sum: Matrix3<f64>, offset| {
        let from_mean = offset - mean;
        sum + from_mean * from_mean.transpose()
    });
    let eigen = SymmetricEigen::new(spread / spread.trace());
    let normal = eigen.eigenvalues.imin();
    let (u, v) = ((normal + 1) % 3, (normal + 2) % 3);
    [u, v].map(|axis| eigen.eigenvectors.column(axis).into_owned())
}

/// A number from 0 to 1 for every index, without a pattern (the finaliser of SplitMix64, Steele,
/// Lea, Flood 2014).
fn scattered(index: u64) -> f64 {
    let mut bits = index.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((bits ^ (bits >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

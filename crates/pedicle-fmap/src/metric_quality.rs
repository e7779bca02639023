//! Distributions of errors and stretches, in Euclidean or geodesic distances.
//!
//! ```text
//! error(y)       d(T(y), T_true(y)) / √A              weight: area at y
//! round trip(x)  d(T_st(T_ts(x)), x) / √A             weight: area at x
//! stretch(y y')  d(T(y), T(y')) / |y y'|              weight: 1 an edge of the target
//! ```
//!
//! d runs on the source, A is its area. Kim, Lipman & Funkhouser 2011; Ren et al. 2018, section 6.
//!
//! Between points inside faces a geodesic distance is that of the best pair of corners with the
//! straight ways to them, or the straight line if the two faces share a corner: an upper bound,
//! off by less than two edges.

use nalgebra::Point3;
use pedicle_geodesic::{EdgeGraph, HeatGeodesics};
use pedicle_mesh::TriMesh;

use crate::{
    Distribution, FmapError, PointInFace, PointMap, PointMapPair, PreciseMap, adjacency::Adjacency,
    map::check_size, quality::vertex_areas,
};

/// How distances on the source are measured.
#[derive(Debug, Clone, Copy)]
pub enum Metric<'a> {
    /// Straight through space.
    Euclidean,
    /// Along the graph of the mesh: cheap for near pairs, some percent too long.
    Paths(&'a EdgeGraph),
    /// By the heat method: two triangular solves for every different first point.
    Heat(&'a HeatGeodesics),
}

/// Distances between found and true images over √area, one a target vertex.
///
/// Paths are searched from the true images.
///
/// # Errors
/// [`FmapError`] if the maps or the metric do not belong to the meshes.
pub fn map_errors(
    (source, target): (&TriMesh, &TriMesh),
    found: &PointMap,
    truth: &PointMap,
    metric: Metric<'_>,
) -> Result<Distribution, FmapError> {
    for map in [found, truth] {
        map.check_between(source.n_vertices(), target.n_vertices())?;
    }
    let images = truth.source_of_target.iter().copied();
    let pairs: Vec<(u32, u32)> = images.zip(found.source_of_target.iter().copied()).collect();
    let distances = metric.between_vertices(source, &pairs)?;
    over_sqrt_area(source, distances, vertex_areas(target))
}

/// [`map_errors`] of maps into triangles.
///
/// # Errors
/// [`FmapError`] if the maps or the metric do not belong to the meshes.
pub fn precise_map_errors(
    (source, target): (&TriMesh, &TriMesh),
    found: &PreciseMap,
    truth: &PreciseMap,
    metric: Metric<'_>,
) -> Result<Distribution, FmapError> {
    for map in [found, truth] {
        map.check_between(source.n_vertices(), target.n_vertices())?;
    }
    let pairs: Vec<(PointInFace, PointInFace)> = truth
        .source_of_target
        .iter()
        .copied()
        .zip(found.source_of_target.iter().copied())
        .collect();
    let distances = metric.between_points(source, &pairs)?;
    over_sqrt_area(source, distances, vertex_areas(target))
}

/// Distances of source vertices from where the two maps bring them back to, over √area.
///
/// # Errors
/// [`FmapError`] if the maps or the metric do not belong to the mesh or to each other.
pub fn round_trip_errors(
    source: &TriMesh,
    maps: &PointMapPair,
    metric: Metric<'_>,
) -> Result<Distribution, FmapError> {
    let (back, there) = (&maps.target_to_source, &maps.source_to_target);
    back.check_between(source.n_vertices(), there.n_source_vertices)?;
    there.check_between(back.n_target_vertices(), source.n_vertices())?;
    let pairs: Vec<(u32, u32)> = there
        .source_of_target
        .iter()
        .enumerate()
        .map(|(x, &y)| (x as u32, back.source_of_target[y as usize]))
        .collect();
    let distances = metric.between_vertices(source, &pairs)?;
    over_sqrt_area(source, distances, vertex_areas(source))
}

/// Distance of the images of both ends of every target edge over its length.
///
/// Near 1 for a good map, 0 where edges collapse, large where the map tears. Edges come in the
/// order of their lower, then their higher vertex; those without length are left out.
///
/// # Errors
/// [`FmapError`] if the map or the metric does not belong to the meshes, or no edge has a length.
pub fn edge_stretch(
    (source, target): (&TriMesh, &TriMesh),
    map: &PointMap,
    metric: Metric<'_>,
) -> Result<Distribution, FmapError> {
    map.check_between(source.n_vertices(), target.n_vertices())?;
    let (mut pairs, mut lengths) = (Vec::new(), Vec::new());
    Adjacency::new(target).for_each_edge(|a, b, length| {
        if length > 0.0 {
            pairs.push((map.source_of_target[a], map.source_of_target[b]));
            lengths.push(length);
        }
    });
    let mut ratios = metric.between_vertices(source, &pairs)?;
    for (ratio, length) in ratios.iter_mut().zip(&lengths) {
        *ratio /= length;
    }
    Distribution::new(ratios, vec![1.0; lengths.len()])
}

impl Metric<'_> {
    /// The distance of every pair of vertices.
    fn between_vertices(self, mesh: &TriMesh, pairs: &[(u32, u32)]) -> Result<Vec<f64>, FmapError> {
        self.check(mesh)?;
        match self {
            Self::Euclidean => {
                let point = |v: u32| mesh.vertices()[v as usize];
                let pairs = pairs.iter();
                Ok(pairs.map(|&(a, b)| (point(a) - point(b)).norm()).collect())
            }
            Self::Paths(graph) => Ok(graph.distances_between(pairs)?),
            Self::Heat(heat) => Ok(heat.distances_between(pairs)?),
        }
    }

    /// The distance of every pair of points in faces.
    fn between_points(
        self,
        mesh: &TriMesh,
        pairs: &[(PointInFace, PointInFace)],
    ) -> Result<Vec<f64>, FmapError> {
        self.check(mesh)?;
        let mut distances = vec![0.0; pairs.len()];
        let mut far = Vec::new();
        let mut corners = Vec::new();
        for (i, (a, b)) in pairs.iter().enumerate() {
            let is_near = a.corners.iter().any(|v| b.corners.contains(v));
            if is_near || matches!(self, Self::Euclidean) {
                distances[i] = (a.position(mesh) - b.position(mesh)).norm();
            } else {
                far.push(i);
                let of = |v: u32| b.corners.map(|w| (v, w));
                corners.extend(a.corners.into_iter().flat_map(of));
            }
        }
        let between = self.between_vertices(mesh, &corners)?;
        let to_corners = |point: &PointInFace| {
            let position: Point3<f64> = point.position(mesh);
            point
                .corners
                .map(|v| (mesh.vertices()[v as usize] - position).norm())
        };
        for (&i, between) in far.iter().zip(between.chunks(9)) {
            let (a, b) = (to_corners(&pairs[i].0), to_corners(&pairs[i].1));
            let ways = between
                .iter()
                .enumerate()
                .map(|(j, d)| a[j / 3] + d + b[j % 3]);
            distances[i] = ways.fold(f64::INFINITY, f64::min);
        }
        Ok(distances)
    }

    fn check(self, mesh: &TriMesh) -> Result<(), FmapError> {
        let found = match self {
            Self::Euclidean => return Ok(()),
            Self::Paths(graph) => graph.n_vertices(),
            Self::Heat(heat) => heat.n_vertices(),
        };
        check_size("vertices of the metric", found, mesh.n_vertices())
    }
}

fn over_sqrt_area(
    source: &TriMesh,
    mut distances: Vec<f64>,
    weights: Vec<f64>,
) -> Result<Distribution, FmapError> {
    let unit = source.area().sqrt();
    if unit > 0.0 {
        for distance in &mut distances {
            *distance /= unit;
        }
    }
    Distribution::new(distances, weights)
}

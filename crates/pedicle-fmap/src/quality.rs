//! How good a point map is, with and without a known truth.
//!
//! ```text
//! coverage            share of the source that is some target vertex's image
//! bijectivity error   Σ_x a_x |T_st(T_ts(x)) - x| / (A √A)
//! continuity          mean over target edges of |T(y) T(y')| / |y y'|
//! error               Σ_y a_y |T(y) - T_true(y)| / (A √A)
//! ```
//!
//! a is a third of the areas of the triangles at a vertex, A their sum. Distances of the functions
//! above are Euclidean: they bound the geodesic ones from below. [`map_errors`],
//! [`round_trip_errors`] and [`edge_stretch`] return whole distributions in the [`Metric`] asked
//! for; none needs an n × n table.
//!
//! Ren et al. 2018, section 6; Kim, Lipman & Funkhouser 2011.

use nalgebra::Point3;
use pedicle_mesh::TriMesh;

use crate::{FmapError, PointMap, PointMapPair, adjacency::Adjacency};

/// How a map treats the edges of the target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Continuity {
    /// Mean over the edges of the length of the image over the length; near 1 for a good map.
    pub mean_stretch: f64,
    /// Share of the edges whose image is longer than the longest edge of the source.
    pub torn_share: f64,
}

/// Share of the area of the source whose vertices are some target vertex's image, 0 to 1.
///
/// `source_areas` are the areas at the source vertices, such as the lumped mass of its basis.
///
/// # Errors
/// [`FmapError`] if there is not one area per source vertex, or an image is out of range.
pub fn coverage(map: &PointMap, source_areas: &[f64]) -> Result<f64, FmapError> {
    map.check_between(source_areas.len(), map.n_target_vertices())?;
    let hit = hit_vertices(map);
    let pairs = source_areas.iter().zip(&hit);
    let covered: f64 = pairs.filter(|&(_, &h)| h).map(|(area, _)| area).sum();
    Ok(ratio(covered, source_areas.iter().sum()))
}

/// Share of the source vertices that are some target vertex's image, 0 to 1.
#[must_use]
pub fn vertex_coverage(map: &PointMap) -> f64 {
    let hit = hit_vertices(map);
    ratio(hit.iter().filter(|&&h| h).count() as f64, hit.len() as f64)
}

/// Mean distance of source vertices from where the two maps bring them back to, over √area.
///
/// # Errors
/// [`FmapError`] if the maps do not belong to the mesh or to each other.
pub fn bijectivity_error(source: &TriMesh, maps: &PointMapPair) -> Result<f64, FmapError> {
    let (back, there) = (&maps.target_to_source, &maps.source_to_target);
    back.check_between(source.n_vertices(), there.n_source_vertices)?;
    there.check_between(back.n_target_vertices(), source.n_vertices())?;
    let round_trip: Vec<u32> = there
        .source_of_target
        .iter()
        .map(|&y| back.source_of_target[y as usize])
        .collect();
    let identity: Vec<u32> = (0..source.n_vertices() as u32).collect();
    let areas = vertex_areas(source);
    Ok(mean_distance(source, &areas, (&round_trip, &identity)) / source.area().sqrt())
}

/// How the edges of the target are stretched and torn.
///
/// # Errors
/// [`FmapError`] if the map does not belong to the meshes.
pub fn continuity(
    source: &TriMesh,
    target: &TriMesh,
    map: &PointMap,
) -> Result<Continuity, FmapError> {
    map.check_between(source.n_vertices(), target.n_vertices())?;
    let longest = Adjacency::new(source).longest_edge;
    let (mut stretch, mut torn, mut n_measured, mut n_edges) = (0.0, 0_usize, 0_usize, 0_usize);
    Adjacency::new(target).for_each_edge(|a, b, length| {
        let image = distance(source, map.image(a), map.image(b));
        n_edges += 1;
        torn += usize::from(image > longest);
        if length > 0.0 {
            stretch += image / length;
            n_measured += 1;
        }
    });
    Ok(Continuity {
        mean_stretch: ratio(stretch, n_measured as f64),
        torn_share: ratio(torn as f64, n_edges as f64),
    })
}

/// Mean distance between found and true images over the target, in the unit of the mesh.
///
/// # Errors
/// [`FmapError`] if the maps do not belong to the meshes.
pub fn mean_error_mm(
    source: &TriMesh,
    target: &TriMesh,
    found: &PointMap,
    truth: &PointMap,
) -> Result<f64, FmapError> {
    for map in [found, truth] {
        map.check_between(source.n_vertices(), target.n_vertices())?;
    }
    let pair = (&found.source_of_target[..], &truth.source_of_target[..]);
    Ok(mean_distance(source, &vertex_areas(target), pair))
}

/// [`mean_error_mm`] over the square root of the area of the source.
///
/// # Errors
/// [`FmapError`] if the maps do not belong to the meshes.
pub fn mean_error_over_sqrt_area(
    source: &TriMesh,
    target: &TriMesh,
    found: &PointMap,
    truth: &PointMap,
) -> Result<f64, FmapError> {
    Ok(ratio(
        mean_error_mm(source, target, found, truth)?,
        source.area().sqrt(),
    ))
}

/// Euclidean distance of two vertices.
pub(crate) fn distance(mesh: &TriMesh, a: usize, b: usize) -> f64 {
    let vertices: &[Point3<f64>] = mesh.vertices();
    (vertices[a] - vertices[b]).norm()
}

/// A third of the areas of the triangles at every vertex.
pub(crate) fn vertex_areas(mesh: &TriMesh) -> Vec<f64> {
    let mut areas = vec![0.0; mesh.n_vertices()];
    for (face, corners) in mesh.faces().iter().enumerate() {
        let third = mesh.face_area(face) / 3.0;
        for &v in corners {
            areas[v as usize] += third;
        }
    }
    areas
}

fn hit_vertices(map: &PointMap) -> Vec<bool> {
    let mut hit = vec![false; map.n_source_vertices];
    for &image in &map.source_of_target {
        if let Some(slot) = hit.get_mut(image as usize) {
            *slot = true;
        }
    }
    hit
}

fn mean_distance(mesh: &TriMesh, areas: &[f64], (a, b): (&[u32], &[u32])) -> f64 {
    let weighted = a
        .iter()
        .zip(b)
        .zip(areas)
        .map(|((&x, &y), area)| area * distance(mesh, x as usize, y as usize))
        .sum();
    ratio(weighted, areas.iter().sum())
}

fn ratio(numerator: f64, denominator: f64) -> f64 {
    if denominator > 0.0 {
        numerator / denominator
    } else {
        0.0
    }
}

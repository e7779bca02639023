//! One part as a closed surface without the stairs of its voxels.
//!
//! ```text
//! { x : (G_σ * m)(x) = c },   c such that the volume inside is that of the voxels
//! ```
//!
//! A Gaussian of 0.7 voxels removes the stairs; at c = 1/2 it would take about 1 % of the volume of a
//! vertebra, most of it from thin processes, so c is moved until the volume is kept. Surface nets at
//! 1/2 on samples whose ambiguous cells are resolved give a closed manifold
//! ([`pedicle_mesh::ScalarGrid`]); its vertices are then moved to c, less than a voxel.

use nalgebra::{Point3, Vector3};
use pedicle_mesh::{
    MeshError, ScalarGrid, SimplifyOptions, Spacing, TriMesh, connected_components, genus,
    is_closed_manifold, non_manifold_edges, simplify, volume,
};

use crate::mask::Mask;
use crate::placing::place;
use crate::{LabelMap, Part};

/// How a part becomes a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceOptions {
    /// Standard deviation of the Gaussian in voxels (default 0.7; 0 for none, at most 3).
    pub sigma_voxels: f64,
}

impl SurfaceOptions {
    /// The range of `sigma_voxels`.
    pub const SIGMA_VOXELS: std::ops::RangeInclusive<f64> = 0.0..=3.0;
}

impl Default for SurfaceOptions {
    fn default() -> Self {
        Self { sigma_voxels: 0.7 }
    }
}

/// The surface of a part.
#[derive(Debug, Clone)]
pub struct PartSurface {
    /// The surface in RAS mm, faces outwards.
    pub mesh: TriMesh,
    /// Volume of the voxels with their holes filled, mm³.
    pub voxel_volume_mm3: f64,
    /// Volume inside the surface over that of the voxels, less 1.
    pub volume_change: f64,
    /// Voxels of closed holes that were filled.
    pub n_filled: u64,
    /// Value of the blurred mask on the surface, between 0 and 1.
    pub level: f64,
    /// Edges without exactly two faces; 0 for a closed manifold.
    pub n_bad_edges: usize,
}

/// Value of the blurred mask that is meshed: what hangs on by a thread thinner than this is cut off.
const MESHED_LEVEL: f64 = 0.5;
/// Smallest and largest value to which the vertices are moved.
const LEVELS: (f64, f64) = (0.35, 0.65);
/// The second value that is tried.
const SECOND_LEVEL: f64 = 0.47;
/// The search ends when the volume is as near as this, relative.
const VOLUME_TOLERANCE: f64 = 5e-4;
/// Largest box of a part that is meshed on a finer grid; above it voxels are fine themselves.
const MAX_REFINED_VOXELS: usize = 1 << 22;
/// How far faces taken away may move the surface, voxels.
const MAX_SIMPLIFICATION_VOXELS: f64 = 0.1;
/// Fewest faces that are worth simplifying.
const MIN_SIMPLIFIED_FACES: usize = 4000;
/// Values tried at most.
const MAX_TRIES: usize = 6;

/// The surface of one part of a label map.
///
/// # Errors
/// [`MeshError`] if the part has no surface.
///
/// # Panics
/// If `sigma_voxels` is not between 0 and 3.
pub fn surface_of_part(
    map: &LabelMap,
    part: &Part,
    options: &SurfaceOptions,
) -> Result<PartSurface, MeshError> {
    let sigma = options.sigma_voxels;
    assert!(
        SurfaceOptions::SIGMA_VOXELS.contains(&sigma),
        "sigma_voxels is between 0 and 3"
    );
    let mut mask = Mask::new(part, sigma);
    mask.blur(sigma);
    let n_inside = mask.n_inside as f64;
    let net = meshed(&mask)?;
    let at_level = |level: f64| -> Result<(TriMesh, f64), MeshError> {
        let points = place(&mask, net.vertices(), net.faces(), level);
        let mesh = TriMesh::new(points, net.faces().to_vec())?;
        let change = volume(&mesh) / n_inside - 1.0;
        Ok((mesh, change))
    };
    let mut level = MESHED_LEVEL;
    let mut best = at_level(level)?;
    let mut tried = (level, best.1);
    let mut next = SECOND_LEVEL;
    for _ in 1..MAX_TRIES {
        if best.1.abs() < VOLUME_TOLERANCE {
            break;
        }
        let (mesh, change) = at_level(next)?;
        // Secant: where the line through both changes is zero.
        let slope = (change - tried.1) / (next - tried.0);
        tried = (next, change);
        if change.abs() < best.1.abs() {
            (level, best) = (next, (mesh, change));
        }
        // The volume falls as the level rises; otherwise the part is too small for its voxels.
        if slope >= 0.0 || slope.is_nan() {
            break;
        }
        next = (next - change / slope).clamp(LEVELS.0, LEVELS.1);
    }
    let (mesh, volume_change) = best;
    let mesh = in_ras(map, &mask, &mesh)?;
    Ok(PartSurface {
        n_bad_edges: n_bad_edges(&mesh),
        mesh,
        voxel_volume_mm3: n_inside * map.voxel_volume_mm3(),
        volume_change,
        n_filled: mask.n_inside - part.n_voxels,
        level,
    })
}

/// The surface at the middle level, in voxels of the mask.
///
/// On a grid of half the voxels, cells with two sheets are rarer and resolving them costs less than
/// a quarter of a voxel. Where both grids see as many handles the coarser surface is as good and has a
/// quarter of the faces; elsewhere the finer one is taken, and up to three of four faces away again.
fn meshed(mask: &Mask) -> Result<TriMesh, MeshError> {
    let coarse = net(mask.size, &mask.values, 1.0)?;
    if mask.values.len() > MAX_REFINED_VOXELS {
        return Ok(coarse);
    }
    let (size, values) = mask.doubled();
    let fine = net(size, &values, 0.5)?;
    if genus(&fine) == genus(&coarse) {
        return Ok(coarse);
    }
    if fine.n_faces() < MIN_SIMPLIFIED_FACES {
        return Ok(fine);
    }
    let options = SimplifyOptions {
        spacing: Spacing::Adaptive,
        max_error_mm: Some(MAX_SIMPLIFICATION_VOXELS),
        ..SimplifyOptions::default()
    };
    let simplified = simplify(&fine, fine.n_faces() / 4, &options)?.mesh;
    // What could not be simplified without a pinch stays as it was.
    Ok(if is_closed_manifold(&simplified) {
        simplified
    } else {
        fine
    })
}

/// The largest piece of the surface on one grid, its points multiplied by `scale`.
fn net(size: [usize; 3], values: &[f32], scale: f64) -> Result<TriMesh, MeshError> {
    let samples = values.iter().map(|g| MESHED_LEVEL as f32 - g).collect();
    let surface = ScalarGrid::new(size.map(|n| n as u32), samples).surface();
    let points = surface.points.iter().map(|p| p * scale).collect();
    largest_piece(TriMesh::new(points, surface.faces)?)
}

/// The blur may cut off a crumb that hung by a thread, or close off a cavity.
fn largest_piece(mesh: TriMesh) -> Result<TriMesh, MeshError> {
    let components = connected_components(&mesh);
    if components.n_components == 1 {
        return Ok(mesh);
    }
    let pieces = components.faces();
    let Some(largest) = pieces.iter().rev().max_by_key(|faces| faces.len()) else {
        return Ok(mesh);
    };
    Ok(mesh.submesh_of_faces(largest)?.mesh)
}

/// From voxels of the mask to RAS mm. A mirrored affine turns the faces inside out: they are turned
/// back.
fn in_ras(map: &LabelMap, mask: &Mask, mesh: &TriMesh) -> Result<TriMesh, MeshError> {
    let origin = Vector3::from_fn(|axis, _| mask.origin[axis] as f64);
    let vertices: Vec<Point3<f64>> = mesh
        .vertices()
        .iter()
        .map(|p| map.ras_mm(&(p + origin)))
        .collect();
    let is_mirrored = map.ras_from_voxel.fixed_view::<3, 3>(0, 0).determinant() < 0.0;
    let faces = mesh
        .faces()
        .iter()
        .map(|&[a, b, c]| if is_mirrored { [a, c, b] } else { [a, b, c] });
    TriMesh::new(vertices, faces.collect())
}

fn n_bad_edges(mesh: &TriMesh) -> usize {
    if is_closed_manifold(mesh) {
        return 0;
    }
    let open: usize = pedicle_mesh::boundary_loops(mesh)
        .iter()
        .map(Vec::len)
        .sum();
    (open + non_manifold_edges(mesh).len()).max(1)
}

//! From the implicit solid to a closed triangle surface.
//!
//! Surface nets over a regular grid give the connectivity, then the vertices are placed on the
//! exact surface ([`crate::placing`]). Should a grid not give one closed manifold that looks
//! outwards, the next one is a little finer.

use nalgebra::{Point3, Vector3};
use pedicle_mesh::{
    ScalarGrid, TriMesh, boundary_loops, connected_components, is_closed_manifold,
    non_manifold_edges, non_manifold_vertices,
};
use pedicle_trajectory::Level;

use crate::SimulationError;
use crate::placing::Placing;
use crate::spine::SpineShape;

/// Each further grid is finer by this factor.
const REFINEMENT: f64 = 0.965;
/// Grids tried before giving up.
const MAX_GRIDS: usize = 8;
/// How finely the phantom is meshed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshingOptions {
    /// Cell size of the grid, mm (default 1.95, about 8 800 faces a vertebra; 0.5 to 3).
    pub cell_mm: f64,
}

impl Default for MeshingOptions {
    fn default() -> Self {
        Self { cell_mm: 1.95 }
    }
}

impl MeshingOptions {
    pub(crate) fn validate(&self) -> Result<(), SimulationError> {
        if (0.5..=3.0).contains(&self.cell_mm) {
            return Ok(());
        }
        Err(SimulationError::MeshingOptionOutOfRange {
            name: "cell_mm",
            value: self.cell_mm,
            min: 0.5,
            max: 3.0,
        })
    }
}

/// The surface of one vertebra in the frame of the spine.
pub(crate) fn mesh_vertebra(
    spine: &SpineShape,
    level: Level,
    options: &MeshingOptions,
) -> Result<TriMesh, SimulationError> {
    let mut cell_mm = options.cell_mm;
    let mut last = Flaws::default();
    for _ in 0..MAX_GRIDS {
        let (mut points, faces) = extract(spine, level, cell_mm);
        let net = TriMesh::new(points.clone(), faces.clone())?;
        last = connectivity_flaws(&net);
        if last != Flaws::NONE {
            cell_mm *= REFINEMENT;
            continue;
        }
        last.n_inverted = Placing::new(spine, level, cell_mm).place(&mut points, &faces);
        if last == Flaws::NONE {
            let pose = &spine.poses[level.index()];
            let vertices = points.iter().map(|p| pose * p).collect();
            return Ok(TriMesh::new(vertices, faces)?);
        }
        cell_mm *= REFINEMENT;
    }
    Err(SimulationError::NotManifold {
        level,
        n_tried: MAX_GRIDS,
        cell_mm: cell_mm / REFINEMENT,
        n_bad_edges: last.n_bad_edges,
        n_pinched: last.n_pinched,
        n_inverted: last.n_inverted,
        n_components: last.n_components,
    })
}

/// Vertices in the vertebra's frame and faces that look outwards.
fn extract(spine: &SpineShape, level: Level, cell_mm: f64) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    let (low, high) = spine.bounds(level);
    let size: [u32; 3] =
        std::array::from_fn(|axis| ((high[axis] - low[axis]) / cell_mm).ceil() as u32 + 1);
    let n_samples = size.iter().map(|&n| n as usize).product();
    let mut samples = Vec::with_capacity(n_samples);
    for z in 0..size[2] {
        for y in 0..size[1] {
            let mut left = 0;
            let mut value = 0.0;
            for x in 0..size[0] {
                // Far from the surface the next samples keep the sign: half of the distance is
                // a safe stride although distances are of first order only.
                if left == 0 {
                    let step = Vector3::new(f64::from(x), f64::from(y), f64::from(z)) * cell_mm;
                    value = spine.distance(level, &(low + step));
                    left = (0.5 * value.abs() / cell_mm) as u32;
                } else {
                    left -= 1;
                }
                samples.push(value as f32);
            }
        }
    }
    let surface = ScalarGrid::new(size, samples).surface();
    let points = surface
        .points
        .iter()
        .map(|p| low + p.coords * cell_mm)
        .collect();
    (points, surface.faces)
}

/// What keeps a surface from being one closed manifold that looks outwards.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Flaws {
    n_bad_edges: usize,
    n_pinched: usize,
    n_inverted: usize,
    n_components: usize,
}

impl Flaws {
    const NONE: Self = Self {
        n_bad_edges: 0,
        n_pinched: 0,
        n_inverted: 0,
        n_components: 1,
    };
}

fn connectivity_flaws(net: &TriMesh) -> Flaws {
    let n_bad_edges = if is_closed_manifold(net) {
        0
    } else {
        let open: usize = boundary_loops(net).iter().map(Vec::len).sum();
        open + non_manifold_edges(net).len()
    };
    Flaws {
        n_bad_edges,
        n_pinched: non_manifold_vertices(net).len(),
        n_inverted: 0,
        n_components: connected_components(net).n_components,
    }
}

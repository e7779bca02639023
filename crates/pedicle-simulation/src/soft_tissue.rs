//! Soft tissue that was not cleaned off: a bumpy height field over parts of the bone.
//!
//! ```text
//! h(u, v) = b(u, v) + max_k t_k (1 - r_k²) + relief - 2 mm
//! ```
//!
//! on the nodes of a grid of 2 mm in the window. b is the height of the posterior bone along w,
//! smoothed over about a centimetre, so that processes stick out; r_k < 1 is the distance from the
//! centre of an elliptic lobe over its radius, t_k its thickness. Lobes are added until the tissue lies
//! above the bone on the share of the bone's nodes that is asked for. Lengths in mm.

use nalgebra::Point3;
use pedicle_mesh::TriMesh;
use rand::{Rng, RngExt};

use crate::SimulationError;
use crate::scene::{Material, Scene, Wound};

/// Distance of the grid's nodes, mm.
const STEP_MM: f64 = 2.0;
/// How often the height of the bone is averaged over 5 × 5 nodes.
const N_SMOOTHINGS: usize = 2;
/// Where there is no bone, the tissue lies this far below its mean height, mm.
const BESIDE_BONE_MM: f64 = 8.0;
/// Radii of the lobes, mm.
const RADIUS_MM: [f64; 2] = [7.0, 18.0];
/// Thickness of the lobes over the smoothed bone, mm.
const THICKNESS_MM: [f64; 2] = [6.0, 13.0];
/// At its rim a lobe lies below the smoothed bone by this much, mm.
const RIM_MM: f64 = 2.0;
/// Height of the relief, mm, and its wavelengths, mm.
const RELIEF_MM: f64 = 0.8;
const WAVELENGTH_MM: [f64; 2] = [9.0, 20.0];
/// More lobes than this are never needed.
const MAX_LOBES: usize = 400;
/// The bone is looked for to this depth below the skin, mm.
const REACH_MM: f64 = 200.0;

struct Lobe {
    center: [f64; 2],
    radii: [f64; 2],
    thickness: f64,
}

impl Lobe {
    fn draw(half: [f64; 2], rng: &mut impl Rng) -> Self {
        let mut radius = || rng.random_range(RADIUS_MM[0]..=RADIUS_MM[1]);
        let radii = [radius(), radius()];
        Self {
            center: half.map(|h| rng.random_range(-h..=h)),
            radii,
            thickness: rng.random_range(THICKNESS_MM[0]..=THICKNESS_MM[1]),
        }
    }

    /// Its thickness at a node; none outside.
    fn at(&self, u: f64, v: f64) -> Option<f64> {
        let x = (u - self.center[0]) / self.radii[0];
        let y = (v - self.center[1]) / self.radii[1];
        let r2 = x * x + y * y;
        (r2 < 1.0).then_some(self.thickness * (1.0 - r2))
    }
}

/// The nodes over the window, row by row along v.
struct Grid {
    n: [usize; 2],
    half: [f64; 2],
}

impl Grid {
    fn new(half: [f64; 2]) -> Self {
        let n = half.map(|h| (2.0 * h / STEP_MM).ceil() as usize + 1);
        Self { n, half }
    }

    fn len(&self) -> usize {
        self.n[0] * self.n[1]
    }

    fn at(&self, node: usize) -> (f64, f64) {
        let (i, j) = (node % self.n[0], node / self.n[0]);
        (
            i as f64 * STEP_MM - self.half[0],
            j as f64 * STEP_MM - self.half[1],
        )
    }

    /// Every node replaced by the mean over the nodes up to two steps away.
    fn smoothed(&self, heights: &[f64]) -> Vec<f64> {
        let [nu, nv] = self.n;
        (0..self.len())
            .map(|node| {
                let (i, j) = (node % nu, node / nu);
                let mut sum = 0.0;
                let mut n = 0.0;
                for y in j.saturating_sub(2)..(j + 3).min(nv) {
                    for x in i.saturating_sub(2)..(i + 3).min(nu) {
                        sum += heights[y * nu + x];
                        n += 1.0;
                    }
                }
                sum / n
            })
            .collect()
    }
}

/// Soft tissue over a share of the bone in the window; none if the share is zero or there is no
/// bone.
pub(crate) fn grown(
    scene: &Scene<'_>,
    wound: &Wound,
    share: f64,
    rng: &mut impl Rng,
) -> Result<Option<TriMesh>, SimulationError> {
    let grid = Grid::new(wound.half);
    let bone = bone_heights(scene, wound, &grid);
    let found: Vec<f64> = bone.iter().flatten().copied().collect();
    if share <= 0.0 || found.is_empty() {
        return Ok(None);
    }
    let beside = found.iter().sum::<f64>() / found.len() as f64 - BESIDE_BONE_MM;
    let mut base: Vec<f64> = bone.iter().map(|h| h.unwrap_or(beside)).collect();
    for _ in 0..N_SMOOTHINGS {
        base = grid.smoothed(&base);
    }
    let relief = Relief::draw(rng);
    let mut tissue: Vec<Option<f64>> = vec![None; grid.len()];
    let wanted = share * found.len() as f64;
    for _ in 0..MAX_LOBES {
        let lobe = Lobe::draw(grid.half, rng);
        for node in 0..grid.len() {
            let (u, v) = grid.at(node);
            let Some(thickness) = lobe.at(u, v) else {
                continue;
            };
            let height = base[node] + thickness + relief.at(u, v) - RIM_MM;
            if tissue[node].is_none_or(|h| h < height) {
                tissue[node] = Some(height);
            }
        }
        let n_covered = bone
            .iter()
            .zip(&tissue)
            .filter(|(bone, tissue)| {
                matches!((bone, tissue), (Some(bone), Some(tissue)) if tissue > bone)
            })
            .count();
        if n_covered as f64 >= wanted {
            break;
        }
    }
    as_mesh(wound, &grid, &tissue)
}

/// Height of the posterior bone along w at every node, seen along the anterior direction.
fn bone_heights(scene: &Scene<'_>, wound: &Wound, grid: &Grid) -> Vec<Option<f64>> {
    (0..grid.len())
        .map(|node| {
            let (u, v) = grid.at(node);
            let above = wound.global([u, v, wound.skin]);
            let (hit, material) = scene.cast(&above, &-wound.posterior, REACH_MM)?;
            matches!(material, Material::Bone(_)).then(|| wound.local(&hit.point)[2])
        })
        .collect()
}

/// Low waves over the tissue.
struct Relief {
    waves: [[f64; 3]; 3],
}

impl Relief {
    fn draw(rng: &mut impl Rng) -> Self {
        let waves = std::array::from_fn(|_| {
            let turn = rng.random_range(0.0..std::f64::consts::TAU);
            let length = rng.random_range(WAVELENGTH_MM[0]..=WAVELENGTH_MM[1]);
            let k = std::f64::consts::TAU / length;
            let phase = rng.random_range(0.0..std::f64::consts::TAU);
            [k * turn.cos(), k * turn.sin(), phase]
        });
        Self { waves }
    }

    fn at(&self, u: f64, v: f64) -> f64 {
        let sum: f64 = self
            .waves
            .iter()
            .map(|[a, b, phase]| (a * u + b * v + phase).sin())
            .sum();
        RELIEF_MM * sum
    }
}

/// Two faces over every four nodes that have tissue.
fn as_mesh(
    wound: &Wound,
    grid: &Grid,
    tissue: &[Option<f64>],
) -> Result<Option<TriMesh>, SimulationError> {
    let mut vertices: Vec<Point3<f64>> = Vec::new();
    let mut index = vec![None; grid.len()];
    for (node, height) in tissue.iter().enumerate() {
        if let Some(w) = height {
            let (u, v) = grid.at(node);
            index[node] = Some(vertices.len() as u32);
            vertices.push(wound.global([u, v, *w]));
        }
    }
    let nu = grid.n[0];
    let mut faces = Vec::new();
    for node in 0..grid.len().saturating_sub(nu) {
        if node % nu + 1 == nu {
            continue;
        }
        let corners = [node, node + 1, node + nu, node + nu + 1].map(|n| index[n]);
        if let [Some(a), Some(b), Some(c), Some(d)] = corners {
            faces.extend([[a, b, d], [a, d, c]]);
        }
    }
    if faces.is_empty() {
        return Ok(None);
    }
    Ok(Some(TriMesh::new(vertices, faces)?))
}

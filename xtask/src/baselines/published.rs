//! The published pipeline as published: no neighbours, no surface, no verdict.
//!
//! ```text
//! descriptors A, B → C = argmin E(C) → BCICP → point map → T_v = MSAC over the pairs of v
//! ```
//!
//! Source and target are meshes of about 3 500 faces; heat and wave kernel signatures and the same
//! from every landmark are the descriptors; BCICP runs with all its rounds, MSAC as MATLAB's
//! `estgeotform3d` (1.5 mm, 1 000 trials, 99 %). What MSAC finds consensus for is the answer.
//! A target with less than 80 % of the source's area is compared with the half of the source that
//! lies behind the centroids, as in our pipeline: the publication cut by hand.

use faer::Mat;
use nalgebra::{Isometry3, Point3};
use pedicle_descriptors::{
    DescriptorError, HeatTimes, WaveEnergies, concatenate_columns, heat_kernel_from_landmark,
    heat_kernel_signature, normalize_columns, wave_kernel_from_landmark, wave_kernel_signature,
};
use pedicle_fmap::{BcicpOptions, FitOptions, Shape, bcicp, fit};
use pedicle_laplacian::{OperatorOptions, cotangent_operators};
use pedicle_mesh::{
    RepairOptions, SimplifyOptions, TriMesh, concatenate, connected_components, repair, simplify,
};
use pedicle_registration::{MsacOptions, msac};
use pedicle_simulation::TargetSurface;
use pedicle_spectral::{EigenOptions, LaplaceBasis, laplace_basis};
use pedicle_trajectory::AnatomicalFrame;

use super::{Poses, Seen, Source};

/// Faces of both meshes.
const N_FACES: usize = 3500;
/// Eigenfunctions of each shape, and of the first map.
const N_FUNCTIONS: usize = 100;
const N_FIT: usize = 60;
/// Wave kernel signatures, those from each landmark, and heat kernel signatures of either kind.
const N_WAVE: usize = 20;
const N_LANDMARK_WAVE: usize = 30;
const N_HEAT: usize = 10;
/// Below this share of the area a target is a part of the spine.
const WHOLE_AREA_SHARE: f64 = 0.8;
/// Loose pieces with a smaller share of the area are left out.
const MIN_PIECE_AREA_SHARE: f64 = 0.004;

/// A mesh with its eigenfunctions.
struct MapShape {
    mesh: TriMesh,
    basis: LaplaceBasis,
}

/// A part of the source, with the vertebra that each vertex belongs to.
struct View {
    shape: MapShape,
    vertebra_of_vertex: Vec<usize>,
}

/// The source as the map sees it.
pub(crate) struct MapSource {
    whole: View,
    posterior: View,
}

impl MapSource {
    /// The vertebrae's meshes as one, and the half of it behind the centroids.
    pub(super) fn new(meshes: &[&TriMesh], frames: &[AnatomicalFrame]) -> Result<Self, String> {
        let mesh = concatenate(meshes).map_err(words)?;
        let owner: Vec<usize> = meshes
            .iter()
            .enumerate()
            .flat_map(|(v, mesh)| vec![v; mesh.n_vertices()])
            .collect();
        let behind: Vec<u32> = (0..mesh.n_faces() as u32)
            .filter(|&f| {
                let frame = &frames[owner[mesh.faces()[f as usize][0] as usize]];
                let corners = mesh.triangle(f as usize);
                corners
                    .iter()
                    .all(|p| (p - frame.origin).dot(&frame.anterior) < 0.0)
            })
            .collect();
        let part = mesh.submesh_of_faces(&behind).map_err(words)?;
        let part_owner = part
            .source_vertex
            .iter()
            .map(|&v| owner[v as usize])
            .collect();
        Ok(Self {
            whole: View {
                shape: MapShape::new(mesh)?,
                vertebra_of_vertex: owner,
            },
            posterior: View {
                shape: MapShape::new(part.mesh)?,
                vertebra_of_vertex: part_owner,
            },
        })
    }
}

impl MapShape {
    fn new(mesh: TriMesh) -> Result<Self, String> {
        if mesh.n_vertices() < 2 * N_FUNCTIONS {
            return Err(format!(
                "{} vertices are too few for {N_FUNCTIONS} eigenfunctions",
                mesh.n_vertices()
            ));
        }
        let operators = cotangent_operators(&mesh, &OperatorOptions::default()).map_err(words)?;
        let basis = laplace_basis(
            &operators.stiffness,
            &operators.mass,
            N_FUNCTIONS,
            &EigenOptions::default(),
        )
        .map_err(words)?;
        Ok(Self { mesh, basis })
    }
}

/// A pose for every vertebra with consensus. Refused for clouds and without all landmarks.
pub(super) fn poses(source: &Source, seen: &Seen<'_>) -> Result<Poses, String> {
    let TargetSurface::Mesh(mesh) = seen.surface else {
        return Err("the functional map needs a mesh, the target is a cloud".to_owned());
    };
    let landmarks: Vec<Point3<f64>> = seen.landmarks.iter().flatten().copied().collect();
    if landmarks.len() < seen.landmarks.len() {
        return Err(format!(
            "the descriptors need the landmarks of all levels, {} are there",
            landmarks.len()
        ));
    }
    let target = MapShape::new(prepared(mesh)?)?;
    let share = target.basis.area() / source.map.whole.shape.basis.area();
    let view = if share < WHOLE_AREA_SHARE {
        &source.map.posterior
    } else {
        &source.map.whole
    };
    let source_landmarks: Vec<Point3<f64>> = source.bones.iter().map(|b| b.landmark).collect();
    let source_of_target = point_map(&view.shape, &target, (&source_landmarks, &landmarks))?;

    let n = source.bones.len();
    let mut pairs = vec![(Vec::new(), Vec::new()); n];
    for (t, &s) in source_of_target.iter().enumerate() {
        let (from, to) = &mut pairs[view.vertebra_of_vertex[s as usize]];
        from.push(view.shape.mesh.vertices()[s as usize]);
        to.push(target.mesh.vertices()[t]);
    }
    Ok(pairs
        .iter()
        .enumerate()
        .map(|(v, (from, to))| consensus(from, to, seen.seed.wrapping_mul(n as u64) + v as u64))
        .collect())
}

fn consensus(
    from: &[Point3<f64>],
    to: &[Point3<f64>],
    seed: u64,
) -> Result<Isometry3<f64>, String> {
    let options = MsacOptions {
        seed,
        ..MsacOptions::default()
    };
    let found = msac(from, to, &options).map_err(words)?;
    Ok(found.target_from_source)
}

/// What the spectral steps can live with: no defects, few faces, no crumbs.
fn prepared(mesh: &TriMesh) -> Result<TriMesh, String> {
    let (mut mesh, _) = repair(mesh, &RepairOptions::default()).map_err(words)?;
    if mesh.n_faces() > N_FACES + N_FACES / 10 {
        let simple = simplify(&mesh, N_FACES, &SimplifyOptions::default());
        mesh = simple.map_err(words)?.mesh;
    }
    let components = connected_components(&mesh);
    let mut area = vec![0.0; components.n_components];
    for (f, &c) in components.of_face.iter().enumerate() {
        area[c as usize] += mesh.face_area(f);
    }
    let least = MIN_PIECE_AREA_SHARE * area.iter().sum::<f64>();
    let kept: Vec<u32> = (0..mesh.n_faces() as u32)
        .filter(|&f| area[components.of_face[f as usize] as usize] >= least)
        .collect();
    Ok(mesh.submesh_of_faces(&kept).map_err(words)?.mesh)
}

/// One source vertex for every target vertex.
fn point_map(
    source: &MapShape,
    target: &MapShape,
    landmarks: (&[Point3<f64>], &[Point3<f64>]),
) -> Result<Vec<u32>, String> {
    let (a, b) = descriptors(source, target, landmarks).map_err(words)?;
    let source = Shape {
        mesh: &source.mesh,
        basis: &source.basis,
        descriptors: &a,
    };
    let target = Shape {
        mesh: &target.mesh,
        basis: &target.basis,
        descriptors: &b,
    };
    let options = FitOptions {
        n_source: N_FIT,
        n_target: N_FIT,
        ..FitOptions::default()
    };
    let first = fit(&source, &target, &options).map_err(words)?;
    let refined = bcicp(&source, &target, &first.map, &BcicpOptions::default()).map_err(words)?;
    Ok(refined.target_to_source.source_of_target)
}

fn descriptors(
    source: &MapShape,
    target: &MapShape,
    (source_landmarks, target_landmarks): (&[Point3<f64>], &[Point3<f64>]),
) -> Result<(Mat<f64>, Mat<f64>), DescriptorError> {
    let energies = WaveEnergies::joint(&source.basis, &target.basis, N_WAVE)?;
    let from_landmark = WaveEnergies::joint(&source.basis, &target.basis, N_LANDMARK_WAVE)?;
    let times = HeatTimes::joint(&source.basis, &target.basis, N_HEAT)?;
    let of = |shape: &MapShape, landmarks: &[Point3<f64>]| {
        let mut parts = vec![
            wave_kernel_signature(&shape.basis, &energies),
            heat_kernel_signature(&shape.basis, &times),
        ];
        for landmark in landmarks {
            let vertex = nearest_vertex(&shape.mesh, landmark);
            parts.push(wave_kernel_from_landmark(
                &shape.basis,
                vertex,
                &from_landmark,
            )?);
            parts.push(heat_kernel_from_landmark(&shape.basis, vertex, &times)?);
        }
        let columns = concatenate_columns(&parts);
        Ok(normalize_columns(columns, &shape.basis.mass))
    };
    Ok((of(source, source_landmarks)?, of(target, target_landmarks)?))
}

fn nearest_vertex(mesh: &TriMesh, point: &Point3<f64>) -> usize {
    let squared = |v: usize| (mesh.vertices()[v] - point).norm_squared();
    (0..mesh.n_vertices())
        .min_by(|&a, &b| squared(a).total_cmp(&squared(b)))
        .unwrap_or(0)
}

fn words(error: impl ToString) -> String {
    error.to_string()
}

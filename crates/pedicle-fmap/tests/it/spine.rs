//! A real lumbar spine against a shuffled and noisy copy of itself.

use nalgebra::Vector3;
use pedicle_descriptors::{
    HeatTimes, WaveEnergies, concatenate_columns, heat_kernel_from_landmark, heat_kernel_signature,
    normalize_columns, wave_kernel_from_landmark, wave_kernel_signature,
};
use pedicle_fmap::{
    BcicpOptions, FitOptions, ZoomOutOptions, bcicp, fit, mean_error_mm, vertex_coverage, zoomout,
};
use pedicle_laplacian::{OperatorOptions, cotangent_operators};
use pedicle_mesh::{TriMesh, read_mesh};
use pedicle_spectral::{EigenOptions, LaplaceBasis, laplace_basis};

use crate::shapes::{Numbers, Owned, noisy, shuffled};

const N_FUNCTIONS: usize = 120;
const N_VERTEBRAE: u32 = 5;

#[test]
fn a_noisy_copy_is_recovered_below_the_noise() {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../shared/reference/spectra/vhp-male-3500.ply"
    );
    let Ok(file) = read_mesh(path) else {
        println!("no reference spine beside the workspace: nothing was tested");
        return;
    };
    let labels = file.vertex_labels.expect("the reference spine is labelled");
    let (moved, truth) = shuffled(&file.mesh, 21);
    let target = noisy(&moved, 1.0, 5);
    let (source_landmarks, target_landmarks) = tips(&file.mesh, &labels, &target);

    let (source_basis, target_basis) = (basis(&file.mesh), basis(&target));
    assert_eq!(source_basis.null_dimension, 5);
    let times = HeatTimes::joint(&source_basis, &target_basis, 10).unwrap();
    let energies = WaveEnergies::joint(&source_basis, &target_basis, 30).unwrap();
    let describe = |basis: &LaplaceBasis, landmarks: &[usize]| {
        let mut parts = vec![
            heat_kernel_signature(basis, &times),
            wave_kernel_signature(basis, &energies),
        ];
        for &landmark in landmarks {
            parts.push(heat_kernel_from_landmark(basis, landmark, &times).unwrap());
            parts.push(wave_kernel_from_landmark(basis, landmark, &energies).unwrap());
        }
        normalize_columns(concatenate_columns(&parts), &basis.mass)
    };
    let source = Owned {
        descriptors: describe(&source_basis, &source_landmarks),
        mesh: file.mesh,
        basis: source_basis,
    };
    let target = Owned {
        descriptors: describe(&target_basis, &target_landmarks),
        mesh: target,
        basis: target_basis,
    };

    let (s, t) = (source.shape(), target.shape());
    let first = fit(&s, &t, &FitOptions::default()).unwrap();
    let zoomed = zoomout(s.basis, t.basis, &first.map, &ZoomOutOptions::default()).unwrap();
    let refined = bcicp(&s, &t, &zoomed.map, &BcicpOptions::default()).unwrap();
    let error = |map| mean_error_mm(s.mesh, t.mesh, map, &truth).unwrap();
    let (rough, fine) = (error(&zoomed.point_map), error(&refined.target_to_source));
    assert!(rough < 3.0, "{rough} mm after ZoomOut");
    assert!(fine < 1.0, "{fine} mm after BCICP");
    assert!(vertex_coverage(&refined.target_to_source) > 0.9);
    let wrong = (0..t.mesh.n_vertices())
        .filter(|&y| labels[refined.target_to_source.image(y)] != labels[truth.image(y)])
        .count();
    assert_eq!(wrong, 0, "target vertices on another vertebra");
}

fn basis(mesh: &TriMesh) -> LaplaceBasis {
    let operators = cotangent_operators(mesh, &OperatorOptions::default()).unwrap();
    laplace_basis(
        &operators.stiffness,
        &operators.mass,
        N_FUNCTIONS,
        &EigenOptions::default(),
    )
    .unwrap()
}

/// The most posterior vertex of every vertebra, and the target vertex nearest to a point up to
/// 5 mm away from it, as a hand would point at it.
fn tips(source: &TriMesh, labels: &[u32], target: &TriMesh) -> (Vec<usize>, Vec<usize>) {
    let mut numbers = Numbers(3);
    let pick = |n: usize, score: &dyn Fn(usize) -> f64| {
        (0..n)
            .min_by(|&a, &b| score(a).total_cmp(&score(b)))
            .unwrap()
    };
    (1..=N_VERTEBRAE)
        .map(|label| {
            let tip = pick(source.n_vertices(), &|v| {
                let outside = if labels[v] == label {
                    0.0
                } else {
                    f64::INFINITY
                };
                source.vertices()[v].x + outside
            });
            let [x, y, z] = std::array::from_fn(|_| numbers.normal());
            let off = Vector3::new(x, y, z).normalize() * (5.0 * numbers.next());
            let seen = source.vertices()[tip] + off;
            let touched = pick(target.n_vertices(), &|v| {
                (target.vertices()[v] - seen).norm()
            });
            (tip, touched)
        })
        .unzip()
}

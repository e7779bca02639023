//! Two poses of an animal as a pair of shapes: bases, descriptors, the truth and maps to start from.

use faer::Mat;
use pedicle_descriptors::{
    HeatTimes, WaveEnergies, concatenate_columns, heat_kernel_from_landmark, heat_kernel_signature,
    normalize_columns, wave_kernel_from_landmark, wave_kernel_signature,
};
use pedicle_fmap::{FitOptions, FunctionalMap, PointMap, PointMapPair, Shape, fit};
use pedicle_laplacian::{OperatorOptions, cotangent_operators};
use pedicle_mesh::TriMesh;
use pedicle_spectral::{EigenOptions, LaplaceBasis, laplace_basis};

use crate::animal::Animal;

/// Places a user would point at: both front feet, a hind foot, the nose.
const LANDMARKS: [[f64; 3]; 4] = [
    [28.0, 10.0, -41.0],
    [28.0, -10.0, -41.0],
    [-28.0, 10.0, -43.0],
    [67.0, 0.0, 18.0],
];

/// A mesh with its basis and descriptors.
pub(crate) struct Described {
    pub(crate) mesh: TriMesh,
    pub(crate) basis: LaplaceBasis,
    pub(crate) descriptors: Mat<f64>,
}

impl Described {
    pub(crate) fn shape(&self) -> Shape<'_> {
        Shape {
            mesh: &self.mesh,
            basis: &self.basis,
            descriptors: &self.descriptors,
        }
    }
}

/// Two poses with the true maps between them.
pub(crate) struct Bent {
    pub(crate) source: Described,
    pub(crate) target: Described,
    /// The nearest source vertex to where every target vertex truly belongs.
    pub(crate) truth: PointMap,
    pub(crate) way_back: PointMap,
}

impl Bent {
    /// A pair of poses with `n_functions` functions each.
    pub(crate) fn new(source: Animal, target: Animal, n_functions: usize) -> Self {
        let truth = target.truth_onto(&source);
        let way_back = source.truth_onto(&target);
        let bases = (
            basis(&source.mesh, n_functions),
            basis(&target.mesh, n_functions),
        );
        let at = |animal: &Animal| LANDMARKS.map(|p| animal.vertex_at(p));
        let landmarks = (at(&source), at(&target));
        let (a, b) = described(&bases, (&landmarks.0, &landmarks.1));
        Self {
            source: Described {
                mesh: source.mesh,
                basis: bases.0,
                descriptors: a,
            },
            target: Described {
                mesh: target.mesh,
                basis: bases.1,
                descriptors: b,
            },
            truth,
            way_back,
        }
    }

    pub(crate) fn true_maps(&self) -> PointMapPair {
        PointMapPair {
            target_to_source: self.truth.clone(),
            source_to_target: self.way_back.clone(),
        }
    }

    /// Fits without and with landmarks.
    pub(crate) fn starts(&self) -> Vec<(&'static str, FunctionalMap)> {
        let options = FitOptions {
            n_source: 40,
            n_target: 40,
            ..FitOptions::default()
        };
        let (source, target) = (self.source.shape(), self.target.shape());
        let n_free = self.source.descriptors.ncols() - 20 * LANDMARKS.len();
        let free = |shape: &Shape<'_>| shape.descriptors.subcols(0, n_free).to_owned();
        let (a, b) = (free(&source), free(&target));
        let without = fit(
            &Shape {
                descriptors: &a,
                ..source
            },
            &Shape {
                descriptors: &b,
                ..target
            },
            &options,
        );
        let with = fit(&source, &target, &options);
        vec![
            ("no landmarks", without.unwrap().map),
            ("four landmarks", with.unwrap().map),
        ]
    }
}

fn basis(mesh: &TriMesh, n_functions: usize) -> LaplaceBasis {
    let operators = cotangent_operators(mesh, &OperatorOptions::default()).unwrap();
    let options = EigenOptions::default();
    laplace_basis(&operators.stiffness, &operators.mass, n_functions, &options).unwrap()
}

/// Heat and wave signatures, then those from the landmarks, 20 columns each.
fn described(
    bases: &(LaplaceBasis, LaplaceBasis),
    landmarks: (&[usize], &[usize]),
) -> (Mat<f64>, Mat<f64>) {
    let times = HeatTimes::joint(&bases.0, &bases.1, 10).unwrap();
    let energies = WaveEnergies::joint(&bases.0, &bases.1, 60).unwrap();
    let few = WaveEnergies::joint(&bases.0, &bases.1, 10).unwrap();
    let describe = |basis: &LaplaceBasis, landmarks: &[usize]| {
        let mut parts = vec![
            heat_kernel_signature(basis, &times),
            wave_kernel_signature(basis, &energies),
        ];
        for &landmark in landmarks {
            parts.push(heat_kernel_from_landmark(basis, landmark, &times).unwrap());
            parts.push(wave_kernel_from_landmark(basis, landmark, &few).unwrap());
        }
        normalize_columns(concatenate_columns(&parts), &basis.mass)
    };
    (
        describe(&bases.0, landmarks.0),
        describe(&bases.1, landmarks.1),
    )
}

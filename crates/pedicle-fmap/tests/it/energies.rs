//! The energy: its gradient, its zeros and what its terms tell apart.

use faer::Mat;
use pedicle_fmap::{
    Energy, EnergyWeights, FitOptions, FitTermination, LaplacianMask, OperatorColumns,
    OrientationBehaviour, fit,
};
use pedicle_mesh::TriMesh;

use crate::shapes::{Numbers, Owned, lump, pair, shuffled};

fn rectangular_pair() -> (Owned, Owned) {
    let (target, _) = shuffled(&lump(2, 0.3), 5);
    pair(lump(2, 0.0), target, 20, &[])
}

fn some_matrix(rows: usize, columns: usize, seed: u64) -> Mat<f64> {
    let mut numbers = Numbers(seed);
    Mat::from_fn(rows, columns, |_, _| numbers.normal())
}

fn inner(a: &Mat<f64>, b: &Mat<f64>) -> f64 {
    let entries = |m: &Mat<f64>| {
        let columns = (0..m.ncols()).flat_map(|j| m.col_as_slice(j).to_vec());
        columns.collect::<Vec<f64>>()
    };
    entries(a).iter().zip(entries(b)).map(|(x, y)| x * y).sum()
}

fn options(weights: EnergyWeights) -> FitOptions {
    FitOptions {
        n_source: 13,
        n_target: 17,
        weights,
        operator_columns: OperatorColumns::Listed(vec![1, 8, 20]),
        ..FitOptions::default()
    }
}

#[test]
fn the_gradient_is_that_of_finite_differences_for_every_term() {
    let (source, target) = rectangular_pair();
    let one = EnergyWeights {
        descriptors: 1e-9,
        laplacian: 0.0,
        descriptor_commutativity: 0.0,
        orientation: 0.0,
        norm: 1e-9,
    };
    let each = [
        EnergyWeights {
            descriptors: 1.0,
            ..one
        },
        EnergyWeights {
            laplacian: 1.0,
            ..one
        },
        EnergyWeights {
            descriptor_commutativity: 1.0,
            ..one
        },
        EnergyWeights {
            orientation: 1.0,
            ..one
        },
        EnergyWeights { norm: 1.0, ..one },
    ];
    for (term, weights) in each.into_iter().enumerate() {
        for orientation in [
            OrientationBehaviour::Preserving,
            OrientationBehaviour::Reversing,
        ] {
            let options = FitOptions {
                orientation,
                ..options(weights)
            };
            let energy = Energy::new(&source.shape(), &target.shape(), &options).unwrap();
            let c = some_matrix(17, 13, 1);
            let direction = some_matrix(17, 13, 2);
            // The energy is quadratic: central differences are exact at any step.
            let at = |step: f64| energy.value(&(&c + step * &direction)).total();
            let difference = (at(0.5) - at(-0.5)) / 1.0;
            let exact = inner(&energy.gradient(&c), &direction);
            assert!(
                (difference - exact).abs() <= 1e-10 * exact.abs().max(at(0.5)),
                "term {term}: {difference} against {exact}"
            );
            assert!(exact.abs() > 1e-8, "term {term} is there");
        }
    }
}

#[test]
fn every_term_vanishes_at_the_identity_between_equal_shapes() {
    let (source, target) = pair(lump(2, 0.0), lump(2, 0.0), 20, &[(3, 3)]);
    let identity = Mat::<f64>::identity(15, 15);
    for mask in [
        LaplacianMask::Standard,
        LaplacianMask::Resolvent { gamma: 0.5 },
        LaplacianMask::Slanted,
    ] {
        let options = FitOptions {
            n_source: 15,
            n_target: 15,
            mask,
            weights: EnergyWeights {
                descriptors: 1.0,
                laplacian: 1.0,
                descriptor_commutativity: 1.0,
                orientation: 1.0,
                norm: 1e-12,
            },
            ..FitOptions::default()
        };
        let energy = Energy::new(&source.shape(), &target.shape(), &options).unwrap();
        assert!(energy.value(&identity).total() < 1e-10);
        assert!(energy.gradient(&identity).norm_l2() < 1e-9);
    }
}

#[test]
fn the_fit_is_where_the_gradient_vanishes() {
    let (source, target) = rectangular_pair();
    let all = EnergyWeights {
        descriptors: 1.0,
        laplacian: 0.5,
        descriptor_commutativity: 0.7,
        orientation: 0.3,
        norm: 1e-6,
    };
    let separable = EnergyWeights {
        descriptor_commutativity: 0.0,
        orientation: 0.0,
        ..all
    };
    for (weights, expected) in [
        (all, FitTermination::Converged),
        (separable, FitTermination::Direct),
    ] {
        let options = options(weights);
        let found = fit(&source.shape(), &target.shape(), &options).unwrap();
        assert_eq!(found.termination, expected);
        assert!(found.gradient_norm < 1e-8, "{}", found.gradient_norm);
        let energy = Energy::new(&source.shape(), &target.shape(), &options).unwrap();
        for seed in 0..5 {
            let other = &found.map.matrix + 1e-2 * &some_matrix(17, 13, seed);
            assert!(energy.value(&other).total() > found.energies.total());
        }
    }
}

#[test]
fn an_exhausted_iteration_says_so() {
    let (source, target) = rectangular_pair();
    let options = FitOptions {
        max_iterations: 1,
        tolerance: 1e-12,
        ..options(EnergyWeights::default())
    };
    let found = fit(&source.shape(), &target.shape(), &options).unwrap();
    assert_eq!(found.termination, FitTermination::IterationLimit);
    assert_eq!(found.iterations, 1);
    assert!(found.gradient_norm > 1e-12);
}

#[test]
fn the_fit_does_not_depend_on_the_unit_of_length() {
    let fitted = |scale: f64| {
        let scaled = |mesh: TriMesh| {
            let vertices = mesh.vertices().iter().map(|p| p * scale).collect();
            TriMesh::new(vertices, mesh.faces().to_vec()).unwrap()
        };
        let (target, _) = shuffled(&lump(2, 0.3), 5);
        let (source, target) = pair(scaled(lump(2, 0.0)), scaled(target), 20, &[]);
        let found = fit(
            &source.shape(),
            &target.shape(),
            &options(EnergyWeights::default()),
        );
        found.unwrap().energies.total()
    };
    let reference = fitted(1.0);
    for scale in [1e-3, 1e3] {
        assert!(
            (fitted(scale) / reference - 1.0).abs() < 1e-6,
            "scale {scale}"
        );
    }
}

#[test]
fn orientation_tells_a_map_from_its_mirror_image() {
    // The mirrored shape with its faces turned, so that both meshes look outwards.
    let source = lump(2, 0.0);
    let vertices = source
        .vertices()
        .iter()
        .map(|p| nalgebra::Point3::new(p.x, -p.y, p.z))
        .collect();
    let faces = source.faces().iter().map(|&[a, b, c]| [a, c, b]).collect();
    let mirrored = TriMesh::new(vertices, faces).unwrap();
    let (source, target) = pair(source, mirrored, 20, &[]);
    let size = FitOptions {
        n_source: 15,
        n_target: 15,
        ..FitOptions::default()
    };
    let pulled = pedicle_fmap::functional_from_point_map(
        &source.basis,
        &target.basis,
        &pedicle_fmap::PointMap::identity(source.mesh.n_vertices()).unwrap(),
        (15, 15),
    )
    .unwrap();
    let at = |orientation| {
        let options = FitOptions {
            orientation,
            ..size.clone()
        };
        let energy = Energy::new(&source.shape(), &target.shape(), &options).unwrap();
        energy.value(&pulled.matrix).orientation
    };
    assert!(at(OrientationBehaviour::Reversing) < 1e-12);
    assert!(at(OrientationBehaviour::Preserving) > 1e-3);
}

#[test]
fn the_scale_of_a_pair_of_descriptors_does_not_matter_to_its_operators() {
    let (mut source, mut target) = rectangular_pair();
    let c = some_matrix(17, 13, 3);
    let options = options(EnergyWeights::default());
    let terms = |source: &Owned, target: &Owned| {
        let energy = Energy::new(&source.shape(), &target.shape(), &options).unwrap();
        energy.value(&c)
    };
    let before = terms(&source, &target);
    for shape in [&mut source, &mut target] {
        let column = shape.descriptors.col_as_slice_mut(8);
        column.iter_mut().for_each(|value| *value *= 1e-8);
    }
    let after = terms(&source, &target);
    for (a, b) in [
        (
            before.descriptor_commutativity,
            after.descriptor_commutativity,
        ),
        (before.orientation, after.orientation),
    ] {
        assert!((a - b).abs() < 1e-9 * a, "{a} against {b}");
    }
}

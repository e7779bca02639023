//! Everything that can be wrong is said, and nothing panics.

use faer::Mat;
use pedicle_fmap::{
    BcicpOptions, EnergyWeights, FitOptions, FmapError, FunctionalMap, LaplacianMask,
    OperatorColumns, PointMap, Shape, Side, ZoomOutOptions, bcicp, fit, functional_from_point_map,
    point_map_from_functional, zoomout,
};

use crate::shapes::{Owned, lump, pair};

fn shapes() -> (Owned, Owned) {
    pair(lump(1, 0.0), lump(1, 0.2), 20, &[])
}

fn small() -> FitOptions {
    FitOptions {
        n_source: 10,
        n_target: 10,
        ..FitOptions::default()
    }
}

fn refused(source: &Shape<'_>, target: &Shape<'_>, options: &FitOptions) -> FmapError {
    let error = fit(source, target, options).unwrap_err();
    let message = error.to_string();
    assert!(
        !message.is_empty() && message != format!("{error:?}"),
        "{message}"
    );
    error
}

#[test]
fn more_functions_than_the_basis_has() {
    let (source, target) = shapes();
    let options = FitOptions {
        n_target: 21,
        ..small()
    };
    assert_eq!(
        refused(&source.shape(), &target.shape(), &options),
        FmapError::BasisTooSmall {
            side: Side::Target,
            requested: 21,
            available: 20
        }
    );
    let options = FitOptions {
        n_source: 0,
        ..small()
    };
    assert!(matches!(
        refused(&source.shape(), &target.shape(), &options),
        FmapError::Empty { .. }
    ));
}

#[test]
fn descriptors_that_do_not_fit() {
    let (source, mut target) = shapes();
    let fewer = target.descriptors.subcols(0, 5).to_owned();
    let shape = Shape {
        descriptors: &fewer,
        ..target.shape()
    };
    assert!(matches!(
        refused(&source.shape(), &shape, &small()),
        FmapError::SizeMismatch { found: 5, .. }
    ));
    let none = Mat::zeros(target.mesh.n_vertices(), 0);
    let shape = Shape {
        descriptors: &none,
        ..target.shape()
    };
    assert!(matches!(
        refused(&shape, &shape, &small()),
        FmapError::Empty { .. }
    ));
    let zero = Mat::zeros(target.mesh.n_vertices(), 3);
    let shape = Shape {
        descriptors: &zero,
        ..target.shape()
    };
    assert!(matches!(
        refused(&shape, &shape, &small()),
        FmapError::Empty { .. }
    ));
    target.descriptors[(7, 2)] = f64::NAN;
    assert!(matches!(
        refused(&source.shape(), &target.shape(), &small()),
        FmapError::NonFinite {
            row: 7,
            column: 2,
            ..
        }
    ));
}

#[test]
fn a_mesh_or_basis_that_does_not_fit() {
    let (source, mut target) = shapes();
    let other = lump(2, 0.0);
    let shape = Shape {
        mesh: &other,
        ..source.shape()
    };
    assert!(matches!(
        refused(&shape, &target.shape(), &small()),
        FmapError::SizeMismatch {
            found: 162,
            expected: 42,
            ..
        }
    ));
    target.basis.eigenfunctions[(1, 4)] = f64::INFINITY;
    assert!(matches!(
        refused(&source.shape(), &target.shape(), &small()),
        FmapError::NonFinite {
            row: 1,
            column: 4,
            ..
        }
    ));
}

#[test]
fn options_that_make_no_sense() {
    let (source, target) = shapes();
    let weights = |weights: EnergyWeights| FitOptions { weights, ..small() };
    let default = EnergyWeights::default();
    let all = [
        weights(EnergyWeights {
            descriptors: 0.0,
            ..default
        }),
        weights(EnergyWeights {
            laplacian: -1.0,
            ..default
        }),
        weights(EnergyWeights {
            orientation: f64::NAN,
            ..default
        }),
        weights(EnergyWeights {
            norm: 0.0,
            ..default
        }),
        FitOptions {
            mask: LaplacianMask::Resolvent { gamma: 0.0 },
            ..small()
        },
        FitOptions {
            tolerance: 0.0,
            ..small()
        },
    ];
    for options in all {
        let error = refused(&source.shape(), &target.shape(), &options);
        assert!(matches!(error, FmapError::InvalidOption { .. }), "{error}");
    }
    let options = FitOptions {
        operator_columns: OperatorColumns::Listed(vec![99]),
        ..small()
    };
    assert!(matches!(
        refused(&source.shape(), &target.shape(), &options),
        FmapError::ColumnOutOfRange { column: 99, .. }
    ));
}

#[test]
fn maps_that_do_not_fit() {
    let (source, target) = shapes();
    let (s, t) = (&source.basis, &target.basis);
    let large = FunctionalMap {
        matrix: Mat::zeros(20, 21),
    };
    assert!(point_map_from_functional(s, t, &large).is_err());
    let broken = FunctionalMap {
        matrix: Mat::full(5, 5, f64::NAN),
    };
    assert!(point_map_from_functional(s, t, &broken).is_err());
    assert_eq!(
        PointMap::new(vec![1, 9], 3),
        Err(FmapError::ImageOutOfRange {
            vertex: 1,
            image: 9,
            n_vertices: 3
        })
    );
    assert!(PointMap::identity(0).is_err());
    let short = PointMap::new(vec![0; 3], 42).unwrap();
    assert!(functional_from_point_map(s, t, &short, (5, 5)).is_err());

    let map = FunctionalMap {
        matrix: Mat::identity(10, 10),
    };
    for options in [
        ZoomOutOptions {
            n_source: 20,
            n_target: 20,
            step: 0,
        },
        ZoomOutOptions {
            n_source: 9,
            n_target: 20,
            step: 1,
        },
        ZoomOutOptions {
            n_source: 20,
            n_target: 99,
            step: 1,
        },
    ] {
        assert!(zoomout(s, t, &map, &options).is_err());
    }
    for options in [
        BcicpOptions {
            n_source: Some(21),
            ..Default::default()
        },
        BcicpOptions {
            max_preimages: 0,
            ..Default::default()
        },
        BcicpOptions {
            outlier_share: f64::NAN,
            ..Default::default()
        },
    ] {
        assert!(bcicp(&source.shape(), &target.shape(), &map, &options).is_err());
    }
}

#[test]
fn a_map_of_zeros_is_a_poor_map_but_no_panic() {
    let (source, target) = shapes();
    let zero = FunctionalMap {
        matrix: Mat::zeros(10, 10),
    };
    let options = BcicpOptions::default();
    let refined = bcicp(&source.shape(), &target.shape(), &zero, &options).unwrap();
    assert_eq!(refined.target_to_source.n_target_vertices(), 42);
}

//! Random surfaces: whatever comes, the operators are sound or the error is the right one.

use nalgebra::Point3;
use pedicle_laplacian::{
    Construction, LaplaceOperators, LaplaceOptions, MassKind, OperatorError, Surface,
    laplace_operators,
};
use pedicle_mesh::TriMesh;
use proptest::prelude::*;

/// Symmetric to the bit, rows that sum to 0, no negative weight, positive masses that sum to the area.
fn check(operators: &LaplaceOperators) -> Result<(), TestCaseError> {
    let w = &operators.stiffness;
    for (&value, (i, j)) in w.iter() {
        prop_assert_eq!(value.to_bits(), w.get(j, i).unwrap().to_bits());
        let diagonal = w.get(i, i).unwrap().min(*w.get(j, j).unwrap());
        prop_assert!(value.is_finite());
        prop_assert!(
            i == j || value < 1e-8 * diagonal,
            "{} beside {}",
            value,
            diagonal
        );
    }
    for (i, row) in w.outer_iterator().enumerate() {
        let sum: f64 = row.data().iter().sum();
        prop_assert!(
            sum.abs() < 1e-12 * w.get(i, i).unwrap(),
            "row {} sums to {}",
            i,
            sum
        );
    }
    prop_assert!(operators.mass.iter().all(|&m| m > 0.0));
    prop_assert_eq!(operators.report.n_non_delaunay_edges, 0);
    let total: f64 = operators.vertex_mass.iter().sum();
    prop_assert!((total / operators.report.area_mm2 - 1.0).abs() < 1e-12);
    Ok(())
}

fn robust(mass: MassKind) -> LaplaceOptions {
    LaplaceOptions {
        construction: Construction::Robust,
        mass,
        ..LaplaceOptions::default()
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// Few vertices on few places: everything that can go wrong does.
    #[test]
    fn face_soup(
        places in proptest::collection::vec([0_i8..4, 0..4, 0..3], 3..10),
        faces in proptest::collection::vec([0_usize..10, 0..10, 0..10], 1..30),
        log_scale in -3.0_f64..3.0,
    ) {
        let scale = 10.0_f64.powf(log_scale);
        let n = places.len();
        let vertices = places.iter().map(|p| Point3::from(p.map(|c| scale * f64::from(c))));
        let faces = faces.iter().map(|f| f.map(|v| (v % n) as u32));
        let mesh = TriMesh::new(vertices.collect(), faces.collect()).unwrap();
        for mass in [MassKind::Barycentric, MassKind::MixedVoronoi] {
            match laplace_operators(Surface::Mesh(&mesh), &robust(mass)) {
                Ok(operators) => check(&operators)?,
                Err(error) => {
                    let is_flat = matches!(error, OperatorError::NoArea { .. });
                    prop_assert!(is_flat, "{}", error);
                }
            }
        }
    }

    /// Points in general position, faces at random: hundreds of flips on a cover full of branches.
    #[test]
    fn tangle(
        points in proptest::collection::vec([-1.0_f64..1.0, -1.0..1.0, -0.1..0.1], 12),
        faces in proptest::collection::vec([0_u32..12, 0..12, 0..12], 20..60),
    ) {
        let mesh = TriMesh::new(points.into_iter().map(Point3::from).collect(), faces).unwrap();
        check(&laplace_operators(Surface::Mesh(&mesh), &robust(MassKind::Barycentric)).unwrap())?;
    }

    /// A few points, many of them on common lines, planes and circles.
    #[test]
    fn little_cloud(places in proptest::collection::vec([0_i8..5, 0..5, 0..2], 1..60)) {
        let points: Vec<_> = places.iter().map(|p| Point3::from(p.map(f64::from))).collect();
        match laplace_operators(Surface::Cloud(&points), &robust(MassKind::Barycentric)) {
            Ok(operators) => check(&operators)?,
            Err(error) => prop_assert!(
                matches!(
                    error,
                    OperatorError::TooFewPoints { .. } | OperatorError::NoTriangles { .. }
                ),
                "{}", error
            ),
        }
    }
}

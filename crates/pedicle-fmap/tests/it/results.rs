//! Precise maps, transfer, distributions and sizes of partial maps on shapes with a known answer.

use faer::Mat;
use nalgebra::{Point3, Vector3};
use pedicle_fmap::{
    Embedding, FmapError, FunctionalMap, Metric, PartialOptions, PartialSizes, PointInFace,
    PointMap, PointMapPair, PreciseMap, crop_along, edge_stretch, functional_from_point_map,
    functional_from_precise_map, map_errors, point_map_from_adjoint, point_map_from_functional,
    precise_map_errors, precise_map_from_functional, round_trip_errors, target_vertices_of_points,
};
use pedicle_geodesic::{EdgeGraph, HeatGeodesics, HeatOptions, Links};
use pedicle_laplacian::{OperatorOptions, cotangent_operators};
use pedicle_mesh::{TriMesh, edge_lengths};
use pedicle_spectral::{EigenOptions, LaplaceBasis, laplace_basis};

use crate::shapes::{five_lumps, lump, shuffled};

fn basis(mesh: &TriMesh, k: usize) -> LaplaceBasis {
    let operators = cotangent_operators(mesh, &OperatorOptions::default()).unwrap();
    let options = EigenOptions::default();
    laplace_basis(&operators.stiffness, &operators.mass, k, &options).unwrap()
}

fn identity(k: usize) -> FunctionalMap {
    FunctionalMap {
        matrix: Mat::identity(k, k),
    }
}

const EMBEDDINGS: [Embedding; 2] = [Embedding::Forward, Embedding::Adjoint];

#[test]
fn the_identity_is_precise_to_the_bit() {
    let mesh = lump(3, 0.0);
    let basis = basis(&mesh, 40);
    for embedding in EMBEDDINGS {
        let map =
            precise_map_from_functional(&mesh, (&basis, &basis), &identity(40), embedding).unwrap();
        for (vertex, point) in map.source_of_target.iter().enumerate() {
            assert_eq!(point.nearest_corner() as usize, vertex);
            let largest = point.barycentric.iter().copied().fold(0.0, f64::max);
            assert!((largest - 1.0).abs() <= 0.0, "{point:?}");
        }
        let points = map.to_point_map();
        assert_eq!(points, PointMap::identity(mesh.n_vertices()).unwrap());
        let positions = map.positions(&mesh).unwrap();
        assert_eq!(positions, mesh.vertices());
    }
    let again = functional_from_precise_map(
        &basis,
        &basis,
        &PreciseMap::from_point_map(&mesh, &PointMap::identity(mesh.n_vertices()).unwrap())
            .unwrap(),
        (40, 40),
    )
    .unwrap();
    assert!((&again.matrix - identity(40).matrix).norm_l2() < 1e-9);
}

#[test]
fn a_shuffled_copy_is_found_vertex_by_vertex() {
    let source = five_lumps(2);
    let (target, truth) = shuffled(&source, 3);
    let (a, b) = (basis(&source, 60), basis(&target, 60));
    let map = functional_from_point_map(&a, &b, &truth, (60, 60)).unwrap();
    assert_eq!(point_map_from_adjoint(&a, &b, &map).unwrap(), truth);
    for embedding in EMBEDDINGS {
        let precise = precise_map_from_functional(&source, (&a, &b), &map, embedding).unwrap();
        assert_eq!(precise.to_point_map(), truth);
        let back = functional_from_precise_map(&a, &b, &precise, (60, 60)).unwrap();
        assert!((&back.matrix - &map.matrix).norm_l2() < 1e-6);
    }
}

/// Fine target on a coarse source and the other way: the truth is the nearest point.
#[test]
fn precise_beats_vertices_between_coarse_and_fine_and_lands_within_the_edge() {
    let (coarse, fine) = (lump(3, 0.0), lump(4, 0.0));
    let k = 60;
    let (a, b) = (basis(&coarse, k), basis(&fine, k));
    for (source, target, s, t) in [(&coarse, &fine, &a, &b), (&fine, &coarse, &b, &a)] {
        let truth = PreciseMap::from_positions(source, target.vertices()).unwrap();
        let map = functional_from_precise_map(s, t, &truth, (k, k)).unwrap();
        let vertices = point_map_from_functional(s, t, &map).unwrap();
        let vertices = PreciseMap::from_point_map(source, &vertices).unwrap();
        let unit = edge_lengths(source).mean_mm / source.area().sqrt();
        for embedding in EMBEDDINGS {
            let precise = precise_map_from_functional(source, (s, t), &map, embedding).unwrap();
            let error = |found: &PreciseMap| {
                let meshes = (source, target);
                precise_map_errors(meshes, found, &truth, Metric::Euclidean).unwrap()
            };
            let (rough, exact) = (error(&vertices), error(&precise));
            assert!(exact.mean() < 0.2 * unit, "{} edges", exact.mean() / unit);
            assert!(exact.quantile(0.99) < unit);
            // The vertices of the coarse mesh are among those of the fine one: there the map of
            // vertices can be exact already.
            if source.n_vertices() < target.n_vertices() {
                assert!(exact.mean() < 0.5 * rough.mean());
            }
        }
    }
}

#[test]
fn precise_maps_do_not_depend_on_threads_or_scale() {
    let (source, target) = (lump(3, 0.0), lump(2, 0.3));
    let (a, b) = (basis(&source, 30), basis(&target, 25));
    let matrix = Mat::from_fn(25, 30, |i, j| {
        if i == j {
            1.0
        } else {
            0.1 * ((i * 7 + j * 3) as f64).sin()
        }
    });
    let map = FunctionalMap { matrix };
    let with = |threads: usize, embedding| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| precise_map_from_functional(&source, (&a, &b), &map, embedding).unwrap())
    };
    for embedding in EMBEDDINGS {
        assert_eq!(with(1, embedding), with(3, embedding));
    }
    let scaled = |mesh: &TriMesh, s: f64| {
        let vertices = mesh.vertices().iter().map(|p| p * s).collect();
        TriMesh::new(vertices, mesh.faces().to_vec()).unwrap()
    };
    for s in [1e-3, 1e3] {
        let big = scaled(&source, s);
        let (p, q) = (basis(&big, 30), basis(&scaled(&target, s), 25));
        let found = precise_map_from_functional(&big, (&p, &q), &map, Embedding::Forward).unwrap();
        let once = with(1, Embedding::Forward);
        let errors = precise_map_errors((&source, &target), &found, &once, Metric::Euclidean);
        assert!(errors.unwrap().quantile(0.95) < 1e-6);
    }
}

#[test]
fn functions_labels_and_points_are_carried() {
    let source = lump(3, 0.0);
    let (target, truth) = shuffled(&source, 5);
    let n = source.n_vertices();
    let values = Mat::from_fn(n, 2, |v, j| source.vertices()[v][j]);
    let carried = truth.pull_back(values.as_ref()).unwrap();
    let precise = PreciseMap::from_point_map(&source, &truth).unwrap();
    assert!((precise.pull_back(values.as_ref()).unwrap() - &carried).norm_l2() < 1e-12);
    for y in 0..n {
        assert!((carried[(y, 1)] - target.vertices()[y].y).abs() <= 0.0);
    }
    // Smooth functions survive the spectrum.
    let (a, b) = (basis(&source, 80), basis(&target, 80));
    let map = functional_from_point_map(&a, &b, &truth, (80, 80)).unwrap();
    let smooth = map.carry((&a, &b), values.as_ref()).unwrap();
    assert!((&smooth - &carried).norm_l2() < 0.03 * carried.norm_l2());

    let labels: Vec<u32> = (0..n as u32).collect();
    assert_eq!(
        truth.pull_back_labels(&labels).unwrap(),
        truth.source_of_target
    );
    assert_eq!(
        precise.pull_back_labels(&labels).unwrap(),
        truth.source_of_target
    );
    // Two light corners of one label outweigh the heaviest.
    let between = PreciseMap::new(
        vec![PointInFace {
            face: 0,
            corners: [0, 1, 2],
            barycentric: [0.4, 0.3, 0.3],
        }],
        3,
    )
    .unwrap();
    assert_eq!(between.pull_back_labels(&["a", "b", "b"]).unwrap(), ["b"]);

    let images = precise.positions(&source).unwrap();
    let points = [source.vertices()[7], source.vertices()[90]];
    let found = target_vertices_of_points(&images, &points).unwrap();
    let images: Vec<u32> = found
        .iter()
        .map(|&y| truth.source_of_target[y as usize])
        .collect();
    assert_eq!(images, [7, 90]);
}

#[test]
fn errors_are_those_of_the_metric() {
    let source = lump(3, 0.0);
    let n = source.n_vertices();
    let truth = PointMap::identity(n).unwrap();
    let found = PointMap::new((0..n as u32).map(|v| (v * 7 + 3) % n as u32).collect(), n).unwrap();
    let graph = EdgeGraph::new(&source, Links::AcrossEdges);
    let heat = HeatGeodesics::new(&source, &HeatOptions::default()).unwrap();
    let meshes = (&source, &source);
    let unit = source.area().sqrt();
    let [straight, paths, heated] = [
        Metric::Euclidean,
        Metric::Paths(&graph),
        Metric::Heat(&heat),
    ]
    .map(|metric| {
        assert!(map_errors(meshes, &truth, &truth, metric).unwrap().max() <= 0.0);
        map_errors(meshes, &found, &truth, metric).unwrap()
    });
    for v in 0..n {
        let d = (source.vertices()[v] - source.vertices()[found.image(v)]).norm() / unit;
        assert!((straight.values[v] - d).abs() < 1e-12);
        assert!(paths.values[v] >= d - 1e-12);
        assert!((heated.values[v] - paths.values[v]).abs() < 0.15 * paths.values[v] + 0.03);
    }
    assert!(paths.mean() > straight.mean());
    // A precise map at vertices has the errors of the point map, up to the ways to the corners.
    let precise = [&found, &truth].map(|m| PreciseMap::from_point_map(&source, m).unwrap());
    let same = precise_map_errors(meshes, &precise[0], &precise[1], Metric::Paths(&graph)).unwrap();
    for (x, y) in same.values.iter().zip(&paths.values) {
        assert!((x - y).abs() < 0.2 * y + 1e-12, "{x} and {y}");
    }

    let pair = PointMapPair {
        target_to_source: found.clone(),
        source_to_target: truth.clone(),
    };
    let trips = round_trip_errors(&source, &pair, Metric::Paths(&graph)).unwrap();
    assert!((trips.mean() - paths.mean()).abs() < 1e-12);
    let stretch = edge_stretch(meshes, &truth, Metric::Paths(&graph)).unwrap();
    assert!((stretch.median() - 1.0).abs() < 1e-12 && stretch.max() <= 1.0 + 1e-12);
    let torn = edge_stretch(meshes, &found, Metric::Euclidean).unwrap();
    assert!(torn.median() > 2.0);

    // Other components are infinitely far away.
    let two = five_lumps(1);
    let m = two.n_vertices();
    let moved = PointMap::new(
        (0..m as u32)
            .map(|v| (v + m as u32 / 5) % m as u32)
            .collect(),
        m,
    );
    let graph = EdgeGraph::new(&two, Links::Edges);
    let identity = PointMap::identity(m).unwrap();
    let far = map_errors(
        (&two, &two),
        &moved.unwrap(),
        &identity,
        Metric::Paths(&graph),
    )
    .unwrap();
    assert!(far.mean().is_infinite() && far.share_within(1e9) <= 0.0);
}

#[test]
fn distributions_weigh_their_values() {
    use pedicle_fmap::Distribution;
    let d = Distribution::new(vec![3.0, 1.0, 2.0], vec![1.0, 2.0, 1.0]).unwrap();
    assert!((d.mean() - 7.0 / 4.0).abs() < 1e-15);
    assert!((d.median() - 1.0).abs() < 1e-15 && (d.quantile(0.75) - 2.0).abs() < 1e-15);
    assert!((d.max() - 3.0).abs() < 1e-15 && (d.quantile(-1.0) - 1.0).abs() < 1e-15);
    assert_eq!(d.curve(&[0.0, 1.0, 2.5, 9.0]), [0.0, 0.5, 0.75, 1.0]);
    let even = Distribution::new(vec![1.0, 4.0], vec![0.0, 0.0]).unwrap();
    assert!((even.mean() - 2.5).abs() < 1e-15);
    assert!(Distribution::new(vec![], vec![]).is_err());
    assert!(Distribution::new(vec![1.0], vec![]).is_err());
    assert!(Distribution::new(vec![f64::NAN], vec![1.0]).is_err());
    assert!(Distribution::new(vec![1.0], vec![-1.0]).is_err());
}

#[test]
fn a_part_of_known_area_gets_the_sizes_of_its_share() {
    let whole = lump(4, 0.0);
    let k = 80;
    let a = basis(&whole, k);
    let options = PartialOptions {
        n_fit: 40,
        n_refined: 80,
        step: 5,
    };
    for share in [0.8, 0.5] {
        let part = crop_along(&whole, &Vector3::new(0.3, 1.0, 0.2), share).unwrap();
        let kept = part.mesh.area() / whole.area();
        assert!((kept - share).abs() < 0.01, "{kept}");
        let b = basis(&part.mesh, k);
        let sizes = PartialSizes::estimate(&a, &b, &options).unwrap();
        assert!((sizes.area_ratio - kept).abs() < 1e-9);
        // A free boundary adds modes: the slope lies above the share of the area, not far.
        assert!(
            sizes.slope > kept - 0.02 && sizes.slope < kept + 0.15,
            "{sizes:?}"
        );
        assert_eq!(
            (sizes.fit.1, sizes.rank, sizes.refined.1),
            (40, sizes.fit.0, 80)
        );
        // The other way round the sizes are exchanged.
        let swapped = PartialSizes::estimate(&b, &a, &options).unwrap();
        assert_eq!(swapped.fit, (sizes.fit.1, sizes.fit.0));
        assert_eq!(swapped.refined, (sizes.refined.1, sizes.refined.0));
        let fit = sizes.fit_options(pedicle_fmap::FitOptions::default());
        assert_eq!((fit.n_target, fit.n_source), sizes.fit);
        // A map onto the part, brought back to the whole.
        let onto = PointMap::identity(part.mesh.n_vertices()).unwrap();
        let lift = PointMap::new(part.source_vertex.clone(), whole.n_vertices()).unwrap();
        let lifted = onto.followed_by(&lift).unwrap();
        assert_eq!(lifted.positions(&whole).unwrap(), part.mesh.vertices());
    }
    let same = PartialSizes::estimate(&a, &a, &options).unwrap();
    assert_eq!((same.fit, same.refined), ((40, 40), (80, 80)));
    assert_eq!(
        crop_along(&whole, &Vector3::x(), 1.0)
            .unwrap()
            .mesh
            .n_faces(),
        whole.n_faces()
    );
}

#[test]
fn wrong_arguments_are_refused() {
    let mesh = lump(2, 0.0);
    let other = lump(1, 0.0);
    let b = basis(&mesh, 12);
    let map = identity(12);
    let refused = precise_map_from_functional(&other, (&b, &b), &map, Embedding::Forward);
    assert!(matches!(refused, Err(FmapError::SizeMismatch { .. })));
    let refused = precise_map_from_functional(&mesh, (&b, &b), &identity(13), Embedding::Adjoint);
    assert!(matches!(refused, Err(FmapError::BasisTooSmall { .. })));
    assert!(point_map_from_adjoint(&b, &b, &identity(13)).is_err());
    let point = |corners, barycentric| PointInFace {
        face: 0,
        corners,
        barycentric,
    };
    for bad in [
        point([0, 1, 9], [1.0, 0.0, 0.0]),
        point([0, 1, 2], [0.5, 0.6, 0.0]),
        point([0, 1, 2], [1.5, -0.5, 0.0]),
        point([0, 1, 2], [f64::NAN, 0.5, 0.5]),
    ] {
        assert!(PreciseMap::new(vec![bad], 3).is_err(), "{bad:?}");
    }
    assert!(PreciseMap::new(vec![], 3).is_err());
    assert!(PreciseMap::from_positions(&mesh, &[Point3::new(f64::NAN, 0.0, 0.0)]).is_err());
    let identity = PointMap::identity(mesh.n_vertices()).unwrap();
    assert!(PreciseMap::from_point_map(&other, &identity).is_err());
    let precise = PreciseMap::from_point_map(&mesh, &identity).unwrap();
    assert!(precise.positions(&other).is_err());
    assert!(functional_from_precise_map(&b, &basis(&other, 12), &precise, (12, 12)).is_err());
    let short = Mat::zeros(3, 1);
    assert!(identity.pull_back(short.as_ref()).is_err());
    assert!(precise.pull_back(short.as_ref()).is_err());
    assert!(map.carry((&b, &b), short.as_ref()).is_err());
    assert!(identity.pull_back_labels(&[1, 2]).is_err());
    let graph = EdgeGraph::new(&other, Links::Edges);
    let refused = map_errors((&mesh, &mesh), &identity, &identity, Metric::Paths(&graph));
    assert!(refused.is_err());
    assert!(target_vertices_of_points(&[], &[]).is_err());
    for share in [0.0, 1.5, f64::NAN] {
        assert!(crop_along(&mesh, &Vector3::x(), share).is_err());
    }
    assert!(crop_along(&mesh, &Vector3::zeros(), 0.5).is_err());
    let none = PartialOptions {
        n_fit: 0,
        ..PartialOptions::default()
    };
    assert!(PartialSizes::estimate(&b, &b, &none).is_err());
    let more = PartialOptions {
        n_fit: 13,
        ..PartialOptions::default()
    };
    assert!(PartialSizes::estimate(&b, &b, &more).is_err());
}

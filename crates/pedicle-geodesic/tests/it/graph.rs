//! Shortest paths against distances in the plane and on the sphere.

use pedicle_geodesic::{EdgeGraph, Links};

use crate::shapes::{scaled, sphere, square, torus, twice};

#[test]
fn paths_in_a_square_are_never_too_short_and_little_too_long() {
    let mesh = square(20, 0.0);
    for (links, excess) in [(Links::Edges, 1.42), (Links::AcrossEdges, 1.0824)] {
        let distances = EdgeGraph::new(&mesh, links).distances_from(&[0]).unwrap();
        let mut worst = 1.0_f64;
        for (p, d) in mesh.vertices().iter().zip(&distances).skip(1) {
            let truth = p.coords.norm();
            assert!(*d >= truth * (1.0 - 1e-12));
            worst = worst.max(d / truth);
        }
        assert!(worst < excess, "{links:?}: {worst}");
    }
}

#[test]
fn paths_on_a_sphere_stay_within_a_few_percent_of_the_arcs() {
    let mesh = sphere(5);
    let graph = EdgeGraph::new(&mesh, Links::AcrossEdges);
    let distances = graph.distances_from(&[100]).unwrap();
    let start = mesh.vertices()[100].coords;
    for (p, d) in mesh.vertices().iter().zip(&distances) {
        let arc = 2.0 * (0.5 * (p.coords - start).norm()).min(1.0).asin();
        // Chords are shorter than arcs by a thousandth.
        assert!(*d >= 0.999 * arc && *d <= 1.07 * arc, "{d} for {arc}");
    }
}

#[test]
fn pairs_agree_with_full_searches_and_do_not_depend_on_threads() {
    let mesh = torus(60, 2.0, 0.7);
    let graph = EdgeGraph::new(&mesh, Links::AcrossEdges);
    let n = mesh.n_vertices() as u32;
    let mut pairs: Vec<(u32, u32)> = (0..200).map(|i| (i * 37 % n, i * 101 % n)).collect();
    pairs.extend([(5, 5), (5, 9), (5, 700 % n), (5, 9)]);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| graph.distances_between(&pairs).unwrap())
    };
    let found = with(1);
    assert_eq!(found, with(3));
    for (&(a, b), d) in pairs.iter().zip(&found) {
        let all = graph.distances_from(&[a]).unwrap();
        assert!((all[b as usize] - d).abs() < 1e-12);
        let back = graph.distances_between(&[(b, a)]).unwrap()[0];
        assert!((back - d).abs() < 1e-12, "symmetric");
    }
    // Triangle inequality, to rounding.
    let [x, y, z] = [3, 400, 777].map(|v| graph.distances_from(&[v]).unwrap());
    for v in 0..n as usize {
        assert!(x[v] <= x[400] + y[v] + 1e-12 && y[v] <= y[777] + z[v] + 1e-12);
    }
}

#[test]
fn balls_are_the_near_part_of_all_distances() {
    let mesh = sphere(3);
    let graph = EdgeGraph::new(&mesh, Links::Edges);
    let all = graph.distances_from(&[17]).unwrap();
    let ball = graph.ball(17, 0.6).unwrap();
    assert_eq!(ball[0], (17, 0.0));
    assert!(ball.windows(2).all(|w| w[0].1 <= w[1].1));
    let n_near = all.iter().filter(|&&d| d <= 0.6).count();
    assert_eq!(ball.len(), n_near);
    assert!(
        ball.iter()
            .all(|&(v, d)| (all[v as usize] - d).abs() <= 0.0)
    );
    let several = graph.balls(&[3, 17], 0.6).unwrap();
    assert_eq!(several[1], ball);
    assert_eq!(graph.ball(17, 0.0).unwrap().len(), 1);
}

#[test]
fn several_sources_give_the_nearest_and_scale_follows_the_mesh() {
    let mesh = sphere(3);
    let graph = EdgeGraph::new(&mesh, Links::default());
    let (a, b) = (
        graph.distances_from(&[3]).unwrap(),
        graph.distances_from(&[200]).unwrap(),
    );
    let both = graph.distances_from(&[3, 200]).unwrap();
    for v in 0..both.len() {
        assert!((both[v] - a[v].min(b[v])).abs() < 1e-14);
    }
    for scale in [1e-3, 1e3] {
        let graph = EdgeGraph::new(&scaled(&mesh, scale), Links::default());
        let found = graph.distances_from(&[3]).unwrap();
        for (x, y) in found.iter().zip(&a) {
            assert!((x / scale - y).abs() < 1e-9);
        }
    }
}

#[test]
fn no_path_leads_to_another_component() {
    let mesh = twice(&sphere(1));
    let n = mesh.n_vertices() / 2;
    let graph = EdgeGraph::new(&mesh, Links::default());
    let distances = graph.distances_from(&[0]).unwrap();
    assert!(distances[..n].iter().all(|d| d.is_finite()));
    assert!(distances[n..].iter().all(|d| d.is_infinite()));
    let far = graph
        .distances_between(&[(1, n as u32), (n as u32, n as u32 + 1)])
        .unwrap();
    assert!(far[0].is_infinite() && far[1].is_finite());
}

//! Maps of vertices against maps into triangles: error and time, from coarse to fine sources.
//!
//! ```text
//! cargo run --release --example precise_maps
//! ```
//!
//! Two triangulations of the phantom's spine, the true map between them as the nearest point, its
//! functional map in 100 × 100 functions, and what the conversions back make of it. With noise on C
//! the rows leave the surface and the search has more to look at.

#![allow(
    clippy::print_stdout,
    reason = "the example is there to print its table"
)]

use std::{error::Error, time::Instant};

use pedicle_fmap::{
    Embedding, Metric, PreciseMap, functional_from_precise_map, map_errors,
    point_map_from_functional, precise_map_errors, precise_map_from_functional,
};
use pedicle_geodesic::{EdgeGraph, HeatGeodesics, HeatOptions, Links};
use pedicle_laplacian::{Mollification, OperatorOptions, cotangent_operators};
use pedicle_mesh::{SimplifyOptions, TriMesh, concatenate, simplify};
use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};
use pedicle_spectral::{EigenOptions, LaplaceBasis, laplace_basis};

const N_FUNCTIONS: usize = 100;

fn main() -> Result<(), Box<dyn Error>> {
    // Two grids on the same solid: the surfaces have no vertex in common.
    let (full, other) = (spine(1.95)?, spine(1.8)?);
    println!("| source | target | noise on C | map | error / √area | s |");
    println!("|---|---|---|---|---|---|");
    for (n_source, n_target) in [(3_500, 20_000), (10_000, 9_000), (40_000, 36_000)] {
        let options = SimplifyOptions::default();
        let source = simplify(&full, n_source, &options)?.mesh;
        let target = simplify(&other, n_target, &options)?.mesh;
        let (a, b) = (basis(&source)?, basis(&target)?);
        let truth = PreciseMap::from_positions(&source, target.vertices())?;
        for noise in [0.0, 0.02] {
            let mut map = functional_from_precise_map(&a, &b, &truth, (N_FUNCTIONS, N_FUNCTIONS))?;
            for j in 0..N_FUNCTIONS {
                for i in 0..N_FUNCTIONS {
                    map.matrix[(i, j)] += noise * (7.0 * i as f64 + 13.0 * j as f64).sin();
                }
            }
            let print = |name: &str, error: f64, seconds: f64| {
                println!(
                    "| {} | {} | {noise} | {name} | {error:.5} | {seconds:.2} |",
                    source.n_vertices(),
                    target.n_vertices()
                );
            };
            let start = Instant::now();
            let vertices = point_map_from_functional(&a, &b, &map)?;
            let seconds = start.elapsed().as_secs_f64();
            let as_points = PreciseMap::from_point_map(&source, &vertices)?;
            let error = |found: &PreciseMap| -> Result<f64, Box<dyn Error>> {
                let meshes = (&source, &target);
                Ok(precise_map_errors(meshes, found, &truth, Metric::Euclidean)?.mean())
            };
            print("vertices", error(&as_points)?, seconds);
            for (name, embedding) in [
                ("precise", Embedding::Forward),
                ("precise, adjoint", Embedding::Adjoint),
            ] {
                let start = Instant::now();
                let found = precise_map_from_functional(&source, (&a, &b), &map, embedding)?;
                let seconds = start.elapsed().as_secs_f64();
                print(name, error(&found)?, seconds);
            }
            let start = Instant::now();
            let graph = EdgeGraph::new(&source, Links::AcrossEdges);
            let meshes = (&source, &target);
            let nearest = truth.to_point_map();
            let errors = map_errors(meshes, &vertices, &nearest, Metric::Paths(&graph))?;
            let seconds = start.elapsed().as_secs_f64();
            print("vertices, along paths", errors.mean(), seconds);
        }
        let start = Instant::now();
        let heat = HeatGeodesics::new(&source, &HeatOptions::default())?;
        let prepared = start.elapsed().as_secs_f64();
        let start = Instant::now();
        heat.distances_from(&[0])?;
        let query = start.elapsed().as_secs_f64();
        println!("heat method: factors {prepared:.3} s, a query {query:.4} s");
    }
    Ok(())
}

fn spine(cell_mm: f64) -> Result<TriMesh, Box<dyn Error>> {
    let phantom = generate_phantom(&PhantomParameters::subject(7), &MeshingOptions { cell_mm })?;
    let parts: Vec<&TriMesh> = phantom.vertebrae.iter().map(|v| &v.mesh).collect();
    Ok(concatenate(&parts)?)
}

fn basis(mesh: &TriMesh) -> Result<LaplaceBasis, Box<dyn Error>> {
    let options = OperatorOptions {
        mollification: Mollification::intrinsic(),
        ..OperatorOptions::default()
    };
    let operators = cotangent_operators(mesh, &options)?;
    Ok(laplace_basis(
        &operators.stiffness,
        &operators.mass,
        N_FUNCTIONS,
        &EigenOptions::default(),
    )?)
}

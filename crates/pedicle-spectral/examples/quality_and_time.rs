//! Time and quality of the smallest eigenpairs, side by side.
//!
//! ```text
//! cargo run --release --example quality_and_time -- 100
//! ```
//!
//! Quality is the largest residual over the last eigenvalue, the largest entry of |XᵀMX - I|, and
//! whether inertia proves the list complete.
#![allow(clippy::print_stdout, reason = "an example shows its results")]

use std::error::Error;
use std::time::Instant;

use faer::Mat;
use nalgebra::Point3;
use pedicle_laplacian::{OperatorOptions, cotangent_operators};
use pedicle_mesh::{TriMesh, concatenate};
use pedicle_spectral::{EigenOptions, EigenPairs, smallest_eigenpairs};

/// A torus with a wavy tube: one component, no symmetry left.
fn torus(n_around: u32, n_tube: u32, phase: f64) -> Result<TriMesh, Box<dyn Error>> {
    let mut vertices = Vec::new();
    for i in 0..n_around {
        for j in 0..n_tube {
            let u = std::f64::consts::TAU * f64::from(i) / f64::from(n_around);
            let v = std::f64::consts::TAU * f64::from(j) / f64::from(n_tube);
            let tube = 12.0 + 3.0 * (3.0 * u + phase).sin() + 2.0 * (2.0 * v - u).cos();
            let radius = 40.0 + tube * v.cos();
            let z = tube * v.sin() + 4.0 * (u + phase).sin();
            vertices.push(Point3::new(radius * u.cos(), radius * u.sin(), z));
        }
    }
    let at = |i: u32, j: u32| (i % n_around) * n_tube + j % n_tube;
    let mut faces = Vec::new();
    for i in 0..n_around {
        for j in 0..n_tube {
            faces.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            faces.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    Ok(TriMesh::new(vertices, faces)?)
}

fn worst_product(pairs: &EigenPairs, mass: &[f64]) -> f64 {
    let x = &pairs.eigenvectors;
    let weighted = Mat::from_fn(x.nrows(), x.ncols(), |i, j| mass[i] * x[(i, j)]);
    let gram = x.transpose() * &weighted;
    let mut worst = 0.0_f64;
    for j in 0..gram.ncols() {
        for i in 0..gram.nrows() {
            let expected = if i == j { 1.0 } else { 0.0 };
            worst = worst.max((gram[(i, j)] - expected).abs());
        }
    }
    worst
}

fn main() -> Result<(), Box<dyn Error>> {
    let n_pairs = match std::env::args().nth(1) {
        Some(text) => text.parse()?,
        None => 100,
    };
    let five: Vec<_> = (0..5)
        .map(|i| torus(100, 40, f64::from(i)))
        .collect::<Result<_, _>>()?;
    let shapes = [
        ("torus", torus(73, 24, 0.0)?),
        ("torus", torus(250, 80, 0.0)?),
        ("five tori", concatenate(&five.iter().collect::<Vec<_>>())?),
    ];
    println!(
        "shape       vertices pairs     ms  residual  product  complete  solves shifts restarts"
    );
    for (name, mesh) in shapes {
        let operators = cotangent_operators(&mesh, &OperatorOptions::default())?;
        let options = EigenOptions::default();
        let mut best = f64::INFINITY;
        let mut last = None;
        for _ in 0..5 {
            let start = Instant::now();
            let pairs =
                smallest_eigenpairs(&operators.stiffness, &operators.mass, n_pairs, &options)?;
            best = best.min(start.elapsed().as_secs_f64());
            last = Some(pairs);
        }
        let Some(pairs) = last else { continue };
        let end = pairs.eigenvalues[n_pairs - 1];
        let residual = pairs.residuals.iter().fold(0.0_f64, |m, r| m.max(r / end));
        println!(
            "{name:<12}{:>8} {n_pairs:>5} {:>6.1} {residual:>9.1e} {:>8.1e}  {:>8}  {:>6} {:>6} {:>8}",
            mesh.n_vertices(),
            1e3 * best,
            worst_product(&pairs, &operators.mass),
            pairs.certificate.complete,
            pairs.work.n_solves,
            pairs.work.n_shifts,
            pairs.work.n_restarts,
        );
    }
    Ok(())
}

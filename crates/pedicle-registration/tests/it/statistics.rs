//! Monte Carlo: is refinement as good as any can be, and does it know how good it is?

use nalgebra::Point3;
use pedicle_registration::{
    RefineOptions, RobustKernel, cramer_rao_bound, pose_error, refine_on_surface,
};

use crate::shapes::{Lump, in_cube, motion, noise, pose, rng};

const RUNS: usize = 400;

struct Outcome {
    /// Root mean square errors over the bound.
    translation: f64,
    rotation: f64,
    /// Mean of δᵀ Σ⁻¹ δ.
    normalized: f64,
}

fn monte_carlo(kernel: RobustKernel, half: bool, n_wrong: usize) -> Outcome {
    let sigma = 0.2;
    let lump = Lump::vertebra_sized();
    let (points, normals) = lump.points(if half { 300 } else { 150 });
    let (points, normals): (Vec<_>, Vec<_>) = points
        .into_iter()
        .zip(normals)
        .filter(|(p, _)| !half || p.y < 0.0)
        .unzip();
    let center = Point3::from(
        points
            .iter()
            .map(|p| p.coords)
            .sum::<nalgebra::Vector3<f64>>()
            / points.len() as f64,
    );
    let bound = cramer_rao_bound(&points, &normals, &center, sigma).expect("a sound shape");
    let options = RefineOptions {
        kernel,
        ..RefineOptions::default()
    };
    let (mut translation, mut rotation, mut normalized) = (0.0, 0.0, 0.0);
    for seed in 0..RUNS as u64 {
        let mut rng = rng(seed);
        let truth = pose(&mut rng);
        let mut target: Vec<_> = points
            .iter()
            .map(|p| truth * p + noise(&mut rng, sigma))
            .collect();
        target.extend((0..n_wrong).map(|_| in_cube(&mut rng, &(truth * center), 30.0)));
        let start = truth * motion(&mut rng, 0.05, 1.0);
        let found = refine_on_surface(&lump, &target, &start, &options).expect("a sound case");
        let error = pose_error(&found.target_from_source, &truth, &center);
        translation += error.translation_mm.powi(2) / RUNS as f64;
        rotation += error.rotation_rad.powi(2) / RUNS as f64;
        normalized += found
            .covariance
            .normalized_error_squared(&found.target_from_source, &truth)
            .expect("a sound covariance")
            / RUNS as f64;
    }
    Outcome {
        translation: translation.sqrt() / bound.translation_mm,
        rotation: rotation.sqrt() / bound.rotation_rad,
        normalized,
    }
}

fn check(name: &str, outcome: &Outcome, limit: f64) {
    let Outcome {
        translation,
        rotation,
        normalized,
    } = *outcome;
    assert!(
        (0.92..limit).contains(&translation),
        "{name}: translation at {translation} of the bound"
    );
    assert!(
        (0.92..limit).contains(&rotation),
        "{name}: rotation at {rotation} of the bound"
    );
    // 400 draws of a χ² with 6 degrees of freedom average to 6 ± 0.17; the estimate of σ from 150
    // points adds two per cent.
    assert!(
        (5.4..6.9).contains(&normalized),
        "{name}: normalised squares average {normalized}"
    );
}

#[test]
fn a_whole_surface_reaches_the_bound() {
    for kernel in [
        RobustKernel::Tukey,
        RobustKernel::GemanMcClure,
        RobustKernel::Squares,
    ] {
        let outcome = monte_carlo(kernel, false, 0);
        check(&format!("{kernel:?}, whole"), &outcome, 1.1);
    }
}

#[test]
fn half_a_surface_reaches_the_bound() {
    check("half", &monte_carlo(RobustKernel::Tukey, true, 0), 1.12);
}

#[test]
fn outliers_hardly_cost_anything() {
    check(
        "a quarter of outliers",
        &monte_carlo(RobustKernel::Tukey, false, 50),
        1.15,
    );
}

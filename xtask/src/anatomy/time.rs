//! The time of `pedicle check` from files, part by part.

use std::path::Path;
use std::time::Instant;

use pedicle_mesh::{TriMesh, WriteOptions, write_mesh};
use pedicle_trajectory::{
    CheckOptions, Level, PedicleOptions, Plan, Side, assess_plan, measure_spine, read_plan,
    write_plan,
};

use super::brute;
use crate::{XtaskError, say};

/// What a spine of this many faces may take, s.
const LIMIT_SECONDS: f64 = 1.0;
/// The shortest of so many runs counts: others had to share the machine.
const RUNS: usize = 5;

/// Plans the spine, writes spine and plan to files and times their check.
pub(super) fn run(name: &str, pairs: &[(Level, &TriMesh)]) -> Result<bool, XtaskError> {
    let folder = tempfile::tempdir().map_err(|source| XtaskError::File {
        path: std::env::temp_dir(),
        source,
    })?;
    let n_faces: usize = pairs.iter().map(|(_, mesh)| mesh.n_faces()).sum();
    let anatomy = |error| XtaskError::Anatomy {
        spine: name.to_owned(),
        error,
    };
    let refused = |error: String| XtaskError::Check {
        scenario: name.to_owned(),
        error,
    };
    let spine = measure_spine(pairs, &PedicleOptions::default()).map_err(anatomy)?;
    let mut plan = Plan::default();
    for &(level, mesh) in pairs {
        let path = folder.path().join(format!("{level}.ply"));
        write_mesh(path, mesh, &WriteOptions::default())?;
        for side in Side::ALL {
            let screw = brute::planned(&spine, pairs, (level, side));
            plan.trajectories
                .push(screw.map_err(|error| refused(error.to_string()))?);
        }
    }
    let file = folder.path().join("plan.ron");
    write_plan(&file, &plan)?;
    let mut best: Option<[f64; 3]> = None;
    for _ in 0..RUNS {
        let parts = check(folder.path(), &file).map_err(|error| match error {
            CheckError::Xtask(error) => error,
            CheckError::Anatomy(error) => anatomy(error),
            CheckError::Assess(error) => refused(error),
        })?;
        if best.is_none_or(|best| parts.iter().sum::<f64>() < best.iter().sum::<f64>()) {
            best = Some(parts);
        }
    }
    let [read, measure, judge] = best.unwrap_or([f64::NAN; 3]);
    let total = read + measure + judge;
    say(&format!(
        "check of {} screws on {n_faces} faces: {total:.2} s (limit {LIMIT_SECONDS}): files {read:.2}, \
         anatomy {measure:.2}, screws {judge:.2}; the shortest of {RUNS} runs, {} threads",
        plan.trajectories.len(),
        rayon::current_num_threads()
    ));
    Ok(total < LIMIT_SECONDS)
}

enum CheckError {
    Xtask(XtaskError),
    Anatomy(pedicle_trajectory::AnatomyError),
    Assess(String),
}

/// Seconds for the files, the anatomy and the screws.
fn check(folder: &Path, file: &Path) -> Result<[f64; 3], CheckError> {
    let clock = Instant::now();
    let vertebrae = pedicle::read_spine(folder).map_err(|e| CheckError::Xtask(e.into()))?;
    let plan = read_plan(file).map_err(|e| CheckError::Xtask(e.into()))?;
    let read = clock.elapsed().as_secs_f64();
    let pairs = pedicle::level_pairs(&vertebrae);
    let spine = measure_spine(&pairs, &PedicleOptions::default()).map_err(CheckError::Anatomy)?;
    let measured = clock.elapsed().as_secs_f64();
    assess_plan(&spine, &pairs, &plan, &CheckOptions::default())
        .map_err(|e| CheckError::Assess(e.to_string()))?;
    let judged = clock.elapsed().as_secs_f64();
    Ok([read, measured - read, judged - measured])
}

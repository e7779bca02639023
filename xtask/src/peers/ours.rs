//! Our side: the chain from two mesh files to a map, stage by stage, in a process of its own.

use std::fmt::Display;
use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use faer::Mat;
use pedicle::shape::{OperatorChoice, operators_for};
use pedicle_descriptors::{
    DescriptorError, WaveEnergies, concatenate_columns, normalize_columns,
    wave_kernel_from_landmark, wave_kernel_signature,
};
use pedicle_fmap::{
    Embedding, FitOptions, FunctionalMap, OperatorColumns, Shape, ZoomOutOptions, fit,
    point_map_from_functional, precise_map_from_functional, zoomout,
};
use pedicle_laplacian::LaplaceOperators;
use pedicle_mesh::{TriMesh, read_mesh};
use pedicle_spectral::{EigenOptions, LaplaceBasis, laplace_basis};

use super::job::{
    DESCRIPTORS, EIGENPAIRS, FIT, FIT_BY_DEFAULT, Job, OPERATORS, Outcome, PRECISE, zoomout_name,
};
use crate::XtaskError;
use crate::measure::{Recorder, read_json, resident_mib};

/// The job file.
#[derive(Debug, Args)]
pub(crate) struct ChildArguments {
    /// What to do.
    job: PathBuf,
}

impl ChildArguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        let job: Job = read_json(&self.job)?;
        // On a thread of the pool: a stage need not be handed over to it.
        let outcome = rayon::scope(|_| chain(&job))?;
        pedicle::write_json(&job.output, &outcome)?;
        Ok(true)
    }
}

/// An error of any stage, with its name.
pub(crate) fn failed<E: Display>(stage: &str) -> impl Fn(E) -> XtaskError {
    let stage = stage.to_owned();
    move |error| XtaskError::Stage {
        stage: stage.clone(),
        reason: error.to_string(),
    }
}

/// W and M of a mesh, with the construction that both programs share.
pub(crate) fn operators(mesh: &TriMesh) -> Result<LaplaceOperators, XtaskError> {
    operators_for(OperatorChoice::Cotangent, mesh)
        .map(|(operators, _)| operators)
        .map_err(failed(OPERATORS))
}

/// The first eigenfunctions.
pub(crate) fn basis(operators: &LaplaceOperators, n: usize) -> Result<LaplaceBasis, XtaskError> {
    let options = EigenOptions::default();
    laplace_basis(&operators.stiffness, &operators.mass, n, &options).map_err(failed(EIGENPAIRS))
}

/// Wave kernel signatures and the same from every landmark, on both shapes.
pub(crate) fn descriptors(
    bases: &[LaplaceBasis; 2],
    landmarks: &[[usize; 2]],
    n_wave: usize,
) -> Result<[Mat<f64>; 2], XtaskError> {
    let of = |side: usize| -> Result<Mat<f64>, DescriptorError> {
        let basis = &bases[side];
        let energies = WaveEnergies::joint(&bases[0], &bases[1], n_wave)?;
        let mut parts = vec![wave_kernel_signature(basis, &energies)];
        for pair in landmarks {
            parts.push(wave_kernel_from_landmark(basis, pair[side], &energies)?);
        }
        Ok(normalize_columns(concatenate_columns(&parts), &basis.mass))
    };
    let failed = failed(DESCRIPTORS);
    let (a, b) = rayon::join(|| of(0), || of(1));
    Ok([a.map_err(&failed)?, b.map_err(&failed)?])
}

/// All terms of the energy, with an operator of either kind for every descriptor.
pub(crate) fn fit_options(n_fit: usize, n_descriptors: usize) -> FitOptions {
    FitOptions {
        n_source: n_fit,
        n_target: n_fit,
        operator_columns: OperatorColumns::Spread(n_descriptors),
        ..FitOptions::default()
    }
}

/// The leading part of a map.
pub(crate) fn leading(map: &FunctionalMap, n: usize) -> FunctionalMap {
    let (rows, columns) = (map.n_target().min(n), map.n_source().min(n));
    FunctionalMap {
        matrix: map.matrix.submatrix(0, 0, rows, columns).to_owned(),
    }
}

fn chain(job: &Job) -> Result<Outcome, XtaskError> {
    let meshes = [read_mesh(&job.source)?.mesh, read_mesh(&job.target)?.mesh];
    let mut outcome = Outcome {
        start_mib: Some(resident_mib()),
        ..Outcome::default()
    };
    let mut record = Recorder::default();

    let made = record.run(OPERATORS, || -> Result<_, XtaskError> {
        let (a, b) = rayon::join(|| operators(&meshes[0]), || operators(&meshes[1]));
        Ok([a?, b?])
    })?;
    let bases = record.run(EIGENPAIRS, || -> Result<_, XtaskError> {
        let of = |side: usize| basis(&made[side], job.n_functions);
        let (a, b) = rayon::join(|| of(0), || of(1));
        Ok([a?, b?])
    })?;
    let functions = record.run(DESCRIPTORS, || {
        descriptors(&bases, &job.landmarks, job.n_wave)
    })?;
    let shape = |side: usize| Shape {
        mesh: &meshes[side],
        basis: &bases[side],
        descriptors: &functions[side],
    };
    // What we do unless told otherwise, beside the work that the peer does.
    let by_default = FitOptions {
        operator_columns: OperatorColumns::default(),
        ..fit_options(job.n_fit, functions[0].ncols())
    };
    let quick = record
        .run(FIT_BY_DEFAULT, || fit(&shape(0), &shape(1), &by_default))
        .map_err(failed(FIT_BY_DEFAULT))?;
    let options = fit_options(job.n_fit, functions[0].ncols());
    let fitted = record
        .run(FIT, || fit(&shape(0), &shape(1), &options))
        .map_err(failed(FIT))?;
    for (name, map) in [(FIT, &fitted.map), (FIT_BY_DEFAULT, &quick.map)] {
        let nearest = point_map_from_functional(&bases[0], &bases[1], map).map_err(failed(name))?;
        outcome
            .maps
            .insert(name.to_owned(), nearest.source_of_target);
    }

    let start = leading(&fitted.map, job.n_start);
    let mut last = start.clone();
    for &step in &job.steps {
        let name = zoomout_name(step);
        let growth = ZoomOutOptions {
            n_source: job.n_functions,
            n_target: job.n_functions,
            step,
        };
        let refined = record
            .run(&name, || zoomout(&bases[0], &bases[1], &start, &growth))
            .map_err(failed(&name))?;
        outcome
            .maps
            .insert(name, refined.point_map.source_of_target);
        last = refined.map;
    }
    let precise = record
        .run(PRECISE, || {
            let pair = (&bases[0], &bases[1]);
            precise_map_from_functional(&meshes[0], pair, &last, Embedding::Adjoint)
        })
        .map_err(failed(PRECISE))?;
    let points = precise.positions(&meshes[0]).map_err(failed(PRECISE))?;
    let points = points.iter().map(|p| [p.x, p.y, p.z]).collect();
    outcome.points.insert(PRECISE.to_owned(), points);
    outcome.eigenvalues = bases.map(|basis| basis.eigenvalues).into();
    outcome.stages = record.stages;
    outcome
        .versions
        .insert("pedicle".to_owned(), env!("CARGO_PKG_VERSION").to_owned());
    Ok(outcome)
}

/// Writes W (by rows) and M as raw little-endian numbers, for SciPy.
pub(super) fn export_matrices(prefix: &Path, mesh: &TriMesh) -> Result<(), XtaskError> {
    let made = operators(mesh)?;
    let (starts, columns, values) = made.stiffness.into_raw_storage();
    let whole = |numbers: Vec<usize>| numbers.into_iter().flat_map(|i| (i as u64).to_le_bytes());
    let real = |numbers: Vec<f64>| numbers.into_iter().flat_map(f64::to_le_bytes);
    write_raw(prefix, "starts", whole(starts))?;
    write_raw(prefix, "columns", whole(columns))?;
    write_raw(prefix, "values", real(values))?;
    write_raw(prefix, "mass", real(made.mass))
}

fn write_raw(
    prefix: &Path,
    extension: &str,
    bytes: impl Iterator<Item = u8>,
) -> Result<(), XtaskError> {
    let path = prefix.with_extension(extension);
    let write = || {
        let mut file = std::io::BufWriter::new(std::fs::File::create(&path)?);
        file.write_all(&bytes.collect::<Vec<u8>>())?;
        file.flush()
    };
    write().map_err(|source| XtaskError::File {
        path: path.clone(),
        source,
    })
}

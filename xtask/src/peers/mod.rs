//! `cargo xtask bench-peers`: our chain and pyfmaps' on the same meshes, and SciPy's eigsh.
//!
//! Every run is a process of its own, the programs take turns, and stages are timed inside the
//! processes. Both programs read the same OFF files and the same landmarks.

mod job;
mod ours;
mod report;
pub(crate) mod venv;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use nalgebra::Point3;
use pedicle_mesh::{TriMesh, WriteOptions, read_mesh, write_mesh};

use crate::measure::{Stage, read_json, run_child};
use crate::pairs::Pair;
use crate::{XtaskError, say, workspace_root};
use job::{Job, N_FIT, N_FUNCTIONS, N_START, N_WAVE, Outcome, Program};
pub(crate) use ours::{
    ChildArguments, basis, descriptors, failed, fit_options, leading, operators,
};
use report::Report;

/// Run pyfmaps, SciPy's eigsh and us on the same meshes, stage by stage, and write docs/peers.md.
///
/// Takes about an hour with all sizes; --quick takes some minutes. Installs pyfmaps in .venv.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Numbers of vertices of the generated pairs, about.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_values_t = [1750, 5000, 20_000])]
    sizes: Vec<usize>,
    /// Only 1 750 vertices.
    #[arg(long, conflicts_with = "sizes")]
    quick: bool,
    /// Also this mesh and a bent, noisy, shuffled copy of it.
    #[arg(long, value_name = "FILE")]
    mesh: Vec<PathBuf>,
    /// Numbers of threads.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_values_t = [1, 2])]
    threads: Vec<usize>,
    /// Runs of each program; the stages that take minutes are run less often on large meshes.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..))]
    repeats: u16,
    /// Runs of the stages that take minutes on large meshes; by default all on small meshes, three
    /// up to 8 000 vertices, one beyond.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    slow_repeats: Option<u16>,
    /// Only our own program, every stage as often as asked for; nothing is installed.
    #[arg(long)]
    alone: bool,
    /// Seed of the pairs.
    #[arg(long, value_name = "N", default_value_t = 20_260_101)]
    seed: u64,
    /// Python interpreter that has pyfmaps, instead of the one in .venv.
    #[arg(long, value_name = "FILE")]
    python: Option<PathBuf>,
    /// Where the Markdown goes; docs/peers.md of the workspace by default.
    #[arg(long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Meshes of at most so many vertices run the slow stages as often as the others.
const SMALL: usize = 2500;
/// Meshes of at most so many vertices run them three times, larger ones once.
const MEDIUM: usize = 8000;

/// All runs on one pair with one number of threads.
pub(crate) struct Series {
    pub(crate) pair_name: String,
    pub(crate) n_threads: usize,
    /// Error of the best map to vertices.
    pub(crate) floor: f64,
    pub(crate) runs: BTreeMap<Program, Vec<Run>>,
}

/// What is kept of a run.
pub(crate) struct Run {
    pub(crate) stages: Vec<Stage>,
    pub(crate) start_mib: f64,
    pub(crate) eigenvalues: Vec<Vec<f64>>,
    /// Mean error over the root of the area after each stage with a map.
    pub(crate) errors: BTreeMap<String, f64>,
}

impl Arguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        let python = match &self.python {
            _ if self.alone => PathBuf::new(),
            python => venv::interpreter(python.as_deref(), "requirements.txt")?,
        };
        let output = self
            .output
            .clone()
            .unwrap_or_else(|| workspace_root().join("docs").join("peers.md"));
        let mut report = Report::new(venv::requirement());
        for (index, pair) in self.pairs()?.iter().enumerate() {
            let folder = workspace_root().join("target").join("bench-peers");
            let folder = folder.join(index.to_string());
            export(&folder, pair)?;
            for &n_threads in &self.threads {
                let series = self.series(pair, &folder, n_threads, &python, &mut report)?;
                report.add(series);
            }
        }
        let text = report.markdown();
        say(&text);
        pedicle::write_text(&output, &text)?;
        say(&format!("written to {}", output.display()));
        Ok(true)
    }

    fn pairs(&self) -> Result<Vec<Pair>, XtaskError> {
        let sizes: &[usize] = if self.quick { &[1750] } else { &self.sizes };
        let mut pairs = Vec::new();
        for &size in sizes {
            let pair = Pair::generated(size, self.seed);
            pairs.push(pair.map_err(ours::failed("generated pair"))?);
        }
        for path in &self.mesh {
            let mesh = read_mesh(path)?.mesh;
            let stem = path.file_stem().unwrap_or_default().to_string_lossy();
            let name = format!("{stem}, {} vertices", mesh.n_vertices());
            let pair = Pair::of_mesh(name, &mesh, self.seed);
            pairs.push(pair.map_err(ours::failed("copy of a mesh"))?);
        }
        Ok(pairs)
    }

    fn series(
        &self,
        pair: &Pair,
        folder: &Path,
        n_threads: usize,
        python: &Path,
        report: &mut Report,
    ) -> Result<Series, XtaskError> {
        let n_slow = match self.slow_repeats {
            Some(asked) => asked.min(self.repeats).into(),
            None if self.alone => self.repeats.into(),
            None => slow_repeats(pair.source.n_vertices(), self.repeats.into()),
        };
        let programs: &[Program] = match self.alone {
            true => &[Program::Pedicle],
            false => &[Program::Pedicle, Program::Pyfmaps, Program::Scipy],
        };
        let mut runs: BTreeMap<Program, Vec<Run>> = BTreeMap::new();
        let bar = progress_bar(programs.len() * usize::from(self.repeats));
        for repeat in 0..usize::from(self.repeats) {
            for &program in programs {
                bar.set_message(format!("{}, {program:?}, {n_threads} threads", pair.name));
                let job = job(pair, folder, program, (n_threads, repeat < n_slow));
                let outcome = execute(&job, folder, python)?;
                report.versions(&outcome.versions);
                runs.entry(program).or_default().push(judged(pair, outcome));
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        Ok(Series {
            pair_name: pair.name.clone(),
            n_threads,
            floor: pair.smallest_error_of_map(),
            runs,
        })
    }
}

/// How often the stages run that take minutes on large meshes.
fn slow_repeats(n_vertices: usize, repeats: usize) -> usize {
    if n_vertices <= SMALL {
        repeats
    } else if n_vertices <= MEDIUM {
        repeats.min(3)
    } else {
        1
    }
}

/// Both meshes as OFF, which keeps every bit, and our matrices for SciPy.
fn export(folder: &Path, pair: &Pair) -> Result<(), XtaskError> {
    std::fs::create_dir_all(folder).map_err(|source| XtaskError::File {
        path: folder.to_owned(),
        source,
    })?;
    let write = |name: &str, mesh: &TriMesh| -> Result<(), XtaskError> {
        write_mesh(folder.join(name), mesh, &WriteOptions::default())?;
        ours::export_matrices(&folder.join(name), mesh)
    };
    write("source.off", &pair.source)?;
    write("target.off", &pair.target)
}

fn job(pair: &Pair, folder: &Path, program: Program, (n_threads, slow): (usize, bool)) -> Job {
    Job {
        program,
        source: folder.join("source.off"),
        target: folder.join("target.off"),
        matrices: [folder.join("source"), folder.join("target")],
        landmarks: pair.landmarks.clone(),
        n_functions: N_FUNCTIONS,
        n_fit: N_FIT,
        n_start: N_START,
        n_wave: N_WAVE,
        n_threads,
        steps: if slow { vec![5, 1] } else { vec![5] },
        precise: slow,
        output: folder.join("outcome.json"),
    }
}

fn execute(job: &Job, folder: &Path, python: &Path) -> Result<Outcome, XtaskError> {
    let file = folder.join("job.json");
    pedicle::write_json(&file, job)?;
    let mut command = match job.program {
        Program::Pedicle => {
            let program = std::env::current_exe().map_err(|source| XtaskError::Command {
                command: "measure-pair".to_owned(),
                source,
            })?;
            let mut command = Command::new(program);
            command.arg("measure-pair");
            command
        }
        Program::Pyfmaps | Program::Scipy => {
            let mut command = Command::new(python);
            command.arg(venv::driver("driver.py"));
            command
        }
    };
    run_child(command.arg(&file), job.n_threads)?;
    read_json(&job.output)
}

/// Holds the maps of a run against the truth.
fn judged(pair: &Pair, outcome: Outcome) -> Run {
    let of_maps = outcome
        .maps
        .iter()
        .map(|(stage, map)| (stage.clone(), pair.mean_error_of_map(map)));
    let of_points = outcome.points.iter().map(|(stage, points)| {
        let points: Vec<_> = points.iter().copied().map(Point3::from).collect();
        (stage.clone(), pair.mean_error(&points))
    });
    Run {
        errors: of_maps.chain(of_points).collect(),
        start_mib: outcome.start_mib.unwrap_or(f64::NAN),
        stages: outcome.stages,
        eigenvalues: outcome.eigenvalues,
    }
}

fn progress_bar(n: usize) -> ProgressBar {
    let bar = ProgressBar::new(n as u64);
    // Shown only on a terminal; indicatif stays silent otherwise.
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg}") {
        bar.set_style(style);
    }
    bar
}

//! `cargo xtask scaling`: seconds and memory of every stage from 1 000 vertices up.
//!
//! ```text
//! seconds ≈ c n^p,   p by least squares of ln seconds on ln n
//! ```
//!
//! Every stage runs in a process of its own, which reads what it needs from files that the stages
//! before it wrote, so its peak memory is its own.

mod report;
mod stage;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use clap::Args;
use pedicle_mesh::{WriteOptions, write_mesh};

use crate::measure::{Stage, median, read_json, run_child};
use crate::pairs::Pair;
use crate::peers::failed;
use crate::{XtaskError, complain, say, workspace_root};
use report::{Point, markdown};
pub(crate) use stage::ChildArguments;
use stage::{Answer, Chore, Task};

/// Measure seconds and peak memory of every stage over the number of vertices, fit exponents and
/// write docs/scaling.md.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Largest number of vertices, of 1, 2, 5, 10, 20, 50, 100 and 200 thousand.
    #[arg(long, value_name = "N", default_value_t = 200_000)]
    max: usize,
    /// Largest number of vertices for ZoomOut.
    #[arg(long, value_name = "N", default_value_t = 200_000)]
    max_zoomout: usize,
    /// Largest number of vertices for BCICP.
    #[arg(long, value_name = "N", default_value_t = 20_000)]
    max_bcicp: usize,
    /// Runs of each stage; medians are reported.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    repeats: u16,
    /// Number of threads; all cores by default.
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Seed of the shapes.
    #[arg(long, value_name = "N", default_value_t = 20_260_101)]
    seed: u64,
    /// Where the Markdown goes; docs/scaling.md of the workspace by default.
    #[arg(long, value_name = "FILE")]
    output: Option<PathBuf>,
}

const SIZES: [usize; 8] = [1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000, 200_000];

impl Arguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let n_threads = self.threads.unwrap_or(cores);
        let output = self
            .output
            .clone()
            .unwrap_or_else(|| workspace_root().join("docs").join("scaling.md"));
        let folder = workspace_root().join("target").join("scaling");
        std::fs::create_dir_all(&folder).map_err(|source| XtaskError::File {
            path: folder.clone(),
            source,
        })?;
        let mut points: BTreeMap<Task, Vec<Point>> = BTreeMap::new();
        for size in SIZES.into_iter().filter(|&size| size <= self.max) {
            let pair = Pair::generated(size, self.seed).map_err(failed("generated pair"))?;
            let n_vertices = pair.source.n_vertices();
            write_mesh(
                folder.join("source.off"),
                &pair.source,
                &WriteOptions::default(),
            )?;
            write_mesh(
                folder.join("target.off"),
                &pair.target,
                &WriteOptions::default(),
            )?;
            for task in Task::ALL
                .into_iter()
                .filter(|task| size <= self.limit(*task))
            {
                let chore = Chore {
                    task,
                    folder: folder.clone(),
                    landmarks: pair.landmarks.clone(),
                };
                let (stage, start_mib, n_runs) = self.measure(&chore, &folder, n_threads)?;
                complain(&format!(
                    "{n_vertices} vertices, {task}: {:.3} s, {:.0} MiB",
                    stage.seconds, stage.peak_mib
                ));
                points.entry(task).or_default().push(Point {
                    n_vertices,
                    n_runs,
                    seconds: stage.seconds,
                    peak_mib: stage.peak_mib,
                    start_mib,
                });
            }
        }
        let text = markdown(&points, n_threads, cores);
        say(&text);
        pedicle::write_text(&output, &text)?;
        say(&format!("written to {}", output.display()));
        Ok(true)
    }

    fn limit(&self, task: Task) -> usize {
        match task {
            Task::ZoomOut => self.max_zoomout,
            Task::Bcicp => self.max_bcicp.min(self.max_zoomout),
            _ => self.max,
        }
    }

    /// The medians of some runs of a stage, memory at its start, and the number of samples.
    fn measure(
        &self,
        chore: &Chore,
        folder: &Path,
        n_threads: usize,
    ) -> Result<(Stage, f64, usize), XtaskError> {
        let (file, output) = (folder.join("chore.json"), folder.join("answer.json"));
        pedicle::write_json(&file, chore)?;
        let program = std::env::current_exe().map_err(|source| XtaskError::Command {
            command: "measure-stage".to_owned(),
            source,
        })?;
        let mut stages: Vec<Stage> = Vec::new();
        let mut start_mib = f64::NAN;
        for _ in 0..self.repeats {
            let mut command = Command::new(&program);
            command.arg("measure-stage").arg(&file).arg(&output);
            run_child(&mut command, n_threads)?;
            let answer: Answer = read_json(&output)?;
            stages.extend(answer.stages);
            start_mib = answer.start_mib.unwrap_or(f64::NAN);
        }
        let middle =
            |value: fn(&Stage) -> f64| median(&stages.iter().map(value).collect::<Vec<_>>());
        let stage = Stage {
            name: chore.task.to_string(),
            seconds: middle(|s| s.seconds),
            cpu_seconds: middle(|s| s.cpu_seconds),
            peak_mib: middle(|s| s.peak_mib),
        };
        Ok((stage, start_mib, stages.len()))
    }
}

//! `cargo xtask bench-registration`: the same clouds through other registration packages and ours.
//!
//! Every package registers the CT surface to what the sensor saw, in a process of its own on one
//! thread; packages take turns, cell by cell. Poses are judged against the simulated truth by the
//! published margins.

mod problems;
mod report;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use clap::Args;
use nalgebra::{Isometry3, Matrix4, Rotation3, Translation3, UnitQuaternion};
use pedicle_simulation::{Suite, SuiteTarget, TargetSurface, suite_scenarios};
use pedicle_spine::{SensorView, SpineModel, Target, TransferOptions, transfer};
use pedicle_trajectory::SafetyMargins;
use serde::{Deserialize, Serialize};

use crate::baselines::{PlaneSurface, icp};
use crate::bench::case::{self, Case, Given};
use crate::measure::{read_json, run_child};
use crate::peers::venv;
use crate::{XtaskError, complain, fixture, say, workspace_root};
use problems::{Part, Problem, SCENES, Scene, problems};
use report::Row;

/// Run Open3D, small_gicp, KISS-Matcher and us on the same clouds and write docs/registration.md.
///
/// Installs the packages in .venv. Open3D needs Debian's packages libusb-1.0-0 and libgl1.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Random draws a cell.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    draws: u32,
    /// Spine: a folder with L1.ply to L5.ply, or one labelled PLY. Without it the phantom.
    #[arg(long, value_name = "PATH")]
    spine: Option<PathBuf>,
    /// Seed of the scenarios.
    #[arg(long, value_name = "N", default_value_t = 20_260_101)]
    seed: u64,
    /// Python interpreter that has the packages, instead of the one in .venv.
    #[arg(long, value_name = "FILE")]
    python: Option<PathBuf>,
    /// Where the Markdown goes; docs/registration.md of the workspace by default.
    #[arg(long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Whose code runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Program {
    Transfer,
    Pedicle,
    Open3d,
    SmallGicp,
    KissMatcher,
}

impl Program {
    const ALL: [Self; 5] = [
        Self::Transfer,
        Self::Pedicle,
        Self::Open3d,
        Self::SmallGicp,
        Self::KissMatcher,
    ];

    /// Its name in the driver, if it is a peer.
    fn peer(self) -> Option<&'static str> {
        match self {
            Self::Transfer | Self::Pedicle => None,
            Self::Open3d => Some("open3d"),
            Self::SmallGicp => Some("small_gicp"),
            Self::KissMatcher => Some("kiss_matcher"),
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Transfer => "pedicle `transfer`",
            Self::Pedicle => "pedicle-registration",
            Self::Open3d => "Open3D FPFH + RANSAC + ICP",
            Self::SmallGicp => "small_gicp GICP",
            Self::KissMatcher => "KISS-Matcher + GICP",
        }
    }
}

/// What a process of the driver is told.
#[derive(Debug, Serialize)]
struct Job<'a> {
    program: &'a str,
    problems: &'a [Problem],
    output: &'a Path,
}

#[derive(Debug, Deserialize)]
struct JobAnswers {
    version: String,
    answers: Vec<Answer>,
}

/// A pose for one problem, as 16 numbers by rows, or why there is none.
#[derive(Debug, Clone, Deserialize)]
struct Answer {
    pose: Option<Vec<f64>>,
    seconds: f64,
    word: Option<String>,
}

/// A pose of one vertebra or of all five, and the seconds of the registration it is from.
struct Found {
    scenario: usize,
    part: Part,
    pose: Result<Isometry3<f64>, String>,
    seconds: f64,
}

impl Arguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        let python = venv::interpreter(self.python.as_deref(), "requirements-registration.txt")?;
        let path = self.spine.clone().unwrap_or_else(|| fixture("phantom"));
        let case = case::load(&path, &Given::default())?;
        let model = case.model()?;
        let folder = workspace_root().join("target").join("bench-registration");
        std::fs::create_dir_all(&folder).map_err(|source| XtaskError::File {
            path: folder.clone(),
            source,
        })?;
        let mut versions = BTreeMap::new();
        let mut rows = Vec::new();
        for scene in &SCENES {
            let targets = self.targets(&case, scene)?;
            let problems = problems(&case, &targets, scene, &folder)?;
            for program in Program::ALL {
                let found = match program.peer() {
                    None if program == Program::Transfer => transferred(&case, &model, &targets),
                    None => registered(&case, &problems)?,
                    Some(name) => {
                        let answers = ask(&python, name, &problems, &folder)?;
                        versions.insert(program.name(), answers.version);
                        of_peer(&problems, answers.answers)
                    }
                };
                let row = judged(scene, program, &targets, &found);
                complain(&row.progress());
                rows.push(row);
            }
        }
        let text = report::markdown(&case.name, self.draws, self.seed, &versions, &rows);
        say(&text);
        let output = self
            .output
            .unwrap_or_else(|| workspace_root().join("docs").join("registration.md"));
        pedicle::write_text(&output, &text)?;
        say(&format!("written to {}", output.display()));
        Ok(true)
    }

    fn targets(&self, case: &Case, scene: &Scene) -> Result<Vec<SuiteTarget>, XtaskError> {
        let suites = [Suite::Paper, Suite::Sensor];
        let scenarios = suites
            .iter()
            .flat_map(|suite| suite_scenarios(*suite, self.seed, self.draws))
            .filter(|scenario| scenario.cell == scene.cell);
        scenarios
            .map(|scenario| Ok(pedicle_simulation::simulate_suite(&case.spine, &scenario)?))
            .collect()
    }
}

/// The whole pipeline. What it needs to know of the source is prepared before.
fn transferred(case: &Case, model: &SpineModel, targets: &[SuiteTarget]) -> Vec<Found> {
    let mut found = Vec::new();
    for (scenario, simulated) in targets.iter().enumerate() {
        let landmarks = simulated.target_landmarks.clone();
        let target = match simulated.surface.clone() {
            TargetSurface::Mesh(mesh) => Target::mesh(mesh, landmarks),
            TargetSurface::Cloud(points) => Target::cloud(points, landmarks),
        };
        let target = match &simulated.view {
            Some(view) => target.seen_from(SensorView {
                camera_mm: view.camera_mm,
            }),
            None => target,
        };
        let clock = Instant::now();
        let result = transfer(model, &case.plan, &target, &TransferOptions::default());
        let seconds = clock.elapsed().as_secs_f64() / simulated.truth.len() as f64;
        for v in 0..simulated.truth.len() {
            let pose = result.as_ref().map_err(ToString::to_string);
            found.push(Found {
                scenario,
                part: Part::Vertebra(v),
                pose: pose.map(|transfer| transfer.vertebrae[v].target_from_source),
                seconds,
            });
        }
    }
    found
}

/// Our registration alone, from the poses that the peers get, with all preparation.
fn registered(case: &Case, problems: &[Problem]) -> Result<Vec<Found>, XtaskError> {
    problems
        .iter()
        .map(|problem| {
            let mesh = problems::source_mesh(case, problem.part)?;
            let clock = Instant::now();
            let surface = PlaneSurface::new(&mesh)?;
            let pose = icp(&surface, &problem.target_points, &problem.start_pose);
            Ok(Found {
                scenario: problem.scenario,
                part: problem.part,
                pose,
                seconds: clock.elapsed().as_secs_f64(),
            })
        })
        .collect()
}

fn ask(
    python: &Path,
    program: &str,
    problems: &[Problem],
    folder: &Path,
) -> Result<JobAnswers, XtaskError> {
    let (job, output) = (folder.join("job.json"), folder.join("answers.json"));
    pedicle::write_json(
        &job,
        &Job {
            program,
            problems,
            output: &output,
        },
    )?;
    let mut command = Command::new(python);
    run_child(command.arg(venv::driver("registration.py")).arg(&job), 1)?;
    read_json(&output)
}

fn of_peer(problems: &[Problem], answers: Vec<Answer>) -> Vec<Found> {
    problems
        .iter()
        .zip(answers)
        .map(|(problem, answer)| Found {
            scenario: problem.scenario,
            part: problem.part,
            pose: answer
                .pose
                .as_deref()
                .and_then(pose_of)
                .ok_or_else(|| answer.word.unwrap_or_else(|| "no pose".to_owned())),
            seconds: answer.seconds,
        })
        .collect()
}

/// A rigid motion from a 4 × 4 matrix by rows; none if it is not one.
fn pose_of(rows: &[f64]) -> Option<Isometry3<f64>> {
    if rows.len() != 16 || !rows.iter().all(|x| x.is_finite()) {
        return None;
    }
    let matrix = Matrix4::from_row_slice(rows);
    let rotation = Rotation3::from_matrix(&matrix.fixed_view::<3, 3>(0, 0).into_owned());
    Some(Isometry3::from_parts(
        Translation3::new(matrix[(0, 3)], matrix[(1, 3)], matrix[(2, 3)]),
        UnitQuaternion::from_rotation_matrix(&rotation),
    ))
}

fn judged(scene: &Scene, program: Program, targets: &[SuiteTarget], found: &[Found]) -> Row {
    let margins = SafetyMargins::default();
    let mut row = Row::new(scene, program);
    for (scenario, target) in targets.iter().enumerate() {
        let own: Vec<&Found> = found.iter().filter(|f| f.scenario == scenario).collect();
        row.seconds.push(own.iter().map(|f| f.seconds).sum());
        for (v, truth) in target.truth.iter().enumerate() {
            let of_v = |f: &&&Found| matches!(f.part, Part::Whole) || f.part == Part::Vertebra(v);
            row.n_vertebrae += 1;
            match own.iter().find(of_v).map(|f| &f.pose) {
                Some(Ok(pose)) => {
                    let error = truth.vertebra.error_of(pose);
                    row.translation_mm.push(error.translation_mm);
                    row.rotation_deg.push(error.rotation_rad.to_degrees());
                    let is_valid = margins.is_within(error.translation_mm, error.rotation_rad);
                    row.n_valid += usize::from(is_valid);
                }
                Some(Err(word)) => row.word = Some(word.clone()),
                None => row.word = Some("no answer".to_owned()),
            }
        }
    }
    row
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrices_come_back_as_poses() {
        let pose = Isometry3::new(
            nalgebra::Vector3::new(1.0, 2.0, 3.0),
            nalgebra::Vector3::new(0.1, -0.4, 0.2),
        );
        let rows = problems::rows_of(&pose);
        let back = pose_of(&rows).unwrap();
        let gap = (back.translation.vector - pose.translation.vector).norm();
        assert!(gap < 1e-15, "the translation is off by {gap}");
        assert!(
            back.rotation.angle_to(&pose.rotation) < 1e-7,
            "the rotation"
        );
        assert_eq!(pose_of(&[f64::NAN; 16]), None, "not finite");
        assert_eq!(pose_of(&rows[..12]), None, "too short");
    }
}

//! The registration problems: cells, clouds and the rough poses that local methods start from.

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_mesh::{TriMesh, concatenate};
use pedicle_registration::kabsch;
use pedicle_simulation::{Deformation, SensorForm, SuiteCell, SuiteTarget};
use serde::Serialize;

use crate::XtaskError;
use crate::baselines::by_level;
use crate::bench::case::Case;

/// How far around where the landmarks put a vertebra its points are looked for, mm.
const MARGIN_MM: f64 = 15.0;
/// Voxels of the peers' features and models, mm: whole spine, vertebra.
const VOXEL_MM: (f64, f64) = (4.0, 2.0);

/// What is registered at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// The spine as one body.
    Whole,
    /// One vertebra, by its index.
    Vertebra(usize),
}

/// One cell of the table.
pub(super) struct Scene {
    pub(super) name: &'static str,
    pub(super) cell: SuiteCell,
    pub(super) is_whole: bool,
}

const fn paper(deformation: Deformation, noise_mm: f64) -> SuiteCell {
    SuiteCell::Paper {
        deformation,
        noise_mm,
    }
}

const fn sensor(form: SensorForm) -> SuiteCell {
    SuiteCell::Sensor {
        form,
        cover: 0.2,
        noise_mm: 0.6,
    }
}

/// All cells.
pub(super) const SCENES: [Scene; 7] = [
    Scene {
        name: "rigid, noise 0, whole spine",
        cell: paper(Deformation::Rigid, 0.0),
        is_whole: true,
    },
    Scene {
        name: "rigid, noise 0.5 mm, whole spine",
        cell: paper(Deformation::Rigid, 0.5),
        is_whole: true,
    },
    Scene {
        name: "rigid, noise 1 mm, whole spine",
        cell: paper(Deformation::Rigid, 1.0),
        is_whole: true,
    },
    Scene {
        name: "non-rigid, noise 0.5 mm, each vertebra",
        cell: paper(Deformation::NonRigid, 0.5),
        is_whole: false,
    },
    Scene {
        name: "partial, noise 0.5 mm, each vertebra",
        cell: paper(Deformation::Partial, 0.5),
        is_whole: false,
    },
    Scene {
        name: "sensor mesh, 20 % covered, noise 0.6 mm, each vertebra",
        cell: sensor(SensorForm::Mesh),
        is_whole: false,
    },
    Scene {
        name: "sensor cloud, 20 % covered, noise 0.6 mm, each vertebra",
        cell: sensor(SensorForm::Cloud),
        is_whole: false,
    },
];

/// One problem, as the driver reads it.
#[derive(Debug, Serialize)]
pub(super) struct Problem {
    source: PathBuf,
    normals: PathBuf,
    target: PathBuf,
    start: Vec<f64>,
    voxel_mm: f64,
    #[serde(skip)]
    pub(super) scenario: usize,
    #[serde(skip)]
    pub(super) part: Part,
    #[serde(skip)]
    pub(super) target_points: Vec<Point3<f64>>,
    #[serde(skip)]
    pub(super) start_pose: Isometry3<f64>,
}

/// The CT surface that takes part.
pub(super) fn source_mesh(case: &Case, part: Part) -> Result<TriMesh, XtaskError> {
    match part {
        Part::Vertebra(v) => Ok(case.vertebrae[v].surface.clone()),
        Part::Whole => {
            let all: Vec<&TriMesh> = case.vertebrae.iter().map(|v| &v.surface).collect();
            concatenate(&all).map_err(|error| XtaskError::Mesh {
                spine: case.name.clone(),
                error,
            })
        }
    }
}

/// The problems of a cell, with their clouds written to a folder.
pub(super) fn problems(
    case: &Case,
    targets: &[SuiteTarget],
    scene: &Scene,
    folder: &Path,
) -> Result<Vec<Problem>, XtaskError> {
    let parts: Vec<Part> = if scene.is_whole {
        vec![Part::Whole]
    } else {
        (0..case.vertebrae.len()).map(Part::Vertebra).collect()
    };
    let mut problems = Vec::new();
    for part in parts {
        let mesh = source_mesh(case, part)?;
        let name = match part {
            Part::Whole => "whole".to_owned(),
            Part::Vertebra(v) => format!("vertebra-{v}"),
        };
        let source = folder.join(format!("{name}.points"));
        let normals = folder.join(format!("{name}.normals"));
        let vertices = mesh.vertices().iter().map(|p| p.coords);
        write_rows(&source, vertices)?;
        write_rows(&normals, mesh.vertex_normals().into_iter())?;
        let center = mesh.centroid();
        let radius_mm = mesh
            .vertices()
            .iter()
            .map(|p| (p - center).norm())
            .fold(0.0, |most, d| if d > most { d } else { most });
        for (scenario, simulated) in targets.iter().enumerate() {
            let start = landmark_fit(case, simulated)?;
            let mut points = simulated.surface.points().to_vec();
            if part != Part::Whole {
                let place = start * center;
                points.retain(|p| (p - place).norm() <= radius_mm + MARGIN_MM);
            }
            let target = folder.join(format!("{name}-{scenario}.target"));
            write_rows(&target, points.iter().map(|p| p.coords))?;
            problems.push(Problem {
                source: source.clone(),
                normals: normals.clone(),
                target,
                start: rows_of(&start),
                voxel_mm: if part == Part::Whole {
                    VOXEL_MM.0
                } else {
                    VOXEL_MM.1
                },
                scenario,
                part,
                target_points: points,
                start_pose: start,
            });
        }
    }
    Ok(problems)
}

fn landmark_fit(case: &Case, simulated: &SuiteTarget) -> Result<Isometry3<f64>, XtaskError> {
    let (from, to): (Vec<Point3<f64>>, Vec<Point3<f64>>) = by_level(&case.landmarks)
        .into_iter()
        .zip(by_level(&simulated.target_landmarks))
        .filter_map(|(a, b)| Some((a?, b?)))
        .unzip();
    kabsch(&from, &to, None).map_err(|error| XtaskError::Stage {
        stage: "landmark fit".to_owned(),
        reason: error.to_string(),
    })
}

/// A pose as 16 numbers by rows.
pub(super) fn rows_of(pose: &Isometry3<f64>) -> Vec<f64> {
    pose.to_homogeneous().transpose().iter().copied().collect()
}

/// Raw little-endian numbers, three a row.
fn write_rows(path: &Path, rows: impl Iterator<Item = Vector3<f64>>) -> Result<(), XtaskError> {
    let bytes: Vec<u8> = rows
        .flat_map(|row| [row.x, row.y, row.z])
        .flat_map(f64::to_le_bytes)
        .collect();
    std::fs::write(path, bytes).map_err(|source| XtaskError::File {
        path: path.to_owned(),
        source,
    })
}

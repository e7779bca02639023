//! The comparison as Markdown.

use std::collections::BTreeMap;

use comfy_table::presets::ASCII_MARKDOWN;
use comfy_table::{CellAlignment, Table};

use super::Program;
use super::problems::Scene;
use crate::measure::median;

/// One package in one cell.
pub(super) struct Row {
    scene: &'static str,
    program: Program,
    pub(super) n_vertebrae: usize,
    pub(super) n_valid: usize,
    /// Of all vertebrae with a pose.
    pub(super) translation_mm: Vec<f64>,
    pub(super) rotation_deg: Vec<f64>,
    /// Of whole scenarios.
    pub(super) seconds: Vec<f64>,
    /// Why a vertebra had no pose.
    pub(super) word: Option<String>,
}

impl Row {
    pub(super) fn new(scene: &Scene, program: Program) -> Self {
        Self {
            scene: scene.name,
            program,
            n_vertebrae: 0,
            n_valid: 0,
            translation_mm: Vec::new(),
            rotation_deg: Vec::new(),
            seconds: Vec::new(),
            word: None,
        }
    }

    /// One line while the benchmark runs.
    pub(super) fn progress(&self) -> String {
        format!(
            "{}: {}: {} of {} valid",
            self.scene,
            self.program.name(),
            self.n_valid,
            self.n_vertebrae
        )
    }
}

/// The whole document.
pub(super) fn markdown(
    spine: &str,
    draws: u32,
    seed: u64,
    versions: &BTreeMap<&str, String>,
    rows: &[Row],
) -> String {
    let versions: Vec<String> = versions
        .iter()
        .map(|(name, version)| format!("{name} ({version})"))
        .collect();
    let mut text = format!(
        "# Beside other registration packages\n\n\
         What `cargo xtask bench-registration --draws {draws} --seed {seed}` measures on the spine \
         `{spine}`, with {draws} draws a cell, on one thread. Peers: {}.\n\n\
         The source is the full-resolution CT surface (its vertices and normals), the target what the \
         scenario shows: of the whole spine, or, one vertebra at a time, the points within reach of \
         where the fit of the landmarks puts it. `pedicle-registration` and `small_gicp` start from \
         that fit, which is off by tens of degrees about the line of the landmarks; Open3D and \
         KISS-Matcher look for their own start. `transfer` is given the whole target, the \
         landmarks and, of a sensor, the place of its camera. Open3D: FPFH and RANSAC (100 000 trials) on voxels of 4 mm (spine) or 2 mm \
         (vertebra), then point-to-plane ICP with gates of 10 and 5 mm. KISS-Matcher: voxels half as \
         large again, both clouds moved to their middles and scaled to centimetres, then GICP from its \
         pose. GICP: gates of 20, 10 and 5 mm. `pedicle-registration`: point-to-surface with a \
         gate from 25 to 5 mm.\n\n\
         Valid: within the published margin, 2.5 mm and 7.1°, counted over vertebrae; a pose of the \
         whole spine counts for all five. Errors are medians over the vertebrae with a pose, wrong \
         ones included. Time is the median of a spine, with all preparation of both clouds (but the \
         source of `transfer`, which is prepared once and serves all targets); the sum of its \
         vertebrae where they are registered one by one.\n",
        versions.join(", ")
    );
    let mut scenes: Vec<&str> = Vec::new();
    for row in rows {
        if !scenes.contains(&row.scene) {
            scenes.push(row.scene);
        }
    }
    for scene in scenes {
        text += &format!("\n## {scene}\n\n{}\n", table(rows, scene));
        for row in rows.iter().filter(|row| row.scene == scene) {
            if let Some(word) = &row.word {
                let n = row.n_vertebrae - row.translation_mm.len();
                text += &format!(
                    "\n{}: no pose for {n} vertebrae: {word}\n",
                    row.program.name()
                );
            }
        }
    }
    text
}

fn table(rows: &[Row], scene: &str) -> Table {
    let mut table = Table::new();
    table
        .load_style(ASCII_MARKDOWN)
        .set_header(["package", "valid", "mm", "degrees", "s a spine"]);
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    for row in rows.iter().filter(|row| row.scene == scene) {
        let share = 100.0 * row.n_valid as f64 / row.n_vertebrae.max(1) as f64;
        table.add_row([
            row.program.name().to_owned(),
            format!("{} of {} ({share:.0} %)", row.n_valid, row.n_vertebrae),
            number(median(&row.translation_mm)),
            number(median(&row.rotation_deg)),
            number(median(&row.seconds)),
        ]);
    }
    table
}

fn number(value: f64) -> String {
    if !value.is_finite() {
        "–".to_owned()
    } else if value != 0.0 && value < 0.01 {
        format!("{value:.0e}")
    } else {
        format!("{value:.2}")
    }
}

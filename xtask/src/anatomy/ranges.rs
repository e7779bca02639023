//! Measured pedicles of a real spine beside published means and deviations of their level.

use comfy_table::{Table, TableStyle};
use pedicle_mesh::TriMesh;
use pedicle_simulation::morphometry::{
    MorphometryRow, PEDICLE_HEIGHT, PEDICLE_SAGITTAL_ANGLE, PEDICLE_TRANSVERSE_ANGLE, PEDICLE_WIDTH,
};
use pedicle_trajectory::{AnatomicalFrame, Level, PedicleAnatomy, Side, VertebraAnatomy};

use crate::bench::new_table;

/// Deviations from the mean within which a person is in the range.
const RANGE_DEVIATIONS: f64 = 3.0;
/// Angles have no published deviation that could be checked: a number of our own, degrees. To lie within it
/// is weak evidence.
const ANGLE_REACH_DEG: f64 = 15.0;

/// What is compared: its row of the published table, and how it is measured as surveys do it.
type Measure = (
    &'static MorphometryRow,
    Range,
    fn(&PedicleAnatomy, &AnatomicalFrame, &TriMesh) -> f64,
);

/// How far from the mean a value may be.
#[derive(Debug, Clone, Copy)]
enum Range {
    /// In standard deviations of the level.
    Deviations(f64),
    /// The same everywhere, degrees.
    Degrees(f64),
}

const MEASURES: [Measure; 4] = [
    (
        &PEDICLE_WIDTH,
        Range::Deviations(RANGE_DEVIATIONS),
        |a, _, _| a.mediolateral_chord_mm,
    ),
    (
        &PEDICLE_HEIGHT,
        Range::Deviations(RANGE_DEVIATIONS),
        |a, _, _| a.upright_chord_mm,
    ),
    (
        &PEDICLE_TRANSVERSE_ANGLE,
        Range::Degrees(ANGLE_REACH_DEG),
        |a, frame, mesh| {
            a.axial_angle_rad(mesh, frame)
                .map_or(f64::NAN, f64::to_degrees)
        },
    ),
    (
        &PEDICLE_SAGITTAL_ANGLE,
        Range::Degrees(ANGLE_REACH_DEG),
        |a, _, _| a.sagittal_angle_rad.to_degrees(),
    ),
];

/// One row a measure and level: left, right and the range; and what lies outside, as words.
pub(super) fn table(
    spine: &[VertebraAnatomy],
    pairs: &[(Level, &TriMesh)],
    style: TableStyle,
) -> (Table, Vec<String>) {
    let header = ["", "level", "left", "right", "published"];
    let mut table = new_table(style, header.map(String::from).to_vec());
    let mut outside = Vec::new();
    for (row, range, of) in MEASURES {
        for (v, (_, mesh)) in spine.iter().zip(pairs) {
            let level = v.level.index();
            let mean = row.mean[level];
            let reach = match range {
                Range::Deviations(n) => n * row.deviation[level],
                Range::Degrees(reach) => reach,
            };
            let mut cells = vec![row.name.to_owned(), v.level.to_string()];
            for side in Side::ALL {
                let Ok(anatomy) = v.pedicle(side) else {
                    outside.push(format!("{} {side}: no {}", v.level, row.name));
                    cells.push("-".to_owned());
                    continue;
                };
                let found = of(anatomy, &v.frame, mesh);
                cells.push(format!("{found:.1}"));
                // NaN is in no range.
                let within = (found - mean).abs() <= reach;
                if !within {
                    outside.push(format!(
                        "{} {side}: {} {found:.1} is not within {mean} ± {reach:.1}",
                        v.level, row.name
                    ));
                }
            }
            cells.push(format!("{mean:.1} ± {reach:.1}"));
            table.add_row(cells);
        }
    }
    (table, outside)
}

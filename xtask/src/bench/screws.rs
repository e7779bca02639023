//! The planned screws and where the final poses came from, for people.

use comfy_table::{Table, TableStyle};
use pedicle_spine::Origin;
use pedicle_trajectory::Plan;

use super::case::Case;
use super::report::new_table;
use super::score::ScenarioScore;

/// Thinnest lumbar pedicle screw; what is thinner goes first: a pilot drill or a guide wire.
const THINNEST_SCREW_MM: f64 = 4.0;

/// What the table is about.
pub(super) fn heading(plan_from: &str) -> String {
    format!("Planned trajectories (plan from {plan_from}), beside the isthmus they pass:")
}

/// One row a planned trajectory.
pub(super) fn table(case: &Case, style: TableStyle) -> Table {
    let header = ["level", "side", "diameter mm", "isthmus width mm"];
    let mut table = new_table(style, header.map(String::from).to_vec());
    for planned in &case.plan.trajectories {
        let pedicle = &case.truth[planned.level.index()].pedicles[planned.side as usize];
        table.add_row([
            planned.level.to_string(),
            planned.side.to_string(),
            format!("{:.1}", planned.diameter_mm),
            format!("{:.1}", pedicle.width_mm),
        ]);
    }
    table
}

/// How many of the planned trajectories are for a screw.
pub(super) fn counts(plan: &Plan) -> String {
    let n = plan.trajectories.len();
    let n_screws = plan
        .trajectories
        .iter()
        .filter(|t| t.diameter_mm >= THINNEST_SCREW_MM)
        .count();
    format!(
        "planned: {n_screws} of {n} trajectories have a diameter of at least \
         {THINNEST_SCREW_MM:.0} mm; thinner (pilot drill or guide wire): {}",
        n - n_screws
    )
}

/// How many vertebrae ended at a pose from each kind of start.
pub(super) fn origins(scores: &[ScenarioScore]) -> String {
    let of_all: Vec<Option<Origin>> = scores
        .iter()
        .flat_map(|score| &score.vertebrae)
        .map(|v| v.origin)
        .collect();
    let count = |kind: &str| {
        let same = |origin: &&Option<Origin>| kind_of(**origin) == kind;
        of_all.iter().filter(same).count()
    };
    let parts: Vec<String> = KINDS
        .iter()
        .map(|kind| format!("{kind} {}", count(kind)))
        .collect();
    let refused = match count(REFUSED) {
        0 => String::new(),
        n => format!("; none, as the scenario was refused: {n}"),
    };
    format!(
        "final poses of {} vertebrae came from: {}{refused}",
        of_all.len(),
        parts.join(", ")
    )
}

const KINDS: [&str; 7] = [
    "functional map",
    "landmark fit",
    "landmark line",
    "neighbour",
    "level shift",
    "long axis",
    "small step",
];
const REFUSED: &str = "refused";

fn kind_of(origin: Option<Origin>) -> &'static str {
    match origin {
        Some(Origin::FunctionalMap) => KINDS[0],
        Some(Origin::LandmarkFit) => KINDS[1],
        Some(Origin::LandmarkLine { .. }) => KINDS[2],
        Some(Origin::Neighbour) => KINDS[3],
        Some(Origin::LevelShift) => KINDS[4],
        Some(Origin::LongAxis { .. }) => KINDS[5],
        Some(Origin::Nearby) => KINDS[6],
        None => REFUSED,
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;
    use pedicle_trajectory::{Level, Side, Trajectory};

    use super::*;

    #[test]
    fn screws_are_told_from_what_is_thinner() {
        let plan = Plan {
            trajectories: [3.5, 4.0, 6.5]
                .map(|diameter_mm| Trajectory {
                    level: Level::L3,
                    side: Side::Left,
                    entry_mm: Point3::origin(),
                    tip_mm: Point3::new(0.0, 40.0, 0.0),
                    diameter_mm,
                })
                .to_vec(),
        };
        let line = counts(&plan);
        assert!(line.contains("2 of 3 trajectories"), "{line}");
        assert!(line.contains("guide wire): 1"), "{line}");
    }

    #[test]
    fn every_origin_has_a_kind() {
        let origins = [
            Origin::FunctionalMap,
            Origin::LandmarkFit,
            Origin::LandmarkLine { turn_rad: 1.0 },
            Origin::Neighbour,
            Origin::LevelShift,
            Origin::LongAxis { turn_rad: 1.0 },
            Origin::Nearby,
        ];
        assert_eq!(origins.map(|o| kind_of(Some(o))), KINDS, "in their order");
        assert_eq!(kind_of(None), REFUSED, "no pose");
    }
}

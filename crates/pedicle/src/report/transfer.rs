//! The page of a transfer.

use nalgebra::Isometry3;
use pedicle_registration::pose_error;
use pedicle_report::chart::Series;
use pedicle_report::{Block, Deviation, Page, ScrewReport, Section, Table, Tone, screw_section};
use pedicle_simulation::trajectory_error;
use pedicle_spine::{SourceVertebra, SpineModel, Target, Transfer, VertebraTransfer};
use pedicle_trajectory::{CheckOptions, Plan, SafetyMargins, Trajectory, check_trajectory};

use super::fmap::{Spectra, map_section};
use super::scene::{scene, screw_name};
use super::screws::{CheckedScrew, PoseDoubt, screw_report};

/// Depth of the isthmus where it cannot be measured, mm: that of the published margins.
const ISTHMUS_DEPTH_MM: f64 = 20.0;

/// What a report of a transfer is made from.
#[derive(Debug, Clone, Copy)]
pub struct TransferReport<'a> {
    /// A sentence on what was transferred, without paths and times.
    pub subtitle: &'a str,
    /// The source, from L1 down.
    pub source: &'a [SourceVertebra],
    /// The source as it was prepared.
    pub model: &'a SpineModel,
    /// The plan.
    pub plan: &'a Plan,
    /// The target.
    pub target: &'a Target,
    /// The result.
    pub transfer: &'a Transfer,
    /// The true `target_from_source` of every vertebra, where it is known: in simulations.
    pub truth: Option<&'a [Isometry3<f64>]>,
}

/// The report of a transfer.
#[must_use]
pub fn transfer_page(report: &TransferReport<'_>) -> Page {
    let mut page = Page::new("Transfer of a pedicle-screw plan");
    page.subtitle = report.subtitle.to_owned();
    add_facts(&mut page, report);
    page.scene = Some(scene(report));
    page.sections.push(vertebrae(report));
    let screws: Vec<ScrewReport> = (0..report.plan.trajectories.len())
        .map(|k| screw(report, k))
        .collect();
    page.sections.push(screw_section(&screws));
    page.sections.push(trajectories(report));
    page.sections
        .extend(report.transfer.map.as_ref().map(|map| {
            map_section(&Spectra {
                source: &map.detail.source_eigenvalues,
                target: &map.detail.target_eigenvalues,
                unit: "1/mm²",
                map: &map.detail.functional_map.matrix,
            })
        }));
    page
}

fn add_facts(page: &mut Page, report: &TransferReport<'_>) {
    let transfer = report.transfer;
    let share = |accepted: usize, all: usize| {
        let tone = if accepted == all {
            Tone::Good
        } else {
            Tone::Bad
        };
        (format!("{accepted} of {all}"), Some(tone))
    };
    let accepted = transfer.vertebrae.iter().filter(|v| v.accepted).count();
    let (value, tone) = share(accepted, transfer.vertebrae.len());
    page.fact("vertebrae accepted", value, tone);
    let accepted = transfer.trajectories.iter().filter(|t| t.accepted).count();
    let (value, tone) = share(accepted, transfer.trajectories.len());
    page.fact("screws accepted", value, tone);
    page.fact("noise of the target", millimetres(transfer.noise_mm), None);
    if let Some(truth) = report.truth {
        let errors = report
            .source
            .iter()
            .zip(&transfer.vertebrae)
            .zip(truth)
            .map(|((bone, found), truth)| {
                let center = bone.surface.centroid();
                pose_error(&found.target_from_source, truth, &center)
            })
            .collect::<Vec<_>>();
        let worst = |f: fn(&pedicle_registration::PoseError) -> f64| {
            errors
                .iter()
                .map(f)
                .fold(0.0, |a, b| if b > a { b } else { a })
        };
        page.fact(
            "largest error",
            millimetres(worst(|e| e.translation_mm)),
            None,
        );
        let degrees = worst(|e| e.rotation_rad).to_degrees();
        page.fact("largest turn", format!("{degrees:.2}°"), None);
    }
}

fn millimetres(x: f64) -> String {
    if x.is_finite() {
        format!("{x:.2} mm")
    } else {
        "–".to_owned()
    }
}

fn number(x: f64, digits: usize) -> String {
    if x.is_finite() {
        format!("{x:.digits$}")
    } else {
        "–".to_owned()
    }
}

fn vertebrae(report: &TransferReport<'_>) -> Section {
    let mut header = vec![
        "level",
        "verdict",
        "residual mm",
        "noise mm",
        "± mm",
        "± °",
        "seen %",
        "points",
        "pose from",
    ];
    if report.truth.is_some() {
        header.extend(["error mm", "error °", "within the margins"]);
    }
    let mut table = Table::new("Vertebrae with what their verdicts rest on", &header);
    for (k, v) in report.transfer.vertebrae.iter().enumerate() {
        let mut row = vertebra_row(v);
        if let Some(truth) = report.truth {
            let center = report.source[k].surface.centroid();
            let error = pose_error(&v.target_from_source, &truth[k], &center);
            let margins = SafetyMargins::default();
            let is_within = margins.is_within(error.translation_mm, error.rotation_rad);
            row.push(number(error.translation_mm, 3));
            row.push(number(error.rotation_rad.to_degrees(), 3));
            row.push(if is_within { "yes" } else { "NO" }.to_owned());
        }
        table.push(row);
    }
    let reasons: Vec<String> = report
        .transfer
        .vertebrae
        .iter()
        .flat_map(|v| v.reasons.iter().map(move |r| format!("{}: {r}", v.level)))
        .collect();
    let mut section = Section::new("vertebrae", "Vertebrae").with(Block::Table(table));
    let notices: Vec<String> = report
        .transfer
        .vertebrae
        .iter()
        .filter_map(|v| Some(format!("{}: {}", v.level, v.notice()?)))
        .collect();
    if !notices.is_empty() {
        section = section
            .with(Block::Text("To know, whether accepted or not:".to_owned()))
            .with(Block::List(notices));
    }
    if !reasons.is_empty() {
        section = section
            .with(Block::Text(
                "A pose that is not accepted must not be used. The reasons:".to_owned(),
            ))
            .with(Block::List(reasons));
    }
    section
}

fn vertebra_row(v: &VertebraTransfer) -> Vec<String> {
    let (mm, degrees) = v.covariance.map_or((f64::NAN, f64::NAN), |c| {
        (c.translation_mm(), c.rotation_rad().to_degrees())
    });
    vec![
        v.level.to_string(),
        if v.accepted { "accepted" } else { "REJECTED" }.to_owned(),
        number(v.residual_mm, 3),
        number(v.noise_mm, 3),
        number(mm, 3),
        number(degrees, 3),
        number(100.0 * v.coverage, 0),
        v.n_points.to_string(),
        v.origin.to_string(),
    ]
}

fn trajectories(report: &TransferReport<'_>) -> Section {
    let mut table = Table::new(
        "Transferred trajectories in the frame of the target",
        &[
            "screw", "verdict", "entry x", "y", "z", "tip x", "y", "z", "diameter",
        ],
    );
    for t in &report.transfer.trajectories {
        let ends = t
            .trajectory
            .entry_mm
            .iter()
            .chain(t.trajectory.tip_mm.iter());
        let mut row = vec![
            screw_name(&t.trajectory),
            if t.accepted { "accepted" } else { "REJECTED" }.to_owned(),
        ];
        row.extend(ends.map(|x| number(*x, 2)));
        row.push(number(t.trajectory.diameter_mm, 1));
        table.push(row);
    }
    Section::new("trajectories", "Trajectories").with(Block::Table(table))
}

/// The k-th screw of the plan: where it was planned and, if the truth is known, where it truly went.
fn screw(report: &TransferReport<'_>, k: usize) -> ScrewReport {
    let planned = &report.plan.trajectories[k];
    let carried = &report.transfer.trajectories[k];
    let level = planned.level.index();
    let found = &report.transfer.vertebrae[level];
    let bone = &report.source[level].surface;
    let pedicle = report.model.pedicle(planned.level, planned.side);
    // Brought back by the true motion, the screw is judged in the bone it was planned in.
    let went = report
        .truth
        .map(|truth| carried.trajectory.transformed(&truth[level].inverse()));
    let check = |t: &Trajectory| {
        let (surface, pedicle) = (report.model.surface(t.level), pedicle?);
        let frame = report.model.frame(t.level);
        check_trajectory(t, surface, pedicle, frame, &CheckOptions::default()).ok()
    };
    let checks = [check(planned), went.as_ref().and_then(check)];
    let [planned_check, went_check] = &checks;
    let mut screws = Vec::new();
    if let Some(check) = planned_check {
        screws.push(CheckedScrew {
            name: "planned",
            series: Series::Blue,
            trajectory: planned,
            check,
        });
    }
    if let (Some(trajectory), Some(check)) = (&went, went_check) {
        screws.push(CheckedScrew {
            name: "transferred",
            series: Series::Red,
            trajectory,
            check,
        });
    }
    let doubt = found.covariance.as_ref().map(|covariance| PoseDoubt {
        target_from_source: &found.target_from_source,
        covariance,
    });
    let mut screw = if screws.is_empty() {
        not_measured(planned)
    } else {
        screw_report(&screws, bone, pedicle, doubt)
    };
    screw.is_accepted = carried.accepted;
    let reasons = found.reasons.iter().map(ToString::to_string);
    screw.reasons.splice(0..0, reasons);
    let depth = pedicle.map_or(ISTHMUS_DEPTH_MM, |p| {
        (p.isthmus_center_mm - planned.entry_mm).dot(&planned.direction())
    });
    add_deviations(&mut screw, report, k, depth);
    screw
}

/// A screw whose pedicle could not be found.
fn not_measured(planned: &Trajectory) -> ScrewReport {
    ScrewReport {
        name: screw_name(planned),
        size_mm: (planned.diameter_mm, planned.length_mm()),
        reasons: vec!["The pedicle could not be measured: clearance is not known.".to_owned()],
        ..ScrewReport::default()
    }
}

fn add_deviations(
    screw: &mut ScrewReport,
    report: &TransferReport<'_>,
    k: usize,
    isthmus_depth_mm: f64,
) {
    let planned = &report.plan.trajectories[k];
    let level = planned.level.index();
    let mut push = |name: &str, value: String| {
        screw.deviations.push(Deviation {
            name: name.to_owned(),
            value,
        });
    };
    if let Some(truth) = report.truth {
        let found = &report.transfer.vertebrae[level].target_from_source;
        let error = trajectory_error(found, &truth[level], planned, isthmus_depth_mm);
        push("off at the entry", millimetres(error.entry_mm));
        push("off at the isthmus", millimetres(error.isthmus_mm));
        push("off at the tip", millimetres(error.tip_mm));
        push(
            "turned by",
            format!("{:.2}°", error.direction_rad.to_degrees()),
        );
    }
    if let Some(u) = report.transfer.trajectories[k].uncertainty {
        push("entry ±", millimetres(u.entry_mm));
        push("isthmus ±", millimetres(u.isthmus_mm));
        push("tip ±", millimetres(u.tip_mm));
        push(
            "breach probability",
            format!("{} %", number(100.0 * u.breach_probability, 2)),
        );
    }
}

//! The page of a plan and its checks.

use nalgebra::{Isometry3, Point3};
use pedicle_mesh::TriMesh;
use pedicle_report::chart::Series;
use pedicle_report::{
    Axes, Column, Geometry, Layout, Page, Panel, Part, Role, Scene, Screw, Tone, screw_section,
};
use pedicle_trajectory::{Level, ScrewReport, VertebraAnatomy};

use super::scene::screw_name;
use super::screws::{CheckedScrew, screw_report};

/// What a report of a plan is made from.
#[derive(Debug, Clone, Copy)]
pub struct PlanReport<'a> {
    /// The heading.
    pub title: &'a str,
    /// The surfaces of the spine, in the order of `anatomy`, mm.
    pub spine: &'a [(Level, &'a TriMesh)],
    /// What was measured on them.
    pub anatomy: &'a [VertebraAnatomy],
    /// The screws with their checks, in the frame of the spine.
    pub screws: &'a [ScrewReport],
}

/// The report of a plan: the spine with its screws, and a card for every screw.
#[must_use]
pub fn plan_page(report: &PlanReport<'_>) -> Page {
    let mut page = Page::new(report.title);
    let n_screws = report.screws.len();
    let fine = report.screws.iter().filter(|s| s.grade.is_acceptable());
    let n_fine = fine.count();
    let tone = if n_fine == n_screws {
        Tone::Good
    } else {
        Tone::Bad
    };
    let value = format!("{n_fine} of {n_screws}");
    page.fact("screws of grade A or B", value, Some(tone));
    let clearances = report.screws.iter().map(|s| s.check.min_clearance_mm());
    if let Some(least) = clearances.min_by(f64::total_cmp) {
        page.fact("least clearance", format!("{least:.2} mm"), None);
    }
    page.scene = Some(scene(report));
    let cards: Vec<_> = report.screws.iter().map(|s| card(report, s)).collect();
    page.sections.push(screw_section(&cards));
    page
}

fn vertebra<'a>(
    report: &PlanReport<'a>,
    level: Level,
) -> Option<(&'a TriMesh, &'a VertebraAnatomy)> {
    let mesh = report.spine.iter().find(|(l, _)| *l == level)?.1;
    let anatomy = report.anatomy.iter().find(|v| v.level == level)?;
    Some((mesh, anatomy))
}

fn card(report: &PlanReport<'_>, screw: &ScrewReport) -> pedicle_report::ScrewReport {
    let t = &screw.trajectory;
    let name = "planned";
    let checked = CheckedScrew {
        name,
        series: Series::Blue,
        trajectory: t,
        check: &screw.check,
    };
    let mut card = match vertebra(report, t.level) {
        Some((bone, anatomy)) => {
            let pedicle = anatomy.pedicle(t.side).ok().map(|p| &p.pedicle);
            screw_report(&[checked], bone, pedicle, None)
        }
        None => pedicle_report::ScrewReport::default(),
    };
    card.is_accepted = screw.grade.is_acceptable();
    card.grades = vec![(name.to_owned(), screw.grade.to_string())];
    let mut fact = |name: &str, value: String| card.facts.push((name.to_owned(), value));
    fact("breach", format!("{:.2} mm", screw.check.breach_mm));
    fact(
        "in the canal",
        format!("{:.2} mm", screw.canal_intrusion_mm),
    );
    fact("facet joint (Babu)", screw.facet.grade.to_string());
    fact(
        "fill of the isthmus",
        format!("{:.0} %", 100.0 * screw.fill),
    );
    if let Some(bone_mm) = screw.tip_to_cortex_mm {
        fact("bone in front of the tip", format!("{bone_mm:.1} mm"));
    }
    card
}

fn scene(report: &PlanReport<'_>) -> Scene {
    let mut scene = Scene {
        panels: vec![Panel {
            name: "spine".to_owned(),
            axes: axes(report),
        }],
        ..Scene::default()
    };
    for (k, (level, mesh)) in report.spine.iter().enumerate() {
        scene.geometries.push(Geometry {
            vertices: mesh.vertices().to_vec(),
            faces: mesh.faces().to_vec(),
            colorings: Vec::new(),
        });
        scene.parts.push(Part {
            name: level.to_string(),
            group: "bone".to_owned(),
            panel: 0,
            geometry: k,
            pose: Isometry3::identity(),
            is_shown: true,
        });
    }
    for screw in report.screws {
        let t = &screw.trajectory;
        scene.screws.push(Screw {
            name: screw_name(t),
            part: t.level.to_string(),
            panel: 0,
            entry_mm: t.entry_mm,
            tip_mm: t.tip_mm,
            diameter_mm: t.diameter_mm,
            isthmus_depth_mm: isthmus_depth_mm(report, screw),
            role: Role::Planned,
            is_accepted: screw.grade.is_acceptable(),
        });
    }
    scene.layouts.push(Layout {
        name: "plan".to_owned(),
        columns: vec![Column {
            title: "Plan".to_owned(),
            panel: 0,
            roles: vec![Role::Planned],
            has_surfaces: true,
        }],
    });
    scene
}

/// Where the view cuts a screw: at its isthmus, half-way without one.
fn isthmus_depth_mm(report: &PlanReport<'_>, screw: &ScrewReport) -> f64 {
    let t = &screw.trajectory;
    vertebra(report, t.level)
        .and_then(|(_, anatomy)| anatomy.pedicle(t.side).ok())
        .map_or(0.5 * t.length_mm(), |p| {
            (p.pedicle.isthmus_center_mm - t.entry_mm).dot(&t.direction())
        })
}

/// Directions of the middle vertebra, around the middle of the spine.
fn axes(report: &PlanReport<'_>) -> Axes {
    let mut points = report.spine.iter().flat_map(|(_, mesh)| mesh.vertices());
    let first = points.next().copied().unwrap_or(Point3::origin());
    let (low, high) = points.fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
    let origin = nalgebra::center(&low, &high);
    match report.anatomy.get(report.anatomy.len() / 2) {
        Some(v) => Axes {
            origin,
            left: v.frame.left,
            anterior: v.frame.anterior,
            up: v.frame.up,
        },
        None => Axes {
            origin,
            left: -nalgebra::Vector3::x(),
            anterior: nalgebra::Vector3::y(),
            up: nalgebra::Vector3::z(),
        },
    }
}

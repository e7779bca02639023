//! Anatomy, plans and checks as JSON. Lengths mm, angles degrees.

use pedicle_mesh::TriMesh;
use pedicle_trajectory::{
    Grade, Implant, Level, PlannedScrew, ScrewReport, Side, Trajectory, VertebraAnatomy, Zone,
};
use serde::Serialize;

/// A checked plan.
#[derive(Debug, Clone, Serialize)]
pub struct CheckFile {
    /// One entry a screw, in the order of the plan.
    pub screws: Vec<ScrewEntry>,
}

/// One checked screw.
#[derive(Debug, Clone, Serialize)]
pub struct ScrewEntry {
    /// Its level.
    pub level: Level,
    /// Its side.
    pub side: Side,
    /// Gertzbein and Robbins, "A" to "E".
    pub grade: Grade,
    /// How far the wall reaches beyond the cortex, mm.
    pub breach_mm: f64,
    /// "medial", "lateral", "cranial", "caudal" or "anterior"; null without a breach.
    pub direction: Option<String>,
    /// Least distance from the wall to the cortex, mm; negative with a breach; null if the judged
    /// part of the screw is empty.
    pub clearance_mm: Option<f64>,
    /// The same in the pedicle alone.
    pub pedicle_clearance_mm: Option<f64>,
    /// The same in front of the pedicle.
    pub body_clearance_mm: Option<f64>,
    /// Whether the axis crosses the isthmus inside the bone.
    pub through_pedicle: bool,
    /// How far the wall reaches into the canal, mm.
    pub canal_intrusion_mm: f64,
    /// Babu's grade of a facet violation, 0 to 3.
    pub facet_violation: u8,
    /// From the wall to the upper articular surface, mm; null where no vertebra above tells where
    /// that is.
    pub facet_distance_mm: Option<f64>,
    /// Diameter over the narrowest chord of the isthmus.
    pub fill: f64,
    /// From the tip along the axis to the cortex, mm; null if the tip is outside.
    pub tip_to_cortex_mm: Option<f64>,
    /// Bone at the entry that was not judged, mm.
    pub skipped_entry_mm: f64,
    /// From the entry to the isthmus along the axis, mm.
    pub isthmus_depth_mm: Option<f64>,
    /// Length, mm.
    pub length_mm: f64,
    /// Diameter, mm.
    pub diameter_mm: f64,
    /// The nearest other screw.
    pub nearest_screw: Option<NearestEntry>,
    /// Clearance along the screw.
    pub profile: Vec<ProfileEntry>,
}

/// The nearest other screw.
#[derive(Debug, Clone, Serialize)]
pub struct NearestEntry {
    /// Its level.
    pub level: Level,
    /// Its side.
    pub side: Side,
    /// Between the walls, mm.
    pub distance_mm: f64,
}

/// Clearance at one place.
#[derive(Debug, Clone, Serialize)]
pub struct ProfileEntry {
    /// From the entry along the axis, mm.
    pub depth_mm: f64,
    /// From the wall to the cortex, mm.
    pub clearance_mm: f64,
    /// "entry" (not judged), "pedicle" or "body".
    pub zone: &'static str,
}

impl From<&[ScrewReport]> for CheckFile {
    fn from(reports: &[ScrewReport]) -> Self {
        Self {
            screws: reports.iter().map(ScrewEntry::from).collect(),
        }
    }
}

fn finite(x: f64) -> Option<f64> {
    x.is_finite().then_some(x)
}

impl From<&ScrewReport> for ScrewEntry {
    fn from(r: &ScrewReport) -> Self {
        let (t, check) = (&r.trajectory, &r.check);
        Self {
            level: t.level,
            side: t.side,
            grade: r.grade,
            breach_mm: check.breach_mm,
            direction: check.breach_direction.map(|d| d.to_string()),
            clearance_mm: finite(check.min_clearance_mm()),
            pedicle_clearance_mm: finite(check.pedicle_clearance_mm),
            body_clearance_mm: finite(check.body_clearance_mm),
            through_pedicle: check.through_pedicle,
            canal_intrusion_mm: r.canal_intrusion_mm,
            facet_violation: r.facet.grade,
            facet_distance_mm: r.facet.distance_mm,
            fill: r.fill,
            tip_to_cortex_mm: r.tip_to_cortex_mm,
            skipped_entry_mm: r.skipped_entry_mm,
            isthmus_depth_mm: check.isthmus_depth_mm,
            length_mm: t.length_mm(),
            diameter_mm: t.diameter_mm,
            nearest_screw: r.nearest_screw.map(|n| NearestEntry {
                level: n.level,
                side: n.side,
                distance_mm: n.distance_mm,
            }),
            profile: check
                .profile
                .iter()
                .map(|s| ProfileEntry {
                    depth_mm: s.depth_mm,
                    clearance_mm: s.clearance_mm,
                    zone: match s.zone {
                        Zone::Entry => "entry",
                        Zone::Pedicle => "pedicle",
                        Zone::Body => "body",
                    },
                })
                .collect(),
        }
    }
}

/// A plan with its checks.
#[derive(Debug, Clone, Serialize)]
pub struct PlanFile {
    /// The trajectories, as in a plan file.
    pub trajectories: Vec<Trajectory>,
    /// What each is for: "screw" or "guide_wire".
    pub implants: Vec<&'static str>,
    /// Their checks.
    pub screws: Vec<ScrewEntry>,
}

impl PlanFile {
    /// A plan and its checks, in the same order.
    #[must_use]
    pub fn new(planned: &[PlannedScrew], reports: &[ScrewReport]) -> Self {
        Self {
            trajectories: planned.iter().map(|p| p.trajectory).collect(),
            implants: planned
                .iter()
                .map(|p| match p.implant {
                    Implant::Screw => "screw",
                    Implant::GuideWire { .. } => "guide_wire",
                })
                .collect(),
            screws: reports.iter().map(ScrewEntry::from).collect(),
        }
    }
}

/// The anatomy of a spine.
#[derive(Debug, Clone, Serialize)]
pub struct AnatomyFile {
    /// From the top down.
    pub vertebrae: Vec<AnatomyEntry>,
}

/// The anatomy of one vertebra; what its shape does not allow is null, with the reason in `errors`.
#[derive(Debug, Clone, Serialize)]
pub struct AnatomyEntry {
    /// Its level.
    pub level: Level,
    /// "high", "fair" or "low".
    pub confidence: &'static str,
    /// What speaks against trusting this, as sentences.
    pub doubts: Vec<String>,
    /// What could not be measured, as sentences.
    pub errors: Vec<String>,
    /// Unit vectors left, anterior, up.
    pub axes: [[f64; 3]; 3],
    /// Depth, width, and heights at the back, in the middle and in front, mm.
    pub body_mm: Option<[Option<f64>; 5]>,
    /// Width and depth (null if open behind), mm.
    pub canal_mm: Option<(f64, Option<f64>)>,
    /// The top of the spinous process, mm.
    pub spinous_process_tip_mm: Option<[f64; 3]>,
    /// Left, then right; null if there is none.
    pub pedicles: [Option<PedicleEntry>; 2],
}

/// One pedicle.
#[derive(Debug, Clone, Serialize)]
pub struct PedicleEntry {
    /// Its side.
    pub side: Side,
    /// Centroid of the isthmus, mm.
    pub isthmus_center_mm: [f64; 3],
    /// Unit vector to the front: the normal of the isthmus' plane.
    pub axis: [f64; 3],
    /// Medio-lateral, mm.
    pub width_mm: f64,
    /// Shortest chord, mm.
    pub narrowest_mm: f64,
    /// Upright, mm.
    pub height_mm: f64,
    /// Medio-lateral chord through the centroid, as surveys measure the width, mm.
    pub mediolateral_chord_mm: f64,
    /// Upright chord through the centroid, as surveys measure the height, mm.
    pub upright_chord_mm: f64,
    /// Positive: converges to the front, degrees.
    pub transverse_angle_deg: f64,
    /// The same as surveys read it from axial sections, degrees; null if no section shows it.
    pub axial_angle_deg: Option<f64>,
    /// Positive: rises to the front, degrees.
    pub sagittal_angle_deg: f64,
    /// From the posterior to the anterior cortex along the axis, mm.
    pub chord_length_mm: f64,
    /// Middle of the entry zone, mm.
    pub entry_mm: [f64; 3],
    /// Radius of the entry zone, mm.
    pub entry_zone_radius_mm: f64,
    /// Contour of the isthmus, mm; the last point joins the first.
    pub isthmus_contour_mm: Vec<[f64; 3]>,
}

impl AnatomyFile {
    /// What was measured on these surfaces, in their order.
    #[must_use]
    pub fn new(found: &[VertebraAnatomy], vertebrae: &[(Level, &TriMesh)]) -> Self {
        Self {
            vertebrae: found
                .iter()
                .zip(vertebrae)
                .map(|(v, (_, mesh))| AnatomyEntry::new(v, mesh))
                .collect(),
        }
    }
}

impl AnatomyEntry {
    /// What was measured on this surface.
    #[must_use]
    pub fn new(v: &VertebraAnatomy, mesh: &TriMesh) -> Self {
        let mut errors = Vec::new();
        errors.extend(v.body.as_ref().err().map(ToString::to_string));
        errors.extend(v.canal.as_ref().err().map(ToString::to_string));
        errors.extend(
            v.spinous_process_tip_mm
                .as_ref()
                .err()
                .map(ToString::to_string),
        );
        for side in Side::ALL {
            errors.extend(v.pedicle(side).err().map(|e| e.to_string()));
        }
        let pedicles = Side::ALL.map(|side| {
            let a = v.pedicle(side).ok()?;
            let p = &a.pedicle;
            Some(PedicleEntry {
                side,
                isthmus_center_mm: p.isthmus_center_mm.into(),
                axis: p.axis.into(),
                width_mm: p.width_mm,
                narrowest_mm: p.narrowest_mm,
                height_mm: p.height_mm,
                mediolateral_chord_mm: a.mediolateral_chord_mm,
                upright_chord_mm: a.upright_chord_mm,
                transverse_angle_deg: a.transverse_angle_rad.to_degrees(),
                axial_angle_deg: a.axial_angle_rad(mesh, &v.frame).map(f64::to_degrees),
                sagittal_angle_deg: a.sagittal_angle_rad.to_degrees(),
                chord_length_mm: a.chord_length_mm,
                entry_mm: a.entry_mm.into(),
                entry_zone_radius_mm: a.entry_zone_radius_mm,
                isthmus_contour_mm: a.isthmus_contour_mm.iter().map(|p| (*p).into()).collect(),
            })
        });
        Self {
            level: v.level,
            confidence: v.confidence().name(),
            doubts: v.doubts.iter().map(ToString::to_string).collect(),
            errors,
            axes: [v.frame.left, v.frame.anterior, v.frame.up].map(Into::into),
            body_mm: v.body.as_ref().ok().map(|b| {
                [
                    b.depth_mm,
                    b.width_mm,
                    b.posterior_height_mm,
                    b.middle_height_mm,
                    b.anterior_height_mm,
                ]
                .map(finite)
            }),
            canal_mm: v.canal.as_ref().ok().map(|c| (c.width_mm, c.depth_mm)),
            spinous_process_tip_mm: v.spinous_process_tip_mm.as_ref().ok().map(|&p| p.into()),
            pedicles,
        }
    }
}

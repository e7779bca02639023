//! A screw in words and figures.

use std::fmt::Write;

use crate::block::Tone;
use crate::chart::{Band, Curve, OutlineView, Plot, Zone, outlines, plot};
use crate::{Block, Card, Figure, Section};

/// Everything a report tells about one screw.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ScrewReport {
    /// Its name, that of the scene's screw.
    pub name: String,
    /// Diameter and length, mm.
    pub size_mm: (f64, f64),
    /// Whether it may be used.
    pub is_accepted: bool,
    /// Sentences that tell why not, or what to look at.
    pub reasons: Vec<String>,
    /// Grades with what they are of, such as ("planned", "A").
    pub grades: Vec<(String, String)>,
    /// How far off it is, or may be.
    pub deviations: Vec<Deviation>,
    /// Other names and values.
    pub facts: Vec<(String, String)>,
    /// Clearance along the screw: depth from the entry and distance of the wall from the cortex, mm.
    pub profile: Vec<Curve>,
    /// How far the clearance may be off: depth, low and high, mm.
    pub profile_band: Option<Band>,
    /// Parts of the bone along the screw.
    pub zones: Vec<Zone>,
    /// The pedicle across the isthmus with the screw; `None` where it could not be measured.
    pub isthmus: Option<OutlineView>,
}

/// How far a screw is off, or may be.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Deviation {
    /// What it is of, such as "entry ± mm".
    pub name: String,
    /// The value with its unit.
    pub value: String,
}

/// The cards of all screws.
#[must_use]
pub fn screw_section(screws: &[ScrewReport]) -> Section {
    Section::new("screws", "Screws")
        .with(Block::Text(
            "Clearance is the distance from the wall of the screw to the cortex at right angles to \
             its axis; below zero the wall is outside. The grey stretch at the entry does not count: every \
             screw has to cross the cortex there. The section is seen from behind, at the isthmus, the \
             narrowest place of the pedicle. Grades are those of Gertzbein and Robbins: A no \
             breach, B less than 2 mm, C less than 4, D less than 6, E more."
                .to_owned(),
        ))
        .with(Block::Cards(screws.iter().map(card).collect()))
}

fn card(screw: &ScrewReport) -> Card {
    let (diameter, length) = screw.size_mm;
    let mut facts = vec![("size".to_owned(), format!("{diameter:.1} × {length:.0} mm"))];
    facts.extend(
        screw
            .grades
            .iter()
            .map(|(of, grade)| (format!("grade, {of}"), grade.clone())),
    );
    facts.extend(
        screw
            .deviations
            .iter()
            .map(|d| (d.name.clone(), d.value.clone())),
    );
    facts.extend(screw.facts.iter().cloned());
    let mut figures = vec![profile(screw)];
    figures.extend(screw.isthmus.as_ref().map(|view| isthmus(screw, view)));
    Card {
        title: screw.name.clone(),
        verdict: if screw.is_accepted {
            "accepted"
        } else {
            "REJECTED"
        }
        .to_owned(),
        tone: if screw.is_accepted {
            Tone::Good
        } else {
            Tone::Bad
        },
        reasons: screw.reasons.clone(),
        facts,
        figures,
        shows: Some(screw.name.clone()),
    }
}

fn profile(screw: &ScrewReport) -> Figure {
    let title = format!("{} clearance", screw.name);
    let mut csv = String::from("curve,depth_mm,clearance_mm\n");
    for curve in &screw.profile {
        for (depth, clearance) in &curve.points {
            let _ = writeln!(csv, "{},{depth:.4},{clearance:.4}", curve.name);
        }
    }
    let svg = plot(&Plot {
        label: format!("Clearance of screw {} along its length", screw.name),
        x_label: "depth below the entry, mm".to_owned(),
        y_label: "clearance, mm".to_owned(),
        curves: screw.profile.clone(),
        bands: screw.profile_band.iter().cloned().collect(),
        zones: screw.zones.clone(),
        levels: vec![(0.0, "cortex".to_owned())],
        ..Plot::default()
    });
    Figure {
        title,
        caption: "from entry to tip".to_owned(),
        svg,
        csv,
    }
}

fn isthmus(screw: &ScrewReport, view: &OutlineView) -> Figure {
    let mut csv = String::from("outline,x_mm,y_mm\n");
    for (k, contour) in view.contours.iter().enumerate() {
        for p in contour {
            let _ = writeln!(csv, "bone {},{:.4},{:.4}", k + 1, p.x, p.y);
        }
    }
    for outline in &view.outlines {
        let (c, a) = (outline.center_mm, outline.shape_mm);
        let _ = writeln!(csv, "{} centre,{:.4},{:.4}", outline.name, c.x, c.y);
        for k in 0..2 {
            let _ = writeln!(
                csv,
                "{} half axis,{:.4},{:.4}",
                outline.name,
                a[(0, k)],
                a[(1, k)]
            );
        }
    }
    Figure {
        title: format!("{} isthmus", screw.name),
        caption: "seen from behind".to_owned(),
        svg: outlines(view),
        csv,
    }
}

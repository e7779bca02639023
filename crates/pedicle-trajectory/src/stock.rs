//! Plans with the implants of a catalogue.

use pedicle_mesh::TriMesh;

use crate::assess::facet_points;
use crate::planner::{Site, plan_site, refine_at_site};
use crate::{
    Catalogue, Level, NarrowPedicle, PlannerError, PlannerOptions, Side, Trajectory,
    VertebraAnatomy,
};

/// What goes into a pedicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Implant {
    /// A screw of the catalogue that keeps all limits.
    Screw,
    /// No screw of the catalogue fits; the guide wire or pilot drill that would go first.
    GuideWire {
        /// Narrowest chord of the isthmus, mm.
        narrowest_mm: f64,
    },
}

/// A planned trajectory and what it is for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedScrew {
    /// Where.
    pub trajectory: Trajectory,
    /// What.
    pub implant: Implant,
}

/// Plans one pedicle with a catalogue, clear of the facet joint above.
///
/// `options` gives the limits; its diameters and lengths are replaced by those of the catalogue.
///
/// # Errors
/// [`PlannerError`] if the spine has no such pedicle, there is no way in or no room for a tip, or
/// neither a screw nor a guide wire of the catalogue fits.
pub fn plan_from_stock(
    spine: &[VertebraAnatomy],
    meshes: &[(Level, &TriMesh)],
    (level, side): (Level, Side),
    catalogue: &Catalogue,
    options: &PlannerOptions,
) -> Result<PlannedScrew, PlannerError> {
    let vertebra = spine
        .iter()
        .find(|v| v.level == level)
        .ok_or(PlannerError::NoSuchLevel { level })?;
    let pedicle = &vertebra
        .pedicle(side)
        .map_err(|source| PlannerError::Anatomy {
            level,
            side,
            source,
        })?
        .pedicle;
    let facets = facet_points(spine, meshes, level);
    let site = Site {
        index: &vertebra.surface,
        pedicle,
        frame: &vertebra.frame,
        level,
        facets: &facets,
    };
    let with = |diameters_mm: &[f64]| PlannerOptions {
        diameters_mm: diameters_mm.to_vec(),
        lengths_mm: catalogue.lengths_mm.clone(),
        narrow_pedicle: NarrowPedicle::Refuse,
        ..options.clone()
    };
    let screws = with(&catalogue.diameters_mm);
    match plan_site(&site, &screws) {
        Ok(found) => Ok(PlannedScrew {
            trajectory: refine_at_site(&site, &screws, found),
            implant: Implant::Screw,
        }),
        Err(PlannerError::TooNarrow { .. }) if !catalogue.guide_wires_mm.is_empty() => {
            let wires = with(&catalogue.guide_wires_mm);
            let found = plan_site(&site, &wires)?;
            Ok(PlannedScrew {
                trajectory: refine_at_site(&site, &wires, found),
                implant: Implant::GuideWire {
                    narrowest_mm: pedicle.narrowest_mm,
                },
            })
        }
        Err(error) => Err(error),
    }
}

//! A simple planner: the screw that runs deepest through a pedicle.
//!
//! ```text
//! maximise  -(1/k) log Σ_i w_i exp(-k d(x_i)) - p |slope|²
//! ```
//!
//! over the two angles of the axis and the two offsets of the place where it crosses the
//! isthmus; d depth below the surface at points x_i from behind the pedicle to the tip, w_i small
//! behind the pedicle, where a screw may show. From there the least depth itself is maximised, which
//! is the clearance of any screw on that line. Then the thickest screw of the catalogue that fills no
//! more than its share of the isthmus and keeps its clearance; for that screw, which may pass a facet
//! joint nearer than a thicker one, the clearance itself is maximised once more. Lengths in mm.

use nalgebra::{Point3, Vector3};
use pedicle_mesh::{SurfaceIndex, TriMesh};

use crate::check::{CheckOptions, TrajectoryCheck, check_trajectory};
use crate::depth::depth_mm;
use crate::facets::{FACET_MM, FacetViolation, axis_distance_mm};
use crate::search::climb;
use crate::{
    AnatomicalFrame, AnatomyError, Level, Pedicle, PedicleOptions, Plan, Side, Trajectory,
    anatomical_frames, measure_pedicle,
};

/// What to do with a pedicle too narrow for the catalogue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NarrowPedicle {
    /// Take the thinnest screw if it stays inside the bone; fill and clearance then fall short.
    TakeThinnest,
    /// Give an error.
    Refuse,
}

/// What the planner aims at.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannerOptions {
    /// Screw diameters to choose from, mm. Default 4.0 to 7.5 in steps of 0.5.
    pub diameters_mm: Vec<f64>,
    /// Largest part of the narrowest chord of the isthmus that a screw fills. Default 0.8.
    pub max_fill: f64,
    /// Lengths to choose from, mm: the longest that fits is taken. Any length if empty, which is
    /// the default.
    pub lengths_mm: Vec<f64>,
    /// Least distance from the screw's wall to the cortex, mm. Default 1.5.
    pub min_clearance_mm: f64,
    /// Distance from entry to tip, mm; shorter where the body is. Default 40.
    pub length_mm: f64,
    /// Least distance from the tip to the surface of the body, mm. Default 4.
    pub tip_margin_mm: f64,
    /// What to do with a pedicle too narrow for the catalogue. Default: the thinnest screw.
    pub narrow_pedicle: NarrowPedicle,
}

impl Default for PlannerOptions {
    fn default() -> Self {
        Self {
            diameters_mm: (8..=15).map(|half| 0.5 * f64::from(half)).collect(),
            max_fill: 0.8,
            lengths_mm: Vec::new(),
            min_clearance_mm: 1.5,
            length_mm: 40.0,
            tip_margin_mm: 4.0,
            narrow_pedicle: NarrowPedicle::TakeThinnest,
        }
    }
}

/// Why there is no plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlannerError {
    /// The spine's directions were not found.
    #[error("the spine has no anatomical frames: {0}")]
    Frames(AnatomyError),
    /// The spine lacks a level that is to be planned.
    #[error("the spine has no {level} to plan")]
    NoSuchLevel {
        /// The level.
        level: Level,
    },
    /// The pedicle was not found.
    #[error("{level} {side}: {source}")]
    Anatomy {
        /// Level of the vertebra.
        level: Level,
        /// Side of the pedicle.
        side: Side,
        /// What was missing.
        source: AnatomyError,
    },
    /// The catalogue is empty or holds a diameter that no screw has.
    #[error("the catalogue of {n_diameters} diameters has none between 0 and 20 mm")]
    Catalogue {
        /// Number of diameters given.
        n_diameters: usize,
    },
    /// No way in or no room for the tip.
    #[error("{level} {side}: a line through the pedicle finds no {what}")]
    NoRoom {
        /// Level of the vertebra.
        level: Level,
        /// Side of the pedicle.
        side: Side,
        /// What is missing.
        what: &'static str,
    },
    /// The pedicle is too narrow for the thinnest screw.
    #[error(
        "{level} {side}: the pedicle has {width_mm:.1} mm at its narrowest, and a {diameter_mm} mm screw leaves {clearance_mm:.2} mm to the cortex"
    )]
    TooNarrow {
        /// Level of the vertebra.
        level: Level,
        /// Side of the pedicle.
        side: Side,
        /// Narrowest chord of the isthmus, mm.
        width_mm: f64,
        /// Diameter of the thinnest screw, mm.
        diameter_mm: f64,
        /// Least clearance it has, mm; negative if it breaches.
        clearance_mm: f64,
    },
}

/// Plans both pedicles of every vertebra given.
///
/// # Errors
/// [`PlannerError`] naming the first level and side that cannot be planned.
pub fn plan_spine(
    vertebrae: &[(Level, &TriMesh)],
    options: &PlannerOptions,
) -> Result<Plan, PlannerError> {
    let frames = anatomical_frames(vertebrae).map_err(PlannerError::Frames)?;
    let mut trajectories = Vec::with_capacity(2 * vertebrae.len());
    for ((level, mesh), frame) in vertebrae.iter().zip(&frames) {
        let index = SurfaceIndex::new(mesh).map_err(|e| PlannerError::Frames(e.into()))?;
        for side in Side::ALL {
            let pedicle = measure_pedicle(mesh, &index, frame, side, &PedicleOptions::default())
                .map_err(|source| PlannerError::Anatomy {
                    level: *level,
                    side,
                    source,
                })?;
            trajectories.push(plan_pedicle(&index, &pedicle, frame, *level, options)?);
        }
    }
    Ok(Plan { trajectories })
}

/// Plans one screw through a measured pedicle.
///
/// # Errors
/// [`PlannerError`] if the catalogue is empty, no line through the pedicle has an entry and room
/// for a tip, or the pedicle is too narrow.
pub fn plan_pedicle(
    index: &SurfaceIndex,
    pedicle: &Pedicle,
    frame: &AnatomicalFrame,
    level: Level,
    options: &PlannerOptions,
) -> Result<Trajectory, PlannerError> {
    let site = Site {
        index,
        pedicle,
        frame,
        level,
        facets: &[],
    };
    Ok(plan_site(&site, options)?.0)
}

/// A pedicle with all that bounds a screw in it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Site<'a> {
    pub(crate) index: &'a SurfaceIndex,
    pub(crate) pedicle: &'a Pedicle,
    pub(crate) frame: &'a AnatomicalFrame,
    pub(crate) level: Level,
    /// Points of the upper articular surface, mm.
    pub(crate) facets: &'a [Point3<f64>],
}

/// Where an axis runs: offsets in the isthmus along width and height, mm; slopes medially and upwards
/// in units of `SLOPE_UNIT`.
pub(crate) type Place = [f64; 4];

/// The screw at a site with the most clearance among those of its diameter and length.
pub(crate) fn refine_at_site(
    site: &Site<'_>,
    options: &PlannerOptions,
    (screw, place): (Trajectory, Place),
) -> Trajectory {
    Planner::new(site, options).refined(screw, place)
}

/// Plans one screw at a site; also where its axis runs.
pub(crate) fn plan_site(
    site: &Site<'_>,
    options: &PlannerOptions,
) -> Result<(Trajectory, Place), PlannerError> {
    let Site { pedicle, level, .. } = *site;
    let side = pedicle.side;
    let planner = Planner::new(site, options);
    let mut diameters: Vec<f64> = options.diameters_mm.clone();
    diameters.retain(|d| *d > 0.0 && *d <= crate::MAX_DIAMETER_MM);
    diameters.sort_by(f64::total_cmp);
    let Some(&thinnest) = diameters.first() else {
        return Err(PlannerError::Catalogue {
            n_diameters: options.diameters_mm.len(),
        });
    };
    let place = planner.best_line();
    let line = planner.axis_of(&place);
    let no_room = |what| PlannerError::NoRoom { level, side, what };
    let (entry_mm, tip_mm) = planner.ends(&line).map_err(no_room)?;
    let tip_mm = planner.stocked_tip(entry_mm, tip_mm).map_err(no_room)?;
    let with = |diameter_mm: f64| Trajectory {
        level,
        side,
        entry_mm,
        tip_mm,
        diameter_mm,
    };
    let fits = |diameter_mm: &&f64| {
        **diameter_mm <= options.max_fill * pedicle.narrowest_mm
            && planner
                .check(&with(**diameter_mm))
                .is_some_and(|c| c.valid && c.min_clearance_mm() >= options.min_clearance_mm)
    };
    let clear = |diameter_mm: &&f64| {
        let violation = FacetViolation::of(&with(**diameter_mm), site.facets);
        violation.grade == 0 && fits(diameter_mm)
    };
    // A pedicle right below a joint may leave no screw clear of it; the check tells.
    let thickest = diameters.iter().rev();
    if let Some(&diameter) = thickest
        .clone()
        .find(clear)
        .or_else(|| thickest.clone().find(fits))
    {
        return Ok((with(diameter), place));
    }
    let check = planner.check(&with(thinnest));
    let inside = check.as_ref().is_some_and(|c| c.valid);
    if inside && options.narrow_pedicle == NarrowPedicle::TakeThinnest {
        return Ok((with(thinnest), place));
    }
    Err(PlannerError::TooNarrow {
        level,
        side,
        width_mm: pedicle.narrowest_mm,
        diameter_mm: thinnest,
        clearance_mm: check.map_or(f64::NEG_INFINITY, |c| c.min_clearance_mm()),
    })
}

struct Planner<'a> {
    index: &'a SurfaceIndex,
    pedicle: &'a Pedicle,
    frame: &'a AnatomicalFrame,
    facets: &'a [Point3<f64>],
    options: &'a PlannerOptions,
}

/// An axis: where it crosses the isthmus and its direction.
#[derive(Debug, Clone, Copy)]
struct Axis {
    at_isthmus: Point3<f64>,
    direction: Vector3<f64>,
}

/// Depth that a slope against the end plates must gain: its square times this, mm.
const SLOPE_PENALTY_MM: f64 = 6.0;
/// Depth that a change of the medial angle must gain: its tangent's square times this, mm.
const CONVERGENCE_PENALTY_MM: f64 = 3.0;
/// How a score weighs the depths along an axis.
#[derive(Debug, Clone, Copy)]
struct Sharpness {
    /// Sharpness k of the soft minimum, 1/mm.
    per_mm: f64,
    /// Spacing of the points whose depth counts, mm.
    spacing_mm: f64,
}

const SOFT: Sharpness = Sharpness {
    per_mm: 3.0,
    spacing_mm: 2.0,
};
const SHARP: Sharpness = Sharpness {
    per_mm: 12.0,
    spacing_mm: 1.0,
};
/// Behind the pedicle this much less depth is as good, mm: the screw may show there.
const ENTRY_BONUS_MM: f64 = 3.0;
/// First and last step of the two searches; offsets in mm, slopes in units of `SLOPE_UNIT`.
const COARSE_STEPS: (f64, f64) = (1.0, 0.1);
const FINE_STEPS: (f64, f64) = (0.3, 0.02);
/// One unit of the search in slope.
const SLOPE_UNIT: f64 = 0.1;
/// Medial angles from which the search starts, as tangents relative to the pedicle's axis.
const START_CONVERGENCES: [f64; 3] = [0.0, 0.15, 0.3];
/// Longest way from the isthmus back to the entry, mm.
const MAX_WAY_BACK_MM: f64 = 40.0;
/// Part of the way behind the pedicle in which the depth does not count, mm.
const ENTRY_MM: f64 = 4.0;

impl<'a> Planner<'a> {
    fn new(site: &Site<'a>, options: &'a PlannerOptions) -> Self {
        Self {
            index: site.index,
            pedicle: site.pedicle,
            frame: site.frame,
            facets: site.facets,
            options,
        }
    }

    fn check(&self, trajectory: &Trajectory) -> Option<TrajectoryCheck> {
        let options = CheckOptions::default();
        check_trajectory(trajectory, self.index, self.pedicle, self.frame, &options).ok()
    }

    fn medial(&self) -> Vector3<f64> {
        -self.frame.left * self.pedicle.side.sign()
    }

    fn axis_of(&self, v: &Place) -> Axis {
        let pedicle = self.pedicle;
        let height_direction = pedicle.axis.cross(&pedicle.width_direction);
        let direction = pedicle.axis
            + self.medial() * (v[2] * SLOPE_UNIT)
            + self.frame.up * (v[3] * SLOPE_UNIT);
        Axis {
            at_isthmus: pedicle.isthmus_center_mm
                + pedicle.width_direction * v[0]
                + height_direction * v[1],
            direction: direction.normalize(),
        }
    }

    fn best_line(&self) -> Place {
        // A soft score leads to the right valley, a sharp one to its bottom.
        let mut best: Option<(f64, [f64; 4])> = None;
        for convergence in START_CONVERGENCES {
            let start = [0.0, 0.0, convergence / SLOPE_UNIT, 0.0];
            let found = climb(start, COARSE_STEPS, |v| self.score(&self.axis_of(v), SOFT));
            if best.is_none_or(|(b, _)| found.0 > b) {
                best = Some(found);
            }
        }
        let near = best.map_or([0.0; 4], |(_, v)| v);
        let (_, v) = climb(near, FINE_STEPS, |v| self.score(&self.axis_of(v), SHARP));
        let (value, last) = climb(v, LAST_STEPS, |v| self.least_depth(&self.axis_of(v)));
        if value.is_finite() { last } else { v }
    }

    /// The screw of this diameter and length on the line near `place` where it has the most clearance
    /// without being nearer to a facet joint than it has to; the screw itself if there is none.
    fn refined(&self, screw: Trajectory, place: Place) -> Trajectory {
        let facet_mm = 0.5 * screw.diameter_mm + FACET_MM + FACET_SPARE_MM;
        let on_line = |v: &[f64; 4]| {
            let axis = self.axis_of(v);
            let (entry, tip) = self.ends(&axis).ok()?;
            let fits = (tip - entry).norm() + LENGTH_TOLERANCE_MM >= screw.length_mm();
            let tip_mm = entry + axis.direction * screw.length_mm();
            fits.then_some(Trajectory {
                entry_mm: entry,
                tip_mm,
                ..screw
            })
        };
        let score = |v: &[f64; 4]| {
            let Some(t) = on_line(v) else {
                return f64::NEG_INFINITY;
            };
            let too_near = axis_distance_mm(&t, self.facets).map_or(0.0, |d| facet_mm - d);
            // The clearance itself: depths beside the entry and the tip say less about it.
            let options = CheckOptions {
                station_spacing_mm: REFINE_STATIONS_MM,
                ..CheckOptions::default()
            };
            let check = check_trajectory(&t, self.index, self.pedicle, self.frame, &options);
            let Some(check) = check.ok().filter(|check| check.through_pedicle) else {
                return f64::NEG_INFINITY;
            };
            let axis = self.axis_of(v);
            check.min_clearance_mm()
                - LAST_PREFERENCE * self.unlikeliness_mm(&axis)
                - FACET_FIRMNESS * too_near.max(0.0)
        };
        let clearance = |t: &Trajectory| {
            let check = self.check(t).filter(|check| check.valid)?;
            let facet = FacetViolation::of(t, self.facets).grade;
            Some((facet, check.min_clearance_mm()))
        };
        // A body and a wide pedicle leave several lines from which no small step is better.
        let mut grid: Vec<(f64, Place)> = (0..GRID_STEPS.pow(4))
            .map(|k| {
                let at = std::array::from_fn(|i| {
                    let digit = k / GRID_STEPS.pow(i as u32) % GRID_STEPS;
                    GRID_REACH[i] * (2.0 * digit as f64 / (GRID_STEPS - 1) as f64 - 1.0)
                });
                (score(&at), at)
            })
            .collect();
        grid.sort_by(|a, b| b.0.total_cmp(&a.0));
        let starts = grid.iter().take(GRID_STARTS).map(|(_, at)| *at);
        let mut best = screw;
        for start in std::iter::once(place).chain(starts) {
            let (_, found) = climb(start, REFINE_STEPS, score);
            let Some(t) = on_line(&found) else { continue };
            let is_better = match (clearance(&t), clearance(&best)) {
                (Some((facet, clear)), Some((best_facet, best_clear))) => {
                    facet <= best_facet && clear > best_clear
                }
                (found, _) => found.is_some(),
            };
            if is_better {
                best = t;
            }
        }
        best
    }

    /// The least depth along the judged part of an axis, mm, with slight preferences.
    fn least_depth(&self, axis: &Axis) -> f64 {
        let Ok((entry, tip)) = self.ends(axis) else {
            return f64::NEG_INFINITY;
        };
        self.least_depth_between(axis, entry, tip)
            - LAST_PREFERENCE * self.unlikeliness_mm(axis)
            - self.shortcomings(axis, entry, tip)
    }

    /// The least depth along the judged part of an axis between entry and tip, mm.
    fn least_depth_between(&self, axis: &Axis, entry: Point3<f64>, tip: Point3<f64>) -> f64 {
        let check = CheckOptions::default();
        let back = (entry - axis.at_isthmus).norm();
        let ahead = (tip - axis.at_isthmus).norm();
        let start = (check.ignored_entry_depth_mm - back)
            .max(-self.pedicle.behind_mm - check.behind_pedicle_mm)
            .min(0.0);
        // What lies in front of the tip is not beside the screw.
        let end = (ahead - self.options.tip_margin_mm).max(0.0);
        let n = ((end - start) / DEPTH_SPACING_MM).ceil().max(1.0);
        (0..=n as usize)
            .map(|k| start + (end - start) * k as f64 / n)
            .map(|s| depth_mm(self.index, &(axis.at_isthmus + axis.direction * s)))
            .fold(f64::INFINITY, f64::min)
    }

    /// What slopes against the end plates and turns from the pedicle's axis have to gain, mm.
    fn unlikeliness_mm(&self, axis: &Axis) -> f64 {
        let forward = axis.direction.dot(&self.frame.anterior);
        let slope = axis.direction.dot(&self.frame.up) / forward;
        let turn = axis.direction.dot(&self.medial()) / forward
            - self.pedicle.axis.dot(&self.medial()) / self.pedicle.axis.dot(&self.frame.anterior);
        SLOPE_PENALTY_MM * slope * slope + CONVERGENCE_PENALTY_MM * turn * turn
    }

    /// What a short way and a facet joint nearby cost, mm.
    fn shortcomings(&self, axis: &Axis, entry: Point3<f64>, tip: Point3<f64>) -> f64 {
        let length = (tip - entry).norm();
        let shortfall = (self.options.length_mm - length).max(0.0);
        let nearest = self
            .facets
            .iter()
            .map(|p| {
                let along = (p - entry).dot(&axis.direction).clamp(0.0, length);
                (p - (entry + axis.direction * along)).norm()
            })
            .fold(f64::INFINITY, f64::min);
        let too_near = (FACET_DISTANCE_MM - nearest).max(0.0);
        SHORTFALL_WEIGHT * shortfall + FACET_WEIGHT * too_near
    }

    /// The tip of the longest screw in stock that is no longer than the way from entry to tip.
    fn stocked_tip(
        &self,
        entry: Point3<f64>,
        tip: Point3<f64>,
    ) -> Result<Point3<f64>, &'static str> {
        let lengths = &self.options.lengths_mm;
        if lengths.is_empty() {
            return Ok(tip);
        }
        let way = tip - entry;
        let longest = lengths
            .iter()
            .copied()
            .filter(|length| *length <= way.norm() + LENGTH_TOLERANCE_MM)
            .max_by(f64::total_cmp)
            .ok_or("length of the catalogue that is short enough")?;
        Ok(entry + way.normalize() * longest)
    }

    fn score(&self, axis: &Axis, sharpness: Sharpness) -> f64 {
        let Ok((entry, tip)) = self.ends(axis) else {
            return f64::NEG_INFINITY;
        };
        let back = (entry - axis.at_isthmus).norm();
        let ahead = (tip - axis.at_isthmus).norm();
        let judged_behind = self.pedicle.behind_mm + CheckOptions::default().behind_pedicle_mm;
        let start = (ENTRY_MM - back).min(-judged_behind);
        let n = ((ahead - start) / sharpness.spacing_mm).max(1.0) as usize;
        let mut sum = 0.0;
        for k in 0..=n {
            let s = start + k as f64 * sharpness.spacing_mm;
            let depth = depth_mm(self.index, &(axis.at_isthmus + axis.direction * s));
            let depth = depth.min(self.enough_mm());
            let bonus = if s < -judged_behind {
                ENTRY_BONUS_MM
            } else {
                0.0
            };
            sum += (-sharpness.per_mm * (depth + bonus)).exp();
        }
        -sum.ln() / sharpness.per_mm
            - self.unlikeliness_mm(axis)
            - self.shortcomings(axis, entry, tip)
    }

    /// Depth beyond which more is no better: the thickest screw with twice its clearance.
    fn enough_mm(&self) -> f64 {
        let thickest = self
            .options
            .diameters_mm
            .iter()
            .copied()
            .fold(0.0, f64::max);
        0.5 * thickest + 2.0 * self.options.min_clearance_mm
    }

    /// Entry on the surface behind and tip in the body, or what is missing.
    fn ends(&self, axis: &Axis) -> Result<(Point3<f64>, Point3<f64>), &'static str> {
        let (at, d) = (axis.at_isthmus, axis.direction);
        let back = self
            .index
            .cast_ray(&at, &-d, MAX_WAY_BACK_MM)
            .filter(|hit| hit.distance_mm > self.pedicle.behind_mm + ENTRY_MM)
            .ok_or("entry behind it")?;
        let wall = self
            .index
            .cast_ray(&at, &d, 2.0 * self.options.length_mm)
            .ok_or("wall in front of it")?;
        let least = self.pedicle.ahead_mm;
        let most = wall.distance_mm - self.options.tip_margin_mm;
        let mut ahead = most.min(self.options.length_mm - back.distance_mm);
        // The wall straight ahead is not always the nearest.
        while ahead > least && depth_mm(self.index, &(at + d * ahead)) < self.options.tip_margin_mm
        {
            ahead -= TIP_STEP_MM;
        }
        if ahead <= least {
            return Err("room for a tip in the body");
        }
        Ok((back.point, at + d * ahead))
    }
}

/// First and last step of the search for the largest least depth.
const LAST_STEPS: (f64, f64) = (0.4, 0.01);
/// Spacing of the points whose least depth counts, mm.
const DEPTH_SPACING_MM: f64 = 0.5;
/// How much of the preferences of the first searches the last one keeps.
const LAST_PREFERENCE: f64 = 0.05;
/// An axis keeps this far from the upper articular surface, mm: the radius of a 6 mm screw and what
/// counts as in the facet.
const FACET_DISTANCE_MM: f64 = 4.5;
/// The last search keeps this much more than what counts as in the facet, mm.
const FACET_SPARE_MM: f64 = 0.02;
/// Clearance that a millimetre nearer to the facet joint than that would have to gain.
const FACET_FIRMNESS: f64 = 20.0;
/// Half the width of the grid on which the last search looks for starts beside the line found, about
/// the axis of the pedicle: offsets mm, slopes in units.
const GRID_REACH: Place = [2.4, 3.6, 3.0, 3.0];
/// Points of the grid along each of the four.
const GRID_STEPS: usize = 5;
/// How many of them become starts.
const GRID_STARTS: usize = 4;
/// Spacing of its stations, mm.
const REFINE_STATIONS_MM: f64 = 1.0;
/// First and last step of the last search.
const REFINE_STEPS: (f64, f64) = (0.8, 0.02);
/// Clearance worth giving up for a millimetre away from the facet joint.
const FACET_WEIGHT: f64 = 1.0;
/// A screw may be longer than the way to its tip by this, mm: rounding.
const LENGTH_TOLERANCE_MM: f64 = 1e-6;
/// Clearance worth giving up for a millimetre of length.
const SHORTFALL_WEIGHT: f64 = 0.05;
/// Step by which the tip is drawn back, mm.
const TIP_STEP_MM: f64 = 0.5;

//! Where a pedicle is and how wide, measured on the surface of a vertebra.
//!
//! The axis is the straight line that runs deepest inside the bone from behind the canal into
//! the body: it maximises the soft minimum
//!
//! ```text
//! f = -(1/k) log mean_i exp(-k d(x_i))
//! ```
//!
//! of the depth d below the surface at points x_i along it. Sections perpendicular to the axis
//! are then closed contours; the one with the smallest area is the isthmus. Lengths in mm, k in 1/mm.

use std::cell::Cell;

use nalgebra::{Point2, Point3, Vector2, Vector3};
use pedicle_mesh::{SurfaceIndex, TriMesh};

use crate::body::Body;
use crate::depth::{depth_mm, depth_near_mm};
use crate::isthmus::{Isthmus, Section, refined_isthmus};
use crate::search::climb;
use crate::section::{Contour, Plane, Slicer, contour_around, section};
use crate::{AnatomicalFrame, AnatomyError, Side};

/// How a pedicle is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct PedicleOptions {
    /// Spacing of the sections along the axis, mm. Default 0.5, least 0.05.
    pub section_spacing_mm: f64,
    /// How far behind the posterior wall of the body sections are taken, mm. Default 12.
    pub behind_wall_mm: f64,
    /// How far inside the body sections are taken, mm. Default 8.
    pub inside_body_mm: f64,
    /// The pedicle reaches as far as its sections have at most this times the area of the
    /// isthmus. Default 1.6.
    pub max_area_ratio: f64,
}

impl Default for PedicleOptions {
    fn default() -> Self {
        Self {
            section_spacing_mm: 0.5,
            behind_wall_mm: 12.0,
            inside_body_mm: 8.0,
            max_area_ratio: 1.6,
        }
    }
}

/// One pedicle of a vertebra.
///
/// All extents are those of the isthmus, the smallest section perpendicular to the axis: the
/// pedicle may run into the body, the lamina or the transverse process elsewhere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pedicle {
    /// Side of the pedicle.
    pub side: Side,
    /// Centroid of the isthmus, mm.
    pub isthmus_center_mm: Point3<f64>,
    /// Unit vector along the pedicle, from behind into the body.
    pub axis: Vector3<f64>,
    /// Unit vector along the width, towards the patient's left.
    pub width_direction: Vector3<f64>,
    /// Width of the isthmus, mm: the medio-lateral chord through its centroid; in an isthmus that
    /// leans, the shortest chord within 45 degrees of medio-lateral.
    pub width_mm: f64,
    /// The shortest chord through its centroid in any direction, mm: what a screw has to fit. Less
    /// than the width where the isthmus leans or is lower than wide.
    pub narrowest_mm: f64,
    /// Height of the isthmus, mm: the extent at right angles to the width.
    pub height_mm: f64,
    /// Area of the isthmus, mm².
    pub area_mm2: f64,
    /// Distance from the isthmus back to where the pedicle begins, mm.
    pub behind_mm: f64,
    /// Distance from the isthmus forward to where the pedicle joins the body, mm.
    pub ahead_mm: f64,
}

/// Finds and measures the pedicle of one side.
///
/// # Errors
/// [`AnatomyError`] if the mirror plane shows no vertebral body, or no closed section of bone
/// beside the canal leads into it.
pub fn measure_pedicle(
    mesh: &TriMesh,
    index: &SurfaceIndex,
    frame: &AnatomicalFrame,
    side: Side,
    options: &PedicleOptions,
) -> Result<Pedicle, AnatomyError> {
    Ok(pedicle_with_isthmus(mesh, index, frame, side, options)?.0)
}

/// The pedicle and, where there is a closed section around it, the refined isthmus.
pub(crate) fn pedicle_with_isthmus(
    mesh: &TriMesh,
    index: &SurfaceIndex,
    frame: &AnatomicalFrame,
    side: Side,
    options: &PedicleOptions,
) -> Result<(Pedicle, Option<Isthmus>), AnatomyError> {
    let body = Body::find(mesh, frame)?;
    let seed = seed_point(mesh, frame, &body, side)?;
    let line = deepest_line(index, frame, &body, seed);
    if !line.bridges(index) {
        return Err(AnatomyError::NoPedicle {
            side,
            reason: "no line runs inside the bone from behind the canal into the body",
        });
    }
    let profile = Profile::along(mesh, frame, &line, options);
    let first = profile.pedicle(side, options)?;
    let found = refined_isthmus(mesh, first.isthmus_center_mm, first.axis, frame.left);
    let pedicle = found
        .as_ref()
        .map_or(first, |isthmus| measured(&isthmus.section, &first));
    Ok((pedicle, found))
}

/// Distances behind the posterior wall at which the first section of the pedicle is sought, mm.
const SEED_BEHIND_WALL_MM: [f64; 6] = [4.0, 3.0, 5.0, 2.0, 6.0, 1.0];
/// Spacing of the points tried within a section, mm.
const SEED_SPACING_MM: f64 = 1.0;
/// Least depth of a point that can be the middle of a pedicle, mm.
const SEED_MIN_DEPTH_MM: f64 = 1.5;
/// How far from the mirror plane pedicles are sought, mm.
const SEED_LATERAL_MM: (f64, f64) = (3.0, 36.0);
/// How far across the mirror plane a contour of one side may reach, mm.
const SEED_ACROSS_MM: f64 = 2.0;

/// The deepest point of a coronal section beside the canal: coordinates left, anterior, up.
fn seed_point(
    mesh: &TriMesh,
    frame: &AnatomicalFrame,
    body: &Body,
    side: Side,
) -> Result<Vector3<f64>, AnatomyError> {
    let middle = 0.5 * (body.low_mm + body.high_mm);
    for behind in SEED_BEHIND_WALL_MM {
        let anterior = body.posterior_wall_mm - behind;
        let plane = Plane {
            origin: frame.point(0.0, anterior, 0.0),
            x: frame.left,
            y: frame.up,
        };
        let contours: Vec<Contour> = section(mesh, &plane)
            .into_iter()
            .filter(|c| {
                let (low, high) = c.bounds();
                let innermost = if side == Side::Left { low.x } else { -high.x };
                innermost > -SEED_ACROSS_MM
            })
            .collect();
        let mut best: Option<(f64, Point2<f64>)> = None;
        for p in grid(side, body.low_mm, body.high_mm) {
            let Some(contour) = contour_around(&contours, &p) else {
                continue;
            };
            // Pedicles spring from the upper half of the body, close to the canal.
            let low = (middle - p.y).max(0.0);
            let score = contour.distance(&p) - 0.3 * low - 0.1 * p.x.abs();
            if contour.distance(&p) >= SEED_MIN_DEPTH_MM && best.is_none_or(|(s, _)| score > s) {
                best = Some((score, p));
            }
        }
        if let Some((_, p)) = best {
            return Ok(Vector3::new(p.x, anterior, p.y));
        }
    }
    Err(AnatomyError::NoPedicle {
        side,
        reason: "no closed section of bone lies beside the canal",
    })
}

/// Points on one side between two heights.
fn grid(side: Side, low: f64, high: f64) -> impl Iterator<Item = Point2<f64>> {
    let (inner, outer) = SEED_LATERAL_MM;
    let across = ((outer - inner) / SEED_SPACING_MM) as usize;
    let upward = ((high - low) / SEED_SPACING_MM).max(0.0) as usize;
    (0..=across).flat_map(move |i| {
        (0..=upward).map(move |j| {
            let x = inner + i as f64 * SEED_SPACING_MM;
            Point2::new(side.sign() * x, low + j as f64 * SEED_SPACING_MM)
        })
    })
}

/// A line through two points given by left and up at two fixed anterior coordinates.
#[derive(Debug, Clone, Copy)]
struct Line {
    back: Point3<f64>,
    front: Point3<f64>,
}

impl Line {
    fn axis(&self) -> Vector3<f64> {
        (self.front - self.back).normalize()
    }

    /// Whether bone leads all along it from behind the canal to the body.
    fn bridges(&self, index: &SurfaceIndex) -> bool {
        (0..=BRIDGE_POINTS).all(|k| {
            let share = k as f64 / BRIDGE_POINTS as f64;
            let t = BRIDGE_FROM + share * (WALL_ON_LINE - BRIDGE_FROM);
            depth_mm(index, &(self.back + (self.front - self.back) * t)) > BRIDGE_DEPTH_MM
        })
    }
}

/// The line is laid between these distances behind the posterior wall and inside the body, mm.
const LINE_BEHIND_MM: f64 = 8.0;
const LINE_INSIDE_MM: f64 = 7.0;
/// Where along the line the posterior wall is.
const WALL_ON_LINE: f64 = LINE_BEHIND_MM / (LINE_BEHIND_MM + LINE_INSIDE_MM);
/// Where along the line bone has to begin: 6 mm behind the posterior wall.
const BRIDGE_FROM: f64 = 2.0 / (LINE_BEHIND_MM + LINE_INSIDE_MM);
/// Points at which there has to be bone.
const BRIDGE_POINTS: usize = 24;
/// Depth that a point in a bridge has, mm.
const BRIDGE_DEPTH_MM: f64 = 0.5;
/// First and last step of the search for the middle of the isthmus, mm.
const CENTER_STEPS_MM: (f64, f64) = (0.5, 0.01);
/// Depth that a line may gain by leaving the plane of the end plates: the square of its slope
/// times this, mm. Pedicles are higher than wide, so depth alone leaves the slope open.
const SLOPE_PENALTY_MM: f64 = 6.0;
/// Points along the line at which the depth counts.
const LINE_POINTS: usize = 16;
/// Sharpness k of the soft minimum, 1/mm.
const SOFTNESS_PER_MM: f64 = 1.0;
/// Medial slopes from which the search starts.
const START_SLOPES: [f64; 3] = [0.1, 0.3, 0.5];
/// Rounding of a sum that cuts a score short.
const HOPELESS_MARGIN: f64 = 1e-9;
/// First and last step of the search, mm.
const SEARCH_STEPS_MM: (f64, f64) = (3.0, 0.05);

fn deepest_line(
    index: &SurfaceIndex,
    frame: &AnatomicalFrame,
    body: &Body,
    seed: Vector3<f64>,
) -> Line {
    let back = body.posterior_wall_mm - LINE_BEHIND_MM;
    let front = body.posterior_wall_mm + LINE_INSIDE_MM;
    let line_of = |v: &[f64; 4]| Line {
        back: frame.point(v[0], back, v[1]),
        front: frame.point(v[2], front, v[3]),
    };
    let walls = Cell::new([None; LINE_POINTS]);
    let best_so_far = Cell::new(f64::NEG_INFINITY);
    let score = |v: &[f64; 4]| {
        let line = line_of(v);
        let slope = (v[3] - v[1]) / (front - back);
        let penalty = SLOPE_PENALTY_MM * slope * slope;
        // Terms only add up: from this sum on, the line cannot be better than the best so far.
        let hopeless = LINE_POINTS as f64
            * (-SOFTNESS_PER_MM * (best_so_far.get() + penalty)).exp()
            * (1.0 + HOPELESS_MARGIN);
        // Lines of a search lie close to each other, and so do the walls next to them.
        let mut near = walls.get();
        let mut sum = 0.0;
        for (i, wall) in near.iter_mut().enumerate() {
            let t = i as f64 / (LINE_POINTS - 1) as f64;
            let depth = depth_near_mm(index, &(line.back + (line.front - line.back) * t), wall);
            sum += (-SOFTNESS_PER_MM * depth).exp();
            if sum > hopeless {
                return f64::NEG_INFINITY;
            }
        }
        walls.set(near);
        let value = -(sum / LINE_POINTS as f64).ln() / SOFTNESS_PER_MM - penalty;
        best_so_far.set(value.max(best_so_far.get()));
        value
    };
    let mut best: Option<(f64, [f64; 4])> = None;
    for slope in START_SLOPES {
        let medial = -seed.x.signum() * slope;
        let start = [
            seed.x + medial * (back - seed.y),
            seed.z,
            seed.x + medial * (front - seed.y),
            seed.z,
        ];
        best_so_far.set(f64::NEG_INFINITY);
        let (value, v) = climb(start, SEARCH_STEPS_MM, score);
        if best.is_none_or(|(b, _)| value > b) {
            best = Some((value, v));
        }
    }
    // There is always a start.
    line_of(&best.map_or([0.0; 4], |(_, v)| v))
}

/// Least spacing of the sections, mm.
const MIN_SPACING_MM: f64 = 0.05;
/// Most sections along one pedicle.
const MAX_SLICES: usize = 1000;
/// How far from the posterior wall the isthmus may be, along the axis, mm.
const ISTHMUS_REACH_MM: f64 = 9.0;

/// Anything narrower is a bridge between facets or a flaw of the segmentation, mm.
const MIN_WIDTH_MM: f64 = 2.0;

/// One section perpendicular to the axis; the axis meets it at the origin of its plane.
#[derive(Debug)]
struct Slice {
    /// Distance along the axis from the posterior wall of the body, mm.
    at_mm: f64,
    plane: Plane,
    contour: Contour,
    area: f64,
}

impl Slice {
    /// The deepest point of the section near the axis.
    fn center(&self) -> Point2<f64> {
        let depth = |p: &[f64; 2]| {
            let p = Point2::from(*p);
            if self.contour.contains(&p) {
                self.contour.distance(&p)
            } else {
                -self.contour.distance(&p)
            }
        };
        Point2::from(climb([0.0; 2], CENTER_STEPS_MM, depth).1)
    }
}

struct Profile {
    slices: Vec<Slice>,
}

impl Profile {
    fn along(
        mesh: &TriMesh,
        frame: &AnatomicalFrame,
        line: &Line,
        options: &PedicleOptions,
    ) -> Self {
        let axis = line.axis();
        let wall = line.back + (line.front - line.back) * WALL_ON_LINE;
        let length = options.behind_wall_mm + options.inside_body_mm;
        let spacing = options.section_spacing_mm.max(MIN_SPACING_MM);
        let n = ((length / spacing) as usize).min(MAX_SLICES);
        let reach = (-options.behind_wall_mm, options.inside_body_mm);
        let slicer = Slicer::new(mesh, wall, axis, reach);
        let mut slices = Vec::new();
        for k in 0..=n {
            let at_mm = k as f64 * spacing - options.behind_wall_mm;
            let Some(plane) = Plane::new(wall + axis * at_mm, axis, frame.left) else {
                continue;
            };
            let contours = slicer.section(&plane);
            let Some(contour) = contour_around(&contours, &Point2::origin()) else {
                continue;
            };
            let contour = contour.clone();
            let area = contour.area();
            slices.push(Slice {
                at_mm,
                plane,
                contour,
                area,
            });
        }
        Self { slices }
    }

    /// The isthmus is the smallest slice; the pedicle reaches from it to where the slices get
    /// too large on either side.
    fn pedicle(&self, side: Side, options: &PedicleOptions) -> Result<Pedicle, AnatomyError> {
        let smallest = (0..self.slices.len())
            .filter(|&i| self.slices[i].at_mm.abs() <= ISTHMUS_REACH_MM)
            .min_by(|&i, &j| self.slices[i].area.total_cmp(&self.slices[j].area));
        let Some(isthmus) = smallest else {
            return Err(AnatomyError::NoPedicle {
                side,
                reason: "no closed section of bone leads into the body",
            });
        };
        let limit = options.max_area_ratio * self.slices[isthmus].area;
        let near = |i: &usize| self.slices[*i].area <= limit;
        let first = (0..isthmus)
            .rev()
            .take_while(near)
            .last()
            .unwrap_or(isthmus);
        let last = (isthmus + 1..self.slices.len())
            .take_while(near)
            .last()
            .unwrap_or(isthmus);
        let slice = &self.slices[isthmus];
        let center = slice.center();
        let (narrowest_mm, across) =
            narrowest_chord(&slice.contour, &center, std::f64::consts::FRAC_PI_2);
        if narrowest_mm < MIN_WIDTH_MM {
            return Err(AnatomyError::NoPedicle {
                side,
                reason: "the narrowest section is thinner than 2 mm",
            });
        }
        let height_mm = slice
            .contour
            .chord(&center, &Vector2::new(-across.y, across.x));
        let axis = slice.plane.normal();
        let width_direction = slice.plane.x * across.x + slice.plane.y * across.y;
        Ok(Pedicle {
            side,
            isthmus_center_mm: slice.plane.to_space(&center),
            axis,
            width_direction,
            width_mm: narrowest_mm,
            narrowest_mm,
            height_mm,
            area_mm2: slice.area,
            behind_mm: slice.at_mm - self.slices[first].at_mm,
            ahead_mm: self.slices[last].at_mm - slice.at_mm,
        })
    }
}

/// The extents of a section, with everything else of `first`.
fn measured(section: &Section, first: &Pedicle) -> Pedicle {
    let Section {
        plane,
        contour,
        center,
    } = section;
    // The x axis of the plane is left, made perpendicular to the axis.
    let (lean_rad, elongation) = contour.lean();
    let across = if lean_rad > MIN_LEAN_RAD && elongation > MIN_ELONGATION {
        narrowest_chord(contour, center, std::f64::consts::FRAC_PI_2).1
    } else {
        Vector2::x()
    };
    let upward = Vector2::new(-across.y, across.x);
    let ahead = (section.center_mm() - first.isthmus_center_mm).dot(&first.axis);
    Pedicle {
        isthmus_center_mm: section.center_mm(),
        axis: plane.normal(),
        width_direction: plane.x * across.x + plane.y * across.y,
        width_mm: contour.chord(center, &across),
        narrowest_mm: narrowest_chord(contour, center, std::f64::consts::PI).0,
        height_mm: contour.extent(&upward),
        area_mm2: contour.area(),
        behind_mm: (first.behind_mm + ahead).max(0.0),
        ahead_mm: (first.ahead_mm - ahead).max(0.0),
        side: first.side,
    }
}

/// An isthmus whose long axis leans by more than this between medio-lateral and upright is measured
/// across itself, radians.
const MIN_LEAN_RAD: f64 = 0.26;
/// A rounder isthmus than this has no long axis to speak of.
const MIN_ELONGATION: f64 = 1.15;
/// Directions in which chords are measured.
const CHORD_DIRECTIONS: usize = 180;

/// Length and direction of the shortest chord through `p` whose direction lies within half of
/// `fan_rad` of the x axis.
fn narrowest_chord(contour: &Contour, p: &Point2<f64>, fan_rad: f64) -> (f64, Vector2<f64>) {
    (0..=CHORD_DIRECTIONS)
        .map(|k| {
            let angle = (k as f64 / CHORD_DIRECTIONS as f64 - 0.5) * fan_rad;
            let d = Vector2::new(angle.cos(), angle.sin());
            (contour.chord(p, &d), d)
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .unwrap_or((0.0, Vector2::x()))
}

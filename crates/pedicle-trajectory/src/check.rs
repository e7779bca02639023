//! Whether a screw stays inside the bone.
//!
//! ```text
//! clearance(s) = ρ(s) - r inside the bone,   -ρ(s) - r outside,   breach = max(0, -min clearance)
//! ```
//!
//! s distance along the screw's axis from the entry, ρ distance from the axis to the cortical
//! surface at right angles to the axis, r radius of the screw, all in mm. The breach is how far
//! the screw's wall reaches beyond the cortex, as Gertzbein & Robbins (Spine 1990) measure it. Where
//! the screw leaves through the front, it is how far the axis is out of the bone.
//!
//! What counts is the pedicle and the body in front of it. Behind the pedicle the back part of
//! the screw lies in a groove between facet, lamina and transverse process, where a cylinder
//! that is perfectly placed still shows on one side: that stretch is in the profile, not in the
//! verdict.

use nalgebra::{Point3, Vector3};
use pedicle_mesh::SurfaceIndex;

use crate::depth::depth_mm;
use crate::{AnatomicalFrame, Pedicle, Trajectory, TrajectoryDefect};

/// What a check asks for.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckOptions {
    /// Bone at the entry that never counts, mm. Default 3: the screw has to cross the entry
    /// cortex, so its wall shows there in every plan.
    pub ignored_entry_depth_mm: f64,
    /// How far behind the measured beginning of the pedicle the check starts, mm. Default 2.
    pub behind_pedicle_mm: f64,
    /// Distance between the stations of the profile, mm. Default 0.5, least 0.05.
    pub station_spacing_mm: f64,
    /// Least clearance of a valid screw, mm. Default 0: the wall may touch the cortex.
    pub min_clearance_mm: f64,
}

impl Default for CheckOptions {
    fn default() -> Self {
        Self {
            ignored_entry_depth_mm: 3.0,
            behind_pedicle_mm: 2.0,
            station_spacing_mm: 0.5,
            min_clearance_mm: 0.0,
        }
    }
}

/// Where a screw leaves the bone, from the patient.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum BreachDirection {
    /// Towards the spinal canal.
    Medial,
    /// Away from the canal.
    Lateral,
    /// Towards the head.
    Cranial,
    /// Towards the feet: the nerve root.
    Caudal,
    /// Through the front of the body: the great vessels.
    Anterior,
}

impl std::fmt::Display for BreachDirection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::Medial => "medial",
            Self::Lateral => "lateral",
            Self::Cranial => "cranial",
            Self::Caudal => "caudal",
            Self::Anterior => "anterior",
        })
    }
}

/// The part of the bone a station of the screw is in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Zone {
    /// Behind the pedicle or in the ignored bone at the entry; not part of the verdict.
    Entry,
    /// In the pedicle.
    Pedicle,
    /// In front of the pedicle.
    Body,
}

/// Clearance at one place along the screw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClearanceSample {
    /// Distance from the planned entry along the axis, mm.
    pub depth_mm: f64,
    /// From the screw's wall to the cortex, mm; negative where the wall is outside.
    pub clearance_mm: f64,
    /// Where this is.
    pub zone: Zone,
    /// Where the nearest cortex is, or where to the wall has left.
    pub direction: BreachDirection,
}

/// What a check found.
#[derive(Debug, Clone, PartialEq)]
pub struct TrajectoryCheck {
    /// Whether the screw runs through the pedicle and no part of its wall comes nearer to the
    /// cortex than asked for.
    pub valid: bool,
    /// Whether the axis crosses the isthmus inside the pedicle.
    pub through_pedicle: bool,
    /// Least clearance in the pedicle, mm.
    pub pedicle_clearance_mm: f64,
    /// Least clearance in front of the pedicle, mm; infinite if the screw ends before.
    pub body_clearance_mm: f64,
    /// How far the wall reaches beyond the cortex at the worst place, mm; 0 without a breach.
    pub breach_mm: f64,
    /// Where to, if there is a breach.
    pub breach_direction: Option<BreachDirection>,
    /// Distance from the planned entry to the isthmus along the axis, mm; `None` if the screw
    /// does not reach it.
    pub isthmus_depth_mm: Option<f64>,
    /// Distance from the planned entry to the bone along the axis, mm (negative if the entry is
    /// inside); `None` if the axis never meets bone.
    pub bone_depth_mm: Option<f64>,
    /// Clearance along the screw, entry to tip.
    pub profile: Vec<ClearanceSample>,
}

impl TrajectoryCheck {
    /// Least clearance in the pedicle and in front of it, mm.
    #[must_use]
    pub fn min_clearance_mm(&self) -> f64 {
        self.pedicle_clearance_mm.min(self.body_clearance_mm)
    }
}

/// Distance beyond which a wall does not matter, mm.
const REACH_MM: f64 = 15.0;
/// Directions of the rays that measure beside the ends of the checked stretch.
const RAY_DIRECTIONS: usize = 24;
/// How often the angle between them is halved around the nearest wall: from 15 to 1 degree.
const RAY_ROUNDS: usize = 4;
/// Within 5 degrees of the diagonal a breach is called by its side: the canal matters most.
const DIAGONAL: f64 = 0.84;
/// A face turned at most 45 degrees from the screw's direction is one that it leaves through forwards.
const FORWARD_COSINE: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// The least clearance is found to this, mm.
const EXACT_MM: f64 = 0.005;
/// Stations are not put closer than this, mm.
const MIN_WAY_MM: f64 = 0.01;
/// Most stations added in one zone.
const MAX_ADDED: usize = 400;
/// Cosine of the angle to the pedicle's axis beyond which a screw cannot be meant to follow it.
const MIN_ALIGNMENT: f64 = 0.3;
/// Least station spacing accepted, mm.
const MIN_SPACING_MM: f64 = 0.05;
/// Most stations: a screw far longer than any bone is sampled more coarsely.
const MAX_STATIONS: usize = 2000;

/// Checks one trajectory against the true surface of its vertebra.
///
/// The pedicle and the frame come from the same surface, so the verdict does not depend on the
/// trajectory being near where it should be: one that misses the pedicle is invalid.
///
/// # Errors
/// [`TrajectoryDefect`] if the trajectory's numbers describe no screw.
pub fn check_trajectory(
    trajectory: &Trajectory,
    index: &SurfaceIndex,
    pedicle: &Pedicle,
    frame: &AnatomicalFrame,
    options: &CheckOptions,
) -> Result<TrajectoryCheck, TrajectoryDefect> {
    trajectory.validate()?;
    let screw = Screw {
        trajectory,
        axis: trajectory.direction(),
        index,
        pedicle,
        frame,
    };
    Ok(screw.check(options))
}

struct Screw<'a> {
    trajectory: &'a Trajectory,
    axis: Vector3<f64>,
    index: &'a SurfaceIndex,
    pedicle: &'a Pedicle,
    frame: &'a AnatomicalFrame,
}

/// The stretch of the axis that is judged, from the entry, mm.
#[derive(Debug, Clone, Copy)]
struct Stretch {
    start: f64,
    /// Where the pedicle ends and the body begins.
    body: f64,
    end: f64,
}

/// Clearance at a station and the way to where it is least.
struct Wall {
    clearance_mm: f64,
    direction: BreachDirection,
}

impl Screw<'_> {
    fn at(&self, depth_mm: f64) -> Point3<f64> {
        self.trajectory.entry_mm + self.axis * depth_mm
    }

    fn radius_mm(&self) -> f64 {
        0.5 * self.trajectory.diameter_mm
    }

    fn check(&self, options: &CheckOptions) -> TrajectoryCheck {
        let length = self.trajectory.length_mm();
        let bone = self.bone_depth_mm();
        let isthmus = self.isthmus_depth_mm();
        let stretch = isthmus.map(|isthmus| self.stretch(isthmus, bone, options));
        let spacing = options.station_spacing_mm.max(MIN_SPACING_MM);
        let n = ((length / spacing).ceil() as usize).clamp(1, MAX_STATIONS);
        let mut depths: Vec<f64> = (0..=n).map(|k| length * k as f64 / n as f64).collect();
        // The places where zones change are stations too.
        depths.extend(stretch.iter().flat_map(|s| [s.start, s.body]));
        depths.sort_by(f64::total_cmp);
        depths.dedup();
        let mut profile: Vec<ClearanceSample> = depths
            .into_iter()
            .map(|depth| self.sample(depth, stretch))
            .collect();
        self.find_least(&mut profile, stretch);
        let (mut pedicle, mut body) = (f64::INFINITY, f64::INFINITY);
        let mut worst: Option<Wall> = None;
        for sample in &profile {
            match sample.zone {
                Zone::Entry => continue,
                Zone::Pedicle => pedicle = pedicle.min(sample.clearance_mm),
                Zone::Body => body = body.min(sample.clearance_mm),
            }
            if worst
                .as_ref()
                .is_none_or(|w| sample.clearance_mm < w.clearance_mm)
            {
                worst = Some(Wall {
                    clearance_mm: sample.clearance_mm,
                    direction: sample.direction,
                });
            }
        }
        let miss = self.miss(isthmus);
        if let Some(miss) = miss {
            pedicle = pedicle.min(miss.clearance_mm);
            // Once the pedicle is missed, where the screw lies matters, not what it touches.
            worst = Some(Wall {
                clearance_mm: pedicle.min(body),
                ..miss
            });
        }
        let through_pedicle = isthmus.is_some() && self.miss(isthmus).is_none();
        let least = pedicle.min(body);
        let breach_mm = (-least).max(0.0);
        TrajectoryCheck {
            valid: through_pedicle && pedicle.is_finite() && least >= options.min_clearance_mm,
            through_pedicle,
            pedicle_clearance_mm: pedicle,
            body_clearance_mm: body,
            breach_mm,
            breach_direction: worst.filter(|_| breach_mm > 0.0).map(|w| w.direction),
            isthmus_depth_mm: isthmus,
            bone_depth_mm: bone,
            profile,
        }
    }

    fn sample(&self, depth_mm: f64, stretch: Option<Stretch>) -> ClearanceSample {
        let zone = stretch.map_or(Zone::Entry, |s| s.zone(depth_mm));
        let wall = self.wall(depth_mm, zone, stretch);
        ClearanceSample {
            depth_mm,
            clearance_mm: wall.clearance_mm,
            zone,
            direction: wall.direction,
        }
    }

    /// Adds stations to the judged part of a profile until its least clearance is exact.
    ///
    /// Inside, a surface point beside the axis between stations a and b, at least m from both, is
    /// at least √(m² - (b - a)² / 4) from the axis. Outside, a distance changes by no more than the
    /// way along the axis, so no clearance is less than (c_a + c_b - (b - a)) / 2 (Piyavskii 1972).
    /// Intervals that cannot hold a new least one are left alone.
    fn find_least(&self, profile: &mut Vec<ClearanceSample>, stretch: Option<Stretch>) {
        for zone in [Zone::Pedicle, Zone::Body] {
            let of_zone: Vec<ClearanceSample> =
                profile.iter().filter(|s| s.zone == zone).copied().collect();
            let mut least = of_zone
                .iter()
                .map(|s| s.clearance_mm)
                .fold(f64::INFINITY, f64::min);
            let mut open: Vec<(ClearanceSample, ClearanceSample)> =
                of_zone.windows(2).map(|w| (w[0], w[1])).collect();
            let mut n_added = 0;
            while let Some((a, b)) = open.pop() {
                let way = b.depth_mm - a.depth_mm;
                let nearest = a.clearance_mm.min(b.clearance_mm) + self.radius_mm();
                let bound = if nearest > 0.0 {
                    (nearest * nearest - 0.25 * way * way).max(0.0).sqrt() - self.radius_mm()
                } else {
                    0.5 * (a.clearance_mm + b.clearance_mm - way)
                };
                let done = way < MIN_WAY_MM || n_added >= MAX_ADDED;
                if done || bound > least - EXACT_MM {
                    continue;
                }
                let middle = self.sample(0.5 * (a.depth_mm + b.depth_mm), stretch);
                least = least.min(middle.clearance_mm);
                profile.push(middle);
                n_added += 1;
                open.extend([(a, middle), (middle, b)]);
            }
        }
        profile.sort_by(|a, b| a.depth_mm.total_cmp(&b.depth_mm));
    }

    /// Where the axis enters the bone.
    fn bone_depth_mm(&self) -> Option<f64> {
        let entry = self.trajectory.entry_mm;
        let length = self.trajectory.length_mm();
        if self.index.contains(&entry) {
            let back = self.index.cast_ray(&entry, &-self.axis, length);
            return Some(back.map_or(-length, |hit| -hit.distance_mm));
        }
        let ahead = self.index.cast_ray(&entry, &self.axis, length)?;
        Some(ahead.distance_mm)
    }

    /// Where the axis crosses the plane of the isthmus, if it does so forwards and on the screw.
    fn isthmus_depth_mm(&self) -> Option<f64> {
        let alignment = self.axis.dot(&self.pedicle.axis);
        if alignment < MIN_ALIGNMENT {
            return None;
        }
        let ahead = self.pedicle.isthmus_center_mm - self.trajectory.entry_mm;
        let depth = ahead.dot(&self.pedicle.axis) / alignment;
        (0.0..=self.trajectory.length_mm())
            .contains(&depth)
            .then_some(depth)
    }

    fn stretch(&self, isthmus: f64, bone: Option<f64>, options: &CheckOptions) -> Stretch {
        let end = self.trajectory.length_mm();
        let per_axis = 1.0 / self.axis.dot(&self.pedicle.axis);
        let behind = (self.pedicle.behind_mm + options.behind_pedicle_mm) * per_axis;
        let start = bone.map_or(0.0, |bone| bone + options.ignored_entry_depth_mm);
        Stretch {
            // The isthmus itself always counts, wherever the bone seems to begin.
            start: start.max(isthmus - behind).clamp(0.0, isthmus),
            body: (isthmus + self.pedicle.ahead_mm * per_axis).min(end),
            end,
        }
    }

    /// Clearance at one station.
    fn wall(&self, depth: f64, zone: Zone, stretch: Option<Stretch>) -> Wall {
        let x = self.at(depth);
        let closest = self.index.closest_point(&x);
        let inside = depth_mm(self.index, &x) > 0.0;
        let to = closest.point - x;
        let along = to.dot(&self.axis);
        let judged = stretch.filter(|s| depth >= s.start);
        let beside = judged.is_none_or(|s| (s.start..=s.end).contains(&(depth + along)));
        let across = to - self.axis * along;
        let lateral = across.norm() >= along.abs();
        let faces_forwards = closest.normal.dot(&self.axis) > FORWARD_COSINE;
        if !inside && beside && faces_forwards && along <= 0.0 {
            // In front of the bone: how far out is the way back, not the way aside.
            return Wall {
                clearance_mm: -closest.distance_mm,
                direction: self.direction_in_body(&x, &closest.normal),
            };
        }
        // A surface that lies before the beginning or beyond the tip is not beside the screw, one
        // ahead is none at right angles, and from outside the closest point of an oblique wall is
        // not the one at right angles either.
        // Behind the judged stretch the closest point is good enough.
        let judged_by_rays = zone != Zone::Entry && !(inside && lateral);
        let (distance, outward, normal) = if beside && !judged_by_rays {
            (across.norm(), across, closest.normal)
        } else {
            self.nearest_by_rays(&x)
        };
        let sign = if inside { 1.0 } else { -1.0 };
        let direction = match zone {
            // From outside, the nearest face is the one the screw has left through.
            Zone::Body if !inside => self.direction_in_body(&x, &closest.normal),
            Zone::Body => self.direction_in_body(&x, &normal),
            _ if inside => self.direction_across(&outward),
            // The nearest bone is on the other side.
            _ => self.direction_across(&-outward),
        };
        Wall {
            clearance_mm: sign * distance.min(REACH_MM) - self.radius_mm(),
            direction,
        }
    }

    /// Distance, way and normal of the nearest wall at right angles to the axis.
    fn nearest_by_rays(&self, x: &Point3<f64>) -> (f64, Vector3<f64>, Vector3<f64>) {
        let (u, v) = perpendicular_pair(&self.axis);
        let mut nearest = (REACH_MM, u, u);
        let mut best_angle = 0.0;
        let mut cast = |angle: f64| {
            let d = u * angle.cos() + v * angle.sin();
            // Nothing further than the nearest so far matters.
            if let Some(hit) = self.index.cast_ray(x, &d, nearest.0)
                && hit.distance_mm < nearest.0
            {
                nearest = (hit.distance_mm, d, hit.normal);
                best_angle = angle;
            }
            best_angle
        };
        let mut step = std::f64::consts::TAU / RAY_DIRECTIONS as f64;
        for k in 0..RAY_DIRECTIONS {
            cast(k as f64 * step);
        }
        // Then between the nearest one and its neighbours.
        for _ in 0..RAY_ROUNDS {
            step *= 0.5;
            let middle = cast(f64::NAN);
            cast(middle - step);
            cast(middle + step);
        }
        nearest
    }

    /// The way from the pedicle's axis to a point, across that axis.
    fn offset_from_pedicle(&self, x: &Point3<f64>) -> Vector3<f64> {
        let d = x - self.pedicle.isthmus_center_mm;
        d - self.pedicle.axis * self.pedicle.axis.dot(&d)
    }

    /// The same in widths and heights of the pedicle: a pedicle is higher than wide, so what is off
    /// by as much to the side and upwards has left it to the side.
    fn side_of_pedicle(&self, x: &Point3<f64>) -> Vector3<f64> {
        let offset = self.offset_from_pedicle(x);
        let across = self.pedicle.width_direction;
        let upward = self.pedicle.axis.cross(&across);
        across * (offset.dot(&across) / self.pedicle.width_mm)
            + upward * (offset.dot(&upward) / self.pedicle.height_mm)
    }

    fn direction_across(&self, outward: &Vector3<f64>) -> BreachDirection {
        let across = |v: Vector3<f64>| v - self.axis * self.axis.dot(&v);
        let lateral = across(self.frame.left * self.pedicle.side.sign());
        let up = across(self.frame.up);
        let (lateral, up) = (unit_dot(outward, &lateral), unit_dot(outward, &up));
        let sideways = lateral.abs() >= DIAGONAL * up.abs();
        match (sideways, lateral > 0.0, up > 0.0) {
            (true, true, _) => BreachDirection::Lateral,
            (true, false, _) => BreachDirection::Medial,
            (false, _, true) => BreachDirection::Cranial,
            (false, _, false) => BreachDirection::Caudal,
        }
    }

    /// In the body the face of the bone that is crossed names the direction.
    fn direction_in_body(&self, x: &Point3<f64>, normal: &Vector3<f64>) -> BreachDirection {
        let lateral = normal.dot(&self.frame.left);
        let up = normal.dot(&self.frame.up);
        let anterior = normal.dot(&self.frame.anterior);
        if anterior.abs() >= lateral.abs().max(up.abs()) {
            // The posterior wall of the body bounds the canal.
            if anterior > 0.0 {
                BreachDirection::Anterior
            } else {
                BreachDirection::Medial
            }
        } else if lateral.abs() >= up.abs() {
            // A wall that faces the mirror plane faces the canal.
            if lateral * self.frame.coordinates(x).x > 0.0 {
                BreachDirection::Lateral
            } else {
                BreachDirection::Medial
            }
        } else if up > 0.0 {
            BreachDirection::Cranial
        } else {
            BreachDirection::Caudal
        }
    }

    /// How the screw misses the pedicle: no crossing of the isthmus, or one outside of it.
    fn miss(&self, isthmus: Option<f64>) -> Option<Wall> {
        let Some(depth) = isthmus else {
            let along = (self.pedicle.isthmus_center_mm - self.trajectory.entry_mm).dot(&self.axis);
            let nearest = self.at(along.clamp(0.0, self.trajectory.length_mm()));
            let offset = nearest - self.pedicle.isthmus_center_mm;
            return Some(Wall {
                clearance_mm: -offset.norm() - self.radius_mm(),
                direction: self.direction_across(&self.side_of_pedicle(&nearest)),
            });
        };
        let x = self.at(depth);
        let offset = self.offset_from_pedicle(&x);
        let across = offset.dot(&self.pedicle.width_direction).abs();
        let height_direction = self.pedicle.axis.cross(&self.pedicle.width_direction);
        let along = offset.dot(&height_direction).abs();
        // Bone further off than the pedicle is wide or high is another part of the vertebra.
        let beyond = (across - self.pedicle.width_mm).max(along - self.pedicle.height_mm);
        let outside = !self.index.contains(&x);
        if !outside && beyond <= 0.0 {
            return None;
        }
        let (clearance_mm, way_out) = if outside {
            let closest = self.index.closest_point(&x);
            let way_out = x - closest.point;
            (-closest.distance_mm - self.radius_mm(), way_out)
        } else {
            (-beyond - self.radius_mm(), self.side_of_pedicle(&x))
        };
        Some(Wall {
            clearance_mm,
            direction: self.direction_across(&way_out),
        })
    }
}

impl Stretch {
    fn zone(&self, depth: f64) -> Zone {
        if depth < self.start {
            Zone::Entry
        } else if depth <= self.body {
            Zone::Pedicle
        } else {
            Zone::Body
        }
    }
}

/// Component of `v` along the direction of `along`; 0 if that has none.
fn unit_dot(v: &Vector3<f64>, along: &Vector3<f64>) -> f64 {
    along
        .try_normalize(f64::MIN_POSITIVE)
        .map_or(0.0, |u| v.dot(&u))
}

/// Two unit vectors at right angles to a unit vector and to each other.
fn perpendicular_pair(axis: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let mut helper = Vector3::zeros();
    helper[axis.iamin()] = 1.0;
    let u = axis.cross(&helper).normalize();
    (u, axis.cross(&u))
}

//! The anatomy of a whole spine from its shape: axes, bodies, canals, pedicles, landmarks.
//!
//! ```text
//! transverse = atan2(a · medial, a · anterior),   sagittal = asin(a · up)
//! ```
//!
//! a unit axis of the pedicle, from behind to the front; the frame is that of the vertebra itself
//! ([`anatomical_frames`](crate::anatomical_frames)), so the sagittal angle is against its own end plates. What a shape does
//! not allow is an error of that part alone; what looks wrong is a [`Doubt`]. Lengths in mm.

use nalgebra::{Point3, Vector3};
use pedicle_mesh::{SurfaceIndex, TriMesh, boundary_loops};
use rayon::prelude::*;

use crate::axial::axial_transverse_angle_rad;
use crate::body::Body;
use crate::frame::frames_and_surfaces;
use crate::isthmus::MIN_NECK_MM;
use crate::pedicle::pedicle_with_isthmus;
use crate::{
    AnatomicalFrame, AnatomyError, Confidence, Doubt, Level, Pedicle, PedicleOptions, Side,
    spinous_process_tip,
};

/// Size of a vertebral body, from the section in the mirror plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyAnatomy {
    /// Middle of the body in the mirror plane, mm.
    pub center_mm: Point3<f64>,
    /// From the posterior to the anterior wall, mm.
    pub depth_mm: f64,
    /// Medio-lateral, through the middle, mm.
    pub width_mm: f64,
    /// Height near the posterior wall, mm.
    pub posterior_height_mm: f64,
    /// Height in the middle, mm.
    pub middle_height_mm: f64,
    /// Height near the anterior wall, mm.
    pub anterior_height_mm: f64,
}

/// Size of the spinal canal at the height of the pedicles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CanalAnatomy {
    /// Middle of the canal, mm.
    pub center_mm: Point3<f64>,
    /// Between the medial walls, mm.
    pub width_mm: f64,
    /// From the posterior wall of the body to the lamina in the mirror plane, mm; `None` where the
    /// canal is open behind at this height.
    pub depth_mm: Option<f64>,
}

/// One pedicle with everything a surgeon asks of it.
#[derive(Debug, Clone, PartialEq)]
pub struct PedicleAnatomy {
    /// Isthmus and axis.
    pub pedicle: Pedicle,
    /// The contour of the isthmus, mm; the last point joins the first.
    pub isthmus_contour_mm: Vec<Point3<f64>>,
    /// Through the centroid of the isthmus from side to side, mm: the width of surveys, which do not
    /// follow an isthmus that leans.
    pub mediolateral_chord_mm: f64,
    /// Through the centroid at right angles to that, mm: the height of surveys.
    pub upright_chord_mm: f64,
    /// Length around the isthmus along which sections are at most 10 % larger, mm.
    pub neck_mm: f64,
    /// Angle of the axis with the sagittal plane, radians; positive: converges to the front.
    pub transverse_angle_rad: f64,
    /// Angle of the axis with the end plates, radians; positive: rises to the front.
    pub sagittal_angle_rad: f64,
    /// Along the axis from the entry to the anterior cortex, mm.
    pub chord_length_mm: f64,
    /// Middle of the entry zone: where the axis meets the posterior cortex, mm.
    pub entry_mm: Point3<f64>,
    /// Radius of the entry zone, mm: half the shortest chord of the isthmus.
    pub entry_zone_radius_mm: f64,
}

impl PedicleAnatomy {
    /// The angle with the sagittal plane of surveys, radians, positive: converges to the front. In axial
    /// sections through the isthmus, of the line at right angles to the shortest chord between canal and
    /// lateral cortex; `None` if none shows both.
    ///
    /// `mesh` and `frame` are those of the vertebra. It is cut anew at every call; no screw needs the
    /// angle, so [`measure_spine`] leaves it out.
    #[must_use]
    pub fn axial_angle_rad(&self, mesh: &TriMesh, frame: &AnatomicalFrame) -> Option<f64> {
        axial_transverse_angle_rad(mesh, frame, &self.pedicle)
    }
}

/// The anatomy of one vertebra.
#[derive(Debug)]
pub struct VertebraAnatomy {
    /// Its level.
    pub level: Level,
    /// Its directions.
    pub frame: AnatomicalFrame,
    /// Its surface, to search.
    pub surface: SurfaceIndex,
    /// Its body.
    pub body: Result<BodyAnatomy, AnatomyError>,
    /// Its canal.
    pub canal: Result<CanalAnatomy, AnatomyError>,
    /// Its pedicles, in the order of [`Side`].
    pub pedicles: [Result<PedicleAnatomy, AnatomyError>; 2],
    /// The top of the spinous process: the landmark of a source, mm.
    pub spinous_process_tip_mm: Result<Point3<f64>, AnatomyError>,
    /// What speaks against trusting this.
    pub doubts: Vec<Doubt>,
}

impl VertebraAnatomy {
    /// The pedicle of one side.
    ///
    /// # Errors
    /// Why there is none.
    pub fn pedicle(&self, side: Side) -> Result<&PedicleAnatomy, AnatomyError> {
        self.pedicles[side as usize].as_ref().map_err(Clone::clone)
    }

    /// How far this may be relied upon.
    #[must_use]
    pub fn confidence(&self) -> Confidence {
        Confidence::after(&self.doubts)
    }
}

/// Lower over higher wall, and middle over the mean of both, of a sound body: Genant's limit of 20 %.
const MIN_HEIGHT_RATIO: f64 = 0.8;
/// A body outside these parts of the median height of the spine is out of the ordinary.
const HEIGHT_OF_MEDIAN: (f64, f64) = (0.75, 1.35);
/// Bodies nearer to each other than this have no disc between them, mm.
const MIN_DISC_MM: f64 = 1.0;
/// Shortest chord of an isthmus: published means less three deviations to means plus three, mm.
const NARROWEST_RANGE_MM: (f64, f64) = (2.5, 26.0);
/// Height of an isthmus, likewise, mm.
const HEIGHT_RANGE_MM: (f64, f64) = (7.0, 28.0);
/// Transverse angle of an axis, degrees.
const TRANSVERSE_RANGE_DEG: (f64, f64) = (-5.0, 50.0);
/// Largest sagittal angle of an axis either way, degrees.
const MAX_SAGITTAL_DEG: f64 = 25.0;
/// The narrower pedicle over the wider one, at least.
const MIN_SIDE_RATIO: f64 = 0.5;
/// Longest ray, mm.
const REACH_MM: f64 = 120.0;
/// Steps inside a body at which rays are cast towards the next one: parts of half its depth and
/// width.
const DISC_SPOTS: [f64; 3] = [-0.4, 0.0, 0.4];

/// Measures every vertebra of a spine.
///
/// # Errors
/// [`AnatomyError`] if the spine has no directions ([`crate::anatomical_frames`]) or a surface cannot be
/// searched. What is missing in one vertebra is an error of that part.
pub fn measure_spine(
    vertebrae: &[(Level, &TriMesh)],
    options: &PedicleOptions,
) -> Result<Vec<VertebraAnatomy>, AnatomyError> {
    let mut found: Vec<VertebraAnatomy> = vertebrae
        .par_iter()
        .zip(frames_and_surfaces(vertebrae)?)
        .map(|(vertebra, directed)| measure_vertebra(vertebra, directed, options))
        .collect();
    compare_heights(&mut found);
    find_fused(&mut found);
    Ok(found)
}

fn measure_vertebra(
    &(level, mesh): &(Level, &TriMesh),
    (frame, surface): (AnatomicalFrame, SurfaceIndex),
    options: &PedicleOptions,
) -> VertebraAnatomy {
    let mut doubts = Vec::new();
    let n_rims = boundary_loops(mesh).len();
    if n_rims > 0 {
        doubts.push(Doubt::OpenSurface { n_rims });
    }
    let section = Body::find(mesh, &frame);
    let body = section
        .as_ref()
        .map(|body| body_anatomy(body, &surface, &frame))
        .map_err(Clone::clone);
    if let Ok(body) = &body {
        doubts.extend(collapsed(body));
    }
    let found = |side| pedicle_with_isthmus(mesh, &surface, &frame, side, options);
    let (left, right) = rayon::join(|| found(Side::Left), || found(Side::Right));
    let pedicles = [(Side::Left, left), (Side::Right, right)].map(|(side, found)| {
        let (pedicle, isthmus) = found?;
        let isthmus = isthmus.ok_or(AnatomyError::NoPedicle {
            side,
            reason: "no closed section lies around its narrowest place",
        })?;
        doubts.extend(isthmus_doubts(side, isthmus.is_narrowest, isthmus.neck_mm));
        let found = pedicle_anatomy(&pedicle, &surface, &frame)?;
        Ok(PedicleAnatomy {
            isthmus_contour_mm: isthmus.contour_mm(),
            neck_mm: isthmus.neck_mm,
            ..found
        })
    });
    doubts.extend(pedicle_doubts(&pedicles));
    let canal = section.and_then(|body| canal_anatomy(&body, &pedicles, &surface, &frame));
    VertebraAnatomy {
        level,
        frame,
        body,
        canal,
        pedicles,
        spinous_process_tip_mm: spinous_process_tip(mesh, &frame),
        doubts,
        surface,
    }
}

fn body_anatomy(body: &Body, surface: &SurfaceIndex, frame: &AnatomicalFrame) -> BodyAnatomy {
    let center_mm = frame.point(
        0.0,
        0.5 * (body.posterior_wall_mm + body.anterior_wall_mm),
        0.5 * (body.low_mm + body.high_mm),
    );
    let [posterior_height_mm, middle_height_mm, anterior_height_mm] = body.heights_mm;
    BodyAnatomy {
        center_mm,
        depth_mm: body.anterior_wall_mm - body.posterior_wall_mm,
        width_mm: across(surface, &center_mm, &frame.left).unwrap_or(f64::NAN),
        posterior_height_mm,
        middle_height_mm,
        anterior_height_mm,
    }
}

/// Length of the chord through a point.
fn across(surface: &SurfaceIndex, p: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
    let there = surface.cast_ray(p, direction, REACH_MM)?.distance_mm;
    let back = surface.cast_ray(p, &-direction, REACH_MM)?.distance_mm;
    Some(there + back)
}

fn pedicle_anatomy(
    pedicle: &Pedicle,
    surface: &SurfaceIndex,
    frame: &AnatomicalFrame,
) -> Result<PedicleAnatomy, AnatomyError> {
    let (middle, axis) = (pedicle.isthmus_center_mm, pedicle.axis);
    let wall = |direction: Vector3<f64>, reason| {
        let side = pedicle.side;
        surface
            .cast_ray(&middle, &direction, REACH_MM)
            .ok_or(AnatomyError::NoPedicle { side, reason })
    };
    let behind = wall(-axis, "its axis meets no cortex behind")?;
    let ahead = wall(axis, "its axis meets no cortex in front")?;
    let medial = -frame.left * pedicle.side.sign();
    let aside = frame.left - axis * axis.dot(&frame.left);
    let chord = |direction: Vector3<f64>| {
        let reason = "its isthmus is open";
        let there = wall(direction, reason)?.distance_mm;
        let back = wall(-direction, reason)?.distance_mm;
        Ok::<f64, AnatomyError>(there + back)
    };
    Ok(PedicleAnatomy {
        pedicle: *pedicle,
        isthmus_contour_mm: Vec::new(),
        mediolateral_chord_mm: chord(aside)?,
        upright_chord_mm: chord(axis.cross(&aside))?,
        neck_mm: 0.0,
        transverse_angle_rad: axis.dot(&medial).atan2(axis.dot(&frame.anterior)),
        sagittal_angle_rad: axis.dot(&frame.up).clamp(-1.0, 1.0).asin(),
        chord_length_mm: behind.distance_mm + ahead.distance_mm,
        entry_mm: behind.point,
        entry_zone_radius_mm: 0.5 * pedicle.narrowest_mm,
    })
}

/// The canal between the two isthmuses, a little behind the posterior wall.
fn canal_anatomy(
    body: &Body,
    pedicles: &[Result<PedicleAnatomy, AnatomyError>; 2],
    surface: &SurfaceIndex,
    frame: &AnatomicalFrame,
) -> Result<CanalAnatomy, AnatomyError> {
    let found: Vec<Vector3<f64>> = pedicles
        .iter()
        .flatten()
        .map(|p| frame.coordinates(&p.pedicle.isthmus_center_mm))
        .collect();
    let n = found.len() as f64;
    if found.is_empty() {
        return Err(AnatomyError::NoCanal);
    }
    let up = found.iter().map(|c| c.z).sum::<f64>() / n;
    let back = found.iter().map(|c| c.y).sum::<f64>() / n;
    let anterior = back.min(body.posterior_wall_mm - CANAL_BEHIND_WALL_MM);
    let inside = frame.point(0.0, anterior, up);
    if surface.contains(&inside) {
        return Err(AnatomyError::NoCanal);
    }
    let width_mm = across(surface, &inside, &frame.left).ok_or(AnatomyError::NoCanal)?;
    Ok(CanalAnatomy {
        center_mm: inside,
        width_mm,
        depth_mm: across(surface, &inside, &frame.anterior),
    })
}

/// Where the width of the canal is measured, behind the posterior wall at least, mm.
const CANAL_BEHIND_WALL_MM: f64 = 2.0;

fn collapsed(body: &BodyAnatomy) -> Option<Doubt> {
    let (back, front) = (body.posterior_height_mm, body.anterior_height_mm);
    let wedge = back.min(front) / back.max(front);
    let biconcave = body.middle_height_mm / (0.5 * (back + front));
    let height_ratio = wedge.min(biconcave);
    // NaN is not sound either.
    let sound = height_ratio >= MIN_HEIGHT_RATIO;
    (!sound).then_some(Doubt::Collapsed {
        height_ratio,
        min_ratio: MIN_HEIGHT_RATIO,
    })
}

fn isthmus_doubts(side: Side, is_narrowest: bool, neck_mm: f64) -> Option<Doubt> {
    if !is_narrowest {
        return Some(Doubt::NoNeck { side });
    }
    (neck_mm < MIN_NECK_MM).then_some(Doubt::ShortNeck {
        side,
        neck_mm,
        min_mm: MIN_NECK_MM,
    })
}

fn pedicle_doubts(pedicles: &[Result<PedicleAnatomy, AnatomyError>; 2]) -> Vec<Doubt> {
    let mut doubts = Vec::new();
    for (side, found) in Side::ALL.into_iter().zip(pedicles) {
        let Ok(anatomy) = found else {
            doubts.push(Doubt::MissingPedicle { side });
            continue;
        };
        let p = &anatomy.pedicle;
        let within = |x: f64, (low, high): (f64, f64)| (low..=high).contains(&x);
        if !within(p.narrowest_mm, NARROWEST_RANGE_MM) || !within(p.height_mm, HEIGHT_RANGE_MM) {
            doubts.push(Doubt::PedicleSize {
                side,
                narrowest_mm: p.narrowest_mm,
                height_mm: p.height_mm,
            });
        }
        let transverse_deg = anatomy.transverse_angle_rad.to_degrees();
        let sagittal_deg = anatomy.sagittal_angle_rad.to_degrees();
        if !within(transverse_deg, TRANSVERSE_RANGE_DEG) || sagittal_deg.abs() > MAX_SAGITTAL_DEG {
            doubts.push(Doubt::PedicleDirection {
                side,
                transverse_deg,
                sagittal_deg,
            });
        }
    }
    if let [Ok(left), Ok(right)] = pedicles {
        let (left_mm, right_mm) = (left.pedicle.narrowest_mm, right.pedicle.narrowest_mm);
        if left_mm.min(right_mm) < MIN_SIDE_RATIO * left_mm.max(right_mm) {
            doubts.push(Doubt::Asymmetric { left_mm, right_mm });
        }
    }
    doubts
}

fn compare_heights(vertebrae: &mut [VertebraAnatomy]) {
    let height = |v: &VertebraAnatomy| v.body.as_ref().ok().map(|b| b.middle_height_mm);
    let mut heights: Vec<f64> = vertebrae.iter().filter_map(height).collect();
    heights.sort_by(f64::total_cmp);
    let Some(&median_mm) = heights.get(heights.len() / 2) else {
        return;
    };
    for v in vertebrae {
        let Some(height_mm) = height(v) else { continue };
        let (low, high) = HEIGHT_OF_MEDIAN;
        if !(low * median_mm..=high * median_mm).contains(&height_mm) {
            v.doubts.push(Doubt::BodyHeight {
                height_mm,
                median_mm,
            });
        }
    }
}

/// Doubts about neighbours whose bodies touch: the least way up from the upper end plate.
fn find_fused(vertebrae: &mut [VertebraAnatomy]) {
    let mut found: Vec<(usize, Doubt)> = Vec::new();
    for (i, lower) in vertebrae.iter().enumerate() {
        let above = vertebrae
            .iter()
            .enumerate()
            .filter(|(_, v)| v.level < lower.level)
            .max_by_key(|(_, v)| v.level);
        let (Some((j, upper)), Ok(body)) = (above, &lower.body) else {
            continue;
        };
        let gap = disc_gap_mm(lower, upper, body);
        if gap.is_some_and(|gap_mm| gap_mm < MIN_DISC_MM) {
            let gap_mm = gap.unwrap_or_default();
            let doubt = |with| Doubt::Fused { with, gap_mm };
            found.push((i, doubt(upper.level)));
            found.push((j, doubt(lower.level)));
        }
    }
    for (i, doubt) in found {
        vertebrae[i].doubts.push(doubt);
    }
}

/// Median over rays from the upper end plate to the body above, mm; negative if the two overlap.
fn disc_gap_mm(
    lower: &VertebraAnatomy,
    upper: &VertebraAnatomy,
    body: &BodyAnatomy,
) -> Option<f64> {
    let frame = &lower.frame;
    let mut gaps = Vec::new();
    for forward in DISC_SPOTS {
        for aside in DISC_SPOTS {
            let start = body.center_mm
                + frame.anterior * (forward * 0.5 * body.depth_mm)
                + frame.left * (aside * 0.5 * body.width_mm);
            let own = lower.surface.cast_ray(&start, &frame.up, REACH_MM);
            let other = upper.surface.cast_ray(&start, &frame.up, REACH_MM);
            if let (Some(own), Some(other)) = (own, other) {
                gaps.push(other.distance_mm - own.distance_mm);
            }
        }
    }
    gaps.sort_by(f64::total_cmp);
    gaps.get(gaps.len() / 2).copied()
}

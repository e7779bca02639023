//! From a file to the surfaces of the lumbar levels.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Mutex;

use nalgebra::Point3;
use pedicle_mesh::TriMesh;
use pedicle_trajectory::Level;
use rayon::prelude::*;

use crate::scheme::{choose, found_and_fit};
use crate::{
    LabelError, LabelMap, LabelScheme, Part, PartSize, ReadLimits, SchemeChoice, SurfaceOptions,
    largest_parts, read_label_map, surface_of_part,
};

/// How a label map is imported.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportOptions {
    /// Which label is which level. Default: found from the labels.
    pub scheme: SchemeChoice,
    /// How a part becomes a surface.
    pub surface: SurfaceOptions,
    /// Bounds on what the file may ask for.
    pub limits: ReadLimits,
    /// Largest relative change of a volume (default 0.02).
    pub max_volume_change: f64,
    /// Largest area of a level on the border of the volume, mm² (default 50): less is the tip of a
    /// process at the edge of a tight crop, more is a cut.
    pub max_border_area_mm2: f64,
    /// Share of the largest part of a label from which another part is too large to be a stray
    /// (default 0.25).
    pub max_stray_share: f64,
}

impl Default for ImportOptions {
    fn default() -> Self {
        Self {
            scheme: SchemeChoice::Auto,
            surface: SurfaceOptions::default(),
            limits: ReadLimits::default(),
            max_volume_change: 0.02,
            max_border_area_mm2: 50.0,
            max_stray_share: 0.25,
        }
    }
}

/// What the import is doing.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum ImportStage {
    /// Reading; the share that has been read.
    Reading(f64),
    /// Making the surface of a level.
    Surface(Level),
}

/// A level of a label map.
#[derive(Debug, Clone)]
pub struct ImportedLevel {
    /// The level.
    pub level: Level,
    /// Its label.
    pub label: i64,
    /// Its surface in RAS mm: one closed manifold, faces outwards.
    pub mesh: TriMesh,
    /// Volume of its voxels with holes filled, mm³.
    pub voxel_volume_mm3: f64,
    /// Volume of the surface over that of the voxels, less 1.
    pub volume_change: f64,
    /// Voxels of strays that were dropped.
    pub n_dropped: u64,
    /// Parts that were dropped.
    pub n_dropped_parts: usize,
    /// Voxels of closed holes that were filled.
    pub n_filled: u64,
    /// Largest area on one border of the volume, mm².
    pub border_area_mm2: f64,
}

/// The lumbar spine of a label map.
#[derive(Debug, Clone)]
pub struct ImportedSpine {
    /// The scheme that was used.
    pub scheme: LabelScheme,
    /// The levels found, from the top down.
    pub levels: Vec<ImportedLevel>,
    /// Levels of the scheme that are not in the file.
    pub missing: Vec<Level>,
    /// Length of a voxel's edges, mm.
    pub spacing_mm: [f64; 3],
    /// Voxels along i, j and k.
    pub size: [u32; 3],
}

/// Volume of a vertebra, cm³: from that of a small child's to more than twice that of a large man's.
const VOLUME_CM3: std::ops::RangeInclusive<f64> = 0.1..=300.0;
/// Longest edge of a vertebra's bounding box, mm.
const MAX_BOX_MM: f64 = 250.0;
/// Most voxels of a vertebra's bounding box: 0.5 GB of single floats.
const MAX_BOX_VOXELS: u64 = 1 << 27;
/// Largest distance from the middle of a vertebra to that of the next one, mm.
const MAX_STEP_MM: f64 = 100.0;

/// Imports the lumbar levels of a label map.
///
/// # Errors
/// [`LabelError`] for a file that is no label map, has no lumbar labels under the scheme, has two
/// large parts of one label, a level cut by the field of view or one that is no vertebra, or levels
/// that do not follow each other from head to feet.
pub fn import_label_map(
    path: impl AsRef<Path>,
    options: &ImportOptions,
    progress: &mut (dyn FnMut(ImportStage) + Send),
) -> Result<ImportedSpine, LabelError> {
    let path = path.as_ref();
    let wanted: BTreeSet<i64> = match &options.scheme {
        SchemeChoice::Scheme(scheme) => scheme.levels.values().copied().collect(),
        SchemeChoice::Auto => {
            let all = LabelScheme::all();
            all.iter()
                .flat_map(|s| s.levels.values().copied())
                .collect()
        }
    };
    let map = read_label_map(path, &wanted, &options.limits, &mut |share| {
        progress(ImportStage::Reading(share));
    })?;
    let scheme = choose(&options.scheme, &map)?;
    let mut found: Vec<Found> = Vec::new();
    let mut missing = Vec::new();
    for (&level, &label) in &scheme.levels {
        match map.runs.get(&label) {
            Some(runs) => found.push(Found::new(level, label, largest_parts(runs))),
            None => missing.push(level),
        }
    }
    // What is wrong with the spine as a whole says more than what is wrong with one level.
    for each in &found {
        each.check_parts(&map, options)?;
    }
    check_order(&map, &scheme, &found)?;
    for each in &found {
        each.check_size(&map)?;
        each.check_border(&map, options)?;
    }
    let progress = Mutex::new(progress);
    let levels: Vec<Result<ImportedLevel, LabelError>> = found
        .par_iter()
        .map(|each| {
            // A poisoned lock means that the caller's own code panicked, which the pool reports.
            if let Ok(mut progress) = progress.lock() {
                progress(ImportStage::Surface(each.level));
            }
            each.import(&map, options)
        })
        .collect();
    let levels = levels.into_iter().collect::<Result<_, _>>()?;
    Ok(ImportedSpine {
        scheme,
        levels,
        missing,
        spacing_mm: map.spacing_mm().into(),
        size: map.size,
    })
}

/// The parts of one level.
struct Found {
    level: Level,
    label: i64,
    parts: Vec<Part>,
}

impl Found {
    fn new(level: Level, label: i64, parts: Vec<Part>) -> Self {
        Self {
            level,
            label,
            parts,
        }
    }

    fn part(&self) -> &Part {
        &self.parts[0]
    }

    fn check_parts(&self, map: &LabelMap, options: &ImportOptions) -> Result<(), LabelError> {
        let [first, second, ..] = &self.parts[..] else {
            return Ok(());
        };
        if second.n_voxels as f64 > options.max_stray_share * first.n_voxels as f64 {
            return Err(LabelError::TwoParts {
                path: map.path.clone(),
                level: self.level,
                label: self.label,
                first: part_size(map, first),
                second: part_size(map, second),
            });
        }
        Ok(())
    }

    fn check_size(&self, map: &LabelMap) -> Result<(), LabelError> {
        let volume_cm3 = part_size(map, self.part()).volume_cm3;
        let (low, high) = self.part().bounds();
        let n: [u64; 3] = std::array::from_fn(|axis| u64::from(high[axis] - low[axis]) + 1);
        let spacing = map.spacing_mm();
        let box_mm: [f64; 3] = std::array::from_fn(|axis| n[axis] as f64 * spacing[axis]);
        let n_box: u64 = n.iter().product();
        if !VOLUME_CM3.contains(&volume_cm3)
            || box_mm.iter().any(|&edge| edge > MAX_BOX_MM)
            || n_box > MAX_BOX_VOXELS
        {
            return Err(LabelError::NotAVertebra {
                path: map.path.clone(),
                level: self.level,
                label: self.label,
                volume_cm3,
                box_mm,
            });
        }
        Ok(())
    }

    fn check_border(&self, map: &LabelMap, options: &ImportOptions) -> Result<(), LabelError> {
        let (area_mm2, side) = border_area(map, self.part());
        if area_mm2 > options.max_border_area_mm2 {
            return Err(LabelError::CutByFieldOfView {
                path: map.path.clone(),
                level: self.level,
                label: self.label,
                side,
                area_mm2,
                max_mm2: options.max_border_area_mm2,
            });
        }
        Ok(())
    }

    fn import(&self, map: &LabelMap, options: &ImportOptions) -> Result<ImportedLevel, LabelError> {
        let (path, level) = (&map.path, self.level);
        let surface = surface_of_part(map, self.part(), &options.surface).map_err(|source| {
            let path = path.clone();
            LabelError::Mesh {
                path,
                level,
                source,
            }
        })?;
        if surface.n_bad_edges > 0 {
            return Err(LabelError::NotManifold {
                path: path.clone(),
                level,
                n_edges: surface.n_bad_edges,
            });
        }
        if surface.volume_change.abs() > options.max_volume_change {
            return Err(LabelError::VolumeChange {
                path: path.clone(),
                level,
                change: surface.volume_change,
                max: options.max_volume_change,
            });
        }
        Ok(ImportedLevel {
            level,
            label: self.label,
            mesh: surface.mesh,
            voxel_volume_mm3: surface.voxel_volume_mm3,
            volume_change: surface.volume_change,
            n_dropped: self.parts[1..].iter().map(|part| part.n_voxels).sum(),
            n_dropped_parts: self.parts.len() - 1,
            n_filled: surface.n_filled,
            border_area_mm2: border_area(map, self.part()).0,
        })
    }
}

/// Levels must lie one below the other and not far apart.
fn check_order(map: &LabelMap, scheme: &LabelScheme, found: &[Found]) -> Result<(), LabelError> {
    for pair in found.windows(2) {
        let [upper, lower] = pair else { continue };
        let step = center(map, upper.part()) - center(map, lower.part());
        let n_steps = (lower.level.index() - upper.level.index()) as f64;
        if step.z <= 0.0 || step.norm() > MAX_STEP_MM * n_steps {
            return Err(LabelError::NotASpine {
                path: map.path.clone(),
                scheme: scheme.name.clone(),
                upper: upper.level,
                upper_label: upper.label,
                lower: lower.level,
                lower_label: lower.label,
                drop_mm: step.z,
                distance_mm: step.norm(),
                found: found_and_fit(map),
            });
        }
    }
    Ok(())
}

/// Mean of the voxels of a part in RAS, mm.
fn center(map: &LabelMap, part: &Part) -> Point3<f64> {
    let mut sum = nalgebra::Vector3::zeros();
    for run in &part.runs {
        let middle = 0.5 * (f64::from(run.first) + f64::from(run.last));
        let voxel = nalgebra::Vector3::new(middle, f64::from(run.j), f64::from(run.k));
        sum += voxel * run.n_voxels() as f64;
    }
    map.ras_mm(&Point3::from(sum / part.n_voxels as f64))
}

fn part_size(map: &LabelMap, part: &Part) -> PartSize {
    PartSize {
        volume_cm3: part.n_voxels as f64 * map.voxel_volume_mm3() / 1000.0,
        center_mm: center(map, part).into(),
    }
}

/// Largest area of a part on one of the six borders of the volume, mm², and which border.
fn border_area(map: &LabelMap, part: &Part) -> (f64, &'static str) {
    const SIDES: [&str; 6] = [
        "first i", "last i", "first j", "last j", "first k", "last k",
    ];
    let mut n = [0_u64; 6];
    let [ni, nj, nk] = map.size;
    for run in &part.runs {
        n[0] += u64::from(run.first == 0);
        n[1] += u64::from(run.last == ni - 1);
        for (side, is_there) in [
            (2, run.j == 0),
            (3, run.j == nj - 1),
            (4, run.k == 0),
            (5, run.k == nk - 1),
        ] {
            if is_there {
                n[side] += run.n_voxels();
            }
        }
    }
    let columns: [nalgebra::Vector3<f64>; 3] =
        std::array::from_fn(|axis| map.ras_from_voxel.fixed_view::<3, 1>(0, axis).into());
    let areas: [f64; 6] = std::array::from_fn(|side| {
        let (a, b) = ((side / 2 + 1) % 3, (side / 2 + 2) % 3);
        n[side] as f64 * columns[a].cross(&columns[b]).norm()
    });
    let largest = (0..6)
        .rev()
        .max_by(|&a, &b| areas[a].total_cmp(&areas[b]))
        .unwrap_or(0);
    (areas[largest], SIDES[largest])
}

//! What a refinement reports after every step.
//!
//! ```text
//! P = Φ_targetᵀ M_target Π Φ_source                       the functional map of the point map
//! energy = min_C ‖Π Φ_source - Φ_target C‖²_M / ‖Π Φ_source‖²_M
//!        = 1 - ‖P‖² / ‖Π Φ_source‖²_M                     0 to 1, without unit
//! ```
//!
//! The energy is the share of the carried eigenfunctions that the functions of the target cannot
//! represent: 0 for an exact map between isometric shapes, near 1 for a random one. It depends on
//! the numbers of functions, so only steps of equal size compare.
//!
//! Every refinement `name(..)` has a twin `name_with_progress(.., &mut dyn FnMut(&RefinementStep))`
//! that calls back once an entry of its report, in order and on the thread of the caller; the first
//! entry is the map it was given.

use faer::Mat;
use pedicle_mesh::TriMesh;
use pedicle_spectral::LaplaceBasis;

use crate::{
    Continuity, FmapError, PointMap, PointMapPair, bijectivity_error, continuity, vertex_coverage,
};

/// The state of a map at one point of a refinement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefinementStep {
    /// Number of functions of the source.
    pub n_source: usize,
    /// Number of functions of the target.
    pub n_target: usize,
    /// Share of the source points that some target point is mapped to; points are all vertices,
    /// or the samples where a refinement works on samples.
    pub coverage: f64,
    /// Share of the target points whose image the step changed; 1 for the first entry and where
    /// the points themselves change.
    pub changed: f64,
    /// Share of the carried eigenfunctions that the target's functions cannot represent.
    pub energy: f64,
    /// What takes the meshes and the map back to measure; `None` where it was not asked for.
    pub quality: Option<MapQuality>,
}

/// Measures of two point maps in opposite directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapQuality {
    /// Share of the source vertices that the target's vertices are mapped to.
    pub source_coverage: f64,
    /// Share of the target vertices that the source's vertices are mapped to.
    pub target_coverage: f64,
    /// Mean distance of source vertices from their round trip, over √area.
    pub bijectivity_error: f64,
    /// How the edges of the target are stretched and torn.
    pub continuity: Continuity,
}

/// At which steps a refinement measures [`MapQuality`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum QualityAt {
    /// At no step.
    Never,
    /// At the last step alone: costs next to nothing where the way back is known.
    #[default]
    LastStep,
    /// At every step: costs a map back and a pass over the edges each.
    EveryStep,
}

impl QualityAt {
    pub(crate) fn wanted(self, at_last_step: bool) -> bool {
        match self {
            Self::Never => false,
            Self::LastStep => at_last_step,
            Self::EveryStep => true,
        }
    }
}

/// Measures two point maps in opposite directions.
///
/// # Errors
/// [`FmapError`] if the maps do not belong to the meshes or to each other.
pub fn map_quality(
    source: &TriMesh,
    target: &TriMesh,
    maps: &PointMapPair,
) -> Result<MapQuality, FmapError> {
    Ok(MapQuality {
        bijectivity_error: bijectivity_error(source, maps)?,
        continuity: continuity(source, target, &maps.target_to_source)?,
        source_coverage: vertex_coverage(&maps.target_to_source),
        target_coverage: vertex_coverage(&maps.source_to_target),
    })
}

/// Collects the report and hands every entry on.
pub(crate) struct Reporter<'a> {
    pub(crate) report: Vec<RefinementStep>,
    progress: &'a mut dyn FnMut(&RefinementStep),
}

impl<'a> Reporter<'a> {
    pub(crate) fn new(progress: &'a mut dyn FnMut(&RefinementStep)) -> Self {
        Self {
            report: Vec::new(),
            progress,
        }
    }

    pub(crate) fn push(&mut self, step: RefinementStep) {
        (self.progress)(&step);
        self.report.push(step);
    }
}

/// Share of the entries in which two maps differ; 1 where there is no map before.
pub(crate) fn changed_share(before: Option<&PointMap>, now: &PointMap) -> f64 {
    before.map_or(1.0, |before| {
        let pairs = now.source_of_target.iter().zip(&before.source_of_target);
        pairs.filter(|(a, b)| a != b).count() as f64 / now.n_target_vertices() as f64
    })
}

/// The energy of a point map, given the functional map that was pulled back from it; functions
/// of that map beyond `n_target` × `n_source` are left aside.
pub(crate) fn map_energy(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    point_map: &PointMap,
    (pulled, n_target, n_source): (&Mat<f64>, usize, usize),
) -> f64 {
    let (mut carried, mut kept) = (0.0, 0.0);
    for j in 0..n_source {
        let from = source.eigenfunctions.col_as_slice(j);
        let images = point_map.source_of_target.iter().zip(&target.mass);
        carried += images
            .map(|(&x, mass)| mass * from[x as usize] * from[x as usize])
            .sum::<f64>();
        let column = &pulled.col_as_slice(j)[..n_target];
        kept += column.iter().map(|c| c * c).sum::<f64>();
    }
    lost_share(carried, carried - kept)
}

/// `lost` over `carried`, without what rounding does to differences near zero.
pub(crate) fn lost_share(carried: f64, lost: f64) -> f64 {
    if lost > 0.0 && carried > 0.0 {
        lost / carried
    } else {
        0.0
    }
}

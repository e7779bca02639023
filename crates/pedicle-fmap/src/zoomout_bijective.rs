//! ZoomOut in both directions at once.
//!
//! ```text
//! C_st = argmin ‖Φ_t C - Π_st Φ_s‖²_t + ‖Π_ts Φ_t C - Φ_s‖²_s      masses over the area of their shape
//! C_ts = the same with the shapes exchanged
//! T_st, T_ts   nearest rows of Φ_t C_st to Φ_s and of Φ_s C_ts to Φ_t
//! ```
//!
//! Each C is fitted to both point maps, stacked: what one direction gets wrong the other holds
//! against it. The normal equations are (I + (A_t/A_s) G) C_st = P_st + (A_t/A_s) P_tsᵀ with
//! P = Φᵀ M Π Φ of either map and G = (Π_ts Φ_t)ᵀ M_s Π_ts Φ_t, always well conditioned.
//!
//! Ren, Melzi, Ovsjanikov & Wonka 2020 (MapTree); Melzi et al. 2019.

use faer::{Mat, Side as Triangle, linalg::solvers::Llt, prelude::Solve};
use pedicle_spectral::LaplaceBasis;

use crate::{
    FmapError, FunctionalMap, PointMap, PointMapPair, QualityAt, RefinementStep, Shape,
    convert::{nearest_point_map, pulled_back},
    growth::Growth,
    linear::{add_scaled, product},
    map_quality,
    progress::{Reporter, changed_share, map_energy},
    vertex_coverage,
};

/// How far and in which steps bijective ZoomOut goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BijectiveZoomOutOptions {
    /// Number of functions of the source at the end, 100.
    pub n_source: usize,
    /// Number of functions of the target at the end, 100; it grows in proportion.
    pub n_target: usize,
    /// Functions of the source added a step, 5; at least 1.
    pub step: usize,
    /// At which steps bijectivity and continuity are measured; the last.
    pub quality: QualityAt,
}

impl Default for BijectiveZoomOutOptions {
    fn default() -> Self {
        Self {
            n_source: 100,
            n_target: 100,
            step: 5,
            quality: QualityAt::default(),
        }
    }
}

/// Maps refined in both directions, in the spectrum alone.
#[derive(Debug, Clone)]
pub struct RefinedPair {
    /// The functional map from the source to the target.
    pub map: FunctionalMap,
    /// The functional map back, k_source × k_target.
    pub map_back: FunctionalMap,
    /// The point maps nearest to them.
    pub point_maps: PointMapPair,
    /// The map given, then one entry a step.
    pub report: Vec<RefinementStep>,
}

/// Refines a map from few functions to many, in both directions; the way back starts from its
/// adjoint. The descriptors of the shapes are not used.
///
/// # Errors
/// [`FmapError`] if sizes do not fit, a basis is too small, the map has more functions than asked
/// for, `step` is 0 or a number is not finite.
pub fn zoomout_bijective(
    source: &Shape<'_>,
    target: &Shape<'_>,
    map: &FunctionalMap,
    options: &BijectiveZoomOutOptions,
) -> Result<RefinedPair, FmapError> {
    // On a thread of the pool: its many small steps need not be handed over to it.
    rayon::scope(|_| zoomout_bijective_with_progress(source, target, map, options, &mut |_| ()))
}

/// [`zoomout_bijective`] that calls back at every step.
///
/// # Errors
/// As [`zoomout_bijective`].
pub fn zoomout_bijective_with_progress(
    source: &Shape<'_>,
    target: &Shape<'_>,
    map: &FunctionalMap,
    options: &BijectiveZoomOutOptions,
    progress: &mut dyn FnMut(&RefinementStep),
) -> Result<RefinedPair, FmapError> {
    let end = (options.n_target, options.n_source);
    let growth = Growth::new((source, target), map, end, options.step)?;
    let (s, t) = (source.basis, target.basis);
    let mut reporter = Reporter::new(progress);
    let (mut there, mut back) = (map.clone(), map.adjoint());
    let mut before: Option<PointMap> = None;
    let mut step = 0;
    loop {
        let maps = PointMapPair {
            target_to_source: nearest_point_map(s, t, &there),
            source_to_target: nearest_point_map(t, s, &back),
        };
        // What the next step needs; its leading block gives the energy of this one.
        let next = growth.size(step + 1);
        let (p_st, p_ts) = pulled_pair((s, t), &maps, next);
        let (n_target, n_source) = growth.size(step);
        let last = step == growth.n_steps;
        let quality = options
            .quality
            .wanted(last)
            .then(|| map_quality(source.mesh, target.mesh, &maps))
            .transpose()?;
        let now = &maps.target_to_source;
        reporter.push(RefinementStep {
            n_source,
            n_target,
            coverage: vertex_coverage(now),
            changed: changed_share(before.as_ref(), now),
            energy: map_energy(s, t, now, (&p_st, n_target, n_source)),
            quality,
        });
        if last {
            return Ok(RefinedPair {
                map: there,
                map_back: back,
                point_maps: maps,
                report: reporter.report,
            });
        }
        let ratio = t.area() / s.area();
        there = stacked((s, t), &maps.source_to_target, (&p_st, &p_ts), ratio)?;
        back = stacked((t, s), &maps.target_to_source, (&p_ts, &p_st), 1.0 / ratio)?;
        before = Some(maps.target_to_source);
        step += 1;
    }
}

/// P_st, n_target × n_source, and P_ts, n_source × n_target.
fn pulled_pair(
    (s, t): (&LaplaceBasis, &LaplaceBasis),
    maps: &PointMapPair,
    (n_target, n_source): (usize, usize),
) -> (Mat<f64>, Mat<f64>) {
    rayon::join(
        || pulled_back(s, t, &maps.target_to_source, (n_target, n_source)).matrix,
        || pulled_back(t, s, &maps.source_to_target, (n_source, n_target)).matrix,
    )
}

/// C_st of both point maps, given P_st, P_ts and A_t/A_s.
fn stacked(
    (s, t): (&LaplaceBasis, &LaplaceBasis),
    way_back: &PointMap,
    (p_st, p_ts): (&Mat<f64>, &Mat<f64>),
    ratio: f64,
) -> Result<FunctionalMap, FmapError> {
    let n_target = p_st.nrows();
    // √M_s Π_ts Φ_t, one row a source vertex.
    let carried = Mat::from_fn(s.n_vertices(), n_target, |x, j| {
        let y = way_back.source_of_target[x] as usize;
        s.mass[x].sqrt() * t.eigenfunctions[(y, j)]
    });
    let gram = product(carried.transpose(), carried.as_ref());
    let mut left = Mat::<f64>::identity(n_target, n_target);
    add_scaled(&mut left, ratio, &gram);
    let mut matrix = p_st.clone();
    add_scaled(&mut matrix, ratio, &p_ts.transpose().to_owned());
    let factor: Llt<f64> = left
        .llt(Triangle::Lower)
        .map_err(|_| FmapError::Decomposition {
            what: "the normal equations of two point maps",
            rows: n_target,
            columns: n_target,
        })?;
    factor.solve_in_place(matrix.as_mut());
    Ok(FunctionalMap { matrix })
}

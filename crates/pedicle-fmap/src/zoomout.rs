//! Refinements in the spectrum: ZoomOut and spectral iterated closest points.
//!
//! ```text
//! T_C(y)         = argmin_x | Φ_target(y, ·) - (Φ_source Cᵀ)(x, ·) |²
//! ZoomOut        T_k from C_k,  C_{k+step} = Φ_targetᵀ M_target Π_k Φ_source, and so on
//! spectral ICP   T from C,      C = U Vᵀ of Φ_targetᵀ M_target Π Φ_source
//! ```
//!
//! C carries the rows of the source, as in the paper. The other way round, with the rows of
//! Φ_target C, images crowd where rows of the source are short, and errors double under noise.
//! Steps move few images, so ZoomOut searches everywhere only each time the functions of a shape
//! have grown by a half, and at the end; in between it looks among what came near then, all of it in
//! single precision; what the last search finds that way is measured in double.
//!
//! The number of functions of the source grows from that of the first map to `n_source` by `step`;
//! that of the target grows in proportion, so a rectangular map for a part stays rectangular.
//!
//! Melzi, Ren, Rodolà, Sharma, Wonka & Ovsjanikov 2019; Ovsjanikov et al. 2012, section 6.

use pedicle_spectral::LaplaceBasis;

use crate::{
    FmapError, FunctionalMap, PointMap, Side,
    convert::{check_basis, check_map},
    correspondence::Correspondence,
    growth::at_least_one,
    linear::nearest_orthogonal,
    progress::{RefinementStep, Reporter},
};

/// How far and in which steps ZoomOut goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ZoomOutOptions {
    /// Number of functions of the source at the end, 100.
    pub n_source: usize,
    /// Number of functions of the target at the end, 100.
    pub n_target: usize,
    /// Functions of the source added a step, 5; at least 1.
    pub step: usize,
}

impl Default for ZoomOutOptions {
    fn default() -> Self {
        Self {
            n_source: 100,
            n_target: 100,
            step: 5,
        }
    }
}

/// A refined map.
#[derive(Debug, Clone)]
pub struct Refined {
    /// The functional map at the end.
    pub map: FunctionalMap,
    /// The point map nearest to it.
    pub point_map: PointMap,
    /// One entry a point map computed, the last for `point_map`.
    pub report: Vec<RefinementStep>,
}

/// Refines a map from few functions to many.
///
/// # Errors
/// [`FmapError`] if a basis is too small, the map has more functions than asked for, `step` is 0
/// or a number is not finite.
pub fn zoomout(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    map: &FunctionalMap,
    options: &ZoomOutOptions,
) -> Result<Refined, FmapError> {
    // On a thread of the pool: its many small steps need not be handed over to it.
    rayon::scope(|_| zoomout_with_progress(source, target, map, options, &mut |_| {}))
}

/// [`zoomout`] that calls back once an entry of its report.
///
/// # Errors
/// Those of [`zoomout`].
pub fn zoomout_with_progress(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    map: &FunctionalMap,
    options: &ZoomOutOptions,
    progress: &mut dyn FnMut(&RefinementStep),
) -> Result<Refined, FmapError> {
    check_map(source, target, map)?;
    check_basis(source, Side::Source, options.n_source)?;
    check_basis(target, Side::Target, options.n_target)?;
    at_least_one("step", options.step)?;
    let start = (map.n_target(), map.n_source());
    for (option, first, last) in [
        ("n_source", start.1, options.n_source),
        ("n_target", start.0, options.n_target),
    ] {
        if last < first {
            return Err(FmapError::InvalidOption {
                option,
                value: last as f64,
                requirement: "it must not be below that of the map to be refined",
            });
        }
    }
    let grown_source = options.n_source - start.1;
    let grown_target = options.n_target - start.0;
    let n_steps = grown_source.div_ceil(options.step).max(grown_target.min(1));
    let mut current = map.matrix.clone();
    let sizes = (options.n_target, options.n_source);
    let mut correspondence = Correspondence::new(source, target, sizes);
    let changed = correspondence.assign_step(current.as_ref());
    let mut reporter = Reporter::new(progress);
    reporter.push(correspondence.step(current.shape(), changed));
    for step in 1..=n_steps {
        let n_source = (start.1 + step * options.step).min(options.n_source);
        // In proportion to the source, and exact at the end.
        let n_target = start.0 + grown_target * step / n_steps;
        current = correspondence.pulled_back((n_target, n_source));
        let changed = if step == n_steps {
            correspondence.assign(current.as_ref())
        } else {
            correspondence.assign_step(current.as_ref())
        };
        reporter.push(correspondence.step(current.shape(), changed));
    }
    Ok(Refined {
        map: FunctionalMap { matrix: current },
        point_map: correspondence.point_map(),
        report: reporter.report,
    })
}

/// Alternates nearest rows and the projection of C to orthonormal rows or columns.
///
/// # Errors
/// [`FmapError`] if a basis is too small or a number is not finite.
pub fn spectral_icp(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    map: &FunctionalMap,
    n_rounds: usize,
) -> Result<Refined, FmapError> {
    // On a thread of the pool: its many small steps need not be handed over to it.
    rayon::scope(|_| spectral_icp_with_progress(source, target, map, n_rounds, &mut |_| {}))
}

/// [`spectral_icp`] that calls back once an entry of its report.
///
/// # Errors
/// Those of [`spectral_icp`].
pub fn spectral_icp_with_progress(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    map: &FunctionalMap,
    n_rounds: usize,
    progress: &mut dyn FnMut(&RefinementStep),
) -> Result<Refined, FmapError> {
    check_map(source, target, map)?;
    let size = (map.n_target(), map.n_source());
    let mut current = map.matrix.clone();
    let mut correspondence = Correspondence::new(source, target, size);
    let changed = correspondence.assign(current.as_ref());
    let mut reporter = Reporter::new(progress);
    reporter.push(correspondence.step(current.shape(), changed));
    for _ in 0..n_rounds {
        current = nearest_orthogonal(&correspondence.pulled_back(size))?;
        let changed = correspondence.assign(current.as_ref());
        reporter.push(correspondence.step(current.shape(), changed));
        if changed == 0 {
            break;
        }
    }
    Ok(Refined {
        map: FunctionalMap { matrix: current },
        point_map: correspondence.point_map(),
        report: reporter.report,
    })
}

//! From functional maps to point maps and back.
//!
//! ```text
//! T(y) = argmin_x | (Φ_target C)(y, ·) - Φ_source(x, ·) |²        one source vertex per target vertex
//! C    = Φ_targetᵀ M_target Π Φ_source                            k_target × k_source
//! ```
//!
//! Ovsjanikov et al. 2012, section 6.2; Melzi et al. 2019, eq. (2).

use faer::{Mat, MatRef};
use pedicle_spectral::LaplaceBasis;

use crate::{
    FmapError, FunctionalMap, PointMap, PointMapPair, Side,
    linear::product,
    map::{check_finite, check_size},
    nearest::nearest_rows,
};

/// The point map nearest to a functional map: the nearest row of Φ_source to rows of Φ_target C.
///
/// Refinements take the other form, [`point_map_from_adjoint`](crate::point_map_from_adjoint).
///
/// # Errors
/// [`FmapError`] if a basis has fewer functions than the map, or a number is not finite.
pub fn point_map_from_functional(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    map: &FunctionalMap,
) -> Result<PointMap, FmapError> {
    check_map(source, target, map)?;
    Ok(nearest_point_map(source, target, map))
}

/// Point maps in both directions: of C, and of its adjoint with the shapes exchanged.
///
/// # Errors
/// [`FmapError`] if a basis has fewer functions than the map, or a number is not finite.
pub fn point_map_pair_from_functional(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    map: &FunctionalMap,
) -> Result<PointMapPair, FmapError> {
    check_map(source, target, map)?;
    Ok(PointMapPair {
        target_to_source: nearest_point_map(source, target, map),
        source_to_target: nearest_point_map(target, source, &map.adjoint()),
    })
}

/// The functional map of a point map in the first `n_source` and `n_target` functions.
///
/// # Errors
/// [`FmapError`] if the sizes do not fit or a basis has too few functions.
pub fn functional_from_point_map(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    point_map: &PointMap,
    (n_target, n_source): (usize, usize),
) -> Result<FunctionalMap, FmapError> {
    check_basis(source, Side::Source, n_source)?;
    check_basis(target, Side::Target, n_target)?;
    point_map.check_between(source.n_vertices(), target.n_vertices())?;
    Ok(pulled_back(source, target, point_map, (n_target, n_source)))
}

/// The first `count` functions of a basis, n × count.
pub(crate) fn functions(basis: &LaplaceBasis, count: usize) -> MatRef<'_, f64> {
    basis.eigenfunctions.subcols(0, count)
}

/// [`point_map_from_functional`] where everything has been checked.
pub(crate) fn nearest_point_map(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    map: &FunctionalMap,
) -> PointMap {
    let carried = product(functions(target, map.n_target()), map.matrix.as_ref());
    PointMap {
        source_of_target: nearest_rows(carried.as_ref(), functions(source, map.n_source())),
        n_source_vertices: source.n_vertices(),
    }
}

/// The nearest row of Φ_source Cᵀ to rows of Φ_target, where everything has been checked: what a
/// refinement takes, as it gives less weight to frequencies at which C loses norm.
pub(crate) fn nearest_adjoint_point_map(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    map: &FunctionalMap,
) -> PointMap {
    let rows = functions(source, map.n_source());
    let carried = product(rows, map.matrix.transpose());
    PointMap {
        source_of_target: nearest_rows(functions(target, map.n_target()), carried.as_ref()),
        n_source_vertices: source.n_vertices(),
    }
}

/// [`functional_from_point_map`] where everything has been checked.
pub(crate) fn pulled_back(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    point_map: &PointMap,
    (n_target, n_source): (usize, usize),
) -> FunctionalMap {
    let mut weighted = Mat::zeros(target.n_vertices(), n_source);
    for j in 0..n_source {
        let from = source.eigenfunctions.col_as_slice(j);
        let to = weighted.col_as_slice_mut(j);
        for ((value, &image), mass) in to
            .iter_mut()
            .zip(&point_map.source_of_target)
            .zip(&target.mass)
        {
            *value = mass * from[image as usize];
        }
    }
    FunctionalMap {
        matrix: product(functions(target, n_target).transpose(), weighted.as_ref()),
    }
}

/// Checks that a basis is whole, finite and has `requested` functions.
pub(crate) fn check_basis(
    basis: &LaplaceBasis,
    side: Side,
    requested: usize,
) -> Result<(), FmapError> {
    let what = match side {
        Side::Source => "basis of the source",
        Side::Target => "basis of the target",
    };
    if requested == 0 || basis.n_vertices() == 0 {
        return Err(FmapError::Empty { what });
    }
    let available = basis.n_functions();
    if requested > available {
        return Err(FmapError::BasisTooSmall {
            side,
            requested,
            available,
        });
    }
    check_size(what, basis.eigenfunctions.ncols(), available)?;
    check_size(what, basis.eigenfunctions.nrows(), basis.n_vertices())?;
    check_finite(what, &basis.eigenfunctions)?;
    let all = basis.eigenvalues.iter().chain(&basis.mass);
    for (row, &value) in all.enumerate() {
        if !value.is_finite() {
            return Err(FmapError::NonFinite {
                what,
                row,
                column: 0,
                value,
            });
        }
    }
    Ok(())
}

pub(crate) fn check_map(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    map: &FunctionalMap,
) -> Result<(), FmapError> {
    check_basis(source, Side::Source, map.n_source())?;
    check_basis(target, Side::Target, map.n_target())?;
    check_finite("functional map", &map.matrix)
}

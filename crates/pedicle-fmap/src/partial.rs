//! A part on a whole: how many functions on either side, and which part of the whole to compare.
//!
//! ```text
//! r = #{ j : λ_j(part) ≤ λ_k(whole) },   slope = r / k,   C: r × k (part as target) or k × r
//! ```
//!
//! By Weyl's law λ_j ≈ 4π j / area, so the slope estimates the ratio of the areas and r the rank of
//! the map: the part has no functions for the other modes of the whole. A square C asks for k
//! functions of the part, which oscillate faster than anything the whole has among its k. Rodolà,
//! Cosmo, Bronstein, Torsello & Cremers 2017, section 4.1.
//!
//! Null spaces need no special care: a whole and a part with equally many components have equally
//! many zeros, and [`LaplacianMask::Slanted`] leaves their block free.

use nalgebra::Vector3;
use pedicle_mesh::{SubMesh, TriMesh, connected_components};
use pedicle_spectral::LaplaceBasis;

use crate::{FitOptions, FmapError, LaplacianMask, Side, ZoomOutOptions, convert::check_basis};

/// Relative room for rounding in a sum of areas: the whole share is the whole component.
const ROUNDING: f64 = 1e-12;

/// How large maps of parts are to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PartialOptions {
    /// Functions of the larger of the two spectra in the fit, 60.
    pub n_fit: usize,
    /// Functions of the larger of the two spectra at the end of ZoomOut, 100.
    pub n_refined: usize,
    /// Functions of the source that ZoomOut adds a step, 5.
    pub step: usize,
}

impl Default for PartialOptions {
    fn default() -> Self {
        Self {
            n_fit: 60,
            n_refined: 100,
            step: 5,
        }
    }
}

/// Sizes of the maps between a part and a whole, estimated from their spectra.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PartialSizes {
    /// (n_target, n_source) of the first map.
    pub fit: (usize, usize),
    /// (n_target, n_source) of the refined map.
    pub refined: (usize, usize),
    /// Functions of the source that ZoomOut adds a step.
    pub step: usize,
    /// Functions of the target per function of the source, over the refined sizes.
    pub slope: f64,
    /// Rank of the first map: the smaller of its two sizes.
    pub rank: usize,
    /// Area of the target over that of the source, to compare with the slope.
    pub area_ratio: f64,
}

impl PartialSizes {
    /// Estimates the sizes; either shape may be the part.
    ///
    /// # Errors
    /// [`FmapError`] if a number of functions is 0 or the basis of the larger spectrum has too few.
    pub fn estimate(
        source: &LaplaceBasis,
        target: &LaplaceBasis,
        options: &PartialOptions,
    ) -> Result<Self, FmapError> {
        check_basis(source, Side::Source, 1)?;
        check_basis(target, Side::Target, 1)?;
        for (option, value) in [
            ("n_fit", options.n_fit),
            ("n_refined", options.n_refined),
            ("step", options.step),
        ] {
            if value == 0 {
                return Err(FmapError::InvalidOption {
                    option,
                    value: 0.0,
                    requirement: "it must be at least 1",
                });
            }
        }
        let fit = sizes(source, target, options.n_fit)?;
        let (n_target, n_source) = sizes(source, target, options.n_refined)?;
        let refined = (n_target.max(fit.0), n_source.max(fit.1));
        Ok(Self {
            fit,
            refined,
            step: options.step,
            slope: refined.0 as f64 / refined.1 as f64,
            rank: fit.0.min(fit.1),
            area_ratio: target.area() / source.area(),
        })
    }

    /// Options of the fit with these sizes and the slanted mask.
    #[must_use]
    pub fn fit_options(&self, base: FitOptions) -> FitOptions {
        FitOptions {
            n_source: self.fit.1,
            n_target: self.fit.0,
            mask: LaplacianMask::Slanted,
            ..base
        }
    }

    /// Options of the proportional ZoomOut from the first to the refined sizes.
    #[must_use]
    pub fn zoomout_options(&self, base: ZoomOutOptions) -> ZoomOutOptions {
        let mut options = base;
        options.n_source = self.refined.1;
        options.n_target = self.refined.0;
        options.step = self.step;
        options
    }
}

/// (n_target, n_source) such that the larger is `count` and both spectra end at the same value.
fn sizes(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    count: usize,
) -> Result<(usize, usize), FmapError> {
    // The one with the smaller count-th value has the denser spectrum: it is the whole.
    let end = |basis: &LaplaceBasis| basis.eigenvalues.get(count - 1).copied();
    let source_is_whole = match (end(source), end(target)) {
        (Some(s), Some(t)) => s <= t,
        (Some(_), None) => true,
        (None, Some(_)) => false,
        (None, None) => source.n_functions() >= target.n_functions(),
    };
    let (whole, part, side) = if source_is_whole {
        (source, target, Side::Source)
    } else {
        (target, source, Side::Target)
    };
    check_basis(whole, side, count)?;
    let last = whole.eigenvalues[count - 1];
    let below = |&&value: &&f64| value <= last;
    let n_part = part.eigenvalues.iter().filter(below).count();
    // The null spaces take part in any case.
    let n_part = n_part.max(part.null_dimension).clamp(1, part.n_functions());
    Ok(if source_is_whole {
        (n_part, count)
    } else {
        (count, n_part)
    })
}

/// The part of every component that lies furthest along a direction.
///
/// Whole faces are kept, component by component, from the furthest on, until `kept_share` of the
/// component's area has been taken. A target seen from one side is better compared with a source
/// cropped this way than with the whole of it; how far the target was cut is not known, so the
/// share is a guess. [`PointMap::followed_by`](crate::PointMap::followed_by) brings the map back to
/// the whole.
///
/// # Errors
/// [`FmapError`] if the share is not in (0, 1] or the direction is zero or not finite.
pub fn crop_along(
    mesh: &TriMesh,
    direction: &Vector3<f64>,
    kept_share: f64,
) -> Result<SubMesh, FmapError> {
    let length = direction.norm();
    for (option, value, is_good) in [
        (
            "kept_share",
            kept_share,
            kept_share > 0.0 && kept_share <= 1.0,
        ),
        (
            "length of the direction",
            length,
            length.is_finite() && length > 0.0,
        ),
    ] {
        if !is_good {
            return Err(FmapError::InvalidOption {
                option,
                value,
                requirement: "it must be positive; a share is at most 1",
            });
        }
    }
    let direction = direction / length;
    let mut kept = Vec::new();
    for mut faces in connected_components(mesh).faces() {
        // A face lies as far as its hindmost corner: the cut then follows a plane.
        let height = |face: u32| {
            let corners = mesh.triangle(face as usize);
            let heights = corners.map(|p| p.coords.dot(&direction));
            heights.into_iter().fold(f64::INFINITY, f64::min)
        };
        faces.sort_by(|&f, &g| height(g).total_cmp(&height(f)).then(f.cmp(&g)));
        let area: f64 = faces.iter().map(|&f| mesh.face_area(f as usize)).sum();
        let mut taken = 0.0;
        for face in faces {
            if taken > 0.0 && taken >= kept_share * area * (1.0 + ROUNDING) {
                break;
            }
            taken += mesh.face_area(face as usize);
            kept.push(face);
        }
    }
    kept.sort_unstable();
    mesh.submesh_of_faces(&kept).map_err(|_| FmapError::Empty {
        what: "faces that are kept",
    })
}

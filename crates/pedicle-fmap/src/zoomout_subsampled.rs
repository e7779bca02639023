//! ZoomOut on samples of both shapes.
//!
//! ```text
//! T on samples   nearest row of Q_s Φ_s Cᵀ to rows of Q_t Φ_t           Q picks the sampled rows
//! C_{k+step}     = argmin Σ_{samples y} a_y |(Φ_t C)(y, ·) - Φ_s(T(y), ·)|²
//! ```
//!
//! a_y is the area of the cell of a sample. The sampled rows of Φ_t are no longer orthonormal, so C
//! is solved for by least squares instead of by projection; the Gram matrix of all functions is
//! formed once, and its leading blocks serve every step. The cost of a step depends on the number
//! of samples p, not of vertices; the map between all vertices is made once, at the end. p should
//! be a few times the number of functions.
//!
//! The report has one entry a map of samples, whose coverage and energy are those of the samples,
//! and a last one for the map between all vertices.
//!
//! Melzi, Ren, Rodolà, Sharma, Wonka & Ovsjanikov 2019, section 4.4.

use faer::{Mat, Side as Triangle, prelude::Solve};
use pedicle_spectral::LaplaceBasis;

use crate::{
    FmapError, FunctionalMap, PointMap, PointMapPair, QualityAt, RefinementStep, SampleDistance,
    Samples, Shape,
    convert::{nearest_adjoint_point_map, pulled_back},
    farthest_point_samples,
    growth::Growth,
    linear::product,
    map_quality,
    nearest::nearest_rows,
    progress::{Reporter, changed_share, lost_share, map_energy},
    vertex_coverage,
};

/// How far, in which steps and on how many samples ZoomOut goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SubsampledZoomOutOptions {
    /// Number of functions of the source at the end, 100.
    pub n_source: usize,
    /// Number of functions of the target at the end, 100; it grows in proportion.
    pub n_target: usize,
    /// Functions of the source added a step, 5; at least 1.
    pub step: usize,
    /// Vertices sampled on each shape, 1000; no more than a shape has, and at least `n_source` and `n_target`.
    pub n_samples: usize,
    /// Distances by which samples are spread; along edges.
    pub distance: SampleDistance,
    /// Whether bijectivity and continuity are measured: at the last step, which takes the map back
    /// between all vertices and about doubles its cost. A map of samples has neither.
    pub quality: QualityAt,
}

impl Default for SubsampledZoomOutOptions {
    fn default() -> Self {
        Self {
            n_source: 100,
            n_target: 100,
            step: 5,
            n_samples: 1000,
            distance: SampleDistance::default(),
            quality: QualityAt::default(),
        }
    }
}

/// A map refined on samples.
#[derive(Debug, Clone)]
pub struct SubsampledZoomOut {
    /// The functional map at the end.
    pub map: FunctionalMap,
    /// The point map between all vertices nearest to it.
    pub point_map: PointMap,
    /// The samples of the source.
    pub source_samples: Samples,
    /// The samples of the target.
    pub target_samples: Samples,
    /// The map given, one entry a step, then the map between all vertices.
    pub report: Vec<RefinementStep>,
}

/// Refines a map from few functions to many on samples of both shapes. The descriptors of the
/// shapes are not used.
///
/// # Errors
/// [`FmapError`] if sizes do not fit, a basis is too small, the map has more functions than asked
/// for, `step` is 0, a number is not finite, there are fewer samples than functions or the sampled
/// functions are linearly dependent.
pub fn zoomout_subsampled(
    source: &Shape<'_>,
    target: &Shape<'_>,
    map: &FunctionalMap,
    options: &SubsampledZoomOutOptions,
) -> Result<SubsampledZoomOut, FmapError> {
    // On a thread of the pool: its many small steps need not be handed over to it.
    rayon::scope(|_| zoomout_subsampled_with_progress(source, target, map, options, &mut |_| ()))
}

/// [`zoomout_subsampled`] that calls back at every step.
///
/// # Errors
/// As [`zoomout_subsampled`].
pub fn zoomout_subsampled_with_progress(
    source: &Shape<'_>,
    target: &Shape<'_>,
    map: &FunctionalMap,
    options: &SubsampledZoomOutOptions,
    progress: &mut dyn FnMut(&RefinementStep),
) -> Result<SubsampledZoomOut, FmapError> {
    let end = (options.n_target, options.n_source);
    let growth = Growth::new((source, target), map, end, options.step)?;
    if options.n_samples < end.0.max(end.1) {
        return Err(FmapError::InvalidOption {
            option: "n_samples",
            value: options.n_samples as f64,
            requirement: "there must be at least as many samples as functions",
        });
    }
    let mut reporter = Reporter::new(progress);
    let source_samples = samples_of(source, options)?;
    let target_samples = samples_of(target, options)?;
    let sampled = Sampled::new(
        (source.basis, target.basis),
        (&source_samples, &target_samples),
        end,
    );

    let mut current = map.clone();
    let mut before: Option<PointMap> = None;
    for step in 0..=growth.n_steps {
        let now = sampled.nearest(&current);
        let carried = sampled.carried(&now, growth.size(step + 1));
        let (n_target, n_source) = growth.size(step);
        reporter.push(RefinementStep {
            n_source,
            n_target,
            coverage: vertex_coverage(&now),
            changed: changed_share(before.as_ref(), &now),
            energy: sampled.energy(&carried, (n_target, n_source))?,
            quality: None,
        });
        current = FunctionalMap {
            matrix: sampled.solve(&carried, growth.size(step + 1))?,
        };
        before = Some(now);
    }
    let (point_map, last) = between_all_vertices((source, target), &current, options.quality)?;
    reporter.push(last);
    Ok(SubsampledZoomOut {
        map: current,
        point_map,
        source_samples,
        target_samples,
        report: reporter.report,
    })
}

fn samples_of(shape: &Shape<'_>, options: &SubsampledZoomOutOptions) -> Result<Samples, FmapError> {
    farthest_point_samples(shape.mesh, options.n_samples, options.distance)
}

/// The dense map of C and its entry in the report.
fn between_all_vertices(
    (source, target): (&Shape<'_>, &Shape<'_>),
    map: &FunctionalMap,
    quality: QualityAt,
) -> Result<(PointMap, RefinementStep), FmapError> {
    let (s, t) = (source.basis, target.basis);
    let point_map = nearest_adjoint_point_map(s, t, map);
    let size = (map.n_target(), map.n_source());
    let pulled = pulled_back(s, t, &point_map, size).matrix;
    let energy = map_energy(s, t, &point_map, (&pulled, size.0, size.1));
    let mut step = RefinementStep {
        n_source: size.1,
        n_target: size.0,
        coverage: vertex_coverage(&point_map),
        changed: 1.0,
        energy,
        quality: None,
    };
    if quality.wanted(true) {
        let maps = PointMapPair {
            source_to_target: nearest_adjoint_point_map(t, s, &map.adjoint()),
            target_to_source: point_map.clone(),
        };
        step.quality = Some(map_quality(source.mesh, target.mesh, &maps)?);
    }
    Ok((point_map, step))
}

/// The sampled rows of both bases.
struct Sampled {
    source_rows: Mat<f64>,
    target_rows: Mat<f64>,
    /// The rows of the target times the areas of their cells.
    weighted_target_rows: Mat<f64>,
    target_areas: Vec<f64>,
    /// Σ a φ_i φ_j over the samples of the target.
    gram: Mat<f64>,
}

/// Functions of the source carried to the samples of the target by a map of samples.
struct Carried {
    values: Mat<f64>,
    /// Σ a φ_i(y) (Π φ_j)(y), k_target × k_source.
    moments: Mat<f64>,
}

impl Sampled {
    fn new(
        (source, target): (&LaplaceBasis, &LaplaceBasis),
        (source_samples, target_samples): (&Samples, &Samples),
        (n_target, n_source): (usize, usize),
    ) -> Self {
        let rows = |basis: &LaplaceBasis, samples: &Samples, k: usize| {
            Mat::from_fn(samples.vertices.len(), k, |i, j| {
                basis.eigenfunctions[(samples.vertices[i] as usize, j)]
            })
        };
        let target_rows = rows(target, target_samples, n_target);
        let weighted = Mat::from_fn(target_rows.nrows(), n_target, |i, j| {
            target_samples.areas[i] * target_rows[(i, j)]
        });
        Self {
            source_rows: rows(source, source_samples, n_source),
            gram: product(weighted.transpose(), target_rows.as_ref()),
            target_rows,
            weighted_target_rows: weighted,
            target_areas: target_samples.areas.clone(),
        }
    }

    /// The nearest source sample of every target sample.
    fn nearest(&self, map: &FunctionalMap) -> PointMap {
        let target_rows = self.target_rows.subcols(0, map.n_target());
        let source_rows = self.source_rows.subcols(0, map.n_source());
        let carried = product(source_rows, map.matrix.transpose());
        PointMap {
            source_of_target: nearest_rows(target_rows, carried.as_ref()),
            n_source_vertices: self.source_rows.nrows(),
        }
    }

    fn carried(&self, map: &PointMap, (n_target, n_source): (usize, usize)) -> Carried {
        let values = Mat::from_fn(map.n_target_vertices(), n_source, |y, j| {
            self.source_rows[(map.image(y), j)]
        });
        let rows = self.weighted_target_rows.subcols(0, n_target);
        Carried {
            moments: product(rows.transpose(), values.as_ref()),
            values,
        }
    }

    /// The C of least squares.
    fn solve(
        &self,
        carried: &Carried,
        (n_target, n_source): (usize, usize),
    ) -> Result<Mat<f64>, FmapError> {
        let gram = self.gram.submatrix(0, 0, n_target, n_target);
        let factor = gram
            .llt(Triangle::Lower)
            .map_err(|_| FmapError::Decomposition {
                what: "products of sampled functions",
                rows: n_target,
                columns: n_target,
            })?;
        Ok(factor.solve(carried.moments.submatrix(0, 0, n_target, n_source)))
    }

    /// Share of the carried functions outside of the span of the target's.
    fn energy(
        &self,
        carried: &Carried,
        (n_target, n_source): (usize, usize),
    ) -> Result<f64, FmapError> {
        let c = self.solve(carried, (n_target, n_source))?;
        let (mut all, mut kept) = (0.0, 0.0);
        for j in 0..n_source {
            let values = carried.values.col_as_slice(j).iter();
            all += values
                .zip(&self.target_areas)
                .map(|(v, area)| area * v * v)
                .sum::<f64>();
            let pairs = c
                .col_as_slice(j)
                .iter()
                .zip(carried.moments.col_as_slice(j));
            kept += pairs.map(|(c, m)| c * m).sum::<f64>();
        }
        Ok(lost_share(all, all - kept))
    }
}

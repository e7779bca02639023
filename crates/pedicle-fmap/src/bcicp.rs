//! BCICP: refinement of maps in both directions at once, bijective, continuous and covering.
//!
//! ```text
//! P_st, P_ts   pulled back from the point maps T_st (target to source) and T_ts
//! C = U Vᵀ of P_st + P_tsᵀ      the orthonormal C of least ‖Φ_t C - Π_st Φ_s‖² + ‖Φ_s Cᵀ - Π_ts Φ_t‖²
//! T_st, T_ts   nearest rows of [Φ_t C, Φ_t] and [Φ_s, Φ_s Cᵀ], the spatial pass, then coupling
//! ```
//!
//! One C serves both directions: where it is square its inverse is Cᵀ, so the maps are inverse to
//! each other in the spectrum (Ren et al. project the round trip C_ts C_st towards the orthogonal
//! group instead, which gives two).
//!
//! The first rounds have no spatial pass and grow from few functions to all, as ZoomOut does: from
//! a rough map that halves the error of rounds with all functions. The spatial pass looks at
//! neighbourhoods on the mesh only, so memory grows linearly with the number of vertices. At the
//! end of an iteration vertices are paired one to one as far as their neighbourhoods allow.
//!
//! Ren, Poulenard, Wonka & Ovsjanikov 2018, section 5.

use faer::Mat;

use crate::{
    FmapError, FunctionalMap, PointMap, PointMapPair, RefinementStep, Shape, Side,
    convert::{check_basis, check_map, functions, nearest_adjoint_point_map, pulled_back},
    joint::{joint_embedding, nearest_pair},
    linear::nearest_orthogonal,
    map::check_size,
    map_quality,
    progress::{Reporter, changed_share, map_energy},
    spatial::{Surface, couple, improve},
};

/// The first rounds use at least this many functions, or all there are.
const FEWEST_FUNCTIONS: usize = 20;

/// How BCICP refines.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BcicpOptions {
    /// Number of functions of the source; all of its basis if `None`, which is the default.
    pub n_source: Option<usize>,
    /// Number of functions of the target; all of its basis if `None`, which is the default.
    pub n_target: Option<usize>,
    /// Rounds of spectral ICP in both directions before the first iteration, 5.
    pub n_icp_rounds: usize,
    /// Share of the functions in the first of these rounds, 0.3, but not below 20 functions; the
    /// last of several rounds has all, a single round too. In (0, 1].
    pub icp_start_share: f64,
    /// Iterations with the spatial pass, 3.
    pub n_iterations: usize,
    /// Preimages a vertex may have before some are spread, 4; times the ratio of the numbers of
    /// vertices if there are more to be mapped than to be hit.
    pub max_preimages: usize,
    /// Coverage above which discontinuities are smoothed, 0.6; relative to what is possible.
    pub smooth_above_coverage: f64,
    /// Pieces between tears that are smaller than this share of their component are mapped again,
    /// 0.08.
    pub outlier_share: f64,
}

impl Default for BcicpOptions {
    fn default() -> Self {
        Self {
            n_source: None,
            n_target: None,
            n_icp_rounds: 5,
            icp_start_share: 0.3,
            n_iterations: 3,
            max_preimages: 4,
            smooth_above_coverage: 0.6,
            outlier_share: 0.08,
        }
    }
}

/// Maps refined in both directions.
#[derive(Debug, Clone)]
pub struct Bcicp {
    /// One source vertex for every target vertex.
    pub target_to_source: PointMap,
    /// One target vertex for every source vertex (source and target exchanged in the type).
    pub source_to_target: PointMap,
    /// The maps given, the maps after spectral ICP, then one entry an iteration.
    pub report: Vec<RefinementStep>,
}

/// Refines a functional map; the way back starts from its adjoint.
///
/// # Errors
/// [`FmapError`] if sizes do not fit, a basis is too small, a number is not finite or an option
/// makes no sense. The descriptors of the shapes are not used.
pub fn bcicp(
    source: &Shape<'_>,
    target: &Shape<'_>,
    initial: &FunctionalMap,
    options: &BcicpOptions,
) -> Result<Bcicp, FmapError> {
    // On a thread of the pool: its many small steps need not be handed over to it.
    rayon::scope(|_| bcicp_with_progress(source, target, initial, options, &mut |_| ()))
}

/// [`bcicp`] that calls back at every step.
///
/// # Errors
/// As [`bcicp`].
pub fn bcicp_with_progress(
    source: &Shape<'_>,
    target: &Shape<'_>,
    initial: &FunctionalMap,
    options: &BcicpOptions,
    progress: &mut dyn FnMut(&RefinementStep),
) -> Result<Bcicp, FmapError> {
    check_map(source.basis, target.basis, initial)?;
    let (s, t) = (source.basis, target.basis);
    let maps = PointMapPair {
        target_to_source: nearest_adjoint_point_map(s, t, initial),
        source_to_target: nearest_adjoint_point_map(t, s, &initial.adjoint()),
    };
    bcicp_from_point_maps_with_progress(source, target, &maps, options, progress)
}

/// Refines point maps in both directions.
///
/// # Errors
/// [`FmapError`] if sizes do not fit, a basis is too small, a number is not finite or an option
/// makes no sense. The descriptors of the shapes are not used.
pub fn bcicp_from_point_maps(
    source: &Shape<'_>,
    target: &Shape<'_>,
    initial: &PointMapPair,
    options: &BcicpOptions,
) -> Result<Bcicp, FmapError> {
    // On a thread of the pool: its many small steps need not be handed over to it.
    rayon::scope(|_| {
        bcicp_from_point_maps_with_progress(source, target, initial, options, &mut |_| ())
    })
}

/// [`bcicp_from_point_maps`] that calls back at every step.
///
/// # Errors
/// As [`bcicp_from_point_maps`].
pub fn bcicp_from_point_maps_with_progress(
    source: &Shape<'_>,
    target: &Shape<'_>,
    initial: &PointMapPair,
    options: &BcicpOptions,
    progress: &mut dyn FnMut(&RefinementStep),
) -> Result<Bcicp, FmapError> {
    let n_source = options.n_source.unwrap_or(source.basis.n_functions());
    let n_target = options.n_target.unwrap_or(target.basis.n_functions());
    check(source, target, initial, options)?;
    check_basis(source.basis, Side::Source, n_source)?;
    check_basis(target.basis, Side::Target, n_target)?;

    let mut reporter = Reporter::new(progress);
    let mut spectral = Spectral::new((source, target), (n_source, n_target), initial.clone());
    reporter.push(spectral.step(None)?);
    let before = spectral.maps.clone();
    spectral.run_icp(options.n_icp_rounds, options.icp_start_share)?;
    reporter.push(spectral.step(Some(&before.target_to_source))?);

    let mut surfaces = (Surface::new(source.mesh), Surface::new(target.mesh));
    for _ in 0..options.n_iterations {
        let before = spectral.maps.clone();
        let (source_rows, target_rows) = spectral.joint_rows((n_source, n_target))?;
        let PointMapPair {
            mut target_to_source,
            mut source_to_target,
        } = nearest_pair(&source_rows, &target_rows);
        surfaces.0.set_rows(&source_rows);
        surfaces.1.set_rows(&target_rows);
        let (s, t) = (&surfaces.0, &surfaces.1);
        improve(s, t, (&mut target_to_source, &source_to_target), options);
        improve(t, s, (&mut source_to_target, &target_to_source), options);
        couple(t, s, (&mut source_to_target, &target_to_source));
        couple(s, t, (&mut target_to_source, &source_to_target));
        spectral.set_maps(PointMapPair {
            target_to_source,
            source_to_target,
        });
        reporter.push(spectral.step(Some(&before.target_to_source))?);
        if spectral.maps == before {
            break;
        }
    }
    Ok(Bcicp {
        target_to_source: spectral.maps.target_to_source,
        source_to_target: spectral.maps.source_to_target,
        report: reporter.report,
    })
}

/// Both maps with the bases they live in.
struct Spectral<'a> {
    source: &'a Shape<'a>,
    target: &'a Shape<'a>,
    n_source: usize,
    n_target: usize,
    maps: PointMapPair,
    /// C_st and C_ts of the point maps.
    pulled: (Mat<f64>, Mat<f64>),
}

impl<'a> Spectral<'a> {
    fn new(
        (source, target): (&'a Shape<'a>, &'a Shape<'a>),
        (n_source, n_target): (usize, usize),
        maps: PointMapPair,
    ) -> Self {
        let mut spectral = Self {
            source,
            target,
            n_source,
            n_target,
            maps: maps.clone(),
            pulled: (Mat::new(), Mat::new()),
        };
        spectral.set_maps(maps);
        spectral
    }

    fn set_maps(&mut self, maps: PointMapPair) {
        let (s, t) = (self.source.basis, self.target.basis);
        let (there, back) = (&maps.target_to_source, &maps.source_to_target);
        self.pulled = rayon::join(
            || pulled_back(s, t, there, (self.n_target, self.n_source)).matrix,
            || pulled_back(t, s, back, (self.n_source, self.n_target)).matrix,
        );
        self.maps = maps;
    }

    fn run_icp(&mut self, n_rounds: usize, start_share: f64) -> Result<(), FmapError> {
        for left in (0..n_rounds).rev() {
            // Evenly from the first share to all.
            let behind = left as f64 / (n_rounds - 1).max(1) as f64;
            let share = 1.0 - (1.0 - start_share) * behind;
            let count = |all: usize| {
                let some = (share * all as f64).round() as usize;
                some.max(FEWEST_FUNCTIONS).min(all)
            };
            let (source_rows, target_rows) =
                self.joint_rows((count(self.n_source), count(self.n_target)))?;
            self.set_maps(nearest_pair(&source_rows, &target_rows));
        }
        Ok(())
    }

    /// The joint embedding of both shapes in their first functions, one row a vertex.
    fn joint_rows(
        &self,
        (n_source, n_target): (usize, usize),
    ) -> Result<(Mat<f64>, Mat<f64>), FmapError> {
        let there = self.pulled.0.submatrix(0, 0, n_target, n_source);
        let back = self.pulled.1.submatrix(0, 0, n_source, n_target);
        let c = nearest_orthogonal(&(there + back.transpose()))?;
        let phi_s = functions(self.source.basis, n_source);
        let phi_t = functions(self.target.basis, n_target);
        Ok(joint_embedding(phi_s, phi_t, &c))
    }

    fn step(&self, before: Option<&PointMap>) -> Result<RefinementStep, FmapError> {
        let map = &self.maps.target_to_source;
        let quality = map_quality(self.source.mesh, self.target.mesh, &self.maps)?;
        let pulled = (&self.pulled.0, self.n_target, self.n_source);
        Ok(RefinementStep {
            n_source: self.n_source,
            n_target: self.n_target,
            coverage: quality.source_coverage,
            changed: changed_share(before, map),
            energy: map_energy(self.source.basis, self.target.basis, map, pulled),
            quality: Some(quality),
        })
    }
}

fn check(
    source: &Shape<'_>,
    target: &Shape<'_>,
    initial: &PointMapPair,
    options: &BcicpOptions,
) -> Result<(), FmapError> {
    let (n_source, n_target) = (source.mesh.n_vertices(), target.mesh.n_vertices());
    check_size(
        "vertices of the source basis",
        source.basis.n_vertices(),
        n_source,
    )?;
    check_size(
        "vertices of the target basis",
        target.basis.n_vertices(),
        n_target,
    )?;
    initial.target_to_source.check_between(n_source, n_target)?;
    initial.source_to_target.check_between(n_target, n_source)?;
    let shares = [
        ("smooth_above_coverage", options.smooth_above_coverage),
        ("outlier_share", options.outlier_share),
    ];
    for (option, value) in shares {
        if !(0.0..=1.0).contains(&value) {
            let requirement = "it must lie in [0, 1]";
            return Err(FmapError::InvalidOption {
                option,
                value,
                requirement,
            });
        }
    }
    if !(options.icp_start_share > 0.0 && options.icp_start_share <= 1.0) {
        return Err(FmapError::InvalidOption {
            option: "icp_start_share",
            value: options.icp_start_share,
            requirement: "it must lie in (0, 1]",
        });
    }
    if options.max_preimages == 0 {
        return Err(FmapError::InvalidOption {
            option: "max_preimages",
            value: 0.0,
            requirement: "it must be at least 1",
        });
    }
    Ok(())
}

//! BCICP: refinement of maps in both directions at once, bijective, continuous and covering.
//!
//! ```text
//! C_st, C_ts   of the point maps, projected to the nearest orthogonal matrices
//! Q = U Vᵀ of C_ts C_st,   C_st ← U Vᵀ of (C_st + C_st Qᵀ)        and the same for C_ts
//! rows         E_s = [Φ_s, Φ_s C_ts],   E_t = [Φ_t C_st, Φ_t]
//! T_st, T_ts   nearest rows of E_s to E_t and of E_t to E_s, then the spatial pass on each
//! ```
//!
//! C_ts C_st is what a round trip does to functions on the source: the identity, if the maps are
//! inverse to each other. Its orthogonal part Q is undone by half a step in either direction, after
//! which the two maps agree. The spatial pass looks at neighbourhoods on the mesh only, so memory
//! grows linearly with the number of vertices.
//!
//! Ren, Poulenard, Wonka & Ovsjanikov 2018, section 5.

use faer::Mat;

use crate::{
    FmapError, FunctionalMap, PointMap, PointMapPair, RefinementStep, Shape, Side,
    convert::{check_basis, functions, point_map_pair_from_functional, pulled_back},
    linear::{add_scaled, nearest_orthogonal, product},
    map::check_size,
    map_quality,
    nearest::nearest_rows,
    progress::{Reporter, changed_share, map_energy},
    spatial::{Surface, improve},
    zoomout::icp_rounds,
};

/// How BCICP refines.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BcicpOptions {
    /// Number of functions of the source; all of its basis if `None`, which is the default.
    pub n_source: Option<usize>,
    /// Number of functions of the target; all of its basis if `None`, which is the default.
    pub n_target: Option<usize>,
    /// Rounds of spectral ICP in each direction before the first iteration, 5.
    pub n_icp_rounds: usize,
    /// Iterations, 5.
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
            n_iterations: 5,
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
    bcicp_with_progress(source, target, initial, options, &mut |_| ())
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
    let maps = point_map_pair_from_functional(source.basis, target.basis, initial)?;
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
    bcicp_from_point_maps_with_progress(source, target, initial, options, &mut |_| ())
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
    spectral.run_icp(options.n_icp_rounds)?;
    reporter.push(spectral.step(Some(&before.target_to_source))?);

    let mut surfaces = (Surface::new(source.mesh), Surface::new(target.mesh));
    for _ in 0..options.n_iterations {
        let before = spectral.maps.clone();
        let (source_rows, target_rows) = spectral.joint_rows()?;
        let mut target_to_source = PointMap {
            source_of_target: nearest_rows(target_rows.as_ref(), source_rows.as_ref()),
            n_source_vertices: source.mesh.n_vertices(),
        };
        let mut source_to_target = PointMap {
            source_of_target: nearest_rows(source_rows.as_ref(), target_rows.as_ref()),
            n_source_vertices: target.mesh.n_vertices(),
        };
        surfaces.0.set_rows(&source_rows);
        surfaces.1.set_rows(&target_rows);
        let (s, t) = (&surfaces.0, &surfaces.1);
        improve(s, t, (&mut target_to_source, &source_to_target), options);
        improve(t, s, (&mut source_to_target, &target_to_source), options);
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
        let size = (self.n_target, self.n_source);
        let there = pulled_back(s, t, &maps.target_to_source, size).matrix;
        let size = (self.n_source, self.n_target);
        let back = pulled_back(t, s, &maps.source_to_target, size).matrix;
        self.pulled = (there, back);
        self.maps = maps;
    }

    fn run_icp(&mut self, n_rounds: usize) -> Result<(), FmapError> {
        let (s, t) = (self.source.basis, self.target.basis);
        let there = (self.n_target, self.n_source);
        let back = (self.n_source, self.n_target);
        let maps = &self.maps;
        let maps = PointMapPair {
            target_to_source: icp_rounds(s, t, &maps.target_to_source, (there, n_rounds))?,
            source_to_target: icp_rounds(t, s, &maps.source_to_target, (back, n_rounds))?,
        };
        self.set_maps(maps);
        Ok(())
    }

    /// E_s and E_t, one row a vertex, k_source + k_target columns.
    fn joint_rows(&self) -> Result<(Mat<f64>, Mat<f64>), FmapError> {
        let (s, t) = (self.source.basis, self.target.basis);
        let there = nearest_orthogonal(&self.pulled.0)?;
        let back = nearest_orthogonal(&self.pulled.1)?;
        // A round trip on the source, and one on the target.
        let (there, back) = (
            half_undone(&there, &product(back.as_ref(), there.as_ref()))?,
            half_undone(&back, &product(there.as_ref(), back.as_ref()))?,
        );
        let (phi_s, phi_t) = (functions(s, self.n_source), functions(t, self.n_target));
        let side_by_side = |left: faer::MatRef<'_, f64>, right: faer::MatRef<'_, f64>| {
            let mut rows = Mat::zeros(left.nrows(), left.ncols() + right.ncols());
            rows.subcols_mut(0, left.ncols()).copy_from(left);
            rows.subcols_mut(left.ncols(), right.ncols())
                .copy_from(right);
            rows
        };
        let source_rows = side_by_side(phi_s, product(phi_s, back.as_ref()).as_ref());
        let target_rows = side_by_side(product(phi_t, there.as_ref()).as_ref(), phi_t);
        Ok((source_rows, target_rows))
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

/// Moves C half of the way that makes the round trip the identity.
fn half_undone(c: &Mat<f64>, round_trip: &Mat<f64>) -> Result<Mat<f64>, FmapError> {
    let rotation = nearest_orthogonal(round_trip)?;
    let mut mean = product(c.as_ref(), rotation.transpose());
    add_scaled(&mut mean, 1.0, c);
    nearest_orthogonal(&mean)
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
    if options.max_preimages == 0 {
        return Err(FmapError::InvalidOption {
            option: "max_preimages",
            value: 0.0,
            requirement: "it must be at least 1",
        });
    }
    Ok(())
}

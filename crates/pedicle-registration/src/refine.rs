//! Robust refinement of a pose against a surface.
//!
//! ```text
//! T = argmin Σ_j ρ( n_j · (T⁻¹ p_j - q_j) / s )
//! ```
//!
//! Gauss-Newton with reweighting: every target point p is brought into the source frame, q is the
//! nearest surface point there and n its normal (Chen & Medioni 1992), ρ a robust kernel and s the
//! scale of the residuals, estimated anew in each iteration. Points farther from the surface than
//! a gate do not take part; the gate may shrink while iterating. A step that raises the cost is
//! taken back and damped (Levenberg 1944; Marquardt 1963). On exact data convergence is quadratic
//! down to rounding; on noisy data iteration stops when a step is a small share of its own
//! standard error.
//!
//! The surface is in the source frame, points and result refer to the target frame; mm and rad.

use nalgebra::{Isometry3, Matrix6, Point3};

use crate::covariance::{constraint, covariance_of};
use crate::kernel::RobustKernel;
use crate::linearize::{CenteredPose, Cloud, Sample, Step, Weighting, sample};
use crate::{PoseCovariance, ReferenceSurface, RegistrationError, validate};

/// Unknowns of a pose.
const N_UNKNOWNS: usize = 6;

/// The scale never falls below this share of the radius of the points: residuals of exact data
/// are rounding, and dividing by them would weight rounding.
const MIN_SCALE: f64 = 1e-11;

/// The scale falls by this factor at most from one iteration to the next, so that a few points
/// that happen to fit exactly cannot shut out the others.
const MAX_SCALE_FALL: f64 = 0.25;

/// Damping of the first retry and its growth after each failure.
const FIRST_DAMPING: f64 = 1e-2;
const DAMPING_GROWTH: f64 = 10.0;

/// Retries of one step before the cost counts as minimal. Each asks for all points again.
const MAX_RETRIES: usize = 4;

/// A step that fails is not worth a retry below this share of its standard error: the corners of
/// the surface, not the data, decide about it.
const WORTH_A_RETRY: f64 = 0.1;

/// Inliers lie within this many standard deviations: 99.7 per cent of normal residuals.
const INLIER_SIGMA: f64 = 3.0;

/// Settings of [`refine_on_surface`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefineOptions {
    /// Most accepted steps. Default 30.
    pub max_iterations: usize,
    /// Points farther from the surface do not take part (the final gate), mm. Default 6.
    pub max_distance_mm: f64,
    /// Gate of the first iteration, mm, at least `max_distance_mm`; `None` for no change.
    /// Default `Some(12)`.
    pub start_distance_mm: Option<f64>,
    /// Iterations over which the gate shrinks geometrically from start to end. Default 4.
    pub anneal_iterations: usize,
    /// How residuals are weighted. Default Tukey.
    pub kernel: RobustKernel,
    /// Fewest points within the gate, at least 7. Default 10.
    pub min_points: usize,
    /// Converged when a step turns by less than this (rad) and shifts by less than this times the
    /// radius of the points. Default 1e-11.
    pub step_tolerance: f64,
    /// Converged when a step is shorter than this share of its own standard error; 0 switches the
    /// test off. Default 0.01: what is left then adds next to nothing to the error.
    pub noise_tolerance: f64,
}

impl Default for RefineOptions {
    fn default() -> Self {
        Self {
            max_iterations: 30,
            max_distance_mm: 6.0,
            start_distance_mm: Some(12.0),
            anneal_iterations: 4,
            kernel: RobustKernel::default(),
            min_points: 10,
            step_tolerance: 1e-11,
            noise_tolerance: 0.01,
        }
    }
}

/// Why refinement ended. The result can be used in every case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Termination {
    /// The last step was shorter than a tolerance.
    Converged,
    /// No step lowered the cost: a minimum as far as a surface with corners, or one made of points,
    /// lets it be seen.
    Stalled,
    /// All iterations were used.
    MaxIterations,
}

/// One iteration, for diagnosis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefineStep {
    /// Gate, mm.
    pub gate_mm: f64,
    /// Scale of the residuals, mm.
    pub scale_mm: f64,
    /// Points within the gate.
    pub n_within: usize,
    /// Mean kernel cost before the step, dimensionless.
    pub cost: f64,
    /// Translation of the step at the middle of the points, mm.
    pub translation_mm: f64,
    /// Rotation of the step, rad.
    pub rotation_rad: f64,
}

/// A refined pose with its uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct Refinement {
    /// Takes source coordinates to target coordinates.
    pub target_from_source: Isometry3<f64>,
    /// Root mean square point-to-plane residual of the inliers, mm.
    pub rmse_mm: f64,
    /// Standard deviation of the noise along the normals: the robust scale of the residuals,
    /// corrected for the six unknowns, mm.
    pub noise_mm: f64,
    /// For every target point, whether it lies within the final gate and three `noise_mm`.
    pub inliers: Vec<bool>,
    /// How many do.
    pub n_inliers: usize,
    /// Uncertainty of the pose about the middle of the points that took part, target frame.
    pub covariance: PoseCovariance,
    /// Accepted steps.
    pub iterations: usize,
    /// Times the surface was asked about all points.
    pub n_evaluations: usize,
    /// Why iteration ended.
    pub termination: Termination,
    /// The iterations in order.
    pub history: Vec<RefineStep>,
}

/// Refines `initial_target_from_source` until the target points lie on the surface.
///
/// The covariance is that of the M-estimator (Huber 1981, section 7.6): the inverse information of
/// the points that take part times the residual variance, enlarged by what the kernel costs. It
/// knows noise, not wrong minima: whether the pose is the right one is for the caller to judge. Being
/// of first order it is honest while the noise is small against the detail of the surface. On
/// vertebrae the errors exceed it by 5 to 20 per cent at a noise of 1 mm, by 20 to 40 per cent at
/// 2 mm and by 45 to 85 per cent at 3 mm.
///
/// # Errors
/// Fewer than `min_points` points or a gate with fewer of them inside, a coordinate or pose that is
/// not finite, an option out of range, or a surface that does not determine the pose.
pub fn refine_on_surface(
    surface: &(impl ReferenceSurface + ?Sized),
    target_points: &[Point3<f64>],
    initial_target_from_source: &Isometry3<f64>,
    options: &RefineOptions,
) -> Result<Refinement, RegistrationError> {
    check_options(options)?;
    validate::at_least(target_points.len(), options.min_points)?;
    validate::finite_points("target", target_points)?;
    validate::finite_pose(initial_target_from_source)?;

    let cloud = Cloud::new(target_points);
    // Points that all but coincide determine no pose, and would divide by zero below.
    if !cloud.radius.is_normal() {
        let (smallest_eigenvalue, largest_eigenvalue) = (0.0, 0.0);
        return Err(RegistrationError::Degenerate {
            smallest_eigenvalue,
            largest_eigenvalue,
        });
    }
    let mut search = Search::new(surface, &cloud, initial_target_from_source, options);
    let termination = search.run()?;
    search.finish(target_points, termination)
}

fn check_options(options: &RefineOptions) -> Result<(), RegistrationError> {
    validate::positive("max_distance_mm", options.max_distance_mm)?;
    validate::not_negative("step_tolerance", options.step_tolerance)?;
    validate::not_negative("noise_tolerance", options.noise_tolerance)?;
    if let Some(start) = options.start_distance_mm {
        validate::positive("start_distance_mm", start)?;
        if start < options.max_distance_mm {
            let expected = "at least max_distance_mm";
            return Err(validate::out_of_range("start_distance_mm", start, expected));
        }
    }
    if options.max_iterations == 0 {
        return Err(validate::out_of_range("max_iterations", 0.0, "at least 1"));
    }
    if options.min_points <= N_UNKNOWNS {
        let value = options.min_points as f64;
        return Err(validate::out_of_range("min_points", value, "at least 7"));
    }
    Ok(())
}

/// State of the iteration. All buffers live here and are refilled, never reallocated.
struct Search<'a, S: ?Sized> {
    surface: &'a S,
    cloud: &'a Cloud,
    options: &'a RefineOptions,
    pose: CenteredPose,
    samples: Vec<Sample>,
    candidate_samples: Vec<Sample>,
    residuals: Vec<f64>,
    scale_mm: Option<f64>,
    history: Vec<RefineStep>,
    iterations: usize,
    n_evaluations: usize,
}

impl<'a, S: ReferenceSurface + ?Sized> Search<'a, S> {
    fn new(
        surface: &'a S,
        cloud: &'a Cloud,
        initial: &Isometry3<f64>,
        options: &'a RefineOptions,
    ) -> Self {
        let n = cloud.levers.len();
        Self {
            surface,
            cloud,
            options,
            pose: CenteredPose::new(initial, &cloud.center),
            samples: Vec::with_capacity(n),
            candidate_samples: Vec::with_capacity(n),
            residuals: Vec::with_capacity(n),
            scale_mm: None,
            history: Vec::with_capacity(options.max_iterations + 1),
            iterations: 0,
            n_evaluations: 1,
        }
    }

    fn run(&mut self) -> Result<Termination, RegistrationError> {
        let first_gate = self.gate(0);
        sample(
            self.surface,
            self.cloud,
            &self.pose,
            first_gate,
            &mut self.samples,
        );
        let mut damping = 0.0;
        loop {
            let gate_mm = self.gate(self.iterations);
            let n_within = self.count_within(gate_mm)?;
            let (scale_mm, is_limited) = self.next_scale(gate_mm);
            let weighting = Weighting {
                kernel: self.options.kernel,
                scale_mm,
                gate_mm,
            };
            let equations = weighting.normal_equations(&self.samples, self.cloud.radius);
            let cost = weighting.cost(&self.samples);
            let mut step = equations.solve(damping, gate_mm);
            self.history.push(RefineStep {
                gate_mm,
                scale_mm,
                n_within,
                cost,
                translation_mm: step.translation_mm.norm(),
                rotation_rad: step.rotation.norm(),
            });
            // The step that is too short to matter is not taken: looking all points up again would
            // cost as much as a whole iteration.
            let gate_is_final = gate_mm <= self.options.max_distance_mm;
            let is_settled =
                !is_limited && step.weighted_length_mm <= self.options.noise_tolerance * scale_mm;
            if gate_is_final && (is_settled || self.is_tiny(&step)) {
                return Ok(Termination::Converged);
            }
            if self.iterations == self.options.max_iterations {
                return Ok(Termination::MaxIterations);
            }
            let mut is_lower = self.try_step(&step, &weighting, cost);
            for _ in 0..MAX_RETRIES {
                if is_lower || step.weighted_length_mm <= WORTH_A_RETRY * scale_mm {
                    break;
                }
                damping = (damping * DAMPING_GROWTH).max(FIRST_DAMPING);
                step = equations.solve(damping, gate_mm);
                is_lower = self.try_step(&step, &weighting, cost);
            }
            if is_lower {
                damping = if damping <= FIRST_DAMPING {
                    0.0
                } else {
                    damping / DAMPING_GROWTH
                };
                self.iterations += 1;
            } else if gate_is_final && !is_limited {
                return Ok(Termination::Stalled);
            } else {
                // Nothing to gain at this gate and scale, but the next ones may differ.
                damping = 0.0;
                self.iterations += 1;
            }
        }
    }

    /// Geometric from the start to the end.
    fn gate(&self, iteration: usize) -> f64 {
        let end = self.options.max_distance_mm;
        let n = self.options.anneal_iterations;
        match self.options.start_distance_mm {
            Some(start) if iteration < n => {
                end * (start / end).powf(1.0 - iteration as f64 / n as f64)
            }
            _ => end,
        }
    }

    fn count_within(&self, gate_mm: f64) -> Result<usize, RegistrationError> {
        let n_within = self.samples.iter().filter(|s| s.is_within(gate_mm)).count();
        if n_within < self.options.min_points {
            return Err(RegistrationError::TooFewWithinReach {
                n_within,
                n_points: self.samples.len(),
                n_needed: self.options.min_points,
                max_distance_mm: gate_mm,
            });
        }
        Ok(n_within)
    }

    /// The scale to use now, and whether it is held above its estimate.
    fn next_scale(&mut self, gate_mm: f64) -> (f64, bool) {
        let estimate = Weighting::scale_of(&self.samples, gate_mm, &mut self.residuals)
            .max(MIN_SCALE * self.cloud.radius);
        let lowest = self
            .scale_mm
            .map_or(0.0, |previous| previous * MAX_SCALE_FALL);
        let scale = estimate.max(lowest);
        self.scale_mm = Some(scale);
        (scale, estimate < lowest)
    }

    fn is_tiny(&self, step: &Step) -> bool {
        let tolerance = self.options.step_tolerance;
        step.rotation.norm() <= tolerance
            && step.translation_mm.norm() <= tolerance * self.cloud.radius
    }

    /// Moves there unless the cost rises.
    fn try_step(&mut self, step: &Step, weighting: &Weighting, cost: f64) -> bool {
        let candidate = self.pose.stepped(step);
        let gate = weighting.gate_mm;
        sample(
            self.surface,
            self.cloud,
            &candidate,
            gate,
            &mut self.candidate_samples,
        );
        self.n_evaluations += 1;
        let new_cost = weighting.cost(&self.candidate_samples);
        if new_cost.is_nan() || new_cost > cost {
            return false;
        }
        self.pose = candidate;
        std::mem::swap(&mut self.samples, &mut self.candidate_samples);
        true
    }

    fn finish(
        mut self,
        target_points: &[Point3<f64>],
        termination: Termination,
    ) -> Result<Refinement, RegistrationError> {
        let gate_mm = self.options.max_distance_mm;
        let n_within = self.count_within(gate_mm)?;
        let estimate = Weighting::scale_of(&self.samples, gate_mm, &mut self.residuals);
        let freedom = n_within as f64 / (n_within - N_UNKNOWNS) as f64;
        let noise_mm = estimate * freedom.sqrt();
        let floor = MIN_SCALE * self.cloud.radius;
        let scale_mm = estimate.max(floor);
        let weighting = Weighting {
            kernel: self.options.kernel,
            scale_mm,
            gate_mm,
        };

        let limit = INLIER_SIGMA * noise_mm.max(floor);
        let is_inlier = |s: &Sample| s.is_within(gate_mm) && s.residual.abs() <= limit;
        let inliers: Vec<bool> = self.samples.iter().map(is_inlier).collect();
        let (mut n_inliers, mut sum) = (0_usize, 0.0);
        for s in self.samples.iter().filter(|s| is_inlier(s)) {
            n_inliers += 1;
            sum += s.residual.powi(2);
        }
        let target_from_source = self.pose.target_from_source(&self.cloud.center);
        let covariance = self.covariance(target_points, &target_from_source, &weighting)?;
        Ok(Refinement {
            target_from_source,
            rmse_mm: (sum / n_inliers.max(1) as f64).sqrt(),
            noise_mm,
            inliers,
            n_inliers,
            covariance,
            iterations: self.iterations,
            n_evaluations: self.n_evaluations,
            termination,
            history: self.history,
        })
    }

    /// `V = s² [Σ ψ² / (n - 6)] / [Σ ψ' / n]² (Σ a aᵀ)⁻¹` over the support of the kernel.
    fn covariance(
        &self,
        target_points: &[Point3<f64>],
        target_from_source: &Isometry3<f64>,
        weighting: &Weighting,
    ) -> Result<PoseCovariance, RegistrationError> {
        let Weighting {
            kernel,
            scale_mm,
            gate_mm,
        } = *weighting;
        let support = kernel.support();
        let members = || {
            self.samples
                .iter()
                .zip(target_points)
                .filter(|(s, _)| s.is_within(gate_mm) && s.residual.abs() <= support * scale_mm)
        };
        let n = members().count();
        if n <= N_UNKNOWNS {
            return Err(RegistrationError::TooFewPoints {
                n_points: n,
                n_needed: N_UNKNOWNS + 1,
            });
        }
        let middle = self.cloud.center;
        let shift = members()
            .map(|(_, p)| p - middle)
            .sum::<nalgebra::Vector3<f64>>();
        let center = middle + shift / n as f64;

        let (mut energy, mut bend) = (0.0, 0.0);
        let mut information = Matrix6::zeros();
        for (s, p) in members() {
            let u = s.residual / scale_mm;
            energy += (u * kernel.weight(u)).powi(2);
            bend += kernel.curvature(u);
            let normal = target_from_source.rotation * s.normal;
            let a = constraint(&(p - center), &normal);
            information.ger(1.0, &a, &a, 1.0);
        }
        let count = n as f64;
        // Rounding of exact data must not make the pose look perfect: at least the floor.
        let variance = (energy * scale_mm.powi(2) / (count - N_UNKNOWNS as f64))
            .max((MIN_SCALE * self.cloud.radius).powi(2));
        // The mean curvature is 0.8 on normal residuals; a cluttered scene must not divide by 0.
        let mean_bend = (bend / count).max(0.1);
        let unit = covariance_of(&information, self.cloud.radius, &center)?;
        Ok(unit.scaled(variance / mean_bend.powi(2)))
    }
}

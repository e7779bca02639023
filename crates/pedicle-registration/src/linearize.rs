//! One linearisation of the point-to-surface problem: residuals, weights, normal equations.
//!
//! In the source frame a target point sits at `x = o + R y`, with `y = p - c` its place about the
//! middle c of the target points and o the image of c. Turning by ω about o and shifting by t
//! changes the residual `r = n·(x - q)` by `aᵀ [ω; t]`, `a = [ R y × n ; n ]`. Levers are divided
//! by the radius of the points, so that all six unknowns are lengths.

use nalgebra::{
    Isometry3, Matrix6, Point3, SymmetricEigen, Translation3, UnitQuaternion, Vector3, Vector6,
};

use crate::ReferenceSurface;
use crate::covariance::{MIN_EIGENVALUE_RATIO, constraint};
use crate::kernel::{RobustKernel, robust_scale};

/// Damping of directions the surface hardly determines, relative to the largest eigenvalue.
const WEAK_DAMPING: f64 = 1e-6;

/// Largest turn of one step, rad: the linearisation is off by 3 per cent of the lever there.
const MAX_TURN_RAD: f64 = 0.25;

/// Target points about their middle, and how far they reach.
pub(crate) struct Cloud {
    pub(crate) levers: Vec<Vector3<f64>>,
    pub(crate) center: Point3<f64>,
    pub(crate) radius: f64,
}

impl Cloud {
    /// The middle is the median of each coordinate and the radius a median distance: stray points
    /// far away must not spoil the conditioning.
    pub(crate) fn new(points: &[Point3<f64>]) -> Self {
        let mut buffer: Vec<f64> = Vec::with_capacity(points.len());
        let mut median = |values: &mut dyn Iterator<Item = f64>| {
            buffer.clear();
            buffer.extend(values);
            let middle = buffer.len() / 2;
            *buffer.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        let center = Point3::new(
            median(&mut points.iter().map(|p| p.x)),
            median(&mut points.iter().map(|p| p.y)),
            median(&mut points.iter().map(|p| p.z)),
        );
        let levers: Vec<_> = points.iter().map(|p| p - center).collect();
        let radius = median(&mut levers.iter().map(|y| y.norm()));
        Self {
            levers,
            center,
            radius,
        }
    }
}

/// `x = origin + rotation y`: the pose, held so that far coordinates do not cost digits.
#[derive(Clone, Copy)]
pub(crate) struct CenteredPose {
    rotation: UnitQuaternion<f64>,
    origin: Point3<f64>,
}

impl CenteredPose {
    pub(crate) fn new(target_from_source: &Isometry3<f64>, center: &Point3<f64>) -> Self {
        Self {
            rotation: target_from_source.rotation.inverse(),
            origin: target_from_source.inverse_transform_point(center),
        }
    }

    pub(crate) fn target_from_source(&self, center: &Point3<f64>) -> Isometry3<f64> {
        let rotation = self.rotation.inverse();
        Isometry3::from_parts(
            Translation3::from(center - rotation * self.origin),
            rotation,
        )
    }

    pub(crate) fn stepped(&self, step: &Step) -> Self {
        let mut rotation = UnitQuaternion::from_scaled_axis(step.rotation) * self.rotation;
        rotation.renormalize();
        Self {
            rotation,
            origin: self.origin + step.translation_mm,
        }
    }
}

/// What one target point sees, in the source frame.
#[derive(Clone, Copy)]
pub(crate) struct Sample {
    pub(crate) lever: Vector3<f64>,
    pub(crate) normal: Vector3<f64>,
    /// Point-to-plane residual, mm.
    pub(crate) residual: f64,
    /// Distance to the nearest surface point, infinite beyond the gate.
    pub(crate) distance: f64,
}

impl Sample {
    /// Written so that NaN from a broken surface is outside.
    pub(crate) fn is_within(&self, gate: f64) -> bool {
        self.distance <= gate && self.residual.is_finite()
    }
}

/// Looks up every point. Clears and refills `samples`.
pub(crate) fn sample<S: ReferenceSurface + ?Sized>(
    surface: &S,
    cloud: &Cloud,
    pose: &CenteredPose,
    gate: f64,
    samples: &mut Vec<Sample>,
) {
    let rotation = pose.rotation.to_rotation_matrix();
    samples.clear();
    samples.extend(cloud.levers.iter().map(|y| {
        let lever = rotation * y;
        let query = pose.origin + lever;
        match surface.closest_within(&query, gate) {
            Some(hit) => Sample {
                lever,
                normal: hit.normal,
                residual: hit.normal.dot(&(query - hit.point)),
                distance: hit.distance_mm,
            },
            None => Sample {
                lever,
                normal: Vector3::zeros(),
                residual: f64::INFINITY,
                distance: f64::INFINITY,
            },
        }
    }));
}

/// How residuals count in one iteration.
#[derive(Clone, Copy)]
pub(crate) struct Weighting {
    pub(crate) kernel: RobustKernel,
    pub(crate) scale_mm: f64,
    pub(crate) gate_mm: f64,
}

impl Weighting {
    pub(crate) fn scale_of(samples: &[Sample], gate: f64, buffer: &mut Vec<f64>) -> f64 {
        buffer.clear();
        let within = samples.iter().filter(|s| s.is_within(gate));
        buffer.extend(within.map(|s| s.residual.abs()));
        robust_scale(buffer, gate)
    }

    /// Mean cost. A point beyond the gate costs what one at the gate does, so that crossing the
    /// gate changes nothing.
    pub(crate) fn cost(&self, samples: &[Sample]) -> f64 {
        let at_gate = self.kernel.cost(self.gate_mm / self.scale_mm);
        let sum: f64 = samples
            .iter()
            .map(|s| {
                if s.is_within(self.gate_mm) {
                    self.kernel.cost(s.residual / self.scale_mm)
                } else {
                    at_gate
                }
            })
            .sum();
        sum / samples.len() as f64
    }

    /// `Σ w a aᵀ` and `Σ w a r` with levers in units of `radius`.
    pub(crate) fn normal_equations(&self, samples: &[Sample], radius: f64) -> NormalEquations {
        let mut matrix = Matrix6::zeros();
        let mut gradient = Vector6::zeros();
        for s in samples.iter().filter(|s| s.is_within(self.gate_mm)) {
            let weight = self.kernel.weight(s.residual / self.scale_mm);
            if weight <= 0.0 {
                continue;
            }
            let a = constraint(&(s.lever / radius), &s.normal);
            gradient.axpy(weight * s.residual, &a, 1.0);
            // Only the lower triangle; the eigenvalue solver reads no other.
            for j in 0..6 {
                let factor = weight * a[j];
                for i in j..6 {
                    matrix[(i, j)] += factor * a[i];
                }
            }
        }
        for j in 0..6 {
            for i in 0..j {
                matrix[(i, j)] = matrix[(j, i)];
            }
        }
        NormalEquations {
            eigen: SymmetricEigen::new(matrix),
            gradient,
            radius,
        }
    }
}

/// A change of pose in the source frame, about the image of the middle of the target points.
#[derive(Clone, Copy)]
pub(crate) struct Step {
    pub(crate) rotation: Vector3<f64>,
    pub(crate) translation_mm: Vector3<f64>,
    /// `√(δᵀ H δ)`, mm: over the noise it is the length of the step in standard errors.
    pub(crate) weighted_length_mm: f64,
}

pub(crate) struct NormalEquations {
    eigen: SymmetricEigen<f64, nalgebra::U6>,
    gradient: Vector6<f64>,
    radius: f64,
}

impl NormalEquations {
    /// `-(H + λ I)⁻¹ g`, λ = `damping` times the largest eigenvalue, and at least the weak
    /// damping if H is nearly singular. Long steps are cut to a trust region.
    pub(crate) fn solve(&self, damping: f64, max_translation_mm: f64) -> Step {
        let largest = self.eigen.eigenvalues.amax();
        let is_weak = self.eigen.eigenvalues.min() < MIN_EIGENVALUE_RATIO * largest;
        let damping = if is_weak {
            damping.max(WEAK_DAMPING)
        } else {
            damping
        };
        let mut delta = Vector6::zeros();
        let mut squared = 0.0;
        let modes = self
            .eigen
            .eigenvalues
            .iter()
            .zip(self.eigen.eigenvectors.column_iter());
        for (value, vector) in modes {
            let stiffness = value.max(0.0) + damping * largest;
            if stiffness <= 0.0 {
                continue;
            }
            let amount = -vector.dot(&self.gradient) / stiffness;
            delta.axpy(amount, &vector, 1.0);
            squared += value.max(0.0) * amount * amount;
        }
        let rotation = delta.fixed_rows::<3>(0) / self.radius;
        let translation = delta.fixed_rows::<3>(3).into_owned();
        let excess = (rotation.norm() / MAX_TURN_RAD).max(translation.norm() / max_translation_mm);
        let share = if excess > 1.0 { 1.0 / excess } else { 1.0 };
        Step {
            rotation: rotation * share,
            translation_mm: translation * share,
            weighted_length_mm: squared.sqrt() * share,
        }
    }
}

//! What noisy points say of a smooth deformation of a bone.
//!
//! ```text
//! ∂ log p(x) / ∂e_ck = Σ_j r_j(x) (x - s_j)_c φ_k(s_j) / σ²,   s_j → s_j + Σ_k e_k φ_k(s_j)
//! ∂ log p(x) / ∂w_k  = Σ_j r_j(x) d_k(s_j) - Σ_j w_j d_k(s_j) / Σ_j w_j
//! ```
//!
//! p, r and s are those of [`crate::blurred_bone`], the fields φ_k those of [`crate::shape_basis`] along the axes c of the vertebra, d the
//! regions and [`crate::bends`], by which points may lie more densely, and the edge of what is seen ([`crate::seen_edge`]). Source frame, mm.

use nalgebra::DMatrix;
use pedicle_trajectory::AnatomicalFrame;

use crate::bends::N_BENDS;
use crate::blurred_bone::{Blur, BlurredBone, N_FREE, RIDGE_POINTS};
use crate::facing::FacingPoint;
use crate::seen_edge::{N_EDGE, OfEdge, RIDGE_OF_EDGE};
use crate::shape_basis::{ShapeBasis, along_axes};

/// Information on the weight of a bend that no point tells, points.
pub(crate) const RIDGE_OF_BENDS_POINTS: f64 = 1.0;

/// A bone whose shape may change.
pub(crate) struct Deformable<'a> {
    blurred: &'a BlurredBone,
    frame: &'a AnatomicalFrame,
    blur: &'a Blur,
    /// φ, a column a place.
    fields: DMatrix<f64>,
    /// Mean over the density of what places say of the edge.
    by_edge: OfEdge,
    /// Mean of what the weights are of, over the density.
    expected: Vec<f64>,
}

impl<'a> Deformable<'a> {
    pub(crate) fn new(
        (blurred, blur): (&'a BlurredBone, &'a Blur),
        frame: &'a AnatomicalFrame,
        basis: &ShapeBasis,
    ) -> Self {
        let mut expected = blurred.expected(blur);
        expected.extend((0..N_BENDS).map(|k| blurred.mean(blur, |j| blurred.bends[j][k])));
        Self {
            fields: basis.fields(&blurred.places, &blurred.center, frame),
            blurred,
            frame,
            blur,
            by_edge: blurred.mean_by_edge(blur),
            expected,
        }
    }

    /// Numbers of pose, σ, the edge and weights, which come first in a column.
    pub(crate) fn n_free(&self) -> usize {
        N_FREE + N_EDGE + self.expected.len()
    }

    /// Numbers of a deformation, which come last.
    pub(crate) fn n_modes(&self) -> usize {
        3 * self.fields.nrows()
    }

    /// What is known of every weight before any point is seen: information, points.
    pub(crate) fn ridge(&self, number: usize) -> f64 {
        match number {
            0..N_FREE => 0.0,
            _ if number < N_FREE + N_EDGE => RIDGE_OF_EDGE,
            _ if number < self.n_free() - N_BENDS => RIDGE_POINTS,
            _ => RIDGE_OF_BENDS_POINTS,
        }
    }

    /// A column a point that lies near a place: the derivatives of its log density by pose, σ, the edge, weights and deformation.
    pub(crate) fn said_of(&self, points: impl IntoIterator<Item = FacingPoint>) -> DMatrix<f64> {
        let n_numbers = self.n_free() + self.n_modes();
        let n_fields = self.fields.nrows();
        let variance = self.blur.sigma_mm * self.blur.sigma_mm;
        let mut all = Vec::new();
        let n_points = self.blurred.each_said(points, self.blur, |said| {
            let start = all.len();
            all.resize(start + n_numbers, 0.0);
            let column = &mut all[start..];
            column[..N_FREE].copy_from_slice(said.free.as_slice());
            let of_edge = self
                .blurred
                .said_of_edge(self.blur, said.shown, &self.by_edge);
            column[N_FREE..N_FREE + N_EDGE].copy_from_slice(of_edge.as_slice());
            let (weights, modes) = column[N_FREE + N_EDGE..].split_at_mut(self.expected.len());
            for (weight, expected) in weights.iter_mut().zip(&self.expected) {
                *weight = -expected;
            }
            self.blurred.add_regions(said.shown, weights);
            let of_bends = &mut weights[self.expected.len() - N_BENDS..];
            for &(j, r) in said.shown {
                let j = j as usize;
                for (weight, bend) in of_bends.iter_mut().zip(&self.blurred.bends[j]) {
                    *weight += r * bend;
                }
                // Moving a place by a field moves the density with it: the noise (x - s) / σ² along the field.
                let away = (said.point.position - self.blurred.places[j]) * (r / variance);
                let field = self.fields.column(j);
                let along = along_axes(self.frame, &away);
                for (modes, along) in modes.chunks_exact_mut(n_fields).zip(along.iter()) {
                    for (mode, field) in modes.iter_mut().zip(field.as_slice()) {
                        *mode += along * field;
                    }
                }
            }
        });
        DMatrix::from_vec(n_numbers, n_points, all)
    }
}

//! How a bone bends at its places: triangulated surfaces have more vertices where they do.
//!
//! ```text
//! v_r = λ₀ / (λ₀ + λ₁ + λ₂),   b_r = n · ⟨s_j - s⟩ / r,   |b_r|      over the places within r of s
//! ```
//!
//! λ are the variances along the principal axes of the neighbours, the least first (the surface variation of Pauly et al. 2002), n the normal: b is below zero on
//! ridges and above it in grooves. Meshes simplified by a measure of their distance from the surface, and scans whose points were chosen so, have
//! so many points where these numbers are large that processes seem to be longer and edges sharper than they are. Taken as unknown weights,
//! exp(Σ_k w_k d_k(s)), they explain that.
//!
//! |b| at the smaller radius alone says most of how vertices crowd, and is a weight in the fit that the shape is asked about as well.
//!
//! Each number is over all places brought to 0 in the mean and 1 in the root mean square, and then to 3 at most. Where fewer than 8 places lie within r, the nearest 8 count.

use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};
use pedicle_registration::ReferenceSurface;

use crate::SpineError;
use crate::bone::BoneSurface;
use crate::local_shape::tree_of;

/// Radii of the neighbourhoods, mm.
const RADII_MM: [f64; 2] = [4.0, 8.0];
/// Neighbours, the place itself among them, that there are at least.
const LEAST: usize = 8;
/// Numbers a place.
pub(crate) const N_BENDS: usize = 3 * RADII_MM.len();
/// The number that tells most of how vertices crowd: |b| at the smaller radius.
pub(crate) const CROWDED: usize = 2;
/// Places that have numbers: some 2 mm apart.
const N_PLACES: usize = 4000;
/// Largest number, in standard deviations.
const LARGEST: f64 = 3.0;

/// How a bone bends everywhere.
#[derive(Debug)]
pub(crate) struct Bends {
    tree: ImmutableKdTree<f64, 3>,
    numbers: Vec<[f64; N_BENDS]>,
}

impl Bends {
    pub(crate) fn of(bone: &BoneSurface) -> Result<Self, SpineError> {
        let places = bone.spread_points(N_PLACES);
        let tree = tree_of(&places)?;
        Ok(Self {
            numbers: bends(bone, &places, &tree),
            tree,
        })
    }

    /// The numbers at a place: of the nearest one that has some.
    pub(crate) fn at(&self, place: &Point3<f64>) -> [f64; N_BENDS] {
        let row: [f64; 3] = place.coords.into();
        let nearest = self.tree.query(&row).nearest_one::<SquaredEuclidean<f64>>();
        self.numbers[nearest.execute().item as usize]
    }
}

/// The numbers of every place of a bone, which `tree` holds.
fn bends(
    bone: &BoneSurface,
    places: &[Point3<f64>],
    tree: &ImmutableKdTree<f64, 3>,
) -> Vec<[f64; N_BENDS]> {
    let mut all: Vec<[f64; N_BENDS]> = places
        .iter()
        .map(|place| {
            let normal = bone.closest(place).normal;
            let mut numbers = [0.0; N_BENDS];
            for (three, radius_mm) in numbers.chunks_exact_mut(3).zip(RADII_MM) {
                let (variation, bend) = bend(place, &normal, radius_mm, (places, tree));
                three.copy_from_slice(&[variation, bend, bend.abs()]);
            }
            numbers
        })
        .collect();
    let n = all.len() as f64;
    for k in 0..N_BENDS {
        let mean = all.iter().map(|row| row[k]).sum::<f64>() / n;
        let square = all.iter().map(|row| (row[k] - mean).powi(2)).sum::<f64>() / n;
        let deviation = square.sqrt();
        for row in &mut all {
            let number = (row[k] - mean) / deviation;
            row[k] = if number.is_finite() {
                number.clamp(-LARGEST, LARGEST)
            } else {
                0.0
            };
        }
    }
    all
}

/// Surface variation and bend of one place.
fn bend(
    place: &Point3<f64>,
    normal: &Vector3<f64>,
    radius_mm: f64,
    (places, tree): (&[Point3<f64>], &ImmutableKdTree<f64, 3>),
) -> (f64, f64) {
    let row: [f64; 3] = place.coords.into();
    let near = tree
        .query(&row)
        .within::<SquaredEuclidean<f64>>(radius_mm * radius_mm)
        .unsorted()
        .execute();
    let mut indices: Vec<u32> = near.into_iter().map(|item| item.item).collect();
    if indices.len() < LEAST {
        let nearest = tree
            .query(&row)
            .nearest_n::<SquaredEuclidean<f64>>(NonZero::<usize>::MIN.saturating_add(LEAST - 1))
            .execute();
        indices = nearest.into_iter().map(|item| item.item).collect();
    }
    // Sums depend on the order.
    indices.sort_unstable();
    let n = indices.len() as f64;
    let offsets = || indices.iter().map(|&j| places[j as usize] - place);
    let mean: Vector3<f64> = offsets().sum::<Vector3<f64>>() / n;
    let spread: Matrix3<f64> = offsets()
        .map(|d| (d - mean) * (d - mean).transpose())
        .sum::<Matrix3<f64>>()
        / n;
    let variances = SymmetricEigen::new(spread).eigenvalues;
    let total = variances.sum();
    let variation = if total > 0.0 {
        variances.min() / total
    } else {
        0.0
    };
    (variation, normal.dot(&mean) / radius_mm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pedicle_mesh::TriMesh;

    /// The surface of a box, in triangles of some millimetres, and without doubled vertices.
    fn boxed(edge_mm: f64, n: usize) -> TriMesh {
        let step = edge_mm / n as f64;
        let mut known = std::collections::BTreeMap::new();
        let mut vertices = Vec::new();
        let mut faces = Vec::new();
        for (axis, side) in [(0, 0), (0, n), (1, 0), (1, n), (2, 0), (2, n)] {
            for (i, k) in (0..n).flat_map(|i| (0..n).map(move |k| (i, k))) {
                let corners = [(i, k), (i + 1, k), (i + 1, k + 1), (i, k + 1)].map(|(i, k)| {
                    let mut at = [0; 3];
                    (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) = (side, i, k);
                    *known.entry(at).or_insert_with(|| {
                        vertices.push(Point3::from(at.map(|x| x as f64 * step)));
                        vertices.len() as u32 - 1
                    })
                });
                let [a, b, c, d] = corners;
                let two = [[a, b, c], [a, c, d]];
                faces.extend(two.map(|[a, b, c]| if side == 0 { [a, c, b] } else { [a, b, c] }));
            }
        }
        TriMesh::new(vertices, faces).unwrap()
    }

    #[test]
    fn edges_bend_outward_and_faces_do_not() {
        let mesh = boxed(40.0, 20);
        let bone = BoneSurface::new(&mesh).unwrap();
        let places = bone.spread_points(4000);
        let all = bends(&bone, &places, &tree_of(&places).unwrap());
        // How many walls a place lies near to.
        let walls = |p: &Point3<f64>| p.iter().filter(|x| **x < 2.0 || **x > 38.0).count();
        for (k, three) in [[0, 1, 2], [3, 4, 5]].into_iter().enumerate() {
            let mean = |number: usize, n_walls: usize| {
                let chosen = places.iter().zip(&all).filter(|(p, _)| walls(p) == n_walls);
                let numbers: Vec<f64> = chosen.map(|(_, row)| row[number]).collect();
                numbers.iter().sum::<f64>() / numbers.len() as f64
            };
            let [variation, bend, size] = three;
            assert!(
                mean(variation, 2) > 1.0 && mean(variation, 1) < 0.0,
                "radius {k}"
            );
            assert!(mean(bend, 2) < -1.0 && mean(bend, 1) > 0.0, "radius {k}");
            assert!(mean(size, 2) > 1.0 && mean(size, 1) < 0.0, "radius {k}");
        }
        for number in 0..N_BENDS {
            let sum: f64 = all.iter().map(|row| row[number]).sum();
            assert!((sum / all.len() as f64).abs() < 0.1, "0 in the mean");
            assert!(all.iter().all(|row| row[number].abs() <= LARGEST));
        }
    }

    #[test]
    fn places_too_few_for_a_radius_have_their_nearest_ones() {
        let mesh = boxed(40.0, 4);
        let bone = BoneSurface::new(&mesh).unwrap();
        let places = bone.spread_points(40);
        let all = bends(&bone, &places, &tree_of(&places).unwrap());
        assert!(all.iter().flatten().all(|number| number.is_finite()));
        // The same for places that are one: nothing can be said of them, and nothing is.
        let one = vec![places[0]; 20];
        let none = bends(&bone, &one, &tree_of(&one[..1]).unwrap());
        assert_eq!(none, vec![[0.0; N_BENDS]; 20]);
    }
}

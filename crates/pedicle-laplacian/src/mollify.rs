//! Intrinsic mollification.
//!
//! ```text
//! ε = max over faces and corners of max(0, δ + l_opposite - l_next - l_last),   l ← l + ε
//! ```
//!
//! After it every face satisfies the triangle inequality with the margin δ. Lengths only: no
//! vertex moves. Sharp & Crane 2020, section 4.5.

/// Lengths opposite the corners of every face, and the ε that was added.
pub(crate) struct MollifiedLengths {
    pub(crate) lengths: Vec<[f64; 3]>,
    pub(crate) added: f64,
}

/// Adds the smallest ε to all lengths that gives every face the margin `relative_margin` × mean length.
pub(crate) fn mollify(mut lengths: Vec<[f64; 3]>, relative_margin: f64) -> MollifiedLengths {
    let sum: f64 = lengths.iter().flatten().sum();
    let margin = relative_margin * sum / (3 * lengths.len()) as f64;
    let mut added = 0.0_f64;
    for l in &lengths {
        for i in 0..3 {
            added = added.max(margin + l[i] - l[(i + 1) % 3] - l[(i + 2) % 3]);
        }
    }
    if added > 0.0 {
        for l in lengths.iter_mut().flatten() {
            *l += added;
        }
    }
    MollifiedLengths { lengths, added }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn good_lengths_stay() {
        let before = vec![[3.0, 4.0, 5.0], [1.0, 1.0, 1.0]];
        let after = mollify(before.clone(), 1e-5);
        assert_eq!(after.lengths, before, "no length may change");
    }

    #[test]
    fn flat_face_gets_exactly_the_margin() {
        let after = mollify(vec![[2.0, 1.0, 1.0], [2.0, 2.0, 2.0]], 1e-3);
        let [a, b, c] = after.lengths[0];
        let margin = 1e-3 * 10.0 / 6.0;
        assert!(
            (b + c - a - margin).abs() < 1e-15,
            "margin of the flat face"
        );
        assert!((after.added - margin).abs() < 1e-15, "length added");
    }
}

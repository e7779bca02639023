//! The published table: RMSE per vertebra over ten draws, mm and degrees.
//!
//! V1 is taken as the lowest vertebra (L5), as the deformation counts from the lowest; the
//! comparison rests on means over the five and does not depend on it. The publication states
//! 100 % valid trajectories in every cell.

/// One row of the table: V1 to V5, linear (mm) and angular (°).
struct Row {
    deformation: &'static str,
    noise_mm: f64,
    figures: [(f64, f64); 5],
}

const TABLE: [Row; 9] = [
    Row {
        deformation: "rigid",
        noise_mm: 0.0,
        figures: [
            (0.007, 0.005),
            (0.005, 0.003),
            (0.001, 0.002),
            (0.010, 0.012),
            (0.004, 0.006),
        ],
    },
    Row {
        deformation: "rigid",
        noise_mm: 0.5,
        figures: [
            (0.32, 0.28),
            (0.27, 0.40),
            (0.13, 0.33),
            (0.23, 0.35),
            (0.57, 0.46),
        ],
    },
    Row {
        deformation: "rigid",
        noise_mm: 1.0,
        figures: [
            (1.21, 1.17),
            (0.52, 0.75),
            (0.49, 0.94),
            (0.60, 0.89),
            (1.20, 1.08),
        ],
    },
    Row {
        deformation: "non-rigid",
        noise_mm: 0.0,
        figures: [
            (0.007, 0.005),
            (0.005, 0.015),
            (0.004, 0.007),
            (0.011, 0.013),
            (0.004, 0.006),
        ],
    },
    Row {
        deformation: "non-rigid",
        noise_mm: 0.5,
        figures: [
            (0.48, 0.41),
            (0.25, 0.39),
            (0.12, 0.37),
            (0.24, 0.33),
            (0.38, 0.38),
        ],
    },
    Row {
        deformation: "non-rigid",
        noise_mm: 1.0,
        figures: [
            (1.31, 1.23),
            (0.48, 0.83),
            (0.43, 1.25),
            (0.86, 1.16),
            (1.59, 1.29),
        ],
    },
    Row {
        deformation: "partial",
        noise_mm: 0.0,
        figures: [
            (0.16, 0.00),
            (0.13, 0.01),
            (0.16, 0.30),
            (0.16, 0.00),
            (0.16, 0.00),
        ],
    },
    Row {
        deformation: "partial",
        noise_mm: 0.5,
        figures: [
            (0.92, 0.85),
            (0.46, 0.66),
            (0.30, 0.97),
            (0.48, 0.61),
            (0.88, 0.76),
        ],
    },
    Row {
        deformation: "partial",
        noise_mm: 1.0,
        figures: [
            (3.37, 3.04),
            (1.23, 1.83),
            (1.45, 4.39),
            (2.01, 4.83),
            (2.90, 2.71),
        ],
    },
];

/// Published RMSE of a vertebra, `index_from_top` 0 for L1: (mm, degrees).
pub(super) fn figure(
    deformation: &str,
    noise_mm: f64,
    index_from_top: usize,
) -> Option<(f64, f64)> {
    row(deformation, noise_mm).and_then(|row| row.figures.iter().rev().nth(index_from_top).copied())
}

/// Published RMSE averaged over the five vertebrae: (mm, degrees).
pub(super) fn mean(deformation: &str, noise_mm: f64) -> Option<(f64, f64)> {
    row(deformation, noise_mm).map(|row| {
        let sum = row
            .figures
            .iter()
            .fold((0.0, 0.0), |s, f| (s.0 + f.0, s.1 + f.1));
        (sum.0 / 5.0, sum.1 / 5.0)
    })
}

fn row(deformation: &str, noise_mm: f64) -> Option<&'static Row> {
    TABLE
        .iter()
        .find(|row| row.deformation == deformation && (row.noise_mm - noise_mm).abs() < 1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lowest_vertebra_is_the_first_of_the_row() {
        assert_eq!(figure("rigid", 0.5, 4), Some((0.32, 0.28)), "V1 is L5");
        assert_eq!(figure("rigid", 0.5, 0), Some((0.57, 0.46)), "V5 is L1");
        assert_eq!(figure("rigid", 2.0, 0), None, "not published");
    }

    #[test]
    fn means_are_those_of_the_rows() {
        // Added up by hand from the publication's table.
        let cases = [("rigid", 0.5, 1.52, 1.82), ("partial", 1.0, 10.96, 16.80)];
        for (deformation, noise_mm, sum_mm, sum_degrees) in cases {
            let (mm, degrees) = mean(deformation, noise_mm).unwrap();
            assert!((mm - sum_mm / 5.0).abs() < 1e-12, "{deformation}: {mm} mm");
            assert!(
                (degrees - sum_degrees / 5.0).abs() < 1e-12,
                "{deformation}: {degrees}°"
            );
        }
    }
}

//! The table of dimensions against itself and against a survey no number in it is taken from.

use pedicle_simulation::morphometry::{self as table, Origin, Provenance, TABLE};

#[test]
fn every_number_says_where_it_comes_from() {
    for row in TABLE {
        for origin in [row.mean_origin, row.deviation_origin] {
            assert!(!origin.source.is_empty(), "{} has no source", row.name);
            // A paper is named by its year.
            let names_a_paper = origin.source.contains("19") || origin.source.contains("20");
            assert!(
                names_a_paper || origin.provenance == Provenance::Construction,
                "{} names no paper: {}",
                row.name,
                origin.source
            );
        }
        assert!(row.mean.iter().all(|x| x.is_finite()), "{}", row.name);
        assert!(row.deviation.iter().all(|x| *x > 0.0), "{}", row.name);
    }
}

/// The counts that the header of the table and the README give.
#[test]
fn the_provenance_is_as_documented() {
    let count = |of: fn(&table::MorphometryRow) -> Origin| {
        [
            Provenance::Published,
            Provenance::Quoted,
            Provenance::Construction,
        ]
        .map(|p| TABLE.iter().filter(|row| of(row).provenance == p).count())
    };
    assert_eq!(count(|row| row.mean_origin), [7, 8, 12]);
    assert_eq!(count(|row| row.deviation_origin), [7, 1, 19]);
}

/// Panjabi 1992 gives standard errors of 12 spines.
#[test]
fn deviations_follow_from_the_published_standard_errors() {
    let rows = [
        (table::BODY_WIDTH_UPPER, [1.03, 0.74, 0.88, 1.20, 1.20]),
        (table::CANAL_WIDTH, [0.92, 0.71, 0.64, 0.49, 0.88]),
        (table::CANAL_DEPTH, [0.67, 0.53, 0.53, 0.71, 0.49]),
    ];
    for (row, errors) in rows {
        for (deviation, error) in row.deviation.iter().zip(errors) {
            let expected = error * 12_f64.sqrt();
            assert!(
                (deviation - expected).abs() < 0.05,
                "{}: {deviation} and {expected}",
                row.name
            );
        }
    }
}

/// Wedging of the bodies and height of the spinous process over that of the body lie between the
/// women and the men of Masharawi 2009, table 1, which no number is taken from.
#[test]
fn shapes_agree_with_a_survey_not_used() {
    let wedge_women = [2.6, 0.7, -1.1, -3.1, -7.8];
    let wedge_men = [4.1, 2.6, 1.3, -0.7, -4.6];
    let spinous_women = [0.79, 0.82, 0.79, 0.67, 0.57];
    let spinous_men = [0.87, 0.92, 0.91, 0.80, 0.67];
    for i in 0..5 {
        let front = table::BODY_HEIGHT_ANTERIOR.mean[i];
        let back = table::BODY_HEIGHT_POSTERIOR.mean[i];
        let depth = 0.5 * (table::BODY_DEPTH_UPPER.mean[i] + table::BODY_DEPTH_LOWER.mean[i]);
        let wedge = ((back - front) / depth).atan().to_degrees();
        assert!(
            (wedge_women[i]..=wedge_men[i]).contains(&wedge),
            "L{}: wedge {wedge}°",
            i + 1
        );
        let ratio = table::SPINOUS_HEIGHT.mean[i] / (0.5 * (front + back));
        assert!(
            (spinous_women[i]..=spinous_men[i]).contains(&ratio),
            "L{}: spinous process over body {ratio}",
            i + 1
        );
    }
}

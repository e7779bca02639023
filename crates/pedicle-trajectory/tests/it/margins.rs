use pedicle_trajectory::{MarginError, SafetyMargins};

#[test]
fn published_values() {
    let margins = SafetyMargins::new(6.0, 11.0, 20.0).unwrap();
    assert_eq!(margins, SafetyMargins::default(), "published screw");
    assert!((margins.lateral_gap_mm() - 2.5).abs() < 1e-12, "l_m");
    assert!((margins.max_translation_mm() - 2.5).abs() < 1e-12, "Δ_t");
    let degrees = margins.max_rotation_rad().to_degrees();
    assert!((degrees - 7.125).abs() < 1e-3, "Δ_R is {degrees}");
}

#[test]
fn both_margins_count() {
    let margins = SafetyMargins::default();
    let limit = margins.max_rotation_rad();
    assert!(margins.is_within(2.5, limit), "the limits themselves");
    assert!(!margins.is_within(2.51, 0.0), "translation");
    assert!(!margins.is_within(0.0, limit * 1.001), "rotation");
    assert!(!margins.is_within(f64::NAN, 0.0), "NaN translation");
    assert!(!margins.is_within(0.0, f64::NAN), "NaN rotation");
}

#[test]
fn rotation_does_not_depend_on_the_scale() {
    let reference = SafetyMargins::new(6.0, 11.0, 20.0).unwrap();
    for scale in [1e-3, 1e3] {
        let scaled = SafetyMargins::new(6.0 * scale, 11.0 * scale, 20.0 * scale).unwrap();
        let change = scaled.max_rotation_rad() - reference.max_rotation_rad();
        assert!(change.abs() < 1e-12, "scale {scale}");
    }
}

#[test]
fn bad_lengths_are_named() {
    for (s, p, d, what) in [
        (0.0, 11.0, 20.0, "screw"),
        (6.0, f64::NAN, 20.0, "pedicle"),
        (6.0, 11.0, f64::INFINITY, "isthmus"),
    ] {
        let error = SafetyMargins::new(s, p, d).unwrap_err();
        assert!(error.to_string().contains(what), "{error}");
    }
    assert_eq!(
        SafetyMargins::new(7.0, 7.0, 20.0),
        Err(MarginError::ScrewTooWide {
            screw_diameter_mm: 7.0,
            pedicle_width_mm: 7.0
        }),
        "no gap"
    );
}

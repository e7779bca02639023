//! Times and energies: one range for both shapes.

use pedicle_descriptors::{DescriptorError, HeatTimes, WaveEnergies};

use crate::shapes::{path, two_paths};

const DECAY: f64 = 4.0 * std::f64::consts::LN_10;

#[test]
fn times_run_between_the_ends_of_the_spectrum_above_the_null_space() {
    for (basis, first_above) in [(path(40, 20, 1.0), 1), (two_paths(20, 10), 2)] {
        let times = HeatTimes::joint(&basis, &basis, 7).unwrap();
        let lambda = &basis.eigenvalues;
        let times = times.as_slice();
        assert!((times[0] * lambda[lambda.len() - 1] / DECAY - 1.0).abs() < 1e-12);
        assert!((times[6] * lambda[first_above] / DECAY - 1.0).abs() < 1e-12);
        assert!(times.windows(2).all(|pair| pair[0] < pair[1]));
    }
}

#[test]
fn the_joint_range_is_the_common_one_and_symmetric() {
    let (small, large) = (path(40, 20, 1.0), path(40, 20, 1.5));
    let times = HeatTimes::joint(&small, &large, 5).unwrap();
    assert_eq!(times, HeatTimes::joint(&large, &small, 5).unwrap());
    assert!((times.as_slice()[0] * large.eigenvalues[19] / DECAY - 1.0).abs() < 1e-12);
    assert!((times.as_slice()[4] * small.eigenvalues[1] / DECAY - 1.0).abs() < 1e-12);
    let energies = WaveEnergies::joint(&small, &large, 5).unwrap();
    assert_eq!(energies, WaveEnergies::joint(&large, &small, 5).unwrap());
}

#[test]
fn energies_keep_their_margin_for_every_count() {
    let basis = path(60, 30, 1.0);
    let (low, high) = (basis.eigenvalues[1].ln(), basis.eigenvalues[29].ln());
    for n in [1, 2, 10, 28, 100] {
        let energies = WaveEnergies::joint(&basis, &basis, n).unwrap();
        let (e, s) = (energies.as_slice(), energies.spread());
        assert_eq!(e.len(), n);
        assert!(e[0] >= low + 2.0 * s - 1e-12 && e[n - 1] <= high - 2.0 * s + 1e-12);
        assert!(e.windows(2).all(|pair| pair[0] < pair[1]), "n = {n}");
        if n > 1 {
            assert!((s - 7.0 * (e[n - 1] - e[0]) / n as f64).abs() < 1e-12);
        }
    }
}

#[test]
fn bad_requests_are_refused() {
    let basis = path(40, 20, 1.0);
    assert_eq!(
        HeatTimes::joint(&basis, &basis, 0),
        Err(DescriptorError::NoSamples)
    );
    assert_eq!(
        WaveEnergies::joint(&basis, &basis.truncated(2), 4).unwrap_err(),
        DescriptorError::NothingAboveNullSpace {
            n_functions: 2,
            null_dimension: 1,
            needed: 2
        }
    );
    let only_null = two_paths(10, 5).truncated(2);
    let message = HeatTimes::joint(&basis, &only_null, 4)
        .unwrap_err()
        .to_string();
    assert!(message.contains("2 functions of which 2"), "{message}");
    assert!(matches!(
        HeatTimes::joint(&basis, &path(40, 20, 1e3), 4),
        Err(DescriptorError::DisjointSpectra { .. })
    ));
    let mut broken = basis.clone();
    broken.eigenvalues[1] = f64::NAN;
    assert!(matches!(
        HeatTimes::joint(&broken, &basis, 4),
        Err(DescriptorError::InvalidEigenvalue { index: 1, .. })
    ));
    assert_eq!(
        HeatTimes::new(vec![1.0, -1.0]),
        Err(DescriptorError::InvalidSample {
            index: 1,
            value: -1.0
        })
    );
    assert!(WaveEnergies::new(vec![f64::NAN], 1.0).is_err());
    assert_eq!(
        WaveEnergies::new(vec![0.0], 0.0),
        Err(DescriptorError::InvalidSpread { spread: 0.0 })
    );
}

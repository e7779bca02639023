//! The same bits on any number of threads.

use pedicle_mesh::concatenate;
use pedicle_spectral::{EigenOptions, EigenPairs, smallest_eigenpairs, smallest_eigenpairs_from};
use rayon::ThreadPoolBuilder;

use crate::shapes::{icosphere, operators, potato};

fn on_threads<R: Send>(n_threads: usize, work: impl FnOnce() -> R + Send) -> R {
    let pool = ThreadPoolBuilder::new().num_threads(n_threads).build();
    pool.unwrap().install(work)
}

fn assert_same_bits(a: &EigenPairs, b: &EigenPairs, n_threads: usize) {
    let bits = |values: &[f64]| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    assert_eq!(
        bits(&a.eigenvalues),
        bits(&b.eigenvalues),
        "eigenvalues on {n_threads} threads"
    );
    assert_eq!(bits(&a.residuals), bits(&b.residuals), "residuals");
    for j in 0..a.eigenvalues.len() {
        assert_eq!(
            bits(a.eigenvectors.col_as_slice(j)),
            bits(b.eigenvectors.col_as_slice(j)),
            "vector {j} on {n_threads} threads"
        );
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    // Large enough for several chunks of rows and for shared right-hand sides; and several blocks.
    let large = operators(&potato(5));
    let several = operators(&concatenate(&[&potato(3), &icosphere(4), &potato(2)]).unwrap());
    for (stiffness, mass) in [large, several] {
        for block_size in [8, 6] {
            let options = EigenOptions {
                block_size,
                ..EigenOptions::default()
            };
            let run = || {
                let first = smallest_eigenpairs(&stiffness, &mass, 12, &options).unwrap();
                let known = first.eigenvectors.as_ref();
                smallest_eigenpairs_from(&stiffness, &mass, 25, known, &options).unwrap()
            };
            let one = on_threads(1, run);
            for n_threads in [2, 3] {
                assert_same_bits(&on_threads(n_threads, run), &one, n_threads);
            }
        }
    }
}

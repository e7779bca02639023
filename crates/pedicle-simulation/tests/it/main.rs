//! Tests of the phantom, the scenarios and the metrics against what is known to be true.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

mod measured;
mod metrics;
mod morphometry;
mod phantom;
mod real_spines;
mod scenarios;
mod section;
mod sensor;
mod suites;

use std::sync::OnceLock;

use pedicle_simulation::{MeshingOptions, Phantom, PhantomParameters, SpineCase, generate_phantom};

/// Faces of the suite's spine.
const N_FACES: usize = 3_500;

/// The mean phantom, built once for all tests.
fn mean_phantom() -> &'static Phantom {
    static PHANTOM: OnceLock<Phantom> = OnceLock::new();
    PHANTOM.get_or_init(|| {
        generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap()
    })
}

/// The mean phantom as a case of the suite.
fn mean_case() -> &'static SpineCase {
    static CASE: OnceLock<SpineCase> = OnceLock::new();
    CASE.get_or_init(|| mean_phantom().spine_case(N_FACES).unwrap())
}

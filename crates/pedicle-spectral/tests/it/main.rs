//! Integration tests of pedicle-spectral.
#![allow(clippy::unwrap_used, reason = "a failed test may panic anywhere")]
#![allow(
    clippy::print_stdout,
    reason = "tests tell when the reference data are absent"
)]

mod analytic;
mod bad_input;
mod invariance;
mod references;
mod shapes;
mod threads;
mod warm;

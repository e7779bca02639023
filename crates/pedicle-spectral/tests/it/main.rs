//! Integration tests of pedicle-spectral.
#![allow(clippy::unwrap_used, reason = "a failed test may panic anywhere")]

mod references;
mod shapes;

//! Integration tests of pedicle-laplacian.
#![allow(clippy::unwrap_used, reason = "a failed test may panic anywhere")]

mod bad_input;
mod shapes;
mod truth;

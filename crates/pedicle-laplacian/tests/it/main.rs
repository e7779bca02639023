//! Integration tests of pedicle-laplacian.
#![allow(clippy::unwrap_used, reason = "a failed test may panic anywhere")]

mod bad_input;
mod boundary;
mod cloud;
mod delaunay;
mod random;
mod real;
mod refused;
mod robust;
mod shapes;
mod truth;

//! Integration tests of functional maps.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking, and says so if its data is absent"
)]

mod bad_input;
mod bijective;
mod energies;
mod known_maps;
mod results;
mod scoring;
mod shapes;
mod spine;

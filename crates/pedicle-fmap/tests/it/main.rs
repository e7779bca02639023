//! Integration tests of functional maps.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking, and says so if its data is absent"
)]

mod animal;
mod bad_input;
mod bent;
mod bijective;
mod energies;
mod known_maps;
mod refinements;
mod results;
mod scoring;
mod shapes;
mod spine;

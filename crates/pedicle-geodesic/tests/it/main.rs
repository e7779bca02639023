//! Integration tests of distances along surfaces.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod bad_input;
mod graph;
mod heat;
mod shapes;

//! Tests against shapes of known size, broken files, and a real label map where it is there.
#![allow(clippy::unwrap_used, reason = "a test may fail by panicking")]

mod bad_input;
mod orientations;
mod real;
mod schemes;
mod support;

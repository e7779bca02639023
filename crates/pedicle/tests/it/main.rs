//! The command line as a user calls it.
#![allow(
    clippy::unwrap_used,
    reason = "a test that cannot set its scene up must fail"
)]
#![allow(
    clippy::print_stdout,
    reason = "tests tell when the reference data are absent"
)]

mod bad_input;
mod clinical;
mod demo;
mod exchange;
mod glb;
mod map;
mod report;
mod spectrum;
mod support;
mod transfer;
mod zoo;

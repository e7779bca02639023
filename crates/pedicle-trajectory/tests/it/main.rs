//! Everything this crate promises, against truth.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking and says what it measured"
)]

mod check;
mod clinical;
mod formats;
mod frames;
mod margins;
mod markups;
mod planner;
mod real;

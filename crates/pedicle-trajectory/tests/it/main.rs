//! Everything this crate promises, against truth.

mod formats;
mod frames;
mod margins;
mod real;

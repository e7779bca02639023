//! Integration tests of the descriptors.

mod ranges;
mod shapes;
mod signatures;

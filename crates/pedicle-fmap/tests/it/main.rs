//! Integration tests of functional maps.

mod bad_input;
mod bijective;
mod energies;
mod known_maps;
mod scoring;
mod shapes;

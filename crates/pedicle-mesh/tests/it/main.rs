//! Integration tests of pedicle-mesh.

mod shapes;
mod simplify;
mod surface_index;

//! Integration tests of pedicle-mesh.

mod shapes;
mod surface_index;

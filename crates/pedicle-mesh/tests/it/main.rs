//! Integration tests of pedicle-mesh.

mod io;
mod io_hostile;
mod repair;
mod shapes;
mod simplify;
mod surface_index;
mod topology;
mod vtp;

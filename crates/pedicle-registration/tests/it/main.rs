//! Integration tests of `pedicle-registration`.

mod bad_input;
mod covariance;
mod kabsch;
mod msac;
mod refine;
mod shapes;
mod statistics;
mod surface;

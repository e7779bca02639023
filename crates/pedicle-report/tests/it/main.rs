//! Pages as a whole.
#![allow(
    clippy::unwrap_used,
    reason = "a test that cannot set its scene up must fail"
)]

mod figures;
mod page;

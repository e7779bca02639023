//! The command line as a user calls it.

mod bad_input;
mod demo;
mod support;
mod transfer;

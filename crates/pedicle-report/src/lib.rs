//! Reports as one self-contained HTML page: no network, no other file.
//!
//! ```text
//! Page = header + verdicts + Scene (WebGL2) + Section*,   Section = Block*,
//! Block = text | Table | Figure (SVG + CSV) | Card (a screw)
//! ```
//!
//! The inputs are plain structs: what a vertebra, a map or a benchmark is, is not known here. A page
//! holds no date, no time and no path of its own, so that the same inputs give the same bytes.
//!
//! | what | where |
//! |---|---|
//! | the page and its parts | [`Page`], [`Section`], [`Block`], [`Card`], [`Table`], [`Figure`] |
//! | the 3-D view | [`Scene`], [`Geometry`], [`Part`], [`Panel`], [`Screw`], [`Layer`], [`Layout`] |
//! | figures | [`chart`] |
//! | colours | [`ColorScale`], [`correspondence_colors`] |
//!
//! Lengths are millimetres, angles radians. Frames are those of the caller: every [`Panel`] has its
//! own, and [`Axes`] tell where the patient's left, front and head are in it.
//!
//! ```
//! use pedicle_report::{Block, Page, Section, Table};
//!
//! let mut table = Table::new("Errors", &["level", "mm"]);
//! table.push(["L4", "0.31"]);
//! let mut page = Page::new("A transfer");
//! page.sections.push(Section::new("errors", "Errors").with(Block::Table(table)));
//! let html = page.html();
//! assert!(html.starts_with("<!doctype html>") && html.contains("0.31"));
//! assert_eq!(html, page.html(), "the same bytes");
//! ```

mod block;
pub mod chart;
mod encode;
mod escape;
mod page;
mod palette;
mod scene;
mod scene_file;
mod screw_card;
mod table;

pub use block::{Block, Card, Figure, Section, Tone};
pub use page::{Fact, Page};
pub use palette::{ColorScale, correspondence_colors};
pub use scene::{
    Axes, Coloring, Column, Geometry, Layer, Layout, Panel, Part, Role, Scene, SceneKind, Screw,
    VertexColors,
};
pub use screw_card::{Deviation, ScrewReport, screw_section};
pub use table::Table;

/// The example of the README is run with the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

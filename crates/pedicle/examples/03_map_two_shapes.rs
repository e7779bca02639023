//! A functional map between two shapes, and a page that shows it.
//!
//! `cargo run --release --example 03_map_two_shapes -- [A] [B] [PAGE.html]`

#![allow(clippy::print_stdout, reason = "an example prints what it finds")]

use std::path::{Path, PathBuf};

use pedicle::report::map_page;
use pedicle::shape::{MapFile, MapShapesOptions, NamedShape, map_shapes};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let phantom = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/phantom");
    let mut arguments = std::env::args().skip(1).map(PathBuf::from);
    let mut next = |name: &str| arguments.next().unwrap_or_else(|| phantom.join(name));
    let paths = [next("L3.ply"), next("L4.ply")];
    let source_mesh = pedicle_mesh::read_mesh(&paths[0])?.mesh;
    let target_mesh = pedicle_mesh::read_mesh(&paths[1])?.mesh;
    let source = NamedShape {
        path: &paths[0],
        mesh: &source_mesh,
    };
    let target = NamedShape {
        path: &paths[1],
        mesh: &target_mesh,
    };
    let options = MapShapesOptions {
        n_functions: 60,
        ..MapShapesOptions::default()
    };
    let map = map_shapes(&source, &target, &[], &options, &mut |stage| {
        println!("{stage}")
    })?;
    let images = &map.point_map().source_of_target;
    println!(
        "vertex 0 of the target corresponds to vertex {} of the source",
        images[0]
    );

    let file = MapFile::new(&source, &target, &[], &options, &map)?;
    println!("coverage {:.3}", file.quality.coverage);
    if let Some(page) = arguments.next() {
        let html = map_page(&source_mesh, &target_mesh, &map, &file)?.html();
        pedicle::write_text(&page, &html)?;
    }
    Ok(())
}

//! A page with a table and a figure, made from the parts of `pedicle-report`.
//!
//! `cargo run --release --example 04_a_page_of_your_own -- [PAGE.html]`

#![allow(clippy::print_stdout, reason = "an example prints what it finds")]

use std::path::PathBuf;

use pedicle_report::chart::{Curve, Plot, Series, plot};
use pedicle_report::{Block, Figure, Page, Section, Table};
use pedicle_trajectory::SafetyMargins;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // How far a screw of 6 mm may be off in pedicles of different widths.
    let mut table = Table::new(
        "Margins of a 6 mm screw",
        &["width mm", "shift mm", "turn °"],
    );
    let mut points = Vec::new();
    for width_mm in 7..=18 {
        let width_mm = f64::from(width_mm);
        let margins = SafetyMargins::new(6.0, width_mm, 20.0)?;
        let degrees = margins.max_rotation_rad().to_degrees();
        points.push((width_mm, degrees));
        table.push([
            format!("{width_mm:.0}"),
            format!("{:.1}", margins.max_translation_mm()),
            format!("{degrees:.1}"),
        ]);
    }
    let figure = Figure {
        title: "Largest turn".to_owned(),
        caption: "of a screw of 6 mm whose isthmus is 20 mm deep".to_owned(),
        svg: plot(&Plot {
            label: "Largest turn over the width of the pedicle".to_owned(),
            x_label: "width, mm".to_owned(),
            y_label: "turn, degrees".to_owned(),
            curves: vec![Curve {
                name: "6 mm".to_owned(),
                series: Series::Blue,
                points,
            }],
            ..Plot::default()
        }),
        csv: table.csv(),
    };
    let mut page = Page::new("Safety margins");
    let section = Section::new("margins", "Margins");
    page.sections.push(
        section
            .with(Block::Figures(vec![figure]))
            .with(Block::Table(table)),
    );
    let html = page.html();
    match std::env::args().nth(1).map(PathBuf::from) {
        Some(path) => pedicle::write_text(&path, &html)?,
        None => println!("a page of {} bytes", html.len()),
    }
    Ok(())
}

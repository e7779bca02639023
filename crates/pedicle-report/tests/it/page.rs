use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_report::{
    Axes, Block, Card, Column, Figure, Geometry, Layout, Page, Panel, Part, Role, Scene, Screw,
    Section, Table, Tone,
};

/// A closed tube around the z axis, `n` points around and `n` along.
fn tube(n: u32) -> Geometry {
    let angle = |i: u32| std::f64::consts::TAU * f64::from(i) / f64::from(n);
    let vertices = (0..n * n)
        .map(|v| {
            let (around, along) = (angle(v % n), angle(v / n));
            let radius = 30.0 + 8.0 * along.cos();
            Point3::new(
                radius * around.cos(),
                radius * around.sin(),
                8.0 * along.sin(),
            )
        })
        .collect();
    let faces = (0..n * n)
        .flat_map(|v| {
            let (i, j) = (v % n, v / n);
            let at = |i: u32, j: u32| (j % n) * n + i % n;
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    Geometry {
        vertices,
        faces,
        colorings: Vec::new(),
    }
}

fn page(name: &str, n: u32) -> Page {
    let scene = Scene {
        panels: vec![Panel {
            name: "source".to_owned(),
            axes: Axes {
                origin: Point3::origin(),
                left: -Vector3::x(),
                anterior: Vector3::y(),
                up: Vector3::z(),
            },
        }],
        geometries: vec![tube(n)],
        parts: vec![Part {
            name: name.to_owned(),
            group: "bone".to_owned(),
            panel: 0,
            geometry: 0,
            pose: Isometry3::identity(),
            is_shown: true,
        }],
        screws: vec![Screw {
            name: name.to_owned(),
            part: name.to_owned(),
            panel: 0,
            entry_mm: Point3::new(0.0, -40.0, 0.0),
            tip_mm: Point3::new(0.0, 0.0, 0.0),
            diameter_mm: 6.0,
            isthmus_depth_mm: 15.0,
            role: Role::Transferred,
            is_accepted: false,
        }],
        layouts: vec![Layout {
            name: "source".to_owned(),
            columns: vec![Column {
                title: name.to_owned(),
                panel: 0,
                roles: vec![Role::Transferred],
                has_surfaces: true,
            }],
        }],
        ..Scene::default()
    };
    let mut table = Table::new(name, &[name, "mm"]);
    table.push([name, "1.5"]);
    let card = Card {
        title: name.to_owned(),
        verdict: "accepted".to_owned(),
        tone: Tone::Good,
        reasons: vec![name.to_owned()],
        facts: vec![(name.to_owned(), name.to_owned())],
        figures: vec![Figure {
            title: name.to_owned(),
            caption: name.to_owned(),
            svg: "<svg ></svg>".to_owned(),
            csv: format!("{name}\n"),
        }],
        shows: Some(name.to_owned()),
    };
    let section = Section::new("all", name)
        .with(Block::Text(name.to_owned()))
        .with(Block::List(vec![name.to_owned()]))
        .with(Block::Table(table))
        .with(Block::Cards(vec![card]));
    Page {
        subtitle: name.to_owned(),
        scene: Some(scene),
        sections: vec![section],
        ..Page::new(name)
    }
}

#[test]
fn a_full_spine_is_far_below_ten_megabytes_and_the_same_every_time() {
    let full = page("L4", 149);
    assert!(
        full.scene.as_ref().unwrap().geometries[0].faces.len() > 44_000,
        "as many faces as a spine"
    );
    let html = full.html();
    assert!(html.len() < 10_000_000, "{} bytes", html.len());
    assert_eq!(html, full.html(), "the same bytes");
}

#[test]
fn a_page_asks_for_nothing_else() {
    let html = page("L4", 12).html();
    // Names of XML vocabularies are no addresses.
    let html = html.replace("http://www.w3.org/2000/svg", "");
    for forbidden in ["http://", "https://", "src=", "@import", "url("] {
        assert!(!html.contains(forbidden), "'{forbidden}' in the page");
    }
}

#[test]
fn names_cannot_break_out_of_the_page() {
    let hostile = "</script><script>alert(1)</script>\" onload=\"x\" & <b>";
    let html = page(hostile, 12).html();
    let plain = page("L4", 12).html();
    for tag in ["<script", "</script", "<b>", "<img"] {
        assert_eq!(
            html.matches(tag).count(),
            plain.matches(tag).count(),
            "a name made another '{tag}'"
        );
    }
    // Inside a script that is data a quotation mark ends nothing.
    assert!(
        !without_scripts(&html).contains("\" onload="),
        "an attribute was ended"
    );
}

/// The page without what stands in its scripts.
fn without_scripts(html: &str) -> String {
    let mut parts = html.split("<script");
    let first = parts.next().unwrap().to_owned();
    parts.fold(first, |out, part| {
        out + part.split_once("</script>").unwrap().1
    })
}

use nalgebra::{Matrix2, Point2};
use pedicle_report::chart::{
    Curve, DotRow, Outline, OutlineView, Plot, Scale, Series, StackRow, bars, dots, heatmap,
    outlines, plot, standalone,
};

/// Elements are closed in the order in which they were opened.
fn expect_well_formed(svg: &str) {
    let mut open: Vec<&str> = Vec::new();
    let mut rest = svg;
    while let Some(at) = rest.find('<') {
        let end = rest[at..].find('>').unwrap() + at;
        let tag = &rest[at + 1..end];
        rest = &rest[end + 1..];
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name), "closed in order: {svg}");
        } else if !tag.ends_with('/') {
            open.push(tag.split_whitespace().next().unwrap());
        }
    }
    assert!(open.is_empty(), "left open: {open:?}");
    assert!(
        !svg.contains("NaN") && !svg.contains("inf"),
        "a place that is no number: {svg}"
    );
}

/// Half the extents of the path with a class, in units of the picture.
fn half_extents(svg: &str, class: &str) -> (f64, f64) {
    let at = svg.find(&format!("class=\"{class}")).unwrap();
    let d = svg[at..]
        .split(" d=\"")
        .nth(1)
        .unwrap()
        .split('"')
        .next()
        .unwrap();
    let numbers: Vec<f64> = d
        .split(['M', 'L', 'Z', ' '])
        .filter(|s| !s.is_empty())
        .map(|s| s.parse().unwrap())
        .collect();
    let extent = |k: usize| {
        let values = numbers.iter().skip(k).step_by(2);
        let (low, high) = values.fold((f64::MAX, f64::MIN), |(l, h), &v| (l.min(v), h.max(v)));
        0.5 * (high - low)
    };
    (extent(0), extent(1))
}

#[test]
fn every_figure_is_well_formed_whatever_it_is_given() {
    for values in [
        vec![],
        vec![f64::NAN; 3],
        vec![0.0; 3],
        vec![-1.0, f64::INFINITY, 2e-9],
    ] {
        let points = values
            .iter()
            .enumerate()
            .map(|(k, v)| (k as f64, *v))
            .collect();
        for scale in [Scale::Linear, Scale::Log] {
            let curve = Curve {
                name: "a < b & \"c\"".to_owned(),
                series: Series::Red,
                points: Clone::clone(&points),
            };
            expect_well_formed(&plot(&Plot {
                label: "a < b".to_owned(),
                curves: vec![curve],
                y_scale: scale,
                ..Plot::default()
            }));
            let row = DotRow {
                name: "<row>".to_owned(),
                values: values.clone(),
            };
            let series = [
                (Series::Red, "<r>"),
                (Series::Grey, "g"),
                (Series::Green, "b"),
            ];
            expect_well_formed(&dots(&[row], &series, scale, ["<a>", "<b>"]));
        }
        expect_well_formed(&heatmap(values.len(), &values, ["a", "<b>", "c"]));
    }
    let row = StackRow {
        name: "nothing".to_owned(),
        counts: vec![0, 0],
    };
    let series = [(Series::Red, "r"), (Series::Grey, "g")];
    expect_well_formed(&bars(&[row], &series, ["a", "b"]));
    expect_well_formed(&outlines(&OutlineView::default()));
}

#[test]
fn outlines_are_to_scale() {
    let circle = Outline {
        name: "screw".to_owned(),
        series: Series::Blue,
        center_mm: Point2::new(1.0, -2.0),
        shape_mm: Matrix2::identity() * 3.0,
        is_filled: true,
    };
    // Half of a normal distribution lies within √(2 ln 2) deviations.
    let covariance = Matrix2::new(4.0, 0.0, 0.0, 1.0);
    let ellipse = Outline::of_covariance("half", Point2::origin(), &covariance, 0.5);
    let view = OutlineView {
        label: "a square of 20 mm".to_owned(),
        contours: vec![vec![
            Point2::new(-10.0, -10.0),
            Point2::new(10.0, -10.0),
            Point2::new(10.0, 10.0),
            Point2::new(-10.0, 10.0),
        ]],
        outlines: vec![circle, ellipse],
        directions: Default::default(),
    };
    let svg = outlines(&view);
    let per_mm = half_extents(&svg, "bone").0 / 10.0;
    let (x, y) = half_extents(&svg, "filled s-blue");
    assert!(
        (x / per_mm - 3.0).abs() < 0.03 && (y / per_mm - 3.0).abs() < 0.03,
        "{x} {y}"
    );
    let (x, y) = half_extents(&svg, "line s-grey");
    let deviations = (2.0 * 2f64.ln()).sqrt();
    assert!((x / per_mm - 2.0 * deviations).abs() < 0.03, "{x}");
    assert!((y / per_mm - deviations).abs() < 0.03, "{y}");
}

#[test]
fn a_matrix_shows_its_entries() {
    let mut values = vec![0.0; 9];
    values[4] = 1.0;
    values[5] = 1.0;
    values[6] = -1.0;
    let svg = heatmap(3, &values, ["a", "b", "c"]);
    // Row, then a run of columns.
    assert!(
        svg.contains("M1 1h2v1h-2z"),
        "two positive ones as one run: {svg}"
    );
    assert!(svg.contains("M0 2h1v1h-1z"), "a negative one: {svg}");
}

#[test]
fn a_figure_alone_has_its_style() {
    let svg = standalone(&heatmap(1, &[1.0], ["a", "b", "c"]));
    expect_well_formed(&svg);
    assert!(svg.starts_with("<svg ") && svg.contains("<style>"), "{svg}");
}

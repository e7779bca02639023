//! Lumbar morphometry: every dimension of the phantom, L1 to L5, with its source.
//!
//! One row is one dimension: the mean per level, the standard deviation between people and where
//! the numbers come from. Lengths in mm, angles in degrees. Rows marked *construction* are not
//! taken from a table: they are the dimensions a smooth model needs and no survey reports, chosen
//! so that the whole stays inside the published ranges.
//!
//! Sources
//! - Panjabi 1992: Panjabi et al., Spine 17(3):299-306 (12 cadavers; it gives standard errors of
//!   the mean, so the deviations here are √12 times as large).
//! - Panjabi 1993: Panjabi et al., Spine 18(10):1298-1310 (articular facets).
//! - Zindrick 1987: Zindrick et al., Spine 12(2):160-166 (2 905 pedicles).
//! - Bonczar 2024: Bonczar et al., Surg. Radiol. Anat. 47(1):22 (pooled, 18 studies, 1 481 people).
//! - Gilad 1985: Gilad and Nissan, J. Anat. 143:115-120 (157 men; deviations of the heights).
//! - Twomey 1985: Twomey and Taylor, Acta Orthop. Scand. 56(6):496-499 (mean disc heights, men
//!   of 20 to 35 years, midsagittal area over depth).
//! - Cook 2021: Cook and Baker, Int. J. Spine Surg. 15(6):1072-1081 (CT of 196 people).
//! - Masharawi 2009: Masharawi et al., Eur. Spine J., 10.1007/s00586-009-1256-6 (facets over
//!   body width).

/// What a row is measured in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Millimetres.
    Millimetre,
    /// Degrees.
    Degree,
}

/// One dimension over the five levels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MorphometryRow {
    /// What is measured.
    pub name: &'static str,
    /// Unit of the mean and the deviation.
    pub unit: Unit,
    /// Mean at L1, L2, L3, L4, L5; mm or degrees.
    pub mean: [f64; 5],
    /// Standard deviation between people at L1 to L5; mm or degrees.
    pub deviation: [f64; 5],
    /// Where the numbers come from.
    pub source: &'static str,
}

const fn length(
    name: &'static str,
    mean: [f64; 5],
    deviation: [f64; 5],
    source: &'static str,
) -> MorphometryRow {
    MorphometryRow {
        name,
        unit: Unit::Millimetre,
        mean,
        deviation,
        source,
    }
}

const fn angle(
    name: &'static str,
    mean: [f64; 5],
    deviation: [f64; 5],
    source: &'static str,
) -> MorphometryRow {
    MorphometryRow {
        name,
        unit: Unit::Degree,
        mean,
        deviation,
        source,
    }
}

/// Width of the upper endplate, mm.
pub const BODY_WIDTH_UPPER: MorphometryRow = length(
    "upper endplate width",
    [41.2, 42.6, 44.1, 46.6, 47.3],
    [3.6, 2.6, 3.0, 4.2, 4.2],
    "Panjabi 1992, EPWu",
);

/// Width of the lower endplate, mm.
pub const BODY_WIDTH_LOWER: MorphometryRow = length(
    "lower endplate width",
    [43.3, 45.5, 48.0, 49.5, 49.4],
    [3.0, 3.0, 3.0, 4.0, 4.0],
    "Panjabi 1992, EPWl",
);

/// Depth (front to back) of the upper endplate, mm.
pub const BODY_DEPTH_UPPER: MorphometryRow = length(
    "upper endplate depth",
    [34.1, 34.6, 35.2, 35.5, 34.7],
    [2.6, 2.6, 2.8, 2.8, 3.1],
    "Panjabi 1992, EPDu; Cook 2021 has 35.7 ± 3.5 at L5",
);

/// Depth of the lower endplate, mm.
pub const BODY_DEPTH_LOWER: MorphometryRow = length(
    "lower endplate depth",
    [35.3, 34.9, 34.8, 33.9, 33.2],
    [2.8, 2.8, 2.8, 2.8, 3.1],
    "Panjabi 1992, EPDl; Cook 2021 has 35.3 ± 3.6 at L5",
);

/// Height of the front of the vertebral body, mm.
pub const BODY_HEIGHT_ANTERIOR: MorphometryRow = length(
    "anterior body height",
    [24.54, 25.75, 26.83, 26.86, 27.44],
    [2.2, 2.0, 2.1, 2.2, 2.1],
    "Bonczar 2024; deviations Gilad 1985; Cook 2021 has 30.3 ± 1.9 at L5",
);

/// Height of the back of the vertebral body, mm.
pub const BODY_HEIGHT_POSTERIOR: MorphometryRow = length(
    "posterior body height",
    [26.57, 27.02, 26.67, 25.76, 24.11],
    [2.1, 2.1, 2.1, 2.3, 2.5],
    "Bonczar 2024; deviations Gilad 1985; Cook 2021 has 26.3 ± 1.9 at L5",
);

/// Height of the disc below the level, mm. The one below L5 only places the lower facets.
pub const DISC_HEIGHT: MorphometryRow = length(
    "disc height",
    [9.2, 9.8, 10.3, 11.3, 10.6],
    [1.0, 1.2, 1.0, 1.3, 1.6],
    "Twomey 1985",
);

/// Angle by which the disc below the level opens to the front, degrees.
pub const DISC_ANGLE: MorphometryRow = angle(
    "disc angle",
    [4.0, 5.5, 7.5, 10.5, 13.0],
    [1.5, 1.5, 1.5, 2.0, 2.0],
    "construction: grows downwards and adds up to a usual lordosis of L1 to L5",
);

/// Least width of the pedicle, at its isthmus, square to its axis, mm.
pub const PEDICLE_WIDTH: MorphometryRow = length(
    "pedicle width",
    [8.7, 8.9, 10.3, 12.9, 16.1],
    [2.3, 2.2, 2.6, 2.1, 2.3],
    "Zindrick 1987 (L1 to L4; it has 18.0 ± 4.1 at L5); Cook 2021 (L5)",
);

/// Height of the pedicle at its isthmus, mm.
pub const PEDICLE_HEIGHT: MorphometryRow = length(
    "pedicle height",
    [15.4, 15.0, 14.9, 14.8, 14.0],
    [2.8, 1.5, 2.4, 2.1, 2.3],
    "Zindrick 1987; Cook 2021 has 12.9 ± 1.9 at L5",
);

/// Angle of the pedicle's axis with the sagittal plane, degrees, converging to the front.
pub const PEDICLE_TRANSVERSE_ANGLE: MorphometryRow = angle(
    "pedicle transverse angle",
    [10.9, 12.0, 14.4, 17.7, 29.8],
    [2.5, 2.5, 2.5, 2.5, 3.0],
    "Zindrick 1987 (means)",
);

/// Angle of the pedicle's axis with the plane of the body, degrees, positive: rises to the front.
pub const PEDICLE_SAGITTAL_ANGLE: MorphometryRow = angle(
    "pedicle sagittal angle",
    [2.4, 1.8, 0.2, 0.2, -1.8],
    [1.0, 1.0, 1.0, 1.0, 1.0],
    "Zindrick 1987 (means)",
);

/// Width of the vertebral canal between the pedicles, mm.
pub const CANAL_WIDTH: MorphometryRow = length(
    "canal width",
    [23.7, 23.8, 24.3, 25.4, 27.1],
    [3.2, 2.5, 2.2, 1.7, 3.0],
    "Panjabi 1992, SCW; Cook 2021 has 28.2 ± 3.1 at L5",
);

/// Depth of the vertebral canal, mm.
pub const CANAL_DEPTH: MorphometryRow = length(
    "canal depth",
    [19.0, 18.2, 17.5, 18.6, 19.7],
    [2.3, 1.8, 1.8, 2.5, 1.7],
    "Panjabi 1992, SCD; Cook 2021 has 15.6 ± 2.1 at L5",
);

/// Thickness of the lamina, mm.
pub const LAMINA_THICKNESS: MorphometryRow = length(
    "lamina thickness",
    [6.8, 7.0, 7.2, 7.2, 6.6],
    [0.6, 0.6, 0.6, 0.6, 0.6],
    "construction: about 6 to 7 mm throughout",
);

/// Height of the lamina, mm; lower and broader downwards.
pub const LAMINA_HEIGHT: MorphometryRow = length(
    "lamina height",
    [22.0, 22.0, 21.0, 18.5, 15.5],
    [1.5, 1.5, 1.5, 1.5, 1.5],
    "construction: falls towards L5",
);

/// Width of an articular facet, mm.
pub const FACET_WIDTH: MorphometryRow = length(
    "facet width",
    [12.4, 12.7, 13.8, 14.7, 15.6],
    [1.5, 1.5, 1.5, 1.5, 1.5],
    "Panjabi 1993, lower facets",
);

/// Height of an articular facet, mm.
pub const FACET_HEIGHT: MorphometryRow = length(
    "facet height",
    [15.3, 16.0, 15.7, 16.2, 17.0],
    [1.5, 1.5, 1.5, 1.5, 1.5],
    "Panjabi 1993, lower facets (18.4 at L5, shortened to clear the sacrum)",
);

/// Distance between the centres of the two upper facets, mm.
pub const INTERFACET_WIDTH: MorphometryRow = length(
    "interfacet width",
    [26.0, 26.5, 28.5, 33.0, 39.0],
    [1.5, 1.5, 1.5, 1.5, 2.0],
    "construction inside Panjabi 1993 (20.8 to 40.6); 0.63 to 0.82 of the body (Masharawi 2009)",
);

/// Angle of the upper facet's plane with the sagittal plane, degrees.
pub const FACET_ANGLE: MorphometryRow = angle(
    "facet angle",
    [18.0, 22.0, 30.0, 40.0, 48.0],
    [4.0, 4.0, 4.0, 4.0, 4.0],
    "construction: sagittal above, turning to the front downwards (trend of Panjabi 1993)",
);

/// Distance between the tips of the transverse processes, mm.
pub const TRANSVERSE_WIDTH: MorphometryRow = length(
    "transverse process width",
    [71.2, 76.1, 85.7, 79.3, 92.5],
    [5.0, 5.0, 6.0, 5.0, 6.0],
    "Panjabi 1992, TPW",
);

/// Rise of the transverse process towards its tip, degrees.
pub const TRANSVERSE_ELEVATION: MorphometryRow = angle(
    "transverse process elevation",
    [2.0, 3.0, 2.0, 14.0, 20.0],
    [3.0, 3.0, 3.0, 3.0, 3.0],
    "construction: level above, rising at L4 and L5",
);

/// Half height of the transverse process at its root, mm.
pub const TRANSVERSE_HALF_HEIGHT: MorphometryRow = length(
    "transverse process half height",
    [5.0, 5.0, 5.0, 5.2, 7.0],
    [0.4, 0.4, 0.4, 0.4, 0.6],
    "construction: slender at L3, stout at L5",
);

/// Distance from the back of the body to the tip of the spinous process, mm.
pub const SPINOUS_REACH: MorphometryRow = length(
    "spinous process reach",
    [46.0, 48.5, 48.5, 46.5, 42.0],
    [3.0, 3.0, 3.0, 3.0, 3.0],
    "construction: whole vertebra about 80 mm front to back, shortest at L5",
);

/// Height of the spinous process, mm.
pub const SPINOUS_HEIGHT: MorphometryRow = length(
    "spinous process height",
    [21.0, 22.5, 23.0, 20.0, 15.0],
    [1.5, 1.5, 1.5, 1.5, 1.5],
    "construction: lowest at L5",
);

/// Thickness of the spinous process, mm.
pub const SPINOUS_THICKNESS: MorphometryRow = length(
    "spinous process thickness",
    [6.4, 6.6, 6.8, 6.6, 6.2],
    [0.6, 0.6, 0.6, 0.6, 0.6],
    "construction",
);

/// Fall of the spinous process towards its tip, degrees.
pub const SPINOUS_SLOPE: MorphometryRow = angle(
    "spinous process slope",
    [24.0, 20.0, 16.0, 14.0, 16.0],
    [3.0, 3.0, 3.0, 3.0, 3.0],
    "construction",
);

/// All rows of the table.
pub const TABLE: [MorphometryRow; 27] = [
    BODY_WIDTH_UPPER,
    BODY_WIDTH_LOWER,
    BODY_DEPTH_UPPER,
    BODY_DEPTH_LOWER,
    BODY_HEIGHT_ANTERIOR,
    BODY_HEIGHT_POSTERIOR,
    DISC_HEIGHT,
    DISC_ANGLE,
    PEDICLE_WIDTH,
    PEDICLE_HEIGHT,
    PEDICLE_TRANSVERSE_ANGLE,
    PEDICLE_SAGITTAL_ANGLE,
    CANAL_WIDTH,
    CANAL_DEPTH,
    LAMINA_THICKNESS,
    LAMINA_HEIGHT,
    FACET_WIDTH,
    FACET_HEIGHT,
    INTERFACET_WIDTH,
    FACET_ANGLE,
    TRANSVERSE_WIDTH,
    TRANSVERSE_ELEVATION,
    TRANSVERSE_HALF_HEIGHT,
    SPINOUS_REACH,
    SPINOUS_HEIGHT,
    SPINOUS_THICKNESS,
    SPINOUS_SLOPE,
];

//! Lumbar morphometry: every dimension of the phantom, L1 to L5, and where each number comes from.
//!
//! One row is one dimension: the mean per level and the standard deviation between people, mm or
//! degrees. The mean and the deviation each carry an [`Origin`]: a [`Provenance`] and one sentence.
//!
//! - [`Provenance::Published`]: the numbers were compared with the paper's own table or with a
//!   transcription of it, and agree. Deviations may be computed from published standard errors
//!   (then √n times as large, and the sentence says so).
//! - [`Provenance::Quoted`]: the numbers commonly given for that paper. They were not compared with
//!   it or with a transcription, so treat the citation as a pointer and not as evidence.
//! - [`Provenance::Construction`]: chosen for this model, or not traceable to a survey. A smooth
//!   solid needs dimensions that no survey reports, and many surveys give no spread between
//!   people. A citation here is a comparison.
//!
//! A row whose levels differ in provenance carries the weakest. Of 27 means 7 are published,
//! 8 quoted and 12 construction; of 27 deviations 7, 1 and 19.
//!
//! Surveys of one dimension differ by as much as people do. The canal of Panjabi 1992, used here, is
//! 3 to 4 mm deeper than the pooled means of Bonczar 2024 (16.0, 15.1, 14.7, 15.1, 15.7 mm). The
//! posterior heights of Bonczar 2024, used here, are 1 to 3 mm above those of Panjabi 1992 (23.8,
//! 24.3, 23.8, 24.1, 22.9 mm). The facets are more sagittal than those of Masharawi 2004, by 10°
//! and more at L3. The phantom is a plausible spine, not a population.
//!
//! # Sources, and how they were checked
//!
//! *Reference table* is the transcription of published series in the public repository
//! `Gregory-Schwing-MD-PhD/CTSpinoPelvic1K` (`morphometrics/make_reference_table.py` and
//! `morphometrics/pedicle_width_references.csv`), which names primary and secondary readings.
//!
//! - Panjabi 1992: Panjabi et al., Spine 17(3):299-306 (60 vertebrae of 12 cadavers, means with
//!   standard errors). Widths of the upper endplate and of the canal and depth of the canal:
//!   reference table, primary. Its other dimensions were not checked.
//! - Panjabi 1993: Panjabi et al., Spine 18(10):1298-1310 (articular facets). Only the abstract was
//!   checked: over C3 to L5 width 9.6 to 16.3, height 10.2 to 18.4, interfacet width 20.8 to
//!   40.6 mm.
//! - Zindrick 1987: Zindrick et al., Spine 12(2):160-166 (2 905 pedicles). Widths: reference table,
//!   secondary (from a later paper). Heights and angles were not checked.
//! - Bonczar 2024: Bonczar et al., Surg. Radiol. Anat. 47(1):22 (pooled, 18 studies, 1 481 people):
//!   reference table, primary. Its errors are pooled standard errors and not used here.
//! - Gilad 1985: Gilad and Nissan, J. Anat. 143:115-120 (radiographs of 157 men): reference table,
//!   primary.
//! - Twomey 1985: Twomey and Taylor, Acta Orthop. Scand. 56(6):496-499 (post-mortem, men of 20 to
//!   35 years, midsagittal area over depth): reference table, primary.
//! - Cook 2021: Cook and Baker, Int. J. Spine Surg. 15(6):1072-1081 (CT of 196 people): its table 6
//!   (L5).
//! - Masharawi 2004: Masharawi et al., Facet orientation in the thoracolumbar spine, Spine 2004
//!   (240 spines): abstract.
//! - Masharawi 2009: Masharawi et al., Eur. Spine J. 19(5):768-773, 10.1007/s00586-009-1256-6
//!   (120 men, 120 women): its table 1. No number is taken from it. The wedging of the bodies, from
//!   published heights and quoted depths, lies between its women and its men at all levels, which
//!   is an independent check. So does the height of the spinous process over that of the body (its
//!   "thickness"), a comparison only, because that row was chosen.
//! - Wang 2024: Wang et al., World Neurosurg., December 2024 (laminae, CT of 62 people): abstract.

/// What a row is measured in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Millimetres.
    Millimetre,
    /// Degrees.
    Degree,
}

/// How far a number can be traced, strongest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Provenance {
    /// Compared with the paper's table or with a transcription of it.
    Published,
    /// Commonly quoted for that paper, not compared with it.
    Quoted,
    /// Chosen for this model.
    Construction,
}

/// Where the five numbers of a mean or of a deviation come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Origin {
    /// How far they can be traced; the weakest of the five levels.
    pub provenance: Provenance,
    /// The source, or what the choice was made by.
    pub source: &'static str,
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
    /// Where the means come from.
    pub mean_origin: Origin,
    /// Standard deviation between people at L1 to L5; mm or degrees.
    pub deviation: [f64; 5],
    /// Where the deviations come from.
    pub deviation_origin: Origin,
}

const fn published(source: &'static str) -> Origin {
    Origin {
        provenance: Provenance::Published,
        source,
    }
}

const fn quoted(source: &'static str) -> Origin {
    Origin {
        provenance: Provenance::Quoted,
        source,
    }
}

const fn construction(source: &'static str) -> Origin {
    Origin {
        provenance: Provenance::Construction,
        source,
    }
}

const fn length(
    name: &'static str,
    mean: [f64; 5],
    mean_origin: Origin,
    deviation: [f64; 5],
    deviation_origin: Origin,
) -> MorphometryRow {
    MorphometryRow {
        name,
        unit: Unit::Millimetre,
        mean,
        mean_origin,
        deviation,
        deviation_origin,
    }
}

const fn angle(
    name: &'static str,
    mean: [f64; 5],
    mean_origin: Origin,
    deviation: [f64; 5],
    deviation_origin: Origin,
) -> MorphometryRow {
    MorphometryRow {
        unit: Unit::Degree,
        ..length(name, mean, mean_origin, deviation, deviation_origin)
    }
}

/// Width of the upper endplate, mm.
pub const BODY_WIDTH_UPPER: MorphometryRow = length(
    "upper endplate width",
    [41.2, 42.6, 44.1, 46.6, 47.3],
    published("Panjabi 1992, EPWu"),
    [3.6, 2.6, 3.0, 4.2, 4.2],
    published("Panjabi 1992, standard errors of 12 times √12"),
);

/// Width of the lower endplate, mm.
pub const BODY_WIDTH_LOWER: MorphometryRow = length(
    "lower endplate width",
    [43.3, 45.5, 48.0, 49.5, 49.4],
    quoted("Panjabi 1992, EPWl"),
    [3.0, 3.0, 3.0, 4.0, 4.0],
    construction("rounded, about those of the upper endplate"),
);

/// Depth (front to back) of the upper endplate, mm.
pub const BODY_DEPTH_UPPER: MorphometryRow = length(
    "upper endplate depth",
    [34.1, 34.6, 35.2, 35.5, 34.7],
    quoted("Panjabi 1992, EPDu; Cook 2021 has 35.7 at L5"),
    [2.6, 2.6, 2.8, 2.8, 3.1],
    construction("between 2.6 and 3.1; Cook 2021 has 3.5 at L5"),
);

/// Depth of the lower endplate, mm.
pub const BODY_DEPTH_LOWER: MorphometryRow = length(
    "lower endplate depth",
    [35.3, 34.9, 34.8, 33.9, 33.2],
    quoted("Panjabi 1992, EPDl; Cook 2021 has 35.3 at L5"),
    [2.8, 2.8, 2.8, 2.8, 3.1],
    construction("between 2.6 and 3.1; Cook 2021 has 3.6 at L5"),
);

/// Height of the front of the vertebral body, mm.
pub const BODY_HEIGHT_ANTERIOR: MorphometryRow = length(
    "anterior body height",
    [24.54, 25.75, 26.83, 26.86, 27.44],
    published("Bonczar 2024; Cook 2021 has 30.3 at L5"),
    [2.2, 2.0, 2.1, 2.2, 2.1],
    published("Gilad 1985; Cook 2021 has 1.9 at L5"),
);

/// Height of the back of the vertebral body, mm.
pub const BODY_HEIGHT_POSTERIOR: MorphometryRow = length(
    "posterior body height",
    [26.57, 27.02, 26.67, 25.76, 24.11],
    published("Bonczar 2024; Cook 2021 has 26.3 at L5"),
    [2.1, 2.1, 2.1, 2.3, 2.5],
    published("Gilad 1985; Cook 2021 has 1.9 at L5"),
);

/// Height of the disc below the level, mm. The one below L5 only places the lower facets.
pub const DISC_HEIGHT: MorphometryRow = length(
    "disc height",
    [9.2, 9.8, 10.3, 11.3, 10.6],
    published("Twomey 1985, men"),
    [1.0, 1.2, 1.0, 1.3, 1.6],
    published("Twomey 1985, men"),
);

/// Angle by which the disc below the level opens to the front, degrees.
pub const DISC_ANGLE: MorphometryRow = angle(
    "disc angle",
    [4.0, 5.5, 7.5, 10.5, 13.0],
    construction("grows downwards and adds up to a usual lordosis of L1 to L5"),
    [1.5, 1.5, 1.5, 2.0, 2.0],
    construction("grows downwards"),
);

/// Least width of the pedicle, at its isthmus, square to its axis, mm.
pub const PEDICLE_WIDTH: MorphometryRow = length(
    "pedicle width",
    [8.7, 8.9, 10.3, 12.9, 16.1],
    published("Zindrick 1987 (L1 to L4; it has 18.0 at L5); Cook 2021 (L5)"),
    [2.3, 2.2, 2.6, 2.1, 2.3],
    published("Zindrick 1987 (L1 to L4; it has 4.1 at L5); Cook 2021 (L5)"),
);

/// Height of the pedicle at its isthmus, mm.
pub const PEDICLE_HEIGHT: MorphometryRow = length(
    "pedicle height",
    [15.4, 15.0, 14.9, 14.8, 14.0],
    quoted("Zindrick 1987; Cook 2021 has 12.9 at L5"),
    [2.8, 1.5, 2.4, 2.1, 2.3],
    quoted("Zindrick 1987; Cook 2021 has 1.0 (women) and 1.4 (men) at L5"),
);

/// Angle of the pedicle's axis with the sagittal plane, degrees, converging to the front.
pub const PEDICLE_TRANSVERSE_ANGLE: MorphometryRow = angle(
    "pedicle transverse angle",
    [10.9, 12.0, 14.4, 17.7, 29.8],
    quoted("Zindrick 1987"),
    [2.5, 2.5, 2.5, 2.5, 3.0],
    construction("nearly the same everywhere"),
);

/// Angle of the pedicle's axis with the plane of the body, degrees, positive: rises to the front.
pub const PEDICLE_SAGITTAL_ANGLE: MorphometryRow = angle(
    "pedicle sagittal angle",
    [2.4, 1.8, 0.2, 0.2, -1.8],
    quoted("Zindrick 1987"),
    [1.0, 1.0, 1.0, 1.0, 1.0],
    construction("the same everywhere, small"),
);

/// Width of the vertebral canal between the pedicles, mm.
pub const CANAL_WIDTH: MorphometryRow = length(
    "canal width",
    [23.7, 23.8, 24.3, 25.4, 27.1],
    published("Panjabi 1992, SCW; Cook 2021 has 28.2 at L5"),
    [3.2, 2.5, 2.2, 1.7, 3.0],
    published("Panjabi 1992, standard errors of 12 times √12"),
);

/// Depth of the vertebral canal, mm.
pub const CANAL_DEPTH: MorphometryRow = length(
    "canal depth",
    [19.0, 18.2, 17.5, 18.6, 19.7],
    published("Panjabi 1992, SCD; Cook 2021 has 15.6 at L5"),
    [2.3, 1.8, 1.8, 2.5, 1.7],
    published("Panjabi 1992, standard errors of 12 times √12"),
);

/// Thickness of the lamina, mm.
pub const LAMINA_THICKNESS: MorphometryRow = length(
    "lamina thickness",
    [6.8, 7.0, 7.2, 7.2, 6.6],
    construction("about 7 mm throughout; Wang 2024 has 6.0 to 6.3 over all levels"),
    [0.6, 0.6, 0.6, 0.6, 0.6],
    construction("the same everywhere"),
);

/// Height of the lamina, mm; lower and broader downwards.
pub const LAMINA_HEIGHT: MorphometryRow = length(
    "lamina height",
    [22.0, 22.0, 21.0, 18.5, 15.5],
    construction("falls towards L5; Wang 2024 has 21.8 to 22.5 over all levels"),
    [1.5, 1.5, 1.5, 1.5, 1.5],
    construction("the same everywhere"),
);

/// Width of an articular facet, mm.
pub const FACET_WIDTH: MorphometryRow = length(
    "facet width",
    [12.4, 12.7, 13.8, 14.7, 15.6],
    quoted("Panjabi 1993, lower facets"),
    [1.5, 1.5, 1.5, 1.5, 1.5],
    construction("the same everywhere"),
);

/// Height of an articular facet, mm.
pub const FACET_HEIGHT: MorphometryRow = length(
    "facet height",
    [15.3, 16.0, 15.7, 16.2, 17.0],
    construction("quoted for Panjabi 1993, lower facets; 18.4 at L5 shortened to clear the sacrum"),
    [1.5, 1.5, 1.5, 1.5, 1.5],
    construction("the same everywhere"),
);

/// Distance between the centres of the two upper facets, mm.
pub const INTERFACET_WIDTH: MorphometryRow = length(
    "interfacet width",
    [26.0, 26.5, 28.5, 33.0, 39.0],
    construction("0.62 to 0.82 of the upper endplate; Masharawi 2009 has 0.63 to 0.77 of the body"),
    [1.5, 1.5, 1.5, 1.5, 2.0],
    construction("nearly the same everywhere"),
);

/// Angle of the upper facet's plane with the sagittal plane, degrees.
pub const FACET_ANGLE: MorphometryRow = angle(
    "facet angle",
    [18.0, 22.0, 30.0, 40.0, 48.0],
    construction(
        "turns to the front downwards; Masharawi 2004 has 26 to 34 (T12 to L2), 40 to 56 (L3 to L5)",
    ),
    [4.0, 4.0, 4.0, 4.0, 4.0],
    construction("the same everywhere"),
);

/// Distance between the tips of the transverse processes, mm.
pub const TRANSVERSE_WIDTH: MorphometryRow = length(
    "transverse process width",
    [71.2, 76.1, 85.7, 79.3, 92.5],
    quoted("Panjabi 1992, TPW"),
    [5.0, 5.0, 6.0, 5.0, 6.0],
    construction("about a fifteenth of the mean"),
);

/// Rise of the transverse process towards its tip, degrees.
pub const TRANSVERSE_ELEVATION: MorphometryRow = angle(
    "transverse process elevation",
    [2.0, 3.0, 2.0, 14.0, 20.0],
    construction("level above, rising at L4 and L5"),
    [3.0, 3.0, 3.0, 3.0, 3.0],
    construction("the same everywhere"),
);

/// Half height of the transverse process at its root, mm.
pub const TRANSVERSE_HALF_HEIGHT: MorphometryRow = length(
    "transverse process half height",
    [5.0, 5.0, 5.0, 5.2, 7.0],
    construction("slender above, stout at L5"),
    [0.4, 0.4, 0.4, 0.4, 0.6],
    construction("nearly the same everywhere"),
);

/// Distance from the back of the body to the tip of the spinous process, mm.
pub const SPINOUS_REACH: MorphometryRow = length(
    "spinous process reach",
    [46.0, 48.5, 48.5, 46.5, 42.0],
    construction("whole vertebra about 80 mm front to back, shortest at L5"),
    [3.0, 3.0, 3.0, 3.0, 3.0],
    construction("the same everywhere"),
);

/// Height of the spinous process, mm.
pub const SPINOUS_HEIGHT: MorphometryRow = length(
    "spinous process height",
    [21.0, 22.5, 23.0, 20.0, 15.0],
    construction("lowest at L5; of the height of the body between women and men of Masharawi 2009"),
    [1.5, 1.5, 1.5, 1.5, 1.5],
    construction("the same everywhere"),
);

/// Thickness of the spinous process, mm.
pub const SPINOUS_THICKNESS: MorphometryRow = length(
    "spinous process thickness",
    [6.4, 6.6, 6.8, 6.6, 6.2],
    construction("about 6.5 mm throughout"),
    [0.6, 0.6, 0.6, 0.6, 0.6],
    construction("the same everywhere"),
);

/// Fall of the spinous process towards its tip, degrees.
pub const SPINOUS_SLOPE: MorphometryRow = angle(
    "spinous process slope",
    [24.0, 20.0, 16.0, 14.0, 16.0],
    construction("steepest at L1"),
    [3.0, 3.0, 3.0, 3.0, 3.0],
    construction("the same everywhere"),
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

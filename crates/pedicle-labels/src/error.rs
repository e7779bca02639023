//! Why a label map was refused.

use std::path::PathBuf;

use pedicle_trajectory::Level;

/// One connected part of a label, for messages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PartSize {
    /// Its volume, cm³.
    pub volume_cm3: f64,
    /// Middle of its bounding box in RAS, mm.
    pub center_mm: [f64; 3],
}

impl std::fmt::Display for PartSize {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [x, y, z] = self.center_mm;
        write!(f, "{:.1} cm³ at ({x:.0}, {y:.0}, {z:.0})", self.volume_cm3)
    }
}

/// Why a label map could not be imported. Every text is one sentence that begins with the path.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LabelError {
    /// The operating system refused.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// The compressed stream is damaged.
    #[error("{}: the gzip stream is damaged after {n_bytes} bytes of data: {source}", path.display())]
    Gzip {
        /// The file.
        path: PathBuf,
        /// Bytes of data before the damage.
        n_bytes: u64,
        /// What the decoder said.
        source: std::io::Error,
    },
    /// The header is not that of a NIfTI file, or contradicts itself.
    #[error("{}: broken NIfTI header: {message}", path.display())]
    Header {
        /// The file.
        path: PathBuf,
        /// What is wrong, with the field's name and value.
        message: String,
    },
    /// The voxels are no integers.
    #[error(
        "{}: the voxels are of type {datatype}, but labels are integers: save the label map with an \
         integer type such as uint8 (an image or a probability map is no label map)",
        path.display()
    )]
    NotInteger {
        /// The file.
        path: PathBuf,
        /// Name of the type.
        datatype: String,
    },
    /// A scaled voxel is not a whole number.
    #[error(
        "{}: voxel ({}, {}, {}) is {value} after scl_slope {slope} and scl_inter {inter}, no label",
        path.display(), voxel[0], voxel[1], voxel[2]
    )]
    FractionalLabel {
        /// The file.
        path: PathBuf,
        /// Indices of the voxel.
        voxel: [u64; 3],
        /// Its value.
        value: f64,
        /// The header's slope.
        slope: f64,
        /// The header's intercept.
        inter: f64,
    },
    /// The header tells neither sform nor qform.
    #[error(
        "{}: the header has no orientation (sform_code and qform_code are 0), so left and right are \
         unknown",
        path.display()
    )]
    NoOrientation {
        /// The file.
        path: PathBuf,
    },
    /// The voxels' affine is singular or not finite.
    #[error("{}: the {form} maps voxels to no volume (determinant {determinant})", path.display())]
    SingularAffine {
        /// The file.
        path: PathBuf,
        /// `sform` or `qform`.
        form: &'static str,
        /// Its determinant, mm³.
        determinant: f64,
    },
    /// The header announces more voxels than are allowed.
    #[error(
        "{}: the header announces {} x {} x {} voxels, more than the {max_voxels} allowed (and {max_axis} \
         along an axis)",
        path.display(), size[0], size[1], size[2]
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Announced size.
        size: [u64; 3],
        /// Most voxels allowed.
        max_voxels: u64,
        /// Most voxels allowed along an axis.
        max_axis: u64,
    },
    /// The data end before the header says they should.
    #[error("{}: the file is cut off: {expected} bytes of data announced, {found} found", path.display())]
    CutOff {
        /// The file.
        path: PathBuf,
        /// Bytes of data announced.
        expected: u64,
        /// Bytes of data found.
        found: u64,
    },
    /// The data go on after the header says they should end.
    #[error(
        "{}: more than {allowed} bytes follow the {expected} bytes of data that the header announces",
        path.display()
    )]
    TooLong {
        /// The file.
        path: PathBuf,
        /// Bytes of data announced.
        expected: u64,
        /// Bytes after them that would be passed over.
        allowed: u64,
    },
    /// So many labels or runs that this is an image or noise.
    #[error("{}: more than {max} {what}: an image or noise, not a label map", path.display())]
    NotLabels {
        /// The file.
        path: PathBuf,
        /// `different labels` or `runs of equal voxels`.
        what: &'static str,
        /// Most allowed.
        max: usize,
    },
    /// No label of the scheme's lumbar levels is there.
    #[error(
        "{}: no lumbar vertebra under the scheme {scheme} ({wanted}); the labels found are {found}",
        path.display()
    )]
    NoLumbarLabels {
        /// The file.
        path: PathBuf,
        /// Name of the scheme.
        scheme: String,
        /// Its labels, as a text.
        wanted: String,
        /// The labels found, as a text, and which scheme would fit them.
        found: String,
    },
    /// More than one scheme fits.
    #[error(
        "{}: the labels {found} fit the schemes {first} and {second}: say which with --scheme",
        path.display()
    )]
    AmbiguousScheme {
        /// The file.
        path: PathBuf,
        /// The labels found, as a text.
        found: String,
        /// The first scheme.
        first: String,
        /// The second.
        second: String,
    },
    /// Levels that do not follow each other from head to feet.
    #[error(
        "{}: under the scheme {scheme} {upper} (label {upper_label}) and {lower} (label {lower_label}) \
         do not follow each other from head to feet: their middles are {drop_mm:.0} mm apart in height \
         and {distance_mm:.0} mm in all; the labels found are {found}",
        path.display()
    )]
    NotASpine {
        /// The file.
        path: PathBuf,
        /// Name of the scheme.
        scheme: String,
        /// A level.
        upper: Level,
        /// Its label.
        upper_label: i64,
        /// The next level below.
        lower: Level,
        /// Its label.
        lower_label: i64,
        /// How much higher the upper one is, mm.
        drop_mm: f64,
        /// Distance of their middles, mm.
        distance_mm: f64,
        /// The labels found, as a text, and which scheme would fit them.
        found: String,
    },
    /// A label has two large parts.
    #[error(
        "{}: {level} (label {label}) is in two large parts, {first} and {second}: two spines, or a \
         vertebra in pieces",
        path.display()
    )]
    TwoParts {
        /// The file.
        path: PathBuf,
        /// The level.
        level: Level,
        /// Its label.
        label: i64,
        /// The largest part.
        first: PartSize,
        /// The next one.
        second: PartSize,
    },
    /// A level reaches the border of the volume.
    #[error(
        "{}: {level} (label {label}) is cut by the field of view: {area_mm2:.0} mm² of it lie on the \
         {side} border of the volume, at most {max_mm2:.0} are allowed",
        path.display()
    )]
    CutByFieldOfView {
        /// The file.
        path: PathBuf,
        /// The level.
        level: Level,
        /// Its label.
        label: i64,
        /// The border: `first i`, `last k`, ...
        side: &'static str,
        /// Area on the border, mm².
        area_mm2: f64,
        /// Largest area allowed, mm².
        max_mm2: f64,
    },
    /// A part is too small or too large for a vertebra.
    #[error(
        "{}: {level} (label {label}) has {volume_cm3:.3} cm³ in a box of {:.0} x {:.0} x {:.0} mm, \
         which is no vertebra",
        path.display(), box_mm[0], box_mm[1], box_mm[2]
    )]
    NotAVertebra {
        /// The file.
        path: PathBuf,
        /// The level.
        level: Level,
        /// Its label.
        label: i64,
        /// Its volume, cm³.
        volume_cm3: f64,
        /// Sizes of its bounding box along the axes of the volume, mm.
        box_mm: [f64; 3],
    },
    /// The smoothed surface would not have the volume of the voxels.
    #[error(
        "{}: the surface of {level} would differ in volume by {:+.2} % from its voxels, at most \
         {:.2} % are allowed",
        path.display(), 100.0 * change, 100.0 * max
    )]
    VolumeChange {
        /// The file.
        path: PathBuf,
        /// The level.
        level: Level,
        /// Relative change.
        change: f64,
        /// Largest one allowed.
        max: f64,
    },
    /// The surface is not one closed manifold.
    #[error("{}: the surface of {level} has {n_edges} open or branching edges", path.display())]
    NotManifold {
        /// The file.
        path: PathBuf,
        /// The level.
        level: Level,
        /// Edges that do not have two faces.
        n_edges: usize,
    },
    /// The surface is no mesh.
    #[error("{}: {level}: {source}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// The level.
        level: Level,
        /// Why.
        source: pedicle_mesh::MeshError,
    },
    /// A scheme file cannot be used.
    #[error("{}: {message}", path.display())]
    Scheme {
        /// The file.
        path: PathBuf,
        /// What is wrong, with line and column where there is one.
        message: String,
    },
}

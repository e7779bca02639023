//! What the command line can refuse.

use std::path::PathBuf;

use pedicle_trajectory::Level;

/// Why a command could not do its work. Every text is one sentence that names the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A mesh file could not be read.
    #[error(transparent)]
    ReadMesh(#[from] pedicle_mesh::ReadError),
    /// A mesh file could not be written.
    #[error(transparent)]
    WriteMesh(#[from] pedicle_mesh::WriteError),
    /// A plan or landmark file could not be read.
    #[error(transparent)]
    Format(#[from] pedicle_trajectory::FormatError),
    /// A label map was refused.
    #[error(transparent)]
    Labels(#[from] pedicle_labels::LabelError),
    /// A .glb file gives no surface.
    #[error(transparent)]
    Glb(#[from] crate::GlbError),
    /// An ITK transform could not be read.
    #[error(transparent)]
    ItkTransform(#[from] crate::ItkTransformError),
    /// A result would go over a file that is there.
    #[error("{}: there already; --force writes over it", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// A plan was to go to standard output.
    #[error(
        "a plan is written to a file, whose name tells the format (.ron, .json, .mrk.json); --json - \
         prints the result"
    )]
    PlanToStdout,
    /// A scheme that is neither known nor a file.
    #[error("the scheme {name:?} is neither verse nor totalsegmentator nor a .ron file")]
    UnknownScheme {
        /// The name given.
        name: String,
    },
    /// A mesh file whose name tells no level.
    #[error("{}: the name does not tell one level, as L4.stl or vertebra_L4.stl does", path.display())]
    NoLevelInName {
        /// The file.
        path: PathBuf,
    },
    /// A mesh whose coordinates nobody tells.
    #[error(
        "{}: neither a SPACE= comment nor --frame tells whether the coordinates are RAS or LPS",
        path.display()
    )]
    UnknownFrame {
        /// The file.
        path: PathBuf,
    },
    /// Two levels in different coordinates.
    #[error("{}: {first} is in {first_space}, but {second} in {}", path.display(), first_space.opposite())]
    MixedFrames {
        /// The folder.
        path: PathBuf,
        /// A level.
        first: Level,
        /// Its coordinates.
        first_space: pedicle_mesh::Space,
        /// Another level, in the other ones.
        second: Level,
    },
    /// A plan in the wrong coordinates.
    #[error(
        "{}: {n_outside} of {n_trajectories} trajectories lie outside the spine, but all lie inside with \
         x and y negated: the plan and the spine are not both in RAS or both in LPS (a Markups file \
         says its own coordinateSystem, meshes by a SPACE= comment or --frame)",
        path.display()
    )]
    PlanFlipped {
        /// The plan.
        path: PathBuf,
        /// Trajectories outside as read.
        n_outside: usize,
        /// All of them.
        n_trajectories: usize,
    },
    /// A point cloud could not be read.
    #[error("{}: cannot be read: {source}", path.display())]
    ReadCloud {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// A line of a point cloud is no point.
    #[error("{}, line {line}: {message}", path.display())]
    CloudLine {
        /// The file.
        path: PathBuf,
        /// Its number, from 1.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// There is nothing at this path.
    #[error("{}: no such file or folder", path.display())]
    NotThere {
        /// The path.
        path: PathBuf,
    },
    /// A folder could not be listed.
    #[error("{}: the folder cannot be read: {source}", path.display())]
    ReadFolder {
        /// The folder.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// A level has no surface.
    #[error("{}: no surface for {level} (expected files L1.ply to L5.ply, or .stl, .obj, .off, .vtp)", path.display())]
    MissingLevel {
        /// The folder or file.
        path: PathBuf,
        /// The level.
        level: Level,
    },
    /// A level has two surfaces.
    #[error("{}: {level} is there more than once: {first} and {second}", path.display())]
    DoubledLevel {
        /// The folder or file.
        path: PathBuf,
        /// The level.
        level: Level,
        /// The first file or label.
        first: String,
        /// The second one.
        second: String,
    },
    /// A single mesh without labels was given as a spine.
    #[error(
        "{}: the mesh has no vertex property \"label\" that tells the levels apart; give a folder \
         with L1.ply to L5.ply or a labelled PLY (labels 1 to 5, or 20 to 24 as in VerSe)",
        path.display()
    )]
    NoLabels {
        /// The file.
        path: PathBuf,
    },
    /// Labels that do not tell where L1 to L5 are.
    #[error(
        "{}: the labels {found:?} do not name L1 to L5: give all of 20 to 24, as in VerSe, or all \
         of 1 to 5 and no others but 0",
        path.display()
    )]
    UnknownLabels {
        /// The file.
        path: PathBuf,
        /// The labels found.
        found: Vec<u32>,
    },
    /// The spine, plan or target was refused.
    #[error("{context}: {error}")]
    Spine {
        /// Which file it is about.
        context: String,
        /// Why.
        error: Box<pedicle_spine::SpineError>,
    },
    /// The shape of a vertebra could not be read.
    #[error("{}: {error}", path.display())]
    Anatomy {
        /// The spine.
        path: PathBuf,
        /// Why.
        error: pedicle_trajectory::AnatomyError,
    },
    /// No plan could be made.
    #[error("{}: {error}", path.display())]
    Planner {
        /// The spine.
        path: PathBuf,
        /// Why.
        error: pedicle_trajectory::PlannerError,
    },
    /// A plan could not be judged.
    #[error("{}: {error}", path.display())]
    Assess {
        /// The plan.
        path: PathBuf,
        /// Why.
        error: pedicle_trajectory::AssessError,
    },
    /// The phantom could not be made.
    #[error(transparent)]
    Simulation(#[from] pedicle_simulation::SimulationError),
    /// The operators of a shape could not be made.
    #[error("{}: {error}", path.display())]
    Operators {
        /// The mesh.
        path: PathBuf,
        /// Why.
        error: pedicle_laplacian::OperatorError,
    },
    /// The eigenpairs of a shape could not be computed.
    #[error("{}: {error}", path.display())]
    Spectrum {
        /// The mesh.
        path: PathBuf,
        /// Why.
        error: pedicle_spectral::SpectralError,
    },
    /// The descriptors of two shapes could not be computed.
    #[error("{} and {}: {error}", source_path.display(), target_path.display())]
    Descriptors {
        /// The source.
        source_path: PathBuf,
        /// The target.
        target_path: PathBuf,
        /// Why.
        error: pedicle_descriptors::DescriptorError,
    },
    /// The map between two shapes could not be computed.
    #[error("{} and {}: {error}", source_path.display(), target_path.display())]
    Map {
        /// The source.
        source_path: PathBuf,
        /// The target.
        target_path: PathBuf,
        /// Why.
        error: pedicle_fmap::FmapError,
    },
    /// A file of landmark pairs could not be read.
    #[error(transparent)]
    Landmarks(#[from] crate::VertexPairError),
    /// Two shapes could not be put into one picture.
    #[error("{}: {error}", path.display())]
    Picture {
        /// The file of the picture.
        path: PathBuf,
        /// Why.
        error: pedicle_mesh::MeshError,
    },
    /// A shape could not be brought to unit area.
    #[error("{} cannot be brought to unit area: {error}", path.display())]
    Scaled {
        /// The mesh.
        path: PathBuf,
        /// Why.
        error: pedicle_mesh::MeshError,
    },
    /// A result would go to a file of another kind.
    #[error("{}: the extension should be {expected}", path.display())]
    Extension {
        /// The file.
        path: PathBuf,
        /// What it should be.
        expected: &'static str,
    },
    /// The folder of a result is not there.
    #[error("{}: the folder {} does not exist", path.display(), folder.display())]
    NoFolder {
        /// The file.
        path: PathBuf,
        /// Its folder.
        folder: PathBuf,
    },
    /// The result could not be written.
    #[error("{}: the result cannot be written: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
}

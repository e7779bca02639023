//! What a chore can fail with.

use std::path::PathBuf;

/// Why a chore could not be done.
#[derive(Debug, thiserror::Error)]
pub(crate) enum XtaskError {
    /// Reading or preparing a spine.
    #[error(transparent)]
    Pedicle(#[from] pedicle::Error),
    /// Reading or writing a plan.
    #[error(transparent)]
    Format(#[from] pedicle_trajectory::FormatError),
    /// Writing a mesh.
    #[error(transparent)]
    WriteMesh(#[from] pedicle_mesh::WriteError),
    /// Simplifying a vertebra.
    #[error("{spine}: {error}")]
    Mesh {
        /// Which spine.
        spine: String,
        /// Why.
        error: pedicle_mesh::MeshError,
    },
    /// Measuring the anatomy.
    #[error("{spine}: {error}")]
    Anatomy {
        /// Which spine.
        spine: String,
        /// Why.
        error: pedicle_trajectory::AnatomyError,
    },
    /// The source spine was refused.
    #[error("{spine}: {error}")]
    Model {
        /// Which spine.
        spine: String,
        /// Why.
        error: Box<pedicle_spine::SpineError>,
    },
    /// A scenario could not be simulated.
    #[error(transparent)]
    Simulation(#[from] pedicle_simulation::SimulationError),
    /// A transferred trajectory could not be checked.
    #[error("{scenario}: {error}")]
    Check {
        /// Which scenario.
        scenario: String,
        /// Why.
        error: String,
    },
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Figures of a run could not be summed up.
    #[error("{}: {message}", path.display())]
    Total {
        /// The file.
        path: PathBuf,
        /// Why.
        message: String,
    },
    /// The gates are not as they should be.
    #[error("{}: {message}", path.display())]
    Gates {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// Threads could not be started.
    #[error("the thread pool could not be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// A mesh file could not be read.
    #[error(transparent)]
    ReadMesh(#[from] pedicle_mesh::ReadError),
    /// A computation that is measured failed.
    #[error("{stage}: {reason}")]
    Stage {
        /// Which stage.
        stage: String,
        /// Why.
        reason: String,
    },
    /// A measured process failed.
    #[error("{command} failed with {status}: {message}")]
    Child {
        /// The command line.
        command: String,
        /// How it ended.
        status: std::process::ExitStatus,
        /// The end of what it said.
        message: String,
    },
    /// A file of a measured process makes no sense.
    #[error("{}: {message}", path.display())]
    Measurement {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// A command could not be started.
    #[error("{command}: {source}")]
    Command {
        /// The command line.
        command: String,
        /// Why.
        source: std::io::Error,
    },
}

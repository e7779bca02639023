//! `cargo xtask make-phantom`: writes the phantom spine of `fixtures/`.

use std::path::PathBuf;

use clap::Args;
use pedicle_mesh::{WriteOptions, write_mesh};
use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};
use pedicle_trajectory::{write_landmarks, write_plan};

use crate::{XtaskError, fixture, say};

/// Write the phantom spine with its plan and landmarks. Without --subject it is the one in
/// fixtures/.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Folder to write to; fixtures/phantom of the workspace by default.
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Draw a subject from the published spread of the dimensions instead of the mean one.
    #[arg(long, value_name = "SEED")]
    subject: Option<u64>,
}

impl Arguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        let parameters = self
            .subject
            .map_or_else(PhantomParameters::default, PhantomParameters::subject);
        let phantom = generate_phantom(&parameters, &MeshingOptions::default())?;
        let output = self.output.unwrap_or_else(|| fixture("phantom"));
        std::fs::create_dir_all(&output).map_err(|source| XtaskError::File {
            path: output.clone(),
            source,
        })?;
        for vertebra in &phantom.vertebrae {
            let path = output.join(format!("{}.ply", vertebra.level));
            write_mesh(&path, &vertebra.mesh, &WriteOptions::default())?;
            say(&format!(
                "{}: {} faces",
                path.display(),
                vertebra.mesh.n_faces()
            ));
        }
        write_plan(output.join("plan.ron"), &phantom.plan())?;
        write_landmarks(output.join("landmarks.ron"), &phantom.landmarks())?;
        Ok(true)
    }
}

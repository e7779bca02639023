//! `pedicle spectrum`: the smallest Laplace eigenvalues of a mesh.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use comfy_table::presets::UTF8_FULL_CONDENSED;
use comfy_table::{CellAlignment, Table};
use pedicle_mesh::read_mesh;

use super::console::Console;
use super::exit_code;
use crate::Error;
use crate::shape::{OperatorChoice, SpectrumFile, spectrum};

/// Smallest eigenvalues of the Laplacian of a mesh, with a proof that none is missing.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// The mesh: OFF, PLY, OBJ or STL. Vertices of STL with equal coordinates are made one.
    #[arg(value_name = "MESH")]
    mesh: PathBuf,
    /// Number of eigenvalues.
    #[arg(short, long = "count", value_name = "K", default_value_t = 200,
          value_parser = super::at_least_one)]
    k: usize,
    /// How the Laplacian is made.
    #[arg(long, value_enum, default_value_t = OperatorChoice::Cotangent)]
    operator: OperatorChoice,
    /// Write eigenvalues, residuals and what was done as JSON; - for standard output.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
}

const EXAMPLES: &str = "\
Examples:
  pedicle spectrum bone.ply
  pedicle spectrum scan.stl -k 100 --operator robust --json spectrum.json

JSON keys: eigenvalues (ascending, one over the unit of the file squared), residuals
(norm of W x - lambda M x in the inverse of M, one a pair), certified (the eigenvalues below the
last one were counted and none is missing), certificate, n_vertices, n_faces, area,
null_dimension (connected pieces), operators (what was done to the mesh's Laplacian).

Exit codes: 0 certified, 3 not certified, 2 wrong usage or input.";

/// Eigenvalues shown at the beginning and at the end of the table.
const N_FIRST: usize = 12;
const N_LAST: usize = 3;

impl Arguments {
    pub(super) fn run(self, console: Console) -> Result<ExitCode, Error> {
        if let Some(path) = &self.json {
            console.check_output(path, None)?;
        }
        let bar = console.bar(2);
        bar.set_message("reading the mesh");
        let mesh = read_mesh(&self.mesh)?.mesh;
        bar.inc(1);
        bar.set_message("eigenvalues");
        let found = spectrum(&self.mesh, &mesh, self.k, self.operator)?;
        bar.finish_and_clear();
        console.report(self.json.as_deref(), &found, &summary(&found))?;
        Ok(exit_code(found.certified))
    }
}

fn summary(found: &SpectrumFile) -> String {
    let mut table = Table::new();
    table
        .load_style(UTF8_FULL_CONDENSED)
        .set_header(["index", "eigenvalue", "residual"]);
    for column in table.column_iter_mut() {
        column.set_cell_alignment(CellAlignment::Right);
    }
    let n = found.eigenvalues.len();
    let skipped = N_FIRST..n.saturating_sub(N_LAST).max(N_FIRST);
    for (i, (value, residual)) in found.eigenvalues.iter().zip(&found.residuals).enumerate() {
        if skipped.contains(&i) {
            if i == skipped.start {
                table.add_row(["…", "…", "…"]);
            }
            continue;
        }
        let row = [
            i.to_string(),
            format!("{value:.10e}"),
            format!("{residual:.1e}"),
        ];
        table.add_row(row);
    }
    let operators = &found.operators;
    let certificate = if found.certified {
        "certified: counting shows that none is missing".to_owned()
    } else {
        format!(
            "NOT certified: {} eigenvalues below the shift were counted, {} found",
            found.certificate.n_below, found.certificate.n_found
        )
    };
    format!(
        "{}: {} vertices, {} faces, area {:.6}, connected pieces {}\n\
         operators: {}, mollification {:.2e} of the mean edge, {} flips, {} negative weights\n\
         met: {} faces without area, {} slivers, {} edges of three or more faces, {} faces and {} \
         vertices left out\n\
         {n} eigenvalues, {certificate}\n{table}",
        found.mesh,
        found.n_vertices,
        found.n_faces,
        found.area,
        found.null_dimension,
        operators.construction,
        operators.relative_mollification,
        operators.n_flips,
        operators.n_negative_weights,
        operators.n_zero_area_faces,
        operators.n_sliver_faces,
        operators.n_non_manifold_edges,
        operators.n_faces_left_out,
        operators.n_unreferenced_vertices,
    )
}

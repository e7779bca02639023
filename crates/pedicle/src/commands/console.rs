//! What every command shares: how much it says, and whether it may write over files.

use std::path::Path;

use clap::Args;
use indicatif::ProgressBar;
use serde::Serialize;

use super::progress::progress_bar;
use super::say;
use crate::shape::check_output;
use crate::{Error, write_json};

/// Stands for standard output where a file is expected.
const STDOUT: &str = "-";

/// Options of every command.
#[derive(Debug, Clone, Copy, Args)]
pub(super) struct Console {
    /// Say nothing but errors: no table, no progress.
    #[arg(long, short, global = true)]
    quiet: bool,
    /// Write over files that are there already.
    #[arg(long, global = true)]
    force: bool,
}

impl Console {
    /// A bar of so many steps; none if quiet, or where standard error is no terminal.
    pub(super) fn bar(self, n_steps: u64) -> ProgressBar {
        if self.quiet {
            return ProgressBar::hidden();
        }
        progress_bar(n_steps)
    }

    /// Checks before the work that a result can be written.
    pub(super) fn check_output(
        self,
        path: &Path,
        extension: Option<&'static str>,
    ) -> Result<(), Error> {
        if is_stdout(path) && extension.is_none() {
            return Ok(());
        }
        check_output(path, extension)?;
        self.check_new(path)
    }

    /// Checks before the work that a plan can be written: its name tells the format, so it is a file.
    pub(super) fn check_plan_output(self, path: &Path) -> Result<(), Error> {
        if is_stdout(path) {
            return Err(Error::PlanToStdout);
        }
        self.check_output(path, None)
    }

    /// Refuses a file that is there already, unless it may be written over.
    pub(super) fn check_new(self, path: &Path) -> Result<(), Error> {
        if self.force || !path.exists() {
            return Ok(());
        }
        Err(Error::Exists {
            path: path.to_owned(),
        })
    }

    /// Writes the JSON where it is wanted, and says the text unless JSON goes to standard output.
    pub(super) fn report(
        self,
        json: Option<&Path>,
        value: &impl Serialize,
        text: &str,
    ) -> Result<(), Error> {
        match json {
            Some(path) if is_stdout(path) => {
                let json = serde_json::to_string_pretty(value).map_err(|error| Error::Write {
                    path: path.to_owned(),
                    source: error.into(),
                })?;
                say(&json);
                return Ok(());
            }
            Some(path) => write_json(path, value)?,
            None => {}
        }
        self.say(text);
        Ok(())
    }

    /// Says a text unless quiet.
    pub(super) fn say(self, text: &str) {
        if !self.quiet {
            say(text);
        }
    }
}

fn is_stdout(path: &Path) -> bool {
    path.as_os_str() == STDOUT
}

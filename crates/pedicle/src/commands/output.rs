//! Where the clinical commands write: a file, whole or not at all, or standard output.

use std::path::Path;

use serde::Serialize;

use super::say;
use crate::{Error, write_json};

/// Whether `--json` names standard output.
pub(super) fn is_stdout(json: Option<&Path>) -> bool {
    json == Some(Path::new("-"))
}

/// Writes `value` where `--json` says and prints `text`, unless standard output is the JSON's.
pub(super) fn deliver(
    json: Option<&Path>,
    value: &impl Serialize,
    text: &str,
) -> Result<(), Error> {
    if is_stdout(json) {
        let written = serde_json::to_string_pretty(value).map_err(|error| Error::Write {
            path: "-".into(),
            source: error.into(),
        })?;
        say(&written);
        return Ok(());
    }
    if let Some(path) = json {
        write_json(path, value)?;
    }
    say(text);
    Ok(())
}

/// Refuses to write over a file that is there.
pub(super) fn refuse_overwrite(path: &Path, force: bool) -> Result<(), Error> {
    if path.exists() && !force {
        return Err(Error::Exists {
            path: path.to_owned(),
        });
    }
    Ok(())
}

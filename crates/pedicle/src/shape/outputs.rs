//! Files of results, whole or not at all, and refused before the work where that can be known.

use std::io::Write;
use std::path::Path;

use crate::Error;

/// Checks before a long computation that a result can be written to `path`.
///
/// `expected` is the extension it must have, such as `.ply`; `None` if any will do.
///
/// # Errors
/// [`Error::Extension`] for another extension, [`Error::NoFolder`] if the folder does not exist,
/// [`Error::Write`] if no file can be made in it or `path` is a folder.
pub fn check_output(path: &Path, expected: Option<&'static str>) -> Result<(), Error> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    if let Some(expected) = expected
        && !expected[1..].eq_ignore_ascii_case(extension)
    {
        return Err(Error::Extension {
            path: path.to_owned(),
            expected,
        });
    }
    let refused = |source| Error::Write {
        path: path.to_owned(),
        source,
    };
    if path.is_dir() {
        return Err(refused(std::io::ErrorKind::IsADirectory.into()));
    }
    // Removed again at once.
    temporary_beside(path)?;
    Ok(())
}

/// Writes bytes, whole or not at all: first beside the file, then renamed.
///
/// # Errors
/// [`Error::NoFolder`] if the folder does not exist, [`Error::Write`] if it cannot be written.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let refused = |source| Error::Write {
        path: path.to_owned(),
        source,
    };
    let mut file = temporary_beside(path)?;
    file.write_all(bytes).map_err(refused)?;
    file.persist(path).map_err(|e| refused(e.error))?;
    Ok(())
}

fn temporary_beside(path: &Path) -> Result<tempfile::NamedTempFile, Error> {
    let folder = path
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(Error::NoFolder {
            path: path.to_owned(),
            folder: folder.to_owned(),
        });
    }
    let builder = tempfile::Builder::new();
    // A temporary file is its owner's alone unless told otherwise; the umask still applies.
    #[cfg(unix)]
    let builder = {
        let mut builder = builder;
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        builder
    };
    builder.tempfile_in(folder).map_err(|source| Error::Write {
        path: path.to_owned(),
        source,
    })
}

//! Files of a report.

use std::path::Path;

use super::error::ReportError;

/// Writes one into a folder.
pub(super) fn write(folder: &Path, name: &str, text: &str) -> Result<(), ReportError> {
    let path = folder.join(name);
    std::fs::write(&path, text).map_err(|source| ReportError::Write { path, source })
}

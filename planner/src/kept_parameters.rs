//! The parameters of programs that outlive a run: in the user's file between two runs, and for each run in the cell's folder, as it started with them.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use std::io;

use bus::cell::CellPaths;
use bus::kept_parameters::{parameter_file, parameters_now, parameters_of_run};
use machine::settings_file::SettingsFileError;
use machine::{KeptParameters, parameter_text, parse_parameters, replace_file};

/// The file of a cell's machine.
#[derive(Debug)]
pub(crate) struct ParameterFile {
    paths: CellPaths,
    /// Programs come and go; the one program of a run has its parameters in the machine file.
    stays: bool,
    /// What was kept last.
    kept: Option<KeptParameters>,
}

impl ParameterFile {
    pub fn of_cell(paths: CellPaths, stays: bool) -> ParameterFile {
        ParameterFile {
            paths,
            stays,
            kept: None,
        }
    }

    /// Those that a run begins with, or that the next one would; none where the machine file holds them.
    pub fn read(
        &self,
        run: Option<(u32, u32)>,
    ) -> Result<Option<KeptParameters>, SettingsFileError> {
        if !self.stays {
            return Ok(None);
        }
        let text = match run {
            Some((load, run)) => parameters_of_run(&self.paths, load, run),
            None => parameters_now(&self.paths),
        };
        let name = match parameter_file(&self.paths) {
            Ok(Some(file)) => file.display().to_string(),
            _ => "parameters".to_owned(),
        };
        let unreadable = |error: io::Error| SettingsFileError::Unreadable {
            path: name.clone(),
            what: error.to_string(),
        };
        let text = text.map_err(unreadable)?;
        text.map(|text| parse_parameters(&name, &text)).transpose()
    }

    /// Writes them into the user's file, whole or not at all; nowhere where the cell has none.
    pub fn keep(&mut self, parameters: &KeptParameters) -> io::Result<()> {
        let Some(file) = parameter_file(&self.paths)? else {
            return Ok(());
        };
        if self.kept.as_ref() == Some(parameters) {
            return Ok(());
        }
        let named =
            |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", file.display()));
        replace_file(&file, &parameter_text(parameters)).map_err(named)?;
        self.kept = Some(parameters.clone());
        Ok(())
    }
}

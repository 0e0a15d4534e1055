//! What outlives a run of a program: in the user's files between two runs, and for each run in the cell's folder, as it started with it.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::cell::CellPaths;
use machine::settings_file::SettingsFileError;
use machine::{KeptFiles, KeptParameters, KeptTexts, Machine, Tool};

/// What a program leaves at its end.
#[derive(Debug, Clone, PartialEq)]
pub struct Left {
    /// The parameters that outlive it.
    pub parameters: KeptParameters,
    /// The tools, as it has changed them.
    pub tools: Vec<Tool>,
}

/// The files of a cell's machine.
#[derive(Debug)]
pub(crate) struct Keeper {
    paths: CellPaths,
    /// Programs come and go; the one program of a run has what it begins with in the machine file.
    stays: bool,
    /// What was kept last.
    kept: Option<Left>,
}

impl Keeper {
    pub fn of_cell(paths: CellPaths, stays: bool) -> Keeper {
        Keeper {
            paths,
            stays,
            kept: None,
        }
    }

    /// What a run begins with, or what the next one would; none where the machine file holds it.
    pub fn read(
        &self,
        run: Option<(u32, u32)>,
        machine: &Machine,
    ) -> Result<Option<KeptTexts>, SettingsFileError> {
        if !self.stays {
            return Ok(None);
        }
        let texts = match run {
            Some(run) => KeptTexts::of_run(&self.paths, run, machine)?,
            None => KeptFiles::of_cell(&self.paths)?.read(machine)?,
        };
        Ok(Some(texts))
    }

    /// Writes it into the user's files, each whole or not at all; nowhere where the cell has none.
    pub fn keep(&mut self, machine: &Machine, left: &Left) -> Result<(), SettingsFileError> {
        if self.kept.as_ref() == Some(left) {
            return Ok(());
        }
        let files = KeptFiles::of_cell(&self.paths)?;
        files.keep(machine, &left.parameters, &left.tools)?;
        self.kept = Some(left.clone());
        Ok(())
    }
}

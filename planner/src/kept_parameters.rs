//! What outlives a run of a program: in the user's files between two runs, and for each run in the cell's folder, as it started with it.

use bus::cell::CellPaths;
use bus::sample::Auxiliaries;
use machine::settings_file::SettingsFileError;
use machine::{KeptFiles, KeptParameters, KeptTexts, Machine, Tool, keep_tool, replace_file};

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
    /// The modes that were kept last, and of which run.
    modes: Option<(u32, String)>,
    /// The tool that its file holds.
    tool: Option<u32>,
}

impl Keeper {
    pub fn of_cell(paths: CellPaths, stays: bool) -> Keeper {
        Keeper {
            paths,
            stays,
            kept: None,
            modes: None,
            tool: None,
        }
    }

    /// What a run begins with, or what the next one would; none where the machine file holds it.
    pub fn read(
        &self,
        run: Option<(u32, u32)>,
        machine: &Machine,
        shown: &Auxiliaries,
    ) -> Result<Option<KeptTexts>, SettingsFileError> {
        if !self.stays {
            return Ok(None);
        }
        let texts = match run {
            Some(run) => KeptTexts::of_run(&self.paths, run, machine, shown)?,
            None => KeptTexts::now(&self.paths, machine, shown)?,
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

    /// Keeps the modes that a run leaves, for the next one, whole or not at all.
    pub fn keep_modes(&mut self, run: u32, modes: &str) -> Result<(), SettingsFileError> {
        let is_kept = |(of, kept): &(u32, String)| *of == run && kept == modes;
        if !self.stays || self.modes.as_ref().is_some_and(is_kept) {
            return Ok(());
        }
        replace_file(&self.paths.modes(run), modes)?;
        self.modes = Some((run, modes.to_owned()));
        Ok(())
    }

    /// Keeps the tool in the spindle over the end of the cell. The one program of a run changes the file only where it is there.
    pub fn keep_tool(&mut self, machine: &Machine, tool: u32) -> Result<(), SettingsFileError> {
        if self.tool == Some(tool) {
            return Ok(());
        }
        let files = KeptFiles::of_cell(&self.paths)?;
        let is_changed = self.tool.is_some() || tool != machine.beginning.tool;
        self.tool = Some(tool);
        match files.spindle {
            Some(file) if file.exists() || self.stays && is_changed => keep_tool(&file, tool),
            _ => Ok(()),
        }
    }
}

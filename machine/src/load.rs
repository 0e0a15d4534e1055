//! Reads a machine file.

use std::path::{Path, PathBuf};

use toml_edit::{Array, DocumentMut, Item, TableLike, value};

use crate::axis::ENDLESS_DEG;
use crate::axis_kind::AxisKind;
use crate::beginning::Beginning;
use crate::error_file::read_errors;
use crate::kept::KeptTexts;
use crate::kept_files::KeptFiles;
use crate::machine::Machine;
use crate::parameter_file::parse_parameters;
use crate::renamed::RENAMED;
use crate::rules;
use crate::settings_file::{self, Rules, Schema, SettingsFileError, read_text};
use crate::tool_table::parse_tools;
use crate::transmission;

impl Machine {
    /// Reads and checks a machine file; `path` is the file or its folder.
    ///
    /// # Errors
    /// Unreadable, too large, not UTF-8, not TOML, unknown or missing keys, or values against their rules: each with file, line,
    /// value, unit and what would be right.
    pub fn load(path: &Path) -> Result<Machine, SettingsFileError> {
        let path = machine_file(path);
        let (name, text) = (path.display().to_string(), read_text(&path)?);
        let mut machine = Self::parse(&name, &text)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        if machine.read_error_files(folder)? {
            let mut rules = Rules::of(&name, &text);
            rules::judge_geometry(&mut rules, &machine);
            rules.judge()?;
        }
        let files = KeptFiles::of(&machine, &path);
        if !machine.program.tool_table.is_empty() && files.tools.is_none() {
            let table = folder.join(&machine.program.tool_table);
            machine.tools = parse_tools(&table.display().to_string(), &read_text(&table)?)?;
        }
        let mut kept = files.read(&machine)?;
        if files.offsets.is_none() {
            // A copy holds what its run began with.
            kept.parameters.clone_from(&machine.program.parameters);
        }
        if files.spindle.is_none() {
            kept.begins_with.clone_from(&machine.program.begins_with);
        }
        machine.take_kept(kept)?;
        machine.kept_files = files;
        let folders = machine.program.subroutine_folders.iter();
        machine.subroutine_folders = folders.map(|within| folder.join(within)).collect();
        Ok(machine)
    }

    /// Where the programs of user M-codes lie that are named in this machine file; none if they are not switched on.
    pub fn user_code_folder(&self, machine_file: &Path) -> Option<PathBuf> {
        let name = &self.program.user_codes;
        let folder = machine_file.parent().unwrap_or(Path::new(""));
        (!name.is_empty()).then(|| folder.join(name))
    }

    /// The folder that its own logic is run in; none without one.
    pub fn logic_folder(&self, machine_file: &Path) -> Option<PathBuf> {
        let folder = machine_file.parent().unwrap_or(Path::new(""));
        Some(folder.join(&self.logic.as_ref()?.folder))
    }

    /// Copies its drive and terminal files from the folder of its file into another.
    ///
    /// # Errors
    /// A file that cannot be copied.
    pub fn copy_drive_files(&self, from: &Path, to: &Path) -> Result<(), SettingsFileError> {
        let drives = self.axes.iter().filter_map(|axis| axis.drive.as_ref());
        let terminals = self.bus.iter().flat_map(|bus| &bus.terminals);
        let files = drives.map(|drive| &drive.file);
        for file in files.chain(terminals.map(|terminal| &terminal.file)) {
            copy_file(&from.join(file), &to.join(file))?;
        }
        Ok(())
    }

    /// Reads the tables of errors that axes have in files of their own; whether there are any.
    fn read_error_files(&mut self, folder: &Path) -> Result<bool, SettingsFileError> {
        let mut read = false;
        for axis in &mut self.axes {
            let of = axis.compensation.as_mut();
            let Some(of) = of.filter(|of| !of.file.is_empty()) else {
                continue;
            };
            of.read_from = std::mem::take(&mut of.file);
            let path = folder.join(&of.read_from);
            let name = path.display().to_string();
            read_errors(&name, &read_text(&path)?, axis.kind, of)?;
            read = true;
        }
        Ok(read)
    }

    /// Checks the text of a machine file; `name` is in the messages. A tool table or parameters in a
    /// file of their own are not read.
    ///
    /// # Errors
    /// As [`Machine::load`].
    pub fn parse(name: &str, text: &str) -> Result<Machine, SettingsFileError> {
        let mut machine: Machine =
            settings_file::load_with(name, text, RENAMED, complete, rules::judge)?;
        machine.tools = parse_tools(&format!("{name}: tools"), &machine.program.tools)?;
        machine.parameters =
            parse_parameters(&format!("{name}: parameters"), &machine.program.parameters)?;
        let beginning = format!("{name}: begins_with");
        machine.beginning = Beginning::parse(&beginning, &machine.program.begins_with)?;
        Ok(machine)
    }
}

/// Gives every axis with a transmission its lead, and every axis that turns without end a travel beyond what it will ever turn.
fn complete(file: &mut toml::Table) {
    let axes = file.get_mut("axis").and_then(toml::Value::as_array_mut);
    for axis in axes.into_iter().flatten() {
        let Some(axis) = axis.as_table_mut() else {
            continue;
        };
        transmission::complete(axis);
        if axis.get("modulo").and_then(toml::Value::as_bool) == Some(true) {
            for (key, end) in [
                ("travel_min_mm", -ENDLESS_DEG),
                ("travel_max_mm", ENDLESS_DEG),
            ] {
                axis.entry(key).or_insert(toml::Value::Float(end));
            }
        }
    }
}

/// The text of a machine file that needs no other file, with what a run began with.
///
/// # Errors
/// It is no TOML.
pub fn with_kept(text: &str, kept: &KeptTexts) -> Result<String, toml_edit::TomlError> {
    let mut document: DocumentMut = text.parse()?;
    set_kept(&mut document, kept);
    Ok(document.to_string())
}

fn program_of(document: &mut DocumentMut) -> Option<&mut dyn TableLike> {
    let program = document.entry("program").or_insert_with(toml_edit::table);
    program.as_table_like_mut()
}

fn set_kept(document: &mut DocumentMut, kept: &KeptTexts) {
    let texts = [&kept.parameters, &kept.begins_with];
    let has_nothing = texts.into_iter().chain(&kept.tools).all(String::is_empty);
    if has_nothing && !document.contains_key("program") {
        return;
    }
    let Some(program) = program_of(document) else {
        return;
    };
    let mut set = |key: &str, text: &str| {
        let now = program.get(key).and_then(Item::as_str);
        match text {
            _ if now.unwrap_or_default() == text => {}
            "" => drop(program.remove(key)),
            text => drop(program.insert(key, value(text))),
        }
    };
    set("parameters", &kept.parameters);
    set("begins_with", &kept.begins_with);
    if let Some(tools) = &kept.tools {
        set("tools", tools);
    }
}

/// The text of a machine file that needs no other file: a tool table and parameters stand in it,
/// and the folder of user M-codes is named in full. For copies that a run or a cell keeps.
///
/// # Errors
/// A file that cannot be read, or is no TOML.
pub fn snapshot(path: &Path) -> Result<String, SettingsFileError> {
    let path = machine_file(path);
    let text = read_text(&path)?;
    let unreadable = |error: toml_edit::TomlError| SettingsFileError::Unreadable {
        path: path.display().to_string(),
        what: error.to_string(),
    };
    let mut document: DocumentMut = text.parse().map_err(unreadable)?;
    let machine = Machine::load(&path)?;
    let files = &machine.kept_files;
    let kept = KeptTexts {
        parameters: machine.program.parameters.clone(),
        begins_with: machine.program.begins_with.clone(),
        tools: files.tools.as_ref().map(|_| machine.program.tools.clone()),
    };
    set_kept(&mut document, &kept);
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut changed = name_logic_folder(&mut document, folder);
    changed |= put_errors_in(&mut document, &machine);
    if !document.contains_key("program") {
        return Ok(if changed { document.to_string() } else { text });
    }
    let Some(program) = program_of(&mut document) else {
        return Ok(text);
    };
    let named = |item: Item| folder.join(item.as_str().unwrap_or_default());
    let tool_table = program.remove("tool_table").map(named);
    program.remove("parameter_file");
    program.remove("offsets");
    if let Some(folder) = program.remove("user_codes").map(named) {
        // They are run where they are; a copy names their folder in full.
        let folder = std::path::absolute(&folder).unwrap_or(folder);
        program.insert("user_codes", value(folder.to_string_lossy().into_owned()));
    }
    if let Some(table) = tool_table.filter(|_| files.tools.is_none()) {
        program.insert("tools", value(read_text(&table)?));
    }
    Ok(document.to_string())
}

/// The logic runs in the folder of the file that it stands in: a copy names that in full.
fn name_logic_folder(document: &mut DocumentMut, from: &Path) -> bool {
    let logic = document.get_mut("logic").and_then(Item::as_table_like_mut);
    let Some(logic) = logic else {
        return false;
    };
    let folder = logic
        .get("folder")
        .and_then(Item::as_str)
        .unwrap_or_default();
    let folder = from.join(folder);
    let folder = std::path::absolute(&folder).unwrap_or(folder);
    logic.insert("folder", value(folder.to_string_lossy().into_owned()));
    true
}

/// Tables of errors stand in a copy, whatever file they were read from; whether any does.
fn put_errors_in(document: &mut DocumentMut, machine: &Machine) -> bool {
    let axes = document
        .get_mut("axis")
        .and_then(Item::as_array_of_tables_mut);
    let mut changed = false;
    let tables = axes.into_iter().flat_map(|axes| axes.iter_mut());
    for (table, axis) in tables.zip(&machine.axes) {
        let entry = table
            .get_mut("compensation")
            .and_then(Item::as_table_like_mut);
        let Some((entry, of)) = entry.zip(axis.compensation.as_ref()) else {
            continue;
        };
        if entry.remove("file").is_none() {
            continue;
        }
        changed = true;
        let [at, there, back] = match axis.kind {
            AxisKind::Linear => ["positions_mm", "forward_um", "backward_um"],
            AxisKind::Rotary => ["positions_deg", "forward_mdeg", "backward_mdeg"],
        };
        for (key, list) in [
            (at, &of.positions_mm),
            (there, &of.forward_um),
            (back, &of.backward_um),
        ] {
            let list: Array = list.iter().copied().collect();
            entry.insert(key, value(list));
        }
    }
    changed
}

/// Copies what a machine file names, tool table, parameters, tables of errors and drive files, into the folder of a copy of it, if it is named from the file's folder.
///
/// # Errors
/// A machine file that cannot be used, or a file that cannot be copied.
pub fn copy_named_files(path: &Path, folder: &Path) -> Result<(), SettingsFileError> {
    let path = machine_file(path);
    let machine = Machine::load(&path)?;
    let beside = path.parent().unwrap_or(Path::new(""));
    machine.copy_drive_files(beside, folder)?;
    let errors = machine
        .axes
        .into_iter()
        .filter_map(|axis| axis.compensation);
    let program = machine.program;
    let named = [program.tool_table, program.parameter_file].into_iter();
    let named: Vec<String> = named.chain(errors.map(|of| of.read_from)).collect();
    let here = |name: &&String| !name.is_empty() && !Path::new(name).is_absolute();
    for name in named.iter().filter(here) {
        let from = beside.join(name);
        // Parameters need not be there yet.
        if from.exists() {
            copy_file(&from, &folder.join(name))?;
        }
    }
    Ok(())
}

fn copy_file(from: &Path, to: &Path) -> Result<(), SettingsFileError> {
    let copied = to
        .parent()
        .map_or(Ok(()), std::fs::create_dir_all)
        .and_then(|()| std::fs::copy(from, to));
    copied
        .map(|_| ())
        .map_err(|error| SettingsFileError::Unreadable {
            path: from.display().to_string(),
            what: error.to_string(),
        })
}

/// The machine file that a MACHINE argument names: the file itself or `machine.toml` in a folder.
pub fn machine_file(path: &Path) -> PathBuf {
    if path.is_dir() {
        path.join("machine.toml")
    } else {
        path.to_path_buf()
    }
}

/// What a machine file may hold.
pub fn schema() -> Schema {
    Schema::of::<Machine>()
}

//! `quadrant new machine`: a folder for a machine of one's own, of a few numbers for each axis, that checks and runs.
//!
//! What is not given is estimated so that the axis can do what is asked of it; the files say of every value where it is from.

mod ask;
mod axis;
mod files;

use std::fs;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail};
use bus::cell::is_cell_name;
use console::exit::{Kind, Outcome};
use console::output::{joined, say};
use launcher::check::{self, Depth};

use crate::options::NewMachineOptions;
use axis::NewAxis;
use files::Files;

/// Steps of the simulation that are tried, in µs: the longest that resolves the stiffest axis is taken.
const MICROSTEPS_US: [f64; 7] = [25.0, 12.5, 5.0, 2.5, 1.25, 2.0, 1.0];
/// Axes of a machine that somebody is asked about.
const EXAMPLE: &str = "quadrant new machine my-machine --axis X:travel=-200..200,lead=10 --axis Y:travel=-150..150,lead=10";

/// Writes the folder of a new machine, and says what can be done with it.
pub fn new_machine(options: &NewMachineOptions) -> Outcome {
    say(&written(options).input()?);
    Ok(())
}

/// Writes the folder of a new machine; what can be done with it.
///
/// # Errors
/// The folder is there already or cannot be written, or no machine has such axes.
pub fn written(options: &NewMachineOptions) -> anyhow::Result<String> {
    let folder = options.folder.display();
    if options.folder.exists() {
        bail!("{folder} is there already: give the new machine another folder");
    }
    let name = cell_name(options)?;
    let axes = axes(options)?;
    write(options, &name, &axes)?;
    Ok(format!(
        "{folder}: machine {name}, {}\n\n  \
         {folder}/machine.toml      what the controller knows\n  \
         {folder}/plant.toml        what is true of the simulated machine\n  \
         {folder}/{}   a program to begin with\n\n\
         {}\n  \
         quadrant new machine --help      what an axis can be given",
        joined(axes.iter().map(NewAxis::summary), "; "),
        files::PROGRAM,
        next(&options.folder, &axes),
    ))
}

/// What to do with the new folder.
fn next(folder: &Path, axes: &[NewAxis]) -> String {
    let shown = folder.display();
    let homed = axes.iter().filter(|axis| axis.incremental);
    let homed: Vec<&str> = homed.map(|axis| axis.letter.as_str()).collect();
    if !homed.is_empty() {
        return format!(
            "It checks, and runs once it is homed: the encoders of {} are incremental. Next:\n\n  \
             quadrant up {shown}          the cell, which stays up; in another terminal:\n  \
             quadrant enable\n  \
             quadrant home --wait\n  \
             quadrant load {shown}/{}\n  \
             quadrant start",
            homed.join(" "),
            files::PROGRAM,
        );
    }
    let tune = match axes.iter().any(|axis| axis.two_motors) {
        true => String::new(),
        false => format!("\n  quadrant tune {shown}"),
    };
    format!(
        "It checks and runs. Next:\n\n  quadrant run {shown} {shown}/{}{tune}",
        files::PROGRAM
    )
}

/// The machine's name: given, or that of its folder.
fn cell_name(options: &NewMachineOptions) -> anyhow::Result<String> {
    let of_folder = options
        .folder
        .file_name()
        .map(|name| name.to_string_lossy());
    let name = match (&options.name, of_folder) {
        (Some(name), _) => name.clone(),
        (None, Some(name)) => name.to_lowercase().replace([' ', '_', '.'], "-"),
        (None, None) => bail!("{}: a new folder is needed", options.folder.display()),
    };
    if !is_cell_name(&name) {
        bail!(
            "{name:?}: a machine's name has lower-case letters, digits and hyphens: give one with --name"
        );
    }
    Ok(name)
}

fn axes(options: &NewMachineOptions) -> anyhow::Result<Vec<NewAxis>> {
    let given = match options.axis.as_slice() {
        [] if std::io::stdin().is_terminal() => ask::axes()?,
        [] => bail!("which axes has it? For example\n  {EXAMPLE}"),
        given => given.to_vec(),
    };
    let axes: Vec<NewAxis> = given
        .iter()
        .map(|text| NewAxis::read(text))
        .collect::<anyhow::Result<_>>()?;
    for (index, axis) in axes.iter().enumerate() {
        if axes
            .iter()
            .take(index)
            .any(|other| other.letter == axis.letter)
        {
            bail!(
                "axis {} is there twice: every axis has its own letter",
                axis.letter
            );
        }
    }
    Ok(axes)
}

/// Writes the files beside the folder, checks them, and gives them its name: it is there whole or not at all.
fn write(options: &NewMachineOptions, name: &str, axes: &[NewAxis]) -> anyhow::Result<()> {
    let parent = match options.folder.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    fs::create_dir_all(parent).with_context(|| parent.display().to_string())?;
    let unfinished: PathBuf = parent.join(format!(".{name}-{}", std::process::id()));
    let written = fill(&unfinished, options, name, axes).and_then(|()| {
        fs::rename(&unfinished, &options.folder)
            .with_context(|| options.folder.display().to_string())
    });
    if written.is_err() {
        let _ = fs::remove_dir_all(&unfinished);
    }
    written
}

fn fill(
    folder: &Path,
    options: &NewMachineOptions,
    name: &str,
    axes: &[NewAxis],
) -> anyhow::Result<()> {
    fs::create_dir_all(folder.join("programs")).with_context(|| folder.display().to_string())?;
    let mut last = anyhow!("no step of the simulation resolves it");
    for microstep_us in MICROSTEPS_US {
        let files = Files {
            name,
            scan_us: options.scan_us,
            microstep_us,
            axes,
        };
        for (file, text) in files.all()? {
            let file = folder.join(file);
            fs::write(&file, text).with_context(|| file.display().to_string())?;
        }
        let program = folder.join(files::PROGRAM);
        match check::load(folder, Some(&program), Depth::Whole) {
            Ok(_) => return Ok(()),
            Err(error) if format!("{error:#}").contains("microstep_us") => last = error,
            Err(error) => return Err(error),
        }
    }
    Err(last)
}

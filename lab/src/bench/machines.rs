//! Machines of more or fewer axes, made of one by copying axes.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use machine::machine_file;
use toml_edit::{ArrayOfTables, DocumentMut, value};

/// Letters in the order in which axes get them.
const LETTERS: &str = "XYZUVWABC";
/// The program that those run that have two axes or more.
const CIRCLES: &str = "programs/circle-r25-f3000.ngc";
/// The same time of machine with one axis.
const STROKES: &str = "programs/strokes.ngc";

/// A machine of a bench.
#[derive(Debug, Clone)]
pub(crate) struct BenchMachine {
    /// Its folder.
    pub folder: PathBuf,
    /// What it is to run.
    pub program: PathBuf,
}

impl BenchMachine {
    /// One that comes with the program.
    pub fn own(folder: &Path) -> BenchMachine {
        BenchMachine {
            folder: folder.to_path_buf(),
            program: machine_file(folder).with_file_name(CIRCLES),
        }
    }
}

/// Makes a machine of so many axes in a folder: its axes are those of `source`, from the first on, again and again, each copy with a
/// letter of its own.
///
/// # Errors
/// A file that cannot be read or written, or more axes than there are letters for.
pub(crate) fn of_axes(source: &Path, axes: usize, folder: &Path) -> anyhow::Result<BenchMachine> {
    if axes > LETTERS.len() {
        bail!(
            "{axes} axes: a machine file has letters for {} slides",
            LETTERS.len()
        );
    }
    let source = machine_file(source);
    let to = folder.join(format!("axes-{axes}"));
    fs::create_dir_all(to.join("programs"))?;
    for name in ["machine.toml", "plant.toml"] {
        let from = source.with_file_name(name);
        let text = fs::read_to_string(&from).with_context(|| from.display().to_string())?;
        fs::write(to.join(name), with_axes(&text, axes)?)?;
    }
    let program = to.join(if axes == 1 { STROKES } else { CIRCLES });
    if axes == 1 {
        fs::write(&program, strokes())?;
    } else {
        let own = source.with_file_name(CIRCLES);
        fs::copy(&own, &program).with_context(|| own.display().to_string())?;
    }
    Ok(BenchMachine {
        folder: to,
        program,
    })
}

/// To and fro, 14 s at 3 m/min.
fn strokes() -> String {
    let to_and_fro = "G1 X-25\nG1 X25\n".repeat(7);
    format!("G21 G90 G94\nF3000\nG0 X25\n{to_and_fro}M2\n")
}

/// A settings file with so many axes.
fn with_axes(text: &str, axes: usize) -> anyhow::Result<String> {
    let mut file: DocumentMut = text.parse()?;
    let own = file.get("axis").and_then(|item| item.as_array_of_tables());
    let own: Vec<_> = own.context("no [[axis]]")?.iter().cloned().collect();
    let mut all = ArrayOfTables::new();
    for (letter, axis) in LETTERS.chars().zip(own.iter().cycle()).take(axes) {
        let mut axis = axis.clone();
        axis.insert("name", value(letter.to_string()));
        // Tables keep their places in the file they come from: copies go behind.
        axis.set_position(None);
        let tables = axis.iter_mut().filter_map(|(_, item)| item.as_table_mut());
        tables.for_each(forget_place);
        all.push(axis);
    }
    file.insert("axis", toml_edit::Item::ArrayOfTables(all));
    Ok(file.to_string())
}

fn forget_place(table: &mut toml_edit::Table) {
    table.set_position(None);
    let below = table.iter_mut().filter_map(|(_, item)| item.as_table_mut());
    below.for_each(forget_place);
}

#[cfg(test)]
mod tests {
    use super::*;
    use machine::Machine;
    use plant_sim::plant_file::PlantFile;

    #[test]
    fn copies_of_axes_make_a_machine_with_letters_of_their_own() {
        let folder = tempfile::tempdir().expect("a folder");
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        for axes in [1, 2, 3, 8] {
            let made = of_axes(&source, axes, folder.path()).expect("a machine");
            let made = Machine::load(&made.folder).expect("a machine file");
            let letters: String = made.axes.iter().map(|axis| axis.name.as_str()).collect();
            assert_eq!(letters, LETTERS[..axes]);
            let plant = folder.path().join(format!("axes-{axes}/plant.toml"));
            let plant = PlantFile::load(&plant).expect("a plant file");
            assert!(plant.drives(&made).is_ok());
        }
        let own = Machine::load(&source).expect("xy");
        let copied = Machine::load(&folder.path().join("axes-8")).expect("of eight axes");
        assert_eq!(
            own.axes[1].position_loop.gain_per_s,
            copied.axes[3].position_loop.gain_per_s
        );
        assert!(of_axes(&source, 10, folder.path()).is_err());
    }
}

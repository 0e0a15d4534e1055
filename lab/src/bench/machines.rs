//! Machines of more or fewer axes, made of one by copying axes.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use bus::sample::PATH_AXES;
use machine::machine_file;
use toml_edit::{ArrayOfTables, DocumentMut, value};

/// Letters in the order in which axes get them; those behind are moved by hand alone.
const LETTERS: [&str; PATH_AXES] = ["X", "Y", "Z", "U", "V", "W", "A", "B", "C"];
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

/// Names of so many axes.
fn names(axes: usize) -> impl Iterator<Item = String> {
    let others = (1..).map(|number| format!("P{number}"));
    let letters = LETTERS.map(String::from);
    letters.into_iter().chain(others).take(axes)
}

/// Makes a machine of so many axes in a folder: its axes are those of `source`, from the first on, again and again, each copy with a
/// name of its own.
///
/// # Errors
/// A file that cannot be read or written.
pub(crate) fn of_axes(source: &Path, axes: usize, folder: &Path) -> anyhow::Result<BenchMachine> {
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
    for (name, axis) in names(axes).zip(own.iter().cycle()) {
        let mut axis = axis.clone();
        axis.insert("name", value(name));
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
    use bus::signal_page::MACHINE_STATE_BYTES;
    use machine::Machine;
    use master::saved::SavedState;
    use plant_sim::plant_file::PlantFile;

    #[test]
    fn copies_of_axes_make_a_machine_with_names_of_their_own() {
        let folder = tempfile::tempdir().expect("a folder");
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        for axes in [1, 2, 3, 8, 9, 10, 32] {
            let made = of_axes(&source, axes, folder.path()).expect("a machine");
            let made = Machine::load(&made.folder).expect("a machine file");
            let named: Vec<&str> = made.axes.iter().map(|axis| axis.name.as_str()).collect();
            assert!(names(axes).eq(named.iter().copied()), "{named:?}");
            assert_eq!(made.program_axes().len(), axes.min(PATH_AXES));
            let plant = folder.path().join(format!("axes-{axes}/plant.toml"));
            let plant = PlantFile::load(&plant).expect("a plant file");
            let drives = plant.drives(&made).expect("drives");
            // A master that dies leaves all of its state.
            let state = SavedState::of(&drives).bytes.len();
            assert!(state <= MACHINE_STATE_BYTES, "{axes} axes: {state} bytes");
        }
        let own = Machine::load(&source).expect("xy");
        let copied = Machine::load(&folder.path().join("axes-9")).expect("of nine axes");
        assert_eq!(
            own.axes[1].position_loop.gain_per_s,
            copied.axes[3].position_loop.gain_per_s
        );
        let made = of_axes(&source, 33, folder.path()).expect("files");
        assert!(Machine::load(&made.folder).is_err());
    }
}

//! `quadrant-lab linuxcnc`: our interpreter beside LinuxCNC's (Debian's linuxcnc-uspace).

#![expect(
    missing_docs,
    reason = "fields named after what they hold, seen by the tests of the comparison alone"
)]

pub mod fuzz;
pub mod generate;
pub mod known;
pub mod ours;
mod speed;
pub mod theirs;
pub mod trace;
pub mod verdict;

use std::path::{Path, PathBuf};

use clap::Subcommand;
use console::exit::{Failure, Outcome};
use verdict::{Tally, Verdict};

/// What can be asked of the comparison.
#[derive(Debug, Clone, Subcommand)]
pub enum LinuxcncCommand {
    /// Judge programs: the same, the same within rounding, or where they differ
    Compare {
        /// Programs, or folders of them
        #[arg(required = true, value_name = "FILE_OR_FOLDER")]
        files: Vec<PathBuf>,
        /// Leave out those that are the same
        #[arg(long)]
        quiet: bool,
    },
    /// Judge random programs
    Fuzz {
        /// The first seed
        #[arg(long, value_name = "SEED", default_value_t = 0)]
        from: u64,
        /// How many
        #[arg(long, value_name = "N", default_value_t = 10_000)]
        programs: u64,
        /// With errors put in
        #[arg(long)]
        mutations: bool,
    },
    /// Print the random programs of seeds
    Program {
        /// Seeds
        #[arg(required = true, value_name = "SEED")]
        seeds: Vec<u64>,
    },
    /// Blocks a second of both
    Speed,
    /// Print what both make of programs
    Trace {
        /// Programs
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
    },
}

/// Carries it out.
///
/// # Errors
/// LinuxCNC's interpreter is not installed.
pub fn linuxcnc(command: &LinuxcncCommand) -> Outcome {
    let needs = !matches!(command, LinuxcncCommand::Program { .. });
    if let Some(missing) = theirs::missing().filter(|_| needs) {
        return Err(Failure::Environment(anyhow::anyhow!(missing)));
    }
    match command {
        LinuxcncCommand::Compare { files, quiet } => compare(files, *quiet),
        LinuxcncCommand::Fuzz {
            from,
            programs,
            mutations,
        } => fuzz(*from, *programs, *mutations),
        LinuxcncCommand::Program { seeds } => {
            for seed in seeds {
                print!("{}", generate::program(*seed, KINDS));
            }
        }
        LinuxcncCommand::Speed => speed::run(),
        LinuxcncCommand::Trace { files } => files.iter().for_each(|file| show(file)),
    }
    Ok(())
}

/// What is drawn.
const KINDS: generate::Kinds = generate::Kinds {
    splines: true,
    spindle_motion: true,
    polar: true,
    mutations: false,
};

fn fuzz(from: u64, programs: u64, mutations: bool) {
    let begun = std::time::Instant::now();
    let kinds = generate::Kinds { mutations, ..KINDS };
    let round = fuzz::round(from..from + programs, kinds, true);
    println!(
        "{round}\n{programs} programs from {from} in {:.0} s",
        begun.elapsed().as_secs_f64()
    );
}

fn compare(arguments: &[PathBuf], quiet: bool) {
    let mut files = vec![];
    for argument in arguments {
        collect(argument, &mut files);
    }
    files.sort();
    files.dedup();
    // The same text is compared once.
    let mut seen = std::collections::HashSet::new();
    files.retain(|file| std::fs::read(file).is_ok_and(|text| seen.insert(text)));
    let mut theirs = theirs::Theirs::start();
    let mut tally = Tally::default();
    for file in files {
        let judged = verdict::judge(&mut theirs, &file);
        if !(quiet && judged.verdict == Verdict::Same) {
            println!(
                "{}: {}{}",
                file.display(),
                judged.verdict,
                if judged.moving { "" } else { " (no motion)" }
            );
        }
        tally.count(&judged);
    }
    print!("{tally}");
}

fn collect(from: &Path, files: &mut Vec<PathBuf>) {
    if !from.is_dir() {
        files.extend(from.canonicalize());
        return;
    }
    for entry in std::fs::read_dir(from).into_iter().flatten().flatten() {
        let path = entry.path();
        let named = path
            .extension()
            .and_then(|ending| ending.to_str())
            .unwrap_or_default();
        let program = ["ngc", "nc", "gcode", "tap", "NGC", "cnc"].contains(&named);
        if path.is_dir() || program {
            collect(&path, files);
        }
    }
}

fn show(file: &Path) {
    let print = |whose: &str, trace: trace::Trace| match trace {
        Ok(steps) => trace::simplified(steps)
            .iter()
            .for_each(|step| println!("{whose} {step}")),
        Err(why) => println!("{whose} refused: {why}"),
    };
    print("theirs", theirs::Theirs::start().run(file));
    print("ours  ", ours::run(file));
}

//! Compares our interpreter with LinuxCNC's (Debian's linuxcnc-uspace).
//!
//! ```text
//! cargo run --release -p program --example linuxcnc -- compare FILE_OR_FOLDER...
//! FROM=0 PROGRAMS=10000 cargo run --release -p program --example linuxcnc -- fuzz
//! ```

mod fuzz;
mod generate;
mod known;
mod ours;
mod speed;
mod theirs;
mod trace;
mod verdict;

use std::path::{Path, PathBuf};

use verdict::{Tally, Verdict};

fn main() {
    let mut arguments = std::env::args().skip(1);
    match arguments.next().as_deref() {
        Some("compare") => compare(arguments.collect()),
        Some("fuzz") => fuzz(),
        Some("program") => arguments.for_each(|seed| {
            print!("{}", generate::program(seed.parse().unwrap_or(0), KINDS));
        }),
        Some("speed") => speed::run(),
        Some("trace") => arguments.for_each(|file| show(Path::new(&file))),
        _ => {
            eprintln!(
                "usage: linuxcnc compare [--quiet] FILE_OR_FOLDER... | linuxcnc trace FILE... | linuxcnc fuzz | linuxcnc speed | linuxcnc program SEED..."
            );
            std::process::exit(2);
        }
    }
}

/// What is drawn.
const KINDS: generate::Kinds = generate::Kinds {
    splines: true,
    spindle_motion: true,
    polar: true,
    mutations: false,
};

fn fuzz() {
    let number = |name: &str, otherwise: u64| {
        let said = std::env::var(name).ok();
        said.map_or(otherwise, |text| text.parse().expect("a whole number"))
    };
    let from = number("FROM", 0);
    let begun = std::time::Instant::now();
    let programs = number("PROGRAMS", 10_000);
    let kinds = generate::Kinds {
        mutations: number("MUTATIONS", 0) > 0,
        ..KINDS
    };
    let round = fuzz::round(from..from + programs, kinds, true);
    println!(
        "{round}\n{programs} programs from {from} in {:.0} s",
        begun.elapsed().as_secs_f64()
    );
}

fn compare(mut arguments: Vec<String>) {
    if let Some(missing) = theirs::missing() {
        eprintln!("{missing}");
        std::process::exit(3);
    }
    let quiet = arguments.iter().any(|argument| argument == "--quiet");
    arguments.retain(|argument| argument != "--quiet");
    let mut files = vec![];
    for argument in &arguments {
        collect(Path::new(argument), &mut files);
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
    let text = std::fs::read(file).unwrap_or_default();
    print("ours  ", ours::run(file, &String::from_utf8_lossy(&text)));
}

//! `quadrant-lab bench all`: every bench, short, and all figures together as one table and one file for programs.

use std::fs;
use std::time::Instant;

use anyhow::Context;
use clap::Parser;
use serde_json::{Value, json};

use super::figures::Figures;
use crate::options::{AllOptions, BenchCommand};
use console::exit::{Failure, Kind, Outcome};
use console::output::say;
use console::signals::Signals;

/// A bench as it is run here: its words for a run of minutes, and for one that only shows that it works.
struct Short {
    name: &'static str,
    words: &'static [&'static str],
    shortest: &'static [&'static str],
}

/// In the order in which they are run: first those that time hand-overs and wake-ups.
const BENCHES: [Short; 12] = [
    Short {
        name: "ipc",
        words: &["--scans", "5000", "--rounds", "2"],
        shortest: &["--scans", "200", "--rounds", "1", "--axes", "1,2"],
    },
    Short {
        name: "wakeup",
        words: &["--seconds", "8"],
        shortest: &["--seconds", "1"],
    },
    Short {
        name: "lockstep",
        words: &["--rounds", "2", "--axes", "1,2,4,8"],
        shortest: &["--rounds", "1"],
    },
    Short {
        name: "simulation",
        words: &[],
        shortest: &["--scans", "500", "--rounds", "1"],
    },
    Short {
        name: "scan",
        words: &[],
        // All parts take 20 s under callgrind; `.ci/run` counts them all.
        shortest: &["--part", "planning"],
    },
    Short {
        name: "planning",
        words: &[],
        shortest: &["machines/xy", "machines/xy/programs/circle-r25-f3000.ngc"],
    },
    Short {
        name: "report",
        words: &["--minutes", "2"],
        shortest: &["--minutes", "1"],
    },
    Short {
        name: "faults",
        words: &["--seeds", "500"],
        shortest: &["--seeds", "2"],
    },
    Short {
        name: "procedures",
        words: &["--seeds", "500"],
        shortest: &["--seeds", "2"],
    },
    Short {
        name: "circles",
        words: &[
            "--radii",
            "25",
            "--feeds",
            "3000",
            "--methods",
            "none,backlash,contact-force",
        ],
        shortest: &["--radii", "12", "--feeds", "4000", "--methods", "backlash"],
    },
    Short {
        name: "plants",
        words: &["--plants", "as-modelled", "--ways", "shipped,pulse"],
        shortest: &["--random", "1"],
    },
    // Needs drives on a bus.
    Short {
        name: "fieldbus",
        words: &["--seconds", "8"],
        shortest: &["--seconds", "1"],
    },
];

/// Names of those that can be named.
pub fn names() -> Vec<&'static str> {
    BENCHES.iter().map(|bench| bench.name).collect()
}

/// A bench on a command line of its own.
#[derive(Debug, Parser)]
struct One {
    #[command(subcommand)]
    command: BenchCommand,
}

/// Runs them one after the other.
///
/// # Errors
/// One fails, or what was measured cannot be written.
pub fn all(options: &AllOptions) -> Outcome {
    let signals = Signals::catch().environment()?;
    fs::create_dir_all(&options.out)
        .with_context(|| format!("{}: cannot be made", options.out.display()))
        .environment()?;
    let mut figures = Figures::default();
    let mut took = Vec::new();
    let asked = |bench: &&Short| {
        let only = &options.only;
        only.is_empty() || only.iter().any(|name| name == bench.name)
    };
    for bench in BENCHES.iter().filter(asked) {
        if signals.count() > 0 {
            return Err(Failure::Interrupted);
        }
        let started = Instant::now();
        let words = match options.shortest {
            true => bench.shortest,
            false => bench.words,
        };
        if bench.name == "fieldbus" {
            figures.leave_out(
                bench.name,
                "it needs drives on a bus: `quadrant-lab bench fieldbus MACHINE`",
            );
            continue;
        }
        let line = [&["bench", bench.name], words].concat();
        say(&format!("== {}", line.join(" ")));
        let One { command } = One::try_parse_from(&line).environment()?;
        super::one(command, &mut figures)?;
        took.push((line.join(" "), started.elapsed().as_secs_f64()));
    }
    let place = Place::of_here();
    let table = place.markdown(&took) + "\n" + &figures.markdown();
    write(options, "bench.md", &table)?;
    let mut json = figures.json();
    if let Some(all) = json.as_object_mut() {
        all.insert("place".into(), place.json());
        let commands = took
            .iter()
            .map(|(command, took_s)| json!({ "command": command, "took_s": took_s }));
        all.insert("commands".into(), commands.collect());
    }
    let text = serde_json::to_string_pretty(&json).environment()? + "\n";
    write(options, "bench.json", &text)?;
    say(&table);
    Ok(())
}

fn write(options: &AllOptions, name: &str, text: &str) -> Outcome {
    let file = options.out.join(name);
    fs::write(&file, text)
        .with_context(|| format!("{}: cannot be written", file.display()))
        .environment()?;
    say(&format!("{}", file.display()));
    Ok(())
}

/// Where it was measured.
struct Place {
    processor: String,
    kernel: String,
    cores: usize,
    /// What else the PC did when it began: runnable threads over a minute.
    load: String,
}

impl Place {
    fn of_here() -> Place {
        let read = |path: &str| fs::read_to_string(path).unwrap_or_default();
        let processors = read("/proc/cpuinfo");
        let model = processors
            .lines()
            .find(|line| line.starts_with("model name"));
        let model = model.and_then(|line| line.split_once(':'));
        let load = read("/proc/loadavg");
        Place {
            processor: model.map_or("not known", |(_, model)| model.trim()).into(),
            kernel: read("/proc/sys/kernel/osrelease").trim().into(),
            cores: bus::realtime::processors().len(),
            load: load.split_whitespace().next().unwrap_or("").into(),
        }
    }

    fn markdown(&self, took: &[(String, f64)]) -> String {
        let lines: String = took
            .iter()
            .map(|(command, took_s)| format!("- `quadrant-lab {command}` in {took_s:.0} s\n"))
            .collect();
        format!(
            "Measured on {}, {} cores, Linux {}; load {} at the end.\n\n{lines}",
            self.processor, self.cores, self.kernel, self.load
        )
    }

    fn json(&self) -> Value {
        json!({
            "processor": self.processor,
            "kernel": self.kernel,
            "cores": self.cores,
            "load_at_end": self.load,
            "version": env!("CARGO_PKG_VERSION"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bench_can_be_run_with_its_words() {
        for bench in &BENCHES {
            for words in [bench.words, bench.shortest] {
                let line = [&["bench", bench.name], words].concat();
                assert!(One::try_parse_from(&line).is_ok(), "{line:?}");
            }
        }
    }
}

//! What the shipped programs do on the shipped machines stays what it was, to the bit (`tests/digests.txt`).

use std::path::PathBuf;

use lab::cell::InProcessCell;
use machine::Machine;
use plant_sim::plant_file::PlantFile;

use crate::size;
use crate::support::{number, root, run_with, text};

/// By default a program that takes more scans is run on the machine that is through with it soonest.
const SCANS: u64 = 50_000;

/// One line of the table.
#[derive(Debug, Clone)]
struct Row {
    machine: String,
    program: String,
    /// Name of a fault script of the machine.
    faults: Option<String>,
    scans: f64,
    digest: String,
    motion_digest: String,
}

impl Row {
    fn machine_folder(&self) -> PathBuf {
        root().join("machines").join(&self.machine)
    }

    /// Whether a row of the same program shows the same motion.
    fn moves_as(&self, other: &Row) -> bool {
        self.scans == other.scans && self.motion_digest == other.motion_digest
    }

    /// What a killed recorder has missed depends on the PC, and with it the digest over the log.
    fn is_reproducible(&self) -> bool {
        self.faults.as_deref() != Some("kill-everybody.toml")
    }

    /// The machines with two slides share the programs of one.
    fn program_file(&self) -> PathBuf {
        let own = self.machine_folder().join("programs");
        let programs = if own.exists() {
            own
        } else {
            root().join("machines/xy/programs")
        };
        programs.join(&self.program)
    }
}

fn table() -> Vec<Row> {
    let lines = include_str!("digests.txt").lines();
    let rows = lines.filter(|line| !line.starts_with('#')).map(|line| {
        let [machine, program, scans, digest, motion_digest] =
            line.split(' ').collect::<Vec<_>>().try_into().expect(line);
        let (program, faults) = match program.split_once('+') {
            Some((program, faults)) => (program, Some(faults.to_string())),
            None => (program, None),
        };
        Row {
            machine: machine.into(),
            program: program.into(),
            faults,
            scans: scans.parse().expect(line),
            digest: digest.into(),
            motion_digest: motion_digest.into(),
        }
    });
    rows.collect()
}

/// Runs it by the real processes: what the row is now.
fn by_processes(row: &Row) -> Row {
    let faults = row.faults.as_ref().map(|name| {
        let path = row.machine_folder().join("faults").join(name);
        path.display().to_string()
    });
    let mut more = vec!["--no-learned"];
    if let Some(faults) = &faults {
        more.extend(["--faults", faults]);
    }
    let report = run_with(row.machine_folder(), row.program_file(), &more).good_report();
    Row {
        scans: number(&report, "/scans"),
        // A recorder that was killed has noted none.
        digest: report["digest"].as_str().unwrap_or_default().into(),
        motion_digest: text(&report, "/motion_digest"),
        ..row.clone()
    }
}

/// Runs it by the real processes and compares both digests.
fn check_by_processes(row: &Row) {
    let now = by_processes(row);
    assert!(row.moves_as(&now), "{row:?}, now {now:?}");
    if row.is_reproducible() {
        assert_eq!(now.digest, row.digest, "{row:?}");
    }
}

#[test]
fn a_program_of_every_machine_has_the_digests_it_had() {
    let rows = table();
    let is_shortest = |row: &Row| {
        let mut others = rows.iter().filter(|other| other.machine == row.machine);
        others.all(|other| other.scans >= row.scans)
    };
    let mut seen = Vec::new();
    for row in &rows {
        if row.faults.is_some() || is_shortest(row) && !seen.contains(&row.machine) {
            seen.push(row.machine.clone());
            check_by_processes(row);
        }
    }
    assert!(seen.len() >= 7, "machines and fault scripts: {seen:?}");
}

#[test]
fn every_shipped_program_has_the_motion_digest_it_had() {
    let scans_max = size::number("SCANS", SCANS, u64::MAX) as f64;
    let rows = table();
    let is_soonest = |row: &Row| {
        let mut same = rows.iter().filter(|other| other.program == row.program);
        same.all(|other| other.scans >= row.scans)
    };
    let is_run = |row: &&Row| row.faults.is_none() && (row.scans <= scans_max || is_soonest(row));
    std::thread::scope(|scope| {
        for half in 0..2 {
            let mine = rows.iter().filter(is_run).skip(half).step_by(2);
            let mine: Vec<&Row> = mine.collect();
            scope.spawn(move || mine.into_iter().for_each(check_in_one_process));
        }
    });
}

fn check_in_one_process(row: &Row) {
    let machine = Machine::load(&row.machine_folder()).expect("a machine");
    let plant = PlantFile::load(&row.machine_folder()).expect("a plant");
    let program = std::fs::read_to_string(row.program_file()).expect("a program");
    let mut cell = InProcessCell::new(&machine, &plant, &row.program, &program).expect("a cell");
    let mut digest = String::new();
    while let Some(published) = cell.scan() {
        digest = format!("{:032x}", published.instruments.motion_digest());
    }
    assert_eq!(digest, row.motion_digest, "{row:?}");
}

/// Takes some minutes. With `RENEW=samples` the digests over all samples are written again, after a change of their layout or of what
/// they carry; the motion must be what it was all the same. With `RENEW=motion` whole rows are, after a change of how the machine moves.
#[test]
#[ignore = "every program by the real processes: after a change that should change no bit"]
fn every_digest_of_every_shipped_program_is_what_it_was() {
    let rows = table();
    let Ok(renewed) = std::env::var("RENEW") else {
        rows.iter().for_each(check_by_processes);
        return;
    };
    let mut all = include_str!("digests.txt").to_string();
    for row in &rows {
        let now = by_processes(row);
        assert!(
            renewed == "motion" || row.moves_as(&now),
            "{row:?}, now {now:?}"
        );
        let of = |row: &Row| format!("{} {} {}", row.scans, row.digest, row.motion_digest);
        if row.is_reproducible() || !row.moves_as(&now) {
            all = all.replace(&of(row), &of(&now));
        }
    }
    std::fs::write(root().join("tests/digests.txt"), all).expect("the table can be written");
}

/// A program that comes with the product without its digests would be changed unseen.
#[test]
fn every_shipped_program_is_in_the_table() {
    let table = table();
    for machine in std::fs::read_dir(root().join("machines"))
        .expect("machines")
        .flatten()
    {
        let name = machine.file_name().to_string_lossy().into_owned();
        // A cell in one process has no logic of its own: `whole_machine::` runs such a machine.
        if Machine::load(&machine.path()).is_ok_and(|machine| machine.logic.is_some()) {
            continue;
        }
        let programs = std::fs::read_dir(machine.path().join("programs"));
        for program in programs.into_iter().flatten().flatten() {
            let program = program.file_name().to_string_lossy().into_owned();
            let known = table
                .iter()
                .any(|r| r.machine == name && r.program == program);
            assert!(known || !program.ends_with(".ngc"), "{name} {program}");
        }
    }
}

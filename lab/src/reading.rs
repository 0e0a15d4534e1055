//! `quadrant-lab reading`: files of any length, how fast they are read and in how much memory.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use clap::Subcommand;
use console::exit::{Kind, Outcome};
use path::geometry::AxisVector;
use program::{AxisSetup, Piece, Progress, Reading, Setup, check_file};

/// So many lines are read at a time.
const LINES: usize = 1_000;

/// What can be asked for.
#[derive(Debug, Clone, Subcommand)]
pub enum ReadingCommand {
    /// Write a program of so many megabytes
    Make {
        /// Its size
        #[arg(value_name = "MEGABYTES")]
        megabytes: u64,
        /// Where to
        file: PathBuf,
    },
    /// Read a program piece by piece, as the planner does
    Read {
        /// The program
        file: PathBuf,
    },
    /// Check a program, as `quadrant check` does
    Check {
        /// The program
        file: PathBuf,
    },
}

/// Carries it out.
///
/// # Errors
/// The file cannot be read or written.
pub fn reading(command: &ReadingCommand) -> Outcome {
    match command {
        ReadingCommand::Make { megabytes, file } => make(megabytes * 1_000_000, file).environment(),
        ReadingCommand::Read { file } => read(file).input(),
        ReadingCommand::Check { file } => {
            check(file);
            Ok(())
        }
    }
}

fn setup() -> Arc<Setup> {
    let axes = ['X', 'Y', 'Z'].map(|letter| AxisSetup {
        letter,
        travel_min: -1000.0,
        travel_max: 1000.0,
        rotary: false,
        modulo: false,
    });
    Arc::new(Setup {
        axes: axes.into(),
        ..Setup::default()
    })
}

/// Writes a program of so many bytes: lines and arcs as CAM systems write them, and now and then a subroutine.
fn make(bytes: u64, file: &Path) -> std::io::Result<()> {
    let mut to = BufWriter::new(File::create(file)?);
    writeln!(
        to,
        "G21 G90 F3000\no<lift> sub\nG0 Z5\nG1 Z0\no<lift> endsub"
    )?;
    let (mut written, mut index) = (0, 0u64);
    while written < bytes {
        let x = (index % 10_007) as f64 * 0.0123;
        let line = match index % 1000 {
            999 => "o<lift> call\n".to_owned(),
            998 => "G2 I2.5\nG1\n".to_owned(),
            _ => format!("X{x:.4} Y{:.4} Z{:.4}\n", x * 0.5, -x * 0.25),
        };
        if index == 0 {
            to.write_all(b"G1\n")?;
        }
        to.write_all(line.as_bytes())?;
        written += line.len() as u64;
        index += 1;
    }
    writeln!(to, "M2")?;
    to.flush()
}

fn read(file: &Path) -> Result<(), program::ProgramError> {
    let begun = Instant::now();
    let mut reading = Reading::open(file, &setup(), AxisVector::zeros())?;
    let opened = begun.elapsed().as_secs_f64();
    println!("opened in {opened:.3} s");
    let mut piece = Piece::default();
    let (mut reads, mut longest_s) = (0u64, 0.0_f64);
    let end = loop {
        let at = Instant::now();
        match reading.read(LINES, &mut piece) {
            Ok(Progress::More) => {}
            other => break other,
        }
        longest_s = longest_s.max(at.elapsed().as_secs_f64());
        piece.elements.clear();
        piece.events.clear();
        piece.messages.clear();
        reads += 1;
    };
    let seconds = begun.elapsed().as_secs_f64() - opened;
    let lines = reads as f64 * LINES as f64;
    println!("{end:?}, {} elements", reading.elements_made());
    println!(
        "{lines:.0} lines in {seconds:.1} s: {:.2} M lines/s",
        lines / seconds / 1e6
    );
    println!("{LINES} lines took at most {:.1} ms", longest_s * 1e3);
    println!("a snapshot has {} bytes", reading.snapshot().len());
    memory();
    Ok(())
}

fn check(file: &Path) {
    let begun = Instant::now();
    let summary = check_file(file, &setup(), AxisVector::zeros(), &mut |_| {});
    println!("{summary:?}");
    println!("{:.1} s", begun.elapsed().as_secs_f64());
    memory();
}

/// The most memory that the process had so far.
fn memory() {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM"));
    println!("{}", line.unwrap_or("memory unknown"));
}

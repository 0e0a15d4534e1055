//! Reads files of any length, and says how fast and in how much memory.
//!
//! ```text
//! cargo run --release -p program --example reading -- make 1000 /tmp/part.ngc
//! cargo run --release -p program --example reading -- read /tmp/part.ngc
//! cargo run --release -p program --example reading -- check /tmp/part.ngc
//! ```

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use control::path::AxisVector;
use program::{AxisSetup, Piece, Progress, Reading, Setup, check_file};

/// So many lines are read at a time.
const LINES: usize = 1_000;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments.as_slice() {
        ["make", megabytes, file] => {
            let megabytes: u64 = megabytes.parse().expect("a number of megabytes");
            make(megabytes * 1_000_000, Path::new(file)).expect("the file");
        }
        ["read", file] => read(Path::new(file)),
        ["check", file] => check(Path::new(file)),
        _ => {
            eprintln!(
                "usage: reading make MEGABYTES FILE | reading read FILE | reading check FILE"
            );
            std::process::exit(2);
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

fn read(file: &Path) {
    let begun = Instant::now();
    let mut reading = Reading::open(file, &setup(), AxisVector::zeros()).expect("the file");
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

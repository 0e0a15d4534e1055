//! How many blocks a second each interpreter does, of the same programs, one behind the other.

use std::fmt::Write;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use path::geometry::AxisVector;

use crate::linuxcnc::ours;

const ROUNDS: usize = 5;

/// Measures plain blocks and blocks with expressions.
pub fn run() {
    let folder = std::env::temp_dir().join(format!("quadrant-speed-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for the programs");
    for (name, blocks, text) in [
        ("plain lines", 500_000, plain(500_000)),
        ("expressions", 250_000, expressions(250_000)),
        ("a loop", 400_000, looped(100_000)),
    ] {
        let file = folder.join("speed.ngc");
        std::fs::write(&file, &text).expect("the program");
        let setup = ours::setup();
        let (mut best_ours, mut best_theirs) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..ROUNDS {
            let begun = Instant::now();
            let program = program::interpret("speed", &text, &setup, AxisVector::zeros());
            best_ours = best_ours.min(begun.elapsed().as_secs_f64());
            assert!(program.is_ok(), "{:?}", program.err());
            let begun = Instant::now();
            if theirs(&file) {
                best_theirs = best_theirs.min(begun.elapsed().as_secs_f64());
            }
        }
        let per_s = |seconds: f64| f64::from(blocks) / seconds / 1e6;
        println!(
            "{name}: ours {:.2} M blocks/s, rs274 {:.2} M blocks/s, ratio {:.1}",
            per_s(best_ours),
            per_s(best_theirs),
            best_theirs / best_ours
        );
    }
    let _ = std::fs::remove_dir_all(folder);
}

/// Runs `rs274` over a file, its output thrown away; false where it is missing. It keeps its tool table in the home folder.
fn theirs(file: &Path) -> bool {
    Command::new("rs274")
        .arg("-g")
        .arg(file)
        .env("HOME", file.parent().unwrap_or(Path::new("/")))
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

fn plain(blocks: u32) -> String {
    let mut text = String::from("G21 G90 F1000\n");
    for index in 0..blocks - 2 {
        let x = f64::from(index % 1000) * 0.123;
        let _ = writeln!(text, "G1 X{x:.4} Y{:.4} Z{:.4}", x * 0.5, -x * 0.25);
    }
    text + "M2\n"
}

fn expressions(blocks: u32) -> String {
    let mut text = String::from("G21 G90 F1000\n#1=5 #2=2.5\n");
    for index in 0..blocks - 3 {
        let _ = writeln!(
            text,
            "G1 X[#1+{}*SIN[#2]] Y[#2-#1/{}]",
            index % 100,
            index % 7 + 1
        );
    }
    text + "M2\n"
}

fn looped(passes: u32) -> String {
    format!(
        "G21 G90 F1000\n#1=0\nO1 while [#1 LT {passes}]\n#1=[#1+1]\nG1 X[#1 MOD 100] Y[#1/1000]\nO1 endwhile\nM2\n"
    )
}

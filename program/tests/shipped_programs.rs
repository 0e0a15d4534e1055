//! The part programs that come with the product fit their machines and are what their names say.

use std::path::{Path, PathBuf};

use crate::common::{at, slide};
use path::geometry::{AxisVector, Feed, Shape};
use program::{Program, ProgramEnd, Setup, load};

fn programs_of(machine: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../machines")
        .join(machine)
        .join("programs");
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    files
}

fn xy() -> Setup {
    Setup {
        axes: vec![slide('X', -220.0, 220.0), slide('Y', -150.0, 150.0)],
        ..Setup::default()
    }
}

fn xyz_mill() -> Setup {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xyz-mill");
    let machine = machine::Machine::load(&folder).unwrap();
    let axes = vec![
        slide('X', 0.0, 500.0),
        slide('Y', 0.0, 400.0),
        slide('Z', -300.0, 0.0),
    ];
    Setup {
        axes,
        work_offset: at(&[250.0, 200.0, -100.0]),
        tools: machine.tools,
        ..Setup::default()
    }
}

/// The reach of an arm of 150 mm to 60° is Y here, and X goes as far beyond its slide as the arm draws back.
fn xzb_pivot() -> Setup {
    let axes = vec![
        slide('X', -295.0, 295.0),
        slide('Y', -129.9, 129.9),
        slide('Z', -300.0, 0.0),
    ];
    Setup {
        axes,
        work_offset: at(&[0.0, 0.0, -100.0]),
        ..Setup::default()
    }
}

fn loaded(file: &Path, setup: &Setup) -> Program {
    load(file, setup, AxisVector::zeros()).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn every_shipped_program_runs_to_its_m2_without_a_remark() {
    let mut files = 0;
    for (machine, setup) in [
        ("xy", xy()),
        ("xyz-mill", xyz_mill()),
        ("xzb-pivot", xzb_pivot()),
    ] {
        for file in programs_of(machine) {
            let program = loaded(&file, &setup);
            assert_eq!(program.path.first_break(), None, "{}", file.display());
            files += 1;
            if is_by_cam(&file) {
                let changes = |event: &program::Event| {
                    matches!(event.kind, program::EventKind::ToolChange(_))
                };
                assert!(program.events.iter().any(changes), "{}", file.display());
                continue;
            }
            assert!(
                matches!(program.end, ProgramEnd::M2(_)),
                "{}",
                file.display()
            );
            assert_eq!(program.notes, [], "{}", file.display());
            assert!(
                program
                    .blocks
                    .first()
                    .unwrap()
                    .text
                    .starts_with("G21 G17 G90 G94"),
                "{}",
                file.display()
            );
        }
    }
    assert_eq!(files, 27 + 7 + 4);
}

/// Programs in the style of a CAM post-processor: they begin and end as that does.
fn is_by_cam(file: &Path) -> bool {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    name.starts_with("plate-")
}

#[test]
fn the_circles_have_the_radius_feed_and_direction_of_their_names() {
    let mut circles = 0;
    for file in programs_of("xy") {
        let name = file.file_stem().unwrap().to_str().unwrap().to_owned();
        let parts: Vec<&str> = name.split('-').collect();
        let ["circle", radius, feed, direction @ ..] = parts.as_slice() else {
            continue;
        };
        circles += 1;
        let radius: f64 = radius.trim_start_matches('r').parse().unwrap();
        let feed: f64 = feed.trim_start_matches('f').parse().unwrap();
        let expected = match direction {
            [] => vec![false, false, true, true],
            ["ccw"] => vec![false, false],
            _ => vec![true, true],
        };
        let mut directions = Vec::new();
        for element in loaded(&file, &xy()).path.elements {
            if let Shape::Arc {
                centre,
                radius_mm,
                sweep_rad,
                ..
            } = element.shape
            {
                assert_eq!((centre, radius_mm), (at(&[]), radius), "{name}");
                assert_eq!(element.feed, Feed::PathMmS(feed / 60.0), "{name}");
                assert_eq!(sweep_rad.abs(), std::f64::consts::TAU, "{name}");
                directions.push(sweep_rad < 0.0);
            }
        }
        assert_eq!(directions, expected, "{name}");
    }
    assert_eq!(circles, 25);
}

#[test]
fn the_rounded_square_has_no_corner() {
    let files = programs_of("xy");
    let file = files
        .iter()
        .find(|file| file.ends_with("rounded-square.ngc"))
        .unwrap();
    let path = loaded(file, &xy()).path;
    // The first element leads there in rapid; the last is a dwell.
    let square = &path.elements[1..path.elements.len() - 1];
    assert_eq!(square.len(), 9);
    for (before, after) in square.iter().zip(&square[1..]) {
        let kink = (before.tangent(before.length_mm) - after.tangent(0.0)).norm();
        assert!(kink < 1e-9, "line {}: {kink}", after.line);
    }
}

//! Our interpreter against LinuxCNC's, where that is installed (Debian's linuxcnc-uspace).

#[path = "../../program/tests/common/diameters.rs"]
mod diameters;

use std::path::Path;

use lab::linuxcnc::verdict::{self, Verdict};
use lab::linuxcnc::{fuzz, generate, known, theirs, trace};
use machine::Machine;
use path::geometry::AxisVector;
use program::Setup;

use crate::size;

/// Programs of ours in the style of three CAM posts.
const POSTS: [&str; 3] = ["plate-fusion.ngc", "plate-freecad.ngc", "plate-fanuc.nc"];

fn mill() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xyz-mill")
}

fn skipped() -> bool {
    let missing = theirs::missing();
    if let Some(missing) = &missing {
        eprintln!("skipped: {missing}");
    }
    missing.is_some()
}

#[test]
fn programs_in_the_style_of_cam_posts_run_on_the_mill() {
    let machine = Machine::load(&mill().join("machine.toml")).expect("the mill");
    let setup = Setup::of(&machine);
    // At its place of reference: the middle of X and Y, Z up.
    let start = setup.work_offset;
    for name in POSTS {
        let program = program::load(&mill().join("programs").join(name), &setup, start);
        let program = program.unwrap_or_else(|error| panic!("{error}"));
        assert!(program.straight_feeds + program.arc_feeds > 8, "{name}");
    }
}

#[test]
fn the_mills_programs_make_the_same_motions_as_linuxcnc() {
    if skipped() {
        return;
    }
    let mut theirs = theirs::Theirs::start();
    for name in POSTS
        .iter()
        .chain(&["drilling-pattern.ngc", "helix.ngc", "pocket-3d.ngc"])
    {
        let judged = verdict::judge(&mut theirs, &mill().join("programs").join(name));
        assert_eq!(judged.verdict, Verdict::Same, "{name}");
        assert!(judged.moving, "{name}");
    }
}

#[test]
fn programs_of_the_grammar_make_the_same_motions_as_linuxcnc() {
    if skipped() {
        return;
    }
    let programs = size::number("PROGRAMS", 400, 400);
    let from = size::number("FROM", 0, 0);
    let kinds = generate::Kinds {
        splines: true,
        spindle_motion: true,
        polar: true,
        mutations: false,
    };
    let round = fuzz::round(from..from + programs, kinds, false);
    assert!(round.found.is_empty(), "{round}");
    // Programs that neither takes show little.
    assert!(round.tally.moving[0] as u64 > programs / 3, "{round}");
}

#[test]
fn every_motion_in_every_plane_is_made_as_by_linuxcnc_with_x_as_radius_and_as_diameter() {
    if skipped() {
        return;
    }
    let pairs = diameters::pairs();
    let texts: Vec<&String> = pairs
        .iter()
        .flat_map(|pair| [&pair.radii, &pair.diameters])
        .collect();
    let (mut different, mut same) = (Vec::new(), 0);
    let folder = fuzz::Folder::make();
    let mut theirs = theirs::Theirs::start();
    for text in &texts {
        let judged = verdict::judge(&mut theirs, &folder.write(0, text));
        match judged.verdict {
            Verdict::Same => same += 1,
            Verdict::RefusedByBoth(..) => {}
            verdict if known::reason(text, &verdict).is_some() => {}
            verdict => different.push(format!("{verdict}\n{text}")),
        }
    }
    assert!(different.is_empty(), "{}", different.join("\n"));
    assert!(
        same > texts.len() / 2,
        "{same} of {} are the same",
        texts.len()
    );
}

#[test]
fn a_difference_is_seen() {
    let of = |x: f64| {
        let mut to = [0.0; 9];
        to[0] = x;
        let way = trace::Way::Feed;
        vec![trace::Step::Move {
            way,
            line: 1,
            from: [0.0; 9],
            to,
            feed: 100.0,
            circle: None,
        }]
    };
    assert_eq!(
        verdict::compared(Ok(of(1.0)), Ok(of(1.0))).verdict,
        Verdict::Same
    );
    let judged = verdict::compared(Ok(of(1.0)), Ok(of(1.000_01))).verdict;
    assert!(matches!(judged, Verdict::Differs(_)), "{judged}");
    assert_eq!(AxisVector::zeros().len(), path::geometry::PATH_AXES);
}

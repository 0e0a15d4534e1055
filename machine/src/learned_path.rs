//! What a program that runs again and again has taught: `learned-path/PROGRAM.csv` beside `machine.toml`.
//! Written by `quadrant run --learn-path` alone.
//!
//! A CSV file whose head is TOML in comment lines: machine, program, settings, passes, and a checksum over all that follows it.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use crate::learned::Learned;
use crate::load::machine_file;
use crate::machine::Machine;
use crate::settings_file::{self, SettingsFileError, read_text_within};

/// Folder of these files, beside the machine file.
pub const LEARNED_PATH_FOLDER: &str = "learned-path";
/// The copy in a run directory.
pub const LEARNED_PATH_FILE: &str = "learned-path.csv";
/// Version of the layout.
pub const LEARNED_PATH_VERSION: u32 = 1;
/// Most knots, and most elements, of a file.
pub const LEARNED_PATH_ROWS_MAX: usize = 1_000_000;
/// Longest file, in bytes.
const FILE_BYTES_MAX: u64 = 256 << 20;
/// Largest correction that is believed, in µm.
const CORRECTION_UM_MAX: f64 = 50.0;
/// Passes that the file remembers.
const PASSES_MAX: usize = 100;

/// What a pass left of error by the scale, in µm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearnedPathPass {
    /// Its number, from 1.
    pub pass: u32,
    /// Mean of the largest errors at reversals.
    pub mean_um: f64,
    /// The largest of them.
    pub worst_um: f64,
    /// Root mean square of the distance from the path.
    pub rms_um: f64,
}

/// What is known of the correction beside its values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearnedPathHead {
    /// [`LEARNED_PATH_VERSION`].
    pub version: u32,
    /// Name of the machine.
    pub machine: String,
    /// Name of the program's file.
    pub program: String,
    /// Hash of program, machine and start, as the path tags have it.
    pub program_hash: String,
    /// [`path_settings_hash`] of the settings that it was learned with.
    pub settings: String,
    /// Part of the error that the next pass takes over.
    pub gain: f64,
    /// Passes since the last one that was better.
    pub passes_no_better: u32,
    /// There is nothing more to learn from this program, until it gets worse.
    pub settled: bool,
    /// What the pass with this correction left; none where it has not run yet.
    pub measured: Option<LearnedPathPass>,
    /// All passes of the program, the last ones.
    #[serde(default)]
    pub passes: Vec<LearnedPathPass>,
}

/// The whole file.
#[derive(Debug, Clone, PartialEq)]
pub struct LearnedPath {
    /// What is known of it.
    pub head: LearnedPathHead,
    /// Letters of the axes.
    pub axes: Vec<String>,
    /// Elements of the path and its length before each, in mm; by elements.
    pub elements: Vec<(u32, f64)>,
    /// The correction, by places.
    pub knots: Vec<LearnedKnot>,
}

/// One place of the path.
#[derive(Debug, Clone, PartialEq)]
pub struct LearnedKnot {
    /// Length of the path up to here, in mm.
    pub place_mm: f64,
    /// Speed along the path, in mm/s.
    pub speed_mm_s: f64,
    /// What is added to the position command of each axis, in mm.
    pub correction_mm: Vec<f64>,
}

/// Names the settings that a learned path depends on: how setpoints are made, and of each axis what is in the machine file and what
/// its runs have learned at reversals.
pub fn path_settings_hash(machine: &Machine, learned: Option<&Learned>) -> String {
    let mut hash = Xxh3::new();
    let (scan, interpolation) = (&machine.scan, &machine.interpolation);
    let made = (
        scan,
        interpolation,
        &machine.path,
        &machine.positioning,
        &machine.kinematics,
    );
    hash.update(format!("{made:?}").as_bytes());
    for axis in &machine.axes {
        hash.update(format!("{axis:?}").as_bytes());
        let table = learned.and_then(|learned| learned.of(machine, axis));
        let table = table.map(|known| serde_json::to_string(&known.table).unwrap_or_default());
        hash.update(table.unwrap_or_default().as_bytes());
        hash.update(&[0]);
    }
    format!("{:016x}", hash.digest())
}

/// The file of a program beside a machine file.
pub fn learned_path_file(machine: &Path, program: &str) -> PathBuf {
    let folder = machine_file(machine).with_file_name(LEARNED_PATH_FOLDER);
    folder.join(format!("{program}.csv"))
}

/// The file of the correction that the next pass tries.
pub fn trial_path_file(machine: &Path, program: &str) -> PathBuf {
    let folder = machine_file(machine).with_file_name(LEARNED_PATH_FOLDER);
    folder.join(format!("{program}.trial.csv"))
}

impl LearnedPath {
    /// Reads such a file; none if there is nothing.
    ///
    /// # Errors
    /// It cannot be read, is damaged, of another version or machine, or holds what nothing can have taught.
    pub fn load(path: &Path, machine: &Machine) -> Result<Option<LearnedPath>, SettingsFileError> {
        if !path.exists() {
            return Ok(None);
        }
        let text = read_text_within(path, FILE_BYTES_MAX)?;
        LearnedPath::parse(&path.display().to_string(), &text, machine).map(Some)
    }

    /// Checks the text of such a file; `name` is in the messages.
    ///
    /// # Errors
    /// As [`LearnedPath::load`].
    pub fn parse(
        name: &str,
        text: &str,
        machine: &Machine,
    ) -> Result<LearnedPath, SettingsFileError> {
        let refused = |what: &str| {
            SettingsFileError::Broken(vec![format!(
                "{name}: {what}; remove the file, or run with --no-learned"
            )])
        };
        let (first, rest) = text.split_once('\n').unwrap_or((text, ""));
        let named = first.strip_prefix("# checksum = ").map(str::trim);
        let is = format!("{:016x}", xxh3_64(rest.as_bytes()));
        if named != Some(is.as_str()) {
            return Err(refused(
                "is damaged: its checksum is not that of what it holds",
            ));
        }
        let head: String = rest
            .lines()
            .map_while(|line| line.strip_prefix('#'))
            .flat_map(|line| [line, "\n"])
            .collect();
        let head: LearnedPathHead = settings_file::parse(name, &head)?;
        if head.version != LEARNED_PATH_VERSION {
            let what = format!("version = {}: must be {LEARNED_PATH_VERSION}", head.version);
            return Err(refused(&what));
        }
        if head.machine != machine.name {
            let (of, is) = (&head.machine, &machine.name);
            return Err(refused(&format!(
                "belongs to another machine ({of:?}) than {is:?}"
            )));
        }
        let (axes, elements, knots) = body(rest).map_err(|what| refused(&what))?;
        let letters = machine.axes.iter().map(|axis| &axis.name);
        if !axes.iter().eq(letters) {
            return Err(refused(&format!("is of other axes: {}", axes.join(" "))));
        }
        Ok(LearnedPath {
            head,
            axes,
            elements,
            knots,
        })
    }

    /// Why it is not used for this program with these settings; none if it is.
    pub fn unfit(&self, program_hash: u64, settings: &str) -> Option<&'static str> {
        if self.head.program_hash != format!("{program_hash:016x}") {
            return Some("the program, where it begins or the machine's axes have changed since");
        }
        let same = self.head.settings == settings;
        (!same).then_some("the settings of an axis, or what it has learned, have changed since")
    }

    /// Notes a pass; the oldest ones are forgotten.
    pub fn note(&mut self, pass: LearnedPathPass) {
        self.head.passes.push(pass);
        let more = self.head.passes.len().saturating_sub(PASSES_MAX);
        self.head.passes.drain(..more);
    }

    /// The text of the file.
    pub fn text(&self) -> String {
        let mut rest = format!(
            "# # What `quadrant run --learn-path` found on the path of {}. Used while program and settings stay as they were;\n\
             # # remove the file, or run with --no-learned, to go without it (docs/methods/path-learning.md).\n",
            self.head.program
        );
        for line in toml::to_string(&self.head).unwrap_or_default().lines() {
            let _ = writeln!(rest, "# {line}");
        }
        let _ = writeln!(rest, "element,start_mm");
        for (element, start_mm) in &self.elements {
            let _ = writeln!(rest, "{element},{start_mm:?}");
        }
        let _ = write!(rest, "place_mm,speed_mm_s");
        for axis in &self.axes {
            let _ = write!(rest, ",{axis}_um");
        }
        rest.push('\n');
        for knot in &self.knots {
            let _ = write!(rest, "{:?},{:.3}", knot.place_mm, knot.speed_mm_s);
            for correction_mm in &knot.correction_mm {
                let _ = write!(rest, ",{:.5}", correction_mm * 1e3);
            }
            rest.push('\n');
        }
        format!("# checksum = {:016x}\n{rest}", xxh3_64(rest.as_bytes()))
    }
}

type Body = (Vec<String>, Vec<(u32, f64)>, Vec<LearnedKnot>);

/// What stands below the head.
fn body(rest: &str) -> Result<Body, String> {
    let mut lines = rest.lines().skip_while(|line| line.starts_with('#'));
    if lines.next() != Some("element,start_mm") {
        return Err("has no list of elements".into());
    }
    let (mut axes, mut elements, mut knots) = (None, Vec::new(), Vec::new());
    for line in lines {
        if let Some(columns) = line.strip_prefix("place_mm,speed_mm_s,") {
            let letters = columns.split(',').map(|column| column.strip_suffix("_um"));
            let letters: Option<Vec<&str>> = letters.collect();
            let letters = letters.ok_or("has a column without a unit")?;
            axes = Some(letters.into_iter().map(str::to_string).collect::<Vec<_>>());
            continue;
        }
        let wrong = || format!("has a row that cannot be: {line:?}");
        match &axes {
            None => elements.push(element(line).ok_or_else(wrong)?),
            Some(axes) => knots.push(knot(line, axes.len()).ok_or_else(wrong)?),
        }
        if elements.len() > LEARNED_PATH_ROWS_MAX || knots.len() > LEARNED_PATH_ROWS_MAX {
            return Err(format!("has more than {LEARNED_PATH_ROWS_MAX} rows"));
        }
    }
    if !elements.is_sorted_by(|a, b| a.0 < b.0 && a.1 <= b.1)
        || !knots.is_sorted_by(|a, b| a.place_mm < b.place_mm)
    {
        return Err("has rows that are not in order".into());
    }
    Ok((axes.ok_or("has no knots")?, elements, knots))
}

fn element(line: &str) -> Option<(u32, f64)> {
    let (element, start_mm) = line.split_once(',')?;
    let start_mm: f64 = start_mm.parse().ok()?;
    Some((element.parse().ok()?, start_mm)).filter(|_| start_mm.is_finite() && start_mm >= 0.0)
}

fn knot(line: &str, axes: usize) -> Option<LearnedKnot> {
    let numbers: Result<Vec<f64>, _> = line.split(',').map(str::parse).collect();
    let numbers = numbers.ok()?;
    let [place_mm, speed_mm_s, corrections @ ..] = numbers.as_slice() else {
        return None;
    };
    let can_be = corrections.len() == axes
        && place_mm.is_finite()
        && speed_mm_s.is_finite()
        && corrections.iter().all(|um| um.abs() <= CORRECTION_UM_MAX);
    can_be.then(|| LearnedKnot {
        place_mm: *place_mm,
        speed_mm_s: *speed_mm_s,
        correction_mm: corrections.iter().map(|um| um * 1e-3).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn shipped() -> Machine {
        Machine::parse(
            "machine.toml",
            include_str!("../../machines/xy/machine.toml"),
        )
        .unwrap()
    }

    fn learned(places_mm: &[f64]) -> LearnedPath {
        let pass = LearnedPathPass {
            pass: 1,
            mean_um: 1.25,
            worst_um: 3.5,
            rms_um: 0.4,
        };
        LearnedPath {
            head: LearnedPathHead {
                version: LEARNED_PATH_VERSION,
                machine: "xy".into(),
                program: "five.ngc".into(),
                program_hash: "00000000000000ff".into(),
                settings: "s".into(),
                gain: 0.6,
                passes_no_better: 0,
                settled: false,
                measured: Some(pass),
                passes: vec![pass, pass],
            },
            axes: vec!["X".into(), "Y".into()],
            elements: vec![(1, 0.1), (2, 30.0)],
            knots: places_mm
                .iter()
                .map(|place_mm| LearnedKnot {
                    place_mm: *place_mm,
                    speed_mm_s: 50.0,
                    correction_mm: vec![0.001, -0.002],
                })
                .collect(),
        }
    }

    #[test]
    fn a_file_is_read_as_it_was_written() {
        let machine = shipped();
        let path = learned(&[0.1, 0.7, 31.25]);
        assert_eq!(
            LearnedPath::parse("f", &path.text(), &machine).unwrap(),
            path
        );
        let none = learned(&[]);
        assert_eq!(
            LearnedPath::parse("f", &none.text(), &machine).unwrap(),
            none
        );
        assert_eq!(path.unfit(0xff, "s"), None);
        assert!(path.unfit(0xfe, "s").is_some() && path.unfit(0xff, "t").is_some());
    }

    #[test]
    fn what_cannot_have_been_learned_is_refused_though_its_checksum_is_right() {
        let machine = shipped();
        let refused = |edit: fn(&mut LearnedPath), says: &str| {
            let mut path = learned(&[0.1, 0.7]);
            edit(&mut path);
            let error = LearnedPath::parse("f", &path.text(), &machine).unwrap_err();
            assert!(error.to_string().contains(says), "{error}");
        };
        refused(|path| path.head.version = 9, "version");
        refused(|path| path.head.machine = "lathe".into(), "another machine");
        refused(
            |path| path.axes = vec!["X".into(), "Z".into()],
            "other axes",
        );
        refused(|path| path.knots[0].correction_mm[0] = 0.06, "a row");
        refused(|path| path.knots[0].correction_mm[0] = f64::NAN, "a row");
        refused(|path| path.knots[0].place_mm = 0.7, "in order");
        refused(|path| path.elements[0].0 = 2, "in order");
    }

    #[test]
    fn the_settings_of_a_path_change_with_an_axis_and_with_what_it_has_learned() {
        let machine = shipped();
        let hash = path_settings_hash(&machine, None);
        let none = Learned::none(&machine);
        assert_eq!(path_settings_hash(&machine, Some(&none)), hash);
        let mut other = machine.clone();
        other.axes[1].position_loop.gain_per_s += 1.0;
        assert_ne!(path_settings_hash(&other, None), hash);
    }

    proptest! {
        #[test]
        fn any_damaged_byte_is_noticed(at in any::<proptest::sample::Index>(), by in 1u8..127) {
            let text = learned(&[0.1, 0.7, 31.25]).text();
            let mut bytes = text.into_bytes();
            let at = at.index(bytes.len());
            bytes[at] = (bytes[at] & 0x7f) ^ by;
            if let Ok(damaged) = String::from_utf8(bytes) {
                let read = LearnedPath::parse("f", &damaged, &shipped());
                // A blank at the end of the first line changes nothing.
                let same = read.as_ref().is_ok_and(|read| *read == learned(&[0.1, 0.7, 31.25]));
                prop_assert!(read.is_err() || same);
            }
        }
    }
}

//! What `quadrant tune` takes.

use std::ops::RangeInclusive;
use std::path::PathBuf;

use anyhow::anyhow;
use clap::Args;
use machine::Machine;

/// What `quadrant tune` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "The axes move by themselves, one after the other, up to 20 mm (100 mm/s) to either side of the\nmiddle of their travel; then a few circles, those of --circles.\n--travel-mm, --speed-mm-s and --acceleration-mm-s2 allow them less: a number for all axes, or\nAXIS=number. Shorter and slower motions tell less.\n\nWhat the model does not explain is printed, with what it may cost. Settings with which the machine\nstops are undone. Exit status 1: nothing can be identified, or the machine stops; nothing is written."
)]
pub struct TuneOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml
    pub machine: PathBuf,
    /// Show what would be written; write nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Write to this file, and leave the machine file as it is
    #[arg(long, value_name = "FILE", conflicts_with = "dry_run")]
    pub out: Option<PathBuf>,
    /// Lost motion of axes that have no scale, as AXIS=µm,…: X=8.3,Y=12.3
    #[arg(long, value_name = "AXIS=UM", value_delimiter = ',')]
    pub lost_motion_um: Vec<String>,
    /// Most travel of the test motions to either side of the middle, in mm: 10 or X=10,Y=5
    #[arg(long, value_name = "MM", value_delimiter = ',')]
    pub travel_mm: Vec<String>,
    /// Highest speed of the test motions, in mm/s: 50 or X=50
    #[arg(long, value_name = "MM_S", value_delimiter = ',')]
    pub speed_mm_s: Vec<String>,
    /// Highest acceleration of the test motions, in mm/s²: it limits the force, mass times acceleration
    #[arg(
        long = "acceleration-mm-s2",
        value_name = "MM_S2",
        value_delimiter = ','
    )]
    pub acceleration_mm_s2: Vec<String>,
    /// Circles on which before and after are compared, as RADIUS:FEED in mm and mm/min; one for which there is no room is refused [default: those of 25:3000, 10:10000 and 100:1000 for which there is room]
    #[arg(long, value_name = "MM:MM_MIN", value_delimiter = ',', value_parser = circle)]
    pub circles: Vec<(f64, f64)>,
    /// Folder for what the axes did in the test motions, as text that `quadrant identify` reads
    #[arg(long, value_name = "DIR")]
    pub recordings: Option<PathBuf>,
}

/// What `quadrant new machine` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "An axis is its letter and what is known of it: X:travel=-200..200,lead=10. X Y Z U V W are slides, in mm,\nkg and N; A B C turn, in degrees, kg·m² and N·m about the axis.\n\n  travel=LOW..HIGH    the only thing that must be given; of a table that turns without end travel=endless\n  lead=MM             screw: travel in one turn [default: 10]\n  rack=MODULExTEETH   rack, with the teeth of its pinion: rack=2x20\n  belt=PITCHxTEETH    toothed belt, with the teeth of its pulley: belt=5x24\n  ratio=TURNS         turns of the motor for one of screw, pinion or pulley [default: 1]\n  gear=TURNS          rotary: turns of the motor for one of the axis [default: 90]\n  speed=, acceleration=    highest, per second and per second²\n  mass= or inertia=   what moves, without the motor [default: 100 kg, 0.5 kg·m²]\n  torque=, rotor=     motor: continuous torque in N·m, inertia in kg·m² [default: what the acceleration needs]\n  friction=, gap=     in N and µm; rotary in N·m and thousandths of a degree\n  motors=2            a gantry: two motors, each with half of mass and friction; skew is watched\n  encoder=incremental    with a home switch: the axis must be homed first\n  lifts=yes or no     higher positions take the tool off the work: homed that way, and first\n                      [default: yes of Z and W, and of X and U where there is a Z and no Y]\n  start=              where it stands at first [default: 0, or the end of the travel next to it]\n\nWhat is not given is chosen to fit what is: an acceleration that the motor can do,\nanother lead or gear for a high speed. Numbers that contradict each other are refused, with what\nwould be right.\n\nWithout --axis on a terminal the numbers are asked for. The files say which values are estimated; they are\nplain text, to be changed.\n\nA gantry mill with a rotary axis:\n  quadrant new machine my-gantry --axis X:travel=0..1200,rack=2x20,ratio=10,mass=150 \\\n      --axis Y:travel=0..800,lead=20,mass=60 --axis Z:travel=-200..0,lead=10,mass=25 --axis A:travel=-3600..3600,gear=60"
)]
pub struct NewMachineOptions {
    /// The new folder
    pub folder: PathBuf,
    /// An axis: LETTER:KEY=VALUE,… (see below); once for each
    #[arg(long, value_name = "AXIS")]
    pub axis: Vec<String>,
    /// Name of the machine and of its cell [default: that of the folder]
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Scan period in µs: 250, or a multiple of it up to 2000
    #[arg(long, value_name = "US", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(250..=2000))]
    pub scan_us: u32,
}

/// Values of an option, axis by axis: `AXIS=number`, or a number for all.
///
/// # Errors
/// No such axis, or no number in this range.
pub fn of_axes(
    machine: &Machine,
    option: &str,
    given: &[String],
    range: RangeInclusive<f64>,
) -> anyhow::Result<Vec<Option<f64>>> {
    let mut all = vec![None; machine.axes.len()];
    for pair in given {
        let (name, number) = match pair.split_once('=') {
            Some((name, number)) => (Some(name), number),
            None => (None, pair.as_str()),
        };
        let number = number.parse().ok().filter(|number| range.contains(number));
        let number: f64 = number.ok_or_else(|| {
            anyhow!(
                "{option} {pair}: must be AXIS=number, {} to {}, like X=8.3",
                range.start(),
                range.end()
            )
        })?;
        if let Some(name) = name
            && !machine.axes.iter().any(|axis| axis.name == name)
        {
            return Err(anyhow!(
                "{option} {pair}: {} has no axis {name}",
                machine.name
            ));
        }
        for (axis, place) in machine.axes.iter().zip(&mut all) {
            if name.is_none_or(|name| name == axis.name) {
                *place = Some(number);
            }
        }
    }
    Ok(all)
}

/// Radius in mm and feed in mm/min of a circle.
fn circle(text: &str) -> Result<(f64, f64), String> {
    let wrong = || "must be RADIUS:FEED, in mm and mm/min, like 25:3000".to_string();
    let (radius, feed) = text.split_once(':').ok_or_else(wrong)?;
    let number = |text| positive(text).map_err(|_| wrong());
    Ok((number(radius)?, number(feed)?))
}

/// What `quadrant identify` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "The file is text: a line of column names, then a line for each instant, evenly spaced; commas,\nsemicolons or tabs between them; lines that begin with # are comments. Names tell the units:\n\n  time_s time_ms time_us                   or give --scan-us\n  position_mm position_m position_um       the motor's encoder, as travel\n  force_n force_kn, torque_nm torque_mnm   what drives the axis; a torque needs --lead-mm\n  scale_mm scale_m scale_um                the table's own scale, if there is one\n  velocity_command_mm_s                    with --velocity-gain-n-s-per-m\n\nOther columns are left alone. Strokes there and back, slow and fast, with hard and soft reversals,\ntell most. With --validate the model is held against other recordings of the same axis: the force\nthat it leaves unexplained, and the motion that it simulates from the force alone.\n\n  quadrant identify strokes.csv --validate other.csv\n\nExit status 1: nothing can be identified; what to look at is printed."
)]
pub struct IdentifyOptions {
    /// Recording of an axis, as text
    #[arg(value_name = "FILE")]
    pub recording: PathBuf,
    /// Other recordings of the same axis, to hold the model against
    #[arg(long, value_name = "FILE", value_delimiter = ',')]
    pub validate: Vec<PathBuf>,
    /// Travel in a turn of the motor, in mm: for a torque, and for what repeats with each turn
    #[arg(long, value_name = "MM", value_parser = positive)]
    pub lead_mm: Option<f64>,
    /// Length of the two running means that force and motion go through, in ms
    #[arg(long, value_name = "MS", default_value_t = 10.0, value_parser = positive)]
    pub smoothing_ms: f64,
    /// Period of the recording, in µs, where it has no times
    #[arg(long, value_name = "US", value_parser = positive)]
    pub scan_us: Option<f64>,
    /// Kv of the drive while it was recorded, in N·s/m at the table
    #[arg(long, value_name = "KV", default_value_t = 0.0)]
    pub velocity_gain_n_s_per_m: f64,
}

/// A number above 0.
fn positive(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "must be a number".to_string())?;
    if number > 0.0 && number.is_finite() {
        Ok(number)
    } else {
        Err("must be above 0".into())
    }
}

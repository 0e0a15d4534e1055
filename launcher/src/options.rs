//! What the launcher's and the operator's commands take.

use std::net::SocketAddr;
use std::path::PathBuf;

use bus::member::Pace;
use clap::{Args, Subcommand};

use crate::metrics_socket as metrics;
use crate::web;

/// What `quadrant run` takes.
#[derive(Debug, Clone, Args)]
pub struct RunOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml
    pub machine: PathBuf,
    /// Part program (RS274/NGC, "G-code")
    pub program: PathBuf,
    /// realtime: scans at absolute times; lockstep: as fast as the machine goes, the same result to the bit every time
    #[arg(long, default_value = "lockstep", value_parser = ["realtime", "lockstep"])]
    pub pace: String,
    /// Run directory to write; made new [default: runs/MACHINE-PROGRAM-TIME]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Name of the cell, when several share a PC [default: the machine's own name]
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
    /// What is recorded: full, every sample and a report; events, what happened to the processes alone; off, neither (a report needs full)
    #[arg(long, value_name = "WHAT", default_value = "full", value_parser = ["off", "events", "full"])]
    pub log: String,
    /// If the run goes well: learn from it what the model lacks at reversals, into learned.toml beside the machine file
    #[arg(long, conflicts_with_all = ["no_learned", "log"], group = "learns")]
    pub learn: bool,
    /// If the run goes well: learn from it what this program leaves of error along its path by the table's scales, into
    /// learned-path/PROGRAM.csv beside the machine file; the best pass is kept
    #[arg(long, conflicts_with_all = ["no_learned", "learn", "log"], group = "learns")]
    pub learn_path: bool,
    /// With --learn or --learn-path: run so often, each pass with a run directory of its own
    #[arg(long, value_name = "N", default_value_t = 1, requires = "learns", value_parser = clap::value_parser!(u32).range(1..=100))]
    pub passes: u32,
    /// Block by block: the machine rests at the end of every block, and `quadrant resume` from another terminal runs the next
    #[arg(long, conflicts_with = "learns")]
    pub single_block: bool,
    /// Begin at this line of the program: modes, tool, spindle, coolant and outputs are as the blocks before it leave them, and the
    /// tool goes there with Z last (or first, if it is below)
    #[arg(long, value_name = "LINE", conflicts_with = "learns", value_parser = clap::value_parser!(u32).range(1..))]
    pub from_line: Option<u32>,
    /// Show `quadrant monitor` in this terminal meanwhile; closing it (q) ends nothing
    #[arg(long)]
    pub view: bool,
    /// Go without what earlier runs have learned (learned.toml and learned-path/ beside the machine file)
    #[arg(long)]
    pub no_learned: bool,
    /// Serve metrics for Prometheus (OpenMetrics, docs/howto/metrics.md) at this address or port [without one: 127.0.0.1:7823]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true, default_missing_value = metrics::DEFAULT_ADDRESS, value_parser = metrics::parse_address)]
    pub metrics: Option<SocketAddr>,
    /// Show the cell as a page in the browser (docs/howto/web.md) at this address or port [without one: 127.0.0.1:8640]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true, default_missing_value = web::DEFAULT_ADDRESS, value_parser = web::parse_address)]
    pub web: Option<SocketAddr>,
    /// With --web: file with the token that orders from the page need; made if it is not there [default: a new token, printed]
    #[arg(long, value_name = "FILE", requires = "web")]
    pub token: Option<PathBuf>,
    /// In lockstep: seconds a living process may take for one answer before the run is given up
    #[arg(long, value_name = "SECONDS", default_value_t = 30, value_parser = clap::value_parser!(u64).range(1..=3600), hide_short_help = true)]
    pub answer_limit: u64,
    /// Orders that the master obeys, each at its scan (TOML: `[[order]]` scan, order, axis, value)
    #[arg(long, value_name = "FILE", hide = true)]
    pub orders: Option<PathBuf>,
    /// Faults to inject: kills, stops, lost or corrupted samples, each at its scan, block or reversal (TOML; see docs/reference/fault-scripts.md)
    #[arg(long, value_name = "FILE")]
    pub faults: Option<PathBuf>,
}

impl RunOptions {
    /// The pace it names.
    pub fn pace(&self) -> Pace {
        self.pace.parse().unwrap_or(Pace::Lockstep)
    }

    /// The same for one of its passes, from 1: each has a run directory of its own.
    pub fn of_pass(&self, pass: u32) -> RunOptions {
        let out = self.out.clone();
        RunOptions {
            out: out.map(|out| match self.passes {
                0 | 1 => out,
                _ => out.join(format!("pass-{pass}")),
            }),
            ..self.clone()
        }
    }
}

/// What `quadrant up` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "The drives are off at first. From any other terminal:\n  quadrant enable\n  quadrant load machines/xy/programs/circle-r25-f3000.ngc\n  quadrant start --wait\n  quadrant down\n\nEvery program that is started leaves a run directory with log and report in DIR: DIR/001-circle-r25-f3000 …\nCtrl-C, SIGTERM and `quadrant down` bring the tool to rest on the path before the processes leave."
)]
pub struct UpOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml
    pub machine: PathBuf,
    /// realtime: scans at absolute times; lockstep: as fast as the machine goes, also while nothing moves
    #[arg(long, default_value = "realtime", value_parser = ["realtime", "lockstep"])]
    pub pace: String,
    /// Folder for the run directories; made new [default: runs/CELL-up-TIME]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Name of the cell, when several share a PC [default: the machine's own name]
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
    /// What is recorded: full, every sample and a report; events, what happened to the processes alone; off, neither (a report needs full)
    #[arg(long, value_name = "WHAT", default_value = "full", value_parser = ["off", "events", "full"])]
    pub log: String,
    /// Show `quadrant monitor` in this terminal meanwhile; closing it (q) ends nothing
    #[arg(long)]
    pub view: bool,
    /// Go without what earlier runs have learned (learned.toml beside the machine file)
    #[arg(long)]
    pub no_learned: bool,
    /// Serve metrics for Prometheus (OpenMetrics, docs/howto/metrics.md) at this address or port [without one: 127.0.0.1:7823]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true, default_missing_value = metrics::DEFAULT_ADDRESS, value_parser = metrics::parse_address)]
    pub metrics: Option<SocketAddr>,
    /// Show the cell as a page in the browser (docs/howto/web.md) at this address or port [without one: 127.0.0.1:8640]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true, default_missing_value = web::DEFAULT_ADDRESS, value_parser = web::parse_address)]
    pub web: Option<SocketAddr>,
    /// With --web: file with the token that orders from the page need; made if it is not there [default: a new token, printed]
    #[arg(long, value_name = "FILE", requires = "web")]
    pub token: Option<PathBuf>,
    /// In lockstep: seconds a living process may take for one answer before the cell is given up
    #[arg(long, value_name = "SECONDS", default_value_t = 30, value_parser = clap::value_parser!(u64).range(1..=3600), hide_short_help = true)]
    pub answer_limit: u64,
}

impl UpOptions {
    /// The pace it names.
    pub fn pace(&self) -> Pace {
        self.pace.parse().unwrap_or(Pace::Realtime)
    }
}

/// What `quadrant load` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "The program is checked against the machine from where its axes stand, and copied: later edits do not reach the\ncell. Exit status 1: the cell cannot take it now; 2: the program is wrong."
)]
pub struct LoadOptions {
    /// Part program (RS274/NGC, \"G-code\")
    pub program: PathBuf,
    /// Which cell.
    #[command(flatten)]
    pub to: OperatorOptions,
}

/// What `quadrant start` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "With --line, nothing before that line is travelled: modes, tool, spindle, coolant and outputs are set as the blocks before\nit leave them, then the tool goes straight to above the place and down to it (or up first, if it is below), at the\nspeed of returns, and the program goes on from there. Jog to where that way is free, and `quadrant hold` before if in\ndoubt: then nothing moves before `resume`. The line has to move the tool; M0, M1 and user M-codes before it are passed\nover, and a program that probes or reads inputs before it is refused.\n\nWith --wait, exit status 0: the program is done; 1: it was stopped, tripped or given up, as is printed; 2: no program begins at that line."
)]
pub struct StartOptions {
    /// Begin at this line of the program
    #[arg(long, value_name = "LINE", value_parser = clap::value_parser!(u32).range(1..))]
    pub line: Option<u32>,
    /// Wait until the program is done
    #[arg(long)]
    pub wait: bool,
    /// Block by block: the machine rests at the end of every block, and `quadrant resume` runs the next
    #[arg(long)]
    pub single_block: bool,
    /// Which cell.
    #[command(flatten)]
    pub to: OperatorOptions,
}

/// What `quadrant mdi` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "A block, or several, each a line of a small program that runs from where the axes are:\n  quadrant mdi \"G0 X10\"\n  quadrant mdi \"G91 G1 Z-1 F100\" \"G4 P0.5\" \"G0 Z1\"\n\nModes stay for the next block or program (G91, G20, G55, F, S, G43 …), until M2, M30, `reset` or the end of the cell; the spindle and coolant stay too, until M5 and M9, M2, M30, `stop`, `reset`, a trip or drives off. The program that was loaded is loaded again afterwards, however the block ends; `start` never runs the block. Refused while a program runs, or is held or stopped.\n\nWaits until the block is done. Ctrl-C holds it. Exit status 0: done; 1: refused, stopped or tripped, as is printed; 2: the block is wrong; 130: held by Ctrl-C."
)]
pub struct MdiOptions {
    /// The blocks, each in quotes
    #[arg(required = true, value_name = "BLOCK")]
    pub blocks: Vec<String>,
    /// Do not wait until they are done; the program that was loaded is then to be loaded again by hand
    #[arg(long)]
    pub no_wait: bool,
    /// Which cell.
    #[command(flatten)]
    pub to: OperatorOptions,
}

/// What every order to a running cell takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Prints what happened, or why it was refused, and exits with 0 or 1; also with 1 if\nno cell runs or it does not answer within 5 s; with 2 on bad usage.\n\nA hold in the middle of a program, a look at the workpiece, and on:\n  quadrant hold\n  quadrant jog Z 20\n  quadrant resume"
)]
pub struct OperatorOptions {
    /// Name of the cell [default: the only one that runs, if its machine lies in this folder, below it or above it; `hold` and `stop` reach it from anywhere]
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
}

/// Which running cell to look at.
#[derive(Debug, Clone, Args)]
pub struct CellOptions {
    /// Name of the cell [default: the only one that runs]
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
    /// See a cell of another machine, on which `quadrant remote serve` runs; read only (docs/howto/remote.md)
    #[arg(long, value_name = "tcp/HOST:PORT")]
    pub remote: Option<String>,
}

/// What `quadrant override` takes.
#[derive(Debug, Clone, Args)]
pub struct OverrideOptions {
    /// Share of the programmed feeds and rapids, in percent
    #[arg(allow_negative_numbers = true, value_parser = percent)]
    pub percent: f64,
    /// Which cell.
    #[command(flatten)]
    pub to: OperatorOptions,
}

/// What `quadrant rapid-override` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Prints what happened, or why it was refused, and exits with 0 or 1; also with 1 if\nno cell runs or it does not answer within 5 s; with 2 on bad usage.\n\nRapids at a quarter, feeds as programmed:\n  quadrant rapid-override 25"
)]
pub struct RapidOverrideOptions {
    /// Share of rapids (G0) and of returns to the path, in percent; 0 stands before the next one
    #[arg(allow_negative_numbers = true, value_parser = percent)]
    pub percent: f64,
    /// Which cell.
    #[command(flatten)]
    pub to: OperatorOptions,
}

/// What `quadrant optional-stop` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Prints what happened, or why it was refused, and exits with 0 or 1; also with 1 if\nno cell runs or it does not answer within 5 s; with 2 on bad usage.\n\nStop at every M1 of the program that runs:\n  quadrant optional-stop on\n  quadrant resume"
)]
pub struct OptionalStopOptions {
    /// Whether M1 stops the program
    #[arg(value_parser = ["on", "off"])]
    pub state: String,
    /// Which cell.
    #[command(flatten)]
    pub to: OperatorOptions,
}

/// What `quadrant single-block` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Prints what happened, or why it was refused, and exits with 0 or 1; also with 1 if\nno cell runs or it does not answer within 5 s; with 2 on bad usage.\n\nBlock by block from here, then the rest at once:\n  quadrant single-block on\n  quadrant resume\n  quadrant single-block off\n  quadrant resume"
)]
pub struct SingleBlockOptions {
    /// Whether the machine rests at the end of every block and waits for `resume`
    #[arg(value_parser = ["on", "off"])]
    pub state: String,
    /// Which cell.
    #[command(flatten)]
    pub to: OperatorOptions,
}

/// What `quadrant jog` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "By a distance, along a straight line of several axes, or until Ctrl-C with a direction in place of it:\n  quadrant jog X 10\n  quadrant jog X -0.5 --speed 120 --wait\n  quadrant jog X 1 Y -2\n  quadrant jog X 100 --to-machine\n  quadrant jog Z- --speed 1500\n  quadrant jog X+ Y-\n\nA distance that is given while its axis still goes by one adds to it. A jog with a direction goes on as long as this command renews its order. When it is killed, stopped or cut off, the axis comes to rest by itself, within 200 ms of scans and its braking; it also does at the end of its travel, and at `hold` and `stop`.\n\nPrints what happened, or why it was refused, and exits with 0 or 1; with 2 on bad usage."
)]
pub struct JogOptions {
    /// Axis letter and distance from where the axis is commanded to be, in mm (degrees of a rotary axis), signed; of more axes for a
    /// straight line; or an axis letter with a sign (X+, X-), of one axis or more, to jog until Ctrl-C
    #[arg(
        value_name = "AXIS DISTANCE|AXIS+|AXIS-",
        required = true,
        allow_negative_numbers = true
    )]
    pub ways: Vec<String>,
    /// The numbers are places of the machine, not distances
    #[arg(long)]
    pub to_machine: bool,
    /// Speed in mm/min (degrees/min), at most the axis's rapid [default: `jog_mm_s` of the machine file]
    #[arg(long, value_name = "MM_MIN", allow_negative_numbers = true, value_parser = number)]
    pub speed: Option<f64>,
    /// Wait until the axis stands
    #[arg(long)]
    pub wait: bool,
    /// Which cell.
    #[command(flatten)]
    pub to: OperatorOptions,
}

/// What `quadrant offsets` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Shows the work offsets that the next program begins with, or changes them:\n  quadrant offsets\n  quadrant offsets set G55 X=12.5 Y=-3\n  quadrant offsets machines/xy clear G55\n\nThey stand in offsets.toml beside the machine file, which the first change makes; from then on programs keep there what they set (G10 L2, L20, G92). A change acts from the next start on. While a program of a cell that uses the file is started, it is refused (exit status 1). Bad values are refused with what would be right (exit status 2)."
)]
pub struct OffsetsOptions {
    /// Machine folder or file [default: the machine of the running cell]
    pub machine: Option<PathBuf>,
    /// Name of the cell [default: the only one that runs, if its machine is one of this folder]
    #[arg(long, global = true, conflicts_with = "machine")]
    pub cell: Option<String>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// What is changed.
    #[command(subcommand)]
    pub change: Option<OffsetsChange>,
}

/// A change of work offsets.
#[derive(Debug, Clone, Subcommand)]
pub enum OffsetsChange {
    /// Set axes of a work offset, in machine coordinates; the others stay as they are
    Set {
        /// G54 to G59, G59.1 to G59.3
        offset: String,
        /// Axis and value in mm (degrees of a rotary axis), such as X=12.5; R turns about Z, in degrees
        #[arg(required = true, value_name = "AXIS=VALUE")]
        values: Vec<String>,
    },
    /// Clear a work offset, or G92: 0, and for G54 what the machine file says
    Clear {
        /// G54 to G59, G59.1 to G59.3, G92
        offset: String,
    },
}

/// What `quadrant tool` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Shows the tool table that the next program begins with, or changes it:\n  quadrant tool\n  quadrant tool set T3 length_mm=40.5 diameter_mm=6 name=\"end mill\"\n  quadrant tool machines/xyz-mill remove T3\n\nIt stands in tools.toml beside the machine file. The first change makes it, with the tools that the machine file has. A change acts from the next start on. While a program of a cell that uses the file is started, it is refused (exit status 1). Bad values are refused with what would be right (exit status 2)."
)]
pub struct ToolOptions {
    /// Machine folder or file [default: the machine of the running cell]
    pub machine: Option<PathBuf>,
    /// Name of the cell [default: the only one that runs, if its machine is one of this folder]
    #[arg(long, global = true, conflicts_with = "machine")]
    pub cell: Option<String>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// What is changed.
    #[command(subcommand)]
    pub change: Option<ToolChangeOptions>,
}

/// A change of the tool table.
#[derive(Debug, Clone, Subcommand)]
pub enum ToolChangeOptions {
    /// Show the tools
    List,
    /// Set what the table says of a tool; a new one is added
    Set {
        /// Its number, such as T3
        tool: String,
        /// length_mm (along Z), diameter_mm, name, pocket, x_mm, y_mm, a_deg, b_deg, c_deg, u_mm, v_mm, w_mm, front_angle_deg,
        /// back_angle_deg, orientation
        #[arg(required = true, value_name = "KEY=VALUE")]
        values: Vec<String>,
    },
    /// Remove a tool from the table
    Remove {
        /// Its number, such as T3
        tool: String,
    },
}

/// What `quadrant zero` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Touch-off: makes the place where the axes are read VALUE in a work offset.\n  quadrant zero X Y\n  quadrant zero Z --at 20 --tool T3\n  quadrant zero X --at -3 --offset G55\n\nRefused while an axis moves, without a reference, or while a program is started (exit status 1)."
)]
pub struct ZeroOptions {
    /// Axis letters
    #[arg(required = true)]
    pub axes: Vec<String>,
    /// What the axes are to read where they are, in mm (degrees of a rotary axis)
    #[arg(long, value_name = "VALUE", default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    pub at: f64,
    /// Work offset [default: the one that programs begin with]
    #[arg(long, value_name = "G54")]
    pub offset: Option<String>,
    /// Tool that touches: its length is taken off [default: the offset that is applied (G43)]
    #[arg(long, value_name = "T3")]
    pub tool: Option<String>,
    /// Name of the cell [default: the only one that runs, if its machine is one of this folder]
    #[arg(long)]
    pub cell: Option<String>,
}

fn finite(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value: &f64| value.is_finite());
    value.ok_or_else(|| format!("{text:?} is no number such as 12.5"))
}

/// What `quadrant home` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Prints what happened, or why it was refused, and exits with 0 or 1; also with 1 if\nno cell runs or it does not answer within 5 s, with --wait if an axis is not homed then;\nwith 2 on bad usage.\n\nA machine that has just been switched on:\n  quadrant enable\n  quadrant home --wait\n  quadrant start"
)]
pub struct HomeOptions {
    /// Axis letters [default: all axes that have to be homed]
    pub axes: Vec<String>,
    /// Wait until they are homed
    #[arg(long)]
    pub wait: bool,
    /// Which cell.
    #[command(flatten)]
    pub to: OperatorOptions,
}

/// What `quadrant check` takes.
#[derive(Debug, Clone, Args)]
pub struct CheckOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml
    pub machine: PathBuf,
    /// Part program to check against the machine
    pub program: Option<PathBuf>,
}

/// What `quadrant plan` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Where the time goes, and what would help:\n  quadrant plan machines/xy part.ngc --svg part.svg --blocks part.csv\n  quadrant plan machines/xy part.ngc --what-if tolerance=0.02\n  quadrant plan machines/xy part.ngc --what-if jerk=100000,acceleration.Y=3000\n\nKeys of --what-if: velocity, acceleration and jerk of all axes, or of one (jerk.X), in mm/s, mm/s² and mm/s³\n(degrees for rotary axes; jerk=none: not limited), tolerance in mm (P of G64, wherever the program is not exact),\nvibration in Hz (or none). No file is changed."
)]
pub struct PlanOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml
    pub machine: PathBuf,
    /// Part program
    pub program: PathBuf,
    /// Write the setpoints of every scan as CSV
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Write each block's length, time and what holds the tool back on it as CSV
    #[arg(long, value_name = "FILE")]
    pub blocks: Option<PathBuf>,
    /// Draw the path, coloured by speed, as SVG
    #[arg(long, value_name = "FILE")]
    pub svg: Option<PathBuf>,
    /// Plan again with other limits, and compare
    #[arg(long, value_name = "KEY=VALUE", value_delimiter = ',')]
    pub what_if: Vec<String>,
}

/// What `quadrant report` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Writes report.txt, report.json, report.html and plots into the run directory; with --against into\nRUN_DIR/against-NAME, NAME being that of the other run's directory, in which nothing is written.\n\nBefore and after a change of the machine file:\n  quadrant report runs/after --against runs/before"
)]
pub struct ReportOptions {
    /// A run directory
    pub run_dir: PathBuf,
    /// The directory of another run of the same program on the same machine, whose settings may differ: both side by side
    #[arg(long, value_name = "RUN_DIR")]
    pub against: Option<PathBuf>,
    /// Print report.json instead of the text
    #[arg(long)]
    pub json: bool,
    /// Yield to everything else on this PC
    #[arg(long, hide = true)]
    pub background: bool,
}

/// What `quadrant doctor` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Each finding is ok, could be better, or must be changed; the last two with the reason and what to type.\nWith drives on EtherCAT, their network interface is looked at too:\n  quadrant doctor eth1\n  quadrant doctor machines/mine\n\nExit status 3: something must be changed before a cell runs in real time."
)]
pub struct DoctorOptions {
    /// Look at the network interface of a fieldbus too: its name, or a machine with [bus]
    #[arg(value_name = "INTERFACE|MACHINE")]
    pub bus: Option<String>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// What `quadrant clean` takes.
#[derive(Debug, Clone, Args)]
pub struct CleanOptions {
    /// The cell
    pub cell: String,
}

/// A finite number.
///
/// # Errors
/// It is none, in words.
pub fn number(text: &str) -> Result<f64, String> {
    let value: f64 = text
        .trim()
        .parse()
        .map_err(|_| format!("{text:?} is no number"))?;
    if value.is_finite() {
        Ok(value)
    } else {
        Err("must be finite".into())
    }
}

/// A number, with or without its sign of percent.
fn percent(text: &str) -> Result<f64, String> {
    number(text.strip_suffix('%').unwrap_or(text))
}

/// What `quadrant bus` takes.
#[derive(Debug, Clone, Args)]
pub struct BusOptions {
    /// Which.
    #[command(subcommand)]
    pub command: BusCommand,
}

/// What can be asked for of drives on a bus.
#[derive(Debug, Clone, Subcommand)]
pub enum BusCommand {
    /// Make a drive file from the ESI file of a drive's vendor
    DriveFile(DriveFileOptions),
    /// Check a drive file by itself and, if given, against the vendor's ESI file
    Check(BusCheckOptions),
    /// Who is on a segment: names, numbers, states, process data
    Scan(BusScanOptions),
    /// Read an object of a slave, or write it
    Sdo(BusSdoOptions),
}

/// What `quadrant bus drive-file` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "The ESI file (EtherCAT slave information, XML) comes from the vendor of the drive. From it to a drive file that is good:\n  quadrant bus drive-file Vendor_Drive.xml --out drives/x.toml\n  (fill in what is marked FILL IN in drives/x.toml)\n  quadrant bus check drives/x.toml --esi Vendor_Drive.xml\n\nWhere the file describes several drives they are listed, with what to write for each. Nothing that is there is overwritten. Exit status 2: no drive file can be made, as is printed."
)]
pub struct DriveFileOptions {
    /// The vendor's ESI file
    pub esi: PathBuf,
    /// Product code (0x00030924 or decimal), or a part of the name, where the file describes several
    #[arg(long, value_name = "CODE|NAME")]
    pub product: Option<String>,
    /// Revision (0x00010420 or decimal), where the file describes several
    #[arg(long, value_name = "NUMBER", value_parser = whole_32)]
    pub revision: Option<u32>,
    /// Mode of operation [default: the first of csv, cst and csp that the drive can be driven in]
    #[arg(long, value_parser = ["csv", "cst", "csp"])]
    pub mode: Option<String>,
    /// Drive file to write [default: drives/NAME.toml, by the name of the drive]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// What `quadrant bus check` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Everything that is wrong is printed, a line each, with what to do; what may not be meant so is a warning. No drive need be there:\n  quadrant bus check drives/x.toml\n  quadrant bus check drives/x.toml --esi Vendor_Drive.xml\n\nExit status 2: something is wrong."
)]
pub struct BusCheckOptions {
    /// The drive file
    pub drive: PathBuf,
    /// The vendor's ESI file
    #[arg(long, value_name = "FILE")]
    pub esi: Option<PathBuf>,
}

/// What `quadrant bus scan` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "INTERFACE is a network interface of this PC that goes to the IN port of the first drive, and to nothing else (`ip link` lists them):\n  quadrant bus scan eth1\n  quadrant bus scan eth1 --json\n\nSlaves are listed in the order of the cable: `place` is what `slave` in [axis.drive] of the machine file counts from 0. `vendor`, `product` and `revision` are what [identity] of a drive file has to say, process data what [process_data] has to say. `profile` is 402 with drives of CiA 402. `clocks` says whether sync = \"dc\" is possible.\n\nNothing is enabled. All slaves go to PRE-OP and stay there; a drive that somebody else drives at that time stops by its own reaction. While a cell of quadrant drives the segment, the scan is refused.\n\nExit status 3: no such interface, it is off or has no link, no right to open raw sockets, a cell drives it, or nobody answers."
)]
pub struct BusScanOptions {
    /// The network interface
    pub interface: String,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// What `quadrant bus sdo` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "An object is read where no VALUE is given, and written where one is:\n  quadrant bus sdo eth1 0 6502          which modes the first drive has\n  quadrant bus sdo eth1 0 605A          what it does at a quick stop\n  quadrant bus sdo eth1 0 605A 6        brake, then hold\n  quadrant bus sdo eth1 1 60C2:2 -3     a negative number\n  quadrant bus sdo eth1 1 1008          its name\n\nIndex and sub-index are hexadecimal and decimal, as manuals print them: 60C2:2, 1A00:10. Values are decimal, or hexadecimal with 0x. What was written holds until the drive is switched off, in most drives; what is to hold at every start belongs into [[start_up.sdo]] of the drive file.\n\nNothing is enabled. All slaves of the segment go to PRE-OP and stay there. While a cell of quadrant drives the segment, this is refused.\n\nExit status 3: the interface cannot be used, nobody answers, or the slave refuses, as is printed."
)]
pub struct BusSdoOptions {
    /// The network interface
    pub interface: String,
    /// Place of the slave on the cable, from 0
    pub slave: usize,
    /// Object: index in hexadecimal, sub-index in decimal (0 where it is left out)
    #[arg(value_name = "INDEX[:SUB]", value_parser = object)]
    pub object: (u16, u8),
    /// Value to write
    #[arg(value_parser = whole_64, allow_negative_numbers = true)]
    pub value: Option<i64>,
    /// Size to write where the object cannot be read
    #[arg(long, requires = "value", value_parser = bits)]
    pub bits: Option<u32>,
}

/// Index and sub-index of an object.
fn object(text: &str) -> Result<(u16, u8), String> {
    let (index, sub) = text.split_once(':').unwrap_or((text, "0"));
    let digits = index.strip_prefix("0x").unwrap_or(index);
    let plain = digits.bytes().all(|digit| digit.is_ascii_hexdigit());
    let index = u16::from_str_radix(digits, 16).ok().filter(|_| plain);
    let sub = sub.parse().ok();
    index
        .zip(sub)
        .ok_or_else(|| format!("{text:?} is no object such as 6064 or 60C2:1"))
}

/// A whole number, hexadecimal or decimal.
fn whole_64(text: &str) -> Result<i64, String> {
    let value = fieldbus::esi::whole(text);
    value.ok_or_else(|| format!("{text:?} is no whole number such as 6, -3 or 0x1F"))
}

/// Size of an object that can be written.
fn bits(text: &str) -> Result<u32, String> {
    let bits = text.parse().ok().filter(|bits| matches!(bits, 8 | 16 | 32));
    bits.ok_or_else(|| format!("{text:?} is not 8, 16 or 32"))
}

/// A number of 32 bits, hexadecimal or decimal.
fn whole_32(text: &str) -> Result<u32, String> {
    let value = fieldbus::esi::whole(text);
    value
        .and_then(|value| u32::try_from(value).ok())
        .ok_or_else(|| format!("{text:?} is no number such as 0x00010420 or 66592"))
}

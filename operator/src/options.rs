//! What the operator's commands take.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use launcher::options::{DialectOption, number};

/// What `quadrant load` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "The program is checked against the machine from where its axes stand, and copied: later edits do not reach the\ncell. Exit status 1: the cell cannot take it now; 2: the program is wrong."
)]
pub struct LoadOptions {
    /// Part program (RS274/NGC, \"G-code\")
    pub program: PathBuf,
    /// Its language.
    #[command(flatten)]
    pub of_program: DialectOption,
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

/// What `quadrant jog-override` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Acts at once, also on what is jogged just now; homing keeps its speed. An axis is no faster than its rapid, or than its search before it is homed.\n\nPrints what happened, or why it was refused, and exits with 0 or 1; also with 1 if\nno cell runs or it does not answer within 5 s; with 2 on bad usage.\n\nHalf as fast near the part, then as before:\n  quadrant jog-override 50\n  quadrant jog Z -20\n  quadrant jog-override 100"
)]
pub struct JogOverrideOptions {
    /// Share of the speed of jogs, in percent; at 0 they rest, and go on from there at more
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
    after_help = "By a distance, along a straight line of several axes, or until Ctrl-C with a direction in place of it:\n  quadrant jog X 10\n  quadrant jog X -0.5 --speed 120 --wait\n  quadrant jog X 1 Y -2\n  quadrant jog X 10 Y 5 --to\n  quadrant jog X 100 --to-machine\n  quadrant jog Z- --speed 1500\n  quadrant jog X+ Y-\n\nA distance that is given while its axis still goes by one adds to it; a jog to a place is refused until it rests. A jog with a direction goes on as long as this command renews its order. When it is killed, stopped or cut off, the axis comes to rest by itself, within 200 ms of scans and its braking; it also does at the end of its travel, and at `hold` and `stop`.\n\nAlong a Y that an arm makes, the tool goes by a typed-in block (`quadrant mdi`), which is waited for.\n\nPrints what happened, or why it was refused, and exits with 0 or 1; with 2 on bad usage."
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
    /// The numbers are places in work coordinates as the readout shows them, not distances
    #[arg(long = "to", conflicts_with = "to_machine")]
    pub to_work: bool,
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

/// What `quadrant wheel` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Reads running counts from standard input, one whole number a line, and tells the cell the newest. The first one only says where the wheel is.\n  for count in $(seq 0 50); do echo $count; sleep 0.02; done | quadrant wheel X 0.01\n  for count in $(seq 0 -1 -50); do echo $count; sleep 0.02; done | quadrant wheel X 0.01 --velocity\n\nEvery count is travelled that comes no faster than the axis may be jogged (`jog_mm_s` of the machine file). After each there is at most one count and 0.2 s of motion left to go; what is more is not taken and never catches up. With --velocity there is only the braking left. Counts that come while the axis may not be jogged move nothing.\n\nAt the end of input, or at Ctrl-C, the axis comes to rest where its count says; what was taken is printed. Exit status 1: the cell has ended; 2: a line is no whole number, or bad usage."
)]
pub struct WheelOptions {
    /// Axis letter
    pub axis: String,
    /// Distance of one count, in mm (degrees of a rotary axis); negative to turn the other way
    #[arg(value_name = "DISTANCE", allow_negative_numbers = true, value_parser = number)]
    pub per_count: f64,
    /// The axis rests as soon as the wheel does, also where counts are lost by it
    #[arg(long)]
    pub velocity: bool,
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

/// What `quadrant alarms` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Shows the alarms of a running cell's machine that are there, or that nobody has acknowledged:\n  quadrant alarms\n  quadrant alarms acknowledge 700\n  quadrant alarms acknowledge\n  quadrant alarms history\n\nEach stands with its number, the time since the cell's first scan, its text and what to do. `history` shows what came, went and was acknowledged."
)]
pub struct AlarmsOptions {
    /// Name of the cell [default: the only one that runs, if its machine is one of this folder]
    #[arg(long, global = true)]
    pub cell: Option<String>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// What is done.
    #[command(subcommand)]
    pub change: Option<AlarmsChangeOptions>,
}

/// What is done about alarms.
#[derive(Debug, Clone, Subcommand)]
pub enum AlarmsChangeOptions {
    /// Acknowledge one, or all: what is over is not shown any more, and an axis whose drive was lost and came back elsewhere is
    /// taken to be where it shows
    Acknowledge {
        /// Its number [default: all]
        number: Option<u32>,
    },
    /// What came, went and was acknowledged, oldest first
    History {
        /// Directory of a run, or of a cell that stayed up [default: of the running cell]
        folder: Option<PathBuf>,
    },
}

/// What `quadrant signal` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Shows the named inputs and outputs of a running cell, or changes one:\n  quadrant signal\n  quadrant signal set part_ready on\n  quadrant signal force lube_pressure 4.5\n  quadrant signal release lube_pressure\n\n`set` is for signals whose source is the operator (from = { by = \"operator\" }); `force` holds any signal at a value, whatever its source says, until `release` or the end of the cell; status and report show what is forced. At most 32 are set or forced at a time. Exits with 0, with 1 where it was refused, with 2 on bad usage."
)]
pub struct SignalOptions {
    /// Name of the cell [default: the only one that runs, if its machine is one of this folder]
    #[arg(long, global = true)]
    pub cell: Option<String>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// What is changed.
    #[command(subcommand)]
    pub change: Option<SignalChangeOptions>,
}

/// A change of a signal.
#[derive(Debug, Clone, Subcommand)]
pub enum SignalChangeOptions {
    /// Show the signals
    List,
    /// Set a signal whose source is the operator
    Set {
        /// Its name
        name: String,
        /// on or off; of a number, the number
        #[arg(allow_negative_numbers = true)]
        value: String,
    },
    /// Hold a signal at a value, whatever its source says
    Force {
        /// Its name
        name: String,
        /// on or off; of a number, the number
        #[arg(allow_negative_numbers = true)]
        value: String,
    },
    /// Let a forced signal follow its source again
    Release {
        /// Its name
        name: String,
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

/// A number, with or without its sign of percent.
fn percent(text: &str) -> Result<f64, String> {
    number(text.strip_suffix('%').unwrap_or(text))
}

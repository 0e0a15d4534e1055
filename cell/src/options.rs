//! What the processes of a cell take.

use machine::LogLevel;
use std::path::PathBuf;

use bus::member::Pace;
use bus::realtime::Settings;
use clap::{ArgAction, Args, Subcommand};

const DEFAULT: Settings = Settings::DEFAULT;

/// A process of a cell.
#[derive(Debug, Clone, Subcommand)]
pub enum Role {
    /// The master of a running cell (started by `run`)
    PlantSim(PlantSimOptions),
    /// The master over drives on a fieldbus, of a running cell (started by `run`)
    Master(MasterOptions),
    /// The owner of the fieldbus, or its standby, of a running cell (started by `run`)
    Fieldbus(FieldbusOptions),
    /// The planner of a running cell (started by `run`)
    Planner(PlannerOptions),
    /// One servo of a running cell (started by `run`)
    Servo(ServoOptions),
    /// What asks the logic of the machine, of a running cell (started by `run`)
    Logic(LogicOptions),
    /// The recorder of a running cell (started by `run`)
    Recorder(RecorderOptions),
}

/// What every role gets from the launcher.
#[derive(Debug, Clone, Args)]
pub struct SlotOptions {
    /// Name of the cell
    #[arg(long)]
    pub cell: String,
    /// Machine file
    #[arg(long)]
    pub machine: PathBuf,
    /// Number of its slot in the roster
    #[arg(long)]
    pub index: usize,
    /// Which process in that slot this is
    #[arg(long, default_value_t = 1)]
    pub incarnation: u32,
    /// Process id of the launcher whose cell this is
    #[arg(long)]
    pub launcher: u32,
    /// Pace of the cell
    #[arg(long, value_parser = ["realtime", "lockstep"])]
    pub pace: String,
    /// Processors to stay on
    #[arg(long, value_delimiter = ',')]
    pub processors: Vec<usize>,
    /// In realtime: SCHED_FIFO priority, 0 for none [default: the role's]
    #[arg(long)]
    pub priority: Option<u32>,
    /// In realtime: keep its memory in memory
    #[arg(long, action = ArgAction::Set, default_value_t = DEFAULT.lock_memory)]
    pub lock_memory: bool,
    /// In realtime: stack to touch before the first scan, in KiB
    #[arg(long, default_value_t = DEFAULT.touch_stack_kb)]
    pub touch_stack_kb: u32,
    /// In realtime: heap to touch before the first scan, in KiB
    #[arg(long, default_value_t = DEFAULT.touch_heap_kb)]
    pub touch_heap_kb: u32,
    /// In realtime: how late the kernel may end a sleep, in ns
    #[arg(long, default_value_t = DEFAULT.timer_slack_ns)]
    pub timer_slack_ns: u32,
    /// In realtime: longest time that it may use a processor under SCHED_FIFO without a pause, in ms
    #[arg(long, default_value_t = DEFAULT.busy_max_ms)]
    pub busy_max_ms: u32,
    /// Scans up to this one are none of its business: it replaces a process that was lost
    #[arg(long)]
    pub after_scan: Option<u64>,
}

impl SlotOptions {
    /// The slot they name.
    pub fn slot(&self) -> bus::member::Slot {
        bus::member::Slot {
            cell: self.cell.clone(),
            machine: self.machine.clone(),
            index: self.index,
            incarnation: self.incarnation,
            launcher: self.launcher,
            pace: self.pace.parse().unwrap_or(Pace::Lockstep),
            processors: self.processors.clone(),
            realtime: Settings {
                priority: self.priority,
                lock_memory: self.lock_memory,
                touch_stack_kb: self.touch_stack_kb,
                touch_heap_kb: self.touch_heap_kb,
                timer_slack_ns: self.timer_slack_ns,
                busy_max_ms: self.busy_max_ms,
            },
            after_scan: self.after_scan,
        }
    }
}

/// What `quadrant plant-sim` takes.
#[derive(Debug, Clone, Args)]
pub struct PlantSimOptions {
    /// What every master takes.
    #[command(flatten)]
    pub master: MasterOptions,
    /// Plant file
    #[arg(long)]
    pub plant: PathBuf,
}

/// What `quadrant fieldbus` takes.
#[derive(Debug, Clone, Args)]
pub struct FieldbusOptions {
    /// Its slot in the cell.
    #[command(flatten)]
    pub slot: SlotOptions,
    /// Seconds that drives may take for one answer in lockstep
    #[arg(long, default_value_t = 30)]
    pub answer_limit: u64,
}

/// What `quadrant master` takes.
#[derive(Debug, Clone, Args)]
pub struct MasterOptions {
    /// Its slot in the cell.
    #[command(flatten)]
    pub slot: SlotOptions,
    /// Drives on from the first scan
    #[arg(long)]
    pub enabled: bool,
    /// End when the program is done or the machine has stopped
    #[arg(long)]
    pub end_after_program: bool,
    /// Block by block from the start
    #[arg(long)]
    pub single_block: bool,
    /// Line that its program begins at; 0 for its beginning
    #[arg(long, default_value_t = 0)]
    pub start_line: u32,
    /// Seconds a living process may take for one answer
    #[arg(long, default_value_t = 30)]
    pub answer_limit: u64,
    /// Orders to obey, each at its scan
    #[arg(long)]
    pub orders: Option<PathBuf>,
    /// Faults to inject
    #[arg(long)]
    pub faults: Option<PathBuf>,
    /// Where blocks that the faults name begin on the path, as LINE=ELEMENT
    #[arg(long, value_delimiter = ',')]
    pub fault_block: Vec<String>,
}

/// What `quadrant planner` takes.
#[derive(Debug, Clone, Args)]
pub struct PlannerOptions {
    /// Its slot in the cell.
    #[command(flatten)]
    pub slot: SlotOptions,
    /// Part program; without one, those that are loaded into the cell
    #[arg(long)]
    pub program: Option<PathBuf>,
}

/// What `quadrant logic` takes.
#[derive(Debug, Clone, Args)]
pub struct LogicOptions {
    /// Its slot in the cell.
    #[command(flatten)]
    pub slot: SlotOptions,
    /// Seconds that the logic may take for one answer in lockstep, and to begin
    #[arg(long, default_value_t = 30)]
    pub answer_limit: u64,
}

/// What `quadrant servo` takes.
#[derive(Debug, Clone, Args)]
pub struct ServoOptions {
    /// Its slot in the cell.
    #[command(flatten)]
    pub slot: SlotOptions,
    /// Axis letter
    #[arg(long)]
    pub axis: String,
    /// Role: a drives, b stands by
    #[arg(long, default_value = "a", value_parser = ["a", "b"])]
    pub role: String,
}

/// What `quadrant recorder` takes.
#[derive(Debug, Clone, Args)]
pub struct RecorderOptions {
    /// Its slot in the cell.
    #[command(flatten)]
    pub slot: SlotOptions,
    /// Run directory to record into; without a program, the folder in which each one that is started gets its own
    #[arg(long)]
    pub out: PathBuf,
    /// Part program, for the log's metadata
    #[arg(long)]
    pub program: Option<PathBuf>,
    /// What goes into the log
    #[arg(long, default_value = "full")]
    pub level: LogLevel,
}

impl PlannerOptions {
    /// What the planner's crate takes.
    pub fn options(&self) -> planner::Options {
        planner::Options {
            slot: self.slot.slot(),
            program: self.program.clone(),
        }
    }
}

impl ServoOptions {
    /// What the servo's crate takes.
    pub fn options(&self) -> servo::Options {
        servo::Options {
            slot: self.slot.slot(),
            axis: self.axis.clone(),
            role: u32::from(self.role == "b"),
        }
    }
}

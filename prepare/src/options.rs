//! What the commands take that prepare a machine.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use launcher::options::DialectOption;

/// What `quadrant check` takes.
#[derive(Debug, Clone, Args)]
pub struct CheckOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml
    pub machine: PathBuf,
    /// Part program to check against the machine
    pub program: Option<PathBuf>,
    /// Its language.
    #[command(flatten)]
    pub of_program: DialectOption,
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
    /// Its language.
    #[command(flatten)]
    pub of_program: DialectOption,
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

/// What `quadrant doctor` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Each finding is ok, could be better, or must be changed; the last two with the reason and what to type.\nHow late scans begin is measured as the master would begin them: the longer the better, and beside\nwhatever this PC has to do as well:\n  quadrant doctor machines/mine --seconds 600\nWith drives on EtherCAT, their network interface is looked at too:\n  quadrant doctor eth1\n\nExit status 3: something must be changed before a cell runs in real time."
)]
pub struct DoctorOptions {
    /// A machine: its scans are measured as its master would start them, and its network interface is looked at; or an interface alone
    #[arg(value_name = "MACHINE|INTERFACE")]
    pub of: Option<String>,
    /// Seconds of scans that are measured; Ctrl-C ends them
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub seconds: u64,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
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
    /// Make a terminal file from the ESI file of a device with inputs and outputs
    IoFile(IoFileOptions),
    /// Check a drive or terminal file by itself and, if given, against the vendor's ESI file
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
    /// Of which device.
    #[command(flatten)]
    pub of: EsiOptions,
    /// Mode of operation [default: the first of these that the drive can be driven in]; the last two are for spindles alone
    #[arg(long, value_parser = ["csv", "cst", "csp", "profile-velocity", "velocity"])]
    pub mode: Option<String>,
    /// How many axes of the drive are in the file, where it has several [default: those that it cannot be without]
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u16).range(1..=8))]
    pub axes: Option<u16>,
}

/// What names a device of an ESI file, and the file that is made of it.
#[derive(Debug, Clone, Args)]
pub struct EsiOptions {
    /// The vendor's ESI file
    pub esi: PathBuf,
    /// Product code (0x00030924 or decimal), or a part of the name, where the file describes several
    #[arg(long, value_name = "CODE|NAME")]
    pub product: Option<String>,
    /// Revision (0x00010420 or decimal), where the file describes several
    #[arg(long, value_name = "NUMBER", value_parser = whole_32)]
    pub revision: Option<u32>,
    /// File to write [default: drives/NAME.toml, or terminals/NAME.toml, by the name of the device]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

impl EsiOptions {
    /// It, and which in the file, from 1.
    pub fn choice(&self, device: Option<usize>) -> esi::Choice<'_> {
        esi::Choice {
            product: self.product.as_deref(),
            revision: self.revision,
            device,
        }
    }
}

/// What `quadrant bus io-file` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "A terminal is a device with digital or analogue inputs and outputs, or counters, and no motor. From the vendor's ESI file to signals of a machine:\n  quadrant bus io-file Vendor_IO.xml --out terminals/x.toml\n  (in machine.toml: [[bus.terminal]] with slave = 3 and file = \"terminals/x.toml\"; [[signal]] with from = { terminal = 3, channel = 1 })\n  quadrant check MACHINE\n\nChannels are numbered in the order of the process data, inputs first. Where the file describes several devices they are listed, with what to write for each. Nothing that is there is overwritten. Exit status 2: no terminal file can be made, as is printed."
)]
pub struct IoFileOptions {
    /// Of which device.
    #[command(flatten)]
    pub of: EsiOptions,
    /// Which device of the file, from 1, where it describes several
    #[arg(long, value_name = "N")]
    pub device: Option<usize>,
}

/// What `quadrant bus check` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Everything that is wrong is printed, a line each, with what to do; what may not be meant so is a warning. No drive need be there:\n  quadrant bus check drives/x.toml\n  quadrant bus check drives/x.toml --esi Vendor_Drive.xml\n\nExit status 2: something is wrong."
)]
pub struct BusCheckOptions {
    /// The drive file, or terminal file
    pub file: PathBuf,
    /// The vendor's ESI file
    #[arg(long, value_name = "FILE")]
    pub esi: Option<PathBuf>,
}

/// What `quadrant bus scan` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "INTERFACE is a network interface of this PC that goes to the IN port of the first drive, and to nothing else (`ip link` lists them):\n  quadrant bus scan eth1\n  quadrant bus scan eth1 --json\n  quadrant bus scan eth1 --machine machines/mine\n  quadrant bus scan eth1 --dc\n\nSlaves are listed in the order of the cable: `place` is what `slave` in [axis.drive] of the machine file counts from 0. `vendor`, `product` and `revision` are what [identity] of a drive file has to say, process data what [process_data] has to say. `profile` is 402 with drives of CiA 402. `clocks` says whether sync = \"dc\" is possible; --dc tells more of it: the delay of the cable up to each slave, the difference of its clock from the reference after some seconds, the ways of synchronisation that it has, its shortest cycle, how long it takes outputs in, how many sync errors it bears (10F1:2: three for each cycle that misses its data), and what it has counted.\n\nNothing is enabled. All slaves go to PRE-OP and stay there; a drive that somebody else drives at that time stops by its own reaction. While a cell of quadrant drives the segment, the scan is refused.\n\nExit status 3: no such interface, it is off or has no link, no right to open raw sockets, a cell drives it, or nobody answers."
)]
pub struct BusScanOptions {
    /// The network interface
    pub interface: String,
    /// Say what this machine has at each place, and which signals that carries
    #[arg(long, value_name = "MACHINE", conflicts_with = "json")]
    pub machine: Option<PathBuf>,
    /// Say how the slaves keep time: distributed clocks
    #[arg(long)]
    pub dc: bool,
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
    let value = esi::whole(text);
    value.ok_or_else(|| format!("{text:?} is no whole number such as 6, -3 or 0x1F"))
}

/// Size of an object that can be written.
fn bits(text: &str) -> Result<u32, String> {
    let bits = text.parse().ok().filter(|bits| matches!(bits, 8 | 16 | 32));
    bits.ok_or_else(|| format!("{text:?} is not 8, 16 or 32"))
}

/// A number of 32 bits, hexadecimal or decimal.
fn whole_32(text: &str) -> Result<u32, String> {
    let value = esi::whole(text);
    value
        .and_then(|value| u32::try_from(value).ok())
        .ok_or_else(|| format!("{text:?} is no number such as 0x00010420 or 66592"))
}

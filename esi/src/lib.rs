//! ESI files: what a vendor says of its EtherCAT devices (EtherCAT Slave Information, ETG.2000), in XML.
//!
//! Nothing in such a file makes the reader panic; what a drive needs and cannot be understood is named with its line. [`from_esi()`]
//! makes a drive file of one, [`terminal_from_esi()`] a terminal file; [`write()`] and [`write_terminal()`] give them their comments,
//! [`judge()`] and [`judge_terminal()`] hold such a file against one.

mod against;
mod axes;
mod choose;
mod device;
mod dictionary;
mod error;
mod from_esi;
mod mapping;
mod modules;
mod number;
mod terminal;
mod text;
mod write;
mod xml;

pub use against::{judge, judge_terminal};
pub use choose::{Choice, choose, choose_terminal};
pub use dictionary::{Dictionary, Object};
pub use error::EsiError;
pub use from_esi::{Made, NotMade, from_esi};
pub use number::whole;
pub use terminal::terminal_from_esi;
pub use write::{write, write_terminal};

use std::path::Path;

use roxmltree::{Document, ParsingOptions};

use fieldbus::cia402;
use modules::Modules;
use xml::{at, children, english, line, number_of};

/// Most elements, attributes and texts of a file; the largest known have a tenth of it.
const NODES_MAX: u32 = 20_000_000;

/// An ESI file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Esi {
    /// Its name, for messages.
    pub file: String,
    /// Number of the vendor.
    pub vendor: u32,
    /// Name of the vendor.
    pub vendor_name: String,
    /// The devices, in the order of the file.
    pub devices: Vec<Device>,
}

/// One revision of a product.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Device {
    /// Its line in the file, from 1.
    pub line: u32,
    /// Product code.
    pub product_code: u32,
    /// Revision.
    pub revision: u32,
    /// Short name (`Type`).
    pub type_name: String,
    /// Name for people.
    pub name: String,
    /// Numbers of the device profiles that it keeps to; 402 is that of drives.
    pub profiles: Vec<u32>,
    /// Process data that it can receive.
    pub receive: Vec<Pdo>,
    /// Process data that it can transmit.
    pub transmit: Vec<Pdo>,
    /// Sync managers, in their order.
    pub sync_managers: Vec<SyncManager>,
    /// Its mailbox; `None` where it has none.
    pub mailbox: Option<Mailbox>,
    /// How it can be synchronised.
    pub sync_modes: Vec<SyncMode>,
    /// SDOs that the vendor wants written before operation.
    pub init_commands: Vec<InitCommand>,
    /// Its objects.
    pub dictionary: Dictionary,
    /// Whether it is made up of modules whose process data stands elsewhere.
    pub modular: bool,
    /// What it is with each of the modules that fit into its first slot; empty of a device without slots, and of one whose modules the
    /// file does not have.
    pub variants: Vec<Device>,
}

/// A process data object of a device.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Pdo {
    /// Its index: 0x1600 and up for what the device receives, 0x1A00 and up for what it transmits.
    pub index: u16,
    /// Its name.
    pub name: String,
    /// Whether its entries cannot be changed.
    pub fixed: bool,
    /// The sync manager that it is assigned to from the factory.
    pub sync_manager: Option<u8>,
    /// PDOs that cannot be assigned together with it.
    pub excludes: Vec<u16>,
    /// Its entries.
    pub entries: Vec<PdoEntry>,
}

/// An entry of a PDO; index 0 is a gap.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PdoEntry {
    /// Index of the object.
    pub index: u16,
    /// Sub-index.
    pub sub: u8,
    /// Size in bits.
    pub bits: u32,
    /// Name of the object.
    pub name: String,
    /// Its type (`DataType`), as `BOOL` or `INT`; empty where the file does not say it.
    pub data_type: String,
}

/// What a sync manager is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// Mailbox to the device.
    MailboxOut,
    /// Mailbox from the device.
    MailboxIn,
    /// Process data to the device.
    Outputs,
    /// Process data from the device.
    Inputs,
}

/// A sync manager of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SyncManager {
    /// What it is for; `None` for one that is not used.
    pub purpose: Option<Purpose>,
    /// Start address.
    pub start: u16,
    /// Control byte.
    pub control: u8,
    /// Size from the factory in bytes; 0 where it follows from the process data.
    pub size: u16,
    /// Largest size in bytes; `None` where the file does not tell it.
    pub size_max: Option<u16>,
}

/// The mailbox of a device and what it can do over CoE (CAN application protocol over EtherCAT).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Mailbox {
    /// Whether it answers SDOs at all.
    pub coe: bool,
    /// Whether objects can be read and written as a whole.
    pub complete_access: bool,
    /// Whether the PDOs to exchange can be chosen.
    pub pdo_assign: bool,
    /// Whether the entries of PDOs can be written.
    pub pdo_config: bool,
    /// Whether it tells its object dictionary.
    pub sdo_info: bool,
    /// Longest time to take a request, in ms.
    pub request_timeout_ms: Option<u32>,
    /// Longest time to answer, in ms.
    pub response_timeout_ms: Option<u32>,
}

/// A way to synchronise a device (`Dc/OpMode`).
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SyncMode {
    /// Its name.
    pub name: String,
    /// Value of register 0x0980 and 0x0981: 0 without SYNC signals, 0x300 SYNC0, 0x700 SYNC0 and SYNC1.
    pub assign_activate: u16,
    /// Cycle of SYNC0 in ns; 0 where it follows from the cycle of the bus.
    pub sync0_cycle_ns: i64,
    /// Cycle of SYNC0 in cycles of the bus.
    pub sync0_cycle_factor: i32,
    /// Shift of SYNC0 in ns.
    pub sync0_shift_ns: i64,
    /// Shift of SYNC1 from SYNC0 in ns.
    pub sync1_shift_ns: i64,
}

/// An SDO that the vendor wants written before operation (`InitCmd`).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InitCommand {
    /// Index.
    pub index: u16,
    /// Sub-index.
    pub sub: u8,
    /// Size in bits.
    pub bits: u32,
    /// Value, without a sign.
    pub value: u64,
    /// What it is for.
    pub comment: String,
}

impl Esi {
    /// Reads an ESI file.
    ///
    /// # Errors
    /// It cannot be read, is not XML or no ESI, or a device in it cannot be understood: with its line.
    pub fn load(path: &Path) -> Result<Esi, EsiError> {
        let file = path.display().to_string();
        let bytes = text::read(path).map_err(|what| EsiError::Unreadable {
            file: file.clone(),
            what,
        })?;
        Esi::parse(&file, &bytes)
    }

    /// Reads the bytes of an ESI file: UTF-8, UTF-16 with its mark, or an 8-bit code in which names alone can be wrong; `file` is its
    /// name, for messages.
    ///
    /// # Errors
    /// As [`Esi::load`].
    pub fn parse(file: &str, bytes: &[u8]) -> Result<Esi, EsiError> {
        let text = text::decode(bytes);
        let wrong = |line: u32, what: String| EsiError::Wrong {
            file: file.to_string(),
            line,
            what,
        };
        let options = ParsingOptions {
            nodes_limit: NODES_MAX,
            ..ParsingOptions::default()
        };
        let document = Document::parse_with_options(&text, options)
            .map_err(|error| wrong(error.pos().row, format!("is no XML: {error}")))?;
        let root = document.root_element();
        if root.tag_name().name() != "EtherCATInfo" {
            let found = root.tag_name().name();
            let what =
                format!("is no ESI file: begins with <{found}>, must begin with <EtherCATInfo>");
            return Err(wrong(line(root), what));
        }
        let vendor = at(root, &["Vendor"]);
        let number = vendor.and_then(|vendor| number_of::<u32>(vendor, "Id"));
        let (Some(vendor), Some(number)) = (vendor, number) else {
            let what = "has no vendor: <Vendor> must hold an <Id> such as #x0000009A";
            return Err(wrong(line(root), what.to_string()));
        };
        // Some files have hundreds of devices: lines are counted once.
        let ends: Vec<usize> = text.match_indices('\n').map(|(at, _)| at).collect();
        let mut devices = Vec::new();
        let modules = Modules::read(root);
        if let Some(list) = at(root, &["Descriptions", "Devices"]) {
            for node in children(list, "Device") {
                let mut device = Device::read(node).map_err(|(line, what)| wrong(line, what))?;
                let before = ends.partition_point(|end| *end < node.range().start);
                device.line = u32::try_from(before + 1).unwrap_or(u32::MAX);
                let variants = modules.variants(&device, node);
                device.variants = variants.map_err(|(line, what)| wrong(line, what))?;
                devices.push(device);
            }
        }
        Ok(Esi {
            file: file.to_string(),
            vendor: number,
            vendor_name: english(vendor, "Name").unwrap_or_default().to_string(),
            devices,
        })
    }
}

impl Device {
    /// Whether it is a CiA 402 drive: it keeps to that profile, or receives a controlword and transmits a statusword.
    pub fn is_drive(&self) -> bool {
        let holds = |pdos: &[Pdo], index| {
            let mut entries = pdos.iter().flat_map(|pdo| &pdo.entries);
            entries.any(|entry| (entry.index, entry.sub, entry.bits) == (index, 0, 16))
        };
        self.variants.iter().any(Device::is_drive)
            || self.profiles.contains(&cia402::PROFILE)
            || (holds(&self.receive, cia402::CONTROLWORD)
                && holds(&self.transmit, cia402::STATUSWORD))
    }

    /// Whether it has inputs or outputs and is no drive.
    pub fn is_terminal(&self) -> bool {
        let mut pdos = self.receive.iter().chain(&self.transmit);
        pdos.any(|pdo| !pdo.entries.is_empty()) && !self.is_drive()
    }

    /// A PDO that it receives.
    pub fn receive_pdo(&self, index: u16) -> Option<&Pdo> {
        self.receive.iter().find(|pdo| pdo.index == index)
    }

    /// A PDO that it transmits.
    pub fn transmit_pdo(&self, index: u16) -> Option<&Pdo> {
        self.transmit.iter().find(|pdo| pdo.index == index)
    }

    /// What the file tells of an object: by the dictionary, and by PDOs that hold it.
    pub fn object(&self, index: u16, sub: u8) -> Option<Object> {
        let of = |pdos: &[Pdo]| {
            let mut entries = pdos.iter().flat_map(|pdo| &pdo.entries);
            let found =
                entries.find(|entry| index != 0 && (entry.index, entry.sub) == (index, sub));
            found.cloned()
        };
        let (received, transmitted) = (of(&self.receive), of(&self.transmit));
        let (receive, transmit) = (received.is_some(), transmitted.is_some());
        let known = self.dictionary.get(index, sub).cloned();
        let mut object = match (known, received.or(transmitted)) {
            (Some(known), _) => known,
            (None, Some(entry)) => Object {
                name: entry.name,
                bits: entry.bits,
                ..Object::default()
            },
            (None, None) => return None,
        };
        // Some dictionaries do not say of an object that it can be mapped, though a PDO holds it.
        object.receive |= receive;
        object.transmit |= transmit;
        Some(object)
    }

    /// The sync manager for this purpose.
    pub fn sync_manager(&self, purpose: Purpose) -> Option<&SyncManager> {
        let mut all = self.sync_managers.iter();
        all.find(|manager| manager.purpose == Some(purpose))
    }
}

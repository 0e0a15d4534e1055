//! The channels of a log: what each is written as, and from which level on.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::sync::Arc;

use bus::sample::{AxisCommand, Setpoint, WindowHeader};
use bus::service::ROLES;
use machine::{LogLevel, Machine};
use mcap::Writer;

use super::codec::Codec;
use super::columns::Columns;
use super::derived::AxisRow;
use super::layout::{Extent, Layout, definitions_of, join_definitions};
use super::packer::Sink;
use crate::digest::{self, ChannelHash};

pub(super) const FEEDBACK: usize = 0;
pub(super) const INSTRUMENTS: usize = 1;
pub(super) const PLANNER: usize = 2;
pub(super) const ROSTER: usize = 3;
pub(super) const WINDOW: usize = 4;
pub(super) const EVENT: usize = 5;
pub(super) const AXES: usize = 6;

pub(super) struct Channel {
    pub(super) id: u16,
    pub(super) sequence: u32,
    pub(super) topic: String,
    pub(super) counts: bool,
    pub(super) hash: ChannelHash,
    /// The levels that have it.
    pub(super) levels: RangeInclusive<LogLevel>,
    /// Samples that are written together; none where each is a message.
    pub(super) waiting: Option<Waiting>,
}

/// Rows that wait for the others of their time.
pub(super) struct Waiting {
    pub(super) columns: Arc<Columns>,
    pub(super) rows: Vec<u8>,
    /// Of the first row.
    pub(super) time_ns: u64,
}

/// What servos have said of an axis, and where it goes.
pub(super) struct AxisChannels {
    /// Role a, role b (made when first heard).
    pub(super) roles: [Option<usize>; ROLES.len()],
    pub(super) whole: usize,
    /// The next command goes in whole, with the state of its servo.
    pub(super) whole_is_due: bool,
}

/// How the samples of a channel are written.
pub(super) enum Form {
    Messages(Layout),
    Columns(Columns),
}

impl Form {
    pub(super) fn channel(
        self,
        writer: &mut Writer<Sink>,
        topic: &str,
        from: LogLevel,
    ) -> Result<Channel, mcap::McapError> {
        let (name, schema) = match &self {
            Form::Messages(layout) => (&layout.schema_name, &layout.schema),
            Form::Columns(columns) => (&columns.schema_name, &columns.schema),
        };
        let schema = writer.add_schema(name, "ros2msg", schema.as_bytes())?;
        // Asked for by MCAP's profile ros2; empty is what a recorder writes that knows of none.
        let metadata = BTreeMap::from([("offered_qos_profiles".to_string(), String::new())]);
        let id = writer.add_channel(schema, topic, "cdr", &metadata)?;
        Ok(Channel {
            id,
            sequence: 0,
            topic: topic.into(),
            counts: digest::counts(topic),
            hash: ChannelHash::default(),
            levels: from..=LogLevel::Full,
            waiting: match self {
                Form::Messages(_) => None,
                Form::Columns(columns) => Some(Waiting {
                    columns: Arc::new(columns),
                    rows: Vec::new(),
                    time_ns: 0,
                }),
            },
        })
    }
}

/// All channels of a log; among them, by index, the channels of each axis, of the fieldbus and of the signals.
pub(super) type Made = (Vec<Channel>, Vec<AxisChannels>, [Option<usize>; 2]);

pub(super) fn make_channels(
    writer: &mut Writer<Sink>,
    machine: &Machine,
    extent: &Extent,
    level: LogLevel,
) -> Result<Made, mcap::McapError> {
    let Codec {
        feedback,
        instruments,
        bus_cycle: cycle,
        signals,
        command,
        planner,
        roster,
        ..
    } = Codec::of_level(extent, level);
    let columns = |row: Layout| Form::Columns(Columns::of(row));
    let topic = |name: &str| name.to_string();
    let instruments = columns(instruments);
    let window = Form::Messages(window_layout(extent));
    let event = Layout::text("Event", "uint64 scan\nstring process\nstring text\n");
    let event = Form::Messages(event);
    let mut plan = vec![
        (topic("/feedback"), columns(feedback), LogLevel::Axes),
        (topic("/instruments"), instruments, LogLevel::Control),
        (topic("/planner"), columns(planner), LogLevel::Control),
        (topic("/roster"), Form::Messages(roster), LogLevel::Events),
        (topic("/window"), window, LogLevel::Control),
        (topic("/event"), event, LogLevel::Events),
    ];
    for axis in &extent.axes {
        let rows = columns(Layout::of::<AxisRow>(extent));
        plan.push((format!("/axis/{axis}"), rows, LogLevel::Axes));
    }
    for axis in &extent.axes {
        let commands = columns(command.clone());
        plan.push((format!("/command/{axis}"), commands, LogLevel::Axes));
    }
    let bus_cycle = machine.bus.is_some().then_some(plan.len());
    if bus_cycle.is_some() {
        plan.push((topic("/bus_cycle"), columns(cycle), LogLevel::Control));
    }
    let of_signals = (!machine.signals.is_empty()).then_some(plan.len());
    if of_signals.is_some() {
        plan.push((topic("/signals"), columns(signals), LogLevel::Axes));
    }
    let states = plan.len();
    for axis in &extent.axes {
        let whole = columns(Layout::of::<AxisCommand>(extent));
        plan.push((format!("/servo_state/{axis}"), whole, LogLevel::Control));
    }
    let mut channels = Vec::new();
    for (topic, form, from) in plan {
        channels.push(form.channel(writer, &topic, from)?);
    }
    for channel in channels.iter_mut().skip(states) {
        // At the highest level every command is whole.
        channel.levels = LogLevel::Control..=LogLevel::Control;
    }
    let commands = (0..extent.axes.len()).map(|axis| AxisChannels {
        roles: [Some(AXES + extent.axes.len() + axis), None],
        whole: states + axis,
        whole_is_due: true,
    });
    Ok((channels, commands.collect(), [bus_cycle, of_signals]))
}

/// Layout of the header, schema of the whole message.
fn window_layout(extent: &Extent) -> Layout {
    let mut layout = Layout::of::<WindowHeader>(extent);
    let body = "quadrant/WindowHeader header\nuint64 tail_checksum\nquadrant/Setpoint[] rows\n";
    let mut definitions = vec![("Window".to_string(), body.to_string())];
    definitions.extend(definitions_of::<WindowHeader>(extent));
    for definition in definitions_of::<Setpoint>(extent) {
        if !definitions.contains(&definition) {
            definitions.push(definition);
        }
    }
    layout.schema_name = "quadrant/msg/Window".into();
    layout.schema = join_definitions(&definitions);
    layout
}

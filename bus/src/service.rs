//! The service table: every service of a cell, who writes it, who reads it, how deep its queues are.
//!
//! **Invariant**: one writer each. The launcher creates all services before it starts anybody and holds them open; all
//! others only open them (a kill during creation would brick a service for good).

use std::fmt::Debug;
use std::mem::offset_of;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

use bytemuck::Pod;
use iceoryx2::node::{Node, NodeBuilder, NodeState};
use iceoryx2::prelude::{
    CallbackProgression, NodeName, ServiceName, SignalHandlingMode, ZeroCopySend,
};
use iceoryx2::service::ipc;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use iceoryx2::service::port_factory::request_response;

use crate::cell::{CellError, CellPaths};
use crate::room;
use crate::sample::checksum;
use crate::sample::{
    AxisCommand, BusCycle, Feedback, Instruments, LogicAnswer, MAX_AXES, MAX_WINDOW_SETPOINTS,
    OperatorRequest, OperatorResponse, PATH_AXES, PlannerStatus, Roster, SIGNALS_MAX, Setpoint,
    Signals, WindowHeader,
};

/// Scans the recorder's queues hold; in lockstep the master waits at half of it.
pub const RECORDER_DEPTH_SCANS: usize = 1024;
/// Samples a reader on the scan path holds.
pub const SCAN_DEPTH: usize = 8;
/// Controllers an axis can have: roles a and b.
pub const ROLES: [&str; 2] = ["a", "b"];

/// Time between two looks for unfinished segments while dead processes are cleaned up after.
const UNFINISHED_LOOK: Duration = Duration::from_millis(20);
/// So long a place in a service may be that of a process that is dead: the launcher cleans up every second, if it runs.
pub(crate) const PLACE_LIMIT: Duration = Duration::from_secs(2);
pub(crate) const PLACE_LOOK: Duration = Duration::from_millis(5);
/// Cleanings after the dead in one go, where one has failed.
const CLEANINGS_MAX: u32 = 3;
const VIEWERS_MAX: usize = 8;
const NODES_SLACK: usize = 24;
/// Samples that a reader may have in hand: the one it is at, and one that it has set aside.
const BORROWED_MAX: usize = 2;
/// Samples that a writer has in hand, and some to spare.
const WRITTEN_MAX: usize = 8;

/// One publish–subscribe service of the table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topic {
    /// Its name below the cell's.
    pub name: String,
    /// Samples the deepest reader holds.
    pub depth: usize,
    /// Samples a late reader gets at once.
    pub history: usize,
    /// Readers it can have.
    pub readers: usize,
}

impl Topic {
    /// Samples for which its writer has room: those in the deepest queue, since all readers hold the same, and those that readers
    /// and writer have in hand.
    pub(crate) fn samples_max(&self) -> usize {
        self.depth + self.history + BORROWED_MAX * self.readers + WRITTEN_MAX
    }

    /// The same of windows, which are let go at once.
    pub(crate) fn windows_max(&self) -> usize {
        self.depth + self.history + self.readers + WRITTEN_MAX
    }
}

/// Bytes that iceoryx2 puts before each sample, at most.
const CHUNK_HEADER: usize = 64;
/// Feedback, instruments, setpoint, planner, roster and operator.
const CELL_SERVICES: usize = 6;
/// Launcher, recorder, planner and master.
const CELL_PROCESSES: usize = 4;
/// Bytes for the connections and files of one process.
const PROCESS_ROOM: usize = 160 << 10;
/// Bytes for page, service files and clients.
const CELL_ROOM: usize = 512 << 10;

/// Names and depths of the services; all processes make the same table from the machine file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Services {
    cell: String,
    /// Written by the master at the start of each scan.
    pub feedback: Topic,
    /// Written by the master at the end of each scan; for the recorder only.
    pub instruments: Topic,
    /// Written by the master at the end of each scan; for observers only. None where drives are simulated.
    pub bus_cycle: Option<Topic>,
    /// Written by the master at the end of each scan: named inputs and outputs. None where the machine names none.
    pub signals: Option<Topic>,
    /// Written by the logic. None where the machine has none.
    pub logic: Option<Topic>,
    /// Written by the planner: windows.
    pub setpoint: Topic,
    /// Written by the planner at each period boundary.
    pub planner: Topic,
    /// Written by the launcher.
    pub roster: Topic,
    /// Written by the servo of each axis (outer) and role (inner).
    pub commands: Vec<[Topic; 2]>,
    /// Served by the master.
    pub operator: String,
}

/// What the service table needs to know of a machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shape {
    /// Names of the axes, in the order of the machine file.
    pub axes: Vec<String>,
    /// Scans in one interpolation period.
    pub period_scans: u32,
    /// Whether its drives are on a fieldbus.
    pub has_bus: bool,
    /// Whether it has named inputs or outputs.
    pub has_signals: bool,
    /// Whether a process of its own does its logic.
    pub has_logic: bool,
}

impl Services {
    /// The table of a cell.
    pub fn of(place: &CellPaths, shape: &Shape) -> Services {
        let topic = |name: String, depth: usize, history: usize| Topic {
            name: format!("{}/{name}", place.name()),
            depth,
            history,
            readers: ROLES.len() * shape.axes.len() + CELL_PROCESSES + VIEWERS_MAX,
        };
        let periods = RECORDER_DEPTH_SCANS / (shape.period_scans as usize).max(1) + SCAN_DEPTH;
        Services {
            cell: place.name().into(),
            feedback: topic("feedback".into(), RECORDER_DEPTH_SCANS, 1),
            instruments: topic("instruments".into(), RECORDER_DEPTH_SCANS, 0),
            bus_cycle: shape
                .has_bus
                .then(|| topic("bus_cycle".into(), RECORDER_DEPTH_SCANS, 0)),
            signals: shape
                .has_signals
                .then(|| topic("signals".into(), RECORDER_DEPTH_SCANS, 1)),
            logic: shape
                .has_logic
                .then(|| topic("logic".into(), RECORDER_DEPTH_SCANS, 0)),
            // No history: it would be delivered with the next window, at no particular instant of a scan.
            setpoint: topic("setpoint".into(), periods, 0),
            planner: topic("planner".into(), periods, 1),
            roster: topic("roster".into(), 64, 1),
            commands: shape
                .axes
                .iter()
                .map(|axis| {
                    ROLES.map(|role| {
                        topic(format!("command/{axis}/{role}"), RECORDER_DEPTH_SCANS, 0)
                    })
                })
                .collect(),
            operator: format!("{}/operator", place.name()),
        }
    }

    /// How many there are.
    pub(crate) fn count(&self) -> usize {
        let optional = [&self.bus_cycle, &self.signals, &self.logic]
            .into_iter()
            .flatten()
            .count();
        CELL_SERVICES + optional + ROLES.len() * self.commands.len()
    }

    /// Shared memory that a cell with these services takes, at most: its segments, the files of iceoryx2, the page, and some
    /// for its clients.
    pub fn room_bytes(&self) -> u64 {
        let of = |topic: &Topic, sample: usize| topic.samples_max() * (sample + CHUNK_HEADER);
        let setpoints = WINDOW_SETPOINTS * size_of::<Setpoint>();
        let window = size_of::<WindowHeader>() + setpoints + CHUNK_HEADER;
        let commands = self.commands.iter().flatten();
        let commands: usize = commands
            .map(|topic| of(topic, size_of::<AxisCommand>()))
            .sum();
        let segments = of(&self.feedback, size_of::<Feedback>())
            + of(&self.instruments, size_of::<Instruments>())
            + self
                .bus_cycle
                .as_ref()
                .map_or(0, |topic| of(topic, size_of::<BusCycle>()))
            + self
                .signals
                .as_ref()
                .map_or(0, |topic| of(topic, size_of::<Signals>()))
            + self
                .logic
                .as_ref()
                .map_or(0, |topic| of(topic, size_of::<LogicAnswer>()))
            + self.setpoint.windows_max() * window
            + of(&self.planner, size_of::<PlannerStatus>())
            + of(&self.roster, size_of::<Roster>())
            + commands;
        let processes = CELL_PROCESSES + ROLES.len() * self.commands.len();
        (segments + processes * PROCESS_ROOM + CELL_ROOM) as u64
    }
}

pub(crate) type PubSub<T> = PortFactory<ipc::Service, T, ()>;
pub(crate) type Windows = PortFactory<ipc::Service, [Setpoint], WindowHeader>;
pub(crate) type Operator =
    request_response::PortFactory<ipc::Service, OperatorRequest, (), OperatorResponse, ()>;

/// No cell comes to a later scan: 285,000 years of 1 ms. Whoever counts from it overflows nowhere.
pub const SCAN_MAX: u64 = 1 << 53;

/// What can travel in a publish–subscribe service of fixed size.
pub trait Sample: Pod + ZeroCopySend + Debug {
    /// The scan it was made in.
    fn scan(&self) -> u64;
    /// The first scan in which a reader may act on it.
    fn visible_from(&self) -> u64;
    /// Bytes at its beginning that are in use; what follows, but for the checksum, is never sent.
    fn used_bytes(&self) -> usize {
        size_of::<Self>()
    }
    /// Writes its checksum, if it has one.
    fn seal(&mut self) {}
    /// Whether it is what was sent, as far as its checksum tells.
    fn is_whole(&self) -> bool {
        true
    }
    /// Whether it does not contradict itself; what does was never sent so.
    fn is_sound(&self) -> bool {
        true
    }
}

macro_rules! samples {
    ($($type:ident: $scan:ident $([$checksum:ident])? $(of $used:expr)? $(, if $sound:expr)?);* $(;)?) => {$(
        impl Sample for $type {
            fn scan(&self) -> u64 {
                self.$scan
            }

            fn visible_from(&self) -> u64 {
                self.visible_from
            }

            $(fn used_bytes(&self) -> usize {
                let used: fn(&Self) -> usize = $used;
                used(self)
            })?

            $(fn seal(&mut self) {
                const { assert!(offset_of!($type, $checksum) + size_of::<u64>() == size_of::<$type>()) };
                self.$checksum = checksum::of(self, self.used_bytes());
            }

            fn is_whole(&self) -> bool {
                self.$checksum == checksum::of(self, self.used_bytes())
            })?

            $(fn is_sound(&self) -> bool {
                let is_sound: fn(&Self) -> bool = $sound;
                is_sound(self)
            })?
        }
    )*};
}
samples!(
    // It counts in its own scan.
    Feedback: scan [checksum] of |feedback| {
        offset_of!(Feedback, axes) + size_of_val(feedback.axes())
    }, if |feedback| {
        let counts = feedback.scan <= SCAN_MAX && feedback.scan == feedback.visible_from;
        let named = feedback.path_axes.min(PATH_AXES as u32);
        let axes = feedback.path_axes == named && named <= feedback.axis_count;
        counts && axes && feedback.axis_count as usize <= MAX_AXES
    };
    Instruments: scan of |instruments| {
        offset_of!(Instruments, axes) + size_of_val(instruments.axes())
    }, if |instruments| is_possible(instruments.scan, instruments.visible_from);
    BusCycle: scan of |cycle| {
        let inputs = cycle.inputs.get(..cycle.axis_count as usize);
        offset_of!(BusCycle, inputs) + size_of_val(inputs.unwrap_or(&cycle.inputs))
    }, if |cycle| is_possible(cycle.scan, cycle.visible_from);
    Signals: scan of |signals| {
        offset_of!(Signals, values) + size_of_val(signals.values())
    }, if |signals| {
        is_possible(signals.scan, signals.visible_from) && signals.count as usize <= SIGNALS_MAX
    };
    AxisCommand: scan [checksum] of |command| {
        let words = command.state.get(..command.state_words as usize);
        offset_of!(AxisCommand, state) + size_of_val(words.unwrap_or(&command.state))
    }, if |command| is_possible(command.scan, command.visible_from);
    LogicAnswer: scan [checksum] of |answer| {
        offset_of!(LogicAnswer, values) + size_of_val(answer.values())
    }, if |answer| {
        is_possible(answer.scan, answer.visible_from) && answer.count as usize <= SIGNALS_MAX
    };
    PlannerStatus: scan [checksum], if |status| is_possible(status.scan, status.visible_from);
    Roster: visible_from [checksum], if |roster| roster.visible_from <= SCAN_MAX;
);

/// Whether a cell can have come to these scans.
fn is_possible(scan: u64, visible_from: u64) -> bool {
    scan.max(visible_from) <= SCAN_MAX
}

/// A process's foot in the cell's shared memory.
#[derive(Debug)]
pub struct Bus {
    node: Node<ipc::Service>,
    place: CellPaths,
    /// A place that is taken may be free in a moment.
    patient: bool,
    /// The service table.
    pub services: Services,
}

impl Bus {
    /// Enters the cell as `who`; `cleaner` is true for the launcher alone.
    ///
    /// # Errors
    /// [`CellError::Transport`].
    pub fn enter(
        place: &CellPaths,
        shape: &Shape,
        who: &str,
        cleaner: bool,
    ) -> Result<Bus, CellError> {
        room::forget_refused();
        iceoryx2::prelude::set_log_level(iceoryx2::prelude::LogLevel::Error);
        let config = place.config(cleaner)?;
        let refuse = |what| refusal(place, what);
        let name = NodeName::new(who).map_err(|e| refuse(format!("node name {who:?}: {e:?}")))?;
        let node = NodeBuilder::new()
            .name(&name)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| refuse(format!("entering shared memory as {who}: {e:?}")))?;
        Ok(Bus {
            node,
            place: place.clone(),
            patient: false,
            services: Services::of(place, shape),
        })
    }

    /// For who takes part in the cell: a place that is taken is waited for, since it may be that of somebody who is dead, or of a
    /// foreign process that tries it.
    pub(crate) fn patient(self) -> Bus {
        Bus {
            patient: true,
            ..self
        }
    }

    pub(crate) fn refuse(&self, what: String) -> CellError {
        refusal(&self.place, what)
    }

    /// A port, with all the shared memory that it has asked for. It is made again for as long as its place, or room, may still
    /// become free: what a process leaves that has died goes once the launcher has cleaned up and its readers have let go.
    pub(crate) fn port<P, E: Debug>(
        &self,
        name: &str,
        is_taken: impl Fn(&E) -> bool,
        make: impl Fn() -> Result<P, E>,
    ) -> Result<P, CellError> {
        let started = Instant::now();
        let mut nobody_was_dead = false;
        loop {
            room::forget_refused();
            let made = make();
            let taken = made.as_ref().is_err_and(&is_taken);
            let made = made.map_err(|error| self.refuse(format!("{name}: {error:?}")));
            // A port that finds no room for its connections is there, and stays deaf.
            let shortage = room::shortage_of_thread(self.place.name());
            let made = made.and_then(|port| shortage.map_or(Ok(port), Err));
            let may_be_had = match &made {
                Ok(_) => false,
                Err(CellError::NoRoom { .. }) => self.patient,
                Err(_) if !taken || self.patient => taken,
                // Who was dead when the place was asked for may have been cleaned up since: only the second answer counts.
                Err(_) => self.somebody_is_dead() || !std::mem::replace(&mut nobody_was_dead, true),
            };
            if !may_be_had || started.elapsed() > PLACE_LIMIT {
                return made;
            }
            std::thread::sleep(PLACE_LOOK);
        }
    }

    /// Whether a process has died and its places are not free yet.
    fn somebody_is_dead(&self) -> bool {
        let mut found = false;
        let _ = Node::<ipc::Service>::list(self.node.config(), |state| {
            found |= matches!(state, NodeState::Dead(_));
            CallbackProgression::Continue
        });
        found
    }

    fn service_name(&self, name: &str) -> Result<ServiceName, CellError> {
        ServiceName::new(name).map_err(|e| self.refuse(format!("service name {name}: {e:?}")))
    }

    fn create<T: Sample>(&self, topic: &Topic) -> Result<PubSub<T>, CellError> {
        self.node
            .service_builder(&self.service_name(&topic.name)?)
            .publish_subscribe::<T>()
            .enable_safe_overflow(true)
            .max_publishers(1)
            .max_subscribers(topic.readers)
            .max_nodes(topic.readers + NODES_SLACK)
            .subscriber_max_buffer_size(topic.depth)
            .subscriber_max_borrowed_samples(BORROWED_MAX)
            .history_size(topic.history)
            .create()
            .map_err(|e| self.refuse(format!("creating {}: {e:?}", topic.name)))
    }

    pub(crate) fn open<T: Sample>(&self, topic: &Topic) -> Result<PubSub<T>, CellError> {
        self.node
            .service_builder(&self.service_name(&topic.name)?)
            .publish_subscribe::<T>()
            .open()
            .map_err(|e| self.refuse(format!("opening {}: {e:?}", topic.name)))
    }

    pub(crate) fn open_windows(&self) -> Result<Windows, CellError> {
        let topic = &self.services.setpoint;
        self.node
            .service_builder(&self.service_name(&topic.name)?)
            .publish_subscribe::<[Setpoint]>()
            .user_header::<WindowHeader>()
            .open()
            .map_err(|e| self.refuse(format!("opening {}: {e:?}", topic.name)))
    }

    pub(crate) fn open_operator(&self) -> Result<Operator, CellError> {
        let name = self.services.operator.clone();
        self.node
            .service_builder(&self.service_name(&name)?)
            .request_response::<OperatorRequest, OperatorResponse>()
            .open()
            .map_err(|e| self.refuse(format!("opening {name}: {e:?}")))
    }

    /// Creates every service of the table; for the launcher, which keeps the result as long as the cell lives.
    ///
    /// # Errors
    /// [`CellError::Transport`].
    pub fn create_all(&self) -> Result<Created, CellError> {
        let services = &self.services;
        let setpoint = self
            .node
            .service_builder(&self.service_name(&services.setpoint.name)?)
            .publish_subscribe::<[Setpoint]>()
            .user_header::<WindowHeader>()
            .enable_safe_overflow(true)
            .max_publishers(1)
            .max_subscribers(services.setpoint.readers)
            .max_nodes(services.setpoint.readers + NODES_SLACK)
            .subscriber_max_buffer_size(services.setpoint.depth)
            .subscriber_max_borrowed_samples(BORROWED_MAX)
            .history_size(services.setpoint.history)
            .create()
            .map_err(|e| self.refuse(format!("creating {}: {e:?}", services.setpoint.name)))?;
        let operator = self
            .node
            .service_builder(&self.service_name(&services.operator)?)
            .request_response::<OperatorRequest, OperatorResponse>()
            .enable_safe_overflow_for_requests(true)
            .max_servers(1)
            .max_clients(VIEWERS_MAX)
            .max_nodes(services.setpoint.readers + NODES_SLACK)
            .create()
            .map_err(|e| self.refuse(format!("creating {}: {e:?}", services.operator)))?;
        let commands = services
            .commands
            .iter()
            .flatten()
            .map(|topic| self.create(topic))
            .collect::<Result<_, _>>()?;
        let created = Created {
            _feedback: self.create(&services.feedback)?,
            _instruments: self.create(&services.instruments)?,
            _bus_cycle: services
                .bus_cycle
                .as_ref()
                .map(|topic| self.create(topic))
                .transpose()?,
            _signals: services
                .signals
                .as_ref()
                .map(|topic| self.create(topic))
                .transpose()?,
            _logic: services
                .logic
                .as_ref()
                .map(|topic| self.create(topic))
                .transpose()?,
            _planner: self.create(&services.planner)?,
            _roster: self.create(&services.roster)?,
            _setpoint: setpoint,
            _commands: commands,
            _operator: operator,
        };
        self.place.close_to_others()?;
        Ok(created)
    }

    /// Cleans up after dead processes; for the launcher alone, after it has reaped them.
    ///
    /// Segments that a process was killed over before they had a size go first, and as long as the cleaning lasts: iceoryx2
    /// 0.10 waits for their size without end.
    pub fn clean_dead(&self) {
        self.place.remove_unfinished();
        let (done, is_done) = mpsc::channel::<()>();
        std::thread::scope(|scope| {
            let thread = std::thread::Builder::new().name("qd-cleaner".into());
            let watching = thread.spawn_scoped(scope, move || {
                while is_done.recv_timeout(UNFINISHED_LOOK) == Err(RecvTimeoutError::Timeout) {
                    self.place.remove_unfinished();
                }
            });
            if let Err(error) = watching {
                tracing::warn!(%error, "dead processes are cleaned up after without a watch");
            }
            for _ in 0..CLEANINGS_MAX {
                let state = self.node.try_cleanup_dead_nodes();
                tracing::debug!(?state, "dead nodes cleaned");
                if state.failed_cleanups == 0 {
                    break;
                }
                std::thread::sleep(Duration::from_millis(1));
            }
            drop(done);
        });
    }
}

/// The error for what iceoryx2 refuses, where it is not for want of room.
fn refusal(place: &CellPaths, what: String) -> CellError {
    room::shortage(place.name()).unwrap_or_else(|| CellError::Transport {
        cell: place.name().into(),
        what,
    })
}

/// The services, held open by the launcher.
#[derive(Debug)]
pub struct Created {
    _feedback: PubSub<Feedback>,
    _instruments: PubSub<Instruments>,
    _bus_cycle: Option<PubSub<BusCycle>>,
    _signals: Option<PubSub<Signals>>,
    _logic: Option<PubSub<LogicAnswer>>,
    _planner: PubSub<PlannerStatus>,
    _roster: PubSub<Roster>,
    _setpoint: Windows,
    _commands: Vec<PubSub<AxisCommand>>,
    _operator: Operator,
}

/// Setpoints for which the planner's segment has room.
pub(crate) const WINDOW_SETPOINTS: usize = MAX_WINDOW_SETPOINTS;

#[cfg(test)]
mod tests;

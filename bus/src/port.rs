//! Ports: the ends of services, with the scan's rules built in.
//!
//! A [`Reader`] in scan k sets aside whatever is visible only later, so no controller ever uses a peer's output of the
//! same scan. A [`Writer`] overwrites the oldest sample of a slow reader and never blocks. What iceoryx2 refuses while
//! running is counted and otherwise a sample that is not there: the reader's age rules decide what follows.

use bytemuck::{bytes_of, bytes_of_mut};
use iceoryx2::active_request::ActiveRequest;
use iceoryx2::port::client::Client;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::server::Server;
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{AllocationStrategy, BackpressureStrategy};
use iceoryx2::service::ipc;
use iceoryx2::service::port_factory::server::ServerCreateError;

use crate::cell::CellError;
use crate::sample::{
    AxisCommand, BusCycle, Feedback, Instruments, LogicAnswer, OperatorRequest, OperatorResponse,
    PlannerStatus, Roster, Setpoint, Signals, WindowHeader,
};
use crate::service::{Bus, PubSub, RECORDER_DEPTH_SCANS, ROLES, Sample, Topic, WINDOW_SETPOINTS};

/// A reader lags behind the writers by its own queue of feedbacks at most: no sample is visible later than so many scans after the
/// one a recorder is at.
const HORIZON_SCANS: u64 = RECORDER_DEPTH_SCANS as u64 + 1;

/// When a sample that is visible from one scan on may be acted on by a reader in another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Visibility {
    /// In the reader's scan.
    Now,
    /// In a later one, at most the reader's horizon ahead: it waits, and all behind it.
    Later,
    /// Later than any sample can be: it is nonsense, and must not keep those behind it waiting.
    Never,
}

impl Visibility {
    /// Of a sample visible from `visible_from` on, for a reader in `scan` that looks `horizon_scans` ahead.
    pub fn of(visible_from: u64, scan: u64, horizon_scans: u64) -> Visibility {
        if visible_from <= scan {
            Visibility::Now
        } else if visible_from - scan <= horizon_scans {
            Visibility::Later
        } else {
            Visibility::Never
        }
    }
}

/// How old the newest sample of a reader is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Age {
    /// There has been none.
    Never,
    /// Of this scan.
    Fresh,
    /// Older.
    Stale {
        /// By how many scans.
        age_scans: u64,
    },
}

impl std::fmt::Display for Age {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Age::Never => f.write_str("never answered"),
            Age::Fresh => f.write_str("answered in this scan"),
            Age::Stale { age_scans } => write!(f, "last answered {age_scans} scans ago"),
        }
    }
}

impl Age {
    /// Age in scan `now` of a sample of scan `sample`, `None` for none. A sample of the future counts as fresh: its
    /// reader refuses it by its number.
    pub fn of(sample: Option<u64>, now: u64) -> Age {
        match sample {
            None => Age::Never,
            Some(scan) if scan >= now => Age::Fresh,
            Some(scan) => Age::Stale {
                age_scans: now - scan,
            },
        }
    }
}

/// Every service has one writer: it may be one that is dead.
fn has_writer(error: &PublisherCreateError) -> bool {
    *error == PublisherCreateError::ExceedsMaxSupportedPublishers
}

fn has_all_readers(error: &SubscriberCreateError) -> bool {
    *error == SubscriberCreateError::ExceedsMaxSupportedSubscribers
}

/// The writing end of a service.
#[derive(Debug)]
pub struct Writer<T: Sample> {
    publisher: Publisher<ipc::Service, T, ()>,
    failed: u64,
}

impl<T: Sample> Writer<T> {
    fn new(bus: &Bus, factory: &PubSub<T>, topic: &Topic) -> Result<Self, CellError> {
        let most = topic.samples_max();
        let publisher = bus.port(&format!("writing {}", topic.name), has_writer, || {
            factory
                .publisher_builder()
                .max_loaned_samples(2)
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .override_sample_preallocation(move |all| all.min(most))
                .create()
        })?;
        Ok(Writer {
            publisher,
            failed: 0,
        })
    }

    /// Seals and sends one sample; what cannot be sent is counted in [`Writer::failed`].
    pub fn send(&mut self, sample: &T) {
        let bytes = bytes_of(sample);
        let sent = self.publisher.loan_uninit().map(|loan| {
            // SAFETY: it is a place in shared memory, which always has bytes, and any bytes are a sample.
            let mut loan = unsafe { loan.assume_init() };
            let place = loan.payload_mut();
            // What the sample that was here before had beyond it is to be zero again.
            let used = sample.used_bytes().max(place.used_bytes());
            for (to, from) in bytes_of_mut(place).iter_mut().zip(bytes).take(used) {
                *to = *from;
            }
            place.seal();
            loan.send().is_ok()
        });
        if !matches!(sent, Ok(true)) {
            self.failed += 1;
        }
    }

    /// Hands its history to readers that have come since the last sample; without it they get it with the next one.
    pub fn connect_readers(&self) {
        let _ = self.publisher.update_connections();
    }

    /// Samples that could not be sent.
    pub fn failed(&self) -> u64 {
        self.failed
    }
}

/// A sample where its writer put it: it stays as it is while somebody holds it.
pub type Held<T> = iceoryx2::sample::Sample<ipc::Service, T, ()>;

/// The reading end of a service.
#[derive(Debug)]
pub struct Reader<T: Sample> {
    subscriber: Subscriber<ipc::Service, T, ()>,
    set_aside: Option<Held<T>>,
    newest_scan: Option<u64>,
    horizon_scans: u64,
    failed: u64,
}

impl<T: Sample> Reader<T> {
    fn new(bus: &Bus, topic: &Topic, depth: usize) -> Result<Self, CellError> {
        let factory = bus.open::<T>(topic)?;
        let subscriber = bus.port(&format!("reading {}", topic.name), has_all_readers, || {
            factory
                .subscriber_builder()
                .buffer_size(depth.min(topic.depth))
                .create()
        })?;
        Ok(Reader {
            subscriber,
            set_aside: None,
            newest_scan: None,
            horizon_scans: HORIZON_SCANS,
            failed: 0,
        })
    }

    /// For a reader that lags behind the writers by less than a recorder may: so many scans ahead a sample may be visible.
    pub fn with_horizon(self, horizon_scans: u64) -> Reader<T> {
        Reader {
            horizon_scans,
            ..self
        }
    }

    /// How old the newest sample handed out is in scan `now`.
    pub fn age(&self, now: u64) -> Age {
        Age::of(self.newest_scan, now)
    }

    fn receive(&mut self) -> Option<Held<T>> {
        if let Some(sample) = self.set_aside.take() {
            return Some(sample);
        }
        loop {
            match self.subscriber.receive() {
                Ok(Some(sample)) if sample.is_whole() && sample.is_sound() => {
                    return Some(sample);
                }
                Ok(None) => return None,
                Ok(Some(_)) => self.failed += 1,
                Err(_) => {
                    self.failed += 1;
                    return None;
                }
            }
        }
    }

    /// The next sample in order that may be acted on in `scan`.
    pub fn next(&mut self, scan: u64) -> Option<T> {
        self.next_held(scan).map(|sample| *sample)
    }

    /// The same without a copy, to be let go before the next. One that is visible later than any can be is dropped and counted in
    /// [`Reader::failed`].
    pub fn next_held(&mut self, scan: u64) -> Option<Held<T>> {
        loop {
            let sample = self.receive()?;
            match Visibility::of(sample.visible_from(), scan, self.horizon_scans) {
                Visibility::Now => {
                    self.newest_scan = Some(sample.scan());
                    return Some(sample);
                }
                Visibility::Later => {
                    self.set_aside = Some(sample);
                    return None;
                }
                Visibility::Never => self.failed += 1,
            }
        }
    }

    /// The newest sample that may be acted on in `scan`; older ones are dropped.
    pub fn newest(&mut self, scan: u64) -> Option<T> {
        self.newest_held(scan).map(|sample| *sample)
    }

    /// The same without a copy, to be let go before the next.
    pub fn newest_held(&mut self, scan: u64) -> Option<Held<T>> {
        let mut newest = None;
        while let Some(sample) = self.next_held(scan) {
            newest = Some(sample);
        }
        newest
    }

    /// The next sample in order, whatever its scan: for recorders and observers, and for the feedback itself.
    pub fn any(&mut self) -> Option<T> {
        self.receive().map(|sample| *sample)
    }

    /// Receptions that iceoryx2 refused, samples that are not what was sent (by their checksum), contradict themselves, or could
    /// never have become visible.
    pub fn failed(&self) -> u64 {
        self.failed
    }
}

/// The planner's end of the setpoint service.
#[derive(Debug)]
pub struct WindowWriter {
    publisher: Publisher<ipc::Service, [Setpoint], WindowHeader>,
}

impl WindowWriter {
    /// Sends a window; false if it could not be sent.
    pub fn send(&mut self, header: &WindowHeader, setpoints: &[Setpoint]) -> bool {
        match self.publisher.loan_slice_uninit(setpoints.len()) {
            Ok(mut loan) => {
                *loan.user_header_mut() = *header;
                loan.write_from_slice(setpoints).send().is_ok()
            }
            Err(_) => false,
        }
    }
}

/// A reading end of the setpoint service.
#[derive(Debug)]
pub struct WindowReader {
    subscriber: Subscriber<ipc::Service, [Setpoint], WindowHeader>,
    set_aside: Option<iceoryx2::sample::Sample<ipc::Service, [Setpoint], WindowHeader>>,
    horizon_scans: u64,
}

impl WindowReader {
    /// As [`Reader::with_horizon`].
    pub fn with_horizon(self, horizon_scans: u64) -> WindowReader {
        WindowReader {
            horizon_scans,
            ..self
        }
    }

    /// Hands each window that may be acted on in `scan` to `take`, in order. One that is visible later than any can be is
    /// dropped.
    pub fn each(&mut self, scan: u64, mut take: impl FnMut(&WindowHeader, &[Setpoint])) {
        loop {
            let sample = match self.set_aside.take() {
                Some(sample) => sample,
                None => match self.subscriber.receive() {
                    Ok(Some(sample)) => sample,
                    _ => return,
                },
            };
            let visible_from = sample.user_header().visible_from;
            match Visibility::of(visible_from, scan, self.horizon_scans) {
                Visibility::Now => take(sample.user_header(), sample.payload()),
                Visibility::Later => {
                    self.set_aside = Some(sample);
                    return;
                }
                Visibility::Never => {}
            }
        }
    }
}

/// An operator's end of the operator service.
#[derive(Debug)]
pub struct OperatorClient {
    client: Client<ipc::Service, OperatorRequest, (), OperatorResponse, ()>,
}

/// An order on its way.
#[derive(Debug)]
pub struct PendingOrder {
    pending: iceoryx2::pending_response::PendingResponse<
        ipc::Service,
        OperatorRequest,
        (),
        OperatorResponse,
        (),
    >,
}

impl PendingOrder {
    /// The answer, once it is there.
    pub fn answer(&self) -> Option<OperatorResponse> {
        match self.pending.receive() {
            Ok(Some(response)) => Some(*response.payload()),
            _ => None,
        }
    }

    /// Whether there was a master to send it to.
    pub fn is_sent(&self) -> bool {
        self.pending.number_of_server_connections() > 0
    }

    /// Whether nobody answers any more: it has been answered, or the master that had it is dead. To be asked before the answer.
    pub fn is_closed(&self) -> bool {
        !self.pending.is_connected()
    }
}

impl OperatorClient {
    /// Sends an order; `None` if it could not be sent.
    pub fn send(&self, request: OperatorRequest) -> Option<PendingOrder> {
        self.client
            .send_copy(request)
            .ok()
            .map(|pending| PendingOrder { pending })
    }
}

/// The master's end of the operator service.
#[derive(Debug)]
pub struct OperatorServer {
    server: Server<ipc::Service, OperatorRequest, (), OperatorResponse, ()>,
}

impl OperatorServer {
    /// Takes the next order, judges it with `judge` and answers; false if there was none.
    pub fn serve(&self, judge: impl FnOnce(&OperatorRequest) -> OperatorResponse) -> bool {
        let request: ActiveRequest<ipc::Service, OperatorRequest, (), OperatorResponse, ()> =
            match self.server.receive() {
                Ok(Some(request)) => request,
                _ => return false,
            };
        let response = judge(request.payload());
        let _ = request.send_copy(response);
        true
    }
}

macro_rules! ports {
    ($($writer:ident $reader:ident $field:ident $type:ty),*) => {$(
        #[doc = concat!("The writing end of `", stringify!($field), "`.")]
        ///
        /// # Errors
        /// [`CellError::Transport`], also if there is a writer already.
        pub fn $writer(&self) -> Result<Writer<$type>, CellError> {
            let topic = &self.services.$field;
            Writer::new(self, &self.open(topic)?, topic)
        }

        #[doc = concat!("A reading end of `", stringify!($field), "` that holds `depth` samples.")]
        ///
        /// # Errors
        /// [`CellError::Transport`].
        pub fn $reader(&self, depth: usize) -> Result<Reader<$type>, CellError> {
            Reader::new(self, &self.services.$field, depth)
        }
    )*};
}

macro_rules! optional_ports {
    ($($writer:ident $reader:ident $field:ident $type:ty, $none:literal);*) => {$(
        #[doc = concat!("The writing end of `", stringify!($field), "`; none ", $none, ".")]
        ///
        /// # Errors
        /// [`CellError::Transport`], also if there is a writer already.
        pub fn $writer(&self) -> Result<Option<Writer<$type>>, CellError> {
            let topic = self.services.$field.as_ref();
            topic
                .map(|topic| Writer::new(self, &self.open(topic)?, topic))
                .transpose()
        }

        #[doc = concat!("A reading end of `", stringify!($field), "` that holds `depth` samples; none ", $none, ".")]
        ///
        /// # Errors
        /// [`CellError::Transport`].
        pub fn $reader(&self, depth: usize) -> Result<Option<Reader<$type>>, CellError> {
            let topic = self.services.$field.as_ref();
            topic
                .map(|topic| Reader::new(self, topic, depth))
                .transpose()
        }
    )*};
}

impl Bus {
    ports!(
        feedback_writer feedback_reader feedback Feedback,
        instruments_writer instruments_reader instruments Instruments,
        planner_writer planner_reader planner PlannerStatus,
        roster_writer roster_reader roster Roster
    );

    optional_ports!(
        bus_cycle_writer bus_cycle_reader bus_cycle BusCycle, "where drives are simulated";
        signals_writer signals_reader signals Signals, "where the machine names no input or output";
        logic_writer logic_reader logic LogicAnswer, "where the machine has no logic of its own"
    );

    fn command_topic(&self, axis: usize, role: usize) -> Result<&Topic, CellError> {
        self.services
            .commands
            .get(axis)
            .and_then(|roles| roles.get(role))
            .ok_or_else(|| self.refuse(format!("axis {axis} role {role}: there is no such servo")))
    }

    /// The writing end of one servo's commands.
    ///
    /// # Errors
    /// [`CellError::Transport`], also if there is a writer already.
    pub fn command_writer(
        &self,
        axis: usize,
        role: usize,
    ) -> Result<Writer<AxisCommand>, CellError> {
        let topic = self.command_topic(axis, role)?;
        Writer::new(self, &self.open(topic)?, topic)
    }

    /// A reading end of one servo's commands.
    ///
    /// # Errors
    /// [`CellError::Transport`].
    pub fn command_reader(
        &self,
        axis: usize,
        role: usize,
        depth: usize,
    ) -> Result<Reader<AxisCommand>, CellError> {
        Reader::new(self, self.command_topic(axis, role)?, depth)
    }

    /// Those of all servos, by axis and role.
    ///
    /// # Errors
    /// [`CellError::Transport`].
    pub fn command_readers(
        &self,
        depth: usize,
    ) -> Result<Vec<[Reader<AxisCommand>; ROLES.len()]>, CellError> {
        let of = |axis, role| self.command_reader(axis, role, depth);
        let axes = 0..self.services.commands.len();
        axes.map(|axis| Ok([of(axis, 0)?, of(axis, 1)?])).collect()
    }

    /// The writing end of the setpoint service.
    ///
    /// # Errors
    /// [`CellError::Transport`], also if there is a writer already.
    pub fn window_writer(&self) -> Result<WindowWriter, CellError> {
        let topic = &self.services.setpoint;
        let most = topic.windows_max();
        let factory = self.open_windows()?;
        let publisher = self.port(&format!("writing {}", topic.name), has_writer, || {
            factory
                .publisher_builder()
                .initial_max_slice_len(WINDOW_SETPOINTS)
                .allocation_strategy(AllocationStrategy::Static)
                .max_loaned_samples(2)
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .override_sample_preallocation(move |all| all.min(most))
                .create()
        })?;
        Ok(WindowWriter { publisher })
    }

    /// A reading end of the setpoint service.
    ///
    /// # Errors
    /// [`CellError::Transport`].
    pub fn window_reader(&self, depth: usize) -> Result<WindowReader, CellError> {
        let topic = &self.services.setpoint;
        let factory = self.open_windows()?;
        let subscriber = self.port(&format!("reading {}", topic.name), has_all_readers, || {
            factory
                .subscriber_builder()
                .buffer_size(depth.min(topic.depth))
                .create()
        })?;
        Ok(WindowReader {
            subscriber,
            set_aside: None,
            horizon_scans: HORIZON_SCANS,
        })
    }

    /// An operator's end of the operator service.
    ///
    /// # Errors
    /// [`CellError::Transport`].
    pub fn operator_client(&self) -> Result<OperatorClient, CellError> {
        let factory = self.open_operator()?;
        let name = format!("asking at {}", self.services.operator);
        // Who waits for a place here does so in its own way.
        let client = self.port(&name, |_| false, || factory.client_builder().create())?;
        Ok(OperatorClient { client })
    }

    /// The master's end of the operator service.
    ///
    /// # Errors
    /// [`CellError::Transport`].
    pub fn operator_server(&self) -> Result<OperatorServer, CellError> {
        let factory = self.open_operator()?;
        let name = format!("serving {}", self.services.operator);
        let is_taken =
            |error: &ServerCreateError| *error == ServerCreateError::ExceedsMaxSupportedServers;
        let server = self.port(&name, is_taken, || factory.server_builder().create())?;
        Ok(OperatorServer { server })
    }
}

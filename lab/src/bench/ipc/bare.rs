//! The bytes of the samples through iceoryx2 as it is: no checksum, no word on when a sample is visible. The one file beside `bus` that
//! names it.

use std::fmt::Debug;

use anyhow::anyhow;
use bus::cell::CellPaths;
use bus::sample::{AxisCommand, Feedback};
use bus::service::{SCAN_DEPTH, Sample as _};
use bytemuck::Zeroable;
use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{ServiceName, SignalHandlingMode, ZeroCopySend};
use iceoryx2::service::ipc;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

/// Bytes of a feedback of so many axes, and of a command without a servo's state: what a cell sends in most scans.
fn used(axes: usize) -> (usize, usize) {
    let feedback = Feedback {
        axis_count: axes as u32,
        ..Feedback::zeroed()
    };
    (feedback.used_bytes(), AxisCommand::zeroed().used_bytes())
}

/// Sends these bytes, at the beginning of a place for all.
fn send<const N: usize>(out: &Publisher<ipc::Service, [u8; N], ()>, bytes: &[u8]) {
    if let Ok(loan) = out.loan_uninit() {
        // SAFETY: it is a place in shared memory, which always has bytes.
        let mut loan = unsafe { loan.assume_init() };
        let place = loan.payload_mut().get_mut(..bytes.len());
        place.unwrap_or_default().copy_from_slice(bytes);
        let _ = loan.send();
    }
}

/// Copies what was sent, as much as fits.
fn take(into: &mut [u8], sent: &[u8]) {
    for (to, from) in into.iter_mut().zip(sent) {
        *to = *from;
    }
    std::hint::black_box(into);
}

type FeedbackBytes = [u8; size_of::<Feedback>()];
type CommandBytes = [u8; size_of::<AxisCommand>()];
type Service<T> = PortFactory<ipc::Service, T, ()>;

fn failed(error: impl Debug) -> anyhow::Error {
    anyhow!("iceoryx2: {error:?}")
}

fn enter(place: &CellPaths) -> anyhow::Result<Node<ipc::Service>> {
    let node = NodeBuilder::new()
        .config(&place.config(false)?)
        .signal_handling_mode(SignalHandlingMode::Disabled);
    node.create::<ipc::Service>().map_err(failed)
}

/// A service of the game; the first process that comes makes it.
fn service<T: ZeroCopySend + Debug + Sized>(
    node: &Node<ipc::Service>,
    place: &CellPaths,
    name: &str,
    readers: usize,
) -> anyhow::Result<Service<T>> {
    let name = ServiceName::new(&format!("{}/{name}", place.name())).map_err(failed)?;
    let builder = node.service_builder(&name).publish_subscribe::<T>();
    builder
        .enable_safe_overflow(true)
        .max_publishers(1)
        .max_subscribers(readers)
        .max_nodes(readers + 2)
        .subscriber_max_buffer_size(SCAN_DEPTH)
        .subscriber_max_borrowed_samples(2)
        .history_size(0)
        .open_or_create()
        .map_err(failed)
}

fn feedback_of(
    node: &Node<ipc::Service>,
    place: &CellPaths,
    axes: usize,
) -> anyhow::Result<Service<FeedbackBytes>> {
    service(node, place, "bare/feedback", axes)
}

fn command_of(
    node: &Node<ipc::Service>,
    place: &CellPaths,
    axis: usize,
) -> anyhow::Result<Service<CommandBytes>> {
    service(node, place, &format!("bare/command/{axis}"), 1)
}

/// The master's ports.
pub(super) struct BareMaster {
    _node: Node<ipc::Service>,
    feedback: Vec<u8>,
    command: Vec<u8>,
    out: Publisher<ipc::Service, FeedbackBytes, ()>,
    commands: Vec<Subscriber<ipc::Service, CommandBytes, ()>>,
}

impl BareMaster {
    pub fn open(place: &CellPaths, axes: usize) -> anyhow::Result<BareMaster> {
        let node = enter(place)?;
        let feedback = feedback_of(&node, place, axes)?;
        let out = feedback.publisher_builder().max_loaned_samples(2);
        let commands = (0..axes).map(|axis| {
            let service = command_of(&node, place, axis)?;
            service.subscriber_builder().create().map_err(failed)
        });
        Ok(BareMaster {
            commands: commands.collect::<anyhow::Result<_>>()?,
            out: out.create().map_err(failed)?,
            feedback: vec![0; used(axes).0],
            command: vec![0; used(axes).1],
            _node: node,
        })
    }

    pub fn send(&mut self, scan: u32) {
        if let Some(bytes) = self.feedback.first_chunk_mut() {
            *bytes = scan.to_ne_bytes();
        }
        send(&self.out, &self.feedback);
    }

    /// Whether each has sent something.
    pub fn receive(&mut self) -> bool {
        self.commands.iter().all(|commands| {
            let command = commands.receive().ok().flatten();
            command.is_some_and(|command| {
                take(&mut self.command, &*command);
                true
            })
        })
    }
}

/// A servo's ports.
pub(super) struct BareServo {
    _node: Node<ipc::Service>,
    feedback: Subscriber<ipc::Service, FeedbackBytes, ()>,
    taken: Vec<u8>,
    command: Vec<u8>,
    out: Publisher<ipc::Service, CommandBytes, ()>,
}

impl BareServo {
    pub fn open(place: &CellPaths, axes: usize, axis: usize) -> anyhow::Result<BareServo> {
        let node = enter(place)?;
        let feedback = feedback_of(&node, place, axes)?;
        let command = command_of(&node, place, axis)?;
        let out = command.publisher_builder().max_loaned_samples(2);
        Ok(BareServo {
            feedback: feedback.subscriber_builder().create().map_err(failed)?,
            out: out.create().map_err(failed)?,
            taken: vec![0; used(axes).0],
            command: vec![0; used(axes).1],
            _node: node,
        })
    }

    /// Answers a feedback, if there is one.
    pub fn answer(&mut self) {
        let Ok(Some(feedback)) = self.feedback.receive() else {
            return;
        };
        take(&mut self.taken, &*feedback);
        if let (Some(to), Some(from)) = (
            self.command.first_chunk_mut::<4>(),
            self.taken.first_chunk::<4>(),
        ) {
            *to = *from;
        }
        send(&self.out, &self.command);
    }
}

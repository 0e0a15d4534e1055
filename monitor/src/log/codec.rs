//! A sample as the bytes of a message, and back: the same for the log and for the black box.
//!
//! What is in a message is not trusted: it is checked against the layout of its type before it becomes a sample.

use bus::sample::{
    AxisCommand, BusCycle, Feedback, Instruments, MAX_WINDOW_SETPOINTS, PlannerStatus, Roster,
    Setpoint, Signals, WindowHeader,
};
use bytemuck::{CheckedBitPattern, Pod, Zeroable};
use machine::LogLevel;

use super::layout::{Extent, Layout, Wire};
use super::run_info::Event;
use super::sample::{LoggedWindow, Sample, SampleRef};

/// What a message begins with: CDR, little-endian (XCDR1, OMG DDSI-RTPS 2.5 §10.2).
pub const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// Fields that only a log of whole samples has: a servo's own memory, and what says that a sample in shared memory is whole.
const WHOLE_ONLY: [&str; 6] = [
    "checksum",
    "motion_digest_high",
    "motion_digest_low",
    "reserved",
    "state",
    "state_words",
];

/// What a message carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, CheckedBitPattern)]
#[repr(u8)]
pub enum Content {
    /// What the master published.
    Feedback,
    /// What the bench's instruments saw.
    Instruments,
    /// What a servo asked for.
    Command,
    /// What the planner published.
    Window,
    /// How the planner stood.
    Planner,
    /// Who took part.
    Roster,
    /// What happened to the process group.
    Event,
    /// What the fieldbus did.
    BusCycle,
    /// What named inputs and outputs showed.
    Signals,
}

impl Content {
    /// What a topic carries; none if nobody here reads it.
    pub fn of_topic(topic: &str) -> Option<Content> {
        Some(match topic {
            "/feedback" => Content::Feedback,
            "/instruments" => Content::Instruments,
            "/bus_cycle" => Content::BusCycle,
            "/signals" => Content::Signals,
            "/window" => Content::Window,
            "/planner" => Content::Planner,
            "/roster" => Content::Roster,
            "/event" => Content::Event,
            _ if topic.starts_with("/command/") => Content::Command,
            _ => return None,
        })
    }

    pub(crate) fn of(sample: &SampleRef<'_>) -> Content {
        match sample {
            SampleRef::Feedback(_) => Content::Feedback,
            SampleRef::Instruments(_) => Content::Instruments,
            SampleRef::BusCycle(_) => Content::BusCycle,
            SampleRef::Signals(_) => Content::Signals,
            SampleRef::Command(..) => Content::Command,
            SampleRef::Window(..) => Content::Window,
            SampleRef::Planner(_) => Content::Planner,
            SampleRef::Roster(_) => Content::Roster,
            SampleRef::Event(_) => Content::Event,
        }
    }
}

/// The layouts of all samples of one machine.
pub(crate) struct Codec {
    /// Whether samples are whole.
    pub(crate) is_whole: bool,
    pub(crate) feedback: Layout,
    pub(crate) instruments: Layout,
    pub(crate) bus_cycle: Layout,
    pub(crate) signals: Layout,
    pub(crate) command: Layout,
    pub(crate) planner: Layout,
    pub(crate) roster: Layout,
    pub(crate) header: Layout,
    pub(crate) setpoint: Layout,
}

impl Codec {
    /// What stands before the setpoints of a window, its header excepted, in bytes.
    pub(crate) const WINDOW_HEAD_BYTES: usize = 8 + 4 + 4;

    /// Of whole samples.
    pub(crate) fn of(extent: &Extent) -> Codec {
        Self::of_level(extent, LogLevel::Full)
    }

    /// Of samples as a log of this level has them.
    pub(crate) fn of_level(extent: &Extent, level: LogLevel) -> Codec {
        let left_out: &[&str] = match level {
            LogLevel::Full => &[],
            _ => &WHOLE_ONLY,
        };
        Codec {
            is_whole: left_out.is_empty(),
            feedback: Layout::without::<Feedback>(extent, left_out),
            instruments: Layout::without::<Instruments>(extent, left_out),
            bus_cycle: Layout::without::<BusCycle>(extent, left_out),
            signals: Layout::without::<Signals>(extent, left_out),
            command: Layout::without::<AxisCommand>(extent, left_out),
            planner: Layout::without::<PlannerStatus>(extent, left_out),
            roster: Layout::of::<Roster>(extent),
            header: Layout::of::<WindowHeader>(extent),
            setpoint: Layout::of::<Setpoint>(extent),
        }
    }

    /// Layout of a sample that comes scan by scan, and is written in columns; none of what has a message each.
    pub(crate) fn of_scans(&self, content: Content) -> Option<&Layout> {
        Some(match content {
            Content::Feedback => &self.feedback,
            Content::Instruments => &self.instruments,
            Content::BusCycle => &self.bus_cycle,
            Content::Signals => &self.signals,
            Content::Command => &self.command,
            Content::Planner => &self.planner,
            Content::Window | Content::Roster | Content::Event => return None,
        })
    }

    /// Appends the body of a message. An event's strings are aligned to the message's first byte, which must be there.
    pub(crate) fn encode(&self, sample: SampleRef<'_>, message: &mut Vec<u8>) {
        match sample {
            SampleRef::Feedback(s) => self.feedback.encode(bytemuck::bytes_of(s), message),
            SampleRef::Instruments(s) => self.instruments.encode(bytemuck::bytes_of(s), message),
            SampleRef::BusCycle(s) => self.bus_cycle.encode(bytemuck::bytes_of(s), message),
            SampleRef::Signals(s) => self.signals.encode(bytemuck::bytes_of(s), message),
            SampleRef::Command(_, s) => self.command.encode(bytemuck::bytes_of(s), message),
            SampleRef::Planner(s) => self.planner.encode(bytemuck::bytes_of(s), message),
            SampleRef::Roster(s) => self.roster.encode(bytemuck::bytes_of(s), message),
            SampleRef::Event(event) => {
                message.extend_from_slice(&event.scan.to_le_bytes());
                put_string(message, &event.process);
                put_string(message, &event.text);
            }
            SampleRef::Window(header, intended, tail_checksum) => {
                self.header.encode(bytemuck::bytes_of(header), message);
                message.extend_from_slice(&tail_checksum.to_le_bytes());
                message.extend_from_slice(&(intended.len() as u32).to_le_bytes());
                if !intended.is_empty() {
                    message.extend_from_slice(&[0; 4]);
                }
                for setpoint in intended {
                    self.setpoint.encode(bytemuck::bytes_of(setpoint), message);
                }
            }
        }
    }

    /// The sample in the body of a message; none if it does not fit.
    pub(crate) fn decode(&self, content: Content, body: &[u8]) -> Option<Sample> {
        Some(match content {
            Content::Feedback => Sample::Feedback(Box::new(pod(&self.feedback, body)?)),
            Content::Instruments => Sample::Instruments(Box::new(pod(&self.instruments, body)?)),
            Content::BusCycle => Sample::BusCycle(Box::new(pod(&self.bus_cycle, body)?)),
            Content::Signals => Sample::Signals(Box::new(pod(&self.signals, body)?)),
            Content::Command => Sample::Command(Box::new(pod(&self.command, body)?)),
            Content::Planner => Sample::Planner(pod(&self.planner, body)?),
            Content::Roster => Sample::Roster(Box::new(pod(&self.roster, body)?)),
            Content::Window => Sample::Window(self.window(body)?),
            Content::Event => Sample::Event(event(body)?),
        })
    }

    fn window(&self, body: &[u8]) -> Option<LoggedWindow> {
        let (header, rest) = body.split_at_checked(self.header.bytes)?;
        let (checksum, rest) = rest.split_first_chunk::<8>()?;
        let (count, rest) = rest.split_first_chunk::<4>()?;
        let count = u32::from_le_bytes(*count) as usize;
        if count > MAX_WINDOW_SETPOINTS {
            return None;
        }
        let setpoints = if count == 0 {
            rest
        } else {
            rest.strip_prefix(&[0; 4])?
        };
        if setpoints.len() != count * self.setpoint.bytes {
            return None;
        }
        Some(LoggedWindow {
            header: pod(&self.header, header)?,
            tail_checksum: u64::from_le_bytes(*checksum),
            setpoints: setpoints
                .chunks_exact(self.setpoint.bytes)
                .map(|setpoint| pod(&self.setpoint, setpoint))
                .collect::<Option<Vec<Setpoint>>>()?,
        })
    }
}

fn pod<T: Pod + Zeroable + Wire>(layout: &Layout, body: &[u8]) -> Option<T> {
    let mut sample = T::zeroed();
    layout
        .decode(body, bytemuck::bytes_of_mut(&mut sample))
        .then_some(sample)
}

/// A CDR string: length with the closing zero, bytes, zero, after padding to four bytes.
fn put_string(message: &mut Vec<u8>, text: &str) {
    let start = ENCAPSULATION.len();
    message.resize(start + (message.len() - start).next_multiple_of(4), 0);
    message.extend_from_slice(&(text.len() as u32 + 1).to_le_bytes());
    message.extend_from_slice(text.as_bytes());
    message.push(0);
}

fn event(body: &[u8]) -> Option<Event> {
    let (scan, _) = body.split_first_chunk::<8>()?;
    let (process, next) = string(body, 8)?;
    let (text, _) = string(body, next)?;
    Some(Event {
        scan: u64::from_le_bytes(*scan),
        process,
        text,
    })
}

/// The CDR string at or after `at`, and where it ends.
fn string(body: &[u8], at: usize) -> Option<(String, usize)> {
    let at = at.next_multiple_of(4);
    let length = u32::from_le_bytes(*body.get(at..)?.first_chunk::<4>()?) as usize;
    let bytes = body.get(at + 4..(at + 4).checked_add(length)?)?;
    let text = bytes.strip_suffix(&[0])?;
    Some((String::from_utf8(text.to_vec()).ok()?, at + 4 + length))
}

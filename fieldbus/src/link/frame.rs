//! The frame of a cycle (ETG.1000.4): a tag, the process data of all slaves in one logical read and write, the AL status of each, and
//! the reference clock.
//!
//! The tag is a datagram without a command (NOP), which slaves pass on as it is. It says which frame of which start-up it is, so that an
//! answer that comes late, twice or from others is never taken for that of this frame; and which of the master's cycles it carries, so
//! that a standby sees what was sent before the sender died.

use bus::drive_page::{Inputs, SLAVES_MAX, SlaveState, Wiring};

use super::socket::{ETHERTYPE, Socket};

/// Our source address: locally administered only once the first slave has marked the frame.
const SOURCE: [u8; 6] = [0x10, 0x51, 0x44, 0x00, 0x00, 0x01];
const ETHERNET_BYTES: usize = 14;
const FRAME_HEADER_BYTES: usize = 2;
const DATAGRAM_HEADER_BYTES: usize = 10;
const COUNTER_BYTES: usize = 2;
/// The shortest Ethernet frame, without its checksum.
const FRAME_BYTES_MIN: usize = 60;

const TAG_BYTES: usize = 24;
/// AL status, a reserved word, AL status code.
const STATUS_BYTES: usize = 6;
const CLOCK_BYTES: usize = 8;
/// Register of the AL control.
const AL_CONTROL: u16 = 0x0120;
/// Register of the AL status; its code is four bytes behind it.
pub(crate) const AL_STATUS: u16 = 0x0130;
/// AL state of a slave that nobody drives.
pub(crate) const INIT: u16 = 0x01;
/// AL state of a slave that takes outputs.
pub(crate) const OPERATIONAL: u16 = 0x08;
/// Register of the system time.
const SYSTEM_TIME: u16 = 0x0910;

/// Commands of datagrams.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Command {
    /// Nothing.
    Nop = 0,
    /// Read of a station address.
    Fprd = 4,
    /// Write to a station address.
    Fpwr = 5,
    /// Logical read and write.
    Lrw = 12,
    /// Read of one station, write to all others.
    Frmw = 14,
}

/// What a received frame is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Received {
    /// The answer of the cycle; the time of the reference clock, in ns, if there is one.
    Answer {
        /// Time of the reference clock, in ns.
        clock_ns: Option<u64>,
    },
    /// An earlier cycle of this start-up.
    Late,
    /// Not ours, or damaged.
    Foreign,
}

/// Which frame of a start-up one is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tag {
    /// Its number: every frame has another, a later one a higher.
    pub frame: u64,
    /// The master's cycle whose outputs it carries.
    pub cycle: u64,
}

/// Frame and places of its datagrams.
#[derive(Debug, Clone)]
pub struct CycleFrame {
    bytes: Vec<u8>,
    nonce: u64,
    tag_at: usize,
    image_at: usize,
    image_bytes: usize,
    slaves_at: [usize; SLAVES_MAX],
    slave_count: usize,
    clock_at: Option<usize>,
}

/// Appends a datagram; where its data begin.
fn append(frame: &mut Vec<u8>, command: Command, address: u32, data_bytes: usize) -> usize {
    frame.push(command as u8);
    frame.push(0);
    frame.extend(address.to_le_bytes());
    // That more datagrams follow is added when one does.
    frame.extend((data_bytes as u16).to_le_bytes());
    frame.extend([0; 2]);
    let at = frame.len();
    frame.resize(at + data_bytes + COUNTER_BYTES, 0);
    at
}

fn station(address: u16, register: u16) -> u32 {
    u32::from(address) | u32::from(register) << 16
}

impl CycleFrame {
    /// For a segment that is wired so.
    pub fn new(wiring: &Wiring) -> CycleFrame {
        let mut bytes = vec![0xFF; 6];
        bytes.extend(SOURCE);
        bytes.extend(ETHERTYPE.to_be_bytes());
        bytes.extend([0; FRAME_HEADER_BYTES]);
        let mut data_at = Vec::new();
        let tag_at = append(&mut bytes, Command::Nop, 0, TAG_BYTES);
        let image_bytes = wiring.image_bytes as usize;
        let image_at = append(&mut bytes, Command::Lrw, 0, image_bytes);
        data_at.extend([tag_at, image_at]);
        let mut slaves_at = [0; SLAVES_MAX];
        for (at, slave) in slaves_at.iter_mut().zip(wiring.slaves()) {
            let address = station(slave.address, AL_STATUS);
            *at = append(&mut bytes, Command::Fprd, address, STATUS_BYTES);
            data_at.push(*at);
        }
        let clock_at = (wiring.reference_clock != 0).then(|| {
            let address = station(wiring.reference_clock as u16, SYSTEM_TIME);
            append(&mut bytes, Command::Frmw, address, CLOCK_BYTES)
        });
        data_at.extend(clock_at);
        // All but the last are followed by another.
        data_at.pop();
        for at in data_at {
            if let Some(high) = bytes.get_mut(at - 3) {
                *high |= 0x80;
            }
        }
        let datagrams = bytes.len() - ETHERNET_BYTES - FRAME_HEADER_BYTES;
        let header = (datagrams as u16 & 0x07FF | 0x1000).to_le_bytes();
        put(&mut bytes, ETHERNET_BYTES, &header);
        let padded = bytes.len().max(FRAME_BYTES_MIN);
        bytes.resize(padded, 0);
        CycleFrame {
            bytes,
            nonce: wiring.nonce,
            tag_at,
            image_at,
            image_bytes,
            slaves_at,
            slave_count: wiring.slaves().len(),
            clock_at,
        }
    }

    /// The frame of this number, which carries the outputs of a cycle. The reference clock passes its time on; it is not told one.
    pub fn fill(&mut self, tag: Tag, image: &[u8]) -> &[u8] {
        let (tag_at, image_at, image_bytes) = (self.tag_at, self.image_at, self.image_bytes);
        put(&mut self.bytes, tag_at, &self.nonce.to_le_bytes());
        put(&mut self.bytes, tag_at + 8, &tag.frame.to_le_bytes());
        put(&mut self.bytes, tag_at + 16, &tag.cycle.to_le_bytes());
        let image = image.get(..image_bytes).unwrap_or(image);
        put(&mut self.bytes, image_at, image);
        &self.bytes
    }

    /// Takes what came; what it says goes into `inputs` if it is the answer to the frame of this number.
    pub fn take(&self, frame: &[u8], number: u64, inputs: &mut Inputs) -> Received {
        let head = ETHERNET_BYTES + FRAME_HEADER_BYTES;
        let same_head = |from: usize, to: usize| frame.get(from..to) == self.bytes.get(from..to);
        // The first slave marks the source address.
        let ours = frame.len() >= self.bytes.len()
            && same_head(ETHERNET_BYTES - 2, head)
            && self.same_datagrams(frame)
            && word(frame, self.tag_at) == Some(self.nonce);
        if !ours {
            return Received::Foreign;
        }
        match word(frame, self.tag_at + 8) {
            Some(of) if of == number => {}
            Some(of) if of < number => return Received::Late,
            _ => return Received::Foreign,
        }
        let image = frame.get(self.image_at..self.image_at + self.image_bytes);
        if let (Some(image), Some(to)) = (image, inputs.image.get_mut(..self.image_bytes)) {
            to.copy_from_slice(image);
        }
        let counter = short(frame, self.image_at + self.image_bytes);
        inputs.working_counter = counter.into();
        let slaves = self.slaves_at.iter().take(self.slave_count);
        for (slave, at) in inputs.slaves.iter_mut().zip(slaves) {
            *slave = SlaveState {
                answered: u16::from(short(frame, at + STATUS_BYTES) == 1),
                al_status: short(frame, *at),
                al_status_code: short(frame, at + 4),
            };
        }
        inputs.answered = 1;
        Received::Answer {
            clock_ns: self.clock_at.and_then(|at| word(frame, at)),
        }
    }

    /// The tag of a frame of this start-up, sent or answered.
    pub fn tag_of(&self, frame: &[u8]) -> Option<Tag> {
        if word(frame, self.tag_at) != Some(self.nonce) {
            return None;
        }
        Some(Tag {
            frame: word(frame, self.tag_at + 8)?,
            cycle: word(frame, self.tag_at + 16)?,
        })
    }

    /// Whether the frame has the datagrams that were sent: commands, addresses and lengths.
    fn same_datagrams(&self, frame: &[u8]) -> bool {
        let clock = self.clock_at.iter().copied();
        let slaves = self.slaves_at.iter().copied().take(self.slave_count);
        let mut all = [self.tag_at, self.image_at]
            .into_iter()
            .chain(slaves)
            .chain(clock);
        all.all(|at| {
            let header = at - DATAGRAM_HEADER_BYTES..at;
            match (frame.get(header.clone()), self.bytes.get(header)) {
                // The circulating bit and the interrupt word are the slaves'.
                (Some(found), Some(sent)) => {
                    let same =
                        |range: std::ops::Range<usize>| found.get(range.clone()) == sent.get(range);
                    let circulates = |bytes: &[u8]| bytes.get(7).map(|high| high & !0x40);
                    same(0..7) && circulates(found) == circulates(sent)
                }
                _ => false,
            }
        })
    }
}

/// A frame that writes two bytes to a register of a station.
fn write_register(address: u16, register: u16, value: u16) -> Vec<u8> {
    let mut bytes = vec![0xFF; 6];
    bytes.extend(SOURCE);
    bytes.extend(ETHERTYPE.to_be_bytes());
    bytes.extend([0; FRAME_HEADER_BYTES]);
    let at = append(&mut bytes, Command::Fpwr, station(address, register), 2);
    put(&mut bytes, at, &value.to_le_bytes());
    let datagrams = bytes.len() - ETHERNET_BYTES - FRAME_HEADER_BYTES;
    put(
        &mut bytes,
        ETHERNET_BYTES,
        &(datagrams as u16 & 0x07FF | 0x1000).to_le_bytes(),
    );
    bytes.resize(FRAME_BYTES_MIN, 0);
    bytes
}

/// Asks a slave for another AL state; whether it takes it shows in its status.
pub fn request_state(socket: &Socket, address: u16, state: u16) {
    let _ = socket.send(&write_register(address, AL_CONTROL, state));
}

fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
    if let Some(slot) = bytes.get_mut(at..at + value.len()) {
        slot.copy_from_slice(value);
    }
}

fn word(bytes: &[u8], at: usize) -> Option<u64> {
    let bytes = bytes.get(at..at + 8)?;
    Some(u64::from_le_bytes(bytes.try_into().ok()?))
}

fn short(bytes: &[u8], at: usize) -> u16 {
    let bytes = bytes
        .get(at..at + 2)
        .and_then(|bytes| bytes.try_into().ok());
    bytes.map_or(0, u16::from_le_bytes)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::indexing_slicing)]
mod tests {
    use bus::drive_page::SlaveWiring;
    use bytemuck::Zeroable;
    use proptest::prelude::*;

    use super::*;

    fn wiring() -> Wiring {
        let mut wiring = Wiring::zeroed();
        wiring.nonce = 0x1122_3344_5566_7788;
        wiring.image_bytes = 12;
        wiring.slave_count = 2;
        wiring.working_counter = 6;
        wiring.reference_clock = 0x1001;
        for (index, slave) in wiring.slaves.iter_mut().take(2).enumerate() {
            *slave = SlaveWiring {
                serial: 0,
                restarted: 0,
                address: 0x1001 + index as u16,
                outputs_at: 6 + 3 * index as u16,
                output_bytes: 3,
                inputs_at: 3 * index as u16,
                input_bytes: 3,
                working_counter: 3,
            };
        }
        wiring
    }

    fn answer(frame: &mut CycleFrame, number: u64) -> Vec<u8> {
        let tag = Tag {
            frame: number,
            cycle: 5,
        };
        let mut bytes = frame.fill(tag, &[7; 12]).to_vec();
        bytes[6] |= 2;
        bytes
    }

    #[test]
    fn a_frame_comes_back_as_inputs() {
        let mut frame = CycleFrame::new(&wiring());
        let mut bytes = answer(&mut frame, 41);
        bytes[frame.image_at] = 99;
        put(&mut bytes, frame.image_at + 12, &6_u16.to_le_bytes());
        let at = frame.slaves_at[1];
        put(&mut bytes, at, &[0x14, 0, 0, 0, 0x1B, 0, 1, 0]);
        put(&mut bytes, frame.clock_at.unwrap(), &77_u64.to_le_bytes());
        let mut inputs = Inputs::zeroed();
        let clock_ns = Some(77);
        assert_eq!(
            frame.take(&bytes, 41, &mut inputs),
            Received::Answer { clock_ns }
        );
        assert_eq!((inputs.answered, inputs.working_counter), (1, 6));
        assert_eq!(inputs.image[..2], [99, 7]);
        let lost = SlaveState {
            answered: 1,
            al_status: 0x14,
            al_status_code: 0x1B,
        };
        assert_eq!(inputs.slaves[..2], [SlaveState::default(), lost]);
    }

    #[test]
    fn an_earlier_cycle_is_late_and_another_start_up_is_foreign() {
        let mut frame = CycleFrame::new(&wiring());
        let bytes = answer(&mut frame, 41);
        let mut inputs = Inputs::zeroed();
        assert_eq!(frame.take(&bytes, 42, &mut inputs), Received::Late);
        assert_eq!(frame.take(&bytes, 40, &mut inputs), Received::Foreign);
        let other = CycleFrame::new(&Wiring {
            nonce: 1,
            ..wiring()
        });
        assert_eq!(other.take(&bytes, 41, &mut inputs), Received::Foreign);
        assert_eq!(inputs, Inputs::zeroed());
    }

    proptest! {
        #[test]
        fn no_damage_to_a_frame_is_taken_for_an_answer_of_another_shape(
            at in 0_usize..200, value: u8, length in 0_usize..200
        ) {
            let mut frame = CycleFrame::new(&wiring());
            let mut bytes = answer(&mut frame, 41);
            if let Some(byte) = bytes.get_mut(at) {
                *byte = value;
            }
            bytes.truncate(length.max(1));
            let mut inputs = Inputs::zeroed();
            let received = frame.take(&bytes, 41, &mut inputs);
            if bytes.len() < frame.bytes.len() {
                prop_assert_eq!(received, Received::Foreign);
            }
        }
    }
}

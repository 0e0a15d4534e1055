//! Where the process data of each slave lie: read from the slaves themselves.

use std::ops::Deref;

use bus::drive_page::{IMAGE_BYTES_MAX, SlaveWiring, Wiring};
use bytemuck::Zeroable;
use ethercrab::{SubDevice, SubDeviceRef};

use super::driver::Driver;
use super::error::StartUpError;
use super::objects::words;
use super::{FileWords, SegmentPlan};
use crate::process_data;

/// First register of the first FMMU, and how many a slave can have.
const FMMU: u16 = 0x0600;
const FMMU_BYTES: u16 = 16;
const FMMUS_MAX: u16 = 8;
/// Register that says how many it has.
const FMMU_COUNT: u16 = 0x0004;

/// Where bytes of one direction lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Place {
    at: u32,
    bytes: u32,
}

impl Place {
    fn add(&mut self, at: u32, bytes: u32) {
        if self.bytes == 0 {
            *self = Place { at, bytes };
        } else {
            let end = (self.at + self.bytes).max(at + bytes);
            self.at = self.at.min(at);
            self.bytes = end - self.at;
        }
    }
}

/// Reads the wiring of slaves in SAFE-OP and compares it with the drive files.
pub(super) fn read_wiring<'a, S: Deref<Target = SubDevice>>(
    driver: &mut Driver<'_>,
    slaves: impl Iterator<Item = SubDeviceRef<'a, S>>,
    plan: &SegmentPlan,
    reference_clock: u16,
) -> Result<Wiring, StartUpError> {
    let mut wiring = Wiring::zeroed();
    wiring.nonce = nonce();
    wiring.reference_clock = reference_clock.into();
    let mut end = 0;
    for ((place, slave), entry) in slaves.enumerate().zip(&mut wiring.slaves) {
        let step = "reading where its process data lie";
        let (outputs, inputs) = places(driver, &slave)
            .map_err(|error| StartUpError::at(&plan.name(place), step, &words(error)))?;
        judge_sizes(plan, place, outputs.bytes, inputs.bytes)?;
        let counter = 2 * u16::from(outputs.bytes > 0) + u16::from(inputs.bytes > 0);
        *entry = SlaveWiring {
            address: slave.configured_address(),
            outputs_at: outputs.at as u16,
            output_bytes: outputs.bytes as u16,
            inputs_at: inputs.at as u16,
            input_bytes: inputs.bytes as u16,
            working_counter: counter,
            serial: slave.identity().serial,
            restarted: 0,
        };
        wiring.working_counter += u32::from(counter);
        wiring.slave_count += 1;
        end = end
            .max(outputs.at + outputs.bytes)
            .max(inputs.at + inputs.bytes);
    }
    if end as usize > IMAGE_BYTES_MAX {
        let what = format!(
            "{end} bytes do not fit into one frame, {IMAGE_BYTES_MAX} do: exchange less with the drives"
        );
        let step = "mapping process data";
        return Err(StartUpError::at(&plan.bus.interface, step, &what));
    }
    wiring.image_bytes = end;
    Ok(wiring)
}

/// Where a slave's FMMUs put its outputs and its inputs.
fn places<S: Deref<Target = SubDevice>>(
    driver: &mut Driver<'_>,
    slave: &SubDeviceRef<'_, S>,
) -> Result<(Place, Place), ethercrab::error::Error> {
    let (mut outputs, mut inputs) = (Place::default(), Place::default());
    let count = driver.run(slave.register_read::<u8>(FMMU_COUNT))?;
    for index in 0..u16::from(count).min(FMMUS_MAX) {
        let at = FMMU + FMMU_BYTES * index;
        let fmmu = driver.run(slave.register_read::<[u8; 16]>(at))?;
        let logical = u32::from_le_bytes([fmmu[0], fmmu[1], fmmu[2], fmmu[3]]);
        let bytes = u16::from_le_bytes([fmmu[4], fmmu[5]]);
        if fmmu[12] & 1 == 0 || bytes == 0 {
            continue;
        }
        if fmmu[11] & 1 != 0 {
            inputs.add(logical, bytes.into());
        }
        if fmmu[11] & 2 != 0 {
            outputs.add(logical, bytes.into());
        }
    }
    Ok((outputs, inputs))
}

/// A device exchanges as many bytes as its file says.
fn judge_sizes(
    plan: &SegmentPlan,
    place: usize,
    outputs: u32,
    inputs: u32,
) -> Result<(), StartUpError> {
    let Some((_, _, FileWords { device, .. })) =
        plan.described().find(|(slave, ..)| *slave == place)
    else {
        return Ok(());
    };
    let of_drive = plan.drives_at(place).next();
    let of_drive = of_drive.map(|setup| &setup.device);
    let of_drive = of_drive.map(|data| (&data.receive, &data.transmit));
    let of_terminal = plan
        .terminal_at(place)
        .map(|setup| &setup.terminal.process_data);
    let of_terminal = of_terminal.map(|data| (&data.receive, &data.transmit));
    let Some((receive, transmit)) = of_drive.or(of_terminal) else {
        return Ok(());
    };
    let wanted = (process_data::bytes(receive), process_data::bytes(transmit));
    if wanted == (outputs, inputs) {
        return Ok(());
    }
    let what = format!(
        "it takes {outputs} bytes and sends {inputs}, its {device} file says {} and {}: make the {device} file of the ESI file of this {device}",
        wanted.0, wanted.1
    );
    let step = "comparing its process data";
    Err(StartUpError::at(&plan.name(place), step, &what))
}

/// A number that no other start-up on this PC has.
fn nonce() -> u64 {
    bus::realtime::now_ns() ^ u64::from(std::process::id()) << 44
}

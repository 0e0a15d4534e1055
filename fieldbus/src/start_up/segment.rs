//! The whole start-up.

use std::rc::Rc;
use std::time::Duration;

use bus::drive_page::{IMAGE_BYTES_MAX, SLAVES_MAX, Wiring};
use bus::realtime::now_ns;
use ethercrab::{MainDevice, SubDeviceGroup, SubDeviceIdentity};
use machine::Sync;

use super::clocks::set_clocks;
use super::configure::configure;
use super::driver::{Driver, Storage, master, read_everywhere};
use super::error::StartUpError;
use super::objects::{Talk, words};
use super::operational::into_operation;
use super::wiring::read_wiring;
use super::{FileWords, SegmentPlan};
use crate::drive_file::Identity;
use crate::link::Socket;

/// Register of the configured station address (ETG.1000.4).
const STATION_ADDRESS: u16 = 0x0010;
/// Frames that bring the clocks together before anything is configured.
const CLOCK_FRAMES: u32 = 2000;

/// Brings a segment from wherever it is to OP; nothing is enabled. How it is wired. Where the cell has started it up before, it was wired
/// like `before`. `note_restarted` takes which slaves were found restarted, and tells which were found so since the last start-up that
/// somebody has seen.
///
/// # Errors
/// [`StartUpError`].
pub fn start_up(
    socket: &Rc<Socket>,
    plan: &SegmentPlan,
    before: &Wiring,
    note_restarted: impl Fn(u64) -> u64,
) -> Result<Wiring, StartUpError> {
    let storage = Box::new(Storage::new());
    let of_drives = plan.drives.iter().map(|setup| setup.drive.mailbox);
    let terminals = plan.terminals.iter();
    let mailboxes = of_drives.chain(terminals.filter_map(|setup| setup.terminal.mailbox));
    let longest_ms = mailboxes.map(|of| of.request_timeout_ms.max(of.response_timeout_ms));
    let mailbox = Duration::from_millis(longest_ms.max().unwrap_or(2000).into());
    let dc = plan.bus.sync == Sync::Dc;
    let clock_frames = if dc { CLOCK_FRAMES } else { 0 };
    let interface = &plan.bus.interface;
    let of_segment = |step: &str, what: String| StartUpError::at(interface, step, &what);
    let (main, mut driver) = master(&storage, socket, mailbox, clock_frames)
        .ok_or_else(|| of_segment("starting", "its frames are in use".into()))?;
    let restarted =
        restarted(&main, &mut driver).map_err(|error| nobody_or(plan, &of_segment, error))?;
    let restarted = note_restarted(restarted);
    let group = find(plan, &main, &mut driver, &of_segment)?;
    let identities: Vec<(SubDeviceIdentity, String)> = group
        .iter(&main)
        .map(|slave| (slave.identity(), slave.name().to_string()))
        .collect();
    judge_slaves(plan, &identities)?;
    judge_serials(plan, &identities, before)?;
    for (place, slave) in group.iter(&main).enumerate() {
        let mut talk = Talk {
            driver: &mut driver,
            slave,
            name: plan.name(place),
        };
        configure(&mut talk, plan, place)?;
    }
    let into = |step: &'static str| move |error| of_segment(step, words(error));
    let reference_clock = match dc {
        true => set_clocks(&mut driver, plan, &main, &group)?,
        false => 0,
    };
    let group = driver
        .run(group.into_pre_op_pdi(&main))
        .map_err(into("mapping process data"))?;
    let group = driver
        .run(group.into_safe_op(&main))
        .map_err(into("going from PRE-OP to SAFE-OP"))?;
    let mut wiring = read_wiring(&mut driver, group.iter(&main), plan, reference_clock)?;
    for (place, slave) in wiring.slaves.iter_mut().enumerate() {
        slave.restarted = (restarted >> place & 1) as u32;
    }
    into_operation(socket, plan, &wiring)?;
    Ok(wiring)
}

/// Which slaves have no station address, a bit each in the order of the cable: a master gives them one, and they lose it with their power.
fn restarted(
    main: &MainDevice<'_>,
    driver: &mut Driver<'_>,
) -> Result<u64, ethercrab::error::Error> {
    let addresses = read_everywhere::<u16>(main, driver, STATION_ADDRESS)?;
    let places = (0..).zip(addresses);
    Ok(places.fold(0, |slaves, (place, address)| {
        slaves | u64::from(address == 0) << place
    }))
}

/// The slaves of a segment, in PRE-OP.
fn find(
    plan: &SegmentPlan,
    main: &MainDevice<'_>,
    driver: &mut Driver<'_>,
    of_segment: &dyn Fn(&str, String) -> StartUpError,
) -> Result<SubDeviceGroup<SLAVES_MAX, IMAGE_BYTES_MAX>, StartUpError> {
    let found = driver.run(main.init_single_group::<SLAVES_MAX, IMAGE_BYTES_MAX>(now_ns));
    let group = match found {
        Ok(group) => group,
        Err(ethercrab::error::Error::Capacity(_)) => {
            let what = format!(
                "more than {SLAVES_MAX} slaves answer: quadrant drives no more on one segment"
            );
            return Err(of_segment("looking for slaves", what));
        }
        Err(error) => return Err(nobody_or(plan, of_segment, error)),
    };
    if group.is_empty() {
        return Err(StartUpError::nobody(&plan.bus.interface));
    }
    Ok(group)
}

/// Nobody on the cable, or something else.
fn nobody_or(
    plan: &SegmentPlan,
    of_segment: &dyn Fn(&str, String) -> StartUpError,
    error: ethercrab::error::Error,
) -> StartUpError {
    use ethercrab::error::Error;
    match error {
        // The first frame of all did not come back.
        Error::Timeout(_) => StartUpError::nobody(&plan.bus.interface),
        Error::SendFrame => of_segment(
            "looking for slaves",
            "no frame can be sent: is the interface up?".into(),
        ),
        error => of_segment("bringing all slaves to PRE-OP", words(error)),
    }
}

/// Whether the slaves are those that the machine file names, in its order.
fn judge_slaves(
    plan: &SegmentPlan,
    found: &[(SubDeviceIdentity, String)],
) -> Result<(), StartUpError> {
    let (count, expected) = (found.len(), plan.slave_count());
    if count != expected {
        let names: Vec<String> = (0..expected).map(|place| plan.name(place)).collect();
        let remedy = if count < expected {
            "a cable is loose or a drive is off behind the last one that answers"
        } else {
            "name the others in [[bus.terminal]], or in `bus.other_slaves`"
        };
        return Err(StartUpError::others(format!(
            "{count} slaves on the cable, {expected} in the machine file ({}): {remedy}; `quadrant bus scan {}` lists them",
            names.join(", "),
            plan.bus.interface
        )));
    }
    let shown = |vendor: u32, product: u32, revision: u32, name: &str| {
        format!(
            "{name:?} (vendor {vendor:#010x}, product {product:#010x}, revision {revision:#010x})"
        )
    };
    for (slave, is, words) in plan.described() {
        let Some((there, name)) = found.get(slave) else {
            continue;
        };
        let same = (there.vendor_id, there.product_id) == (is.vendor, is.product_code);
        if same && there.revision == is.revision {
            continue;
        }
        // At its own place, or at one where a drive of this kind stands rightly, it is none that was taken for another.
        let elsewhere = (0..).zip(found).find(|(place, (other, _))| {
            let rightful = plan.described().find(|(slave, ..)| slave == place);
            is_of(other, is) && rightful.is_none_or(|(_, own, _)| !is_of(other, own))
        });
        let FileWords {
            device,
            table,
            command,
        } = words;
        let remedy = match elsewhere {
            Some((place, _)) if !same => format!(
                "such a {device} is at place {place}: connect them in the order of the machine file, or set `slave` in {table}"
            ),
            _ if same => format!(
                "make a {device} file of the ESI file of that revision (`{command} ESI --revision`)"
            ),
            _ => format!(
                "connect the {device} that the machine file names, or make a {device} file of this one"
            ),
        };
        return Err(StartUpError::others(format!(
            "{}: {} is there, its {device} file is of {}: {remedy}",
            plan.name(slave),
            shown(there.vendor_id, there.product_id, there.revision, name),
            shown(is.vendor, is.product_code, is.revision, &is.name)
        )));
    }
    Ok(())
}

/// Whether the slaves are those of the start-up before, place by place: drives of the same kind that have changed their places would drive
/// each other's axes.
fn judge_serials(
    plan: &SegmentPlan,
    found: &[(SubDeviceIdentity, String)],
    before: &Wiring,
) -> Result<(), StartUpError> {
    for (place, ((there, _), was)) in found.iter().zip(before.slaves()).enumerate() {
        if there.serial == was.serial || there.serial == 0 || was.serial == 0 {
            continue;
        }
        let mut places = (0..).zip(before.slaves());
        let from = places.find(|(_, slave)| slave.serial == there.serial);
        let remedy = match from {
            Some((from, _)) => format!(
                "it was at place {from} before: put the cables back as they were"
            ),
            None => "where it was exchanged, end the cell and begin anew (`quadrant down`, `quadrant up`)".into(),
        };
        return Err(StartUpError::others(format!(
            "{}: a device with serial number {} is there, before it was one with {}: {remedy}",
            plan.name(place),
            there.serial,
            was.serial
        )));
    }
    Ok(())
}

/// Whether a slave is the one of a file.
fn is_of(there: &SubDeviceIdentity, own: &Identity) -> bool {
    (there.vendor_id, there.product_id, there.revision)
        == (own.vendor, own.product_code, own.revision)
}

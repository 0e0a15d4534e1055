//! Devices of several axes: objects of an axis are 0x800 above the same objects of the axis before (ETG.6010).

use fieldbus::cia402;

use super::{Device, Pdo};

impl Device {
    /// How many axes it has, by their controlwords and profiles.
    pub fn axes(&self) -> u16 {
        let has = |axis: &u16| {
            let controlword = cia402::on_axis(cia402::CONTROLWORD, *axis);
            self.object(controlword, 0).is_some()
        };
        let by_objects = (0..machine::AXES_OF_DRIVE_MAX as u16).take_while(has);
        let of_drives = self.profiles.iter();
        let of_drives = of_drives.filter(|profile| **profile == cia402::PROFILE);
        by_objects.count().max(of_drives.count()).max(1) as u16
    }

    /// The device as one of its axes sees it, from 0: objects of others are gaps.
    pub fn of_axis(&self, axis: u16) -> Device {
        let mut seen = Device {
            dictionary: self.dictionary.moved(|index| cia402::seen_by(index, axis)),
            ..self.clone()
        };
        for pdos in [&mut seen.receive, &mut seen.transmit] {
            pdos.retain(|pdo| is_of(pdo, axis));
            for entry in pdos.iter_mut().flat_map(|pdo| &mut pdo.entries) {
                match cia402::seen_by(entry.index, axis) {
                    Some(index) => entry.index = index,
                    None => (entry.index, entry.sub) = (0, 0),
                }
            }
        }
        seen
    }
}

/// Whether a PDO is one of an axis: it holds an object of it, or none of any and the axis is the first.
fn is_of(pdo: &Pdo, axis: u16) -> bool {
    let entries = pdo.entries.iter();
    let mut axes = entries
        .filter_map(|entry| Some(cia402::of_axis(entry.index)?.0))
        .peekable();
    match axes.peek() {
        None => axis == 0,
        Some(_) => axes.any(|of| of == axis),
    }
}

//! Devices of several axes: each has its objects 0x800 above those of the one before (ETG.6010).

use fieldbus::cia402;

use super::{Device, Pdo};

impl Device {
    /// How many axes it has, by their controlwords and profiles.
    pub fn axes(&self) -> u16 {
        let has = |axis: &u16| {
            let controlword = cia402::on_axis(cia402::CONTROLWORD, *axis);
            self.object(controlword, 0).is_some()
        };
        let by_objects = (0..machine::AXES_OF_DRIVE_MAX as u16)
            .take_while(has)
            .count();
        let of_drives = self.profiles.iter();
        let of_drives = of_drives.filter(|profile| **profile == cia402::PROFILE);
        by_objects.max(of_drives.count()).max(1) as u16
    }

    /// It as one of its axes sees it, from 0: its objects have the numbers of the first axis, those of others are gaps.
    pub fn of_axis(&self, axis: u16) -> Device {
        let own = |index: u16| match cia402::of_axis(index) {
            None => Some(index),
            Some((of, index)) => (of == axis).then_some(index),
        };
        let mut seen = self.clone();
        for pdos in [&mut seen.receive, &mut seen.transmit] {
            pdos.retain(|pdo| is_of(pdo, axis));
            for entry in pdos.iter_mut().flat_map(|pdo| &mut pdo.entries) {
                if own(entry.index).is_none() {
                    entry.sub = 0;
                }
                entry.index = own(entry.index).unwrap_or(0);
            }
        }
        seen.dictionary = self.dictionary.moved(own);
        seen.variants = Vec::new();
        seen
    }
}

/// Whether a PDO is one of an axis: it holds something of it, or nothing of any and it is the first.
fn is_of(pdo: &Pdo, axis: u16) -> bool {
    let mut axes = pdo
        .entries
        .iter()
        .filter_map(|entry| cia402::of_axis(entry.index));
    let has_own = pdo.entries.iter().any(|entry| {
        let of = cia402::of_axis(entry.index);
        of.is_some_and(|(of, _)| of == axis)
    });
    has_own || axis == 0 && axes.next().is_none()
}

//! Which PDOs of a drive to exchange, and whether to write their entries.

use crate::{Device, Pdo as EsiPdo, PdoEntry, Purpose};
use fieldbus::cia402::{self, OperatingMode};
use fieldbus::drive_file::{Limits, Mapping};
use fieldbus::process_data::{self, Entry, Pdo};

/// Process data of one direction.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Side {
    /// What becomes of the entries.
    pub mapping: Mapping,
    /// The PDOs.
    pub pdos: Vec<Pdo>,
}

impl Side {
    /// Whether PDOs of another axis go with it: entries of our own do not share a PDO.
    pub fn takes(&self, other: &Side) -> bool {
        let is_there = |pdo: &Pdo| self.pdos.iter().any(|own| own.index == pdo.index);
        self.mapping == other.mapping
            && (self.mapping == Mapping::Fixed || !other.pdos.iter().any(is_there))
    }

    /// Takes the PDOs of another axis too; where one PDO is of both, its entries are.
    pub fn add(&mut self, other: Side, axis: u16) {
        for mut pdo in other.pdos {
            for entry in &mut pdo.entries {
                entry.index = cia402::on_axis(entry.index, axis);
            }
            match self.pdos.iter_mut().find(|own| own.index == pdo.index) {
                None => self.pdos.push(pdo),
                Some(own) => {
                    for (own, entry) in own.entries.iter_mut().zip(pdo.entries) {
                        if own.is_gap() {
                            *own = entry;
                        }
                    }
                }
            }
        }
    }
}

/// One direction of a device: what it offers, and what a mode wants of it.
struct Offer<'a> {
    device: &'a Device,
    receives: bool,
    needed: &'static [u16],
    wanted: &'static [u16],
}

/// What the drive can take, as far as its ESI file tells it; of the PDOs that are to be exchanged.
pub fn limits(device: &Device, receive: &Side, transmit: &Side) -> Limits {
    let entries = |side: &Side| {
        let pdos = side
            .pdos
            .iter()
            .filter(|_| side.mapping == Mapping::Written);
        pdos.filter_map(|pdo| entries_max(device, pdo.index)).min()
    };
    let bytes = |purpose| {
        let manager = device.sync_manager(purpose)?;
        manager.size_max.map(u32::from)
    };
    Limits {
        receive_entries: entries(receive),
        transmit_entries: entries(transmit),
        receive_pdos: entries_max(device, cia402::RECEIVE_ASSIGN),
        transmit_pdos: entries_max(device, cia402::TRANSMIT_ASSIGN),
        receive_bytes: bytes(Purpose::Outputs),
        transmit_bytes: bytes(Purpose::Inputs),
    }
}

/// Most entries of a mapping or an assignment: its highest sub-index.
pub fn entries_max(device: &Device, index: u16) -> Option<u32> {
    let highest = device.dictionary.highest_sub(index)?;
    (highest > 0).then_some(u32::from(highest))
}

/// Whether the entries of a PDO can be written.
pub fn can_be_written(device: &Device, pdo: &EsiPdo) -> bool {
    let configures = device.mailbox.is_some_and(|mailbox| mailbox.pdo_config);
    // Some files call a PDO free whose mapping object cannot be written.
    let mapping = device.dictionary.get(pdo.index, 1);
    let locked = mapping.and_then(|object| object.writable) == Some(false);
    configures && !pdo.fixed && !locked
}

/// Whether a PDO is exchanged from the factory, or can be chosen.
fn can_be_assigned(device: &Device, pdo: &EsiPdo) -> bool {
    pdo.sync_manager.is_some() || device.mailbox.is_some_and(|mailbox| mailbox.pdo_assign)
}

/// The process data for a mode, to the drive and from it; `None` where the drive cannot hold what the mode needs.
pub fn choose(device: &Device, mode: OperatingMode) -> Option<(Side, Side)> {
    choose_by(device, mode, |offer| offer.best())
}

/// The same of PDOs as the drive has them.
pub fn choose_fixed(device: &Device, mode: OperatingMode) -> Option<(Side, Side)> {
    choose_by(device, mode, |offer| offer.fixed())
}

fn choose_by(
    device: &Device,
    mode: OperatingMode,
    side: impl Fn(&Offer<'_>) -> Option<Side>,
) -> Option<(Side, Side)> {
    let receive = Offer {
        device,
        receives: true,
        needed: mode.receive_needed(),
        wanted: mode.receive_wanted(),
    };
    let transmit = Offer {
        device,
        receives: false,
        needed: mode.transmit_needed(),
        wanted: mode.transmit_wanted(),
    };
    Some((side(&receive)?, side(&transmit)?))
}

/// Its size in bits.
fn bits(pdo: &EsiPdo) -> u32 {
    let entries = pdo.entries.iter();
    entries.fold(0, |bits, entry| bits.saturating_add(entry.bits))
}

/// Whether a PDO has an object.
fn has(pdo: &EsiPdo, object: u16) -> bool {
    let mut entries = pdo.entries.iter();
    entries.any(|entry| (entry.index, entry.sub) == (object, 0))
}

/// Whether two PDOs can be exchanged side by side, without an object that is in both.
fn go_together(one: &EsiPdo, other: &EsiPdo) -> bool {
    let excluded = one.excludes.contains(&other.index) || other.excludes.contains(&one.index);
    let mut shared = one.entries.iter().filter(|entry| entry.index != 0);
    !excluded && !shared.any(|entry| has(other, entry.index))
}

impl Offer<'_> {
    fn pdos(&self) -> &[EsiPdo] {
        if self.receives {
            &self.device.receive
        } else {
            &self.device.transmit
        }
    }

    /// Entries of our own where the drive takes them, unless PDOs as they are hold more of what is wanted.
    fn best(&self) -> Option<Side> {
        match (self.written(), self.fixed()) {
            (Some(written), Some(fixed)) if self.held(&fixed.pdos) > self.held(&written.pdos) => {
                Some(fixed)
            }
            (Some(written), _) => Some(written),
            (None, fixed) => fixed,
        }
    }

    /// How many of the wanted objects are there.
    fn held(&self, pdos: &[Pdo]) -> usize {
        self.wanted.len() - process_data::missing(pdos, self.wanted).len()
    }

    /// PDOs as the drive has them: those from the factory, or the one that holds most and has the fewest bits.
    fn fixed(&self) -> Option<Side> {
        let from_factory = self.pdos().iter().filter(|pdo| pdo.sync_manager.is_some());
        let from_factory: Vec<Pdo> = from_factory.map(|pdo| self.as_it_is(pdo)).collect();
        let single = self
            .pdos()
            .iter()
            .filter(|pdo| can_be_assigned(self.device, pdo));
        let single = single.map(|pdo| vec![self.as_it_is(pdo)]);
        let candidates = [from_factory, self.combined()].into_iter().chain(single);
        let good = candidates.filter(|pdos| process_data::missing(pdos, self.needed).is_empty());
        let pdos = good.min_by_key(|pdos| {
            let lacking = self.wanted.len() - self.held(pdos);
            (lacking, process_data::bits(pdos))
        })?;
        Some(Side {
            mapping: Mapping::Fixed,
            pdos,
        })
    }

    /// Where PDOs can be chosen: those from the factory, and for each object that is lacking the smallest one that has it and goes with
    /// them.
    fn combined(&self) -> Vec<Pdo> {
        let mailbox = self.device.mailbox;
        if !mailbox.is_some_and(|mailbox| mailbox.pdo_assign) {
            return Vec::new();
        }
        let all = self.pdos().iter();
        let from_factory = all.clone().filter(|pdo| pdo.sync_manager.is_some());
        let mut chosen: Vec<&EsiPdo> = from_factory.collect();
        let assign = match self.receives {
            true => cia402::RECEIVE_ASSIGN,
            false => cia402::TRANSMIT_ASSIGN,
        };
        let most = entries_max(self.device, assign).unwrap_or(u32::MAX) as usize;
        for object in self.needed.iter().chain(self.wanted) {
            if chosen.len() >= most || chosen.iter().any(|pdo| has(pdo, *object)) {
                continue;
            }
            let fits = |pdo: &&EsiPdo| {
                has(pdo, *object) && chosen.iter().all(|other| go_together(pdo, other))
            };
            chosen.extend(all.clone().filter(fits).min_by_key(|pdo| bits(pdo)));
        }
        chosen.into_iter().map(|pdo| self.as_it_is(pdo)).collect()
    }

    fn as_it_is(&self, pdo: &EsiPdo) -> Pdo {
        let entries = pdo.entries.iter();
        Pdo {
            index: pdo.index,
            entries: entries.map(|entry| self.entry(entry)).collect(),
        }
    }

    /// An entry; one that limits the drive is sent as it comes from the factory.
    fn entry(&self, entry: &PdoEntry) -> Entry {
        let limits = self.receives && cia402::is_limit(entry.index);
        let default = self.device.dictionary.default_of(entry.index, entry.sub);
        Entry {
            value: default.filter(|_| limits).unwrap_or(0),
            ..Entry::of(entry.index, entry.sub, entry.bits)
        }
    }

    /// Entries of our own: what is needed, then what is wanted, as far as the drive has it and takes so many.
    fn written(&self) -> Option<Side> {
        let free = self.pdos().iter();
        let mut free = free
            .filter(|pdo| can_be_written(self.device, pdo) && can_be_assigned(self.device, pdo));
        let pdo = free.next()?;
        let most = entries_max(self.device, pdo.index).unwrap_or(u32::from(u8::MAX)) as usize;
        let manager = self.device.sync_manager(if self.receives {
            Purpose::Outputs
        } else {
            Purpose::Inputs
        });
        let bits_max = manager
            .and_then(|manager| manager.size_max)
            .map_or(u32::MAX, |size| u32::from(size) * 8);
        let mut entries: Vec<Entry> = Vec::new();
        let mut bits: u32 = 0;
        for (objects, must) in [(self.needed, true), (self.wanted, false)] {
            for index in objects {
                let takes = self.mappable(*index).filter(|size| {
                    entries.len() < most
                        && bits.checked_add(*size).is_some_and(|sum| sum <= bits_max)
                });
                match takes {
                    Some(size) => {
                        entries.push(Entry::of(*index, 0, size));
                        bits += size;
                    }
                    None if must => return None,
                    None => {}
                }
            }
        }
        if self.pads() && !bits.is_multiple_of(16) && entries.len() < most {
            entries.push(Entry::of(0, 0, 16 - bits % 16));
        }
        let index = pdo.index;
        Some(Side {
            mapping: Mapping::Written,
            pdos: vec![Pdo { index, entries }],
        })
    }

    /// The size of an object that may be mapped in this direction.
    fn mappable(&self, index: u16) -> Option<u32> {
        let object = self.device.object(index, 0)?;
        let may = if self.receives {
            object.receive
        } else {
            object.transmit
        };
        (may && object.bits > 0).then_some(object.bits)
    }

    /// Whether the vendor fills all of its PDOs up to whole words: then ours are as well.
    fn pads(&self) -> bool {
        let mut entries = self.pdos().iter().flat_map(|pdo| &pdo.entries);
        let mut pdos = self.pdos().iter();
        entries.any(|entry| entry.index == 0) && pdos.all(|pdo| bits(pdo).is_multiple_of(16))
    }
}

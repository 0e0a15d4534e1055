//! Modular devices: what one is with modules in its slots (ETG.2000, ETG.5001).

use std::collections::{BTreeMap, BTreeSet};

use fieldbus::cia402::CONFIGURED_MODULES;
use roxmltree::Node;

use super::device::{Wrong, pdo, profiles};
use super::number;
use super::xml::{at, child, children, flag_in, number_in, text};
use super::{Device, Dictionary, InitCommand, Pdo};

/// More slots of a drive are not filled: it has an axis in each.
const SLOTS_MAX: usize = machine::AXES_OF_DRIVE_MAX as usize;
/// Of so many modules for the first slot at most the drive is looked at with each.
const MODULES_MAX: usize = 16;
/// Objects that a slot moves begin here.
const OBJECTS: u16 = 0x6000;

/// The modules of an ESI file, by what their slots call them.
#[derive(Debug, Default)]
pub(super) struct Modules<'a>(BTreeMap<u32, Node<'a, 'a>>);

/// Distance between the same objects, or PDOs, of two neighbouring slots.
#[derive(Debug, Clone, Copy)]
struct Increments {
    pdos: u16,
    objects: u16,
}

/// A slot.
struct Slot {
    must_be_filled: bool,
    /// What may be in it, the default one first.
    idents: Vec<u32>,
}

impl<'a> Modules<'a> {
    /// Reads `Descriptions/Modules`.
    pub fn read(root: Node<'a, 'a>) -> Modules<'a> {
        let list = at(root, &["Descriptions", "Modules"]);
        let all = list.into_iter().flat_map(|list| children(list, "Module"));
        let all = all.filter_map(|module| {
            let ident = child(module, "Type").and_then(|of| number_in(of, "ModuleIdent"))?;
            Some((ident, module))
        });
        Modules(all.collect())
    }

    /// What a device can be: one for each module that its first slot takes, the default one first, the other slots filled likewise.
    ///
    /// # Errors
    /// The process data of a module cannot be understood.
    pub fn variants(&self, device: &Device, node: Node<'a, 'a>) -> Result<Vec<Device>, Wrong> {
        let Some(of_slots) = child(node, "Slots") else {
            return Ok(Vec::new());
        };
        let increments = Increments {
            pdos: number_in(of_slots, "SlotPdoIncrement").unwrap_or(0),
            objects: number_in(of_slots, "SlotIndexIncrement").unwrap_or(0),
        };
        let slots = children(of_slots, "Slot").take(SLOTS_MAX);
        let all: Vec<Slot> = slots.map(|slot| self.slot(slot)).collect();
        let must = all.iter().skip(1).take_while(|slot| slot.must_be_filled);
        let filled = 1 + must.count();
        let mut variants = Vec::new();
        // Those that may be empty are, then are filled as well.
        let mut counts = vec![filled, all.len()];
        counts.dedup();
        for slots in counts {
            let slots = all.get(..slots).unwrap_or(&all);
            for ident in slots.first().map_or(&[][..], |slot| &slot.idents) {
                let mut variant = Device {
                    modular: false,
                    ..device.clone()
                };
                for (place, slot) in (0..).zip(slots) {
                    let own = slot.idents.iter().find(|own| *own == ident);
                    if let Some(own) = own.or(slot.idents.first()) {
                        self.place(&mut variant, place, *own, increments)?;
                    }
                }
                variants.push(variant);
            }
        }
        Ok(variants)
    }

    fn slot(&self, node: Node<'a, 'a>) -> Slot {
        let known = children(node, "ModuleIdent").filter_map(|of| {
            let ident = number::narrow(text(of)).filter(|ident| self.0.contains_key(ident))?;
            Some((!flag_in(of, "Default"), ident))
        });
        let mut known: Vec<(bool, u32)> = known.collect();
        known.sort_by_key(|(other, _)| *other);
        let mut seen = BTreeSet::new();
        known.retain(|(_, ident)| seen.insert(*ident));
        known.truncate(MODULES_MAX);
        Slot {
            must_be_filled: number_in(node, "MinInstances") != Some(0_u32),
            idents: known.into_iter().map(|(_, ident)| ident).collect(),
        }
    }

    /// Puts a module into a slot, from 0.
    fn place(
        &self,
        device: &mut Device,
        slot: u16,
        ident: u32,
        increments: Increments,
    ) -> Result<(), Wrong> {
        let Some(module) = self.0.get(&ident) else {
            return Ok(());
        };
        let pdos = increments.pdos.saturating_mul(slot);
        let objects = increments.objects.saturating_mul(slot);
        let raised = |index: u16| match index {
            OBJECTS.. => index.saturating_add(objects),
            _ => index,
        };
        for (name, list) in [
            ("RxPdo", &mut device.receive),
            ("TxPdo", &mut device.transmit),
        ] {
            for read in children(*module, name).map(pdo) {
                let mut read: Pdo = read?;
                read.index = read.index.saturating_add(pdos);
                for entry in &mut read.entries {
                    entry.index = raised(entry.index);
                }
                list.push(read);
            }
        }
        if let Some(profile) = child(*module, "Profile") {
            let news = profiles(profile);
            let news = news.into_iter().filter(|of| !device.profiles.contains(of));
            device.profiles.extend(news.collect::<Vec<_>>());
            if let Some(dictionary) = child(profile, "Dictionary").map(Dictionary::read) {
                device.dictionary.add_all(dictionary.moved(|index| {
                    Some(match index {
                        0x1600..0x1C00 => index.saturating_add(pdos),
                        index => raised(index),
                    })
                }));
            }
        }
        if device.dictionary.highest_sub(CONFIGURED_MODULES).is_some() {
            device.init_commands.push(InitCommand {
                index: CONFIGURED_MODULES,
                sub: slot as u8 + 1,
                bits: 32,
                value: ident.into(),
                comment: "module in its slot".into(),
            });
        }
        Ok(())
    }
}

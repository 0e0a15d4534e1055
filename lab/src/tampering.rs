//! Samples that are damaged behind their sender's back, after their checksum was computed; or by somebody who computes another one.
//!
//! A reader drops the first kind, as it drops what contradicts itself. The second kind it believes: of feedback and roster alone,
//! whose senders the fault scripts do not make lie.

use std::sync::OnceLock;

use bus::layout::{Leaf, leaves};
use bus::sample::{AxisCommand, Feedback, PlannerStatus, Roster};
use bus::service::Sample;
use plant_sim::script::faults::Spoil;
use plant_sim::script::rng::Rng;

use crate::corruption::spoil_number;

/// The most scans in a row whose samples are damaged.
const SCANS_MAX: u64 = 20;
/// So many scans later what was damaged is forgotten: a servo is ready again.
pub const FORGOTTEN_SCANS: u64 = 12;

/// Which samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The feedback, for all who read it.
    Feedback,
    /// The roster, as the master reads it.
    Roster,
    /// The commands of all servos.
    Command,
    /// The planner's status.
    Status,
}

impl Kind {
    /// All of them.
    pub const ALL: [Kind; 4] = [Kind::Feedback, Kind::Roster, Kind::Command, Kind::Status];

    /// The numbers of such a sample.
    pub fn leaves(self) -> &'static [Leaf] {
        static LEAVES: OnceLock<[Vec<Leaf>; 4]> = OnceLock::new();
        let all = LEAVES.get_or_init(|| {
            [
                leaves::<Feedback>(),
                leaves::<Roster>(),
                leaves::<AxisCommand>(),
                leaves::<PlannerStatus>(),
            ]
        });
        all.get(self as usize).map_or(&[], Vec::as_slice)
    }
}

/// One number of all samples of a kind, for some scans.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tampering {
    /// Which samples.
    pub kind: Kind,
    /// Which number: its index in [`Kind::leaves`].
    pub index: usize,
    /// How it is wrong.
    pub how: Spoil,
    /// The checksum is right all the same.
    pub resealed: bool,
    /// From this scan on.
    pub from: u64,
    /// For so many.
    pub scans: u64,
}

impl Tampering {
    /// Any, in a run of so many scans.
    pub fn draw(rng: &mut Rng, scans: u64) -> Tampering {
        let kind = *rng.pick(&Kind::ALL).unwrap_or(&Kind::Feedback);
        let index = rng.below(kind.leaves().len().max(1) as u64) as usize;
        let leaf = kind.leaves().get(index);
        let bits = 8 * leaf.map_or(1, |leaf| leaf.bytes) as u64;
        let how = match rng.below(7) {
            0 => Spoil::AllBits,
            1 => Spoil::Most,
            2 => Spoil::Zero,
            3 => Spoil::OneMore,
            4 => Spoil::OneLess,
            5 if leaf.is_some_and(|leaf| leaf.number == "float64") => Spoil::NotANumber,
            _ => Spoil::Bit(rng.below(bits) as u8),
        };
        let lies = matches!(kind, Kind::Feedback | Kind::Roster);
        Tampering {
            kind,
            index,
            how,
            resealed: lies && rng.one_in(2),
            from: rng.within(1, scans.max(2)),
            scans: 1 + rng.below(SCANS_MAX),
        }
    }

    /// Whether the samples of this scan are damaged.
    pub fn meets(&self, scan: u64) -> bool {
        (self.from..self.until()).contains(&scan)
    }

    /// The first scan whose samples are whole again.
    pub fn until(&self) -> u64 {
        self.from.saturating_add(self.scans)
    }

    /// What a reader takes of a sample that was sent in this scan.
    pub fn received<T: Sample>(&self, kind: Kind, scan: u64, sent: &T) -> Option<T> {
        let mut sample = *sent;
        if kind != self.kind || !self.meets(scan) {
            return Some(sample);
        }
        sample.seal();
        if let Some(leaf) = kind.leaves().get(self.index) {
            spoil_number(&mut sample, leaf, self.how);
        }
        if self.resealed {
            sample.seal();
        }
        (sample.is_whole() && sample.is_sound()).then_some(sample)
    }

    /// In words.
    pub fn words(&self) -> String {
        let name = self.kind.leaves().get(self.index);
        let name = name.map_or("?", |leaf| leaf.name.as_str());
        let seal = if self.resealed {
            "under a right checksum"
        } else {
            "after its checksum"
        };
        format!(
            "{:?}.{name} {} {seal}, scans {} to {}",
            self.kind,
            self.how.word(),
            self.from,
            self.until().saturating_sub(1)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bus::sample::{MAX_AXES, SERVO_STATE_WORDS};
    use bytemuck::Zeroable;

    fn each<T: Sample>(kind: Kind, sample: &T) {
        for (index, leaf) in kind.leaves().iter().enumerate() {
            for how in [Spoil::AllBits, Spoil::Most, Spoil::OneMore, Spoil::Bit(0)] {
                let tampering = Tampering {
                    kind,
                    index,
                    how,
                    resealed: false,
                    from: 7,
                    scans: 2,
                };
                let what = tampering.words();
                assert!(tampering.received(kind, 7, sample).is_none(), "{what}");
                assert!(tampering.received(kind, 9, sample).is_some(), "{what}");
                let resealed = Tampering {
                    resealed: true,
                    ..tampering
                };
                let taken = resealed.received(kind, 8, sample);
                let name = leaf.name.as_str();
                let counts = matches!(name, "axis_count" | "path_axes");
                let is_checked = counts || matches!(name, "checksum" | "scan" | "visible_from");
                assert!(is_checked || taken.is_some(), "{what}");
            }
        }
    }

    #[test]
    fn damage_behind_a_checksum_is_found_in_every_number_of_every_sample() {
        // What is not in use is not sent.
        let feedback = Feedback {
            axis_count: MAX_AXES as u32,
            ..Feedback::zeroed()
        };
        each(Kind::Feedback, &feedback);
        each(Kind::Roster, &Roster::zeroed());
        let command = AxisCommand {
            state_words: SERVO_STATE_WORDS as u32,
            ..AxisCommand::zeroed()
        };
        each(Kind::Command, &command);
        each(Kind::Status, &PlannerStatus::zeroed());
    }

    #[test]
    fn a_scan_that_no_cell_comes_to_is_refused_under_a_right_checksum() {
        let mut far = Feedback::zeroed();
        far.scan = u64::MAX;
        far.visible_from = u64::MAX;
        far.seal();
        assert!(far.is_whole() && !far.is_sound());
        let mut far = AxisCommand {
            scan: u64::MAX,
            visible_from: u64::MAX,
            ..AxisCommand::zeroed()
        };
        far.seal();
        assert!(far.is_whole() && !far.is_sound());
        let mut right = Feedback::zeroed();
        right.scan = bus::service::SCAN_MAX;
        right.visible_from = right.scan;
        right.seal();
        assert!(right.is_whole() && right.is_sound());
    }
}

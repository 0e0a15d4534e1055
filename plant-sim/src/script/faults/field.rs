//! One number of a sample that is wrong: which, and how.

use std::sync::OnceLock;

use bus::layout::{Leaf, leaves};
use bus::sample::{AxisCommand, Job, PlannerStatus, Setpoint, WindowHeader};

/// What a process sends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sent {
    /// A servo's command.
    Command,
    /// The header of a window.
    Window,
    /// A setpoint in the middle of a window.
    Setpoint,
    /// What the planner reports.
    Status,
}

impl Sent {
    /// All of them.
    pub const ALL: [Sent; 4] = [Sent::Command, Sent::Window, Sent::Setpoint, Sent::Status];

    /// The word in the file.
    pub fn word(self) -> &'static str {
        match self {
            Sent::Command => "command",
            Sent::Window => "window",
            Sent::Setpoint => "setpoint",
            Sent::Status => "status",
        }
    }

    /// Who sends it.
    pub fn job(self) -> Job {
        match self {
            Sent::Command => Job::Servo,
            Sent::Window | Sent::Setpoint | Sent::Status => Job::Planner,
        }
    }

    /// Its numbers.
    pub fn leaves(self) -> &'static [Leaf] {
        static LEAVES: OnceLock<[Vec<Leaf>; 4]> = OnceLock::new();
        let all = LEAVES.get_or_init(|| {
            [
                leaves::<AxisCommand>(),
                leaves::<WindowHeader>(),
                leaves::<Setpoint>(),
                leaves::<PlannerStatus>(),
            ]
        });
        all.get(self as usize).map_or(&[], Vec::as_slice)
    }
}

/// One number of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// Of which sample.
    pub sent: Sent,
    /// Its index in [`Sent::leaves`].
    pub index: usize,
    /// A window comes under a right checksum all the same.
    pub sealed: bool,
}

impl Field {
    /// The field of this name, as `command.held.sequence`, of what this job sends.
    pub fn parse(job: Job, name: &str, sealed: bool) -> Option<Field> {
        let (sent, within) = name.split_once('.')?;
        let sent = Sent::ALL
            .into_iter()
            .find(|s| s.word() == sent && s.job() == job)?;
        let index = sent.leaves().iter().position(|leaf| leaf.name == within)?;
        Some(Field {
            sent,
            index,
            sealed,
        })
    }

    /// Where it is.
    pub fn leaf(self) -> Option<&'static Leaf> {
        self.sent.leaves().get(self.index)
    }

    /// The word in the file.
    pub fn name(self) -> String {
        let name = self.leaf().map_or("?", |leaf| leaf.name.as_str());
        format!("{}.{name}", self.sent.word())
    }
}

/// How a number is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Spoil {
    /// Every bit is the other.
    AllBits,
    /// One bit is, counted from the lowest.
    Bit(u8),
    /// It is the largest of its kind.
    Most,
    /// It is 0.
    Zero,
    /// It is one more.
    OneMore,
    /// It is one less.
    OneLess,
    /// It is not a number.
    NotANumber,
}

impl Spoil {
    /// The word in the file.
    pub fn word(self) -> String {
        match self {
            Spoil::AllBits => "all-bits".into(),
            Spoil::Bit(bit) => format!("bit-{bit}"),
            Spoil::Most => "most".into(),
            Spoil::Zero => "zero".into(),
            Spoil::OneMore => "one-more".into(),
            Spoil::OneLess => "one-less".into(),
            Spoil::NotANumber => "not-a-number".into(),
        }
    }

    /// What this word means for a number; none if it means nothing.
    pub fn parse(word: &str, leaf: &Leaf) -> Option<Spoil> {
        let bits = 8 * leaf.bytes as u64;
        Some(match word {
            "all-bits" => Spoil::AllBits,
            "most" => Spoil::Most,
            "zero" => Spoil::Zero,
            "one-more" => Spoil::OneMore,
            "one-less" => Spoil::OneLess,
            "not-a-number" if leaf.number == "float64" => Spoil::NotANumber,
            _ => {
                let bit: u8 = word.strip_prefix("bit-")?.parse().ok()?;
                (u64::from(bit) < bits).then_some(Spoil::Bit(bit))?
            }
        })
    }

    /// The bits that stand in the place of these.
    pub fn of(self, bits: u64, leaf: &Leaf) -> u64 {
        let all = u64::MAX >> (64 - 8 * leaf.bytes.clamp(1, 8));
        let float = leaf.number == "float64";
        let add = |number: f64| (f64::from_bits(bits) + number).to_bits();
        let spoilt = match self {
            Spoil::AllBits => !bits,
            Spoil::Bit(bit) => bits ^ 1u64.checked_shl(bit.into()).unwrap_or(0),
            Spoil::Most if float => f64::MAX.to_bits(),
            Spoil::Most if leaf.number.starts_with("int") => all >> 1,
            Spoil::Most => all,
            Spoil::Zero => 0,
            Spoil::OneMore if float => add(1.0),
            Spoil::OneMore => bits.wrapping_add(1),
            Spoil::OneLess if float => add(-1.0),
            Spoil::OneLess => bits.wrapping_sub(1),
            Spoil::NotANumber => f64::NAN.to_bits(),
        };
        spoilt & all
    }
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use super::*;

    #[test]
    fn every_number_of_every_sample_is_found_by_its_name() {
        for sent in Sent::ALL {
            for index in 0..sent.leaves().len() {
                let field = Field {
                    sent,
                    index,
                    sealed: true,
                };
                let found = Field::parse(sent.job(), &field.name(), true);
                assert_eq!(found, Some(field), "{}", field.name());
            }
        }
        assert_eq!(Field::parse(Job::Planner, "command.scan", true), None);
        assert_eq!(Field::parse(Job::Servo, "command.scans", true), None);
    }

    #[test]
    fn each_way_to_be_wrong_is_what_it_says() {
        let leaf = |name: &str| {
            let found = Field::parse(Job::Servo, name, true).and_then(Field::leaf);
            found.expect("a field")
        };
        let (scan, axis) = (leaf("command.scan"), leaf("command.axis"));
        let (place, speed) = (leaf("command.position"), leaf("command.velocity_mm_s"));
        for (leaf, word, before, after) in [
            (scan, "all-bits", 1, u64::MAX - 1),
            (scan, "bit-63", 1, 1 + (1 << 63)),
            (axis, "all-bits", 1, u64::from(u32::MAX) - 1),
            (axis, "one-less", 0, u64::from(u32::MAX)),
            (axis, "most", 0, u64::from(u32::MAX)),
            (place, "most", 0, i64::MAX as u64),
            (place, "one-less", 0, u64::MAX),
            (speed, "one-more", 2.5f64.to_bits(), 3.5f64.to_bits()),
            (speed, "most", 0, f64::MAX.to_bits()),
            (speed, "zero", 7, 0),
        ] {
            let spoil = Spoil::parse(word, leaf).expect("a word");
            assert_eq!(spoil.word(), word);
            assert_eq!(spoil.of(before, leaf), after, "{word} of {}", leaf.name);
        }
        assert_eq!(Spoil::parse("bit-32", axis), None);
        assert_eq!(Spoil::parse("not-a-number", axis), None);
        let nan = Spoil::parse("not-a-number", speed).expect("a word");
        assert!(f64::from_bits(nan.of(0, speed)).is_nan());
    }
}

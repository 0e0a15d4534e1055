//! Homing by the drive itself: CiA 402 mode 6 (IEC 61800-7-201, "homing mode").

/// Mode of operation "homing".
const HOMING: i32 = 6;
/// Bit 4 of the controlword: homing starts at its rise.
const START: u16 = 1 << 4;
/// Bits of the statusword in this mode: target reached, homing attained, homing error.
const REACHED: u16 = 1 << 10;
const ATTAINED: u16 = 1 << 12;
const ERROR: u16 = 1 << 13;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// Nobody has asked for it.
    Idle,
    /// The mode is asked for.
    Asked,
    /// The drive has shown the mode: it is to start.
    Started,
    /// The reference is found; the mode is left when homing is asked for no more.
    Found,
    /// It is asked for no more, and the drive may still show the mode.
    Left,
}

/// Homing of one drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct DriveHoming {
    /// Whether the drive has to be homed at all.
    needed: bool,
    referenced: bool,
    step: Step,
    /// Cycles since the start: what the drive shows of an earlier homing does not count.
    cycles: u32,
}

/// A drive has left the mode within so many cycles after that is asked for.
const LEAVING_CYCLES: u32 = 100;
/// A drive takes back what it attained before within so many cycles after the start.
const STALE_CYCLES: u32 = 10;

impl DriveHoming {
    pub fn new(needed: bool) -> DriveHoming {
        DriveHoming {
            needed,
            referenced: !needed,
            step: Step::Idle,
            cycles: 0,
        }
    }

    /// Whether the position is that of the machine.
    pub fn is_referenced(self) -> bool {
        self.referenced
    }

    /// Takes what was known before this process.
    pub fn restore(&mut self, referenced: bool) {
        self.referenced = referenced || !self.needed;
    }

    /// The drive was lost: whatever it knew may be gone.
    pub fn lose(&mut self) {
        self.referenced = !self.needed;
        self.step = Step::Idle;
    }

    /// Homing is asked for in this cycle, or not.
    pub fn command(&mut self, homes: bool) {
        match (homes, self.step) {
            (true, Step::Idle | Step::Left) => {
                self.referenced = false;
                self.step = Step::Asked;
            }
            (false, Step::Asked | Step::Started | Step::Found) => {
                self.step = Step::Left;
                self.cycles = 0;
            }
            (false, Step::Idle | Step::Left) | (true, _) => {}
        }
    }

    /// The mode to ask for; none for that of operation.
    pub fn mode(self) -> Option<i64> {
        (!matches!(self.step, Step::Idle | Step::Left)).then_some(HOMING.into())
    }

    /// What is added to the controlword.
    pub fn control_bits(self) -> u16 {
        if matches!(self.step, Step::Started | Step::Found) {
            START
        } else {
            0
        }
    }

    /// Whether a drive that follows commands may be in this mode now.
    pub fn may_show(self, mode: i32) -> bool {
        mode == HOMING && self.step != Step::Idle
    }

    /// Takes what the drive shows; true in the cycle in which it has found its reference.
    pub fn take(&mut self, statusword: u16, mode: Option<i32>) -> bool {
        if mode != Some(HOMING) {
            if self.step == Step::Left {
                self.step = Step::Idle;
            }
            return false;
        }
        match self.step {
            Step::Left => {
                self.cycles = self.cycles.saturating_add(1);
                if self.cycles > LEAVING_CYCLES {
                    self.step = Step::Idle;
                }
                false
            }
            Step::Asked => {
                self.step = Step::Started;
                self.cycles = 0;
                false
            }
            Step::Started => {
                self.cycles = self.cycles.saturating_add(1);
                let shown = statusword & (REACHED | ATTAINED | ERROR);
                let found = shown == REACHED | ATTAINED && self.cycles > STALE_CYCLES;
                if found {
                    self.step = Step::Found;
                    self.referenced = true;
                }
                found
            }
            Step::Idle | Step::Found => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn incremental() -> DriveHoming {
        DriveHoming {
            needed: true,
            referenced: false,
            step: Step::Idle,
            cycles: 0,
        }
    }

    #[test]
    fn a_drive_is_homed_once_it_shows_the_mode_and_that_it_attained_its_reference() {
        let mut homing = incremental();
        homing.command(true);
        assert_eq!((homing.mode(), homing.control_bits()), (Some(6), 0));
        // Still in its mode of operation.
        assert!(!homing.take(0x1637, Some(9)));
        assert_eq!(homing.control_bits(), 0);
        // What it attained some time ago.
        for _ in 0..5 {
            homing.command(true);
            assert!(!homing.take(0x1637, Some(6)));
            assert_eq!(homing.control_bits(), START);
        }
        for _ in 0..100 {
            homing.command(true);
            assert!(!homing.take(0x0237, Some(6)));
        }
        assert!(homing.take(0x1637, Some(6)));
        assert!(homing.is_referenced());
        homing.command(false);
        assert_eq!((homing.mode(), homing.control_bits()), (None, 0));
        assert!(homing.is_referenced());
        // It shows the mode a while longer, as long as it takes on a bus, not for ever.
        assert!(homing.may_show(6) && !homing.take(0x1637, Some(6)) && homing.may_show(6));
        let mut stays = homing;
        assert!(!(0..=LEAVING_CYCLES).any(|_| stays.take(0x1637, Some(6))));
        assert!(!stays.may_show(6));
        homing.take(0x1637, Some(9));
        assert!(!homing.may_show(6));
        homing.lose();
        assert!(!homing.is_referenced());
    }

    #[test]
    fn a_homing_that_fails_or_is_left_gives_no_reference() {
        let mut homing = incremental();
        for _ in 0..100 {
            homing.command(true);
            assert!(!homing.take(0x2637 | ATTAINED, Some(6)));
        }
        homing.command(false);
        assert!(!homing.take(0x1637, Some(6)));
        assert!(!homing.is_referenced());
    }
}

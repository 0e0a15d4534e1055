//! The state machine of a CiA 402 drive (IEC 61800-7-201, "power drive system") as whoever controls it walks it: from whatever the drive
//! shows towards what is wanted, one transition a cycle.

/// State of a drive, from its statusword.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeviceState {
    /// It is starting by itself.
    NotReady,
    /// No power may be switched on yet.
    SwitchOnDisabled,
    /// Power may be switched on.
    ReadyToSwitchOn,
    /// Power is on, without torque.
    SwitchedOn,
    /// It follows targets.
    OperationEnabled,
    /// It has braked and holds, or brakes.
    QuickStopActive,
    /// It does what its fault reaction says.
    FaultReaction,
    /// It has faulted.
    Fault,
}

impl DeviceState {
    /// The state that a statusword names; bits that name none count as [`DeviceState::NotReady`].
    pub fn of(statusword: u16) -> DeviceState {
        match (statusword & 0x4F, statusword & 0x6F) {
            (0x40, _) => DeviceState::SwitchOnDisabled,
            (0x0F, _) => DeviceState::FaultReaction,
            (0x08, _) => DeviceState::Fault,
            (_, 0x21) => DeviceState::ReadyToSwitchOn,
            (_, 0x23) => DeviceState::SwitchedOn,
            (_, 0x27) => DeviceState::OperationEnabled,
            (_, 0x07) => DeviceState::QuickStopActive,
            _ => DeviceState::NotReady,
        }
    }
}

/// What is wanted of a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Want {
    /// No torque.
    Off,
    /// It follows targets; a fault is reset, because an operator has ordered it.
    SwitchOn,
    /// It goes on to follow targets; a drive that does not is left as it is.
    Operate,
    /// It brakes by itself.
    QuickStop,
}

const SHUTDOWN: u16 = 0x06;
const SWITCH_ON: u16 = 0x07;
const ENABLE_OPERATION: u16 = 0x0F;
const DISABLE_VOLTAGE: u16 = 0x00;
/// Quick stop of a drive that operates.
pub const QUICK_STOP: u16 = 0x02;
const FAULT_RESET: u16 = 0x80;

/// So many cycles a drive may stay in quick stop though it is enabled again; then the way leads over *switch-on disabled*, for drives
/// without transition 16.
const OUT_OF_QUICK_STOP_CYCLES: u32 = 20;
/// A reset that has not been taken after so many cycles is given again.
const RESET_CYCLES: u32 = 50;

/// The walk of one drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StateWalk {
    /// Cycles in a row in which the drive was in quick stop, or faulted, though it is to operate.
    waited: u32,
}

impl StateWalk {
    /// The controlword of the next cycle, from the state that the drive shows.
    pub fn controlword(&mut self, shown: DeviceState, want: Want) -> u16 {
        let waits = want == Want::SwitchOn
            && matches!(shown, DeviceState::QuickStopActive | DeviceState::Fault);
        self.waited = if waits {
            self.waited.saturating_add(1)
        } else {
            0
        };
        match want {
            Want::Off => off(shown),
            Want::QuickStop => match shown {
                DeviceState::OperationEnabled | DeviceState::QuickStopActive => QUICK_STOP,
                shown => off(shown),
            },
            // Enabled while it operates; nothing switches a drive on that went off by itself.
            Want::Operate => match shown {
                DeviceState::OperationEnabled => ENABLE_OPERATION,
                shown => off(shown),
            },
            Want::SwitchOn => self.on(shown),
        }
    }

    fn on(self, shown: DeviceState) -> u16 {
        match shown {
            DeviceState::SwitchOnDisabled | DeviceState::NotReady | DeviceState::FaultReaction => {
                SHUTDOWN
            }
            DeviceState::ReadyToSwitchOn => SWITCH_ON,
            DeviceState::SwitchedOn | DeviceState::OperationEnabled => ENABLE_OPERATION,
            DeviceState::QuickStopActive if self.waited > OUT_OF_QUICK_STOP_CYCLES => {
                DISABLE_VOLTAGE
            }
            DeviceState::QuickStopActive => ENABLE_OPERATION,
            // A reset is an edge: one cycle without the bit, then some with it.
            DeviceState::Fault if self.waited % RESET_CYCLES <= 1 => DISABLE_VOLTAGE,
            DeviceState::Fault => FAULT_RESET,
        }
    }
}

/// Down, one transition after the other, to *ready to switch on*.
fn off(shown: DeviceState) -> u16 {
    match shown {
        DeviceState::OperationEnabled => SWITCH_ON,
        DeviceState::QuickStopActive | DeviceState::Fault => DISABLE_VOLTAGE,
        _ => SHUTDOWN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A drive as the standard has it: the state after a controlword.
    fn drive(state: DeviceState, word: u16, before: u16) -> DeviceState {
        use DeviceState::*;
        match state {
            Fault if word & 0x80 != 0 && before & 0x80 == 0 => SwitchOnDisabled,
            Fault | FaultReaction | NotReady => state,
            _ if word & 0x02 == 0 => SwitchOnDisabled,
            OperationEnabled | QuickStopActive if word & 0x04 == 0 => QuickStopActive,
            _ if word & 0x04 == 0 => SwitchOnDisabled,
            SwitchOnDisabled => match word & 0x07 {
                0x06 => ReadyToSwitchOn,
                _ => SwitchOnDisabled,
            },
            QuickStopActive if word & 0x0F == 0x0F => OperationEnabled,
            QuickStopActive => QuickStopActive,
            _ => match (state, word & 0x0F) {
                (_, 0x06 | 0x0E) => ReadyToSwitchOn,
                (ReadyToSwitchOn, _) => SwitchedOn,
                (SwitchedOn | OperationEnabled, 0x0F) => OperationEnabled,
                _ => SwitchedOn,
            },
        }
    }

    fn walk(from: DeviceState, want: Want, cycles: usize) -> DeviceState {
        let (mut walk, mut state, mut before) = (StateWalk::default(), from, 0x80);
        for _ in 0..cycles {
            let word = walk.controlword(state, want);
            state = drive(state, word, before);
            before = word;
        }
        state
    }

    const ALL: [DeviceState; 6] = [
        DeviceState::SwitchOnDisabled,
        DeviceState::ReadyToSwitchOn,
        DeviceState::SwitchedOn,
        DeviceState::OperationEnabled,
        DeviceState::QuickStopActive,
        DeviceState::Fault,
    ];

    #[test]
    fn a_drive_is_switched_on_from_whatever_it_shows() {
        for from in ALL {
            let to = walk(from, Want::SwitchOn, 10);
            assert_eq!(to, DeviceState::OperationEnabled, "{from:?}");
        }
    }

    #[test]
    fn a_drive_is_switched_off_from_whatever_it_shows_and_its_fault_stays() {
        for from in ALL {
            let to = walk(from, Want::Off, 10);
            let expected = match from {
                DeviceState::Fault => DeviceState::Fault,
                _ => DeviceState::ReadyToSwitchOn,
            };
            assert_eq!(to, expected, "{from:?}");
        }
    }

    #[test]
    fn nothing_but_an_order_switches_a_drive_on() {
        for from in ALL
            .into_iter()
            .filter(|s| *s != DeviceState::OperationEnabled)
        {
            for want in [Want::Operate, Want::QuickStop] {
                assert_ne!(walk(from, want, 200), DeviceState::OperationEnabled);
            }
        }
    }

    #[test]
    fn statuswords_of_the_standard_name_their_states() {
        for (word, state) in [
            (0x0000, DeviceState::NotReady),
            (0x0250, DeviceState::SwitchOnDisabled),
            (0x0231, DeviceState::ReadyToSwitchOn),
            (0x0233, DeviceState::SwitchedOn),
            (0x1237, DeviceState::OperationEnabled),
            (0x0217, DeviceState::QuickStopActive),
            (0x021F, DeviceState::FaultReaction),
            (0x0218, DeviceState::Fault),
        ] {
            assert_eq!(DeviceState::of(word), state, "{word:04X}");
        }
    }

    #[test]
    fn every_statusword_and_every_wish_has_a_controlword_of_the_standard() {
        for word in 0..=u16::MAX {
            let mut walk = StateWalk::default();
            for want in [Want::Off, Want::SwitchOn, Want::Operate, Want::QuickStop] {
                let control = walk.controlword(DeviceState::of(word), want);
                assert!([0x00, 0x02, 0x06, 0x07, 0x0F, 0x80].contains(&control));
            }
        }
    }
}

//! What an axis without an absolute encoder has to find its place: an incremental encoder with an index, a home switch, a drive that
//! homes by itself.

use bytemuck::{Pod, Zeroable};
use master::DriveCommand;

use crate::axis::AxisSimulation;
use crate::plant_file::{Actuated, PlantAxis, PlantDriveHoming, PlantHomeSwitch};
use crate::script::rng::Rng;

/// How fast a drive that homes by itself changes its speed, in mm/s².
const RAMP_MM_S2: f64 = 500.0;

/// It does not home.
const IDLE: u32 = 0;
/// It leaves its switch first.
const LEAVES: u32 = 1;
/// It moves towards its switch.
const SEARCHES: u32 = 2;

/// What the plant file says of it.
#[derive(Debug, Clone, Copy, Default)]
struct Settings {
    incremental: bool,
    /// Counts of an index, and from one to the next.
    index: i64,
    counts_per_turn: i64,
    count_mm: f64,
    switch: Option<PlantHomeSwitch>,
    drive: Option<PlantDriveHoming>,
    scan_s: f64,
}

/// What outlives the process.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct HomingState {
    /// What the encoder shows less where the motor is, in counts.
    pub offset: i64,
    /// Counts that were latched at the index in the last scan.
    pub latched: i64,
    /// Changes of the switch so far.
    pub changes: u64,
    /// Speed of a drive that homes by itself, in mm/s.
    pub speed_mm_s: f64,
    /// Motor counts at the end of the last scan.
    pub counts: i64,
    /// 1 if an index passed in the last scan.
    pub has_index: u32,
    /// 1 while the switch is actuated.
    pub actuated: u32,
    /// What a drive that homes by itself does: 0 nothing, 1 leaves its switch, 2 searches it.
    pub phase: u32,
    /// 1 once it knows its place.
    pub referenced: u32,
    /// 1 while the master asks it to home.
    pub asked: u32,
    /// Kept zero.
    pub reserved: u32,
}

/// Encoder, switch and homing of one axis; an absolute encoder without a switch where the plant file says nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct SimulatedHoming {
    settings: Settings,
    /// The state, for saving it.
    pub state: HomingState,
}

impl SimulatedHoming {
    /// Of an axis that stands where its simulation has it.
    pub fn new(axis: &PlantAxis, simulation: &AxisSimulation, scan_s: f64) -> SimulatedHoming {
        let count_mm = simulation.count_mm();
        let counts = |mm: f64| libm::round(mm / count_mm) as i64;
        let mut homing = SimulatedHoming {
            settings: Settings {
                incremental: axis.encoder.is_some(),
                index: axis.encoder.map_or(0, |of| counts(of.index_at_mm)),
                counts_per_turn: i64::from(axis.motor.encoder_counts_per_turn).max(1),
                count_mm,
                switch: axis.home_switch,
                drive: axis.drive_homing,
                scan_s,
            },
            state: HomingState {
                counts: simulation.motor_counts(),
                ..HomingState::default()
            },
        };
        if let Some(encoder) = axis.encoder {
            homing.state.offset = counts(encoder.shows_mm).wrapping_sub(homing.state.counts);
        }
        homing.judge_switch(simulation.instruments().table_mm);
        homing
    }

    /// What the encoder shows, in mm.
    pub fn shown_mm(&self, simulation: &AxisSimulation) -> f64 {
        if !self.settings.incremental {
            return simulation.motor_position_mm();
        }
        let shown = simulation.motor_counts().wrapping_add(self.state.offset);
        shown as f64 * self.settings.count_mm
    }

    /// What was latched at the index in the last scan, in mm as the encoder shows them.
    pub fn index_mm(&self) -> Option<f64> {
        let latched_mm = self.state.latched as f64 * self.settings.count_mm;
        (self.state.has_index == 1).then_some(latched_mm)
    }

    /// Whether the drive knows where it is.
    pub fn referenced(&self) -> bool {
        !self.settings.incremental || self.state.referenced == 1
    }

    /// The master hands over a command: whether the drive is to home is known at once.
    pub fn hand_over(&mut self, command: &DriveCommand, simulation: &AxisSimulation) {
        let asked = *command == DriveCommand::Home;
        let state = &mut self.state;
        if !asked {
            state.phase = IDLE;
        } else if state.asked == 0 {
            state.referenced = 0;
            state.speed_mm_s = 0.0;
            state.phase = match self.settings.drive {
                None => IDLE,
                Some(drive) if drive.is_actuated(simulation) => LEAVES,
                Some(_) => SEARCHES,
            };
        }
        state.asked = u32::from(asked);
    }

    /// A position is meant as the encoder shows it; the motor counts from elsewhere.
    fn in_own_counts(&self, command: DriveCommand) -> DriveCommand {
        let off_mm = self.state.offset as f64 * self.settings.count_mm;
        let mut command = command;
        if let DriveCommand::Position { position_mm, .. } = &mut command {
            *position_mm -= off_mm;
        }
        command
    }

    /// What the drive does in this scan for a command that acts now.
    pub fn act(&mut self, command: DriveCommand, simulation: &AxisSimulation) -> DriveCommand {
        if command != DriveCommand::Home {
            return self.in_own_counts(command);
        }
        let (Some(drive), state) = (self.settings.drive, &mut self.state) else {
            return command;
        };
        let actuated = drive.is_actuated(simulation);
        match state.phase {
            LEAVES if !actuated => state.phase = SEARCHES,
            SEARCHES if actuated => {
                state.phase = IDLE;
                state.referenced = 1;
                let off_mm = drive.position_mm - drive.switch_at_mm;
                state.offset = libm::round(off_mm / self.settings.count_mm) as i64;
            }
            _ => {}
        }
        let wanted_mm_s = match state.phase {
            LEAVES => -drive.speed_mm_s,
            SEARCHES => drive.speed_mm_s,
            _ => return command,
        };
        let change_mm_s = RAMP_MM_S2 * self.settings.scan_s;
        let missing_mm_s = wanted_mm_s - state.speed_mm_s;
        state.speed_mm_s += missing_mm_s.clamp(-change_mm_s, change_mm_s);
        DriveCommand::Velocity {
            velocity_mm_s: state.speed_mm_s,
            torque_offset_nm: 0.0,
        }
    }

    /// One scan has ended, with the table there.
    pub fn scan(&mut self, simulation: &AxisSimulation, table_mm: f64) {
        let (before, now) = (self.state.counts, simulation.motor_counts());
        let index = self.passed(before, now);
        let state = &mut self.state;
        state.counts = now;
        state.has_index = u32::from(index.is_some());
        state.latched = index.unwrap_or(0).wrapping_add(state.offset);
        self.judge_switch(table_mm);
    }

    /// The index that the motor met first on its way; its edge is the same from either side.
    fn passed(&self, before: i64, now: i64) -> Option<i64> {
        let settings = &self.settings;
        if !settings.incremental || before == now {
            return None;
        }
        let turns_below = |counts: i64| {
            (counts.wrapping_sub(settings.index)).div_euclid(settings.counts_per_turn)
        };
        let (from, to) = (turns_below(before), turns_below(now));
        let turn = match from.cmp(&to) {
            std::cmp::Ordering::Less => from + 1,
            std::cmp::Ordering::Equal => return None,
            std::cmp::Ordering::Greater => from,
        };
        Some(settings.index + turn * settings.counts_per_turn)
    }

    fn judge_switch(&mut self, table_mm: f64) {
        let Some(switch) = self.settings.switch else {
            return;
        };
        let state = &mut self.state;
        let scatter_mm = switch.scatter_um * 1e-3;
        let mut random = Rng::after(switch.seed, state.changes);
        let scatter_mm = random.between(-scatter_mm, scatter_mm);
        let beyond_mm = match switch.actuated {
            Actuated::Above => table_mm - switch.at_mm,
            Actuated::Below => switch.at_mm - table_mm,
        } - scatter_mm;
        let actuated = match state.actuated {
            1 => beyond_mm > -switch.hysteresis_um * 1e-3,
            _ => beyond_mm >= 0.0,
        };
        if actuated != (state.actuated == 1) {
            state.changes = state.changes.wrapping_add(1);
            state.actuated = u32::from(actuated);
        }
    }

    /// Inputs that its switch sets, a bit each.
    pub fn inputs(&self) -> u64 {
        let Some(switch) = self.settings.switch else {
            return 0;
        };
        let shows = (self.state.actuated == 1) != switch.normally_closed;
        u64::from(shows)
            .checked_shl(switch.digital)
            .unwrap_or_default()
    }

    /// Goes on from a saved state; a drive that was homing has stopped.
    pub fn restore(&mut self, state: &HomingState) {
        self.state = HomingState {
            phase: IDLE,
            asked: 0,
            has_index: 0,
            ..*state
        };
    }

    /// The axis has moved without a scan of the master.
    pub fn moved(&mut self, simulation: &AxisSimulation, table_mm: f64) {
        self.state.counts = simulation.motor_counts();
        self.judge_switch(table_mm);
    }
}

impl PlantDriveHoming {
    fn is_actuated(&self, simulation: &AxisSimulation) -> bool {
        let motor_mm = simulation.instruments().motor_mm;
        (motor_mm - self.switch_at_mm) * self.speed_mm_s >= 0.0
    }
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use machine::{Machine, settings_file::SettingsFileError};

    use super::*;
    use crate::plant_file::PlantFile;

    /// Machine and plant of two slides with pieces of their texts added to the first axis.
    fn made(machine: &str, plant: &str) -> Result<(), String> {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        let text = |name: &str, tables: &str| {
            let text = std::fs::read_to_string(folder.join(name)).expect(name);
            text.replacen("[axis.motor]", &format!("{tables}\n[axis.motor]"), 1)
        };
        let words = |error: SettingsFileError| error.to_string();
        let machine = Machine::parse("machine.toml", &text("machine.toml", machine));
        let plant = PlantFile::parse("plant.toml", &text("plant.toml", plant));
        let (machine, plant) = (machine.map_err(words)?, plant.map_err(words)?);
        plant.drives(&machine).map_err(|error| error.to_string())?;
        Ok(())
    }

    const ENCODER: &str = "[axis.encoder]\nshows_mm = 3\n";

    #[test]
    fn a_machine_is_homed_by_what_its_plant_has() {
        let by = |method: &str| format!("[axis.homing]\nmethod = {method}\n");
        let switch = "[axis.home_switch]\ndigital = 4\nat_mm = 0\n";
        let drive = "[axis.drive_homing]\nspeed_mm_s = 5\nswitch_at_mm = 0\n";
        let by_switch = by("\"switch\"\nswitch_input = 4");
        assert_eq!(made(&by_switch, &format!("{ENCODER}{switch}")), Ok(()));
        assert_eq!(made(&by("\"drive\""), &format!("{ENCODER}{drive}")), Ok(()));
        let standing = drive.replace("= 5", "= 0");
        for (machine, plant, says) in [
            (String::new(), ENCODER.to_string(), "no [axis.homing]"),
            (by("\"index\""), String::new(), "no [axis.encoder]"),
            (by("\"drive\""), ENCODER.into(), "no [axis.drive_homing]"),
            (
                by("\"switch\"\nswitch_input = 5"),
                format!("{ENCODER}{switch}"),
                "no [axis.home_switch] for it at the same digital input",
            ),
            (String::new(), drive.into(), "needs [axis.encoder]"),
            (
                by("\"drive\""),
                format!("{ENCODER}{standing}"),
                "drive_homing.speed_mm_s = 0 mm/s",
            ),
        ] {
            let said = made(&machine, &plant).expect_err(says);
            assert!(said.contains(says), "{said}");
        }
    }

    #[test]
    fn the_index_is_met_at_the_same_count_from_either_side_and_the_first_of_several() {
        let homing = SimulatedHoming {
            settings: Settings {
                incremental: true,
                index: 30,
                counts_per_turn: 100,
                ..Settings::default()
            },
            ..SimulatedHoming::default()
        };
        for (before, now, met) in [
            (20, 29, None),
            (29, 30, Some(30)),
            (30, 31, None),
            (31, 30, None),
            (30, 29, Some(30)),
            (20, 250, Some(30)),
            (250, 20, Some(230)),
            (-80, -60, Some(-70)),
            (-60, -80, Some(-70)),
            (5, 5, None),
        ] {
            assert_eq!(homing.passed(before, now), met, "{before} to {now}");
        }
    }
}

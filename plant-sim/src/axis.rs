//! One simulated axis: drive, motor and mechanics, advanced one scan at a time.

use bytemuck::{Pod, Zeroable};
use machine::BrakeBy;
use master::{DriveCommand, InstrumentSample, StateRefused};

use crate::bridge::Bridge;
use crate::drive::{DriveParameters, DriveSettings, DriveState};
use crate::measurement::{Measurement, MeasurementState, TORQUES_KEPT};
use crate::mechanics::{MechanicsSettings, MechanicsState};
use crate::plant_file::PlantFile;
use crate::winding::{WindingSettings, WindingState};

/// Period of the bench instruments, in µs.
pub const INSTRUMENT_PERIOD_US: u32 = 250;

/// Positions farther from zero than this, in m, are not those of a machine: an axis that turns without end counts 1 m for 1000 degrees.
const POSITION_M_MAX: f64 = 1e5;
/// Scans without one count of movement after which an axis is at rest (beside the time in [`REST_S`]).
const REST_SCANS_MIN: u32 = 4;
/// Time without one count of movement after which an axis is at rest, in s.
const REST_S: f64 = 0.05;
/// Longest simulated time a run-down may take, in s: minutes of travel at any speed and deceleration that exist.
const RUN_DOWN_S_MAX: f64 = 20.0;
/// Longest wait for a brake to close, in s: more than the longest time that a plant file can give one.
const CLOSING_S_MAX: f64 = 2.5;

/// Clocks that do not fit each other.
/// Why plant file and machine file do not fit each other.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct SetupError(pub String);

/// The constants of one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisSettings {
    mechanics: MechanicsSettings,
    drive: DriveSettings,
    winding: WindingSettings,
    measurement: Option<Measurement>,
    brake: Option<BrakeBy>,
    /// The scan in which the drive loses its power, if it ever does.
    power_lost_scan: Option<u64>,
    radius_m: f64,
    count_m: f64,
    scale_count_m: Option<f64>,
    start_m: f64,
    microsteps_per_drive_period: u32,
    microsteps_per_scan: u32,
    microsteps_per_sample: u32,
    samples_per_scan: u32,
    scan_s: f64,
}

/// Everything an axis remembers; plain bytes, so that it survives the process.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct AxisState {
    /// Motor, screw and table.
    pub mechanics: MechanicsState,
    /// Drive.
    pub drive: DriveState,
    /// Winding.
    pub winding: WindingState,
    /// What is measured wrongly.
    pub measurement: MeasurementState,
    /// Mean torque of the last scan, in N·m.
    pub torque_mean_nm: f64,
    /// 1 if the torque limit was active in the last scan.
    pub torque_limited: u64,
    /// Scans so far, where one of them is that in which the drive loses its power.
    pub scans: u64,
    /// 1 while the controller wants the brake open, where it is the one to say so.
    pub released: u32,
    /// 1 while the drive has no power, until it is switched on.
    pub powerless: u32,
}

/// How a run-down went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunDown {
    /// Scans simulated.
    pub scans: u32,
    /// Whether the axis came to rest; false only for a drive whose loop oscillates.
    pub at_rest: bool,
}

/// Whether a drive that brakes holds its axis within a count of one place.
#[derive(Debug, Clone, Copy)]
struct RestWatch {
    still: u32,
    place: i64,
    rest_scans: u32,
}

impl RestWatch {
    fn of(axis: &AxisSimulation) -> RestWatch {
        RestWatch {
            still: 0,
            place: axis.state.drive.counts,
            rest_scans: ((REST_S / axis.settings.scan_s) as u32).max(REST_SCANS_MIN),
        }
    }

    /// One scan later: whether it has done so for 50 ms.
    fn stands(&mut self, axis: &AxisSimulation) -> bool {
        let drive = &axis.state.drive;
        let stays = drive.command_m_s == 0.0 && drive.counts.abs_diff(self.place) <= 1;
        if stays {
            self.still += 1;
        } else {
            (self.still, self.place) = (0, drive.counts);
        }
        self.still >= self.rest_scans
    }
}

/// Scans until one of them says that all stands, within a bound.
fn run_down_with(scan_s: f64, mut scan: impl FnMut() -> bool) -> RunDown {
    let scans_max = (RUN_DOWN_S_MAX / scan_s) as u32;
    for scans in 1..=scans_max {
        if scan() {
            return RunDown {
                scans,
                at_rest: true,
            };
        }
    }
    RunDown {
        scans: scans_max,
        at_rest: false,
    }
}

/// How far a scan is.
#[derive(Debug, Clone, Copy, Default)]
struct Progress {
    /// Microsteps to the end of the scan, to the drive's next period and to the next sample.
    left: u32,
    until_drive: u32,
    until_sample: u32,
    /// Samples taken.
    samples: usize,
    force_sum_n: f64,
    force_square_sum_n2: f64,
    limited: bool,
}

/// One simulated axis: settings and state.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisSimulation {
    /// The settings it was made with.
    pub(crate) settings: AxisSettings,
    state: AxisState,
}

impl AxisSettings {
    /// Prepares axis `name` of a plant for this drive and scan.
    ///
    /// # Errors
    /// The plant has no such axis, or microstep, drive period, instrument period and scan are not whole multiples.
    pub fn new(
        plant: &PlantFile,
        name: &str,
        drive: &DriveParameters,
        scan_us: u32,
    ) -> Result<Self, SetupError> {
        let wrong = |what: &str| SetupError(format!("axis {name}{what}"));
        let axis = plant.axis(name);
        let axis = axis.ok_or_else(|| wrong(": the plant file has no [[axis]] of that name"))?;
        let (period_us, microstep_ns) = (drive.period_us, plant.microstep_ns());
        let wrong_period = |what: String| {
            wrong(&format!(
                " velocity_loop.period_us = {period_us} µs: {what}"
            ))
        };
        let microsteps_per_drive_period = whole(period_us, microstep_ns).ok_or_else(|| {
            let microstep_us = plant.microstep_us;
            wrong_period(format!(
                "must be a multiple of the plant's microstep_us = {microstep_us} µs"
            ))
        })?;
        if period_us == 0 || scan_us == 0 || !scan_us.is_multiple_of(period_us) {
            let what = format!("the scan of {scan_us} µs must be a multiple of it");
            return Err(wrong_period(what));
        }
        let sample_us = scan_us.min(INSTRUMENT_PERIOD_US);
        let microsteps_per_sample = whole(sample_us, microstep_ns)
   .filter(|_| scan_us.is_multiple_of(sample_us))
   .ok_or_else(|| SetupError(format!(
    "scan.period_us = {scan_us} µs: above {INSTRUMENT_PERIOD_US} µs it must be a multiple of it, the instruments' period"
   )))?;
        let scan_s = f64::from(scan_us) * 1e-6;
        let measurement = axis.measurement(scan_s);
        let scans = measurement.map_or(0, |of| of.torque_delay_scans);
        if scans >= TORQUES_KEPT {
            let most = TORQUES_KEPT - 1;
            return Err(wrong(&format!(
                " measurement.torque_delay_ms: {scans} scans, and the drive keeps the torques of {most}"
            )));
        }
        let microstep_s = microstep_ns as f64 * 1e-9;
        let radius_m = axis.radius_m();
        let count_m = axis.screw.lead_mm * 1e-3 / f64::from(axis.motor.encoder_counts_per_turn);
        Ok(AxisSettings {
            mechanics: MechanicsSettings::new(&axis.mechanics(microstep_s), microstep_s),
            drive: DriveSettings::new(drive, axis.motor.peak_torque_nm, radius_m, count_m),
            winding: axis.winding(scan_s),
            measurement,
            brake: drive.brake,
            power_lost_scan: axis.power_lost_at_s.map(|at_s| (at_s / scan_s) as u64),
            radius_m,
            count_m,
            scale_count_m: axis.scale.map(|scale| scale.resolution_nm * 1e-9),
            start_m: axis.start_position_mm * 1e-3,
            microsteps_per_drive_period,
            microsteps_per_scan: microsteps_per_drive_period * (scan_us / period_us),
            microsteps_per_sample,
            samples_per_scan: scan_us.div_ceil(INSTRUMENT_PERIOD_US),
            scan_s,
        })
    }

    /// Instrument samples in one scan: one every 250 µs, or one per scan where the scan is shorter.
    pub fn samples_per_scan(&self) -> usize {
        self.samples_per_scan as usize
    }
}

/// How many microsteps make `period_us`, if it is a whole number above 0.
fn whole(period_us: u32, microstep_ns: u64) -> Option<u32> {
    let period_ns = u64::from(period_us) * 1_000;
    (period_ns > 0 && microstep_ns > 0 && period_ns.is_multiple_of(microstep_ns))
        .then(|| u32::try_from(period_ns / microstep_ns).ok())
        .flatten()
}

impl AxisSimulation {
    /// An axis at rest, without force, at the start position of the plant file.
    pub fn new(settings: AxisSettings) -> Self {
        let mut state = AxisState::default();
        state.mechanics.motor_m = settings.start_m;
        state.mechanics.table_m = settings.start_m;
        state.drive.counts = counts(settings.start_m, settings.count_m);
        AxisSimulation { settings, state }
    }

    /// Everything it remembers.
    pub fn state(&self) -> &AxisState {
        &self.state
    }

    /// Goes on from a saved state, to the bit.
    ///
    /// # Errors
    /// A value is not finite or lies where no machine is; the axis stays as it was.
    pub fn restore(&mut self, state: &AxisState) -> Result<(), StateRefused> {
        if state.is_possible() {
            self.state = *state;
            Ok(())
        } else {
            Err(StateRefused)
        }
    }

    /// Advances one scan with this command.
    ///
    /// Each drive period begins with its velocity loop, on the encoder as it is then. `samples` gets one instrument
    /// sample every 250 µs (one per scan where the scan is shorter), the last at the end of the scan; it should hold
    /// [`AxisSettings::samples_per_scan`], further samples are dropped and further places left alone.
    pub fn scan(&mut self, command: &DriveCommand, samples: &mut [InstrumentSample]) {
        let mut progress = self.begin_scan();
        while progress.left > 0 {
            self.run(&mut progress, command, samples, u32::MAX);
        }
        self.end_scan(&progress);
    }

    /// Before the first microstep of a scan.
    fn begin_scan(&mut self) -> Progress {
        if let Some(lost_scan) = self.settings.power_lost_scan {
            self.state.powerless |= u32::from(self.state.scans == lost_scan);
            self.state.scans += 1;
        }
        Progress {
            left: self.settings.microsteps_per_scan,
            until_sample: self.settings.microsteps_per_sample,
            ..Progress::default()
        }
    }

    /// Some microsteps of a scan, at most so many and no farther than to the drive's next period or the next sample.
    fn run(
        &mut self,
        progress: &mut Progress,
        command: &DriveCommand,
        samples: &mut [InstrumentSample],
        steps_max: u32,
    ) {
        let settings = &self.settings;
        if progress.until_drive == 0 {
            let mut motor_m = self.state.mechanics.motor_m;
            if let Some(measurement) = &settings.measurement {
                motor_m += measurement.encoder(&mut self.state.measurement, motor_m);
            }
            let counts = counts(motor_m, settings.count_m);
            let command = with_brake(settings.brake, &mut self.state, command);
            settings
                .drive
                .update(&mut self.state.drive, &command, counts);
            progress.limited |= self.state.drive.limited != 0;
            progress.until_drive = settings.microsteps_per_drive_period;
        }
        let steps = progress.until_drive.min(progress.until_sample);
        let steps = steps.min(progress.left).min(steps_max);
        let demand_n = self.state.drive.demand_n;
        let effort = settings
            .mechanics
            .run(&mut self.state.mechanics, steps, demand_n);
        progress.force_sum_n += effort.force_sum_n;
        progress.force_square_sum_n2 += effort.force_square_sum_n2;
        progress.left -= steps;
        progress.until_drive -= steps;
        progress.until_sample -= steps;
        if progress.until_sample == 0 {
            progress.until_sample = settings.microsteps_per_sample;
            if let Some(place) = samples.get_mut(progress.samples) {
                *place = self.instruments();
            }
            progress.samples += 1;
        }
    }

    /// After the last microstep of a scan.
    fn end_scan(&mut self, progress: &Progress) {
        let settings = &self.settings;
        if let Some(measurement) = &settings.measurement {
            let torque_nm = self.state.mechanics.force_n * settings.radius_m;
            measurement.encoder(&mut self.state.measurement, self.state.mechanics.motor_m);
            measurement.torque(&mut self.state.measurement, torque_nm);
        }
        let microsteps = f64::from(settings.microsteps_per_scan);
        let radius_m = settings.radius_m;
        self.state.torque_mean_nm = radius_m * progress.force_sum_n / microsteps;
        self.state.torque_limited = u64::from(progress.limited);
        settings.winding.update(
            &mut self.state.winding,
            radius_m * radius_m * progress.force_square_sum_n2 / microsteps,
        );
    }

    /// Lets the drive brake until the axis has stayed within a count of one place for 50 ms: a drive that holds an axis may go to
    /// and fro by a count without end.
    ///
    /// For a restored axis: what the drive did while its master was away. The deceleration is in mm/s²; the drive's own
    /// quick stop where it is not above 0. Bounded by 20 s of simulated time.
    pub fn run_down(&mut self, deceleration_mm_s2: f64) -> RunDown {
        let command = DriveCommand::Brake { deceleration_mm_s2 };
        let scan_s = self.settings.scan_s;
        let mut rest = RestWatch::of(self);
        // Who opened the brake says nothing more; a drive closes its own once the axis stands.
        self.state.released = 0;
        let run_down = run_down_with(scan_s, || {
            self.scan(&command, &mut []);
            rest.stands(self)
        });
        let last = match self.settings.brake {
            Some(BrakeBy::Drive) => DriveCommand::Disabled,
            _ => command,
        };
        let closing_scans = (CLOSING_S_MAX / scan_s) as u32;
        for _ in 0..closing_scans {
            if self.settings.brake.is_none() || self.is_braked() {
                break;
            }
            self.scan(&last, &mut []);
        }
        run_down
    }

    /// Whether its brake holds it.
    pub fn is_braked(&self) -> bool {
        self.settings.brake.is_some() && self.state.mechanics.beyond.brake.holds()
    }

    /// Whether its drive follows commands: it has power, and a brake of its own is open.
    pub fn follows(&self) -> bool {
        let brake = &self.state.mechanics.beyond.brake;
        let opened =
            self.settings.brake != Some(BrakeBy::Drive) || brake.has_current() && !brake.holds();
        self.state.powerless == 0 && opened
    }

    /// The drive has lost its power, in whatever state it is, or has it again.
    pub fn power(&mut self, on: bool) {
        self.state.powerless = u32::from(!on);
    }

    /// The controller wants the brake open, or closed, where it is the one to say so.
    pub fn release(&mut self, open: bool) {
        self.state.released = u32::from(open);
    }

    /// Other axes are where friction of this one is higher by a share than without them, from now on.
    pub fn rub_more(&mut self, friction_share: f64) {
        self.state.mechanics.beyond.friction_share = friction_share;
    }

    /// True positions now: of the motor, and of the table as a tool sees it that does not swing with the frame.
    pub fn instruments(&self) -> InstrumentSample {
        InstrumentSample {
            motor_mm: self.state.mechanics.motor_m * 1e3,
            table_mm: self
                .state
                .mechanics
                .table_from_ground_m(&self.settings.mechanics)
                * 1e3,
        }
    }

    /// Motor encoder now, in whole counts (rounded down), as mm of travel. Absolute: a restart does not lose it.
    pub fn motor_position_mm(&self) -> f64 {
        self.motor_counts() as f64 * self.count_mm()
    }

    /// Motor encoder now, in whole counts (rounded down), as an absolute one has them.
    pub fn motor_counts(&self) -> i64 {
        let motor_m = self.state.mechanics.motor_m + self.state.measurement.encoder_error_m;
        counts(motor_m, self.settings.count_m)
    }

    /// One count of the motor encoder, in mm of travel.
    pub fn count_mm(&self) -> f64 {
        self.settings.count_m * 1e3
    }

    /// Linear scale at the table now, in whole steps (rounded down), in mm; none where the axis has no scale.
    pub fn scale_position_mm(&self) -> Option<f64> {
        self.settings
            .scale_count_m
            .map(|count_m| counts(self.state.mechanics.table_m, count_m) as f64 * (count_m * 1e3))
    }

    /// Velocity the drive measured at its last period, from encoder counts, in mm/s.
    pub fn velocity_mm_s(&self) -> f64 {
        self.state.drive.velocity_m_s * 1e3
    }

    /// Velocity command of the drive at its last period, in mm/s: its own ramp while it brakes.
    pub fn velocity_command_mm_s(&self) -> f64 {
        self.state.drive.command_m_s * 1e3
    }

    /// Motor torque now, behind the current loop, in N·m, as the drive shows it.
    pub fn torque_nm(&self) -> f64 {
        if let Some(measurement) = &self.settings.measurement {
            return measurement.shown_nm(&self.state.measurement);
        }
        self.state.mechanics.force_n * self.settings.radius_m
    }

    /// Mean motor torque of the last scan, in N·m.
    pub fn torque_mean_nm(&self) -> f64 {
        self.state.torque_mean_nm
    }

    /// Whether the torque limit cut the demand at any period of the last scan.
    pub fn torque_limited(&self) -> bool {
        self.state.torque_limited != 0
    }

    /// Winding temperature above the ambient, in K.
    pub fn winding_rise_k(&self) -> f64 {
        self.state.winding.rise_k
    }

    /// Integral of the squared torque over all scans, in N²·m²·s.
    pub fn torque_square_nm2_s(&self) -> f64 {
        self.state.winding.torque_square_nm2_s
    }
}

/// Two axes whose tables a bridge joins, the first motor's before the second's.
pub struct Joined<'a> {
    /// The axes.
    pub ends: [&'a mut AxisSimulation; 2],
    /// What joins their tables.
    pub bridge: &'a Bridge,
}

impl Joined<'_> {
    /// Advances both one scan, each with its command and its samples ([`AxisSimulation::scan`]). In every microstep the bridge acts on
    /// both tables first.
    pub fn scan(&mut self, commands: [&DriveCommand; 2], samples: [&mut [InstrumentSample]; 2]) {
        let [first, second] = &mut self.ends;
        let ([command, other], [samples, others]) = (commands, samples);
        let mut progress = [first.begin_scan(), second.begin_scan()];
        let [of_first, of_second] = &mut progress;
        while of_first.left > 0 && of_second.left > 0 {
            let force_n = self
                .bridge
                .force_n(&first.state.mechanics, &second.state.mechanics);
            first
                .settings
                .mechanics
                .push_table(&mut first.state.mechanics, force_n);
            second
                .settings
                .mechanics
                .push_table(&mut second.state.mechanics, -force_n);
            first.run(of_first, command, samples, 1);
            second.run(of_second, other, others, 1);
        }
        first.end_scan(of_first);
        second.end_scan(of_second);
    }

    /// Lets both drives brake until both axes stand, as [`AxisSimulation::run_down`].
    pub fn run_down(&mut self, deceleration_mm_s2: f64) -> RunDown {
        let command = DriveCommand::Brake { deceleration_mm_s2 };
        let scan_s = self.ends[0].settings.scan_s;
        let mut rest = [RestWatch::of(self.ends[0]), RestWatch::of(self.ends[1])];
        run_down_with(scan_s, || {
            self.scan([&command; 2], [&mut [], &mut []]);
            let [first, second] = &mut rest;
            let stand = [first.stands(self.ends[0]), second.stands(self.ends[1])];
            stand == [true; 2]
        })
    }
}

impl AxisState {
    /// Whether a machine could be in this state: every number finite, positions within a kilometre.
    pub fn is_possible(&self) -> bool {
        let m = &self.mechanics;
        let d = &self.drive;
        let positions = [m.motor_m, m.table_m, m.beyond.frame.off_m];
        let contacts = [&m.motor_friction, &m.table_friction];
        let numbers = [
            m.motor_m_s,
            m.table_m_s,
            m.force_n,
            d.velocity_m_s,
            d.command_m_s,
            d.integral_n,
            d.offset_n,
            d.demand_n,
            self.winding.rise_k,
            self.winding.torque_square_nm2_s,
            self.torque_mean_nm,
            m.beyond.variation.on_s,
            m.beyond.variation.rest_s,
            m.beyond.attached.off_m,
            m.beyond.attached.velocity_m_s,
            m.beyond.cutting.phase_s,
            m.beyond.frame.velocity_m_s,
            m.beyond.friction_share,
            self.measurement.encoder_error_m,
            self.measurement.time_s,
        ];
        let slips = m.beyond.lost_motion.force_n.iter();
        let torques = self.measurement.torque_nm.iter();
        positions.iter().all(|x| x.abs() <= POSITION_M_MAX)
            && numbers
                .iter()
                .chain(slips)
                .chain(torques)
                .all(|x| x.is_finite())
            && contacts.iter().all(|f| {
                f.velocity_m_s.is_finite()
                    && f.force_n.iter().all(|x| x.is_finite())
                    && f.slipping.iter().all(|s| *s == 0.0 || *s == 1.0)
            })
            && d.mode <= 3
            && d.limited <= 1
            && self.torque_limited <= 1
            && m.beyond.brake.is_possible()
            && self.released <= 1
            && self.powerless <= 1
    }
}

/// What a drive does for a command, with the brake of its motor. One that opens and closes it by itself holds the axis meanwhile.
fn with_brake(by: Option<BrakeBy>, state: &mut AxisState, command: &DriveCommand) -> DriveCommand {
    let brake = &mut state.mechanics.beyond.brake;
    if state.powerless == 1 {
        brake.switch(false);
        return DriveCommand::Disabled;
    }
    let hold = DriveCommand::Brake {
        deceleration_mm_s2: 0.0,
    };
    match (by, *command) {
        (None, command) => return command,
        (Some(BrakeBy::Controller), command) => {
            brake.switch(state.released == 1);
            return command;
        }
        (Some(BrakeBy::Drive), DriveCommand::SwitchOn) => brake.switch(true),
        (Some(BrakeBy::Drive), DriveCommand::Disabled) => {
            if state.drive.holds() || brake.holds() {
                brake.switch(false);
            }
        }
        (Some(BrakeBy::Drive), _) => {}
    }
    match (brake.has_current(), brake.holds()) {
        (false, true) => DriveCommand::Disabled,
        (true, false) if *command != DriveCommand::Disabled => *command,
        _ => hold,
    }
}

/// Whole counts at a position, rounded down.
fn counts(position_m: f64, count_m: f64) -> i64 {
    libm::floor(position_m / count_m) as i64
}

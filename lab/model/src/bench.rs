//! The machine and the program of the model: two axes, scans of 2 ms, periods of two scans, a path of some ten scans.

use machine::{AfterLoss, AfterMaster, Machine};

/// Scans of a period.
pub const PERIOD_SCANS: u64 = 2;
/// Scan period, in s.
pub const SCAN_S: f64 = 0.002;
/// Steps in which the axes stand, in mm: ten increments.
pub const STAND_MM: f64 = 0.01;
/// Most progress along the path in one scan, in mm: full speed along one axis.
pub const STEP_MAX_MM: f64 = 50.0 * SCAN_S;

/// A corner: an element along each axis.
pub const PROGRAM: &str = "G21 G17 G90 G94\nG1 X0.2 F3000\nY0.1\nM2\n";
/// Path length before each element, in mm.
pub const LENGTH_BEFORE_MM: [f64; 2] = [0.0, 0.2];

/// A deliberate mistake in one rule; the model must find it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mistake {
    /// The master takes a window over without asking axis Y whether it holds it.
    WindowWithoutEveryAxis,
    /// A replacement is admitted under the incarnation of who was there before.
    AdmittedUnderOldIncarnation,
    /// A servo that missed a feedback obeys the one before.
    StaleFeedbackObeyed,
    /// The launcher restarts a master that was killed after its last feedback.
    RestartedAfterTheEnd,
    /// The launcher orders a stop once, whoever is the master.
    StopOrderedOnce,
    /// A new master begins after the scan that was saved last, published or not.
    ScanPublishedTwice,
    /// The master takes the window of any planner.
    WindowOfAnyPlanner,
    /// The master answers an order before what it has latched is saved.
    AnsweredBeforeSaved,
    /// The launcher orders a run to stop, and not to end.
    StopTakenBack,
    /// What the master saves has no place on the path.
    PlaceForgotten,
}

impl Mistake {
    /// All of them.
    pub const ALL: [Mistake; 10] = [
        Mistake::WindowWithoutEveryAxis,
        Mistake::AdmittedUnderOldIncarnation,
        Mistake::StaleFeedbackObeyed,
        Mistake::RestartedAfterTheEnd,
        Mistake::StopOrderedOnce,
        Mistake::ScanPublishedTwice,
        Mistake::WindowOfAnyPlanner,
        Mistake::AnsweredBeforeSaved,
        Mistake::StopTakenBack,
        Mistake::PlaceForgotten,
    ];
}

/// What may happen in a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Budget {
    /// Processes that are killed.
    pub kills: u8,
    /// Samples that are lost or come too late.
    pub losses: u8,
    /// Stops that the operator or Ctrl-C orders.
    pub stops: u8,
    /// Orders that bring a waiting machine on: enable, resume.
    pub go_ons: u8,
}

/// One question to the model.
#[derive(Debug, Clone, Copy)]
pub struct Setting {
    /// Which axes have a standby.
    pub standby: [bool; 2],
    /// What follows the loss of a servo.
    pub servo: AfterLoss,
    /// What follows the loss of the planner.
    pub planner: AfterLoss,
    /// What follows the loss of the master.
    pub master: AfterMaster,
    /// What may happen.
    pub budget: Budget,
    /// What is wrong on purpose.
    pub mistake: Option<Mistake>,
}

impl Setting {
    /// The machine file of this setting.
    ///
    /// # Panics
    /// The machine below is refused: a mistake of the model.
    pub fn machine(&self) -> Machine {
        let axis = |name: &str, standby: bool| {
            format!(
                "[[axis]]\nname = {name:?}\nincrement_nm = 1000\ntravel_min_mm = -10.0\ntravel_max_mm = 10.0\nrapid_mm_s = 200.0\n\
                 acceleration_mm_s2 = 12500.0\nquick_stop_mm_s2 = 25000.0\nfollowing_error_limit_mm = 2.0\nlead_mm = 10.0\n\
                 standby = {standby}\n[axis.motor]\nrated_torque_nm = 8.0\npeak_torque_nm = 32.0\n\
                 [axis.position_loop]\ngain_per_s = 250.0\n[axis.velocity_loop]\ngain_n_s_per_m = 100000.0\n\
                 integral_time_ms = 10.0\nperiod_us = 2000\n[axis.feed_forward]\nenabled = false\n[axis.reversal]\nmethod = \"none\"\n"
            )
        };
        let text = format!(
            "name = \"model\"\n[scan]\nperiod_us = 2000\ninterpolation_period_scans = {PERIOD_SCANS}\nlook_ahead_periods = 1\n\
             watchdog_scans = 2\nsettle_scans = 2\n[manual]\nreturn_mm_s = 50.0\n{}{}",
            axis("X", self.standby[0]),
            axis("Y", self.standby[1])
        );
        let mut machine = Machine::parse("model", &text).expect("the model's machine");
        machine.restart.servo = self.servo;
        machine.restart.planner = self.planner;
        machine.restart.master = self.master;
        machine
    }
}

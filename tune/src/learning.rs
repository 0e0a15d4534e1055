//! Learns from a run what the model of an axis lacks at its reversals.

use std::collections::VecDeque;

use loops::learned_table::{CELLS, DISTANCE_MAX_MM, LearnedTable, LearnedValue, cell_of};

/// Part of a residual that one pass takes over. The source of docs/methods/physics.md §4 takes 0.7; here the scale of friction takes the
/// large part at once, and what is left is taken slowly, so that a loop's own swing does not build up over passes.
pub const GAIN: f64 = 0.4;
/// Part of what was learned that a pass forgets: a training must be confirmed to stay.
pub const LEAK: f64 = 0.15;
/// Nothing is learned farther from a reversal than this, in mm.
const DISTANCE_LEARNED_MM: f64 = 4.0 * DISTANCE_MAX_MM;
/// Half the span of the difference that gives the acceleration of the deviation, in s.
const DIFFERENCE_S: f64 = 2e-3;
/// Time after a reversal, in s, from which on the loop shows what the model lacks, and not its own swing: six times
/// 1/(300 rad/s) of the velocity loop. What fast reversals hide of the first micrometres slow ones show.
const SHOWN_S: f64 = 0.02;
/// So long a swing of the loop lasts, in s: ten integral times.
const SETTLE_S: f64 = 0.1;
/// Samples a cell must have before it is believed.
const WEIGHT_MIN: f64 = 3.0;

/// One scan of one axis, at the instant its feedback was taken; positions in mm, torques in N·m.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Observation {
    /// Position command.
    pub command_mm: f64,
    /// Motor encoder.
    pub motor_mm: f64,
    /// Linear scale; the motor encoder where there is none.
    pub scale_mm: f64,
    /// Compensation that was on the position command.
    pub compensation_mm: f64,
    /// Torque of the motor.
    pub torque_nm: f64,
    /// Part of it that was fed forward.
    pub fed_forward_nm: f64,
    /// Whether the axis was on a path that is to be exact, at a feed.
    pub counts: bool,
}

/// Cells at the far end that say how high friction is once it has turned round: beyond 0.28 mm.
const FAR_CELLS: usize = 10;
/// Friction is scaled where it is off by more than this part.
const SCALE_STEP_MIN: f64 = 0.03;
/// Bounds of the scale: beyond them the axis is to be tuned, or repaired.
const SCALE_MIN: f64 = 0.4;
const SCALE_MAX: f64 = 2.0;

/// What a training is measured by and may not exceed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrainingLimits {
    /// Coulomb friction of the model as a torque of the motor, in N·m; 0 where it is not fed forward, and so not scaled.
    pub coulomb_nm: f64,
    /// Largest learned torque, in N·m.
    pub torque_nm: f64,
    /// Largest learned lost motion, in mm.
    pub lost_motion_mm: f64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    torque_nm: f64,
    lost_motion_mm: f64,
    weight: f64,
}

/// What one axis shows in a run, over direction and distance since the reversal.
///
/// The residual is what the velocity loop had to add, less what the axis's own deviation from its command took of it:
/// `ΔT = T − T_ff − p·M·(x1 − x1_c)''`; and with a scale the lost motion that was not compensated,
/// `Δl = (x1 − x2) − compensation`, from its mean over both directions. Source: feedback-error learning (Kawato 1987), docs/methods/physics.md §4.
#[derive(Debug, Clone)]
pub struct Learner {
    mass_nm_s2_per_mm: f64,
    scan_s: f64,
    acceleration_max_mm_s2: f64,
    span: usize,
    /// Scans that still pass before what is seen counts.
    unsettled_scans: u32,
    window: VecDeque<Observation>,
    direction: f64,
    distance_mm: f64,
    since_reversal_s: f64,
    cells: [[Cell; CELLS]; 2],
    has_scale: bool,
    square_sum_nm2: f64,
    count: f64,
}

/// What a pass gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Training {
    /// The table after it.
    pub table: LearnedTable,
    /// Root mean square of the residual torque near reversals in this run, in N·m: what the table in force left.
    pub residual_rms_nm: f64,
    /// Samples it rests on.
    pub samples: u64,
}

impl Learner {
    /// For an axis that moves `mass_kg` on `radius_m` of travel per radian. Where the command accelerates by more than
    /// `acceleration_max_mm_s2` (rapids, starts and stops) its steps swing the loop, and shortly after it nothing is learned.
    pub fn new(mass_kg: f64, radius_m: f64, scan_s: f64, acceleration_max_mm_s2: f64) -> Learner {
        Learner {
            mass_nm_s2_per_mm: mass_kg * radius_m * 1e-3,
            scan_s,
            acceleration_max_mm_s2,
            unsettled_scans: 0,
            span: (libm::round(DIFFERENCE_S / scan_s) as usize).max(1),
            window: VecDeque::new(),
            direction: 0.0,
            distance_mm: 0.0,
            since_reversal_s: 0.0,
            cells: [[Cell::default(); CELLS]; 2],
            has_scale: false,
            square_sum_nm2: 0.0,
            count: 0.0,
        }
    }

    /// Takes the next scan; scans follow each other without a gap.
    pub fn take(&mut self, observation: Observation) {
        self.window.push_back(observation);
        if self.window.len() <= 2 * self.span {
            return;
        }
        let at = |index: usize| self.window.get(index).copied().unwrap_or_default();
        let (first, before, here, last) =
            (at(0), at(self.span - 1), at(self.span), at(2 * self.span));
        let step_mm = here.command_mm - before.command_mm;
        if step_mm * self.direction < 0.0 || (self.direction == 0.0 && step_mm != 0.0) {
            self.direction = step_mm.signum();
            self.distance_mm = 0.0;
            self.since_reversal_s = 0.0;
        }
        self.distance_mm += step_mm.abs();
        self.since_reversal_s += self.scan_s;
        let span_s = self.span as f64 * self.scan_s;
        let commanded_mm_s2 =
            (last.command_mm - 2.0 * here.command_mm + first.command_mm) / (span_s * span_s);
        let on_path = self.window.iter().all(|seen| seen.counts);
        if !on_path || commanded_mm_s2.abs() > self.acceleration_max_mm_s2 {
            self.unsettled_scans = libm::ceil(SETTLE_S / self.scan_s) as u32;
        } else {
            self.unsettled_scans = self.unsettled_scans.saturating_sub(1);
        }
        if self.unsettled_scans == 0
            && self.since_reversal_s >= SHOWN_S
            && step_mm != 0.0
            && self.distance_mm <= DISTANCE_LEARNED_MM
        {
            let off = |seen: &Observation| seen.motor_mm - seen.command_mm - seen.compensation_mm;
            let own_mm_s2 = (off(&last) - 2.0 * off(&here) + off(&first)) / (span_s * span_s);
            let torque_nm =
                here.torque_nm - here.fed_forward_nm - self.mass_nm_s2_per_mm * own_mm_s2;
            self.has_scale |= here.scale_mm != here.motor_mm;
            let lost_mm = here.motor_mm - here.scale_mm - here.compensation_mm;
            self.enter(torque_nm, lost_mm);
        }
        self.window.pop_front();
    }

    fn enter(&mut self, torque_nm: f64, lost_motion_mm: f64) {
        if !(torque_nm.is_finite() && lost_motion_mm.is_finite()) {
            return;
        }
        let [negative, positive] = &mut self.cells;
        let cells = if self.direction > 0.0 {
            positive
        } else {
            negative
        };
        let place = cell_of(self.distance_mm);
        let low = libm::floor(place);
        let part = place - low;
        for (index, weight) in [(low as usize, 1.0 - part), (low as usize + 1, part)] {
            if let Some(cell) = cells.get_mut(index) {
                cell.torque_nm += weight * torque_nm;
                cell.lost_motion_mm += weight * lost_motion_mm;
                cell.weight += weight;
            }
        }
        if self.distance_mm <= DISTANCE_MAX_MM {
            self.square_sum_nm2 += torque_nm * torque_nm;
            self.count += 1.0;
        }
    }

    /// Friction that the model lacks where it has turned round, in N·m; none where not both directions were seen.
    fn friction_nm(&self) -> Option<f64> {
        let far = |cells: &[Cell; CELLS]| {
            let seen = cells.iter().skip(CELLS - FAR_CELLS);
            let (sum_nm, weight) =
                seen.fold((0.0, 0.0), |(s, w), c| (s + c.torque_nm, w + c.weight));
            (weight >= WEIGHT_MIN).then_some(sum_nm / weight)
        };
        let [negative, positive] = &self.cells;
        Some(0.5 * (far(positive)? - far(negative)?))
    }

    /// What the run learned: the table after it; the one before where the run shows nothing of a cell.
    ///
    /// Where friction as a whole is off by more than 3 % it is scaled in this pass, for the shape of a wrong height is no
    /// training; otherwise the residuals are taken over.
    pub fn training(&self, table: &LearnedTable, limits: &TrainingLimits) -> Training {
        let residual_rms_nm = libm::sqrt(self.square_sum_nm2 / self.count.max(1.0));
        let part = self
            .friction_nm()
            .filter(|_| limits.coulomb_nm > 0.0)
            .map_or(0.0, |lacking_nm| lacking_nm / limits.coulomb_nm);
        let scale = (table.friction_scale + part).clamp(SCALE_MIN, SCALE_MAX);
        let table = if part.abs() > SCALE_STEP_MIN && scale != table.friction_scale {
            LearnedTable {
                friction_scale: scale,
                ..*table
            }
        } else {
            self.residuals_into(table, limits)
        };
        Training {
            table,
            residual_rms_nm,
            samples: self.count as u64,
        }
    }

    fn residuals_into(&self, table: &LearnedTable, limits: &TrainingLimits) -> LearnedTable {
        // Encoder and scale have no common zero: what both directions share is no lost motion.
        let ends: Vec<f64> = self
            .cells
            .iter()
            .filter_map(|cells| {
                let seen = cells.iter().rev().find(|cell| cell.weight >= WEIGHT_MIN)?;
                Some(seen.lost_motion_mm / seen.weight)
            })
            .collect();
        let common_mm = ends.iter().sum::<f64>() / ends.len().max(1) as f64;
        let learns_lost = self.has_scale && ends.len() == 2;
        let mut next = *table;
        for (cells, values) in self.cells.iter().zip(&mut next.directions) {
            let residual = filled(cells, common_mm);
            let Some(residual) = residual else { continue };
            for (value, index) in values.iter_mut().zip(0..) {
                let smooth = smoothed(&residual, index);
                value.torque_nm = ((1.0 - LEAK) * value.torque_nm + GAIN * smooth.torque_nm)
                    .clamp(-limits.torque_nm, limits.torque_nm);
                if learns_lost {
                    value.lost_motion_mm = ((1.0 - LEAK) * value.lost_motion_mm
                        + GAIN * smooth.lost_motion_mm)
                        .clamp(-limits.lost_motion_mm, limits.lost_motion_mm);
                }
            }
        }
        next
    }
}

/// The mean of every cell. Cells nearer to the reversal than any that was seen teach nothing: what fast reversals hide there
/// must not be guessed. Other cells without samples have that of the nearest before them. None where no cell has any.
fn filled(cells: &[Cell; CELLS], common_mm: f64) -> Option<Vec<LearnedValue>> {
    let mean = |cell: &Cell| {
        (cell.weight >= WEIGHT_MIN).then(|| LearnedValue {
            torque_nm: cell.torque_nm / cell.weight,
            lost_motion_mm: cell.lost_motion_mm / cell.weight - common_mm,
        })
    };
    let mut last = None;
    let values = cells
        .iter()
        .map(|cell| {
            last = mean(cell).or(last);
            last.unwrap_or_default()
        })
        .collect();
    last.map(|_| values)
}

/// ¼, ½, ¼ of a cell and its neighbours.
fn smoothed(values: &[LearnedValue], index: usize) -> LearnedValue {
    let at = |place: usize| values.get(place).copied().unwrap_or_default();
    let last = values.len().saturating_sub(1);
    let (before, here, after) = (
        at(index.saturating_sub(1)),
        at(index),
        at((index + 1).min(last)),
    );
    let mix = |a: f64, b: f64, c: f64| 0.25 * a + 0.5 * b + 0.25 * c;
    LearnedValue {
        torque_nm: mix(before.torque_nm, here.torque_nm, after.torque_nm),
        lost_motion_mm: mix(
            before.lost_motion_mm,
            here.lost_motion_mm,
            after.lost_motion_mm,
        ),
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use super::*;

    const LIMITS: TrainingLimits = TrainingLimits {
        coulomb_nm: 0.7,
        torque_nm: 3.0,
        lost_motion_mm: 0.02,
    };

    /// Slow turns of 5 mm with this torque and lost motion, as functions of direction and distance in mm.
    fn training(
        table: &LearnedTable,
        torque_nm: impl Fn(f64, f64) -> f64,
        lost_mm: impl Fn(f64) -> f64,
    ) -> Training {
        let mut learner = Learner::new(858.0, 1.59e-3, 1e-3, 3000.0);
        let (mut direction, mut turned_at, mut before) = (1.0, 0.0, 0.0);
        for scan in 0..12_000 {
            let command_mm = 5.0 * libm::sin(f64::from(scan) * 1e-3 * 2.0);
            if (command_mm - before) * direction < 0.0 {
                direction = -direction;
                turned_at = before;
            }
            before = command_mm;
            learner.take(Observation {
                command_mm,
                motor_mm: command_mm,
                scale_mm: command_mm - lost_mm(direction),
                torque_nm: torque_nm(direction, (command_mm - turned_at).abs()),
                counts: true,
                ..Observation::default()
            });
        }
        learner.training(table, &LIMITS)
    }

    #[test]
    fn friction_as_a_whole_that_is_off_is_scaled_in_one_pass() {
        let found = training(
            &LearnedTable::default(),
            |direction, _| 0.14 * direction,
            |_| 0.0,
        );
        assert!(
            (found.table.friction_scale - 1.2).abs() < 0.01,
            "{}",
            found.table.friction_scale
        );
        assert_eq!(found.table.directions, LearnedTable::default().directions);
        assert!((found.residual_rms_nm - 0.14).abs() < 0.01);
    }

    #[test]
    fn a_bump_over_distance_and_lost_motion_are_taken_over_by_the_gain() {
        let bump = |direction: f64, mm: f64| 0.2 * direction * libm::exp(-mm / 0.05);
        let found = training(&LearnedTable::default(), bump, |direction| {
            0.003 * direction
        });
        assert_eq!(found.table.friction_scale, 1.0);
        let value = found.table.value(true, 0.05);
        assert!(
            (value.torque_nm - GAIN * bump(1.0, 0.05)).abs() < 0.005,
            "{value:?}"
        );
        assert!(
            (value.lost_motion_mm - GAIN * 0.003).abs() < 1e-4,
            "{value:?}"
        );
        let other = found.table.value(false, 0.05);
        assert!((other.torque_nm + value.torque_nm).abs() < 0.005);
    }

    #[test]
    fn what_is_not_confirmed_is_forgotten() {
        let bump = |direction: f64, mm: f64| 0.2 * direction * libm::exp(-mm / 0.05);
        let mut table = training(&LearnedTable::default(), bump, |_| 0.0).table;
        for _ in 0..20 {
            table = training(&table, |_, _| 0.0, |_| 0.0).table;
        }
        assert!(table.value(true, 0.05).torque_nm.abs() < 0.01);
    }

    #[test]
    fn a_run_off_the_path_teaches_nothing() {
        let mut learner = Learner::new(858.0, 1.59e-3, 1e-3, 3000.0);
        for scan in 0..5000 {
            learner.take(Observation {
                command_mm: 5.0 * libm::sin(f64::from(scan) * 2e-3),
                torque_nm: 1.0,
                ..Observation::default()
            });
        }
        let found = learner.training(&LearnedTable::default(), &LIMITS);
        assert_eq!((found.samples, found.table), (0, LearnedTable::default()));
    }
}

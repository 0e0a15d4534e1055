//! Windows of setpoints: intended motion, then braking to rest along the same path.
//!
//! A window starts from the state of the setpoint before it and depends on that state and the request alone. Its setpoints
//! are those of the window before wherever they overlap and nothing was asked to change, to the increment.
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::panic
)]

use std::sync::Arc;

use thiserror::Error;

use crate::envelope::{Envelope, EnvelopeKey};
use crate::limits::MotionLimits;
use crate::path::{Element, MAX_AXES, Path};
use crate::path_part::PathPart;
use crate::positioning::Positioning;
use crate::profile::{PathState, Traveller};
use crate::speed_map::{MapError, MapSettings, SpeedMap};

/// One scan of setpoints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedSetpoint {
    /// Position of every axis, in increments: the path at the state's place, as [`MotionLimits::setpoint`] makes it.
    pub position_increments: [i64; MAX_AXES],
    /// Place and speed at this setpoint. Element, distance and remaining dwell are its path tag; a window that replaces this
    /// one after this setpoint starts from here.
    pub state: PathState,
}

/// What windows are to be like, for a whole run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowSettings {
    /// Most setpoints of intended motion asked for.
    pub intended_setpoints_max: u32,
    /// Most setpoints that brake after them. Path speed is limited so that they suffice.
    pub braking_setpoints_max: u32,
    /// Highest override that is obeyed; 1 is the programmed feed.
    pub override_max: f64,
}

/// What one window is to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowRequest {
    /// Setpoints of intended motion; less come out where the program ends.
    pub intended_setpoints: u32,
    /// Share of feeds and rapids to travel at, from 0 (hold) to the highest override; NaN holds.
    pub feed_override: f64,
    /// Brake now and stay at rest.
    pub hold: bool,
    /// Stop at the end of each block that can still be reached at rest, and wait there for a start.
    pub single_block: bool,
    /// Go on from the end of a block. Ask once: it starts what `from` waits for, not what comes to wait later.
    pub start: bool,
    /// Setpoint 0 is `from` itself, which is at rest: the first window after *no window*.
    pub repeats_start: bool,
    /// The first element that is not begun yet: motion rests before it. It, or the next one that has a length or waits, is one
    /// that [rests before](crate::path::Element::rests_before) it; the number of elements holds back at the end of the path.
    pub until_element: u32,
}

impl Default for WindowRequest {
    fn default() -> Self {
        Self {
            intended_setpoints: 0,
            feed_override: 1.0,
            hold: false,
            single_block: false,
            start: false,
            repeats_start: false,
            until_element: u32::MAX,
        }
    }
}

/// What a window came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WindowOutcome {
    /// Setpoints of intended motion.
    pub intended_setpoints: u32,
    /// All setpoints. The last two have the same positions.
    pub setpoint_count: u32,
    /// Whether the last intended setpoint is the end of the program.
    pub ends_program: bool,
}

/// Why there is no window. The machine then stops on the path, at the end of the window in force.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PlanError {
    /// The path and the limits do not make a plan.
    #[error(transparent)]
    Map(#[from] MapError),
    /// Settings that no window can keep.
    #[error(
        "{braking_setpoints_max} setpoints to brake in: a window needs at least {BRAKING_ROWS_MIN}"
    )]
    BrakingSetpoints {
        /// What was found.
        braking_setpoints_max: u32,
    },
    /// A state that is not on the path.
    #[error("element {element} at {distance_mm} mm and {speed_mm_s} mm/s is not on the path")]
    State {
        /// Index of the element.
        element: u32,
        /// Distance along it, in mm.
        distance_mm: f64,
        /// Speed, in mm/s.
        speed_mm_s: f64,
    },
    /// The path is not known far enough ahead: more of it has to be added first.
    #[error("the path is not known far enough ahead")]
    NotAtHand,
    /// A state too fast for the path, which no window of this planner ever had.
    #[error("braking from element {element} takes more than {braking_setpoints_max} setpoints")]
    DoesNotStop {
        /// Index of the element where braking starts.
        element: u32,
        /// Setpoints there are.
        braking_setpoints_max: u32,
    },
}

/// Fewest setpoints to brake in.
const BRAKING_ROWS_MIN: u32 = 8;
/// Of the braking setpoints: one for the scan in which braking ends, one that repeats it, one for rounding.
const REST_ROWS: u32 = 3;

/// Plans windows along one path, as far as it is at hand. Owns all it needs; planning does not allocate.
#[derive(Debug, Clone)]
pub struct WindowPlanner {
    part: PathPart,
    settings: WindowSettings,
    map: SpeedMap,
    envelope: Envelope,
}

/// Elements that stay at hand behind the tool.
const BEHIND_ELEMENTS: u32 = 1024;

impl WindowPlanner {
    /// Maps a whole path.
    pub fn new(
        path: impl Into<Arc<Path>>,
        limits: MotionLimits,
        settings: WindowSettings,
    ) -> Result<Self, PlanError> {
        Self::with_positioning(path, limits, settings, None)
    }

    /// The same with single rapids from rest to rest at least heat, where `positioning` is given.
    pub fn with_positioning(
        path: impl Into<Arc<Path>>,
        limits: MotionLimits,
        settings: WindowSettings,
        positioning: Option<&Positioning>,
    ) -> Result<Self, PlanError> {
        let mut planner = Self::of_part(limits, settings, positioning, 0, 0.0)?;
        let override_max = planner.map.override_max();
        planner.part = PathPart::whole(&path.into(), planner.limits(), override_max)?;
        planner.map_on();
        Ok(planner)
    }

    /// A planner along a path of which nothing is at hand yet, that goes on with the element `first`; `start_mm` of the path lie before it.
    ///
    /// # Errors
    /// [`PlanError::BrakingSetpoints`].
    pub fn of_part(
        limits: MotionLimits,
        settings: WindowSettings,
        positioning: Option<&Positioning>,
        first: u32,
        start_mm: f64,
    ) -> Result<Self, PlanError> {
        let braking_setpoints_max = settings.braking_setpoints_max;
        if braking_setpoints_max < BRAKING_ROWS_MIN {
            return Err(PlanError::BrakingSetpoints {
                braking_setpoints_max,
            });
        }
        let of_map = MapSettings {
            override_max: settings.override_max,
            braking_setpoints_max: braking_setpoints_max - REST_ROWS,
        };
        let map = SpeedMap::empty(&of_map, positioning, first);
        Ok(Self {
            envelope: Envelope::new(),
            part: PathPart::new(&limits, map.override_max(), first, start_mm),
            settings,
            map,
        })
    }

    /// Adds the next element of the path. It counts once [`WindowPlanner::map_on`] has been called.
    ///
    /// # Errors
    /// [`PlanError::Map`]: it cannot be travelled, and is not added.
    pub fn push(&mut self, element: Element) -> Result<(), PlanError> {
        Ok(self.part.push(element)?)
    }

    /// Nothing comes after what was added.
    pub fn finish(&mut self) {
        self.part.finish();
    }

    /// Maps what was added, as far as what is known of the path allows.
    pub fn map_on(&mut self) {
        self.part.round_on();
        self.map.extend(&self.part);
        self.envelope.follow(&self.map);
    }

    /// Lets go of what the tool has behind it on its way through this element, but for a little.
    pub fn forget_behind(&mut self, element: u32) {
        let keep_from = element.saturating_sub(BEHIND_ELEMENTS);
        self.map.forget_before(keep_from);
        self.envelope.follow(&self.map);
        self.part
            .forget_before(keep_from.min(self.map.needs_from()));
    }

    /// The path it plans along, as far as it is at hand.
    pub fn path(&self) -> &PathPart {
        &self.part
    }

    /// The limits it keeps.
    pub fn limits(&self) -> &MotionLimits {
        self.part.limits()
    }

    /// Where the path is slow, and why.
    pub fn speed_map(&self) -> &SpeedMap {
        &self.map
    }

    /// Most setpoints a window can have.
    pub fn setpoints_max(&self) -> usize {
        self.settings.intended_setpoints_max as usize
            + self.settings.braking_setpoints_max as usize
            + 1
    }

    /// The setpoint of a state: what the machine's command position should hold there.
    pub fn setpoint(&self, state: &PathState) -> Option<PlannedSetpoint> {
        let element = self.part.get(state.element)?;
        Some(PlannedSetpoint {
            position_increments: self.limits().setpoint(element, state.distance_mm),
            state: *state,
        })
    }

    /// The state at rest at the start of the path.
    pub fn start_state(&self) -> PathState {
        let first = self.map.segment(0);
        let waits = first.filter(|segment| segment.is_dwell && segment.element == 0);
        PathState {
            dwell_remaining_scans: waits.map_or(0, |segment| segment.dwell_scans),
            ..PathState::default()
        }
    }

    /// The state at rest at the end of what is at hand of the path.
    pub fn end_state(&self) -> PathState {
        PathState {
            element: self.part.end().saturating_sub(1),
            distance_mm: self.part.last().map_or(0.0, |last| last.length_mm),
            ..PathState::default()
        }
    }

    /// Whether motion from this state goes no further before this element is [begun](WindowRequest::until_element).
    pub fn is_held_back(&self, state: &PathState, until_element: u32) -> bool {
        let scan_period_s = self.limits().scan_period_s();
        let at = Traveller::new(&self.map, scan_period_s, *state, until_element);
        state.is_at_rest() && at.is_held_back()
    }

    /// Whether this state is the end of the path: nothing is left to do there.
    pub fn is_end(&self, state: &PathState) -> bool {
        let (end, last) = (self.part.end(), self.part.last());
        let at_length = last.is_some_and(|element| state.distance_mm >= element.length_mm);
        self.part.is_complete()
            && state.element == end.saturating_sub(1)
            && at_length
            && state.dwell_remaining_scans == 0
            && state.is_at_rest()
    }

    /// Fills `setpoints` with the window that follows `from`: the state of the setpoint executed one scan before setpoint 0, or, with
    /// [`WindowRequest::repeats_start`], of setpoint 0 itself.
    pub fn plan(
        &mut self,
        from: &PathState,
        request: &WindowRequest,
        setpoints: &mut Vec<PlannedSetpoint>,
    ) -> Result<WindowOutcome, PlanError> {
        setpoints.clear();
        if !self.is_mapped(from.element) {
            return Err(PlanError::NotAtHand);
        }
        let mut before = self.start(from, request)?;
        let feed_override = if request.hold || request.feed_override.is_nan() {
            0.0
        } else {
            request.feed_override.clamp(0.0, self.map.override_max())
        };
        self.envelope.select(EnvelopeKey {
            feed_override,
            single_block: request.single_block,
        });
        let mut traveller = Traveller::new(
            &self.map,
            self.part.limits().scan_period_s(),
            before.state,
            request.until_element,
        );
        let mut ends_program = false;
        let intended_setpoints_max = request
            .intended_setpoints
            .min(self.settings.intended_setpoints_max)
            as usize;
        while setpoints.len() < intended_setpoints_max {
            if !(request.repeats_start && setpoints.is_empty()) {
                traveller.go(&mut self.envelope);
            }
            before = setpoint_at(&self.part, &traveller.state);
            setpoints.push(before);
            ends_program = traveller.is_at_end() && !traveller.is_held_back();
            if ends_program {
                break;
            }
        }
        if traveller.ran_short() || self.envelope.ran_short() {
            setpoints.clear();
            return Err(PlanError::NotAtHand);
        }
        let intended_setpoints = setpoints.len() as u32;
        let braked = self.brake(&mut traveller, before, setpoints);
        if let Err(error) = braked {
            setpoints.clear();
            return Err(error);
        }
        Ok(WindowOutcome {
            intended_setpoints,
            setpoint_count: setpoints.len() as u32,
            ends_program,
        })
    }

    /// Adds the setpoints that brake to rest, the last of them twice.
    fn brake(
        &self,
        traveller: &mut Traveller<'_>,
        mut before: PlannedSetpoint,
        setpoints: &mut Vec<PlannedSetpoint>,
    ) -> Result<(), PlanError> {
        let element = traveller.state.element;
        let braking_setpoints_max = self.settings.braking_setpoints_max;
        let setpoints_max = setpoints.len() + braking_setpoints_max as usize;
        while setpoints.len() < setpoints_max {
            traveller.brake();
            if traveller.ran_short() {
                return Err(PlanError::NotAtHand);
            }
            let setpoint = setpoint_at(&self.part, &traveller.state);
            setpoints.push(setpoint);
            if traveller.state.is_at_rest()
                && setpoint.position_increments == before.position_increments
            {
                return Ok(());
            }
            before = setpoint;
        }
        Err(PlanError::DoesNotStop {
            element,
            braking_setpoints_max,
        })
    }

    /// Time from a state to the end of a path that is at hand as a whole, in s. It is not planned scan by scan, so its length takes no time.
    ///
    /// # Errors
    /// [`PlanError::State`], and [`PlanError::NotAtHand`] where the end is not at hand.
    pub fn time_to_end_s(
        &mut self,
        from: &PathState,
        feed_override: f64,
    ) -> Result<f64, PlanError> {
        let start = self.start(from, &WindowRequest::default())?;
        self.envelope.select(EnvelopeKey {
            feed_override: feed_override.clamp(0.0, self.map.override_max()),
            single_block: false,
        });
        let scan_period_s = self.part.limits().scan_period_s();
        let mut traveller = Traveller::new(&self.map, scan_period_s, start.state, u32::MAX);
        let time_s = traveller.time_to_end_s(&mut self.envelope);
        if traveller.is_at_end() {
            Ok(time_s)
        } else {
            Err(PlanError::NotAtHand)
        }
    }

    /// Whether the speed map holds an element, or the path has none of this number.
    pub fn is_mapped(&self, element: u32) -> bool {
        self.map.is_complete() || self.map.reaches(element)
    }

    /// The setpoint of a state that a window can start from.
    fn start(
        &self,
        from: &PathState,
        request: &WindowRequest,
    ) -> Result<PlannedSetpoint, PlanError> {
        let on_path = self
            .part
            .get(from.element)
            .is_some_and(|element| (0.0..=element.length_mm).contains(&from.distance_mm));
        let speed_fits = from.speed_mm_s >= 0.0
            && from.speed_mm_s.is_finite()
            && (from.is_at_rest() || !request.repeats_start);
        let mut setpoint = match self.setpoint(from) {
            Some(setpoint) if on_path && speed_fits => setpoint,
            _ => {
                return Err(PlanError::State {
                    element: from.element,
                    distance_mm: from.distance_mm,
                    speed_mm_s: from.speed_mm_s,
                });
            }
        };
        setpoint.state.waits_for_start &= !request.start;
        Ok(setpoint)
    }
}

fn setpoint_at(part: &PathPart, state: &PathState) -> PlannedSetpoint {
    let position_increments = match part.get(state.element) {
        Some(element) => part.limits().setpoint(element, state.distance_mm),
        None => [0; MAX_AXES],
    };
    PlannedSetpoint {
        position_increments,
        state: *state,
    }
}

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
use crate::path::{MAX_AXES, Path};
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

/// Plans windows along one path. Owns all it needs; planning does not allocate.
#[derive(Debug, Clone)]
pub struct WindowPlanner {
    path: Arc<Path>,
    limits: MotionLimits,
    settings: WindowSettings,
    map: SpeedMap,
    envelope: Envelope,
}

impl WindowPlanner {
    /// Makes the speed map of a path.
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
        let path = path.into();
        let braking_setpoints_max = settings.braking_setpoints_max;
        if braking_setpoints_max < BRAKING_ROWS_MIN {
            return Err(PlanError::BrakingSetpoints {
                braking_setpoints_max,
            });
        }
        let map = SpeedMap::with_positioning(
            &path,
            &limits,
            &MapSettings {
                override_max: settings.override_max,
                braking_setpoints_max: braking_setpoints_max - REST_ROWS,
            },
            positioning,
        )?;
        Ok(Self {
            envelope: Envelope::new(&map),
            path,
            limits,
            settings,
            map,
        })
    }

    /// The path it plans along.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The limits it keeps.
    pub fn limits(&self) -> &MotionLimits {
        &self.limits
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
        let element = self.path.elements.get(state.element as usize)?;
        Some(PlannedSetpoint {
            position_increments: self.limits.setpoint(element, state.distance_mm),
            state: *state,
        })
    }

    /// The state at rest at the start of the path.
    pub fn start_state(&self) -> PathState {
        let first = self.map.segments.first();
        let waits = first.filter(|segment| segment.is_dwell && segment.element == 0);
        PathState {
            dwell_remaining_scans: waits.map_or(0, |segment| segment.dwell_scans),
            ..PathState::default()
        }
    }

    /// Whether motion from this state goes no further before this element is [begun](WindowRequest::until_element).
    pub fn is_held_back(&self, state: &PathState, until_element: u32) -> bool {
        let scan_period_s = self.limits.scan_period_s();
        let at = Traveller::new(&self.map, scan_period_s, *state, until_element);
        state.is_at_rest() && at.is_held_back()
    }

    /// Whether this state is the end of the path: nothing is left to do there.
    pub fn is_end(&self, state: &PathState) -> bool {
        let last = self.path.elements.len().saturating_sub(1);
        let at_length = self
            .path
            .elements
            .last()
            .is_some_and(|element| state.distance_mm >= element.length_mm);
        state.element as usize == last
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
            self.limits.scan_period_s(),
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
            before = setpoint_at(&self.path, &self.limits, &traveller.state);
            setpoints.push(before);
            ends_program = traveller.is_at_end() && !traveller.is_held_back();
            if ends_program {
                break;
            }
        }
        let intended_setpoints = setpoints.len() as u32;
        let braking_from = traveller.state.element;
        loop {
            traveller.brake();
            let setpoint = setpoint_at(&self.path, &self.limits, &traveller.state);
            setpoints.push(setpoint);
            if traveller.state.is_at_rest()
                && setpoint.position_increments == before.position_increments
            {
                break;
            }
            before = setpoint;
            if setpoints.len()
                >= intended_setpoints as usize + self.settings.braking_setpoints_max as usize
            {
                setpoints.clear();
                return Err(PlanError::DoesNotStop {
                    element: braking_from,
                    braking_setpoints_max: self.settings.braking_setpoints_max,
                });
            }
        }
        Ok(WindowOutcome {
            intended_setpoints,
            setpoint_count: setpoints.len() as u32,
            ends_program,
        })
    }

    /// The setpoint of a state that a window can start from.
    fn start(
        &self,
        from: &PathState,
        request: &WindowRequest,
    ) -> Result<PlannedSetpoint, PlanError> {
        let on_path = self
            .path
            .elements
            .get(from.element as usize)
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

fn setpoint_at(path: &Path, limits: &MotionLimits, state: &PathState) -> PlannedSetpoint {
    let position_increments = match path.elements.get(state.element as usize) {
        Some(element) => limits.setpoint(element, state.distance_mm),
        None => [0; MAX_AXES],
    };
    PlannedSetpoint {
        position_increments,
        state: *state,
    }
}

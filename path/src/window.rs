//! Windows of setpoints: intended motion, then braking to rest along the same path.
//!
//! A window starts from the state of the setpoint before it and depends on that state and the request alone. Its setpoints
//! are those of the window before wherever they overlap and nothing was asked to change, to the increment.
use std::sync::Arc;

use thiserror::Error;

use crate::envelope::{Envelope, EnvelopeKey};
use crate::geometry::{Element, PATH_AXES, Path};
use crate::limits::MotionLimits;
use crate::path_part::{Laid, PathPart};
use crate::positioning::Positioning;
use crate::profile::{PathState, Traveller};
pub use crate::smoothing::Lead;
use crate::smoothing::Trail;
use crate::speed_map::{MapError, MapSettings, SpeedMap};

/// One scan of setpoints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedSetpoint {
    /// Position of every axis, in increments: the path at the state's place, as [`MotionLimits::setpoint`] makes it.
    pub position_increments: [i64; PATH_AXES],
    /// Place and speed at this setpoint. Element, distance and remaining dwell are its path tag; a window that replaces this
    /// one after this setpoint starts from here.
    pub state: PathState,
    /// What leads it: the same where motion along the path is not smoothed.
    pub lead: Lead,
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
    /// Elements of the path that can be read in a second while the tool moves: it passes no more. Infinite where all of them are at hand.
    pub elements_per_s_max: f64,
}

/// What one window is to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowRequest {
    /// Setpoints of intended motion; less come out where the program ends.
    pub intended_setpoints: u32,
    /// Share of feeds and rapids to travel at, from 0 (hold) to the highest override; NaN holds.
    pub feed_override: f64,
    /// Share of rapids to travel at beside that, from 0 to 1.
    pub rapid_override: f64,
    /// Brake now and stay at rest.
    pub hold: bool,
    /// Stop at the end of each block that can still be reached at rest, and wait there for a start.
    pub single_block: bool,
    /// Go on from the end of a block. Ask once: it starts what `from` waits for, not what comes to wait later.
    pub start: bool,
    /// Setpoint 0 is `from` itself, which is at rest: the first window after *no window*.
    pub repeats_start: bool,
    /// The first element that is not begun yet: motion rests before it. It, or the next one that has a length or waits, is one
    /// that [rests before](crate::geometry::Element::rests_before) it; the number of elements holds back at the end of the path.
    pub until_element: u32,
}

impl Default for WindowRequest {
    fn default() -> Self {
        Self {
            intended_setpoints: 0,
            feed_override: 1.0,
            rapid_override: 1.0,
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
    #[error("{braking_setpoints_max} setpoints to brake in: a window needs at least {rows_min}")]
    BrakingSetpoints {
        /// What was found.
        braking_setpoints_max: u32,
        /// How many it takes, those by which the tool comes later than what leads it among them.
        rows_min: u32,
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
    trail: Trail,
}

/// Elements that stay at hand behind the tool.
const BEHIND_ELEMENTS: u32 = 1024;

impl WindowPlanner {
    /// Maps a whole path; single rapids from rest to rest are of least heat where `positioning` is given.
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
        let rows_min = BRAKING_ROWS_MIN + limits.smoothing_scans();
        if braking_setpoints_max < rows_min {
            return Err(PlanError::BrakingSetpoints {
                braking_setpoints_max,
                rows_min,
            });
        }
        let of_map = MapSettings {
            override_max: settings.override_max,
            braking_setpoints_max: braking_setpoints_max - REST_ROWS - limits.smoothing_scans(),
            elements_per_s_max: settings.elements_per_s_max,
        };
        let map = SpeedMap::empty(&of_map, positioning, first);
        Ok(Self {
            envelope: Envelope::new(),
            trail: Trail::new(limits.smoothing_scans()),
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
        self.part.get(state.element)?;
        Some(setpoint_at(&self.part, state, &Lead::at(&self.part, state)))
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
        let at = Traveller::new(&self.map, self.limits(), *state, until_element);
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
    /// [`WindowRequest::repeats_start`], of setpoint 0 itself. Where motion along the path is smoothed, `from` is at rest.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn plan(
        &mut self,
        from: &PathState,
        request: &WindowRequest,
        setpoints: &mut Vec<PlannedSetpoint>,
    ) -> Result<WindowOutcome, PlanError> {
        self.plan_behind(from, &[], request, setpoints)
    }

    /// The same where motion along the path is smoothed: `before` are the leads of the setpoints before the window, the last of them that of
    /// `from`; at least as many as [`MotionLimits::smoothing_scans`] and one, or all since a rest.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn plan_behind(
        &mut self,
        from: &PathState,
        before: &[Lead],
        request: &WindowRequest,
        setpoints: &mut Vec<PlannedSetpoint>,
    ) -> Result<WindowOutcome, PlanError> {
        setpoints.clear();
        // Whoever rests has nothing ahead of it.
        let before = if from.is_at_rest() { &[] } else { before };
        // Limits bind what leads, planned without smoothing; the tool follows it as the average over the trail.
        let lead = before.last().map_or(*from, |lead| lead.state);
        if !self.is_mapped(from.element) || !self.is_mapped(lead.element) {
            return Err(PlanError::NotAtHand);
        }
        let start = self.start(from, request)?;
        let lead = PathState {
            waits_for_start: lead.waits_for_start && !request.start,
            ..lead
        };
        match before {
            [] => self.trail.rest_at(start.lead.along_mm),
            leads => self.trail.follow(leads),
        }
        // Speeds over the path hold for an override: the envelope is made again only where that has changed.
        self.envelope.select(self.key(request));
        let limits = self.part.limits();
        let mut scans = Scans {
            part: &self.part,
            tool: On::element(&self.part, start.state.element),
            lead: On::element(&self.part, lead.element),
            traveller: Traveller::new(&self.map, limits, lead, request.until_element),
            trail: &mut self.trail,
            before: start.state,
        };
        let mut ends_program = false;
        let intended_setpoints_max = request
            .intended_setpoints
            .min(self.settings.intended_setpoints_max)
            as usize;
        while setpoints.len() < intended_setpoints_max {
            if request.repeats_start && setpoints.is_empty() {
                scans.before = lead;
                setpoints.push(setpoint_at(&self.part, &lead, &Lead::at(&self.part, &lead)));
            } else {
                scans.traveller.go(&mut self.envelope);
                scans.follow(setpoints);
            }
            let traveller = &scans.traveller;
            ends_program =
                traveller.is_at_end() && !traveller.is_held_back() && scans.trail.is_settled();
            if ends_program {
                break;
            }
        }
        // Speeds beyond what is known are guesses: such a window is thrown away rather than handed on.
        if scans.traveller.ran_short || self.envelope.ran_short {
            setpoints.clear();
            return Err(PlanError::NotAtHand);
        }
        let intended_setpoints = setpoints.len() as u32;
        // A window always ends at rest: if no other comes, the machine stops on the path.
        let before = setpoints.last().unwrap_or(&start).position_increments;
        let braking_setpoints_max = self.settings.braking_setpoints_max;
        let braked = scans.brake(braking_setpoints_max, before, setpoints);
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
            rapid_override: 1.0,
            single_block: false,
        });
        let mut traveller = Traveller::new(&self.map, self.part.limits(), start.state, u32::MAX);
        let time_s = traveller.time_to_end_s(&mut self.envelope);
        if traveller.is_at_end() {
            Ok(time_s)
        } else {
            Err(PlanError::NotAtHand)
        }
    }

    /// Whether the speed map holds all that motion from an element depends on, or the path has none of this number.
    pub fn is_mapped(&self, element: u32) -> bool {
        self.map.is_mapped(element)
    }

    /// The lowest path speed that the tool is held to because no more of the path is looked at, or read in time; none where it is not.
    pub fn speed_limited_by_look_ahead_mm_s(&self) -> Option<f64> {
        let limits = [self.map.limited_by_reading_mm_s, self.envelope.limited_mm_s];
        limits.into_iter().flatten().reduce(f64::min)
    }

    /// What the envelope of a window is computed for.
    fn key(&self, request: &WindowRequest) -> EnvelopeKey {
        let holds = request.hold || request.feed_override.is_nan();
        EnvelopeKey {
            feed_override: match holds {
                true => 0.0,
                false => request.feed_override.clamp(0.0, self.map.override_max()),
            },
            rapid_override: request.rapid_override.clamp(0.0, 1.0),
            single_block: request.single_block,
        }
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

/// An element that something is on, and where the next begins: looked up once, not in every scan.
struct On<'a> {
    element: u32,
    laid: Option<&'a Laid>,
    /// None where there is none.
    next_mm: Option<f64>,
}

impl<'a> On<'a> {
    fn element(part: &'a PathPart, element: u32) -> Self {
        let next = element.checked_add(1).and_then(|next| part.laid(next));
        Self {
            element,
            laid: part.laid(element),
            next_mm: next.map(|laid| laid.start_mm),
        }
    }

    fn go_to(&mut self, part: &'a PathPart, element: u32) {
        if self.element != element {
            *self = Self::element(part, element);
        }
    }
}

/// A window that is being planned, scan by scan.
struct Scans<'a> {
    part: &'a PathPart,
    traveller: Traveller<'a>,
    trail: &'a mut Trail,
    /// The state of the setpoint of the scan before.
    before: PathState,
    /// Where that is.
    tool: On<'a>,
    /// Where the traveller is.
    lead: On<'a>,
}

impl Scans<'_> {
    /// Adds the setpoint of the tool, which follows what the traveller has done in a scan; its position.
    #[inline]
    fn follow(&mut self, setpoints: &mut Vec<PlannedSetpoint>) -> [i64; PATH_AXES] {
        let state = self.traveller.state;
        self.lead.go_to(self.part, state.element);
        let start_mm = self.lead.laid.map(|laid| laid.start_mm);
        let lead = Lead {
            state,
            along_mm: start_mm.unwrap_or(self.part.length_mm()) + state.distance_mm,
        };
        self.trail.push(lead.along_mm);
        let state = if self.trail.is_settled() {
            lead.state
        } else {
            self.behind(&lead.state)
        };
        self.tool.go_to(self.part, state.element);
        let limits = self.part.limits();
        let increments = |laid: &Laid| limits.setpoint(&laid.element, state.distance_mm);
        self.before = state;
        let position_increments = self.tool.laid.map_or([0; PATH_AXES], increments);
        setpoints.push(PlannedSetpoint {
            position_increments,
            state,
            lead,
        });
        position_increments
    }

    /// Where the tool is, at the average of the trail, on its way from the state before to the lead.
    fn behind(&mut self, lead: &PathState) -> PathState {
        let from = self.before;
        let along_mm = self.trail.average_mm();
        self.tool.go_to(self.part, from.element);
        if self.tool.next_mm.is_some_and(|next_mm| next_mm <= along_mm) {
            let mut element = from.element;
            // Elements without length begin where the next one does: the tool goes on to one that moves.
            for next in from.element.saturating_add(1)..=lead.element {
                let begun = self
                    .part
                    .laid(next)
                    .filter(|laid| laid.start_mm <= along_mm);
                match begun {
                    Some(laid) if laid.moves() => element = next,
                    Some(_) => {}
                    None => break,
                }
            }
            self.tool.go_to(self.part, element);
        }
        let element = self.tool.element;
        let (start_mm, length_mm) = self.tool.laid.map_or((along_mm, 0.0), |laid| {
            (laid.start_mm, laid.element.length_mm)
        });
        let distance_max_mm = if element == lead.element {
            lead.distance_mm
        } else {
            length_mm
        };
        PathState {
            element,
            // Rounded down, it could be a last bit behind where it rested.
            distance_mm: (along_mm - start_mm)
                .max(if element == from.element {
                    from.distance_mm
                } else {
                    0.0
                })
                .min(distance_max_mm),
            // It moves, however slowly.
            speed_mm_s: self
                .trail
                .speed_mm_s(self.part.limits().scan_period_s())
                .max(f64::MIN_POSITIVE),
            ..PathState::default()
        }
    }

    /// Adds the setpoints that brake to rest, the last of them twice.
    fn brake(
        &mut self,
        braking_setpoints_max: u32,
        from_increments: [i64; PATH_AXES],
        setpoints: &mut Vec<PlannedSetpoint>,
    ) -> Result<(), PlanError> {
        let mut before = from_increments;
        let element = self.traveller.state.element;
        let setpoints_max = setpoints.len() + braking_setpoints_max as usize;
        // The increments tell rest as well: drives must see a speed of zero at the end of the window.
        while setpoints.len() < setpoints_max {
            self.traveller.brake();
            if self.traveller.ran_short {
                return Err(PlanError::NotAtHand);
            }
            let after = self.follow(setpoints);
            if self.traveller.state.is_at_rest() && self.trail.is_settled() && after == before {
                return Ok(());
            }
            before = after;
        }
        Err(PlanError::DoesNotStop {
            element,
            braking_setpoints_max,
        })
    }
}

fn setpoint_at(part: &PathPart, state: &PathState, lead: &Lead) -> PlannedSetpoint {
    let position_increments = match part.get(state.element) {
        Some(element) => part.limits().setpoint(element, state.distance_mm),
        None => [0; PATH_AXES],
    };
    PlannedSetpoint {
        position_increments,
        state: *state,
        lead: *lead,
    }
}

//! Windows of setpoints: intended motion, then braking to rest along the same path.
//!
//! A window starts from the state of the row before it and depends on that state and the request alone. Its rows
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
pub struct Row {
    /// Position of every axis, in increments: the path at the state's place, as [`MotionLimits::row`] makes it.
    pub position_increments: [i64; MAX_AXES],
    /// Place and speed at this row. Element, distance and remaining dwell are its path tag; a window that replaces this
    /// one after this row starts from here.
    pub state: PathState,
}

/// What windows are to be like, for a whole run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowSettings {
    /// Most rows of intended motion asked for.
    pub intended_rows_max: u32,
    /// Most rows that brake after them. Path speed is limited so that they suffice.
    pub braking_rows_max: u32,
    /// Highest override that is obeyed; 1 is the programmed feed.
    pub override_max: f64,
}

/// What one window is to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowRequest {
    /// Rows of intended motion; less come out where the program ends.
    pub intended_rows: u32,
    /// Share of feeds and rapids to travel at, from 0 (hold) to the highest override; NaN holds.
    pub feed_override: f64,
    /// Brake now and stay at rest.
    pub hold: bool,
    /// Stop at the end of each block that can still be reached at rest, and wait there for a start.
    pub single_block: bool,
    /// Go on from the end of a block. Ask once: it starts what `from` waits for, not what comes to wait later.
    pub start: bool,
    /// Row 0 is `from` itself, which is at rest: the first window after *no window*.
    pub repeats_start: bool,
}

impl Default for WindowRequest {
    fn default() -> Self {
        Self {
            intended_rows: 0,
            feed_override: 1.0,
            hold: false,
            single_block: false,
            start: false,
            repeats_start: false,
        }
    }
}

/// What a window came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WindowOutcome {
    /// Rows of intended motion.
    pub intended_rows: u32,
    /// All rows. The last two have the same positions.
    pub row_count: u32,
    /// Whether the last intended row is the end of the program.
    pub ends_program: bool,
}

/// Why there is no window. The machine then stops on the path, at the end of the window in force.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PlanError {
    /// The path and the limits do not make a plan.
    #[error(transparent)]
    Map(#[from] MapError),
    /// Settings that no window can keep.
    #[error("{braking_rows_max} rows to brake in: a window needs at least {BRAKING_ROWS_MIN}")]
    BrakingRows {
        /// What was found.
        braking_rows_max: u32,
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
    #[error("braking from element {element} takes more than {braking_rows_max} rows")]
    DoesNotStop {
        /// Index of the element where braking starts.
        element: u32,
        /// Rows there are.
        braking_rows_max: u32,
    },
}

/// Fewest rows to brake in.
const BRAKING_ROWS_MIN: u32 = 8;
/// Of the braking rows: one for the scan in which braking ends, one that repeats it, one for rounding.
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
        let braking_rows_max = settings.braking_rows_max;
        if braking_rows_max < BRAKING_ROWS_MIN {
            return Err(PlanError::BrakingRows { braking_rows_max });
        }
        let map = SpeedMap::with_positioning(
            &path,
            &limits,
            &MapSettings {
                override_max: settings.override_max,
                braking_rows_max: braking_rows_max - REST_ROWS,
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

    /// Most rows a window can have.
    pub fn rows_max(&self) -> usize {
        self.settings.intended_rows_max as usize + self.settings.braking_rows_max as usize + 1
    }

    /// The row of a state: what the machine's command register should hold there.
    pub fn row(&self, state: &PathState) -> Option<Row> {
        let element = self.path.elements.get(state.element as usize)?;
        Some(Row {
            position_increments: self.limits.row(element, state.distance_mm),
            state: *state,
        })
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

    /// Fills `rows` with the window that follows `from`: the state of the row executed one scan before row 0, or, with
    /// [`WindowRequest::repeats_start`], of row 0 itself.
    pub fn plan(
        &mut self,
        from: &PathState,
        request: &WindowRequest,
        rows: &mut Vec<Row>,
    ) -> Result<WindowOutcome, PlanError> {
        rows.clear();
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
        let mut traveller = Traveller::new(&self.map, self.limits.scan_period_s(), before.state);
        let mut ends_program = false;
        let intended_rows_max = request.intended_rows.min(self.settings.intended_rows_max) as usize;
        while rows.len() < intended_rows_max {
            if !(request.repeats_start && rows.is_empty()) {
                traveller.go(&mut self.envelope);
            }
            before = row_at(&self.path, &self.limits, &traveller.state);
            rows.push(before);
            ends_program = traveller.is_at_end();
            if ends_program {
                break;
            }
        }
        let intended_rows = rows.len() as u32;
        let braking_from = traveller.state.element;
        loop {
            traveller.brake();
            let row = row_at(&self.path, &self.limits, &traveller.state);
            rows.push(row);
            if traveller.state.is_at_rest() && row.position_increments == before.position_increments
            {
                break;
            }
            before = row;
            if rows.len() >= intended_rows as usize + self.settings.braking_rows_max as usize {
                rows.clear();
                return Err(PlanError::DoesNotStop {
                    element: braking_from,
                    braking_rows_max: self.settings.braking_rows_max,
                });
            }
        }
        Ok(WindowOutcome {
            intended_rows,
            row_count: rows.len() as u32,
            ends_program,
        })
    }

    /// The row of a state that a window can start from.
    fn start(&self, from: &PathState, request: &WindowRequest) -> Result<Row, PlanError> {
        let on_path = self
            .path
            .elements
            .get(from.element as usize)
            .is_some_and(|element| (0.0..=element.length_mm).contains(&from.distance_mm));
        let speed_fits = from.speed_mm_s >= 0.0
            && from.speed_mm_s.is_finite()
            && (from.is_at_rest() || !request.repeats_start);
        let mut row = match self.row(from) {
            Some(row) if on_path && speed_fits => row,
            _ => {
                return Err(PlanError::State {
                    element: from.element,
                    distance_mm: from.distance_mm,
                    speed_mm_s: from.speed_mm_s,
                });
            }
        };
        row.state.waits_for_start &= !request.start;
        Ok(row)
    }
}

fn row_at(path: &Path, limits: &MotionLimits, state: &PathState) -> Row {
    let position_increments = match path.elements.get(state.element as usize) {
        Some(element) => limits.row(element, state.distance_mm),
        None => [0; MAX_AXES],
    };
    Row {
        position_increments,
        state: *state,
    }
}

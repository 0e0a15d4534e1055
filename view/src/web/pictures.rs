//! What the page draws and what is too large for each frame: the machine's axes, the path of the program, the trail of the tool.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use axum::body::Bytes;
use machine::TURN_DEG;
use monitor::quantities;
use path::geometry::{AxisVector, Element, Feed, Path, Shape};
use serde::Serialize;
use serde_json::json;

use crate::live::json::thousandth_of;
use crate::live::model::Model;
use crate::live::state::rounded;
use crate::live::trail::TrailPoint;

/// Points of the trail that are kept.
const KEPT: usize = 6000;
/// Straight pieces of a whole turn.
const PIECES_PER_TURN: f64 = 90.0;
/// Finer parts of its size nobody sees in the picture of a path.
const PARTS: f64 = 2000.0;

/// Where the trail of the tool, and the path under it, have got to; in every frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Drawn {
    /// Counts the paths: another one is to be fetched.
    pub path: u32,
    /// Counts the trails: it has begun again.
    pub trail: u32,
    /// Number of the first new point of the trail.
    pub first: u64,
}

/// The pictures, as far as they are the same for all who look.
pub struct Pictures {
    machine: Bytes,
    path: Bytes,
    trail: VecDeque<TrailPoint>,
    drawn: Drawn,
    /// Points that the trail had so far.
    count: u64,
    program: Option<u64>,
    run: Option<u32>,
}

/// The pictures, whoever may have died over them.
pub fn locked(pictures: &Mutex<Pictures>) -> MutexGuard<'_, Pictures> {
    pictures.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Pictures {
    /// Of a cell that nobody has looked at yet.
    pub fn new(model: &Model) -> Pictures {
        Pictures {
            machine: machine(model),
            path: path(None),
            trail: VecDeque::new(),
            drawn: Drawn {
                path: 0,
                trail: 0,
                first: 0,
            },
            count: 0,
            program: None,
            run: None,
        }
    }

    /// Follows the model; the new points of the trail.
    pub fn follow(&mut self, model: &mut Model) -> Vec<TrailPoint> {
        let program = model.program.as_ref().map(|program| program.source_hash);
        let run = model.feedback.as_ref().map(|feedback| feedback.run);
        if program != self.program {
            self.path = path(model.program.as_ref().map(|program| &program.path));
            self.drawn.path += 1;
        }
        if program != self.program || run != self.run {
            (self.program, self.run) = (program, run);
            self.trail.clear();
            self.drawn.trail += 1;
            let bounds = model.program.as_ref().and_then(|p| p.path.bounds());
            let size_mm = bounds.map(|(low, high)| size_mm(&low, &high));
            if let Some(trail) = &mut model.trail {
                trail.begin(size_mm);
            }
        }
        let new = model.trail.as_mut().map_or(Vec::new(), |t| t.take_new());
        self.drawn.first = self.count;
        self.count += new.len() as u64;
        self.trail.extend(&new);
        self.trail.drain(..self.trail.len().saturating_sub(KEPT));
        new
    }

    /// Where they have got to.
    pub fn state(&self) -> Drawn {
        self.drawn
    }

    /// The machine's axes, as JSON.
    pub fn machine(&self) -> Bytes {
        self.machine.clone()
    }

    /// The program's path, as JSON.
    pub fn path(&self) -> Bytes {
        self.path.clone()
    }

    /// The trail so far, as JSON.
    pub fn trail(&self) -> Bytes {
        let points: Vec<_> = self.trail.iter().map(shown).collect();
        let first = self.count - self.trail.len() as u64;
        let text = json!({
            "trail": self.drawn.trail,
            "first": first,
            "points": points,
        });
        text.to_string().into()
    }
}

/// A point as the page takes it: X, Y, Z in mm, and the contour error in µm or null.
pub fn shown(point: &TrailPoint) -> (f64, f64, f64, Option<f64>) {
    let [x, y, z] = point.place_mm.map(|mm| rounded(mm, 4));
    (x, y, z, point.error_um.map(|um| rounded(um, 2)))
}

fn machine(model: &Model) -> Bytes {
    let machine = &model.machine;
    let axes = machine.axes.iter().zip(&model.axes).map(|(axis, view)| {
        let increments = machine.manual.increments(axis.kind).into_iter();
        let increments = increments
            .map(|of| json!({"way": of.way, "shown": of.shown, "unit": of.unit}))
            .collect::<Vec<_>>();
        let (low, high) = match axis.modulo {
            true => (0.0, TURN_DEG),
            false => (axis.travel_min_mm, axis.travel_max_mm),
        };
        let (mm, um) = (view.unit, thousandth_of(view.unit));
        json!({
            "axis": axis.name,
            "unit": view.unit,
            (format!("minimum_{mm}")): low,
            (format!("maximum_{mm}")): high,
            (format!("following_error_limit_{um}")): view.error_limit_um,
            "homes": axis.homing.is_some(),
            "increments": increments,
        })
    });
    let text = json!({
        "cell": model.cell,
        "machine": machine.name,
        "period_us": machine.scan.period_us,
        "axes": axes.collect::<Vec<_>>(),
        "quantities": quantities::OF_AXIS.map(|one| {
            json!({ "key": one.key, "heading": one.heading, "unit": one.unit, "decimals": one.decimals })
        }),
    });
    text.to_string().into()
}

/// A stretch of path of one kind.
#[derive(Debug, Serialize)]
struct Stretch {
    rapid: bool,
    /// X, Y, Z one after the other.
    places_mm: Vec<f64>,
}

/// The path as lines of straight pieces; rapids apart.
fn path(path: Option<&Path>) -> Bytes {
    let mut stretches: Vec<Stretch> = Vec::new();
    let bounds = path.and_then(Path::bounds);
    let grain_mm = bounds.map_or(0.0, |(low, high)| size_mm(&low, &high) / PARTS);
    let mut last = AxisVector::zeros();
    for element in path.map_or(&[][..], |path| &path.elements) {
        if element.is_dwell() {
            continue;
        }
        let rapid = matches!(element.feed, Feed::Rapid);
        if stretches.last().is_none_or(|last| last.rapid != rapid) {
            let places_mm = Vec::new();
            stretches.push(Stretch { rapid, places_mm });
            last = element.start();
            push(&mut stretches, &last);
        }
        let pieces = pieces(element);
        for piece in 1..=pieces {
            let share = f64::from(piece) / f64::from(pieces);
            let place = element.point(element.length_mm * share);
            // The end of a stretch is drawn by the next one or by the tool.
            if (place - last).norm() >= grain_mm {
                push(&mut stretches, &place);
                last = place;
            }
        }
    }
    json!({ "stretches": stretches }).to_string().into()
}

fn push(stretches: &mut [Stretch], place: &AxisVector) {
    if let Some(stretch) = stretches.last_mut() {
        let xyz = place.iter().take(3);
        stretch.places_mm.extend(xyz.map(|mm| rounded(*mm, 4)));
    }
}

fn pieces(element: &Element) -> u32 {
    match &element.shape {
        Shape::Arc { sweep_rad, .. } => {
            let turns = sweep_rad.abs() / std::f64::consts::TAU;
            (turns * PIECES_PER_TURN).ceil().clamp(2.0, 10_000.0) as u32
        }
        Shape::Line { .. } | Shape::Dwell { .. } => 1,
    }
}

/// Diagonal of the box, in mm.
fn size_mm(low: &AxisVector, high: &AxisVector) -> f64 {
    let sides = low.iter().zip(high.iter()).take(3);
    sides.map(|(a, b)| (b - a) * (b - a)).sum::<f64>().sqrt()
}

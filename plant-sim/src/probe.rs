//! A simulated touch probe: the ball of its stylus against bodies at rest. It tells the instant of a contact within the scan, as the
//! touch-probe unit of a drive does.

use bytemuck::{Pod, Zeroable};
use master::InputFeedback;

use crate::plant_file::{PlantBox, PlantCylinder, PlantPlane, PlantProbe, PlantSphere};
use crate::script::rng::Rng;

/// Halvings of the time between two instrument samples: to 250 µs / 2²⁰ = 0.24 ns.
const HALVINGS: u32 = 20;
/// Uniform numbers that are added up to one of the noise (Irwin–Hall: 12 have a variance of 1).
const UNIFORMS: u64 = 12;

type Point = [f64; 3];

fn minus(a: &Point, b: &Point) -> Point {
    let ([ax, ay, az], [bx, by, bz]) = (a, b);
    [ax - bx, ay - by, az - bz]
}

fn dot(a: &Point, b: &Point) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn length(a: &Point) -> f64 {
    libm::sqrt(dot(a, a))
}

/// Distance from a set that is the meeting of others, of which these are the distances: exact outside, a bound inside.
fn meeting(distances: &[f64]) -> f64 {
    let deepest = distances.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let outside = distances.iter().map(|distance| distance.max(0.0));
    let outside = libm::sqrt(outside.map(|distance| distance * distance).sum());
    deepest.min(0.0) + outside
}

/// Distance of a point from the surface of a body, negative inside, in mm.
fn from_plane(plane: &PlantPlane, point: &Point) -> f64 {
    dot(&minus(point, &plane.point_mm), &plane.normal)
        / length(&plane.normal).max(f64::MIN_POSITIVE)
}

fn from_box(of_box: &PlantBox, point: &Point) -> f64 {
    let mut sides = [0.0; 3];
    let corners = of_box.low_mm.iter().zip(&of_box.high_mm);
    for ((side, at), (low, high)) in sides.iter_mut().zip(point).zip(corners) {
        *side = (low - at).max(at - high);
    }
    meeting(&sides)
}

fn from_sphere(sphere: &PlantSphere, point: &Point) -> f64 {
    length(&minus(point, &sphere.centre_mm)) - sphere.radius_mm
}

fn from_cylinder(cylinder: &PlantCylinder, point: &Point) -> f64 {
    let axis = minus(&cylinder.to_mm, &cylinder.from_mm);
    let whole_mm = length(&axis).max(f64::MIN_POSITIVE);
    let way = minus(point, &cylinder.from_mm);
    let along_mm = dot(&way, &axis) / whole_mm;
    let across_mm = libm::sqrt((dot(&way, &way) - along_mm * along_mm).max(0.0));
    let beyond_mm = (-along_mm).max(along_mm - whole_mm);
    meeting(&[across_mm - cylinder.radius_mm, beyond_mm])
}

/// What outlives the process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct ProbeState {
    /// Contacts so far: the noise of the next one follows from it.
    pub contacts: u64,
    /// 1 while in contact.
    pub contact: u32,
    /// 1 once the stylus has broken.
    pub broken: u32,
}

/// A touch probe and what it can touch.
#[derive(Debug, Clone)]
pub struct SimulatedProbe {
    settings: PlantProbe,
    /// Index of the axes X, Y and Z.
    slides: [Option<usize>; 3],
    /// The state, for saving it; who goes on from a saved one says where by [`stand`](SimulatedProbe::stand).
    pub state: ProbeState,
    /// Centre of the ball at the end of the scan before.
    centre_mm: Point,
    /// Shares of the last scan at which contact was made and lost, each first.
    made_at: Option<f64>,
    lost_at: Option<f64>,
}

impl SimulatedProbe {
    /// A probe carried by these axes; it stands nowhere yet.
    pub fn new(settings: PlantProbe, slides: [Option<usize>; 3]) -> SimulatedProbe {
        SimulatedProbe {
            settings,
            slides,
            state: ProbeState::default(),
            centre_mm: [0.0; 3],
            made_at: None,
            lost_at: None,
        }
    }

    /// The centre of the ball with the tables of the axes at these positions.
    fn centre(&self, table_mm: impl Fn(usize) -> f64) -> Point {
        let at = |slide: &Option<usize>| slide.map_or(0.0, &table_mm);
        let [x, y, z] = &self.slides;
        [at(x), at(y), at(z) - self.settings.length_mm]
    }

    /// Its axes stand there; contact is as it is there.
    pub fn stand(&mut self, table_mm: impl Fn(usize) -> f64) {
        self.centre_mm = self.centre(table_mm);
        let touches = self.gap_mm(&self.centre_mm) <= 0.0;
        self.state.contact = u32::from(touches || self.state.broken == 1);
    }

    /// From the ball to the nearest body, negative in contact, in mm.
    pub fn clearance_mm(&self, centre_mm: &Point) -> f64 {
        let settings = &self.settings;
        let planes = settings.planes.iter().map(|of| from_plane(of, centre_mm));
        let boxes = settings.boxes.iter().map(|of| from_box(of, centre_mm));
        let spheres = settings.spheres.iter().map(|of| from_sphere(of, centre_mm));
        let cylinders = settings
            .cylinders
            .iter()
            .map(|of| from_cylinder(of, centre_mm));
        let nearest = planes.chain(boxes).chain(spheres).chain(cylinders);
        let solid_mm = nearest.fold(f64::INFINITY, f64::min);
        let bores = settings
            .bores
            .iter()
            .map(|of| -from_cylinder(of, centre_mm));
        bores.fold(solid_mm, f64::max) - settings.tip_radius_mm
    }

    /// The same with the noise of the next contact, or of the one in force.
    fn gap_mm(&self, centre_mm: &Point) -> f64 {
        self.clearance_mm(centre_mm) + self.noise_mm()
    }

    fn noise_mm(&self) -> f64 {
        if self.settings.repeatability_um == 0.0 {
            return 0.0;
        }
        let drawn = self.state.contacts.wrapping_mul(UNIFORMS);
        let mut rng = Rng::after(self.settings.seed, drawn);
        let sum: f64 = (0..UNIFORMS).map(|_| rng.between(-0.5, 0.5)).sum();
        sum * self.settings.repeatability_um * 1e-3
    }

    /// One scan, with the tables of the axes at these positions at each of its instrument samples.
    pub fn scan(&mut self, samples: usize, table_mm: impl Fn(usize, usize) -> f64) {
        (self.made_at, self.lost_at) = (None, None);
        for sample in 0..samples {
            let from = self.centre_mm;
            let to = self.centre(|axis| table_mm(axis, sample));
            self.centre_mm = to;
            if self.state.broken == 1 {
                continue;
            }
            let share = |within: f64| (sample as f64 + within) / samples as f64;
            let touches = self.gap_mm(&to) <= 0.0;
            if touches != (self.state.contact == 1) {
                let at = Some(share(self.changes_at(&from, &to, touches)));
                self.state.contact = u32::from(touches);
                if touches {
                    self.made_at = self.made_at.or(at);
                } else {
                    self.lost_at = self.lost_at.or(at);
                    // The next contact has noise of its own.
                    self.state.contacts += 1;
                }
            }
            if self.clearance_mm(&to) < -self.settings.overtravel_mm {
                (self.state.broken, self.state.contact) = (1, 1);
            }
        }
    }

    /// Where on the way between two samples the contact becomes that of its end, from 0 to 1.
    fn changes_at(&self, from: &Point, to: &Point, touches: bool) -> f64 {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            let mut point = *from;
            for (at, to) in point.iter_mut().zip(to) {
                *at += (to - *at) * middle;
            }
            if (self.gap_mm(&point) <= 0.0) == touches {
                high = middle;
            } else {
                low = middle;
            }
        }
        high
    }

    /// Adds what it shows.
    pub fn show(&self, shown: &mut InputFeedback) {
        shown.contact = self.state.contact == 1;
        shown.made_at = self.made_at;
        shown.lost_at = self.lost_at;
    }
}

#[cfg(test)]
mod tests;

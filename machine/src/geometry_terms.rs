//! What the geometry of a machine comes to: the corrections of each axis, over the positions of the axes that they depend on.

use crate::axis::{Axis, PositionFeedback};
use crate::geometry::{ErrorTable, GeometryTerm};
use crate::machine::Machine;
use crate::reversal::ReversalMethod;

impl Machine {
    /// Everything that positions are corrected by. The second motor of a gantry is corrected as its axis is, each over its own position;
    /// what depends on a gantry goes by its first motor. Names that no axis has are left out: the rules refuse them.
    pub fn geometry(&self) -> Vec<GeometryTerm> {
        let index = |name: &str| self.axes.iter().position(|axis| axis.name == name);
        let mut terms: Vec<GeometryTerm> = Vec::new();
        for (of, axis) in self.axes.iter().enumerate() {
            if let Some(compensation) = &axis.compensation {
                let errors = compensation.mean();
                terms.push(GeometryTerm {
                    of,
                    from: of,
                    errors,
                });
            }
        }
        for square in &self.squareness {
            let (Some(of), Some(from)) = (index(&square.to), index(&square.of)) else {
                continue;
            };
            let Some(axis) = self.axes.get(from) else {
                continue;
            };
            let ends_mm = [axis.travel_min_mm, axis.travel_max_mm];
            let errors = ends_mm.map(|at_mm| square.um_per_m * 1e-3 * at_mm);
            let errors = ErrorTable::new(&ends_mm, errors.into_iter());
            terms.push(GeometryTerm { of, from, errors });
        }
        for straight in &self.straightness {
            let (Some(of), Some(from)) = (index(&straight.to), index(&straight.of)) else {
                continue;
            };
            let errors = ErrorTable::new(&straight.positions_mm, straight.error_um.iter().copied());
            terms.push(GeometryTerm { of, from, errors });
        }
        for pair in self.gantries() {
            let of_leader = terms.iter().filter(|term| term.of == pair.leader);
            let of_follower: Vec<GeometryTerm> = of_leader
                .map(|term| GeometryTerm {
                    of: pair.follower,
                    from: match term.from == pair.leader {
                        true => pair.follower,
                        false => term.from,
                    },
                    errors: term.errors.clone(),
                })
                .collect();
            terms.extend(of_follower);
        }
        terms
    }

    /// Lost motion by place, beside `reversal.backlash_um`, of an axis whose position backlash is compensated: the servo makes it good on
    /// the motor's side. None where the model knows the gap (`contact-force`), where a scale shows the table itself, and where reversals
    /// are left alone: there the mean of both directions counts alone.
    pub fn lost_motion_by_place(&self, axis: usize) -> Option<ErrorTable> {
        let leader = self.gantry_of(axis).map_or(axis, |pair| pair.leader);
        let compensation = self.axes.get(leader)?.compensation.as_ref()?;
        let steps = self.axes.get(axis).is_some_and(Axis::steps_at_reversals);
        compensation.lost_motion().filter(|_| steps)
    }

    /// What positions of an axis are corrected by, in words; none of one that is not.
    pub fn geometry_in_words(&self, axis: usize) -> Option<String> {
        let settings = self.axes.get(axis)?;
        let unit = settings.kind.unit();
        let (small, scale) = match unit {
            "mm" => ("µm", 1e3),
            _ => ("mdeg", 1e3),
        };
        let mut parts: Vec<String> = Vec::new();
        let terms = self.geometry();
        for term in terms.iter().filter(|term| term.of == axis) {
            let [low, high] = term.errors.range_mm()?;
            let largest = term.errors.largest_mm() * scale;
            if term.from != axis {
                let from = self.axis_name(term.from);
                parts.push(format!("by {from} up to {largest:.1} {small}"));
                continue;
            }
            let mut words =
                format!("its own errors from {low} to {high} {unit} up to {largest:.1} {small}");
            let both = settings
                .compensation
                .as_ref()
                .and_then(|of| of.lost_motion());
            match (self.lost_motion_by_place(axis), both) {
                (Some(lost), _) => words.push_str(&format!(
                    " with lost motion up to {:.1} {small}",
                    lost.largest_mm() * scale
                )),
                (None, Some(_)) => words.push_str(", the mean of both directions"),
                (None, None) => {}
            }
            parts.push(words);
        }
        let words = parts.join("; ");
        (!words.is_empty()).then(|| format!("axis {} is corrected: {words}", settings.name))
    }
}

impl Axis {
    /// Whether its position backlash is compensated by a step at each reversal, and shows in its feedback.
    fn steps_at_reversals(&self) -> bool {
        let method = self.reversal.method;
        self.feedback == PositionFeedback::Motor
            && matches!(
                method,
                ReversalMethod::Backlash | ReversalMethod::FrictionPulse
            )
    }
}

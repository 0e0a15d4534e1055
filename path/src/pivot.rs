//! A pivot axis that is in for Y: a swing arm about an axis parallel to Z, on a machine with X, B and Z.
use thiserror::Error;

use crate::axis_rates::AxisRates;
use crate::geometry::{AxisVector, Element, PATH_AXES, Path};
use crate::travel::Travel;

/// Degrees per radian.
const DEG_PER_RAD: f64 = 180.0 / std::f64::consts::PI;
/// A reach beyond the arm's range by less than this is rounding of the program's numbers, in mm.
const REACH_ROUNDING_MM: f64 = 1e-9;
/// A slide may come this close to the end of its travel without being split further by the check, in mm.
const TRAVEL_RESOLUTION_MM: f64 = 1e-4;
/// Pieces that the check of one element may come to. Only pieces near an end of travel are split.
const PIECES_MAX: usize = 1 << 16;

/// What the X slide carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Carries {
    /// The pivot with its arm.
    Arm,
    /// The work. X counts the motion of the slide itself (X′ of ISO 841), so the slide has to go along with what the
    /// rotation does to the tool.
    Work,
}

/// The arm and its slide.
///
/// With the arm along X at θ = 0 the tool is at
///
/// ```text
/// X = x ∓ L·(1 − cos θ)       Y = L·sin θ             − where the slide carries the arm, + where it carries the work
/// x = X ± L·(1 − cos θ)       θ = asin(Y/L)           from which δx = ±L·(cos θ − cos(θ + Δθ)) of the source follows
/// ```
///
/// Source: Fanuc, numerical controller for a machine whose axis B is in for Y (docs/methods/pivot-axis.md). Units: mm,
/// degrees for the arm. Everything is computed from absolute positions: nothing drifts. All other axes pass through. A Y
/// beyond the arm is taken as its end; paths are checked before ([`PivotY::check`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PivotY {
    /// Index of the X slide.
    pub slide: usize,
    /// Index of the arm's axis B, and of Y in the program's coordinates: it takes its place.
    pub arm: usize,
    /// L, in mm.
    pub arm_length_mm: f64,
    /// Range of θ, in degrees; within ±90.
    pub arm_min_deg: f64,
    /// Upper end.
    pub arm_max_deg: f64,
    /// What the slide carries.
    pub carries: Carries,
}

/// A path that the machine cannot follow.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum OutOfReach {
    /// Y beyond the arm's range.
    #[error(
        "line {line}: Y would reach {y_mm:.4} mm: the arm of {arm_length_mm} mm reaches {low_mm:.4} to {high_mm:.4} mm"
    )]
    Arm {
        /// Line of the program.
        line: u32,
        /// The farthest Y, in machine coordinates.
        y_mm: f64,
        /// L.
        arm_length_mm: f64,
        /// Lowest Y of the range.
        low_mm: f64,
        /// Highest.
        high_mm: f64,
    },
    /// The slide beyond its travel.
    #[error(
        "line {line}: the slide under X would reach {found_mm:.4} mm, where it makes up for the arm: its travel is {low_mm} to {high_mm} mm"
    )]
    Slide {
        /// Line of the program.
        line: u32,
        /// Where.
        found_mm: f64,
        /// Lower end of its travel.
        low_mm: f64,
        /// Upper end.
        high_mm: f64,
    },
    /// The machine is with its arm outside the range.
    #[error("the arm is at {angle_deg:.4}°: its range is {low_deg} to {high_deg}°: jog it inwards")]
    Start {
        /// Where it stands.
        angle_deg: f64,
        /// Lower end of its range.
        low_deg: f64,
        /// Upper end.
        high_deg: f64,
    },
}

impl PivotY {
    fn sign(&self) -> f64 {
        match self.carries {
            Carries::Arm => 1.0,
            Carries::Work => -1.0,
        }
    }

    /// L·(1 − cos θ) at sin θ = Y/L, in mm: how far the arm has drawn the tool back along X.
    fn drawn_back_mm(&self, y_mm: f64) -> f64 {
        // As Y·tan(θ/2), which loses nothing near θ = 0.
        let sine = self.sine(y_mm);
        self.arm_length_mm * sine * sine / (1.0 + (1.0 - sine * sine).sqrt())
    }

    fn sine(&self, y_mm: f64) -> f64 {
        (y_mm / self.arm_length_mm).clamp(-1.0, 1.0)
    }

    /// Where the axes are for a place of the tool: X Y Z to X B Z.
    pub fn axes(&self, tool: &AxisVector) -> AxisVector {
        let mut axes = *tool;
        let y_mm = tool.get(self.arm).copied().unwrap_or(0.0);
        if let Some(arm_deg) = axes.get_mut(self.arm) {
            *arm_deg = libm::asin(self.sine(y_mm)) * DEG_PER_RAD;
        }
        if let Some(slide_mm) = axes.get_mut(self.slide) {
            *slide_mm += self.sign() * self.drawn_back_mm(y_mm);
        }
        axes
    }

    /// Where the tool is on the part for a place of the axes: X B Z to X Y Z.
    pub fn tool(&self, axes: &AxisVector) -> AxisVector {
        let mut tool = *axes;
        let angle_rad = axes.get(self.arm).copied().unwrap_or(0.0) / DEG_PER_RAD;
        if let Some(y_mm) = tool.get_mut(self.arm) {
            *y_mm = self.arm_length_mm * libm::sin(angle_rad);
        }
        if let Some(x_mm) = tool.get_mut(self.slide) {
            let half = libm::sin(0.5 * angle_rad);
            *x_mm -= self.sign() * 2.0 * self.arm_length_mm * half * half;
        }
        tool
    }

    /// First derivative of the axes along a path of the tool at `tool` with the tangent `tangent`.
    pub fn axes_tangent(&self, tool: &AxisVector, tangent: &AxisVector) -> AxisVector {
        let y_mm = tool.get(self.arm).copied().unwrap_or(0.0);
        let along_y = tangent.get(self.arm).copied().unwrap_or(0.0);
        let (tangent_of_angle, per_mm) = self.slopes(y_mm);
        let mut axes = *tangent;
        if let Some(arm) = axes.get_mut(self.arm) {
            *arm = along_y * per_mm * DEG_PER_RAD;
        }
        if let Some(slide) = axes.get_mut(self.slide) {
            *slide += self.sign() * tangent_of_angle * along_y;
        }
        axes
    }

    /// tan θ and dθ/dY = 1/(L·cos θ), in rad/mm.
    fn slopes(&self, y_mm: f64) -> (f64, f64) {
        let sine = self.sine(y_mm);
        let cosine = (1.0 - sine * sine).sqrt();
        (sine / cosine, 1.0 / (self.arm_length_mm * cosine))
    }

    /// Bounds of the axes' derivatives where |Y| is at most `y_max_mm` and the tool's own derivatives are within
    /// `of_tool`. With t = tan θ and c = cos θ at the largest |Y|, where both slopes are steepest:
    ///
    /// ```text
    /// |θ′| ≤ |Y′|/(L·c)                       |θ″| ≤ |Y″|/(L·c) + t·|Y′|²/(L·c)²
    /// |x′| ≤ |X′| + t·|Y′|                    |x″| ≤ |X″| + t·|Y″| + |Y′|²/(L·c³)
    /// ```
    pub fn rates_at_most(&self, y_max_mm: f64, of_tool: &AxisRates) -> AxisRates {
        let (tangent, per_mm) = self.slopes(y_max_mm);
        let cosine = 1.0 / (self.arm_length_mm * per_mm);
        let of = |rates: &[f64; PATH_AXES], axis: usize| rates.get(axis).copied().unwrap_or(0.0);
        let first = of(&of_tool.first, self.arm);
        let second = of(&of_tool.second, self.arm);
        let mut rates = *of_tool;
        if let Some(arm) = rates.first.get_mut(self.arm) {
            *arm = first * per_mm * DEG_PER_RAD;
        }
        if let Some(arm) = rates.second.get_mut(self.arm) {
            *arm = (second * per_mm + tangent * first * first * per_mm * per_mm) * DEG_PER_RAD;
        }
        if let Some(slide) = rates.first.get_mut(self.slide) {
            *slide += tangent.abs() * first;
        }
        if let Some(slide) = rates.second.get_mut(self.slide) {
            *slide += tangent.abs() * second + first * first * per_mm / (cosine * cosine);
        }
        rates
    }

    /// The same all along an element.
    pub fn element_rates(&self, element: &Element) -> AxisRates {
        self.rates_on(element, &AxisRates::of(element))
    }

    /// The same where the tool is somewhere on an element and its derivatives are within `of_tool`.
    pub fn rates_on(&self, element: &Element, of_tool: &AxisRates) -> AxisRates {
        let (lowest, highest) = element.bounds();
        let of = |bound: &AxisVector| bound.get(self.arm).copied().unwrap_or(0.0).abs();
        self.rates_at_most(of(&lowest).max(of(&highest)), of_tool)
    }

    /// Lowest and highest Y of the arm's range, in mm.
    pub fn reach_mm(&self) -> (f64, f64) {
        let y_mm = |angle_deg: f64| self.arm_length_mm * libm::sin(angle_deg / DEG_PER_RAD);
        (y_mm(self.arm_min_deg), y_mm(self.arm_max_deg))
    }

    /// Most that the arm draws the tool back along X within its range, in mm.
    pub fn drawn_back_max_mm(&self) -> f64 {
        let (low_mm, high_mm) = self.reach_mm();
        self.drawn_back_mm(low_mm).max(self.drawn_back_mm(high_mm))
    }

    /// Whether the arm reaches every place of an element; the line and the farthest Y where not.
    pub fn check_reach(&self, element: &Element) -> Result<(), OutOfReach> {
        let (low_mm, high_mm) = self.reach_mm();
        let y_mm = |place: &AxisVector| place.get(self.arm).copied().unwrap_or(0.0);
        let reach = Travel {
            min: low_mm - REACH_ROUNDING_MM,
            max: high_mm + REACH_ROUNDING_MM,
        };
        let reach = reach.from_place(y_mm(&element.point(0.0)));
        let (lowest, highest) = element.bounds();
        for y_mm in [lowest, highest].map(|place| y_mm(&place)) {
            if !reach.holds(y_mm) {
                return Err(OutOfReach::Arm {
                    line: element.line,
                    y_mm,
                    arm_length_mm: self.arm_length_mm,
                    low_mm,
                    high_mm,
                });
            }
        }
        Ok(())
    }

    /// Whether the arm stands within its range, or outside by no more than its in-position window: the place of the tool alone does
    /// not say on which side of 90° it does.
    pub fn check_start(&self, axes: &AxisVector, window_deg: f64) -> Result<(), OutOfReach> {
        let angle_deg = axes.get(self.arm).copied().unwrap_or(0.0);
        let range = Travel {
            min: self.arm_min_deg - window_deg,
            max: self.arm_max_deg + window_deg,
        };
        if range.holds(angle_deg) {
            return Ok(());
        }
        Err(OutOfReach::Start {
            angle_deg,
            low_deg: self.arm_min_deg,
            high_deg: self.arm_max_deg,
        })
    }

    /// Whether the machine can follow a path with its slide between `low_mm` and `high_mm`. Of paths that touch the end of
    /// the travel in a curve the last 0.1 µm are refused too.
    pub fn check(&self, path: &Path, low_mm: f64, high_mm: f64) -> Result<(), OutOfReach> {
        let mut elements = path.elements.iter();
        elements.try_for_each(|element| self.check_element(element, low_mm, high_mm))
    }

    /// The same of one element.
    pub fn check_element(
        &self,
        element: &Element,
        low_mm: f64,
        high_mm: f64,
    ) -> Result<(), OutOfReach> {
        self.check_reach(element)?;
        match self.slide_outside(element, low_mm, high_mm) {
            Some(found_mm) => Err(OutOfReach::Slide {
                line: element.line,
                found_mm,
                low_mm,
                high_mm,
            }),
            None => Ok(()),
        }
    }

    fn slide_mm(&self, element: &Element, distance_mm: f64) -> f64 {
        let axes = self.axes(&element.point(distance_mm));
        axes.get(self.slide).copied().unwrap_or(0.0)
    }

    /// A place of the slide outside low … high on an element, if there is one. On a piece of length h the slide is
    /// within h²/8·|x″| of the straight line between the piece's ends, and between them itself where its slope in the middle
    /// is above h/2·|x″|; pieces that neither clears are halved.
    fn slide_outside(&self, element: &Element, low_mm: f64, high_mm: f64) -> Option<f64> {
        let rates = self.element_rates(element);
        let bend_per_mm = rates.second.get(self.slide).copied().unwrap_or(0.0);
        let travel = Travel {
            min: low_mm,
            max: high_mm,
        };
        let reach = travel.from_place(self.slide_mm(element, 0.0));
        let mut pieces = vec![(0.0, element.length_mm)];
        let mut judged = 0;
        while let Some((from_mm, to_mm)) = pieces.pop() {
            judged += 1;
            let ends = [from_mm, to_mm].map(|at_mm| self.slide_mm(element, at_mm));
            let outside = |x_mm: f64| !reach.holds(x_mm);
            if let Some(found_mm) = ends.into_iter().find(|x_mm| outside(*x_mm)) {
                return Some(found_mm);
            }
            let length_mm = to_mm - from_mm;
            let bulge_mm = length_mm * length_mm / 8.0 * bend_per_mm;
            let [a, b] = ends;
            let middle_mm = 0.5 * (from_mm + to_mm);
            let slope = self.axes_tangent(&element.point(middle_mm), &element.tangent(middle_mm));
            let slope = slope.get(self.slide).copied().unwrap_or(0.0);
            let turns_nowhere = slope.abs() > 0.5 * length_mm * bend_per_mm;
            if turns_nowhere || (!outside(a.min(b) - bulge_mm) && !outside(a.max(b) + bulge_mm)) {
                continue;
            }
            if bulge_mm <= TRAVEL_RESOLUTION_MM || judged > PIECES_MAX {
                return Some(self.slide_mm(element, middle_mm));
            }
            pieces.push((middle_mm, to_mm));
            pieces.push((from_mm, middle_mm));
        }
        None
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use super::*;
    use crate::geometry::Feed;
    use proptest::prelude::*;

    /// Increments of 1 nm and 1 µdeg.
    const INCREMENT: f64 = 1e-6;

    fn arm(carries: Carries) -> PivotY {
        PivotY {
            slide: 0,
            arm: 1,
            arm_length_mm: 150.0,
            arm_min_deg: -60.0,
            arm_max_deg: 60.0,
            carries,
        }
    }

    fn at(x: f64, y: f64, z: f64) -> AxisVector {
        let mut place = AxisVector::zeros();
        (place[0], place[1], place[2]) = (x, y, z);
        place
    }

    fn rounded(place: &AxisVector) -> AxisVector {
        place.map(|component| libm::round(component / INCREMENT) * INCREMENT)
    }

    /// The source's step: (Δθ in degrees, δx in mm) for a ΔY at θ.
    fn source_step(pivot: &PivotY, angle_deg: f64, delta_y_mm: f64) -> (f64, f64) {
        let (length_mm, angle_rad) = (pivot.arm_length_mm, angle_deg.to_radians());
        let turned_rad = libm::asin(libm::sin(angle_rad) + delta_y_mm / length_mm) - angle_rad;
        let freed_mm = length_mm * (libm::cos(angle_rad) - libm::cos(angle_rad + turned_rad));
        let correction_mm = match pivot.carries {
            Carries::Arm => freed_mm,
            Carries::Work => -freed_mm,
        };
        (turned_rad.to_degrees(), correction_mm)
    }

    #[test]
    fn an_arm_of_150_mm_at_30_degrees_has_moved_75_mm_and_drawn_back_20_mm() {
        let drawn_back = 150.0 * (1.0 - 0.75f64.sqrt());
        for (carries, slide_mm) in [
            (Carries::Arm, 7.0 + drawn_back),
            (Carries::Work, 7.0 - drawn_back),
        ] {
            let axes = arm(carries).axes(&at(7.0, 75.0, -3.0));
            assert!((axes - at(slide_mm, 30.0, -3.0)).norm() < 1e-12, "{axes}");
        }
    }

    #[test]
    fn the_carriage_of_the_arm_turns_its_correction_round_and_nothing_else() {
        let (of_arm, of_work) = (arm(Carries::Arm), arm(Carries::Work));
        let tool = at(0.0, -40.0, 5.0);
        let (a, b) = (of_arm.axes(&tool), of_work.axes(&tool));
        assert!(a[0] > 5.0 && a[0] == -b[0]);
        assert_eq!((a[1], a[2]), (b[1], b[2]));
    }

    fn any_carries() -> impl Strategy<Value = Carries> {
        prop_oneof![Just(Carries::Arm), Just(Carries::Work)]
    }

    proptest! {
        /// Axes in whole increments come back as the same increments: a start command position is met to the bit.
        #[test]
        fn axes_to_tool_and_back_is_the_same_increment(
            x in -300_000_000i64..300_000_000,
            angle in -60_000_000i64..=60_000_000,
            carries in any_carries(),
        ) {
            let pivot = arm(carries);
            let axes = at(x as f64 * INCREMENT, angle as f64 * INCREMENT, 0.0);
            let back = pivot.axes(&pivot.tool(&axes));
            for (component, increments) in back.iter().zip([x, angle]) {
                let off = component / INCREMENT - increments as f64;
                prop_assert!(off.abs() < 1e-3, "{off} increments");
            }
        }

        /// Rounding the axes moves the tool by less than one increment of each of them: 1 nm of the slide in X, and 1 µdeg of
        /// the arm, which is 2.6 nm at the end of 150 mm, across the arm.
        #[test]
        fn tool_to_axes_and_back_is_within_one_increment_of_the_axes(
            x in -300.0..300.0f64,
            y in -129.0..129.0f64,
            carries in any_carries(),
        ) {
            let pivot = arm(carries);
            let tool = at(x, y, 1.0);
            let off = pivot.tool(&rounded(&pivot.axes(&tool))) - tool;
            let arm_increment_mm = INCREMENT.to_radians() * pivot.arm_length_mm;
            prop_assert!(off[1].abs() < 0.51 * arm_increment_mm, "{} mm", off[1]);
            prop_assert!(off[0].abs() < 0.51 * (INCREMENT + arm_increment_mm), "{} mm", off[0]);
            prop_assert_eq!(off[2].abs() < 1e-12, true);
        }

        /// The source's increments, added up over a walk, end where the absolute form is at once.
        #[test]
        fn the_steps_of_the_source_add_up_to_the_absolute_form(
            places in prop::collection::vec(-129.0..129.0f64, 1..50),
            carries in any_carries(),
        ) {
            let pivot = arm(carries);
            let (mut y, mut slide, mut angle_deg) = (0.0, 0.0, 0.0);
            for next in places {
                let (turned_deg, correction_mm) = source_step(&pivot, angle_deg, next - y);
                angle_deg += turned_deg;
                slide += correction_mm;
                y = next;
                let axes = pivot.axes(&at(0.0, y, 0.0));
                prop_assert!((axes[1] - angle_deg).abs() < 1e-10, "{} and {angle_deg}", axes[1]);
                prop_assert!((axes[0] - slide).abs() < 1e-10, "{} and {slide}", axes[0]);
            }
        }

        /// The bounds that the speed map is made from hold at every place of an element, and the tangent is the slope.
        #[test]
        fn rates_along_lines_and_arcs_stay_within_their_bounds(
            from in (-50.0..50.0f64, -60.0..60.0f64),
            to in (-50.0..50.0f64, -60.0..60.0f64),
            radius_mm in 1.0..60.0f64,
            start_rad in -3.1..3.1f64,
            sweep_rad in 0.1..6.2f64,
            is_arc in any::<bool>(),
            carries in any_carries(),
        ) {
            let pivot = arm(carries);
            let from = at(from.0, from.1, 0.0);
            let element = if is_arc {
                let spoke = |angle: f64| at(radius_mm * libm::cos(angle), radius_mm * libm::sin(angle), 0.0);
                let centre = at(3.0, 5.0, 0.0);
                let (a, b) = (centre + spoke(start_rad), centre + spoke(start_rad + sweep_rad));
                Element::arc(1, a, b, centre, [0, 1], sweep_rad, Feed::Rapid)
            } else {
                Element::line(1, from, at(to.0, to.1, 0.0), Feed::Rapid)
            };
            prop_assume!(element.length_mm > 0.1);
            let bounds = pivot.element_rates(&element);
            let step = 1e-3 * element.length_mm;
            for index in 1..1000 {
                let s = f64::from(index) * step;
                let [before, here, after] =
                    [s - step, s, s + step].map(|s| pivot.axes(&element.point(s)));
                let tangent = pivot.axes_tangent(&element.point(s), &element.tangent(s));
                for axis in 0..2 {
                    let first = (after[axis] - before[axis]) / (2.0 * step);
                    let second = (after[axis] - 2.0 * here[axis] + before[axis]) / (step * step);
                    let noise = 1e-12 / (step * step);
                    prop_assert!(tangent[axis].abs() <= bounds.first[axis] * (1.0 + 1e-9));
                    prop_assert!(second.abs() <= bounds.second[axis] * (1.0 + 1e-6) + noise);
                    prop_assert!((first - tangent[axis]).abs() < 1e-3 * bounds.first[axis].max(0.1));
                }
            }
        }
    }

    #[test]
    fn what_the_arm_or_the_slide_cannot_reach_is_refused_with_its_line() {
        let pivot = arm(Carries::Arm);
        let line = |line, from, to| Element::line(line, from, to, Feed::Rapid);
        let check = |elements: Vec<Element>, low_mm, high_mm| {
            pivot.check(&Path { elements }, low_mm, high_mm)
        };
        let zero = at(0.0, 0.0, 0.0);
        let reach = pivot.reach_mm().1;
        assert!((reach - 129.903_810_567).abs() < 1e-6);
        let to_the_end = line(3, zero, at(0.0, reach, 0.0));
        assert_eq!(check(vec![to_the_end.clone()], -100.0, 100.0), Ok(()));
        let beyond = line(7, at(0.0, reach, 0.0), at(0.0, reach + 0.001, 0.0));
        assert!(matches!(
            check(vec![to_the_end.clone(), beyond], -100.0, 100.0),
            Err(OutOfReach::Arm { line: 7, .. })
        ));
        // 150·(1 − cos 60°) = 75 mm of slide.
        assert_eq!(check(vec![to_the_end.clone()], -1.0, 75.000_001), Ok(()));
        assert!(matches!(
            check(vec![to_the_end], -1.0, 74.99),
            Err(OutOfReach::Slide { line: 3, .. })
        ));
        // Both ends inside, the middle at 0 of the slide, 34 mm below them.
        let across = line(9, at(0.0, -100.0, 0.0), at(0.0, 100.0, 0.0));
        assert_eq!(check(vec![across.clone()], -0.001, 100.0), Ok(()));
        assert!(matches!(
            check(vec![across], 0.5, 100.0),
            Err(OutOfReach::Slide { line: 9, .. })
        ));
        let turned = at(0.0, 61.0, 0.0);
        assert!(matches!(
            pivot.check_start(&turned, 0.0),
            Err(OutOfReach::Start { .. })
        ));
    }

    #[test]
    fn along_the_end_of_the_slides_travel_a_line_in_x_alone_is_no_trouble() {
        let pivot = arm(Carries::Arm);
        let (from, to) = (at(0.0, 50.0, 0.0), at(20.0, 50.0, 0.0));
        let element = Element::line(1, from, to, Feed::Rapid);
        let high_mm = pivot.axes(&to)[0];
        let path = Path {
            elements: vec![element],
        };
        assert_eq!(pivot.check(&path, -1.0, high_mm), Ok(()));
    }
}

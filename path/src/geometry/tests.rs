use super::*;
use proptest::prelude::*;

const FEED: Feed = Feed::PathMmS(50.0);
const XY: [usize; 2] = [0, 1];

fn at(values: &[f64]) -> AxisVector {
    let mut vector = AxisVector::zeros();
    for (component, value) in vector.iter_mut().zip(values) {
        *component = *value;
    }
    vector
}

fn circle(radius_mm: f64, sweep_rad: f64, axial_mm: f64) -> Element {
    let to = at(&[
        radius_mm * libm::cos(sweep_rad),
        radius_mm * libm::sin(sweep_rad),
        axial_mm,
    ]);
    Element::arc(3, at(&[radius_mm, 0.0]), to, at(&[]), XY, sweep_rad, FEED)
}

/// Any line or arc of a size a machine tool has, in any of the three planes.
fn any_element() -> impl Strategy<Value = Element> {
    let coordinate = || -300.0..300.0f64;
    let point = move || [coordinate(), coordinate(), coordinate()].prop_map(|values| at(&values));
    let line = (point(), point()).prop_map(|(from, to)| Element::line(1, from, to, FEED));
    let plane = prop_oneof![Just([0, 1]), Just([2, 0]), Just([1, 2])];
    let sweep = prop_oneof![0.01..14.0f64, -14.0..-0.01f64];
    let axial = prop_oneof![Just(0.0), -50.0..50.0f64];
    let arc = (point(), plane, 0.5..200.0f64, -3.1..3.1f64, sweep, axial).prop_map(
        |(centre, plane, radius_mm, start_rad, sweep_rad, axial_mm)| {
            let (u, v) = (axis_unit(plane[0]), axis_unit(plane[1]));
            let on_circle =
                |angle: f64| centre + (u * libm::cos(angle) + v * libm::sin(angle)) * radius_mm;
            let normal = axis_unit(3 - plane[0] - plane[1]);
            let (from, to) = (
                on_circle(start_rad),
                on_circle(start_rad + sweep_rad) + normal * axial_mm,
            );
            Element::arc(2, from, to, centre, plane, sweep_rad, FEED)
        },
    );
    prop_oneof![line, arc]
}

#[test]
fn a_line_is_as_long_as_its_chord_and_ends_where_it_was_given() {
    let element = Element::line(7, at(&[0.1, 0.2]), at(&[3.1, 4.2]), FEED);
    assert!((element.length_mm - 5.0).abs() < 1e-14);
    assert_eq!(element.point(element.length_mm), at(&[3.1, 4.2]));
    assert_eq!(element.point(0.0), at(&[0.1, 0.2]));
    assert_eq!(element.curvature_magnitude_per_mm(), 0.0);
}

#[test]
fn a_full_circle_is_two_pi_r_long_and_curved_by_one_over_r() {
    let element = circle(25.0, TAU, 0.0);
    assert!((element.length_mm - 50.0 * PI).abs() < 1e-12);
    assert!((element.curvature_magnitude_per_mm() - 0.04).abs() < 1e-15);
    assert!((element.point(12.5 * PI) - at(&[0.0, 25.0])).norm() < 1e-12);
}

#[test]
fn a_clockwise_arc_goes_the_other_way() {
    let element = circle(10.0, -PI / 2.0, 0.0);
    assert!((element.tangent(0.0) - at(&[0.0, -1.0])).norm() < 1e-15);
}

#[test]
fn a_helix_counts_its_rise_in_its_length() {
    let element = circle(10.0, 2.0 * TAU, 6.0);
    assert!((element.length_mm - (40.0 * PI).hypot(6.0)).abs() < 1e-12);
}

#[test]
fn rotary_axes_count_in_degrees_only_when_no_slide_moves() {
    let rotary = [false, false, false, true, false, false, false, false, false];
    let move_of = |to: &[f64]| {
        Element::new(
            1,
            Shape::Line {
                from: at(&[]),
                to: at(to),
            },
            FEED,
            &rotary,
        )
        .length_mm
    };
    assert_eq!(move_of(&[0.0, 0.0, 0.0, 90.0]), 90.0);
    assert_eq!(move_of(&[3.0, 4.0, 0.0, 90.0]), 5.0);
}

#[test]
fn bounds_hold_the_quadrant_points_of_an_arc() {
    let from = at(&[libm::cos(-0.5) * 10.0, libm::sin(-0.5) * 10.0]);
    let to = at(&[libm::cos(2.0) * 10.0, libm::sin(2.0) * 10.0]);
    let path = Path {
        elements: vec![Element::arc(1, from, to, at(&[]), XY, 2.5, FEED)],
    };
    let (low, high) = path.bounds().unwrap();
    assert_eq!((high[0], high[1]), (10.0, 10.0));
    assert_eq!((low[0], low[1]), (to[0], from[1]));
}

#[test]
fn an_empty_path_has_no_ends() {
    let path = Path::default();
    assert_eq!(
        (path.length_mm(), path.start(), path.bounds()),
        (0.0, None, None)
    );
}

#[test]
fn a_break_between_elements_is_found() {
    let line = |from: f64, to: f64| Element::line(1, at(&[from]), at(&[to]), FEED);
    assert_eq!(
        Path {
            elements: vec![line(0.0, 1.0), line(1.0, 2.0)]
        }
        .first_break(),
        None
    );
    assert_eq!(
        Path {
            elements: vec![line(0.0, 1.0), line(1.0 + 1e-15, 2.0)]
        }
        .first_break(),
        Some(1)
    );
}

#[test]
fn nan_is_found_wherever_it_hides() {
    assert!(
        !Path {
            elements: vec![Element::dwell(1, at(&[f64::NAN]), 1.0)]
        }
        .is_finite()
    );
    assert!(
        !Path {
            elements: vec![Element::line(
                1,
                at(&[]),
                at(&[1.0]),
                Feed::PathMmS(f64::NAN)
            )]
        }
        .is_finite()
    );
    assert!(
        Path {
            elements: vec![circle(1.0, TAU, 0.0)]
        }
        .is_finite()
    );
}

#[test]
fn a_dwell_has_a_place_and_no_length() {
    let element = Element::dwell(4, at(&[1.0, 2.0]), 0.5);
    assert!(element.is_dwell());
    assert_eq!(element.point(1.0), at(&[1.0, 2.0]));
    assert_eq!(element.tangent(0.0), AxisVector::zeros());
    assert_eq!(element.closest_distance(&at(&[1.0, 5.0])), (0.0, 3.0));
}

#[test]
fn deviation_from_a_circle_is_the_radial_error() {
    let element = circle(25.0, 2.0 * TAU, 0.0);
    let (distance_mm, deviation_mm) = element.closest_distance(&at(&[0.0, 25.003]));
    assert!((distance_mm - 12.5 * PI).abs() < 1e-9);
    assert!((deviation_mm - 0.003).abs() < 1e-12);
}

#[test]
fn deviation_past_the_end_is_measured_to_the_end() {
    let (distance_mm, deviation_mm) =
        Element::line(1, at(&[]), at(&[10.0]), FEED).closest_distance(&at(&[13.0, 4.0]));
    assert_eq!((distance_mm, deviation_mm), (10.0, 5.0));
    let quarter = circle(10.0, PI / 2.0, 0.0);
    let (distance_mm, _) = quarter.closest_distance(&at(&[-1.0, 12.0]));
    assert_eq!(distance_mm, quarter.length_mm);
}

#[test]
fn sweeps_go_round_the_commanded_way() {
    let (from, to, centre) = (at(&[10.0]), at(&[0.0, 10.0]), at(&[]));
    let sweep =
        |to, clockwise, turns| sweep_between_rad(&from, to, &centre, XY, clockwise, turns, 1e-6);
    assert!((sweep(&to, false, 1) - PI / 2.0).abs() < 1e-15);
    assert!((sweep(&to, true, 1) + 1.5 * PI).abs() < 1e-15);
    assert!((sweep(&to, false, 3) - 4.5 * PI).abs() < 1e-14);
    assert_eq!(sweep(&from, false, 1), TAU);
    assert_eq!(sweep(&from, true, 2), -2.0 * TAU);
}

proptest! {
    #[test]
    fn ends_are_the_stored_bits_and_the_curve_runs_into_them(element in any_element()) {
        prop_assert_eq!(element.point(0.0), element.start());
        prop_assert_eq!(element.point(element.length_mm), element.end());
        let step_mm = 1e-9 * element.length_mm;
        prop_assert!((element.point(step_mm) - element.start()).norm() < 1e-5);
        prop_assert!((element.point(element.length_mm - step_mm) - element.end()).norm() < 1e-5);
    }

    #[test]
    fn tangent_and_curvature_agree_with_finite_differences(element in any_element(), share in 0.05..0.95f64) {
        let s = share * element.length_mm;
        let h = 1e-4 * element.length_mm.min(1.0);
        let tangent = (element.point(s + h) - element.point(s - h)) / (2.0 * h);
        prop_assert!((tangent - element.tangent(s)).norm() < 1e-6, "{} {}", tangent, element.tangent(s));
        prop_assert!((element.tangent(s).norm() - 1.0).abs() < 1e-12);
        let curvature = (element.tangent(s + h) - element.tangent(s - h)) / (2.0 * h);
        prop_assert!((curvature - element.curvature_per_mm(s)).norm() < 1e-6);
        let magnitude = element.curvature_per_mm(s).norm();
        prop_assert!((magnitude - element.curvature_magnitude_per_mm()).abs() < 1e-12);
    }

    #[test]
    fn a_point_on_the_curve_is_its_own_closest_point(element in any_element(), share in 0.0..1.0f64) {
        let point = element.point(share * element.length_mm);
        let (distance_mm, deviation_mm) = element.closest_distance(&point);
        prop_assert!(deviation_mm < 1e-6, "{deviation_mm}");
        prop_assert!((element.point(distance_mm) - point).norm() < 1e-6);
    }

    #[test]
    fn no_sample_of_the_curve_is_closer_than_the_closest_point(
        element in any_element(), offset in [-0.2..0.2f64, -0.2..0.2f64, -0.2..0.2f64], share in 0.0..1.0f64,
    ) {
        let point = element.point(share * element.length_mm) + at(&offset);
        let (_, deviation_mm) = element.closest_distance(&point);
        for index in 0..=400 {
            let sample = element.point(element.length_mm * f64::from(index) / 400.0);
            prop_assert!((sample - point).norm() >= deviation_mm - 1e-7);
        }
    }

    #[test]
    fn halves_meet_in_the_middle_and_run_along_the_whole(element in any_element(), share in 0.0..1.0f64) {
        let (first, second) = element.shape.halves();
        prop_assert_eq!(first.start(), element.start());
        prop_assert_eq!(second.end(), element.end());
        prop_assert_eq!(first.end(), second.start());
        for (half, whole) in [(&first, share / 2.0), (&second, 0.5 + share / 2.0)] {
            let gap_mm = (half.at_share(share) - element.shape.at_share(whole)).norm();
            prop_assert!(gap_mm < 1e-9, "{gap_mm} mm");
        }
        let lengths_mm = first.length_mm() + second.length_mm();
        prop_assert!((lengths_mm - element.length_mm).abs() < 1e-9 * element.length_mm.max(1.0));
    }

    #[test]
    fn bounds_hold_every_point_and_are_touched(element in any_element()) {
        let (low, high) = element.bounds();
        let (mut seen_low, mut seen_high) = (element.start(), element.start());
        for index in 0..=2000 {
            let point = element.point(element.length_mm * f64::from(index) / 2000.0);
            seen_low = seen_low.inf(&point);
            seen_high = seen_high.sup(&point);
        }
        prop_assert!((seen_low - low).min() > -1e-9 && (high - seen_high).min() > -1e-9);
        prop_assert!((seen_low - low).max() < 0.01 && (high - seen_high).max() < 0.01);
    }

    #[test]
    fn lengths_add_up(from in -100.0..100.0f64, to in 101.0..300.0f64, share in 0.1..0.9f64) {
        let whole = Element::line(1, at(&[from]), at(&[to]), FEED);
        let middle = whole.point(share * whole.length_mm);
        let path = Path { elements: vec![
            Element::line(1, at(&[from]), middle, FEED),
            Element::line(2, middle, at(&[to]), FEED),
        ] };
        prop_assert!((path.length_mm() - whole.length_mm).abs() < 1e-12);
        prop_assert_eq!(path.first_break(), None);
        prop_assert_eq!(path.line_of(1), Some(2));
        prop_assert_eq!(path.end(), Some(at(&[to])));
    }
}

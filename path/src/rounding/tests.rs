use super::*;
use crate::geometry::{Correction, PathTolerance};
use proptest::prelude::*;

const SETTINGS: RoundingSettings = RoundingSettings {
    corner_angle_rad: 0.5,
    rotary_tolerance_deg: 0.05,
    rotary: [false; PATH_AXES],
};
const FEED: Feed = Feed::PathMmS(100.0);

fn at(x: f64, y: f64) -> AxisVector {
    let mut vector = AxisVector::zeros();
    vector[0] = x;
    vector[1] = y;
    vector
}

fn within(corner_mm: f64) -> PathTolerance {
    PathTolerance {
        corner_mm,
        ..PathTolerance::EXACT
    }
}

fn polyline(points: &[AxisVector], tolerance_mm: f64) -> Vec<Element> {
    let lines = points.windows(2).zip(1..).map(|(ends, line)| Element {
        tolerance: within(tolerance_mm),
        ..Element::line(line, ends[0], ends[1], FEED)
    });
    lines.collect()
}

/// The corrections of the elements `wanted` of those given, which begin at `start_mm` of the path.
fn corrections<'a>(
    elements: impl Iterator<Item = &'a Element>,
    start_mm: f64,
    wanted: std::ops::Range<usize>,
    settings: &RoundingSettings,
) -> Vec<Option<Correction>> {
    let mut junctions = Junctions::new(0, 2);
    let (mut before, mut at_mm) = (None, start_mm);
    for element in elements {
        junctions.push(before, element, at_mm, settings);
        at_mm += element.length_mm;
        before = Some(element);
    }
    if let Some(last) = before {
        junctions.end(last, at_mm);
    }
    junctions.corrections(wanted.start as u32..wanted.end as u32, settings)
}

/// The elements with their corrections.
fn rounded(mut elements: Vec<Element>) -> Vec<Element> {
    let all = 0..elements.len();
    let corrections = corrections(elements.iter(), 0.0, all, &SETTINGS);
    for (element, correction) in elements.iter_mut().zip(corrections) {
        element.rounding = correction.map(std::sync::Arc::new);
    }
    elements
}

/// Places along an element: its ends, and those to both sides of where its pieces meet.
fn places_mm(element: &Element) -> Vec<f64> {
    let pieces = element.rounding.iter().flat_map(|of| of.pieces());
    let mut places: Vec<f64> = pieces.map(|piece| piece.from_mm).collect();
    places.extend((0..=16).map(|share| element.length_mm * f64::from(share) / 16.0));
    places
}

fn furthest_mm(elements: &[Element]) -> f64 {
    let apart = |element: &Element| {
        let places = places_mm(element).into_iter();
        let apart = places.map(|mm| (element.point(mm) - element.programmed_point(mm)).norm());
        apart.fold(0.0, f64::max)
    };
    elements.iter().map(apart).fold(0.0, f64::max)
}

/// How far value, tangent and curvature jump anywhere, the latter with the width of the correction as the length.
fn worst_jump(elements: &[Element]) -> f64 {
    let mut worst = 0.0f64;
    let mut take = |a: [AxisVector; 3], b: [AxisVector; 3]| {
        for (a, b) in a.iter().zip(&b) {
            worst = worst.max((a - b).norm() / (1.0 + a.norm()));
        }
    };
    for element in elements {
        let Some(correction) = &element.rounding else {
            continue;
        };
        for (before, after) in correction.pieces().iter().zip(&correction.pieces()[1..]) {
            let [before, after] = [before, after].map(|of| {
                let [first, second] = of.slopes_at(after.from_mm);
                [of.value_at(after.from_mm), first, second]
            });
            take(before, after);
        }
    }
    let of = |element: &Element, mm: f64| {
        [
            element.point(mm),
            element.tangent(mm),
            element.curvature_per_mm(mm),
        ]
    };
    for pair in elements.windows(2) {
        take(of(&pair[0], pair[0].length_mm), of(&pair[1], 0.0));
    }
    worst
}

#[test]
fn a_corner_is_left_by_its_tolerance_and_as_wide_as_that_needs() {
    let elements = rounded(polyline(&[at(0.0, 0.0), at(5.0, 0.0), at(5.0, 5.0)], 0.01));
    let corner = (elements[0].point(5.0) - at(5.0, 0.0)).norm();
    assert!((corner - 0.01).abs() < 1e-12, "{corner}");
    let half_width_mm = 0.06 / 2f64.sqrt();
    let straight_to_mm = 5.0 - half_width_mm;
    assert_eq!(
        elements[0].point(straight_to_mm - 1e-6),
        at(straight_to_mm - 1e-6, 0.0)
    );
    assert!(elements[0].point(straight_to_mm + 1e-2)[1] > 0.0);
    assert_eq!(elements[1].point(5.0), at(5.0, 5.0));
    assert!(worst_jump(&elements) < 1e-12);
}

#[test]
fn what_must_be_exact_is() {
    let points = [
        at(0.0, 0.0),
        at(5.0, 0.0),
        at(5.0, 5.0),
        at(0.0, 5.0),
        at(0.0, 9.0),
    ];
    let mut elements = polyline(&points, 0.01);
    elements[1].feed = Feed::Rapid;
    elements[3].rests_before = true;
    assert!(
        rounded(elements)
            .iter()
            .all(|element| element.rounding.is_none())
    );
    let exact = rounded(polyline(&points, 0.0));
    assert!(exact.iter().all(|element| element.rounding.is_none()));
}

#[test]
fn a_line_that_runs_into_an_arc_has_a_continuous_curvature() {
    let quarter = std::f64::consts::FRAC_PI_2;
    let mut elements = vec![
        Element::line(1, at(-10.0, -2.0), at(0.0, -2.0), FEED),
        Element::arc(
            2,
            at(0.0, -2.0),
            at(2.0, 0.0),
            at(0.0, 0.0),
            [0, 1],
            quarter,
            FEED,
        ),
        Element::line(3, at(2.0, 0.0), at(2.0, 10.0), FEED),
    ];
    for element in &mut elements {
        element.tolerance = within(0.002);
    }
    let elements = rounded(elements);
    assert!(worst_jump(&elements) < 1e-9, "{}", worst_jump(&elements));
    let furthest_mm = furthest_mm(&elements);
    assert!((0.0015..=0.002).contains(&furthest_mm), "{furthest_mm}");
}

#[test]
fn chords_of_a_circle_become_a_curve_of_nearly_its_curvature() {
    let (radius_mm, chord_mm) = (10.0, 0.1);
    let points: Vec<AxisVector> = (0..200)
        .map(|index| f64::from(index) * chord_mm / radius_mm)
        .map(|angle| at(radius_mm * angle.cos(), radius_mm * angle.sin()))
        .collect();
    let elements = rounded(polyline(&points, 0.01));
    let middle = &elements[60..140];
    for element in middle {
        for mm in places_mm(element) {
            let curvature = element.curvature_per_mm(mm).norm();
            assert!((curvature * radius_mm - 1.0).abs() < 0.02, "{curvature}");
        }
    }
    // As wide as sqrt(12·P·R) asks for.
    let furthest_mm = furthest_mm(middle);
    assert!((0.009..=0.01).contains(&furthest_mm), "{furthest_mm}");
}

/// Points of a circle of 5 mm, so far from it at random.
fn circle(chord_mm: f64, noise_mm: f64) -> Vec<AxisVector> {
    let mut noise = 0.5f64;
    let mut off = || {
        noise = (noise * 9301.0 + 0.49297).fract();
        2.0 * noise_mm * (noise - 0.5)
    };
    let angles = (0..300).map(|index| f64::from(index) * chord_mm / 5.0);
    angles
        .map(|angle| at(5.0 * angle.cos() + off(), 5.0 * angle.sin() + off()))
        .collect()
}

#[test]
fn chords_whose_points_are_off_at_random_become_a_curve_that_hardly_sways() {
    for (chord_mm, noise_mm, sways) in [(0.05, 0.0, 0.05), (0.05, 1e-3, 0.1), (0.2, 1e-3, 0.25)] {
        let elements = rounded(polyline(&circle(chord_mm, noise_mm), 0.01));
        for element in &elements[60..240] {
            for mm in places_mm(element) {
                let curvature = 5.0 * element.curvature_per_mm(mm).norm();
                assert!((curvature - 1.0).abs() < sways, "{chord_mm}: {curvature}");
            }
        }
        assert!(furthest_mm(&elements) <= 0.01);
    }
}

#[test]
fn lines_between_chords_and_ends_of_arcs_stay_where_they_are() {
    let mut points = circle(0.05, 1e-3);
    let end = points[299];
    points.push(end + at(8.0, 0.0));
    points.push(end + at(8.0, 0.05));
    points.push(end + at(8.0, 0.1));
    let elements = rounded(polyline(&points, 0.01));
    let line = &elements[299];
    for mm in [1.0, 4.0, 7.0] {
        assert_eq!(line.point(mm), line.programmed_point(mm));
    }
}

#[test]
fn rotary_axes_keep_a_tolerance_of_their_own() {
    let mut settings = SETTINGS;
    settings.rotary[1] = true;
    let mut elements = polyline(&[at(0.0, 0.0), at(5.0, 0.0), at(10.0, 20.0)], 0.1);
    for element in &mut elements {
        element.length_mm = 5.0;
    }
    let corrections = corrections(elements.iter(), 0.0, 0..2, &settings);
    let [_, rotary_deg] = [0, 1].map(|axis| {
        let added = corrections[0]
            .as_ref()
            .map(|of| of.value_at(5.0))
            .unwrap_or_default();
        added[axis]
    });
    assert!((rotary_deg - 0.05).abs() < 1e-9, "{rotary_deg}");
}

fn turns() -> impl Strategy<Value = Vec<(f64, f64)>> {
    // Lengths over three orders of magnitude; turns of chords and of corners.
    let turn = prop_oneof![4 => -0.2..0.2f64, 1 => -3.1..3.1f64];
    prop::collection::vec((-2.0..1.0f64, turn), 3..60).prop_map(|of| {
        of.into_iter()
            .map(|(exponent, turn)| (10f64.powf(exponent), turn))
            .collect()
    })
}

/// Chords of a curve with noise.
fn chords() -> impl Strategy<Value = Vec<(f64, f64)>> {
    let chords = (-1.8..-0.8f64, -0.05..0.05f64, 0.0..0.05f64, 8..60usize);
    let noise = prop::collection::vec(-1.0..1.0f64, 60);
    prop::collection::vec((chords, noise), 1..4).prop_map(|curves| {
        let curve =
            |((exponent, turn_rad, noise_rad, count), noise): ((_, _, f64, _), Vec<f64>)| {
                let turns = noise.into_iter().take(count);
                turns.map(move |noise| (10f64.powf(exponent), turn_rad + noise * noise_rad))
            };
        curves.into_iter().flat_map(curve).collect()
    })
}

fn points(turns: &[(f64, f64)]) -> Vec<AxisVector> {
    let (mut point, mut angle) = (AxisVector::zeros(), 0.0f64);
    let mut points = vec![point];
    for (length_mm, turn_rad) in turns {
        angle += turn_rad;
        point += at(length_mm * angle.cos(), length_mm * angle.sin());
        points.push(point);
    }
    points
}

proptest! {
    #[test]
    fn the_path_stays_within_its_tolerance_and_is_smooth(turns in prop_oneof![turns(), chords()], tolerance_mm in 1e-3..0.1f64) {
        let elements = rounded(polyline(&points(&turns), tolerance_mm));
        // To a picometre: places some metres along a path are known to a femtometre.
        let most_mm = furthest_mm(&elements);
        prop_assert!(most_mm <= tolerance_mm + 1e-9, "{} of {}", most_mm, tolerance_mm);
        prop_assert!(worst_jump(&elements) < 1e-6);
        let (first, last) = (&elements[0], &elements[elements.len() - 1]);
        prop_assert!((first.point(0.0) - first.start()).norm() < 1e-12);
        prop_assert!((last.point(last.length_mm) - last.end()).norm() < 1e-12);
    }

    #[test]
    fn a_path_and_its_reverse_are_rounded_alike(turns in prop_oneof![turns(), chords()]) {
        let points = points(&turns);
        let forth = rounded(polyline(&points, 0.02));
        let mut backward = points;
        backward.reverse();
        let back = rounded(polyline(&backward, 0.02));
        for (a, b) in forth.iter().zip(back.iter().rev()) {
            for mm in places_mm(a) {
                let apart = (a.point(mm) - b.point(b.length_mm - mm)).norm();
                prop_assert!(apart < 1e-9, "{}", apart);
            }
        }
    }
}

#[test]
fn what_is_made_of_an_element_depends_on_those_beside_it_alone() {
    let mut angle = 0.0f64;
    let turns: Vec<(f64, f64)> = (0..2000)
        .map(|index| {
            angle = (angle * 7.3 + 0.37 * f64::from(index)).sin();
            (0.05 + 0.04 * angle, 0.3 * angle)
        })
        .collect();
    let elements = polyline(&points(&turns), 0.01);
    let whole = rounded(elements.clone());
    let reach = REACH_ELEMENTS as usize;
    let (from, to) = (1000, 1010);
    let start_mm: f64 = elements[..from - reach].iter().map(|of| of.length_mm).sum();
    let near = &elements[from - reach..to + reach];
    let part = corrections(near.iter(), start_mm, reach..reach + to - from, &SETTINGS);
    for (element, correction) in whole[from..to].iter().zip(&part) {
        assert_eq!(element.rounding.as_deref(), correction.as_ref());
    }
}

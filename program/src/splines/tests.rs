//! Curves against the points that LinuxCNC 2.9's interpreter puts on them, and the arcs against the curves.

use super::*;

fn weighted(points: &[(f64, f64, f64)]) -> Vec<ControlPoint> {
    points
        .iter()
        .map(|&(x, y, weight)| ControlPoint {
            at_mm: Flat::new(x, y),
            weight,
        })
        .collect()
}

const SEVEN: [(f64, f64, f64); 7] = [
    (0.0, 0.0, 1.0),
    (0.0, 1.0, 1.0),
    (20.0, 0.0, 1.0),
    (15.0, -30.0, 2.0),
    (40.0, 10.0, 0.5),
    (30.0, 30.0, 3.0),
    (-5.0, 20.0, 1.0),
];

fn of_order_5() -> Curve {
    let mut points = weighted(&SEVEN);
    points[1].at_mm = Flat::new(0.0, 10.0);
    Curve::nurbs(points, 5).unwrap()
}

/// Curves, the step between the points that follow (of 15 to each control point), and these points.
#[expect(clippy::too_many_lines, reason = "a table of points")]
fn table() -> Vec<(Curve, usize, Vec<[f64; 2]>)> {
    vec![
        // G0 X1 Y2 / G5 X4 Y5 I1 J3 P-2 Q-3
        (
            Curve::cubic(
                Flat::new(1.0, 2.0),
                Flat::new(2.0, 5.0),
                Flat::new(2.0, 2.0),
                Flat::new(4.0, 5.0),
            ),
            6,
            vec![
                [1.273, 2.732],
                [1.504, 3.176],
                [1.711, 3.404],
                [1.912, 3.488],
                [2.125, 3.5],
                [2.368, 3.512],
                [2.659, 3.596],
                [3.016, 3.824],
                [3.457, 4.268],
                [4.0, 5.0],
            ],
        ),
        // G5 X10 Y0 I30 J30 P-30 Q30
        (
            Curve::cubic(
                Flat::new(0.0, 0.0),
                Flat::new(30.0, 30.0),
                Flat::new(-20.0, 30.0),
                Flat::new(10.0, 0.0),
            ),
            6,
            vec![
                [6.76, 8.1],
                [9.68, 14.4],
                [9.72, 18.9],
                [7.84, 21.6],
                [5.0, 22.5],
                [2.16, 21.6],
                [0.28, 18.9],
                [0.32, 14.4],
                [3.24, 8.1],
                [10.0, 0.0],
            ],
        ),
        // G5.1 X4 Y0 I1 J20
        (
            Curve::quadratic(
                Flat::new(0.0, 0.0),
                Flat::new(1.0, 20.0),
                Flat::new(4.0, 0.0),
            ),
            5,
            vec![
                [0.246_913_580_247, 3.950_617_283_95],
                [0.543_209_876_543, 6.913_580_246_91],
                [0.888_888_888_889, 8.888_888_888_89],
                [1.283_950_617_28, 9.876_543_209_88],
                [1.728_395_061_73, 9.876_543_209_88],
                [2.222_222_222_22, 8.888_888_888_89],
                [2.765_432_098_77, 6.913_580_246_91],
                [3.358_024_691_36, 3.950_617_283_95],
                [4.0, 0.0],
            ],
        ),
        // G5.2 X0 Y1 P1 / X2 Y2 P1 / X2 Y0 P1 / X0 Y0 P2 / G5.3
        (
            Curve::nurbs(
                weighted(&[
                    (0.0, 0.0, 1.0),
                    (0.0, 1.0, 1.0),
                    (2.0, 2.0, 1.0),
                    (2.0, 0.0, 1.0),
                    (0.0, 0.0, 2.0),
                ]),
                3,
            )
            .unwrap(),
            8,
            vec![
                [0.1024, 0.5888],
                [0.4096, 1.0752],
                [0.9216, 1.4592],
                [1.4816, 1.6624],
                [1.84, 1.56],
                [1.9936, 1.1504],
                [1.782_148_260_21, 0.546_142_208_775],
                [1.045_066_991_47, 0.147_381_242_387],
                [0.254_283_137_962, 0.008_115_419_296_66],
            ],
        ),
        // G5.2 P1, the points of `SEVEN`, G5.3
        (
            Curve::nurbs(weighted(&SEVEN), 3).unwrap(),
            11,
            vec![
                [2.743_764_172_34, 0.636_054_421_769],
                [10.928_652_321_6, 0.385_050_962_627],
                [17.017_543_859_6, -8.342_105_263_16],
                [16.327_845_383, -22.190_408_017_2],
                [16.681_645_350_8, -26.335_983_408_2],
                [22.654_028_436, -16.729_857_819_9],
                [31.707_317_073_2, 17.804_878_048_8],
                [30.174_778_166_2, 28.273_729_497_2],
                [20.597_826_087, 27.065_217_391_3],
            ],
        ),
        // The same with L5 and its second point at Y10.
        (
            of_order_5(),
            11,
            vec![
                [4.333_136_387_45, 4.566_923_275_17],
                [11.430_356_734_9, -2.233_009_415_95],
                [15.671_350_907_5, -11.685_552_594_6],
                [17.325_984_158_1, -17.989_272_145_6],
                [18.997_189_994_3, -18.745_711_724_4],
                [22.622_371_768, -9.864_859_248_8],
                [27.604_461_974_6, 9.774_436_090_23],
                [28.745_452_312_6, 24.211_825_774_2],
                [21.352_722_55, 26.917_388_214_8],
            ],
        ),
    ]
}

#[test]
fn curves_pass_where_the_reference_interpreter_says() {
    for (curve, step, points) in table() {
        for (index, expected) in points.iter().enumerate() {
            let count = 15 * curve.points.len();
            let parameter = curve.last_parameter() * ((index + 1) * step) as f64 / count as f64;
            let (found, _) = curve.at(parameter);
            assert!(
                (found - Flat::new(expected[0], expected[1])).length() < 1e-9,
                "{curve:?} at {parameter}: {found:?}, not {expected:?}"
            );
        }
    }
}

/// The largest distance of a place on the shapes from the curve.
fn farthest_mm(curve: &Curve, shapes: &[Shape]) -> f64 {
    let samples = 40_000;
    let on_curve: Vec<Flat> = (0..=samples)
        .map(|index| {
            curve
                .at(curve.last_parameter() * f64::from(index) / f64::from(samples))
                .0
        })
        .collect();
    let mut farthest_mm: f64 = 0.0;
    let mut nearest = 0;
    for shape in shapes {
        let element = Element::new(
            1,
            shape.clone(),
            path::geometry::Feed::Rapid,
            &path::geometry::ALL_LINEAR,
        );
        for part in 0..=10 {
            let place = element.point(element.length_mm * f64::from(part) / 10.0);
            let place = Flat::new(place[0], place[1]);
            let distance = |index: usize| {
                let Some([from, to]) = on_curve.get(index..index + 2) else {
                    return f64::INFINITY;
                };
                let chord = *to - *from;
                let share = (place - *from).dot(chord) / chord.dot(chord).max(1e-30);
                (place - (*from + chord * share.clamp(0.0, 1.0))).length()
            };
            // Shapes follow the curve in order: look on from the last nearest place.
            let window = nearest..(nearest + 2_000).min(on_curve.len());
            nearest = window
                .min_by(|&one, &other| distance(one).total_cmp(&distance(other)))
                .unwrap_or(nearest);
            farthest_mm = farthest_mm.max(distance(nearest));
        }
    }
    farthest_mm
}

#[test]
fn the_arcs_stay_within_the_tolerance_and_meet_with_one_tangent() {
    for (curve, _, _) in table() {
        let mut from = AxisVector::zeros();
        let begin = curve.at(0.0).0;
        (from[0], from[1], from[2]) = (begin.u, begin.v, 7.0);
        let shapes = curve.shapes(&from, [0, 1]).unwrap();
        let found_mm = farthest_mm(&curve, &shapes);
        assert!(found_mm < 1.2 * TOLERANCE_MM, "{curve:?}: {found_mm} mm");
        assert!(shapes.len() < 2_000, "{curve:?}: {}", shapes.len());
        let end = shapes.last().unwrap().end();
        assert!((Flat::new(end[0], end[1]) - curve.end()).length() < 1e-9);
        assert_eq!(end[2].to_bits(), 7.0_f64.to_bits());
        let elements: Vec<Element> = shapes
            .into_iter()
            .map(|shape| {
                Element::new(
                    1,
                    shape,
                    path::geometry::Feed::Rapid,
                    &path::geometry::ALL_LINEAR,
                )
            })
            .collect();
        for pair in elements.windows(2) {
            assert_eq!(pair[0].end(), pair[1].start());
            let kink = pair[1].tangent(0.0) - pair[0].tangent(pair[0].length_mm);
            assert!(kink.norm() < 1e-4, "{curve:?}: {}", kink.norm());
        }
    }
}

#[test]
fn a_curve_without_a_tangent_at_its_start_or_inside_is_followed_all_the_same() {
    // Control points that coincide: a straight line, slower at its start.
    let straight = Curve::quadratic(
        Flat::new(0.0, 0.0),
        Flat::new(0.0, 0.0),
        Flat::new(4.0, 5.0),
    );
    let shapes = straight.shapes(&AxisVector::zeros(), [0, 1]).unwrap();
    assert!(
        shapes
            .iter()
            .all(|shape| matches!(shape, Shape::Line { .. }))
    );
    // A cusp in the middle.
    let cusp = Curve::cubic(
        Flat::new(0.0, 0.0),
        Flat::new(10.0, 10.0),
        Flat::new(0.0, 10.0),
        Flat::new(10.0, 0.0),
    );
    let shapes = cusp.shapes(&AxisVector::zeros(), [0, 1]).unwrap();
    let found_mm = farthest_mm(&cusp, &shapes);
    assert!(found_mm < 2.0 * TOLERANCE_MM, "{found_mm} mm");
    // All points in one place: nothing to follow.
    let point = Curve::quadratic(
        Flat::new(1.0, 1.0),
        Flat::new(1.0, 1.0),
        Flat::new(1.0, 1.0),
    );
    assert_eq!(point.pieces().unwrap(), []);
}

#[test]
fn a_curve_that_cannot_be_is_refused() {
    let found = |points: &[(f64, f64, f64)], order| {
        let refusal = Curve::nurbs(weighted(points), order).unwrap_err();
        format!("{}: {}", refusal.found, refusal.right)
    };
    assert_eq!(
        found(&SEVEN[..2], 3),
        "a spline of 2 control points: at least as many as its order: L is 3, the start counts as one"
    );
    assert_eq!(found(&SEVEN, 11), "a spline of order L11: L from 3 to 10");
    assert_eq!(
        found(&[(0.0, 0.0, 1.0), (1.0, 1.0, 0.0), (2.0, 0.0, 1.0)], 3),
        "a control point of weight P0: a weight is above 0"
    );
}

#[test]
fn a_curve_that_no_arc_can_follow_is_refused_in_bounded_time() {
    let refused = |curve: Curve| {
        curve
            .shapes(&AxisVector::zeros(), [0, 1])
            .unwrap_err()
            .found
    };
    assert_eq!(
        refused(Curve::quadratic(
            Flat::new(0.0, 0.0),
            Flat::new(f64::NAN, 1.0),
            Flat::new(2.0, 2.0)
        )),
        "a control point at NaN mm, 1 mm"
    );
    assert_eq!(
        refused(Curve::quadratic(
            Flat::new(0.0, 0.0),
            Flat::new(1e300, 1.0),
            Flat::new(2.0, 2.0)
        )),
        "a control point at 1e300 mm, 1 mm"
    );
    let zigzag: Vec<(f64, f64, f64)> = (0..POINTS_MAX)
        .map(|index| match index % 3 {
            0 => (1e7, 0.0, 1.0),
            1 => (-1e7, 1e7, 1.0),
            _ => (0.0, -1e7, 1.0),
        })
        .collect();
    let curve = Curve::nurbs(weighted(&zigzag), ORDER_MAX).unwrap();
    assert_eq!(refused(curve), "a spline that bends too often");
}

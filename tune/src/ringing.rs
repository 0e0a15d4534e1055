//! The frequency at which a machine rings after a change of acceleration.
//!
//! While an axis slides at a steady speed after it was accelerated, its friction is constant: what is left of its place beside a straight line is a
//! sum of damped oscillations, the same ones in every stroke. Their poles are found from all strokes together by the rotational
//! invariance of the signal's subspace (Roy, Kailath, *ESPRIT*, IEEE Trans. Acoust. Speech Signal Process. 37, 1989; for damped oscillations: Hua,
//! Sarkar, *Matrix pencil method*, same Trans. 38, 1990); their sizes by least squares. A pole counts if it is found with models of
//! several orders (a stabilization diagram, as in modal analysis).

use nalgebra::{Complex, DMatrix, DVector};

use super::recording::Recording;

/// Relative precision of a singular value decomposition: nalgebra's own.
const SVD_PRECISION: f64 = 5.0 * f64::EPSILON;
/// Steps after which it is given up: it takes a few for each of its values, and without a bound some would never end.
const SVD_STEPS_MAX: usize = 10_000;
/// Signals are looked at in steps of about this, in s: a mode that matters is below 200 Hz.
const STEP_S: f64 = 1e-3;
/// Rows of the matrix whose columns are pieces of the signal: 80 ms, a period and a half of 20 Hz.
const ROWS: usize = 80;
/// Orders of the models that must agree.
const ORDERS: [usize; 3] = [6, 8, 10];
/// As much as frequencies of the same mode may differ between them.
const SAME_SHARE: f64 = 0.05;
/// Speed counts as steady above this share of the stroke's highest.
const STEADY_SHARE: f64 = 0.95;
/// Left out at the beginning and at the end of steady speed, in s: a drive and its feed-forward are not in step with the command.
const MARGIN_S: [f64; 2] = [3e-3, 8e-3];
/// Frequencies that are looked for, in Hz.
const LOWEST_HZ: f64 = 8.0;
/// The highest, over the frequency of the steps.
const HIGHEST_SHARE: f64 = 0.25;
/// Damping ratios of what counts as ringing: loops are damped better, cogging at a steady speed is not damped at all.
const DAMPING: [f64; 2] = [0.003, 0.2];
/// Oscillations below this are none, in µm: above the noise of encoders, far below what is set for.
const LEAST_UM: f64 = 0.5;

/// A damped oscillation of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ringing {
    /// Its frequency, in Hz.
    pub frequency_hz: f64,
    /// Its damping ratio.
    pub damping_ratio: f64,
    /// How large it is after the axis was accelerated, in µm: root mean square over the strokes of its amplitude where speed begins to be steady.
    pub amplitude_um: f64,
}

/// What rings of an axis in these strokes, the largest first. Of its scale where it has one.
pub fn ringing(strokes: &Recording) -> Vec<Ringing> {
    let every = libm::round(STEP_S / strokes.scan_s).max(1.0) as usize;
    let step_s = every as f64 * strokes.scan_s;
    let spans: Vec<Vec<f64>> = steady_spans(strokes)
        .into_iter()
        .filter_map(|span| strokes.scale_mm.get(span))
        .map(|places| deviation_um(&averages(places, every)))
        .filter(|span| span.len() > 2 * ROWS)
        .collect();
    let Some((subspace, energies)) = subspace(&spans) else {
        return Vec::new();
    };
    let of_orders: Vec<Vec<Complex<f64>>> = ORDERS
        .iter()
        .filter(|order| energies.get(**order - 1).is_some_and(|of| *of > 0.0))
        .map(|order| poles(&subspace, *order))
        .collect();
    let Some((last, others)) = of_orders.split_last() else {
        return Vec::new();
    };
    let rate_of = |pole: &Complex<f64>| pole.ln() / step_s;
    let near = |of: &Complex<f64>, pole: &Complex<f64>| {
        (rate_of(of) - rate_of(pole)).norm() < SAME_SHARE * rate_of(pole).norm()
    };
    let is_stable =
        |pole: &&Complex<f64>| others.iter().all(|of| of.iter().any(|of| near(of, pole)));
    let sizes_um = sizes_um(&spans, last);
    let both = last.iter().zip(sizes_um);
    let mut found: Vec<Ringing> = both
        .filter(|(pole, _)| pole.im > 0.0 && is_stable(pole))
        .map(|(pole, amplitude_um)| {
            let rate = rate_of(pole);
            Ringing {
                frequency_hz: rate.norm() / (2.0 * core::f64::consts::PI),
                damping_ratio: -rate.re / rate.norm(),
                amplitude_um,
            }
        })
        .filter(|of| {
            (LOWEST_HZ..HIGHEST_SHARE / step_s).contains(&of.frequency_hz)
                && (DAMPING[0]..DAMPING[1]).contains(&of.damping_ratio)
                && of.amplitude_um >= LEAST_UM
        })
        .collect();
    found.sort_by(|a, b| b.amplitude_um.total_cmp(&a.amplitude_um));
    found
}

/// Where the axis is commanded a steady speed for long.
fn steady_spans(strokes: &Recording) -> Vec<core::ops::Range<usize>> {
    let command = &strokes.velocity_command_mm_s;
    let scans = |seconds: f64| libm::ceil(seconds / strokes.scan_s) as usize;
    let highest_mm_s = command.iter().fold(0.0f64, |most, of| most.max(of.abs()));
    let mut spans = Vec::new();
    let mut from = 0;
    for index in 0..=command.len() {
        let steady = |index: usize| {
            let of = command.get(index).copied().unwrap_or(0.0);
            (of.abs() > STEADY_SHARE * highest_mm_s).then(|| of.signum())
        };
        let goes_on = index > 0 && steady(index) == steady(index - 1);
        if !goes_on {
            let (begin, end) = (
                from + scans(MARGIN_S[0]),
                index.saturating_sub(scans(MARGIN_S[1])),
            );
            if index > 0 && steady(index - 1).is_some() && begin < end {
                spans.push(begin..end);
            }
            from = index;
        }
    }
    spans
}

/// Means of so many values each.
fn averages(values: &[f64], every: usize) -> Vec<f64> {
    values
        .chunks_exact(every)
        .map(|chunk| chunk.iter().sum::<f64>() / every as f64)
        .collect()
}

/// What places are beside a straight line through them, in µm.
fn deviation_um(places_mm: &[f64]) -> Vec<f64> {
    let count = places_mm.len() as f64;
    let middle = 0.5 * (count - 1.0);
    let mean_mm = places_mm.iter().sum::<f64>() / count;
    let (mut product, mut squares) = (0.0, 0.0);
    for (index, place_mm) in places_mm.iter().enumerate() {
        let away = index as f64 - middle;
        product += away * (place_mm - mean_mm);
        squares += away * away;
    }
    let slope_mm = product / squares.max(f64::MIN_POSITIVE);
    let straight_mm = |index: usize| mean_mm + slope_mm * (index as f64 - middle);
    let all = places_mm.iter().enumerate();
    all.map(|(index, place_mm)| (place_mm - straight_mm(index)) * 1e3)
        .collect()
}

/// The directions in which pieces of the signals lie, those with the most energy first, and these energies.
fn subspace(spans: &[Vec<f64>]) -> Option<(DMatrix<f64>, Vec<f64>)> {
    let mut products = DMatrix::<f64>::zeros(ROWS, ROWS);
    for piece in spans.iter().flat_map(|span| span.windows(ROWS)) {
        let piece = DVector::from_column_slice(piece);
        products.ger(1.0, &piece, &piece, 1.0);
    }
    if spans.is_empty() || products.trace() <= 0.0 {
        return None;
    }
    let eigen = products.symmetric_eigen();
    let mut order: Vec<usize> = (0..ROWS).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let columns: Vec<_> = order
        .iter()
        .map(|index| eigen.eigenvectors.column(*index).into_owned())
        .collect();
    let energies = order.iter().map(|index| eigen.eigenvalues[*index]);
    Some((DMatrix::from_columns(&columns), energies.collect()))
}

/// What turns the subspace of so many directions by one step: its eigenvalues are the poles.
fn poles(subspace: &DMatrix<f64>, order: usize) -> Vec<Complex<f64>> {
    let before = subspace.view((0, 0), (ROWS - 1, order)).into_owned();
    let after = subspace.view((1, 0), (ROWS - 1, order)).into_owned();
    let parts = before.try_svd(true, true, SVD_PRECISION, SVD_STEPS_MAX);
    let turn = parts.and_then(|parts| parts.solve(&after, 1e-12).ok());
    turn.map_or(Vec::new(), |turn| {
        turn.complex_eigenvalues().iter().copied().collect()
    })
}

/// Amplitude of each pole's oscillation at the beginning of the spans, in µm; of one that grows at their end.
fn sizes_um(spans: &[Vec<f64>], poles: &[Complex<f64>]) -> Vec<f64> {
    let mut squares = vec![0.0; poles.len()];
    for span in spans {
        // What grows is counted from the end of the span: numbers of many orders of magnitude are never decomposed.
        let last = span.len() as i32 - 1;
        let power = |pole: &Complex<f64>, row: usize| match row as i32 {
            row if pole.norm_sqr() > 1.0 => pole.powi(row - last),
            row => pole.powi(row),
        };
        let powers = DMatrix::from_fn(span.len(), poles.len(), |row, column| {
            poles
                .get(column)
                .map_or(Complex::default(), |pole| power(pole, row))
        });
        let values = DVector::from_iterator(span.len(), span.iter().map(|of| Complex::from(*of)));
        let parts = powers.try_svd(true, true, SVD_PRECISION, SVD_STEPS_MAX);
        if let Some(Ok(sizes)) = parts.map(|parts| parts.solve(&values, 1e-9)) {
            for (sum, size) in squares.iter_mut().zip(sizes.iter()) {
                *sum += 4.0 * size.norm_sqr();
            }
        }
    }
    let count = spans.len().max(1) as f64;
    squares.iter().map(|sum| (sum / count).sqrt()).collect()
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use super::*;

    /// Strokes at 100 mm/s with these oscillations behind each change of speed: frequency, damping ratio, µm; noise, and a line of cogging.
    fn strokes(scan_s: f64, modes: &[(f64, f64, f64)], cogging_um: f64) -> Recording {
        let mut recording = Recording {
            scan_s,
            ..Recording::default()
        };
        let mut place_mm = 0.0;
        let mut state = 1u64;
        for stroke in 0..12 {
            let direction = if stroke % 2 == 0 { 1.0 } else { -1.0 };
            let scans = libm::round((0.40 - 0.01 * f64::from(stroke)) / scan_s) as usize;
            for scan in 0..scans + 20 {
                let t = scan as f64 * scan_s;
                let rings = |(hz, damping, um): &(f64, f64, f64)| {
                    let w = 2.0 * PI * hz;
                    um * (-damping * w * t).exp() * (w * (1.0 - damping * damping).sqrt() * t).cos()
                };
                let ringing_um: f64 = modes.iter().map(rings).sum();
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                let noise_um = 0.05 * ((state >> 40) as f64 / 16_777_216.0 - 0.5);
                let cogging = cogging_um * (2.0 * PI * 120.0 * t + f64::from(stroke)).sin();
                let speed_mm_s = if scan < scans { 100.0 * direction } else { 0.0 };
                place_mm += speed_mm_s * scan_s;
                let deviation_um = ringing_um + noise_um + cogging;
                recording
                    .scale_mm
                    .push(place_mm + direction * deviation_um * 1e-3);
                recording.velocity_command_mm_s.push(speed_mm_s);
            }
        }
        recording
    }

    #[test]
    fn two_damped_modes_are_found_beside_cogging_and_noise() {
        for scan_s in [1e-3, 250e-6] {
            let found = ringing(&strokes(
                scan_s,
                &[(65.0, 0.02, 30.0), (38.0, 0.05, 8.0)],
                0.3,
            ));
            let [first, second] = found.as_slice() else {
                panic!("{found:?}");
            };
            assert!((first.frequency_hz / 65.0 - 1.0).abs() < 0.01, "{first:?}");
            assert!((first.damping_ratio / 0.02 - 1.0).abs() < 0.1, "{first:?}");
            assert!(
                (second.frequency_hz / 38.0 - 1.0).abs() < 0.01,
                "{second:?}"
            );
            assert!((20.0..32.0).contains(&first.amplitude_um), "{first:?}");
        }
    }

    #[test]
    fn a_loop_that_is_damped_well_and_cogging_do_not_ring() {
        let found = ringing(&strokes(1e-3, &[(48.0, 0.6, 20.0)], 2.0));
        assert_eq!(found, []);
        assert_eq!(ringing(&strokes(1e-3, &[], 0.0)), []);
        assert_eq!(ringing(&Recording::default()), []);
    }
}

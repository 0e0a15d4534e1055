//! Least squares with coefficients that may be bound to be not negative.

use nalgebra::{Cholesky, DMatrix, DVector, DVectorView};

/// Normal equations, gathered row by row.
#[derive(Debug, Clone)]
pub struct NormalEquations {
    /// `Σ w·aᵀa`, its lower triangle.
    gram: DMatrix<f64>,
    /// `Σ w·aᵀy`.
    right: DVector<f64>,
    /// `Σ w·y²`.
    square: f64,
    /// `Σ w`.
    weight: f64,
}

/// What fits best.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// One coefficient per column.
    pub coefficients: Vec<f64>,
    /// Root of the weighted mean square of what is left, in the unit of the right side.
    pub residual: f64,
}

impl NormalEquations {
    /// For rows of this length.
    pub fn new(columns: usize) -> NormalEquations {
        NormalEquations {
            gram: DMatrix::zeros(columns, columns),
            right: DVector::zeros(columns),
            square: 0.0,
            weight: 0.0,
        }
    }

    /// Takes in one equation `Σ row·x = y`.
    pub fn add(&mut self, row: &[f64], y: f64, weight: f64) {
        let row = DVectorView::from_slice(row, row.len());
        self.gram.syger(weight, &row, &row, 1.0);
        self.right.axpy(weight * y, &row, 1.0);
        self.square += weight * y * y;
        self.weight += weight;
    }

    /// The best coefficients, those of the first `bound` columns not negative.
    ///
    /// Active set method of Lawson and Hanson (Solving Least Squares Problems, 1974, ch. 23) on the normal equations; columns that
    /// never vary get 0.
    pub fn solve(&self, bound: usize) -> Fit {
        let mut gram = self.gram.clone();
        gram.fill_upper_triangle_with_lower_triangle();
        let n = self.right.len();
        let usable: Vec<bool> = gram.diagonal().iter().map(|square| *square > 0.0).collect();
        let mut free: Vec<bool> = (0..n).map(|i| i >= bound && usable[i]).collect();
        let mut x = solve_free(&gram, &self.right, &free);
        for _ in 0..10 * n.max(1) {
            let gradient = &self.right - &gram * &x;
            let most = (0..bound)
                .filter(|i| usable[*i] && !free[*i])
                .map(|i| (i, gradient[i] / gram[(i, i)].sqrt()))
                .max_by(|a, b| a.1.total_cmp(&b.1));
            let Some((enters, slope)) = most else { break };
            if slope <= 1e-9 * self.square.sqrt() {
                break;
            }
            free[enters] = true;
            x = self.within_bounds(&gram, x, &mut free, bound);
        }
        let left = self.square - 2.0 * x.dot(&self.right) + x.dot(&(&gram * &x));
        Fit {
            coefficients: x.as_slice().to_vec(),
            residual: if self.weight > 0.0 {
                (left.max(0.0) / self.weight).sqrt()
            } else {
                0.0
            },
        }
    }

    /// The best on the free columns, on the way from `x`: columns that would become negative are bound again.
    fn within_bounds(
        &self,
        gram: &DMatrix<f64>,
        mut x: DVector<f64>,
        free: &mut [bool],
        bound: usize,
    ) -> DVector<f64> {
        loop {
            let wanted = solve_free(gram, &self.right, free);
            let blocking = (0..bound)
                .filter(|i| free[*i] && wanted[*i] <= 0.0)
                .map(|i| x[i] / (x[i] - wanted[i]))
                .fold(f64::INFINITY, f64::min);
            if !blocking.is_finite() {
                return wanted;
            }
            x.axpy(blocking, &wanted, 1.0 - blocking);
            let mut left = false;
            for i in 0..bound {
                if free[i] && wanted[i] <= 0.0 && x[i] <= 1e-12 {
                    x[i] = 0.0;
                    free[i] = false;
                    left = true;
                }
            }
            if !left {
                return x;
            }
        }
    }
}

/// Least squares on the columns that are free, by Cholesky on columns scaled to the same length; 0 for the others.
fn solve_free(gram: &DMatrix<f64>, right: &DVector<f64>, free: &[bool]) -> DVector<f64> {
    let index: Vec<usize> = (0..free.len()).filter(|i| free[*i]).collect();
    let m = index.len();
    let scale: Vec<f64> = index.iter().map(|i| gram[(*i, *i)].sqrt()).collect();
    let mut matrix = DMatrix::from_fn(m, m, |a, b| {
        gram[(index[a], index[b])] / (scale[a] * scale[b])
    });
    for a in 0..m {
        // So much correlation is allowed that rounding does not decide.
        matrix[(a, a)] += 1e-10;
    }
    let right = DVector::from_fn(m, |a, _| right[index[a]] / scale[a]);
    let cholesky = Cholesky::new_with_substitute(matrix, 1e-12);
    let solved = cholesky.map_or_else(|| DVector::zeros(m), |it| it.solve(&right));
    let mut x = DVector::zeros(free.len());
    for (a, i) in index.iter().enumerate() {
        x[*i] = solved[a] / scale[a];
    }
    x
}

/// Place of the smallest value of a function with one minimum, by golden section (Kiefer 1953), to 1/1000 of the range.
pub fn golden_section(low: f64, high: f64, mut cost: impl FnMut(f64) -> f64) -> f64 {
    const RATIO: f64 = 0.618_033_988_749_895;
    let (mut low, mut high) = (low, high);
    let width = high - low;
    let (mut a, mut b) = (high - RATIO * width, low + RATIO * width);
    let (mut at_a, mut at_b) = (cost(a), cost(b));
    while high - low > 1e-3 * width {
        if at_a <= at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - RATIO * (high - low);
            at_a = cost(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + RATIO * (high - low);
            at_b = cost(b);
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_equations_are_solved_exactly() {
        let mut equations = NormalEquations::new(3);
        for i in 0..50 {
            let t = f64::from(i) * 0.1;
            let row = [1.0, t, t * t];
            equations.add(&row, 2.0 + 3.0 * t + 0.5 * t * t, 1.0);
        }
        let fit = equations.solve(3);
        for (found, right) in fit.coefficients.iter().zip([2.0, 3.0, 0.5]) {
            assert!((found - right).abs() < 1e-6, "{fit:?}");
        }
        assert!(fit.residual < 1e-4, "{fit:?}");
    }

    #[test]
    fn a_coefficient_that_would_be_negative_is_zero_and_the_others_make_the_best_of_it() {
        let mut equations = NormalEquations::new(2);
        for i in 0..50 {
            let t = f64::from(i) * 0.1;
            equations.add(&[1.0, t], 5.0 - t, 1.0);
        }
        let fit = equations.solve(2);
        assert_eq!(fit.coefficients[1], 0.0);
        assert!((fit.coefficients[0] - (5.0 - 2.45)).abs() < 1e-6, "{fit:?}");
        let free = equations.solve(0);
        assert!((free.coefficients[1] + 1.0).abs() < 1e-6, "{free:?}");
    }

    #[test]
    fn a_column_that_never_varies_gets_zero() {
        let mut equations = NormalEquations::new(2);
        equations.add(&[1.0, 0.0], 4.0, 1.0);
        assert_eq!(equations.solve(2).coefficients[1], 0.0);
    }

    #[test]
    fn the_minimum_is_found() {
        let place = golden_section(0.0, 10.0, |x| (x - 3.7) * (x - 3.7));
        assert!((place - 3.7).abs() < 0.02, "{place}");
    }
}

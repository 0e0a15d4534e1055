//! Least squares of a few causes: what was seen of them, summed up.

use bytemuck::{Pod, Zeroable};
use nalgebra::{SMatrix, SVector};

use super::CAUSES;

/// Normal equations of some scans.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Normal {
    /// Upper half of the matrix, line by line.
    pub matrix: [f64; CAUSES * (CAUSES + 1) / 2],
    pub right: [f64; CAUSES],
    /// Square of what is to be explained.
    pub square: f64,
    pub weight: f64,
}

impl Normal {
    pub fn add(&mut self, causes: &[f64; CAUSES], value: f64, weight: f64) {
        let mut entries = self.matrix.iter_mut();
        for (line, cause) in causes.iter().enumerate() {
            for other in causes.iter().skip(line) {
                if let Some(entry) = entries.next() {
                    *entry += weight * cause * other;
                }
            }
        }
        for (right, cause) in self.right.iter_mut().zip(causes) {
            *right += weight * cause * value;
        }
        self.square += weight * value * value;
        self.weight += weight;
    }

    /// `keep` times this and another, the other divided by its weight.
    pub fn with(&self, keep: f64, other: &Normal) -> Normal {
        let mut sum = *self;
        let part = 1.0 / other.weight;
        for (own, new) in sum.matrix.iter_mut().zip(other.matrix) {
            *own = keep * *own + part * new;
        }
        for (own, new) in sum.right.iter_mut().zip(other.right) {
            *own = keep * *own + part * new;
        }
        sum.square = keep * sum.square + part * other.square;
        sum.weight = keep * sum.weight + 1.0;
        sum
    }

    pub fn whole(&self) -> SMatrix<f64, CAUSES, CAUSES> {
        let mut matrix = SMatrix::<f64, CAUSES, CAUSES>::zeros();
        let mut entries = self.matrix.iter();
        for line in 0..CAUSES {
            for column in line..CAUSES {
                let entry = entries.next().copied().unwrap_or(0.0);
                if let Some(place) = matrix.get_mut((line, column)) {
                    *place = entry;
                }
                if let Some(place) = matrix.get_mut((column, line)) {
                    *place = entry;
                }
            }
        }
        matrix
    }

    /// Mean square that these values leave.
    pub fn left(&self, values: &SVector<f64, CAUSES>) -> f64 {
        let right = SVector::from(self.right);
        let left = self.square - 2.0 * values.dot(&right) + values.dot(&(self.whole() * values));
        (left / self.weight.max(f64::MIN_POSITIVE)).max(0.0)
    }
}

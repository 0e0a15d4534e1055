//! What rounding has added to an element: cubics in its distance.

use nalgebra::SVector;

use super::{AxisVector, PATH_AXES, first_axes};

/// A cubic from a place on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CubicPiece<const AXES: usize = PATH_AXES> {
    /// Where it begins, in mm on its element.
    pub from_mm: f64,
    /// What is added there, and its first, second and third derivative with respect to the distance.
    pub derivatives: [SVector<f64, AXES>; 4],
}

impl CubicPiece {
    /// That of the first axes alone.
    pub(super) fn first_axes<const AXES: usize>(&self) -> CubicPiece<AXES> {
        CubicPiece {
            from_mm: self.from_mm,
            derivatives: self.derivatives.each_ref().map(first_axes),
        }
    }
}

impl<const AXES: usize> CubicPiece<AXES> {
    /// What is added at a distance on the element.
    pub fn value_at(&self, distance_mm: f64) -> SVector<f64, AXES> {
        let [value, first, second, third] = &self.derivatives;
        let y = distance_mm - self.from_mm;
        value + (first + (second + third * (y / 3.0)) * (y / 2.0)) * y
    }

    /// The first and second derivative of that.
    pub fn slopes_at(&self, distance_mm: f64) -> [SVector<f64, AXES>; 2] {
        let [_, first, second, third] = &self.derivatives;
        let y = distance_mm - self.from_mm;
        [first + (second + third * (y / 2.0)) * y, second + third * y]
    }
}

/// What rounding adds to an element.
#[derive(Debug, Clone, PartialEq)]
pub struct Correction {
    pub(crate) pieces: Vec<CubicPiece>,
}

impl Correction {
    /// The cubics, in order; each holds up to the next, the last up to the end of the element.
    pub fn pieces(&self) -> &[CubicPiece] {
        &self.pieces
    }

    /// The first and second derivative of what is added at a distance on the element.
    pub fn slopes_at(&self, distance_mm: f64) -> [AxisVector; 2] {
        let piece = self.piece_at(distance_mm);
        piece.map_or([AxisVector::zeros(); 2], |of| of.slopes_at(distance_mm))
    }

    /// What is added at a distance on the element.
    pub fn value_at(&self, distance_mm: f64) -> AxisVector {
        let piece = self.piece_at(distance_mm);
        piece.map_or_else(AxisVector::zeros, |piece| piece.value_at(distance_mm))
    }

    /// The cubic that holds at a distance on the element; the first before it.
    pub(crate) fn piece_at(&self, distance_mm: f64) -> Option<&CubicPiece> {
        let behind = self
            .pieces
            .partition_point(|piece| piece.from_mm <= distance_mm);
        self.pieces.get(behind.max(1) - 1)
    }
}

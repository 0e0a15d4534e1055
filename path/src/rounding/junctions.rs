//! The junctions of a path, each made, evened out and weighed once, as far as all is known that has a part in it.

use std::ops::Range;

use crate::geometry::{Correction, Element, PATH_AXES};

use super::correction::{Cubics, Round};
use super::evening::{self, FITTED};
use super::{Junction, NEIGHBOURS, REACH_ELEMENTS, RoundingSettings, half_widths, of_all};

/// Junctions that are let go of together.
const GONE_TOGETHER: usize = 1024;

/// Junctions to either side whose widths and their own neighbours have a part in the correction of an element.
const WIDTHS: usize = half_widths::REACH_JUNCTIONS + NEIGHBOURS;

/// The junctions before elements one behind the other.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Junctions {
    known: Vec<Junction>,
    /// Number of the element behind the first of them.
    first: u32,
    /// So many of them are moved, so many weighed.
    moved: usize,
    weighed: usize,
    /// The path ends with the last of them.
    is_ended: bool,
    /// Axes that there are: all others stay where they are.
    axis_count: usize,
}

impl Junctions {
    /// None yet of a path that goes on with the element `first`.
    pub fn new(first: u32, axis_count: usize) -> Self {
        Self {
            known: Vec::new(),
            first,
            moved: 0,
            weighed: 0,
            is_ended: false,
            axis_count,
        }
    }

    /// The path goes on with this element, behind the one before, if there is one; it begins at `at_mm`.
    pub fn push(
        &mut self,
        before: Option<&Element>,
        element: &Element,
        at_mm: f64,
        settings: &RoundingSettings,
    ) {
        self.known.push(match before {
            Some(before) => Junction::between(before, element, at_mm, settings),
            None => Junction {
                point: element.start(),
                ..Junction::exact(at_mm)
            },
        });
    }

    /// Nothing comes after the last element, which ends at `at_mm`.
    pub fn end(&mut self, last: &Element, at_mm: f64) {
        if !self.is_ended {
            self.is_ended = true;
            self.known.push(Junction {
                point: last.end(),
                ..Junction::exact(at_mm)
            });
        }
    }

    /// The corrections of the elements `wanted`; none where the path stays as it is.
    ///
    /// All that are known, [`REACH_ELEMENTS`] before them and behind them, must be there, or the path begins and ends there.
    pub fn corrections(
        &mut self,
        wanted: Range<u32>,
        settings: &RoundingSettings,
    ) -> Vec<Option<Correction>> {
        match self.axis_count {
            0..=2 => self.corrections_of::<2>(wanted, settings),
            3..=4 => self.corrections_of::<4>(wanted, settings),
            _ => self.corrections_of::<PATH_AXES>(wanted, settings),
        }
    }

    fn corrections_of<const AXES: usize>(
        &mut self,
        wanted: Range<u32>,
        settings: &RoundingSettings,
    ) -> Vec<Option<Correction>> {
        self.even_out::<AXES>(settings);
        self.weigh::<AXES>(settings);
        let index = |element: u32| element.saturating_sub(self.first) as usize;
        let from = index(wanted.start).saturating_sub(WIDTHS);
        let to = (index(wanted.end) + WIDTHS + 1).min(self.known.len());
        let near = self.known.get(from..to).unwrap_or_default();
        let half_widths_mm = half_widths::of_junctions_mm(near);
        let round = near.iter().zip(half_widths_mm);
        let round: Vec<Round<AXES>> = round.map(|(of, half)| Round::of(of, half)).collect();
        let mut cubics = Cubics::new();
        let corrections = wanted.map(|element| index(element) - from);
        corrections
            .map(|element| Correction::of(&round, element, &mut cubics))
            .collect()
    }

    /// Moves the points of which all is known that has a part in it.
    fn even_out<const AXES: usize>(&mut self, settings: &RoundingSettings) {
        let ahead = if self.is_ended { 0 } else { FITTED };
        for index in self.moved..self.known.len().saturating_sub(ahead) {
            let (moved, taken) = evening::move_point::<AXES>(&self.known, index, settings);
            if let Some(junction) = self.known.get_mut(index) {
                (junction.moved, junction.taken) = (moved, taken);
            }
            self.moved = index + 1;
        }
    }

    /// Weighs the jumps at those whose neighbours are moved too.
    fn weigh<const AXES: usize>(&mut self, settings: &RoundingSettings) {
        let to = if self.is_ended {
            self.moved
        } else {
            self.moved.saturating_sub(1)
        };
        for index in self.weighed..to {
            let slope = |index: usize| match self.known.get(index..index + 2) {
                Some([before, behind]) => of_all(&evening::slope::<AXES>(before, behind)),
                _ => Default::default(),
            };
            let slope_before = index.checked_sub(1).map(slope).unwrap_or_default();
            let turns = slope(index) - slope_before;
            if let Some(junction) = self.known.get_mut(index) {
                junction.kink = junction.programmed_kink + turns;
                junction.weigh(settings);
            }
            self.weighed = index + 1;
        }
    }

    /// Lets go of those that have no part any more in what is made of this element and those behind it.
    pub fn forget_before(&mut self, element: u32) {
        let keep_from = element.saturating_sub(REACH_ELEMENTS);
        let gone = keep_from.saturating_sub(self.first) as usize;
        let gone = gone.min(self.known.len());
        if gone >= GONE_TOGETHER {
            self.known.drain(..gone);
            self.first += gone as u32;
            // Nothing is moved where nothing is rounded.
            self.moved = self.moved.saturating_sub(gone);
            self.weighed = self.weighed.saturating_sub(gone);
        }
    }
}

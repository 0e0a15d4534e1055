//! How numbers are spread.

/// A share of so many, as a percentage; 0 of none.
pub(super) fn percent(some: usize, of: usize) -> f64 {
    100.0 * some as f64 / of.max(1) as f64
}

/// Numbers in the order of their size.
#[derive(Debug, Clone)]
pub(super) struct Distribution(Vec<f64>);

impl Distribution {
    pub fn of(numbers: impl Iterator<Item = f64>) -> Distribution {
        let mut numbers: Vec<f64> = numbers.collect();
        numbers.sort_by(f64::total_cmp);
        Distribution(numbers)
    }

    /// The number that this share of all are not above, by line between two of them; none of none.
    pub fn at(&self, share: f64) -> Option<f64> {
        let place = share * self.0.len().checked_sub(1)? as f64;
        let low = *self.0.get(place as usize)?;
        let high = self.0.get(place as usize + 1).copied().unwrap_or(low);
        Some(low + (high - low) * place.fract())
    }

    /// A tenth, a half and nine tenths of all are not above these; the largest.
    pub fn words(&self) -> String {
        let cells = [0.1, 0.5, 0.9, 1.0].map(|share| match self.at(share) {
            Some(number) => format!("{number:>7.2}"),
            None => format!("{:>7}", "-"),
        });
        cells.concat()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_of_the_numbers_is_not_above_its_place() {
        let numbers = Distribution::of([4.0, 1.0, 3.0, 2.0, 5.0].into_iter());
        assert_eq!(numbers.at(0.5), Some(3.0));
        assert_eq!(numbers.at(1.0), Some(5.0));
        assert_eq!(numbers.at(0.0), Some(1.0));
        assert!((numbers.at(0.9).unwrap_or(0.0) - 4.6).abs() < 1e-12);
        assert_eq!(Distribution::of(std::iter::empty()).at(0.5), None);
    }
}

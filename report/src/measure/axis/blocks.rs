//! Peaks per block: a line of the program, all passes through it together.

use std::collections::BTreeMap;

use bus::sample::MAX_AXES;

/// What was measured while the command stood in one block.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BlockPeaks {
    /// Scans, holds in the block included.
    pub scans: u64,
    /// Largest distance of the table from the programmed path, in mm.
    pub contour_error_mm: f64,
    /// Largest following error of each axis, in mm.
    pub following_error_mm: [f64; MAX_AXES],
}

impl BlockPeaks {
    fn join(&mut self, other: &BlockPeaks) {
        self.scans += other.scans;
        self.contour_error_mm = self.contour_error_mm.max(other.contour_error_mm);
        let errors = self.following_error_mm.iter_mut();
        for (mine, theirs) in errors.zip(other.following_error_mm) {
            *mine = mine.max(theirs);
        }
    }
}

/// Peaks of every block that was travelled: as many as the program has lines at most.
#[derive(Debug, Clone, Default)]
pub struct BlockMeter {
    /// The block of the last scan, not yet among the others.
    current: Option<(u32, BlockPeaks)>,
    blocks: BTreeMap<u32, BlockPeaks>,
}

impl BlockMeter {
    /// Takes one scan in the block of this line.
    ///
    /// The table follows its command with a lag: what it does in the first milliseconds of a block is the end of the one before.
    pub fn take(
        &mut self,
        line: u32,
        contour_error_mm: f64,
        following_error_mm: impl Iterator<Item = f64>,
    ) {
        if self
            .current
            .as_ref()
            .is_none_or(|(block, _)| *block != line)
        {
            self.put_away();
            self.current = Some((line, BlockPeaks::default()));
        }
        let Some((_, block)) = &mut self.current else {
            return;
        };
        let mut scan = BlockPeaks {
            scans: 1,
            contour_error_mm,
            ..BlockPeaks::default()
        };
        for (place, error_mm) in scan.following_error_mm.iter_mut().zip(following_error_mm) {
            // A NaN is no error that could be compared: f64::max leaves it out.
            *place = error_mm.abs();
        }
        block.join(&scan);
    }

    fn put_away(&mut self) {
        if let Some((line, block)) = self.current.take() {
            self.blocks.entry(line).or_default().join(&block);
        }
    }

    /// The blocks, in order of their lines.
    pub fn finish(mut self) -> Vec<(u32, BlockPeaks)> {
        self.put_away();
        self.blocks.into_iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_that_is_passed_again_keeps_the_larger_peak_and_counts_on() {
        let mut meter = BlockMeter::default();
        for (line, contour, following) in [
            (4, 0.001, [0.02, -0.01]),
            (4, 0.003, [-0.05, 0.01]),
            (7, 0.1, [f64::NAN, 0.0]),
            (4, 0.002, [0.01, 0.04]),
        ] {
            meter.take(line, contour, following.into_iter());
        }
        let blocks = meter.finish();
        assert_eq!(blocks.len(), 2);
        let (line, four) = blocks[0];
        assert_eq!((line, four.scans, four.contour_error_mm), (4, 3, 0.003));
        assert_eq!(four.following_error_mm[..3], [0.05, 0.04, 0.0]);
        assert_eq!(blocks[1].1.following_error_mm[0], 0.0);
    }
}

//! The last scans in memory of a fixed size, taken and touched at the start: a recorder does not grow while a run goes on.

use std::collections::VecDeque;

#[derive(Debug, Clone, Copy)]
struct Place {
    scan: u64,
    start: usize,
    length: usize,
    /// It is handed over before it goes.
    is_missed: bool,
}

impl Place {
    fn end(&self) -> usize {
        self.start + self.length
    }
}

/// The samples of the last scans: as many as fit, and none older than asked for.
#[derive(Debug)]
pub(super) struct Ring {
    bytes: Vec<u8>,
    /// Oldest first; each in one piece.
    places: VecDeque<Place>,
    write_at: usize,
    scans_max: usize,
}

impl Ring {
    /// Of so many bytes for so many scans.
    pub(super) fn new(bytes: usize, scans_max: usize) -> Ring {
        let mut memory = vec![0; bytes];
        // Zeroes come from the kernel page by page when they are first written to: now, not in a scan.
        for page in memory.chunks_mut(4096) {
            if let Some(first) = page.first_mut() {
                *first = 1;
            }
        }
        Ring {
            bytes: std::hint::black_box(memory),
            places: VecDeque::with_capacity(scans_max.max(1) + 1),
            write_at: 0,
            scans_max: scans_max.max(1),
        }
    }

    /// Puts the samples of the next scan in. A scan that has to go for it and will be missed is handed to `forget` before; nobody looks
    /// at the others, which are no longer near the processor.
    pub(super) fn push(
        &mut self,
        scan: u64,
        samples: &[u8],
        is_missed: bool,
        mut forget: impl FnMut(&[u8]),
    ) {
        let length = samples.len();
        if length > self.bytes.len() {
            return;
        }
        while self.places.len() >= self.scans_max {
            self.pop(&mut forget);
        }
        if self.write_at + length > self.bytes.len() {
            // What lies from here to the end is the oldest there is.
            while self
                .places
                .front()
                .is_some_and(|p| p.start >= self.write_at)
            {
                self.pop(&mut forget);
            }
            self.write_at = 0;
        }
        let (start, end) = (self.write_at, self.write_at + length);
        while self
            .places
            .front()
            .is_some_and(|place| place.start < end && start < place.end())
        {
            self.pop(&mut forget);
        }
        if let Some(space) = self.bytes.get_mut(start..end) {
            space.copy_from_slice(samples);
        }
        self.write_at = end;
        self.places.push_back(Place {
            scan,
            start,
            length,
            is_missed,
        });
    }

    fn pop(&mut self, forget: &mut impl FnMut(&[u8])) {
        if let Some(place) = self.places.pop_front()
            && place.is_missed
        {
            forget(self.bytes.get(place.start..place.end()).unwrap_or_default());
        }
    }

    /// Scans from this one on, oldest first, with their samples.
    pub(super) fn from(&self, scan: u64) -> impl Iterator<Item = (u64, &[u8])> {
        let first = self.places.partition_point(|place| place.scan < scan);
        self.places.range(first..).map(|place| {
            let samples = self.bytes.get(place.start..place.end());
            (place.scan, samples.unwrap_or_default())
        })
    }

    /// Scans in it, and the bytes that it takes.
    #[cfg(test)]
    pub(super) fn held(&self) -> (usize, usize) {
        (self.places.len(), self.bytes.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples of a scan: as long as `length` says, every byte the scan.
    fn samples(scan: u64, length: usize) -> Vec<u8> {
        vec![scan as u8; length]
    }

    #[test]
    fn the_newest_scans_that_fit_are_there_whole_whatever_their_lengths() {
        let mut ring = Ring::new(1000, 40);
        let mut forgotten = Vec::new();
        let length = |scan: u64| 10 + (scan * 37 % 91) as usize;
        for scan in 0..10_000u64 {
            let is_missed = scan % 3 == 0;
            ring.push(scan, &samples(scan, length(scan)), is_missed, |bytes| {
                forgotten.push(bytes.to_vec());
            });
            let held: Vec<(u64, Vec<u8>)> =
                ring.from(0).map(|(scan, b)| (scan, b.to_vec())).collect();
            let first = scan + 1 - held.len() as u64;
            assert!(held.len() <= 40 && held.len() >= 8.min(scan as usize + 1));
            for ((found, bytes), expected) in held.into_iter().zip(first..) {
                assert_eq!(found, expected);
                assert_eq!(
                    bytes,
                    samples(expected, length(expected)),
                    "scan {expected}"
                );
            }
        }
        // Each that went and is missed was handed over once, in order.
        for (scan, bytes) in (0..).step_by(3).zip(&forgotten) {
            assert_eq!(*bytes, samples(scan, length(scan)));
        }
        let gone = 10_000 - ring.held().0;
        assert_eq!(forgotten.len(), gone.div_ceil(3));
        assert_eq!(ring.from(9_995).count(), 5);
        assert_eq!(ring.from(10_000).count(), 0);
    }

    #[test]
    fn what_is_larger_than_the_ring_is_left_out() {
        let mut ring = Ring::new(100, 10);
        ring.push(1, &samples(1, 50), false, |_| {});
        ring.push(2, &samples(2, 101), false, |_| {});
        ring.push(3, &samples(3, 50), false, |_| {});
        let scans: Vec<u64> = ring.from(0).map(|(scan, _)| scan).collect();
        assert_eq!(scans, [1, 3]);
    }
}

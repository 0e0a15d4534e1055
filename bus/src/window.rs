//! The identity of windows: a checksum over what they say.

use bytemuck::bytes_of;
use xxhash_rust::xxh3::Xxh3;

use crate::sample::{Setpoint, WindowHeader};

/// Rows that are put together before they go into the hash.
const ROWS: usize = 16;
/// Words of a row.
const WORDS: usize = size_of::<Setpoint>() / size_of::<u64>();

/// Checksum of a window: XXH3-64 over its header with the checksum field zeroed, then its setpoints, without the ninth place where it is
/// 0 in all of them. So a window of eight axes, and with it the motion digest of a run, has the name that it had before there were nine.
///
/// Two windows that differ never hash the same bytes: with the number of rows, which the header says, their length tells whether the
/// ninth place is among them.
pub fn checksum(header: &WindowHeader, setpoints: &[Setpoint]) -> u64 {
    let mut header = *header;
    header.id.checksum = 0;
    let mut hash = Xxh3::new();
    hash.update(bytes_of(&header));
    let stays = |Setpoint {
                     position: [.., ninth],
                     ..
                 }: &Setpoint| *ninth == 0;
    if !setpoints.iter().all(stays) {
        hash.update(bytemuck::cast_slice(setpoints));
        return hash.digest();
    }
    let mut rows = [[0; WORDS - 1]; ROWS];
    for setpoints in setpoints.chunks(ROWS) {
        for (row, setpoint) in rows.iter_mut().zip(setpoints) {
            let [a, b, c, d, e, f, g, h, _, i, j]: [u64; WORDS] = bytemuck::cast(*setpoint);
            *row = [a, b, c, d, e, f, g, h, i, j];
        }
        let used = rows.get(..setpoints.len()).unwrap_or(&rows);
        hash.update(bytemuck::cast_slice(used));
    }
    hash.digest()
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use super::*;
    use crate::sample::{PATH_AXES, PathTag};
    use bytemuck::Zeroable;

    #[test]
    fn a_changed_row_or_header_changes_the_checksum_and_the_stored_one_does_not() {
        let mut header = WindowHeader::zeroed();
        let mut setpoints = vec![Setpoint::zeroed(); 5];
        let before = checksum(&header, &setpoints);
        header.id.checksum = before;
        assert_eq!(before, checksum(&header, &setpoints));
        header.first_scan = 1;
        assert_ne!(before, checksum(&header, &setpoints));
        header.first_scan = 0;
        for place in 0..PATH_AXES {
            let mut moved = setpoints.clone();
            if let Some(setpoint) = moved.get_mut(3) {
                setpoint.position[place] = 1;
            }
            assert_ne!(before, checksum(&header, &moved), "{place}");
        }
        if let Some(setpoint) = setpoints.get_mut(3) {
            setpoint.tag.dwell_remaining_scans = 1;
        }
        assert_ne!(before, checksum(&header, &setpoints));
    }

    /// Whichever bit of whichever row, with a ninth axis that moves and without one.
    #[test]
    fn no_flipped_bit_of_a_row_passes() {
        let header = WindowHeader::zeroed();
        for ninth in [0, 7] {
            let row = |at: i64| Setpoint {
                position: [at, 0, 0, 0, 0, 0, 0, 5, ninth * (at % 3)],
                tag: PathTag::OFF_PATH,
            };
            let setpoints: Vec<Setpoint> = (0..40).map(row).collect();
            let before = checksum(&header, &setpoints);
            for byte in 0..size_of_val(setpoints.as_slice()) {
                let mut flipped = setpoints.clone();
                let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut flipped);
                bytes[byte] ^= 1 << (byte % 8);
                assert_ne!(before, checksum(&header, &flipped), "byte {byte}");
            }
        }
    }

    /// Digests of runs, and what was learned of programs, outlive the number of axes.
    #[test]
    fn a_window_of_eight_axes_has_the_checksum_that_it_had_before_there_were_nine() {
        let header = WindowHeader {
            setpoint_count: 37,
            ..WindowHeader::zeroed()
        };
        let row = |at: i64| Setpoint {
            position: [at, -at, 3 * at, 4, 5, 6, 7, 8 * at, 0],
            tag: PathTag::default(),
        };
        let setpoints: Vec<Setpoint> = (0..37).map(row).collect();
        let words = |setpoint: &Setpoint| -> Vec<u8> {
            let places = bytemuck::cast_slice(&setpoint.position[..8]);
            [places, bytes_of(&setpoint.tag)].concat()
        };
        let mut all = bytes_of(&header).to_vec();
        all.extend(setpoints.iter().flat_map(words));
        assert_eq!(
            checksum(&header, &setpoints),
            xxhash_rust::xxh3::xxh3_64(&all)
        );
    }
}

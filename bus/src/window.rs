//! The identity of windows: a checksum over what they say.

use bytemuck::bytes_of;
use xxhash_rust::xxh3::Xxh3;

use crate::sample::{Setpoint, WindowHeader};

/// Checksum of a window: XXH3-64 over its header with the checksum field zeroed, then its setpoints.
pub fn checksum(header: &WindowHeader, setpoints: &[Setpoint]) -> u64 {
    let mut header = *header;
    header.id.checksum = 0;
    let mut hash = Xxh3::new();
    hash.update(bytes_of(&header));
    hash.update(bytemuck::cast_slice(setpoints));
    hash.digest()
}

#[cfg(test)]
mod tests {
    use super::*;
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
        if let Some(setpoint) = setpoints.get_mut(3) {
            setpoint.position[7] = 1;
        }
        assert_ne!(before, checksum(&header, &setpoints));
    }
}

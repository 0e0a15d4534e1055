//! Parts of a saved state, one after the other.

use bytemuck::Pod;
use master::StateRefused;

/// Writes a part of the state to the beginning of what is left of the bytes, if it fits.
pub(crate) fn put(bytes: &mut &mut [u8], part: &impl Pod) {
    put_bytes(bytes, bytemuck::bytes_of(part));
}

/// The same of bytes.
pub(crate) fn put_bytes(bytes: &mut &mut [u8], part: &[u8]) {
    if let Some(slot) = bytes.split_off_mut(..part.len()) {
        slot.copy_from_slice(part);
    }
}

/// Reads a part of the state from the beginning of what is left of the bytes.
pub(crate) fn taken<T: Pod>(bytes: &mut &[u8]) -> Result<T, StateRefused> {
    let slot = bytes.split_off(..size_of::<T>()).ok_or(StateRefused)?;
    Ok(bytemuck::pod_read_unaligned(slot))
}

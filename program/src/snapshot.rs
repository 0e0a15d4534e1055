//! The state of a reading as bytes: what its interpreter knows between two blocks, to the bit.
//!
//! The text, the machine and what was made are not in it: whoever goes on has the first two, and took the last away.

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use crate::error::{ProgramError, refuse_file};

/// What every snapshot begins with; its last byte counts the versions of what is in it.
const BEGINS: &[u8; 8] = b"QREAD\0\0\x06";
/// Its beginning, the hash of the program, and the checksum at its end.
const HASH_BYTES: usize = 8;

/// Bytes of a state of this program.
pub fn pack(source_hash: u64, state: &impl Serialize) -> Vec<u8> {
    let mut bytes = BEGINS.to_vec();
    bytes.extend(source_hash.to_le_bytes());
    // Nothing in a state refuses to be written.
    bytes.extend(postcard::to_allocvec(state).unwrap_or_default());
    let sum = xxh3_64(&bytes);
    bytes.extend(sum.to_le_bytes());
    bytes
}

/// The state in bytes of [`pack`].
pub fn unpack<'a, T: Deserialize<'a>>(
    name: &str,
    source_hash: u64,
    bytes: &'a [u8],
) -> Result<T, ProgramError> {
    let refuse = |found: &str| {
        let right = "the program is read again from its beginning";
        refuse_file(name, found, right)
    };
    let damaged = "a state to go on from that is damaged";
    let content = bytes
        .split_last_chunk::<HASH_BYTES>()
        .filter(|(content, sum)| xxh3_64(content) == u64::from_le_bytes(**sum))
        .map(|(content, _)| content);
    let Some(content) = content else {
        return refuse(damaged);
    };
    let Some(content) = content.strip_prefix(BEGINS) else {
        return refuse("a state to go on from that another version wrote");
    };
    match content.split_first_chunk::<HASH_BYTES>() {
        Some((hash, state)) if u64::from_le_bytes(*hash) == source_hash => {
            postcard::from_bytes(state).or_else(|_| refuse(damaged))
        }
        _ => refuse("a state to go on from of another program, machine or start"),
    }
}

/// Feeds, which belong to another crate.
pub mod feed {
    use path::geometry::Feed;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    /// Writes one: its speed, none for a rapid.
    pub fn serialize<S: Serializer>(feed: &Feed, to: S) -> Result<S::Ok, S::Error> {
        let speed_mm_s = match feed {
            Feed::Rapid => None,
            Feed::PathMmS(speed_mm_s) => Some(*speed_mm_s),
        };
        speed_mm_s.serialize(to)
    }

    /// Reads one.
    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Feed, D::Error> {
        let speed_mm_s = Option::<f64>::deserialize(from)?;
        Ok(speed_mm_s.map_or(Feed::Rapid, Feed::PathMmS))
    }
}

/// What is asked of an input, as it travels.
pub mod asked_input {
    use bus::sample::AskedInput;
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(asked: &AskedInput, to: S) -> Result<S::Ok, S::Error> {
        asked.wire().serialize(to)
    }

    pub fn deserialize<'a, D: Deserializer<'a>>(from: D) -> Result<AskedInput, D::Error> {
        let wire = u32::deserialize(from)?;
        AskedInput::from_wire(wire).ok_or_else(|| D::Error::custom("an input that there is not"))
    }
}

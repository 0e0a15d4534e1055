//! One record of a log, read from bytes that may be anything.

use mcap::McapError;
use mcap::records::{Record, op};

/// Log time and creation time, before the name of an attachment.
const TIMES_BYTES: usize = 16;
/// The length of the data, behind the media type.
const LENGTH_BYTES: usize = 8;
/// The checksum, behind the data.
const CHECKSUM_BYTES: usize = 4;

/// Parses a record as [`mcap::parse_record`] does.
///
/// `mcap` 0.26 slices an attachment that ends before its data begins without asking for its length, and panics.
///
/// # Errors
/// Whatever is wrong with it.
pub fn parse_record(opcode: u8, body: &[u8]) -> Result<Record<'_>, McapError> {
    if opcode == op::ATTACHMENT && !holds_its_header(body) {
        return Err(McapError::BadAttachmentLength {
            header: (TIMES_BYTES + LENGTH_BYTES + CHECKSUM_BYTES) as u64,
            available: body.len() as u64,
        });
    }
    mcap::parse_record(opcode, body)
}

/// Whether an attachment is long enough for its times, its two texts, the length of its data and its checksum.
fn holds_its_header(body: &[u8]) -> bool {
    let behind_text = |at: usize| {
        let bytes = body.get(at..at.checked_add(4)?)?;
        let length = u32::from_le_bytes(bytes.try_into().ok()?);
        at.checked_add(4)?.checked_add(length as usize)
    };
    behind_text(TIMES_BYTES)
        .and_then(behind_text)
        .and_then(|at| at.checked_add(LENGTH_BYTES + CHECKSUM_BYTES))
        .is_some_and(|end| end <= body.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_attachment_cut_anywhere_is_refused_or_read() {
        let mut body = vec![0; TIMES_BYTES];
        for text in ["part.ngc", "text/plain"] {
            body.extend((text.len() as u32).to_le_bytes());
            body.extend(text.as_bytes());
        }
        body.extend(3u64.to_le_bytes());
        body.extend(b"G0\n");
        body.extend([0; CHECKSUM_BYTES]);
        for length in 0..body.len() {
            assert!(
                parse_record(op::ATTACHMENT, &body[..length]).is_err(),
                "{length}"
            );
        }
        assert!(!holds_its_header(&[0xff; 64]));
    }
}

//! The digest of a run: equal if and only if everything recorded is equal.
//!
//! Each channel has one writer and its own order, and what happens between two channels of one scan is chance. So
//! every channel is hashed for itself (XXH3, 128 bits, over its messages in order) and the channels are put together in the
//! order of their names. The checksum that a sample was sent with stands for it: its reader has checked that. Derived
//! channels (`/axis/…`, `/servo_state/…`), `/event` and `/bus_cycle` are left out: the first say nothing new, the second speaks
//! to people, and what a wire does (times, damaged frames) is chance.

use std::collections::BTreeMap;

use xxhash_rust::xxh3::Xxh3;

/// Running hash of one channel.
#[derive(Clone, Default)]
pub struct ChannelHash {
    state: Box<Xxh3>,
    messages: u64,
}

impl ChannelHash {
    /// Takes the next message.
    pub fn update(&mut self, message: &[u8]) {
        self.state.update(&(message.len() as u64).to_le_bytes());
        self.state.update(message);
        self.messages += 1;
    }
}

/// Whether a channel counts in the digest.
pub fn counts(topic: &str) -> bool {
    let derived = ["/axis/", "/servo_state/"];
    !derived.iter().any(|prefix| topic.starts_with(prefix))
        && topic != "/event"
        && topic != "/bus_cycle"
}

/// The digest over all channels, as 32 hexadecimal digits.
pub fn combine<'a>(channels: impl IntoIterator<Item = (&'a str, &'a ChannelHash)>) -> String {
    let in_order: BTreeMap<&str, &ChannelHash> = channels
        .into_iter()
        .filter(|(topic, hash)| counts(topic) && hash.messages > 0)
        .collect();
    let mut all = Xxh3::new();
    for (topic, hash) in in_order {
        all.update(&(topic.len() as u64).to_le_bytes());
        all.update(topic.as_bytes());
        all.update(&hash.messages.to_le_bytes());
        all.update(&hash.state.digest128().to_le_bytes());
    }
    hex(all.digest128())
}

/// The digest of a log in parts, over the digests of the parts in their order.
pub fn over_parts<'a>(digests: impl IntoIterator<Item = &'a str>) -> String {
    let mut all = Xxh3::new();
    for digest in digests {
        all.update(&(digest.len() as u64).to_le_bytes());
        all.update(digest.as_bytes());
    }
    hex(all.digest128())
}

/// A 128-bit hash as 32 hexadecimal digits.
pub fn hex(value: u128) -> String {
    format!("{value:032x}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn digest(messages: &[(usize, Vec<u8>)]) -> String {
        let topics = ["/feedback", "/command/X", "/command/Y"];
        let mut hashes: Vec<ChannelHash> = topics.iter().map(|_| ChannelHash::default()).collect();
        for (channel, message) in messages {
            hashes[*channel].update(message);
        }
        combine(topics.iter().copied().zip(&hashes))
    }

    fn messages() -> impl Strategy<Value = Vec<(usize, Vec<u8>)>> {
        proptest::collection::vec(
            (0..3usize, proptest::collection::vec(any::<u8>(), 1..40)),
            1..30,
        )
    }

    proptest! {
        #[test]
        fn interleaving_of_channels_does_not_change_the_digest(messages in messages()) {
            let mut grouped = messages.clone();
            grouped.sort_by_key(|(channel, _)| *channel);
            prop_assert_eq!(digest(&messages), digest(&grouped));
        }

        #[test]
        fn any_changed_bit_changes_the_digest(messages in messages(), at in any::<proptest::sample::Index>(), bit in 0..8u8) {
            let mut changed = messages.clone();
            let which = at.index(changed.len());
            let byte = at.index(changed[which].1.len());
            changed[which].1[byte] ^= 1 << bit;
            prop_assert_ne!(digest(&messages), digest(&changed));
        }
    }

    #[test]
    fn order_and_borders_of_messages_within_a_channel_count() {
        let one =
            |parts: &[&[u8]]| digest(&parts.iter().map(|p| (0, p.to_vec())).collect::<Vec<_>>());
        assert_ne!(one(&[b"ab", b"c"]), one(&[b"a", b"bc"]));
        assert_ne!(one(&[b"a", b"b"]), one(&[b"b", b"a"]));
    }

    #[test]
    fn channels_for_people_and_that_of_the_wire_do_not_count() {
        let (mut feedback, mut derived) = (ChannelHash::default(), ChannelHash::default());
        feedback.update(b"x");
        let alone = combine([("/feedback", &feedback)]);
        derived.update(b"y");
        assert_eq!(
            combine([
                ("/feedback", &feedback),
                ("/axis/X", &derived),
                ("/event", &derived)
            ]),
            alone
        );
    }
}

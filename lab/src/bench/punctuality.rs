//! How late something is whose clock nobody knows: behind the most punctual of its time.

/// How late each is counts from the most punctual of so many.
pub(crate) const PUNCTUAL_AMONG: usize = 250;

/// How late each is, in ns, in order: `off_ns` says when it was seen, less when it was due by its own clock.
pub(crate) fn late_ns<T>(seen: &[T], off_ns: impl Fn(&T) -> i128) -> impl Iterator<Item = u64> {
    seen.chunks(PUNCTUAL_AMONG).flat_map(move |some| {
        let offs: Vec<i128> = some.iter().map(&off_ns).collect();
        let punctual = offs.iter().copied().min().unwrap_or(0);
        let late = offs.into_iter().map(move |off| off - punctual);
        late.map(|late| u64::try_from(late).unwrap_or(u64::MAX))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_punctual_of_each_time_is_not_late() {
        let offs: Vec<i128> = (0..2 * PUNCTUAL_AMONG as i128).map(|n| 1000 + n).collect();
        let late: Vec<u64> = late_ns(&offs, |off| *off).collect();
        let of_one: Vec<u64> = (0..PUNCTUAL_AMONG as u64).collect();
        assert_eq!(late, [&of_one[..], &of_one].concat());
    }
}

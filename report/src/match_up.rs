//! Which thing of one run is which of another: those of one key, in their order; and which of its key each is.

use std::collections::BTreeMap;

/// The same thing in both runs, or in one that the other lacks.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Pair<'a, T> {
    pub(super) a: Option<&'a T>,
    pub(super) b: Option<&'a T>,
    /// Which one of its key, from 1.
    pub(super) order: usize,
}

/// Those of A in their order, each with its counterpart, then what only B has.
pub(super) fn matched<'a, T, K: Ord + Clone>(
    a: &'a [T],
    b: &'a [T],
    key: impl Fn(&T) -> K,
) -> Vec<Pair<'a, T>> {
    let mut of_b: BTreeMap<(K, usize), &T> = numbered(b, &key).collect();
    let mut pairs: Vec<Pair<'a, T>> = numbered(a, &key)
        .map(|(place, of_a)| Pair {
            a: Some(of_a),
            b: of_b.remove(&place),
            order: place.1,
        })
        .collect();
    let rest = numbered(b, &key).filter(|(place, _)| of_b.contains_key(place));
    pairs.extend(rest.map(|((_, order), of_b)| Pair {
        a: None,
        b: Some(of_b),
        order,
    }));
    pairs
}

/// Which one of its key each is, from 1.
pub(super) fn orders<T, K: Ord + Clone>(all: &[T], key: impl Fn(&T) -> K) -> Vec<usize> {
    numbered(all, key).map(|((_, order), _)| order).collect()
}

/// Each with its key and which one of that key it is, from 1.
fn numbered<T, K: Ord + Clone>(
    all: &[T],
    key: impl Fn(&T) -> K,
) -> impl Iterator<Item = ((K, usize), &T)> {
    let mut counts: BTreeMap<K, usize> = BTreeMap::new();
    all.iter().map(move |one| {
        let key = key(one);
        let count = counts.entry(key.clone()).or_default();
        *count += 1;
        ((key, *count), one)
    })
}

//! Jobs of a bench, some at a time.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc;

use console::exit::Failure;

/// Does jobs `0` to `count − 1` in so many lanes. `work` gets the job, its lane, and whether another has failed meanwhile; `done` is
/// called after each with all results up to the first that is missing.
///
/// # Errors
/// The first failure; no further job is started after it.
pub fn in_order<T: Send>(
    lanes: usize,
    count: usize,
    work: impl Fn(usize, usize, &AtomicBool) -> Result<T, Failure> + Sync,
    mut done: impl FnMut(&[T]),
) -> Result<Vec<T>, Failure> {
    let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    let (send, receive) = mpsc::channel();
    let mut early: Vec<Option<T>> = (0..count).map(|_| None).collect();
    let mut whole: Vec<T> = Vec::new();
    let mut failure = None;
    std::thread::scope(|scope| {
        for lane in 0..lanes.clamp(1, count.max(1)) {
            let (send, next, failed, work) = (send.clone(), &next, &failed, &work);
            scope.spawn(move || {
                while !failed.load(Ordering::Relaxed) {
                    let job = next.fetch_add(1, Ordering::Relaxed);
                    if job >= count {
                        break;
                    }
                    let result = work(job, lane, failed);
                    failed.fetch_or(result.is_err(), Ordering::Relaxed);
                    if send.send((job, result)).is_err() {
                        break;
                    }
                }
            });
        }
        drop(send);
        for (job, result) in receive {
            match result {
                Ok(result) => {
                    if let Some(place) = early.get_mut(job) {
                        *place = Some(result);
                    }
                    while let Some(result) = early.get_mut(whole.len()).and_then(Option::take) {
                        whole.push(result);
                    }
                    done(&whole);
                }
                Err(error) => {
                    // The first says why; what is still running ends by itself or was interrupted with it.
                    failure.get_or_insert(error);
                }
            }
        }
    });
    failure.map_or(Ok(whole), Err)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_the_order_of_the_jobs_and_each_once() {
        let mut seen = Vec::new();
        let all = in_order(
            3,
            20,
            |job, lane, _| {
                assert!(lane < 3);
                std::thread::sleep(std::time::Duration::from_micros(50 * (job as u64 * 7 % 5)));
                Ok(job * job)
            },
            |whole| seen.push(whole.len()),
        );
        let squares: Vec<usize> = (0..20).map(|job| job * job).collect();
        assert_eq!(all.expect("no failure"), squares);
        assert_eq!((seen.len(), seen.last()), (20, Some(&20)));
        assert!(seen.is_sorted());
    }

    #[test]
    fn after_a_failure_no_further_job_is_begun() {
        let begun = AtomicUsize::new(0);
        let ended = in_order(
            1,
            20,
            |job, _, _| {
                begun.fetch_add(1, Ordering::Relaxed);
                if job == 4 {
                    Err(Failure::Interrupted)
                } else {
                    Ok(())
                }
            },
            |_| {},
        );
        assert!(matches!(ended, Err(Failure::Interrupted)));
        assert_eq!(begun.load(Ordering::Relaxed), 5);
    }
}

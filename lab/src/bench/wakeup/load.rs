//! Work of ordinary priority on every processor.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use bus::realtime;

/// Threads that do nothing for ever; they end with it.
pub(super) struct Load {
    ended: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Load {
    pub fn start() -> Load {
        let ended = Arc::new(AtomicBool::new(false));
        let threads = realtime::processors().into_iter().map(|core| {
            let ended = Arc::clone(&ended);
            std::thread::spawn(move || {
                realtime::stay_on_all(&[core]);
                while !ended.load(Ordering::Relaxed) {
                    std::hint::black_box(core);
                }
            })
        });
        Load {
            threads: threads.collect(),
            ended,
        }
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

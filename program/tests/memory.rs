//! A file is read in memory that does not grow with its length.

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use common::{at, mill};
use program::{Piece, Progress, Reading, check_file};

/// Counts the bytes in use, and the most that there were.
struct Counting;

static USED: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is passed on to the allocator of the system as it is.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let used = USED.fetch_add(layout.size(), Relaxed) + layout.size();
        MOST.fetch_max(used, Relaxed);
        // SAFETY: the caller's own promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        USED.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's own promise.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// The most bytes that were in use while something was done, beyond those before it.
fn most_bytes(act: impl FnOnce()) -> usize {
    let before = USED.load(Relaxed);
    MOST.store(before, Relaxed);
    act();
    MOST.load(Relaxed) - before
}

/// A program of so many passes: lines, arcs, cycles, expressions, a subroutine, comments.
fn file_of(passes: u32) -> tempfile::NamedTempFile {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    let mut to = std::io::BufWriter::new(file.as_file_mut());
    writeln!(to, "G21 G90 F3000\no<lift> sub\nG0 Z#1\no<lift> endsub").unwrap();
    for pass in 0..passes {
        let x = f64::from(pass % 100);
        writeln!(
            to,
            "G1 X{x} Y1.5 (a comment)\nX[{x}+1] Y[#1*2]\nG3 X{x} I-0.5\no<lift> call [{x}]\n#1={x}\nG81 X1 Y2 Z-1 R1\nG80 M8\nG64\n(debug, #1)\nM9"
        )
        .unwrap();
    }
    writeln!(to, "o1 repeat [{passes}]\nG1 X1\nX2\no1 endrepeat\nM2").unwrap();
    to.flush().unwrap();
    drop(to);
    file
}

#[test]
fn memory_does_not_grow_with_the_length_of_a_file() {
    let setup = Arc::new(mill(1000.0));
    let [short, long] = [2_000, 100_000].map(|passes| {
        let file = file_of(passes);
        let read = most_bytes(|| {
            let mut reading = Reading::open(file.path(), &setup, at(&[])).unwrap();
            loop {
                let mut piece = Piece::default();
                if reading.read(100, &mut piece).unwrap() != Progress::More {
                    break;
                }
            }
            assert!(reading.elements_made() > u64::from(passes) * 7);
        });
        let checked = most_bytes(|| {
            check_file(file.path(), &setup, at(&[]), &mut |_| {}).unwrap();
        });
        let bytes = file.as_file().metadata().unwrap().len();
        println!("{bytes} bytes: read with {read}, checked with {checked}");
        [read, checked]
    });
    for (short, long) in short.into_iter().zip(long) {
        assert!(long < short + 20_000, "{short} and {long} bytes");
        assert!(long < 8_000_000, "{long} bytes");
    }
}

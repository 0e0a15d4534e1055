#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| quadrant_fuzz::targets::machine(data));

//! The fuzz targets. The same are run over their seeds by a plain test of the product (tests/fuzz_seeds.rs).

pub mod samples;
pub mod targets;

//! From ESI files to drive files that are good, and what is refused on the way.

mod damage;
mod modules;
mod support;
mod testor;
mod vendors;
mod wrong_files;

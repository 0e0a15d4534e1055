//! The page of the drive file in the book and the schema for editors are those of the keys in the code.

#[path = "../../machine/tests/fresh/mod.rs"]
mod fresh;

use fieldbus::drive_file;
use fresh::assert_fresh;

#[test]
fn the_page_of_the_drive_file_is_that_of_its_keys() {
    assert_fresh("docs/reference/drive-file.md", &drive_file::reference());
}

#[test]
fn the_schema_of_the_drive_file_is_that_of_its_keys() {
    assert_fresh("machines/drive.schema.json", &drive_file::schema().json());
}

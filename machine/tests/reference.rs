//! The page of the machine file in the book and the schema for editors are those of the keys in the code.

use crate::fresh::assert_fresh;

#[test]
fn the_page_of_the_machine_file_is_that_of_its_keys() {
    assert_fresh("docs/reference/machine-file.md", &machine::reference());
}

#[test]
fn the_schema_of_the_machine_file_is_that_of_its_keys() {
    assert_fresh("machines/machine.schema.json", &machine::schema().json());
}

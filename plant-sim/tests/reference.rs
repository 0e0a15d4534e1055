//! The page of the plant file in the book and the schema for editors are those of the keys in the code.

#[path = "../../machine/tests/fresh/mod.rs"]
mod fresh;

use fresh::assert_fresh;
use plant_sim::plant_file;

#[test]
fn the_page_of_the_plant_file_is_that_of_its_keys() {
    assert_fresh("docs/reference/plant-file.md", &plant_file::reference());
}

#[test]
fn the_schema_of_the_plant_file_is_that_of_its_keys() {
    assert_fresh("machines/plant.schema.json", &plant_file::schema().json());
}

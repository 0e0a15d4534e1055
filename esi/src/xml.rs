//! The few things that are asked of an XML element.

use roxmltree::Node;

use super::number;

/// Elements of this name right below `node`.
pub fn children<'a>(node: Node<'a, 'a>, name: &'a str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.children()
        .filter(move |child| child.is_element() && child.tag_name().name() == name)
}

/// The first element of this name right below `node`.
pub fn child<'a>(node: Node<'a, 'a>, name: &'a str) -> Option<Node<'a, 'a>> {
    children(node, name).next()
}

/// The first element below `node` along these names.
pub fn at<'a>(node: Node<'a, 'a>, names: &[&'a str]) -> Option<Node<'a, 'a>> {
    names.iter().try_fold(node, |node, name| child(node, name))
}

/// Its text, without space around it.
pub fn text<'a>(node: Node<'a, 'a>) -> &'a str {
    node.text().unwrap_or_default().trim()
}

/// The text of the first element of this name below it.
pub fn text_of<'a>(node: Node<'a, 'a>, name: &'a str) -> Option<&'a str> {
    child(node, name).map(text)
}

/// A number in the first element of this name below it.
pub fn number_of<T: TryFrom<i64>>(node: Node<'_, '_>, name: &str) -> Option<T> {
    let found = node
        .children()
        .find(|child| child.is_element() && child.tag_name().name() == name)?;
    number::narrow(found.text().unwrap_or_default())
}

/// A number in an attribute.
pub fn number_in<T: TryFrom<i64>>(node: Node<'_, '_>, attribute: &str) -> Option<T> {
    number::narrow(node.attribute(attribute)?)
}

/// Whether an attribute is there and true.
pub fn flag_in(node: Node<'_, '_>, attribute: &str) -> bool {
    node.attribute(attribute).and_then(number::flag) == Some(true)
}

/// The text in English (1033) where there are several languages, else the first.
pub fn english<'a>(node: Node<'a, 'a>, name: &'a str) -> Option<&'a str> {
    let english = children(node, name).find(|found| found.attribute("LcId") == Some("1033"));
    english.or_else(|| child(node, name)).map(text)
}

/// Its line in the file, from 1.
pub fn line(node: Node<'_, '_>) -> u32 {
    node.document().text_pos_at(node.range().start).row
}

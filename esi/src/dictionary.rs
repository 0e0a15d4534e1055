//! The object dictionary of a device, as far as its ESI file tells it.

use std::collections::BTreeMap;

use roxmltree::Node;

use super::number;
use super::xml::{at, child, children, number_of, text_of};

/// Most sub-indexes of an object.
const SUBS_MAX: usize = 256;

/// The objects of a device by index and sub-index; an object without sub-indexes has sub-index 0.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Dictionary {
    objects: BTreeMap<(u16, u8), Object>,
}

/// One object, or one sub-index of it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Object {
    /// Its name.
    pub name: String,
    /// Its size in bits; 0 where the file does not tell it.
    pub bits: u32,
    /// Whether it can be written; `None` where the file does not tell it.
    pub writable: Option<bool>,
    /// Whether it may be mapped into a PDO that the device receives.
    pub receive: bool,
    /// Whether it may be mapped into a PDO that the device transmits.
    pub transmit: bool,
    /// The value it has from the factory.
    pub default: Option<i64>,
    /// Its lowest value.
    pub min: Option<i64>,
    /// Its highest value.
    pub max: Option<i64>,
}

impl Dictionary {
    /// An object.
    pub fn get(&self, index: u16, sub: u8) -> Option<&Object> {
        self.objects.get(&(index, sub))
    }

    /// Whether the file tells nothing of objects.
    pub fn is_empty(&self) -> bool {
        self.objects.is_empty()
    }

    /// The value that an object has from the factory.
    pub fn default_of(&self, index: u16, sub: u8) -> Option<i64> {
        self.get(index, sub)?.default
    }

    /// Whether an object is there and may be written.
    pub fn writes(&self, index: u16, sub: u8) -> bool {
        self.get(index, sub).and_then(|object| object.writable) == Some(true)
    }

    /// Highest sub-index of an object: of a mapping the number of entries it can have.
    pub fn highest_sub(&self, index: u16) -> Option<u8> {
        let mut subs = self.objects.range((index, 0)..=(index, u8::MAX));
        subs.next_back().map(|((_, sub), _)| *sub)
    }

    /// The objects by other indices, those that have none left out.
    pub(super) fn moved(&self, to: impl Fn(u16) -> Option<u16>) -> Dictionary {
        let all = self.objects.iter();
        let moved =
            all.filter_map(|((index, sub), object)| Some(((to(*index)?, *sub), object.clone())));
        Dictionary {
            objects: moved.collect(),
        }
    }

    /// Takes the objects of another one too.
    pub(super) fn add_all(&mut self, other: Dictionary) {
        self.objects.extend(other.objects);
    }

    /// Reads `Dictionary`. Objects that cannot be understood are left out.
    pub(super) fn read<'a>(node: Node<'a, 'a>) -> Dictionary {
        let mut types = BTreeMap::new();
        for list in children(node, "DataTypes") {
            for of_type in children(list, "DataType") {
                types.insert(text_of(of_type, "Name").unwrap_or_default(), of_type);
            }
        }
        let mut dictionary = Dictionary::default();
        for list in children(node, "Objects") {
            for object in children(list, "Object") {
                dictionary.add(object, &types);
            }
        }
        dictionary
    }

    fn add<'a>(&mut self, node: Node<'a, 'a>, types: &Types<'a>) {
        let Some(index) = number_of::<u16>(node, "Index") else {
            return;
        };
        let type_name = text_of(node, "Type").unwrap_or_default();
        let name = text_of(node, "Name").unwrap_or_default();
        let of_type = types.get(type_name).copied();
        let subs = of_type.map_or(Vec::new(), |of_type| subs(of_type, types));
        if subs.is_empty() {
            let bits = number_of(node, "BitSize").or_else(|| bits_of(type_name, types));
            let mut object = Object {
                name: name.to_string(),
                bits: bits.unwrap_or(0),
                ..Object::default()
            };
            object.take_flags(node);
            // Some files have the values of a plain object one level further down.
            let info = child(node, "Info");
            let nested = info.and_then(|info| at(info, &["SubItem", "Info"]));
            if let Some(info) = nested.or(info) {
                object.take_values(info, is_signed(type_name));
            }
            self.objects.insert((index, 0), object);
            return;
        }
        let infos: Vec<Node<'_, '_>> = child(node, "Info")
            .map(|info| children(info, "SubItem").collect())
            .unwrap_or_default();
        for (place, (sub, mut object, signed)) in subs.into_iter().enumerate() {
            let info = infos.get(place);
            if let Some(info) = info.and_then(|item| child(*item, "Info")) {
                object.take_values(info, signed);
            }
            if object.writable.is_none() {
                object.take_flags(node);
            }
            object.name = match object.name.as_str() {
                "" => name.to_string(),
                own => format!("{name}: {own}"),
            };
            self.objects.insert((index, sub), object);
        }
    }
}

type Types<'a> = BTreeMap<&'a str, Node<'a, 'a>>;

/// A sub-index of a data type.
/// Number of a subindex, what is there, and whether its values are signed.
type Sub = (u8, Object, bool);

/// The sub-indexes of a record or an array, in their order; none of a plain type.
fn subs<'a>(of_type: Node<'a, 'a>, types: &Types<'a>) -> Vec<Sub> {
    let mut found = Vec::new();
    for item in children(of_type, "SubItem") {
        let type_name = text_of(item, "Type").unwrap_or_default();
        let mut object = Object {
            name: text_of(item, "Name").unwrap_or_default().to_string(),
            bits: number_of(item, "BitSize").unwrap_or(0),
            ..Object::default()
        };
        object.take_flags(item);
        if let Some(sub) = number_of::<u8>(item, "SubIdx") {
            found.push((sub, object, is_signed(type_name)));
            continue;
        }
        // What has no sub-index is an array: all of its elements.
        let array = types.get(type_name).copied();
        let Some(info) = array.and_then(|array| child(array, "ArrayInfo")) else {
            continue;
        };
        let first = number_of::<u8>(info, "LBound").unwrap_or(1);
        let count = number_of::<u8>(info, "Elements").unwrap_or(0);
        let base = array.and_then(|array| text_of(array, "BaseType"));
        let signed = is_signed(base.unwrap_or_default());
        object.bits = object.bits.checked_div(u32::from(count)).unwrap_or(0);
        let subs = (0..count).map(|place| first.saturating_add(place));
        found.extend(subs.map(|sub| (sub, object.clone(), signed)));
    }
    found.truncate(SUBS_MAX);
    found
}

/// Whether a basic type of ETG.1020 has a sign.
fn is_signed(type_name: &str) -> bool {
    matches!(
        type_name,
        "SINT" | "INT" | "DINT" | "LINT" | "INT24" | "INT40" | "INT48" | "INT56"
    )
}

/// The size of a type that the file declares.
fn bits_of(type_name: &str, types: &Types<'_>) -> Option<u32> {
    number_of(*types.get(type_name)?, "BitSize")
}

impl Object {
    /// Access and mapping.
    fn take_flags(&mut self, node: Node<'_, '_>) {
        let Some(flags) = node.children().find(|n| n.tag_name().name() == "Flags") else {
            return;
        };
        let of = |name| {
            let found = flags.children().find(|n| n.tag_name().name() == name);
            Some(found?.text()?.trim().to_ascii_lowercase())
        };
        if let Some(access) = of("Access") {
            self.writable = Some(access.contains('w'));
        }
        if let Some(mapping) = of("PdoMapping") {
            self.receive |= mapping.contains('r');
            self.transmit |= mapping.contains('t');
        }
    }

    /// Default, lowest and highest value.
    fn take_values<'a>(&mut self, info: Node<'a, 'a>, signed: bool) {
        let bits = self.bits;
        let value = |number: &'a str, data: &'a str| {
            let plain =
                at(info, &[number]).and_then(|n| number::whole(n.text().unwrap_or_default()));
            let bytes = || {
                let bytes = at(info, &[data])?.text()?;
                i64::try_from(number::little_endian(bytes)?).ok()
            };
            let value = plain.or_else(bytes)?;
            Some(if signed {
                number::sign_extended(value, bits)
            } else {
                value
            })
        };
        self.default = value("DefaultValue", "DefaultData");
        self.min = value("MinValue", "MinData");
        self.max = value("MaxValue", "MaxData");
    }
}

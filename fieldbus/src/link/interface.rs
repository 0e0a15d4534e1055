//! The network interfaces of this PC, asked of the kernel itself: `/sys` may be that of another network namespace.

use std::ffi::CStr;

/// `IFF_LOWER_UP` of linux/if.h.
const LOWER_UP: u32 = 1 << 16;

/// A network interface.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Interface {
    /// Its name.
    pub name: String,
    /// Whether it is switched on.
    pub up: bool,
    /// Whether something is at the other end.
    pub link: bool,
}

/// All but the loopback, by name; none where the kernel does not say.
pub fn interfaces() -> Vec<Interface> {
    let mut found: Vec<Interface> = Vec::new();
    let mut first: *mut libc::ifaddrs = std::ptr::null_mut();
    // SAFETY: the pointer lives over the call; what it is set to is given back below.
    if unsafe { libc::getifaddrs(&raw mut first) } != 0 {
        return found;
    }
    let mut next = first;
    // SAFETY: a list that ends with a null pointer, of which each entry lives until it is given back.
    while let Some(entry) = unsafe { next.as_ref() } {
        next = entry.ifa_next;
        // SAFETY: a C string of the list.
        let name = unsafe { CStr::from_ptr(entry.ifa_name) };
        let name = name.to_string_lossy().into_owned();
        let flags = entry.ifa_flags;
        let loopback = flags & libc::IFF_LOOPBACK as u32 != 0;
        // One with several addresses is there several times.
        if !loopback && !found.iter().any(|other| other.name == name) {
            found.push(Interface {
                name,
                up: flags & libc::IFF_UP as u32 != 0,
                link: flags & LOWER_UP != 0,
            });
        }
    }
    // SAFETY: the list was made above and is not used any more.
    unsafe { libc::freeifaddrs(first) };
    found.sort_by(|one, other| one.name.cmp(&other.name));
    found
}

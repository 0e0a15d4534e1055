//! No bindings of C.
//!
//! The build scripts of iceoryx2 0.10 name bindgen for every platform and call it on QNX alone; elsewhere it and seven libraries of its
//! own would be built for nothing.

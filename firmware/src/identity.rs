//! Which sources the image was built from; `build.rs` writes it.

include!(concat!(env!("OUT_DIR"), "/identity.rs"));

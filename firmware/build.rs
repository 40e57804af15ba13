//! Gives the linker `memory.x` and the image its table, setup, board and identity.
//!
//! `cargo xtask firmware` plans the table on the host and says in environment variables
//! where it is: `FLEXOR_TABLE` (table image), `FLEXOR_SETUP` (encoded
//! `flexor::link::Setup`), `FLEXOR_BOARD` (the board file as an expression of type
//! `flexor::supervisor::BoardParameters`), `FLEXOR_GIT` (commit, eight hex digits, and `+` if
//! modified).

use std::path::PathBuf;
use std::{env, fs};

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    println!("cargo:rustc-link-search={}", out.display());
    copy("../memory.x", &out.join("memory.x"));
    for (variable, file) in [
        ("FLEXOR_TABLE", "table.bin"),
        ("FLEXOR_SETUP", "setup.bin"),
        ("FLEXOR_BOARD", "board.rs"),
    ] {
        println!("cargo:rerun-if-env-changed={variable}");
        let source = env::var(variable).unwrap_or_else(|_| {
            panic!("{variable} is not set: build the firmware with `cargo xtask firmware`")
        });
        copy(&source, &out.join(file));
    }
    println!("cargo:rerun-if-env-changed=FLEXOR_GIT");
    let git = env::var("FLEXOR_GIT").unwrap_or_default();
    let number = u32::from_str_radix(git.trim_end_matches('+'), 16).unwrap_or(0);
    let version = ["MAJOR", "MINOR", "PATCH"].map(|part| {
        let variable = format!("CARGO_PKG_VERSION_{part}");
        let number = env::var(&variable).expect("cargo sets the package's version");
        number
            .parse::<u16>()
            .unwrap_or_else(|error| panic!("{variable} is {number}: {error}"))
    });
    let identity = format!(
        "/// The package's version: major, minor, patch.\n\
         pub const VERSION: [u16; 3] = {version:?};\n\
         /// First 4 bytes of the git commit; 0 outside a repository.\n\
         pub const GIT: [u8; 4] = {:?};\n\
         /// Whether the sources differed from it.\n\
         pub const MODIFIED: bool = {};\n",
        number.to_be_bytes(),
        git.ends_with('+')
    );
    fs::write(out.join("identity.rs"), identity).expect("OUT_DIR is writable");
}

fn copy(from: &str, to: &PathBuf) {
    println!("cargo:rerun-if-changed={from}");
    fs::copy(from, to).unwrap_or_else(|error| panic!("cannot copy {from}: {error}"));
}

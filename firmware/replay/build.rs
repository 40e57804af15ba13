//! Gives the linker `memory.x` and the images their table and coefficients, which
//! `cargo xtask replay` makes and names in environment variables.

use std::path::PathBuf;
use std::{env, fs};

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    println!("cargo:rustc-link-search={}", out.display());
    copy("memory.x", &out.join("memory.x"));
    for (variable, file) in [
        ("FLEXOR_TABLE", "table.bin"),
        ("FLEXOR_PAPER_FIXED", "paper_fixed.bin"),
        ("FLEXOR_PAPER_FLOAT", "paper_float.bin"),
        ("FLEXOR_HYBRID_FIXED", "hybrid_fixed.bin"),
        ("FLEXOR_HYBRID_FLOAT", "hybrid_float.bin"),
    ] {
        println!("cargo:rerun-if-env-changed={variable}");
        let source = env::var(variable).unwrap_or_else(|_| {
            panic!("{variable} is not set: build the images with `cargo xtask replay`")
        });
        copy(&source, &out.join(file));
    }
}

fn copy(from: &str, to: &PathBuf) {
    println!("cargo:rerun-if-changed={from}");
    fs::copy(from, to).unwrap_or_else(|error| panic!("cannot copy {from}: {error}"));
}

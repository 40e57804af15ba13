//! Flexor's command line.

fn main() {}

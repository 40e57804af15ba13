//! Lines of the files that are written, not read.

/// Every number as a float, which TOML tells from an integer.
pub(super) fn number(x: f64) -> String {
    format!("{x:?}")
}

/// A key with its value, or commented out with an example; and what it is for.
pub(super) fn line(assignment: &str, comment: &str) -> String {
    format!("{assignment:<41} # {comment}\n")
}

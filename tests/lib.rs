//! Behaviour across crates; the tests are in `tests/`.

//! The structure that docs/architecture.md promises: imports run one way, no file is long.
//!
//! Sources are read as text. A *wing* is a folder (or a file) directly below `src`; an import is a
//! path that begins with `crate::` or, within a wing, `super::`, outside of unit tests. What a
//! wing's `mod.rs` holds besides its files, and what files take from it, is not followed when
//! circles are looked for.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// A file has at most this many lines, unit tests included.
const FILE_LINES_MAX: usize = 700;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Every Rust source below `folder`, but for files that are unit tests (`..._tests.rs`).
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            if !path.ends_with("target") || folder.ends_with("src") {
                found.extend(sources(&path));
            }
        } else if path.extension().is_some_and(|extension| extension == "rs")
            && !path.to_string_lossy().ends_with("_tests.rs")
        {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// A source without its unit tests and without comments.
fn code(path: &Path) -> String {
    let text = fs::read_to_string(path).unwrap();
    let tests = text.match_indices("#[cfg(test)]").find(|(at, mark)| {
        text[at + mark.len()..].trim_start().contains("mod ") && {
            let next = text[at + mark.len()..].trim_start().lines().next();
            next.is_some_and(|line| line.contains("mod ") && line.ends_with('{'))
        }
    });
    let text = tests.map_or(&text[..], |(at, _)| &text[..at]);
    let lines = text
        .lines()
        .filter(|line| !line.trim_start().starts_with("//"));
    lines.collect::<Vec<_>>().join("\n")
}

/// The words that follow `prefix` in paths of `code`: for `crate::`, the wings named. A group in
/// braces counts with every word that it begins a path with.
fn named_after(code: &str, prefix: &str) -> BTreeSet<String> {
    let word = |text: &str| -> String {
        let end = |c: char| !(c.is_alphanumeric() || c == '_');
        text.split(end).next().unwrap_or_default().to_string()
    };
    let mut found = BTreeSet::new();
    for (at, _) in code.match_indices(prefix) {
        let before = code[..at].chars().next_back();
        if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':' || c == '$') {
            continue;
        }
        let rest = &code[at + prefix.len()..];
        match rest.strip_prefix('{') {
            Some(group) => {
                let mut depth = 0_i32;
                let mut start = true;
                for (i, c) in group.char_indices() {
                    match c {
                        '{' => depth += 1,
                        '}' if depth == 0 => break,
                        '}' => depth -= 1,
                        ',' if depth == 0 => start = true,
                        c if start && !c.is_whitespace() => {
                            found.insert(word(&group[i..]));
                            start = false;
                        }
                        _ => {}
                    }
                }
            }
            None => {
                found.insert(word(rest));
            }
        }
    }
    found
}

/// The wing of a file below `src`.
fn wing(src: &Path, file: &Path) -> String {
    let inside = file.strip_prefix(src).unwrap();
    let first = inside.components().next().unwrap();
    let name = first.as_os_str().to_string_lossy().into_owned();
    name.trim_end_matches(".rs").to_string()
}

/// Asserts that every wing imports only what `allowed` lists for it.
#[track_caller]
fn imports_are_allowed(src: &str, allowed: &[(&str, &[&str])]) {
    let src = root().join(src);
    let allowed: BTreeMap<_, _> = allowed.iter().copied().collect();
    let mut seen = BTreeSet::new();
    for file in sources(&src) {
        let wing = wing(&src, &file);
        if ["lib", "main"].contains(&wing.as_str()) {
            continue;
        }
        seen.insert(wing.clone());
        let may = allowed
            .get(wing.as_str())
            .unwrap_or_else(|| panic!("{}: a wing that this test does not know", file.display()));
        for name in named_after(&code(&file), "crate::") {
            let known = allowed.contains_key(name.as_str());
            assert!(
                !known || name == wing || may.contains(&name.as_str()),
                "{} imports {name}, which {wing} must not know",
                file.display()
            );
        }
    }
    let expected: BTreeSet<_> = allowed.keys().map(ToString::to_string).collect();
    assert_eq!(seen, expected, "wings");
}

#[test]
fn the_shared_crate_imports_one_way() {
    imports_are_allowed(
        "shared/src",
        &[
            ("number", &[]),
            ("signals", &["number"]),
            ("fault", &[]),
            ("phase", &[]),
            ("model", &["number"]),
            ("table", &["number", "signals", "model"]),
            (
                "control",
                &["number", "signals", "fault", "phase", "model", "table"],
            ),
            ("link", &["signals", "fault", "phase", "model", "table"]),
            (
                "supervisor",
                &[
                    "number", "signals", "fault", "phase", "model", "table", "control", "link",
                ],
            ),
        ],
    );
}

#[test]
fn the_host_imports_one_way() {
    let below = [
        "text",
        "model",
        "planner",
        "plant",
        "simulation",
        "analysis",
        "campaign",
    ];
    let files = [&below[..], &["target", "files"]].concat();
    let cli = [&files[..], &["report"]].concat();
    imports_are_allowed(
        "host-sim/src",
        &[
            ("text", &[]),
            ("model", &["text"]),
            ("planner", &["text", "model"]),
            ("plant", &["text", "model"]),
            ("simulation", &below[..4]),
            ("analysis", &below[..5]),
            ("campaign", &below[..6]),
            ("target", &below[..6]),
            ("files", &below),
            ("report", &files),
            ("cli", &cli),
            ("testing", &below),
        ],
    );
}

/// The files of a wing that `file` names, by `super::` or by the wing's path.
fn siblings_named(wing: &str, code: &str) -> BTreeSet<String> {
    let mut names = named_after(code, "super::");
    for prefix in ["crate::", "flexor::", "flexor_sim::"] {
        names.extend(named_after(code, &format!("{prefix}{wing}::")));
    }
    names
}

#[test]
fn the_files_of_a_wing_know_each_other_one_way() {
    for src in ["shared/src", "host-sim/src"] {
        let src = root().join(src);
        let mut files: BTreeMap<PathBuf, BTreeSet<PathBuf>> = BTreeMap::new();
        for file in sources(&src) {
            let name = file.file_stem().unwrap().to_string_lossy().into_owned();
            let folder = file.parent().unwrap().to_path_buf();
            if folder == src || name == "mod" {
                continue;
            }
            let inside = folder.strip_prefix(&src).unwrap();
            let path = inside.components().map(|c| c.as_os_str().to_string_lossy());
            let path = path.collect::<Vec<_>>().join("::");
            let named = siblings_named(&path, &code(&file));
            let known = named.iter().map(|name| folder.join(format!("{name}.rs")));
            let known = known.filter(|other| other.exists() && *other != file);
            files.insert(file.clone(), known.collect());
        }
        // Takes away what knows nothing that is left, until nothing is: a circle never goes.
        while !files.is_empty() {
            let left: BTreeSet<_> = files.keys().cloned().collect();
            let before = files.len();
            files.retain(|_, known| known.iter().any(|other| left.contains(other)));
            assert!(files.len() < before, "a circle among {:?}", files.keys());
        }
    }
}

#[test]
fn no_file_is_long() {
    for folder in ["shared", "host-sim", "firmware", "xtask", "tests"] {
        for file in sources(&root().join(folder)) {
            let lines = fs::read_to_string(&file).unwrap().lines().count();
            assert!(lines <= FILE_LINES_MAX, "{}: {lines} lines", file.display());
        }
    }
}

/// A function that is no test has at most this many lines.
const FUNCTION_LINES_MAX: usize = 70;

/// The functions in `code` with their numbers of lines, from `fn` to the closing brace. Sources
/// are formatted, so that brace stands as far in as the function's first line.
fn functions(code: &str) -> Vec<(&str, usize)> {
    let lines: Vec<&str> = code.lines().collect();
    let mut found = Vec::new();
    for (start, line) in lines.iter().enumerate() {
        let inside = line.trim_start();
        let words: Vec<&str> = inside.split(' ').collect();
        let Some(at) = words.iter().position(|word| *word == "fn") else {
            continue;
        };
        let qualifiers = [
            "pub",
            "pub(crate)",
            "pub(super)",
            "const",
            "unsafe",
            "extern",
            "\"C\"",
        ];
        if !words[..at].iter().all(|word| qualifiers.contains(word)) {
            continue;
        }
        let indent = &line[..line.len() - inside.len()];
        // The signature's end says whether there is a body.
        let body = lines[start..]
            .iter()
            .position(|l| l.ends_with(['{', ';', '}']));
        let body = start + body.unwrap_or(0);
        let closing = format!("{indent}}}");
        let end = match lines[body].ends_with('{') {
            true => lines[body..]
                .iter()
                .position(|l| *l == closing)
                .map(|n| body + n),
            false => Some(body),
        };
        let name = words.get(at + 1).copied().unwrap_or_default();
        found.push((name, end.unwrap_or(body) + 1 - start));
    }
    found
}

#[test]
fn no_function_is_long() {
    let mut count = 0;
    for folder in ["shared/src", "host-sim/src", "firmware", "xtask/src"] {
        for file in sources(&root().join(folder)) {
            let text = code(&file);
            for (name, lines) in functions(&text) {
                count += 1;
                assert!(
                    lines <= FUNCTION_LINES_MAX,
                    "{}: {name} has {lines} lines",
                    file.display()
                );
            }
        }
    }
    assert!(count > 500, "only {count} functions were found");
}

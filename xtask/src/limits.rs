//! Files of limits: what an image may take, and what it took with which compiler.
//!
//! `[limits]` is declared by hand, with head-room for compilers to come; only it can fail.
//! `[measured."<compiler>"]` has the exact figures with one compiler; they show the trend.

use anyhow::{Context, Result, ensure};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::Path;

/// Figures by name, in the units that the names say.
pub(crate) type Figures = BTreeMap<String, u64>;

/// A file of limits.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    limits: Figures,
    /// Figures by compiler; one's figures need not be complete.
    #[serde(default)]
    measured: BTreeMap<String, Figures>,
}

impl File {
    fn parse(name: &Path, text: &str) -> Result<Self> {
        toml::from_str(text).with_context(|| format!("{} is no file of limits", name.display()))
    }

    /// The figures to compare with: this compiler's own, or those of the version next to it.
    fn nearest(&self, compiler: &str) -> Option<(&str, &Figures)> {
        let distance = |other: &str| match (version(compiler), version(other)) {
            _ if compiler == other => 0,
            (Some(this), Some(other)) => 1 + this.abs_diff(other),
            _ => u64::MAX,
        };
        let all = self.measured.iter();
        all.map(|(name, figures)| (name.as_str(), figures))
            .min_by_key(|(name, _)| distance(name))
    }
}

/// A compiler's version as one number that grows with it: of "rustc 1.96.0 (...)".
fn version(compiler: &str) -> Option<u64> {
    let mut parts = compiler.split_whitespace().nth(1)?.split(['.', '-']);
    let mut part = || parts.next()?.parse::<u64>().ok();
    let (major, minor, patch) = (part()?, part()?, part()?);
    Some((major * 10_000 + minor) * 10_000 + patch)
}

/// What the figures say against a file of limits.
#[derive(Debug, PartialEq)]
pub(crate) struct Verdict {
    /// A line a figure: its value, its limit, and what it was before.
    pub(crate) lines: Vec<String>,
    /// What is over its limit, or has none.
    pub(crate) excess: Vec<String>,
}

/// Holds `figures`, measured with `compiler`, against the file `path`; `update` puts them into
/// it as that compiler's.
pub(crate) fn hold(
    path: &Path,
    figures: &Figures,
    compiler: &str,
    update: bool,
) -> Result<Verdict> {
    let text =
        fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let file = File::parse(path, &text)?;
    let verdict = judge(&file, figures, compiler);
    if update {
        let text = updated(&text, figures, compiler);
        // What cannot be read again must not be left behind.
        let read = File::parse(path, &text)?;
        ensure!(
            read.measured.get(compiler) == Some(figures) && read.limits == file.limits,
            "{} cannot be updated: write the figures into it by hand",
            path.display()
        );
        fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(verdict)
}

/// Compares with limits and earlier figures.
fn judge(file: &File, figures: &Figures, compiler: &str) -> Verdict {
    let known = file.nearest(compiler);
    let mut lines = vec![match known {
        Some((name, _)) => format!("measured with {compiler}; known: {name}"),
        None => format!("measured with {compiler}; nothing is known"),
    }];
    let mut excess = vec![];
    for (name, is) in figures {
        let before = known.and_then(|(_, figures)| figures.get(name));
        let trend = before.map_or("new".into(), |before| match is.abs_diff(*before) {
            0 => "as known".into(),
            change => format!("{}{change}", if is > before { "+" } else { "-" }),
        });
        let most = file.limits.get(name);
        let limit = most.map_or("none".into(), u64::to_string);
        lines.push(format!("{name:30} {is:6}  of {limit:>6}  {trend}"));
        match most {
            Some(most) if is <= most => {}
            Some(most) => excess.push(format!("{name} is {is}, the limit is {most}")),
            None => excess.push(format!("{name} is {is} and has no limit")),
        }
    }
    // A figure that is measured no more would pass by itself.
    for name in file
        .limits
        .keys()
        .filter(|name| !figures.contains_key(*name))
    {
        excess.push(format!("{name} has a limit and was not measured"));
    }
    Verdict { lines, excess }
}

/// The file's text with `figures` as the compiler's; all else stays as it is.
fn updated(text: &str, figures: &Figures, compiler: &str) -> String {
    let head = format!("[measured.{compiler:?}]");
    let mut section = format!("{head}\n");
    for (name, value) in figures {
        // Into a String this cannot fail.
        let _ = writeln!(section, "{name} = {value}");
    }
    let starts = |line: &str| line.trim_end() == head;
    if !text.lines().any(starts) {
        return format!("{}\n\n{section}", text.trim_end());
    }
    let mut updated = String::new();
    let mut inside = false;
    for line in text.split_inclusive('\n') {
        if starts(line) {
            inside = true;
            updated += &section;
            continue;
        }
        // Only the old figures go; a comment or an empty line ends them.
        inside = inside && line.contains(" = ") && !line.trim_start().starts_with('#');
        if !inside {
            updated += line;
        }
    }
    updated
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "\
# Why.
[limits]
flash_bytes = 100 # head-room
ticks = 20

# As reported.
[measured.\"another, reported\"]
flash_bytes = 90

[measured.\"rustc 1.90.0 (x)\"]
flash_bytes = 80
ticks = 10

# At the end.
";

    fn figures(flash: u64, ticks: u64) -> Figures {
        [("flash_bytes".into(), flash), ("ticks".into(), ticks)].into()
    }

    fn judged(flash: u64, ticks: u64, compiler: &str) -> Verdict {
        let file = File::parse(Path::new("f"), TEXT).unwrap();
        judge(&file, &figures(flash, ticks), compiler)
    }

    #[test]
    fn only_limits_fail_and_each_figure_wants_one() {
        assert!(judged(100, 20, "rustc 1.90.0 (x)").excess.is_empty());
        let excess = judged(101, 21, "rustc 1.90.0 (x)").excess;
        assert_eq!(
            excess,
            [
                "flash_bytes is 101, the limit is 100",
                "ticks is 21, the limit is 20"
            ]
        );
        let file = File::parse(Path::new("f"), TEXT).unwrap();
        let renamed = [("flash_bytes".into(), 1), ("tocks".into(), 1)].into();
        let excess = judge(&file, &renamed, "rustc 1.90.0 (x)").excess;
        assert_eq!(
            excess,
            [
                "tocks is 1 and has no limit",
                "ticks has a limit and was not measured"
            ]
        );
    }

    #[test]
    fn the_trend_is_against_this_compiler_or_the_version_next_to_it() {
        let trend = |verdict: Verdict| -> Vec<String> {
            let words = |line: &String| line.rsplit("  ").next().unwrap().to_string();
            verdict.lines[1..].iter().map(words).collect()
        };
        assert_eq!(
            trend(judged(82, 10, "rustc 1.90.0 (x)")),
            ["+2", "as known"]
        );
        assert_eq!(trend(judged(79, 9, "rustc 1.96.1 (y)")), ["-1", "-1"]);
        assert_eq!(
            trend(judged(90, 1, "another, reported")),
            ["as known", "new"]
        );
        assert!(version("rustc 1.96.0-nightly (z)") > version("rustc 1.95.9 (z)"));
        assert_eq!(version("another, reported"), None);
    }

    #[test]
    fn an_update_changes_this_compilers_figures_and_nothing_else() {
        let same = updated(TEXT, &figures(81, 11), "rustc 1.90.0 (x)");
        let expected = TEXT.replace("= 80\nticks = 10", "= 81\nticks = 11");
        assert_eq!(same, expected);
        let other = updated(TEXT, &figures(1, 2), "rustc 1.91.0 (\"y\")");
        assert!(other.starts_with(TEXT.trim_end()), "{other}");
        let file = File::parse(Path::new("f"), &other).unwrap();
        assert_eq!(file.measured["rustc 1.91.0 (\"y\")"], figures(1, 2));
        assert_eq!(file.measured.len(), 3);
    }
}

//! Names the commit that the program is built from: `FLEXOR_COMMIT` is eight hex digits, with `+`
//! where the sources differ from it, or `unknown` outside a repository and without git.

use std::process::Command;

/// What git says; nothing where it fails.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}

fn main() {
    // What the program is made of, and what changes with a commit.
    for source in [
        "src",
        "build.rs",
        "Cargo.toml",
        "../shared/src",
        "../examples",
        "../boards",
    ] {
        println!("cargo:rerun-if-changed={source}");
    }
    for file in ["HEAD", "logs/HEAD"] {
        let path = git(&["rev-parse", "--git-path", file]);
        if let Some(path) = path.filter(|path| std::path::Path::new(path).exists()) {
            println!("cargo:rerun-if-changed={path}");
        }
    }
    let commit = git(&["rev-parse", "--short=8", "HEAD"]).filter(|commit| !commit.is_empty());
    let sources = [
        "status",
        "--porcelain",
        "--untracked-files=no",
        "--",
        ".",
        "../shared",
        "../examples",
        "../boards",
    ];
    let clean = git(&sources).is_some_and(|changes| changes.is_empty());
    let name = match (commit, clean) {
        (Some(commit), true) => commit,
        (Some(commit), false) => commit + "+",
        (None, _) => "unknown".into(),
    };
    println!("cargo:rustc-env=FLEXOR_COMMIT={name}");
}

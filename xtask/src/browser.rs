//! The pages in a browser.

use crate::{announce, root, run};
use anyhow::Result;
use std::env;
use std::path::PathBuf;
use std::process::Command;

/// Names of browsers that can do it.
const NAMES: [&str; 4] = [
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
];

/// The browser: what `FLEXOR_BROWSER` names, or the first of these on the path.
fn find() -> Option<PathBuf> {
    if let Some(named) = env::var_os("FLEXOR_BROWSER") {
        return Some(named.into());
    }
    let path = env::var_os("PATH")?;
    let places = || env::split_paths(&path);
    let mut files = NAMES
        .iter()
        .flat_map(|name| places().map(move |folder| folder.join(name)));
    files.find(|file| file.is_file())
}

/// Uses the pages in a browser, or says that there is none.
pub(crate) fn browser() -> Result<()> {
    let Some(browser) = find() else {
        announce(&format!(
            "skipped: the pages are not tried in a browser, as there is none; FLEXOR_BROWSER names one, or one of {} on the path is taken",
            NAMES.join(", ")
        ));
        return Ok(());
    };
    run(Command::new("cargo")
        .current_dir(root())
        .args(["test", "--package", "flexor-sim", "--test", "browser"])
        .args(["--", "--ignored"])
        .env("FLEXOR_BROWSER", browser))
}

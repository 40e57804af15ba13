//! The folder that a command writes its results into, as one unit: whole or not at all, and by
//! one command at a time.
//!
//! What is in such a folder `DIR`:
//!
//! | name | what |
//! |---|---|
//! | the result's files, `summary.json` among them | of one command; `summary.json` is put there last and taken away first, so that where it is everything beside it belongs to it |
//! | `DIR/.flexor` | locked while a command works; the names of the result's files, one a line, so that nobody else's file is ever touched |
//! | `DIR/.flexor-partial/` | what a command has written so far; what a killed one has left goes with the next one |
//! | `DIR/.flexor-kept/` | what a killed command wants to find again ([`Output::keep`]) |
//! | `DIR/previous/` | the result before: a new one, and a command that fails, move it there |
//!
//! Files of the result that a command reads ([`Output::open`]'s `inputs`) stay where they are.

use super::signals;
use super::{CliError, say};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, BufWriter, Read, Seek, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The file that is locked and lists the result's files.
const MANIFEST: &str = ".flexor";

/// Where a command's files are until they are all there.
const PARTIAL: &str = ".flexor-partial";

/// What outlives a kill.
const KEPT: &str = ".flexor-kept";

/// The result before.
const PREVIOUS: &str = "previous";

/// The file that says that a result is complete.
const SUMMARY: &str = "summary.json";

/// A results folder that this command alone writes into.
///
/// [`open`](Self::open) it before anything is read or planned, write everything, and
/// [`commit`](Self::commit) before anything is printed. Dropped without, it takes away what was
/// written and moves the older result to `previous`, so that it is not taken for this command's.
/// Ctrl-C and its like take away what was written and leave the older result where it is.
pub(super) struct Output {
    /// As the user named it.
    folder: PathBuf,
    manifest: Manifest,
    /// Folders that were made for this one, the innermost first.
    made: Vec<PathBuf>,
    /// Files of the older result that are this command's input.
    inputs: BTreeSet<String>,
    /// True once the command has taken a place for what it wants to find again.
    keeps: Arc<AtomicBool>,
    committed: bool,
}

impl Output {
    /// Makes `folder`, takes it for this command, and removes what a killed one has left.
    /// `inputs` are the files that the command reads: they stay, also if they are part of the
    /// folder's older result.
    ///
    /// # Errors
    /// [`CliError::Busy`] if another command writes there; [`CliError::Unwritable`].
    pub(super) fn open<'a>(
        folder: &Path,
        inputs: impl IntoIterator<Item = Option<&'a Path>>,
    ) -> Result<Self, CliError> {
        let failed = |cause| unwritable(folder, cause);
        let made = missing(folder);
        let manifest = Manifest::lock(folder)?;
        let partial = folder.join(PARTIAL);
        let place = folder.to_path_buf();
        let keeps = Arc::new(AtomicBool::new(false));
        signals::clean_up_when_ended({
            let (manifest, made) = (manifest.untouched(), made.clone());
            let keeps = Arc::clone(&keeps);
            move || {
                remove_folder(&place.join(PARTIAL));
                manifest.remove_if_empty(&made);
                let kept = match keeps.load(Ordering::Relaxed) {
                    true => "; the same command goes on from here",
                    false => "",
                };
                say(format_args!(
                    "error: interrupted; {} is as it was before{kept}",
                    place.display()
                ));
            }
        });
        // From here on dropping cleans up.
        let mut output = Self {
            folder: folder.to_path_buf(),
            manifest,
            made,
            inputs: BTreeSet::new(),
            keeps,
            committed: false,
        };
        remove_folder(&partial);
        fs::create_dir(&partial).map_err(failed)?;
        let real = folder.canonicalize().map_err(failed)?;
        output.inputs = inputs
            .into_iter()
            .flatten()
            .filter_map(|file| file.canonicalize().ok())
            .filter_map(|file| name_in(&real, &file))
            .collect();
        Ok(output)
    }

    /// The folder, as the user named it: for messages.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Where files are written that do not go through [`write`](Self::write).
    pub(super) fn partial(&self) -> PathBuf {
        self.folder.join(PARTIAL)
    }

    /// Writes the file `name`, a relative path with `/`; its folders are made.
    ///
    /// # Errors
    /// [`CliError::Unwritable`].
    pub(super) fn write(
        &self,
        name: &str,
        content: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
    ) -> Result<(), CliError> {
        let file = self.partial().join(name);
        let write = || {
            file.parent().map_or(Ok(()), fs::create_dir_all)?;
            let mut writer = BufWriter::new(File::create(&file)?);
            content(&mut writer)?;
            writer.flush()
        };
        write().map_err(|cause| unwritable(&self.folder.join(name), cause))
    }

    /// Writes a value as the file `name`.
    ///
    /// # Errors
    /// [`CliError::Unwritable`].
    pub(super) fn json(&self, name: &str, value: &Value) -> Result<(), CliError> {
        self.write(name, |w| writeln!(w, "{value:#}"))
    }

    /// The place of a file that a command writes as it goes and wants to find again after it was
    /// killed, interrupted or refused; [`commit`](Self::commit) removes it. Its folder is there.
    ///
    /// # Errors
    /// [`CliError::Unwritable`].
    pub(super) fn keep(&self, name: &str) -> Result<PathBuf, CliError> {
        let kept = self.folder.join(KEPT);
        fs::create_dir_all(&kept).map_err(|cause| unwritable(&kept, cause))?;
        self.keeps.store(true, Ordering::Relaxed);
        Ok(kept.join(name))
    }

    /// Removes what [`keep`](Self::keep) has places for: there is nothing in it worth finding.
    pub(super) fn forget(&self) {
        remove_folder(&self.folder.join(KEPT));
    }

    /// Puts the files in place of the older result, which moves to `previous`.
    ///
    /// # Errors
    /// [`CliError::Unwritable`].
    pub(super) fn commit(mut self) -> Result<(), CliError> {
        // A signal waits, and then finds nothing to remove.
        let mut clean_up = signals::hold();
        self.put_in_place()
            .map_err(|cause| unwritable(&self.folder, cause))?;
        *clean_up = None;
        self.committed = true;
        Ok(())
    }

    /// Every state on the way is one that the next command understands: the manifest names all
    /// files there are, and `summary.json` is there only with all of its own.
    fn put_in_place(&mut self) -> io::Result<()> {
        let partial = self.partial();
        let mut names = BTreeSet::new();
        files_below(&partial, &mut |file| {
            // Only now a disk on the network says that it is full.
            File::open(file)?.sync_all()?;
            names.extend(name_in(&partial, file));
            Ok(())
        })?;
        let older = &self.manifest.names - &self.inputs;
        self.manifest.rewrite(&older | &names)?;
        retire(&self.folder, &older)?;
        let put = |name: &String| -> io::Result<()> {
            let to = self.folder.join(name);
            to.parent().map_or(Ok(()), fs::create_dir_all)?;
            fs::rename(partial.join(name), to)
        };
        let (summaries, others) = in_order(&names);
        others.into_iter().try_for_each(put)?;
        self.manifest.rewrite(names.clone())?;
        summaries.into_iter().rev().try_for_each(put)?;
        remove_folder(&partial);
        remove_folder(&self.folder.join(KEPT));
        Ok(())
    }

    /// Takes the older result out of sight of whoever looks for this command's.
    fn retire_older(&mut self) -> io::Result<()> {
        let older = &self.manifest.names - &self.inputs;
        retire(&self.folder, &older)?;
        if !self.manifest.names.is_empty() {
            self.manifest.rewrite(BTreeSet::new())?;
        }
        Ok(())
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        if self.committed {
            return;
        }
        // A signal that came first ends the process before this goes on.
        let mut clean_up = signals::hold();
        *clean_up = None;
        remove_folder(&self.partial());
        if signals::requested() {
            // As for those who do not look: what was there before is as it was.
        } else if let Err(cause) = self.retire_older() {
            say(format_args!(
                "warning: an older result is still in {}: it cannot be moved to its folder {PREVIOUS}: {cause}",
                self.folder.display()
            ));
        }
        self.manifest.untouched().remove_if_empty(&self.made);
    }
}

fn unwritable(file: &Path, cause: io::Error) -> CliError {
    CliError::Unwritable {
        file: file.to_path_buf(),
        cause,
    }
}

/// The folders on the way to `folder` that are not there, the innermost first.
fn missing(folder: &Path) -> Vec<PathBuf> {
    let named = folder
        .ancestors()
        .filter(|part| !part.as_os_str().is_empty());
    named
        .take_while(|part| !part.exists())
        .map(Path::to_path_buf)
        .collect()
}

/// Removes a folder of this module's own, if it is there. What cannot be removed now the next
/// command removes.
fn remove_folder(folder: &Path) {
    // Files may come while others go, where a signal ends a command in the middle of its work.
    for _ in 0..100 {
        match fs::remove_dir_all(folder) {
            Err(error) if error.kind() == io::ErrorKind::DirectoryNotEmpty => {}
            _ => return,
        }
    }
}

/// Calls `found` with every file below `folder`.
fn files_below(folder: &Path, found: &mut dyn FnMut(&Path) -> io::Result<()>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            files_below(&path, found)?;
        } else {
            found(&path)?;
        }
    }
    Ok(())
}

/// The name that `file` has in `folder`, with `/`; none where it is elsewhere.
fn name_in(folder: &Path, file: &Path) -> Option<String> {
    let inside = file.strip_prefix(folder).ok()?;
    let parts: Option<Vec<&str>> = inside.iter().map(|part| part.to_str()).collect();
    Some(parts?.join("/"))
}

/// Whether `name` is a result's: inside its folder, and not one of this module's own.
fn is_results(name: &str) -> bool {
    let path = Path::new(name);
    let mut parts = path.components();
    !name.is_empty()
        && !name.starts_with(MANIFEST)
        && parts.all(|part| matches!(part, Component::Normal(_)))
}

/// Names of summaries, the folder's own first, and of all other files.
fn in_order(names: &BTreeSet<String>) -> (Vec<&String>, Vec<&String>) {
    let is_summary = |name: &&String| name.rsplit('/').next() == Some(SUMMARY);
    let (mut summaries, others): (Vec<_>, Vec<_>) = names.iter().partition(is_summary);
    summaries.sort_by_key(|name| name.len());
    (summaries, others)
}

/// Moves the files `names` of `folder` to its folder `previous`, in place of what was moved there
/// before. Remains of a result without `summary.json` are no result, and are removed.
fn retire(folder: &Path, names: &BTreeSet<String>) -> io::Result<()> {
    let there = |name: &&String| folder.join(name).is_file();
    let names: BTreeSet<String> = names.iter().filter(there).cloned().collect();
    let previous = folder.join(PREVIOUS);
    let mut old = None;
    if names.contains(SUMMARY) {
        fs::create_dir_all(&previous)?;
        let mut manifest = Manifest::open(&previous)?;
        remove_files(&previous, &manifest.names)?;
        manifest.rewrite(names.clone())?;
        old = Some(previous);
    }
    let (summaries, others) = in_order(&names);
    for name in summaries.into_iter().chain(others) {
        let file = folder.join(name);
        match &old {
            Some(previous) => {
                let to = previous.join(name);
                to.parent().map_or(Ok(()), fs::create_dir_all)?;
                fs::rename(file, to)?;
            }
            None => fs::remove_file(file)?,
        }
    }
    remove_empty_folders(folder, &names);
    Ok(())
}

/// Removes those of the files `names` of `folder` that are there.
fn remove_files(folder: &Path, names: &BTreeSet<String>) -> io::Result<()> {
    for name in names {
        match fs::remove_file(folder.join(name)) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    remove_empty_folders(folder, names);
    Ok(())
}

/// Removes the folders that the files `names` of `folder` were in, where nothing else is in them.
fn remove_empty_folders(folder: &Path, names: &BTreeSet<String>) {
    for name in names {
        let folders = Path::new(name).ancestors().skip(1);
        for inner in folders.filter(|inner| !inner.as_os_str().is_empty()) {
            // Fails for a folder with something in it, which stays.
            let _ = fs::remove_dir(folder.join(inner));
        }
    }
}

/// The file that is locked and lists the result's files.
struct Manifest {
    path: PathBuf,
    file: File,
    /// The files' names, relative, with `/`.
    names: BTreeSet<String>,
}

impl Manifest {
    /// Makes `folder` and locks its manifest, until this is dropped.
    fn lock(folder: &Path) -> Result<Self, CliError> {
        let failed = |cause: io::Error| {
            let cause = match cause.kind() {
                // "File exists" would not say what is wrong with that.
                io::ErrorKind::AlreadyExists => io::ErrorKind::NotADirectory.into(),
                _ => cause,
            };
            unwritable(folder, cause)
        };
        loop {
            fs::create_dir_all(folder).map_err(failed)?;
            let manifest = match Self::open(folder) {
                // Removed with its folder by a command that was refused.
                Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                other => other.map_err(failed)?,
            };
            match manifest.file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    return Err(CliError::Busy {
                        folder: folder.to_path_buf(),
                    });
                }
                Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => {
                    say(format_args!(
                        "warning: {} is on a file system without locks: write there with one command at a time",
                        folder.display()
                    ));
                }
                Err(TryLockError::Error(error)) => return Err(failed(error)),
            }
            // Between opening and locking it may have been removed, or written.
            if manifest.is_at_its_path() {
                return Self::open(folder).map_err(failed).map(|again| Self {
                    names: again.names,
                    ..manifest
                });
            }
        }
    }

    /// Reads `folder`'s manifest, or makes an empty one.
    fn open(folder: &Path) -> io::Result<Self> {
        let path = folder.join(MANIFEST);
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path)?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        // Whoever has edited it: what is no name of a result's file is left alone.
        let names = String::from_utf8_lossy(&bytes)
            .lines()
            .filter(|name| is_results(name))
            .map(String::from)
            .collect();
        Ok(Self { path, file, names })
    }

    /// Whether the file that is open is the one that others would open.
    fn is_at_its_path(&self) -> bool {
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt;
            let id = |data: fs::Metadata| (data.dev(), data.ino());
            let there = fs::metadata(&self.path).ok().map(id);
            there.is_some() && there == self.file.metadata().ok().map(id)
        }
        // Elsewhere an open file is not removed.
        #[cfg(not(unix))]
        true
    }

    /// Makes it list `names`. A kill leaves either list: the new one is written at once, as long
    /// as the old one, and then cut.
    fn rewrite(&mut self, names: BTreeSet<String>) -> io::Result<()> {
        let mut text: String = names.iter().flat_map(|name| [name, "\n"]).collect();
        let (length, old) = (text.len() as u64, self.file.metadata()?.len());
        text.extend((length..old).map(|_| '\n'));
        self.file.rewind()?;
        self.file.write_all(text.as_bytes())?;
        self.file.set_len(length)?;
        self.names = names;
        Ok(())
    }

    /// Its path and whether it lists nothing, for when it is not changed any more.
    fn untouched(&self) -> Untouched {
        Untouched {
            path: self.path.clone(),
            empty: self.names.is_empty(),
        }
    }
}

/// A manifest of a command that has changed nothing, or nothing more.
struct Untouched {
    path: PathBuf,
    empty: bool,
}

impl Untouched {
    /// Leaves no trace of a command that leaves no result: removes the manifest, if it lists
    /// nothing, and the folders that were `made` for it, if they are empty.
    fn remove_if_empty(&self, made: &[PathBuf]) {
        if self.empty {
            let _ = fs::remove_file(&self.path);
            for folder in made {
                let _ = fs::remove_dir(folder);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Opens `folder` as a command without inputs does.
    fn open(folder: &Path) -> Result<Output, CliError> {
        Output::open(folder, [])
    }

    /// Writes files with their own names in them and commits.
    fn commit(folder: &Path, names: &[&str]) {
        let output = open(folder).unwrap();
        for name in names {
            output.write(name, |w| write!(w, "{name}")).unwrap();
        }
        output.commit().unwrap();
    }

    /// The files below a folder, but for its manifest.
    fn names(folder: &Path) -> Vec<String> {
        let mut names = Vec::new();
        files_below(folder, &mut |file| {
            names.extend(name_in(folder, file).filter(|name| name != MANIFEST));
            Ok(())
        })
        .unwrap();
        names.sort();
        names
    }

    #[test]
    fn what_is_kept_outlives_failures_and_goes_with_the_result() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("out");
        for _ in 0..2 {
            let output = open(&folder).unwrap();
            let kept = output.keep("rows.csv").unwrap();
            let mut file = OpenOptions::new().append(true).create(true).open(&kept);
            writeln!(file.as_mut().unwrap(), "row").unwrap();
            output.write("half.csv", |w| write!(w, "1")).unwrap();
        }
        assert_eq!(names(&folder), [".flexor-kept/rows.csv"]);
        let output = open(&folder).unwrap();
        let rows = fs::read_to_string(output.keep("rows.csv").unwrap());
        assert_eq!(rows.unwrap(), "row\nrow\n");
        output.json(SUMMARY, &Value::Null).unwrap();
        output.commit().unwrap();
        assert_eq!(names(&folder), [SUMMARY]);
    }

    #[test]
    fn a_refused_writer_changes_nothing() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path();
        commit(folder, &["a.csv", SUMMARY]);
        let first = open(folder).unwrap();
        let second = open(folder).map(|_| ());
        assert!(matches!(second, Err(CliError::Busy { .. })));
        assert_eq!(names(folder), ["a.csv", SUMMARY]);
        first.write("b.csv", |w| write!(w, "b")).unwrap();
        first.commit().unwrap();
        assert_eq!(
            names(folder),
            [
                "b.csv",
                "previous/.flexor",
                "previous/a.csv",
                "previous/summary.json"
            ]
        );
    }

    #[test]
    fn a_manifest_names_only_what_is_in_its_folder() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("out");
        let outside = root.path().join("mine.txt");
        fs::write(&outside, "mine").unwrap();
        commit(&folder, &["a.csv", SUMMARY]);
        let list = format!(
            "../mine.txt\n{}\n\n.flexor\na.csv\nsummary.json\ngone\n",
            outside.display()
        );
        fs::write(folder.join(MANIFEST), list).unwrap();
        drop(open(&folder).unwrap());
        assert_eq!(fs::read_to_string(outside).unwrap(), "mine");
        assert!(folder.join("previous/a.csv").exists() && !folder.join("a.csv").exists());
    }

    #[test]
    fn a_result_that_cannot_be_put_in_place_is_none() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path();
        commit(folder, &["a.csv", SUMMARY]);
        // In the way of a file: somebody's folder.
        fs::create_dir_all(folder.join("b.csv/full")).unwrap();
        let output = open(folder).unwrap();
        for name in ["a.csv", "b.csv", SUMMARY] {
            output.write(name, |w| write!(w, "new")).unwrap();
        }
        assert!(matches!(output.commit(), Err(CliError::Unwritable { .. })));
        assert_eq!(
            names(folder),
            [
                "previous/.flexor",
                "previous/a.csv",
                "previous/summary.json"
            ]
        );
        assert_eq!(
            fs::read_to_string(folder.join("previous/a.csv")).unwrap(),
            "a.csv"
        );
        assert!(folder.join("b.csv/full").exists());
    }

    #[test]
    fn a_shorter_list_replaces_a_longer_one() {
        let root = tempfile::tempdir().unwrap();
        let list = |names: &[&str]| names.iter().map(ToString::to_string).collect();
        let mut manifest = Manifest::open(root.path()).unwrap();
        manifest
            .rewrite(list(&["a/long name.csv", "b", "c"]))
            .unwrap();
        manifest.rewrite(list(&["b"])).unwrap();
        assert_eq!(
            fs::read_to_string(root.path().join(MANIFEST)).unwrap(),
            "b\n"
        );
        assert_eq!(Manifest::open(root.path()).unwrap().names, list(&["b"]));
    }
}

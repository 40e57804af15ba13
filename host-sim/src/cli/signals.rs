//! Ctrl-C, kill(1) and a closed terminal: what is done then.
//!
//! A process has one handler. Commands that must end in order by themselves ask for a flag and
//! look at it ([`stop_flag`]); all others are ended here, after a clean-up
//! ([`clean_up_when_ended`]).

use super::CliError;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Exit code of a command that was ended: 128 and Ctrl-C's number, as of one that does not
/// handle it. Which of the signals it was the handler is not told.
const INTERRUPTED: i32 = 130;

/// True once the process has been asked to end.
static STOP: AtomicBool = AtomicBool::new(false);

/// True where the command looks at [`STOP`] itself.
static ATTENDED: AtomicBool = AtomicBool::new(false);

/// What is done before the process is ended.
type CleanUp = Box<dyn FnOnce() + Send>;
static CLEAN_UP: Mutex<Option<CleanUp>> = Mutex::new(None);

/// A flag that is set when the process is asked to end, which from now on does not end it:
/// whoever calls this must look at the flag. A later call clears it and uses the same handler.
///
/// # Errors
/// [`CliError::Signals`] if signals cannot be caught.
#[cfg(feature = "target")]
pub(super) fn stop_flag() -> Result<&'static AtomicBool, CliError> {
    ATTENDED.store(true, Ordering::Relaxed);
    STOP.store(false, Ordering::Relaxed);
    catch()?;
    Ok(&STOP)
}

/// Whether a command that looks at its flag was asked to end.
pub(super) fn requested() -> bool {
    STOP.load(Ordering::Relaxed)
}

/// From now on a signal calls `clean_up`, in a thread of its own, and ends the process with exit
/// code 130. In place of what was to be done before, for a command that has ended.
///
/// Where signals cannot be caught, or the hang-up of a terminal is to be ignored (nohup(1)), they
/// do what they do without a handler, and nothing is cleaned up.
pub(super) fn clean_up_when_ended(clean_up: impl FnOnce() + Send + 'static) {
    ATTENDED.store(false, Ordering::Relaxed);
    STOP.store(false, Ordering::Relaxed);
    *hold() = Some(Box::new(clean_up));
    if !hangup_is_ignored() {
        // What is left behind then the next command removes.
        let _ = catch();
    }
}

/// What is to be done at the end. While it is held the process is not ended by a signal; where it
/// is being ended, this does not return.
pub(super) fn hold() -> MutexGuard<'static, Option<CleanUp>> {
    // A panic while it was held: the clean-up is none the worse.
    CLEAN_UP.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Installs the handler, if it is not there.
fn catch() -> Result<(), CliError> {
    match ctrlc::set_handler(end) {
        // This handler: nothing else in the program sets one.
        Ok(()) | Err(ctrlc::Error::MultipleHandlers) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// The handler.
fn end() {
    STOP.store(true, Ordering::Relaxed);
    if !ATTENDED.load(Ordering::Relaxed) {
        // Held to the end, so that the command neither goes on to put its files in place nor
        // says that they cannot be written.
        let mut clean_up = hold();
        if let Some(clean_up) = clean_up.take() {
            clean_up();
        }
        std::process::exit(INTERRUPTED);
    }
}

/// Whether the process was started to outlive its terminal. Linux says so; elsewhere a hang-up
/// ends the command.
fn hangup_is_ignored() -> bool {
    const HANGUP: u64 = 1 << 0;
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mut lines = status.lines();
    lines
        .find_map(|line| line.strip_prefix("SigIgn:"))
        .and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .is_some_and(|mask| mask & HANGUP != 0)
}

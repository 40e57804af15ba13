//! Ctrl-C, kill(1) and a closed terminal, for commands that must end in order.

use super::CliError;
use std::sync::atomic::{AtomicBool, Ordering};

/// True once the process has been asked to end.
static STOP: AtomicBool = AtomicBool::new(false);

/// A flag that is set when the process is asked to end, which from now on does not end it:
/// whoever calls this must look at the flag. For once in a process.
///
/// # Errors
/// [`CliError::Signals`] if signals cannot be caught.
pub(super) fn stop_flag() -> Result<&'static AtomicBool, CliError> {
    ctrlc::set_handler(|| STOP.store(true, Ordering::Relaxed))?;
    Ok(&STOP)
}

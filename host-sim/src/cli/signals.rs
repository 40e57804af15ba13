//! Ctrl-C, kill(1) and a closed terminal, for commands that must end in order.

use super::CliError;
use std::sync::atomic::{AtomicBool, Ordering};

/// True once the process has been asked to end.
static STOP: AtomicBool = AtomicBool::new(false);

/// A flag that is set when the process is asked to end, which from now on does not end it:
/// whoever calls this must look at the flag. A later call clears it and uses the same handler:
/// a process has one.
///
/// # Errors
/// [`CliError::Signals`] if signals cannot be caught.
pub(super) fn stop_flag() -> Result<&'static AtomicBool, CliError> {
    match ctrlc::set_handler(|| STOP.store(true, Ordering::Relaxed)) {
        // This handler: nothing else in the program sets one.
        Ok(()) | Err(ctrlc::Error::MultipleHandlers) => {}
        Err(error) => return Err(error.into()),
    }
    STOP.store(false, Ordering::Relaxed);
    Ok(&STOP)
}

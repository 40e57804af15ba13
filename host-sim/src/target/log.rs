//! The firmware's log: from the link's entries to text.

use super::error::TargetError;
use defmt_decoder::{Locations, Table as LogTable};
use flexor::link::LogEntry;
use std::io;
use std::path::Path;

/// Reads the log: the symbols in the image, and who is told.
pub struct Logs {
    table: LogTable,
    locations: Option<Locations>,
    sink: Box<dyn FnMut(&str)>,
}

impl Logs {
    /// Reads the symbols in the image `elf`; `sink` is given every line.
    ///
    /// # Errors
    /// [`TargetError::NoImage`], [`TargetError::NoLogTable`].
    pub fn new(elf: &Path, sink: impl FnMut(&str) + 'static) -> Result<Self, TargetError> {
        let path = || elf.to_path_buf();
        // A device might never end.
        let read = || match std::fs::metadata(elf)?.is_file() {
            true => std::fs::read(elf),
            false => Err(io::Error::other("not a file")),
        };
        let bytes = read().map_err(|source| TargetError::NoImage {
            path: path(),
            source,
        })?;
        let message = |message: String| TargetError::NoLogTable {
            path: path(),
            message,
        };
        let table = LogTable::parse(&bytes)
            .map_err(|error| message(format!("not a firmware image: {error}")))?
            .ok_or_else(|| message("not an image with a log".into()))?;
        // Without debug information there are no places, and nothing else is missing.
        let locations = table
            .get_locations(&bytes)
            .ok()
            .filter(|locations| table.indices().all(|i| locations.contains_key(&(i as u64))));
        Ok(Self {
            table,
            locations,
            sink: Box::new(sink),
        })
    }

    /// Gives the sink an entry as a line of text.
    pub(super) fn write_log(&mut self, entry: &LogEntry) {
        let line = match self.table.decode(entry) {
            Ok((frame, _)) => {
                let level = frame.level().map_or("", |level| level.as_str());
                let place = self.locations.as_ref().and_then(|l| l.get(&frame.index()));
                let place = place.map_or(String::new(), |place| {
                    let file = place.file.file_name().unwrap_or_default().display();
                    format!(" ({file}:{})", place.line)
                });
                format!("{level} {}{place}", frame.display_message())
            }
            // The board runs another image than the one whose symbols these are.
            Err(_) => format!("not to be read with this image's symbols: {entry:02x?}"),
        };
        (self.sink)(&line);
    }
}

//! Where a controller lives, and how the next one is handed to the tick.
//!
//! A controller is a few hundred bytes, and making one opens a table: both take longer than
//! interrupts may be held off. So there are two places. The supervisor's tick runs the one in
//! its own place; the main loop prepares the next in the other, with no lock held, and then
//! exchanges the two **references** under a short lock.

use crate::control::Controller;
use crate::supervisor::monitors::Monitors;

/// A controller, and the monitors of its run.
#[derive(Clone, Debug)]
pub struct MonitoredController<'a> {
    /// The controller.
    pub controller: Controller<'a, f32>,
    /// Its monitors.
    pub monitors: Monitors,
}

/// An exclusive reference to a place for one controller with its monitors, which may be empty.
///
/// There are two of them: one goes to [`Supervisor::new`](crate::supervisor::Supervisor::new),
/// the other stays with whoever prepares controllers.
#[derive(Debug)]
pub struct ControllerSlot<'a> {
    place: &'a mut Option<MonitoredController<'a>>,
}

impl<'a> ControllerSlot<'a> {
    /// An empty slot in this place; what was there is dropped.
    pub fn new(place: &'a mut Option<MonitoredController<'a>>) -> Self {
        *place = None;
        Self { place }
    }

    /// Puts a controller and the monitors of its run into the slot, instead of those that were there.
    pub fn put(&mut self, controller: Controller<'a, f32>, monitors: Monitors) {
        *self.place = Some(MonitoredController {
            controller,
            monitors,
        });
    }

    /// Exchanges what the two slots hold, by exchanging their references.
    pub(super) fn exchange(&mut self, other: &mut Self) {
        core::mem::swap(&mut self.place, &mut other.place);
    }

    /// The controller, to look at; `None` if the slot is empty.
    pub(super) fn look(&self) -> Option<&Controller<'a, f32>> {
        self.place.as_ref().map(|placed| &placed.controller)
    }

    /// The controller with its monitors; `None` if the slot is empty.
    #[inline]
    pub(super) fn controller(&mut self) -> Option<&mut MonitoredController<'a>> {
        self.place.as_mut()
    }
}

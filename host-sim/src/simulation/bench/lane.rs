//! One board with its sensors and drives: the supervisor in the loop.

use crate::plant::bench::CompliantReading;
use crate::simulation::bench::arm::{BenchArm, BenchBoard};
use crate::simulation::bench::injection::FaultKind;
use crate::simulation::bench::rig::{BoardTick, Rig};
use flexor::control::Controller;
use flexor::link::Refusal;
use flexor::supervisor::{
    Calibration, ControllerSlot, MonitorParameters, MonitoredController, Monitors, StartPose,
    Supervisor, check_enable,
};

/// A board, homed and enabled, in the loop.
pub(super) struct Lane<'a> {
    supervisor: Supervisor<'a>,
    /// Where the next controller is made.
    prepared: ControllerSlot<'a>,
    calibration: Calibration,
    rig: Rig,
    refusal: Option<Refusal>,
}

impl<'a> Lane<'a> {
    /// A board before the arm, which reads `first`: homed, moved to its start, enabled with
    /// what is `placed`. `places` are where the supervisor keeps its controllers. The drives have been
    /// commanded `planned` (N m) for long; the table begins at `start`. Whether the arm is near
    /// enough to that, which a board's link asks before it enables, is told and enables all the
    /// same: what a campaign draws may be farther off, and is to be judged by how it runs.
    pub(super) fn new(
        arm: &BenchArm,
        board: &BenchBoard,
        (placed, places): (
            MonitoredController<'a>,
            &'a mut [Option<MonitoredController<'a>>; 2],
        ),
        first: &CompliantReading,
        (planned, start): ([f64; 2], &StartPose),
        tick_rate_hz: u32,
    ) -> Self {
        let mut rig = Rig::new(arm, board, &[], (first, planned), tick_rate_hz);
        let [running, next] = places;
        let slot = ControllerSlot::new(running);
        let mut supervisor = Supervisor::new(
            &mut rig.board,
            slot,
            &board.safety,
            &board.calibration,
            tick_rate_hz,
        );
        supervisor.tick(&mut rig.board);
        let homed = supervisor.home();
        debug_assert!(homed.is_ok(), "a disabled board can be homed");
        rig.move_by_hand(&mut supervisor, (arm, first));
        let refusal = check_enable(&board.safety, &supervisor.enable_inputs(), start);
        let mut prepared = ControllerSlot::new(next);
        prepared.put(placed.controller, placed.monitors);
        let enabled = supervisor.enable(&mut prepared);
        debug_assert!(enabled.is_ok(), "a disabled board can be enabled");
        Self {
            supervisor,
            prepared,
            calibration: board.calibration,
            rig,
            refusal: refusal.err(),
        }
    }

    /// Why a board would not have been enabled where the arm stands; it is, all the same.
    pub(super) fn refusal(&self) -> Option<Refusal> {
        self.refusal
    }

    /// Whether the arm stands with its drives on, and could go over to another table.
    pub(super) fn stands(&self) -> bool {
        self.rig.board.torque.is_some()
            && (self.supervisor.controller()).is_some_and(|controller| controller.phase().stands())
    }

    /// Goes over to the table of `controller`, with these thresholds of its monitors; whether it does.
    pub(super) fn go_on(
        &mut self,
        controller: Controller<'a, f32>,
        monitors: &MonitorParameters,
        tick_rate_hz: u32,
    ) -> bool {
        let monitors = Monitors::new(monitors, &self.calibration, tick_rate_hz);
        self.prepared.put(controller, monitors);
        self.supervisor.go_on(&mut self.prepared).is_ok()
    }

    /// The tick at `t_s` (s) with the arm as `reading` says.
    pub(super) fn tick(&mut self, t_s: f64, reading: &CompliantReading) -> BoardTick {
        let Self {
            supervisor, rig, ..
        } = self;
        if rig.sense([t_s; 2], reading) {
            if !rig.has(FaultKind::LinkLost) {
                supervisor.link_alive();
            }
            // Asked at every tick; where there is nothing to pause or to end it is refused.
            let _ = supervisor.pause(rig.has(FaultKind::Pause));
            if rig.has(FaultKind::Retract) {
                let _ = supervisor.retract();
            }
            supervisor.tick(&mut rig.board);
        }
        rig.give(supervisor)
    }
}

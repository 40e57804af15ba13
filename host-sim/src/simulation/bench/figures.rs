//! What comes of a run on the bench: how it ended, and its figures.

use super::BenchRow;
use super::arm::period_s;
use crate::planner::plan::Plan;
use crate::simulation::closed_loop::{Outcome, tip_error_limit_m};
use flexor::fault::Fault;
use flexor::phase::Phase;
use flexor::signals::Saturation;

/// Time after leaving the table at which the tip's speed is a figure, s.
const SPEED_AFTER_S: f64 = 1.0;

/// From which error on a run counts as failed; where nothing is given, by the task's own size.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FailureLimits {
    /// Of the tip's place along the surface, m; `None` for a tenth of the path's length.
    pub along_m: Option<f64>,
    /// Of the contact force, N; `None` for ten times the planned force, or any where that is none.
    pub force_n: Option<f64>,
}

impl FailureLimits {
    /// The limits for a plan, m and N.
    fn of(&self, plan: &Plan) -> [f64; 2] {
        let force = plan.task.normal_force.largest();
        let ten_times = if force > 0.0 {
            10.0 * force
        } else {
            f64::INFINITY
        };
        [
            self.along_m.unwrap_or_else(|| tip_error_limit_m(plan)),
            self.force_n.unwrap_or(ten_times),
        ]
    }
}

/// A run's figures, up to the tick at which it ended. Those of a run that diverged may be
/// infinite or NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunFigures {
    /// How the run ended.
    pub outcome: Outcome,
    /// Root mean square of the true contact force's error over all ticks, N.
    pub force_error_rms_n: f64,
    /// Its largest magnitude, N.
    pub force_error_max_n: f64,
    /// Root mean square of the tip's error along the surface, m.
    pub along_error_rms_m: f64,
    /// Its largest magnitude, m.
    pub along_error_max_m: f64,
    /// Time without contact, all ticks together, s.
    pub contact_lost_s: f64,
    /// The longest time without contact, s.
    pub contact_lost_longest_s: f64,
    /// Largest contact force, N.
    pub force_max_n: f64,
    /// Largest torque magnitudes of both joints, N m.
    pub torque_max_nm: [f64; 2],
    /// Ticks in which a torque was limited.
    pub limited_ticks: u32,
    /// Time at which the run ended, from the path's start, s.
    pub ended_s: f64,
    /// Largest contact force of the approach, N: the impact.
    pub approach_force_max_n: f64,
    /// Time from enabling until the law pressed, s.
    pub touched_s: f64,
    /// Time from enabling until the table began, s.
    pub begun_s: f64,
    /// Losses of contact before the table began.
    pub before_losses: f64,
    /// Largest contact force from the retraction's begin on, N.
    pub after_force_max_n: f64,
    /// Largest way of the tip along the surface in the second after it, m.
    pub after_way_m: f64,
    /// Speed of the tip 1 s after it, m/s.
    pub after_speed_m_s: f64,
    /// Distance of the tip from where a move after the run was to end, m.
    pub parked_off_m: f64,
}

/// How many figures of a run are real numbers.
pub const FIGURES: usize = 18;

/// A figure of every run that has a unit: its name in files, and where it is in
/// [`RunFigures`].
pub type Figure = (&'static str, fn(&RunFigures) -> f64);

impl RunFigures {
    /// The figures that are real numbers, in the order of the files' columns.
    pub const COLUMNS: [Figure; FIGURES] = [
        ("force_error_rms_N", |f| f.force_error_rms_n),
        ("force_error_max_N", |f| f.force_error_max_n),
        ("along_error_rms_m", |f| f.along_error_rms_m),
        ("along_error_max_m", |f| f.along_error_max_m),
        ("contact_lost_s", |f| f.contact_lost_s),
        ("contact_lost_longest_s", |f| f.contact_lost_longest_s),
        ("force_max_N", |f| f.force_max_n),
        ("torque1_max_Nm", |f| f.torque_max_nm[0]),
        ("torque2_max_Nm", |f| f.torque_max_nm[1]),
        ("ended_s", |f| f.ended_s),
        ("approach_force_max_N", |f| f.approach_force_max_n),
        ("touched_s", |f| f.touched_s),
        ("begun_s", |f| f.begun_s),
        ("before_losses", |f| f.before_losses),
        ("after_force_max_N", |f| f.after_force_max_n),
        ("after_way_m", |f| f.after_way_m),
        ("after_speed_m_s", |f| f.after_speed_m_s),
        ("parked_off_m", |f| f.parked_off_m),
    ];

    /// The figures of these values in the order of [`COLUMNS`](Self::COLUMNS).
    pub fn from_columns(outcome: Outcome, values: [f64; FIGURES], limited_ticks: u32) -> Self {
        let [
            force_error_rms_n,
            force_error_max_n,
            along_error_rms_m,
            along_error_max_m,
            contact_lost_s,
            contact_lost_longest_s,
            force_max_n,
            torque1_max_nm,
            torque2_max_nm,
            ended_s,
            approach_force_max_n,
            touched_s,
            begun_s,
            before_losses,
            after_force_max_n,
            after_way_m,
            after_speed_m_s,
            parked_off_m,
        ] = values;
        Self {
            outcome,
            force_error_rms_n,
            force_error_max_n,
            along_error_rms_m,
            along_error_max_m,
            contact_lost_s,
            contact_lost_longest_s,
            force_max_n,
            torque_max_nm: [torque1_max_nm, torque2_max_nm],
            limited_ticks,
            ended_s,
            approach_force_max_n,
            touched_s,
            begun_s,
            before_losses,
            after_force_max_n,
            after_way_m,
            after_speed_m_s,
            parked_off_m,
        }
    }
}

/// Sums up a run as its ticks come.
#[derive(Clone, Debug)]
pub(super) struct Tally {
    /// Of the error along the surface, m, and of the force's, N.
    limits: [f64; 2],
    period_s: f64,
    /// Whether the plan presses anywhere.
    presses: bool,
    ticks: u32,
    force_square: f64,
    along_square: f64,
    lost_ticks: u32,
    lost_longest: u32,
    lost_now: u32,
    diverged: bool,
    not_begun: bool,
    /// Whether the arm was to be parked after the run, and whether it is.
    to_park: bool,
    parked: bool,
    fault: Option<Fault>,
    /// Before the table: contact was lost, or the law pressed, at the tick before.
    lost_before: bool,
    touched: bool,
    /// After the table: place along the surface where it was left, and the tip at the tick before, m.
    left_at: Option<f64>,
    tip_before: Option<[f64; 2]>,
    figures: RunFigures,
}

impl Tally {
    /// Nothing has happened yet on `plan`; the arm is `to_park` after it, or not.
    pub(super) fn new(limits: &FailureLimits, plan: &Plan, to_park: bool) -> Self {
        let zeros = [0.0; FIGURES];
        Self {
            limits: limits.of(plan),
            period_s: period_s(plan),
            presses: plan.task.normal_force.largest() > 0.0,
            ticks: 0,
            force_square: 0.0,
            along_square: 0.0,
            lost_ticks: 0,
            lost_longest: 0,
            lost_now: 0,
            diverged: false,
            not_begun: false,
            to_park,
            parked: false,
            fault: None,
            lost_before: false,
            touched: false,
            left_at: None,
            tip_before: None,
            figures: RunFigures::from_columns(Outcome::Completed, zeros, 0),
        }
    }

    /// A tick more.
    pub(super) fn add(&mut self, row: &BenchRow) {
        let figures = &mut self.figures;
        let (force, along) = (row.force_error(), row.along_error);
        self.ticks += 1;
        self.force_square += force * force;
        self.along_square += along * along;
        figures.force_error_max_n = figures.force_error_max_n.max(force.abs());
        figures.along_error_max_m = figures.along_error_max_m.max(along.abs());
        figures.force_max_n = figures.force_max_n.max(row.reading.force);
        if row.reading.force > 0.0 || !self.presses {
            self.lost_now = 0;
        } else {
            self.lost_ticks += 1;
            self.lost_now += 1;
            self.lost_longest = self.lost_longest.max(self.lost_now);
        }
        for joint in 0..2 {
            let torque = row.torque[joint].abs();
            figures.torque_max_nm[joint] = figures.torque_max_nm[joint].max(torque);
        }
        figures.limited_ticks += u32::from(row.saturation != [Saturation::None; 2]);
        figures.ended_s = row.t;
        self.fault = self.fault.or(row.fault);
    }

    /// A tick before the table begins, `since_s` after enabling: the arm, and where the run is.
    pub(super) fn before(&mut self, row: &BenchRow, since_s: f64) {
        let figures = &mut self.figures;
        figures.ended_s = row.t;
        figures.approach_force_max_n = if row.phase == Phase::Approach {
            figures.approach_force_max_n.max(row.reading.force)
        } else {
            figures.approach_force_max_n
        };
        let lost = row.phase == Phase::Lost;
        if lost && !self.lost_before {
            figures.before_losses += 1.0;
        }
        self.lost_before = lost;
        if row.phase != Phase::Contact {
            self.touched = false;
        } else if !self.touched {
            self.touched = true;
            figures.touched_s = since_s;
        }
        figures.begun_s = since_s + self.period_s;
        self.fault = self.fault.or(row.fault);
    }

    /// Rows are of every so many ticks only.
    pub(super) fn of_every(&mut self, ticks: u32) {
        self.period_s *= f64::from(ticks);
    }

    /// The table has not begun in time.
    pub(super) fn give_up(&mut self) {
        self.not_begun = true;
    }

    /// A tick after the table was left, `since_s` after that.
    pub(super) fn after(&mut self, row: &BenchRow, along_m: f64, since_s: f64) {
        let figures = &mut self.figures;
        let left_at = *self.left_at.get_or_insert(along_m);
        figures.after_force_max_n = figures.after_force_max_n.max(row.reading.force);
        if since_s <= SPEED_AFTER_S {
            figures.after_way_m = figures.after_way_m.max((along_m - left_at).abs());
            let tip = row.reading.tip;
            if let Some(before) = self.tip_before {
                let way = libm::hypot(tip[0] - before[0], tip[1] - before[1]);
                figures.after_speed_m_s = way / self.period_s;
            }
            self.tip_before = Some(tip);
        }
        self.fault = self.fault.or(row.fault);
    }

    /// The arm stands where a move after the run ended.
    pub(super) fn park(&mut self, row: &BenchRow) {
        let (tip, planned) = (row.reading.tip, row.tip_reference);
        self.figures.parked_off_m = libm::hypot(tip[0] - planned[0], tip[1] - planned[1]);
        self.parked = true;
    }

    /// The state has become infinite, undefined or absurd: there is nothing more to add.
    pub(super) fn diverge(&mut self) {
        self.diverged = true;
    }

    /// The run, judged.
    pub(super) fn finish(self) -> RunFigures {
        let ticks = f64::from(self.ticks.max(1));
        let mut figures = self.figures;
        figures.force_error_rms_n = (self.force_square / ticks).sqrt();
        figures.along_error_rms_m = (self.along_square / ticks).sqrt();
        figures.contact_lost_s = f64::from(self.lost_ticks) * self.period_s;
        figures.contact_lost_longest_s = f64::from(self.lost_longest) * self.period_s;
        figures.outcome = if let Some(fault) = self.fault {
            Outcome::Fault(fault)
        } else if self.diverged {
            Outcome::Diverged
        } else if self.not_begun {
            Outcome::NotBegun
        } else if self.to_park && !self.parked {
            Outcome::NotParked
        } else if figures.along_error_max_m > self.limits[0] {
            Outcome::TipOffPath
        } else if figures.force_error_max_n > self.limits[1] {
            Outcome::ForceOff
        } else if self.lost_ticks > 0 {
            Outcome::ContactLost
        } else {
            Outcome::Completed
        };
        figures
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_come_back_from_their_columns() {
        let values = std::array::from_fn(|i| 1.5 + i as f64);
        let figures = RunFigures::from_columns(Outcome::Diverged, values, 7);
        assert_eq!(
            RunFigures::COLUMNS.map(|(_, value)| value(&figures)),
            values
        );
        assert_eq!(figures.limited_ticks, 7);
    }
}

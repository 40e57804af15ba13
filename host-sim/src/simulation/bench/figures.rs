//! What comes of a run on the bench: how it ended, and its figures.

use super::BenchRow;
use super::arm::period_s;
use crate::planner::plan::Plan;
use crate::simulation::closed_loop::{Outcome, tip_error_limit_m};
use flexor::fault::Fault;
use flexor::signals::Saturation;

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
        let force = plan.task.normal_force;
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
}

/// A figure of every run that has a unit: its name in files, and where it is in
/// [`RunFigures`].
pub type Figure = (&'static str, fn(&RunFigures) -> f64);

impl RunFigures {
    /// The figures that are real numbers, in the order of the files' columns.
    pub const COLUMNS: [Figure; 10] = [
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
    ];

    /// The figures of these values in the order of [`COLUMNS`](Self::COLUMNS).
    pub fn from_columns(outcome: Outcome, values: [f64; 10], limited_ticks: u32) -> Self {
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
        }
    }
}

/// Sums up a run as its ticks come.
#[derive(Clone, Debug)]
pub(super) struct Tally {
    /// Of the error along the surface, m, and of the force's, N.
    limits: [f64; 2],
    period_s: f64,
    ticks: u32,
    force_square: f64,
    along_square: f64,
    lost_ticks: u32,
    lost_longest: u32,
    lost_now: u32,
    diverged: bool,
    fault: Option<Fault>,
    figures: RunFigures,
}

impl Tally {
    /// Nothing has happened yet on `plan`.
    pub(super) fn new(limits: &FailureLimits, plan: &Plan) -> Self {
        let zeros = [0.0; RunFigures::COLUMNS.len()];
        Self {
            limits: limits.of(plan),
            period_s: period_s(plan),
            ticks: 0,
            force_square: 0.0,
            along_square: 0.0,
            lost_ticks: 0,
            lost_longest: 0,
            lost_now: 0,
            diverged: false,
            fault: None,
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
        if row.reading.force > 0.0 {
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

    /// A tick at `t` (s) of the time in which the law settles.
    pub(super) fn settle(&mut self, t: f64, fault: Option<Fault>) {
        self.figures.ended_s = t;
        self.fault = self.fault.or(fault);
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

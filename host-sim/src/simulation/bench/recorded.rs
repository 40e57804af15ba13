//! A run as a board has told it: its telemetry, made into the rows and figures of a run on the bench.
//!
//! A board knows what its sensors say and not how the arm is. So the rows' readings are measured ones:
//! angles by the encoders, the root's moment by the gauge and its slope by that and by what the plan knows of
//! the link's weight, the force by the cell, the tip from these; friction and what the drives give nobody measures, and they are NaN. The link's shape
//! in pictures is the planned one.

use crate::plant::bench::CompliantReading;
use crate::simulation::bench::BenchRow;
use crate::simulation::bench::arm::period_s;
use crate::simulation::bench::bench::{BenchTask, path_s};
use crate::simulation::bench::figures::{RunFigures, Tally};
use crate::simulation::closed_loop::{LogRow, Run, SHAPE_STRIDE, Summary, summarise};
use flexor::control::LawParameters;
use flexor::link::{SensorReport, TelemetrySample};
use flexor::phase::Phase;
use flexor::supervisor::Calibration;

/// Makes rows of a board's telemetry.
pub struct RecordedRun<'a> {
    task: &'a BenchTask<'a>,
    calibration: Calibration,
    every_ticks: u32,
    /// Motor angles, rad, by encoders that are followed, and the counts that they stand at.
    motor: [f64; 2],
    encoder: [u16; 2],
    root_slope: f64,
    /// The sample before, and the first one with open brakes.
    last_tick: Option<u32>,
    opened: Option<u32>,
    /// When the table began and was left, ticks since the brakes opened.
    begun: Option<u32>,
    left: Option<u32>,
    approaches: bool,
    gaps: u32,
    missing: u32,
    rows: Vec<BenchRow>,
    /// Ticks of the plan that belong to the rows.
    planned: Vec<usize>,
    tally: Tally,
}

impl<'a> RecordedRun<'a> {
    /// A run of `task` that is about to begin where the board's sensors say `start`, of which every so
    /// many ticks are told.
    pub fn new(task: &'a BenchTask<'a>, start: &SensorReport, every_ticks: u16) -> Self {
        let every_ticks = u32::from(every_ticks.max(1));
        let mut tally = Tally::new(task.failure, task.plan, false);
        tally.of_every(every_ticks);
        Self {
            task,
            calibration: task.board.calibration.for_arm(&task.plan.model.arm),
            every_ticks,
            motor: start.measured.motor.map(f64::from),
            encoder: start.raw.encoder,
            root_slope: f64::from(start.measured.root_slope),
            last_tick: None,
            opened: None,
            begun: None,
            left: None,
            approaches: false,
            gaps: 0,
            missing: 0,
            rows: Vec::new(),
            planned: Vec::new(),
            tally,
        }
    }

    /// Gaps in the telemetry so far, and the samples that are missing in them.
    pub fn gaps(&self) -> (u32, u32) {
        (self.gaps, self.missing)
    }

    /// Takes the next sample.
    pub fn add(&mut self, sample: &TelemetrySample) {
        if let Some(last) = self.last_tick {
            let missing = sample.tick.wrapping_sub(last) / self.every_ticks;
            if missing > 1 {
                self.gaps += 1;
                self.missing += missing - 1;
            }
        }
        self.last_tick = Some(sample.tick);
        if !sample.open && self.opened.is_none() && sample.fault.is_none() {
            self.follow(sample);
            return;
        }
        let opened = *self.opened.get_or_insert(sample.tick);
        let since = sample.tick.wrapping_sub(opened);
        self.approaches |= sample.phase == Phase::Approach;
        if sample.begun && self.begun.is_none() {
            self.begun = Some(since);
        }
        let since_begun = self.begun.map_or(0, |begun| since - begun);
        let at = (since_begun as usize).min(self.task.plan.points.len() - 1);
        self.follow(sample);
        let reading = self.measure(sample, at);
        self.put(sample, (since, at), reading);
    }

    /// Follows the encoders.
    fn follow(&mut self, sample: &TelemetrySample) {
        for i in 0..2 {
            let step = sample.raw.encoder[i].wrapping_sub(self.encoder[i]);
            let rad = f64::from(self.calibration.encoder_rad[i]);
            self.motor[i] += f64::from(step.cast_signed()) * rad;
        }
        self.encoder = sample.raw.encoder;
    }

    /// What the root's slope is beyond what the gauge shows, rad, at a tick of the plan: a gauge that
    /// shows the moment does not know what link 2's own weight bends.
    fn beyond_the_gauge(&self, at: usize) -> f64 {
        match self.task.law {
            LawParameters::Paper(_) => 0.0,
            LawParameters::Hybrid(_) => {
                let point = &self.task.plan.points[at];
                let stiffness = self.task.plan.model.arm.moment_per_root_slope();
                point.root_slope - point.torque[1] / stiffness
            }
        }
    }

    /// What the sensors say of the arm, at a tick of the plan.
    fn measure(&mut self, sample: &TelemetrySample, at: usize) -> CompliantReading {
        let c = &self.calibration;
        let scaled = |count: u16, (per_count, zero): (f32, f32)| {
            (f64::from(count) - f64::from(zero)) * f64::from(per_count)
        };
        let shown = scaled(sample.raw.strain, c.slope_rad);
        let root_slope = shown + self.beyond_the_gauge(at);
        let period_s = f64::from(self.every_ticks) * period_s(self.task.plan);
        let root_slope_rate = (root_slope - self.root_slope) / period_s;
        self.root_slope = root_slope;
        let angle = [self.motor[0], self.motor[0] + self.motor[1] - root_slope];
        let arm = &self.task.plan.model.arm;
        let lengths = [arm.link1_length_m, arm.link2_length_m];
        let along = |f: fn(f64) -> f64| lengths[0] * f(angle[0]) + lengths[1] * f(angle[1]);
        CompliantReading {
            angle,
            rate: [f64::NAN; 2],
            motor_angle: self.motor,
            motor_rate: [f64::NAN; 2],
            root_slope,
            root_slope_rate,
            tip: [along(libm::cos), along(libm::sin)],
            tip_velocity: [f64::NAN; 2],
            depth: f64::NAN,
            normal: self.task.plan.surface.normal,
            force: scaled(sample.raw.force, c.force_n),
            friction_force: f64::NAN,
            root_moment: shown * f64::from(c.moment_nm_rad),
            torque: [f64::NAN; 2],
        }
    }

    /// Makes a row of a sample so many ticks after the brakes opened, at a tick of the plan.
    fn put(
        &mut self,
        sample: &TelemetrySample,
        (since, at): (u32, usize),
        reading: CompliantReading,
    ) {
        let plan = self.task.plan;
        let since_s = f64::from(since) * period_s(plan);
        let begun = self.begun.map(|begun| begun as usize);
        let last = plan.points.len() - 1;
        let point = &plan.points[at];
        let n = plan.surface.normal;
        let along = |p: [f64; 2]| n[1] * p[0] - n[0] * p[1];
        let row = BenchRow {
            t: match self.approaches {
                true => since_s,
                false => path_s(self.task, begun, since as usize),
            },
            reading,
            sample: sample.raw,
            tip_reference: point.tip.position,
            force_reference: point.force.normal,
            along_error: along(reading.tip) - along(point.tip.position),
            torque: sample.torque.map(f64::from),
            saturation: sample.saturation,
            integral: f64::from(sample.force_integral),
            target: [f64::NAN; 2],
            fault: sample.fault,
            phase: sample.phase,
        };
        let leaves = row.phase == Phase::Retract || row.phase.stands();
        if self.begun.is_none() {
            self.tally.before(&row, since_s);
        } else {
            let ended = at >= last;
            if self.left.is_none() && (ended || !leaves) {
                self.tally.add(&row);
            }
            if self.left.is_none() && (leaves || ended) {
                self.left = Some(since);
            }
            if let Some(left) = self.left {
                let after_s = f64::from(since - left) * period_s(plan);
                self.tally.after(&row, along(reading.tip), after_s);
            }
        }
        if !self.approaches && self.begun == Some(since) {
            // As on the bench, a run that starts pressing begins with the table.
            self.rows.clear();
            self.planned.clear();
        }
        self.rows.push(row);
        self.planned.push(at);
    }

    /// The run, its rows and its figures.
    pub fn finish(mut self) -> (Run, Vec<BenchRow>, RunFigures) {
        if self.begun.is_none() {
            self.tally.give_up();
        }
        let figures = self.tally.finish();
        let rows: Vec<LogRow> = self.rows.iter().map(LogRow::from).collect();
        let summary = Summary {
            force_error_rms: figures.force_error_rms_n,
            force_error_max: figures.force_error_max_n,
            ..summarise(&rows, |_| figures.outcome)
        };
        let plan = self.task.plan;
        let shapes = self.planned.iter().step_by(SHAPE_STRIDE);
        let run = Run {
            rows,
            summary,
            shapes: shapes
                .map(|tick| plan.deflection_at(*tick as u32).to_vec())
                .collect(),
            elements: plan.model.elements,
        };
        (run, self.rows, figures)
    }
}

//! Everything about one run on the bench, as a run is kept elsewhere too.

use crate::plant::Reading;
use crate::plant::bench::CompliantPlant;
use crate::plant::bench::lanes::Lanes;
use crate::simulation::bench::{BenchArm, BenchRow, RunFigures};
use crate::simulation::closed_loop::{LogRow, Run, SHAPE_STRIDE, Summary, summarise};

/// Collects the ticks of one arm.
#[derive(Clone, Debug)]
pub struct BenchLog {
    rows: Vec<BenchRow>,
    shapes: Vec<Vec<f64>>,
}

impl From<&BenchRow> for LogRow {
    fn from(row: &BenchRow) -> Self {
        let r = &row.reading;
        Self {
            t: row.t,
            reading: Reading {
                angle: r.angle,
                rate: r.rate,
                root_slope: r.root_slope,
                root_slope_rate: r.root_slope_rate,
                tip: r.tip,
                force: r.force,
                root_moment: r.root_moment,
            },
            tip_reference: row.tip_reference,
            force_reference: row.force_reference,
            torque: row.torque,
            saturation: row.saturation,
            integral: row.integral,
        }
    }
}

impl BenchLog {
    /// A log for so many ticks.
    pub fn new(ticks: usize) -> Self {
        Self {
            rows: Vec::with_capacity(ticks),
            shapes: Vec::with_capacity(ticks / SHAPE_STRIDE + 1),
        }
    }

    /// Adds a tick of `arm`, which is in `lane` of the plant.
    pub fn add<T: Lanes>(
        &mut self,
        row: &BenchRow,
        (plant, lane): (&CompliantPlant<T>, usize),
        arm: &BenchArm,
    ) {
        if self.rows.len().is_multiple_of(SHAPE_STRIDE) {
            let state = plant.state(lane);
            let q = &state[4..4 + arm.model.dof()];
            self.shapes
                .push(arm.model.deflection(q).as_slice().to_vec());
        }
        self.rows.push(*row);
    }

    /// The run of `arm` that has these `figures`, and its ticks.
    pub fn finish(self, figures: &RunFigures, arm: &BenchArm) -> (Run, Vec<BenchRow>) {
        let rows: Vec<LogRow> = self.rows.iter().map(LogRow::from).collect();
        let summary = Summary {
            // Approach, lifting and what follows have a force of their own.
            force_error_rms: figures.force_error_rms_n,
            force_error_max: figures.force_error_max_n,
            ..summarise(&rows, |_| figures.outcome)
        };
        let run = Run {
            rows,
            summary,
            shapes: self.shapes,
            elements: arm.model.elements,
        };
        (run, self.rows)
    }
}

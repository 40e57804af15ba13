//! Reports: figures as SVG files, and one self-contained HTML page with a verdict, tables, and
//! histories that share their time with a moving arm.
//!
//! Glossary: a *case* is a controller with its start, e.g. `feedforward`; a *plant* is
//! the simulated arm it ran on, e.g. `stiffness_x0.9`.

// Coordinates of drawings and decimals of words decide nothing.
#![allow(clippy::disallowed_methods)]

mod accuracy;
#[cfg(feature = "campaign")]
mod campaign;
mod figures;
mod gains;
mod html;
mod motion;
mod page;
mod plan;
mod series;

use crate::planner::plan::Plan;
use crate::planner::tip_force::NormalForce;
use crate::simulation::closed_loop::Run;
use std::path::{Path, PathBuf};

pub use accuracy::{AccuracyPage, write_accuracy};
#[cfg(feature = "campaign")]
pub use campaign::{CampaignPage, write_campaign};
pub use figures::gains::Gains;
pub use figures::write_figures;
pub use gains::{GainsPage, write_gains};
pub use html::{RunsPage, write_html};
pub use page::Verdict;
pub use plan::{PlanPage, write_plan};

/// One simulated case for the report.
#[derive(Clone, Copy, Debug)]
pub struct Case<'a> {
    /// Name of the case, snake_case; underscores are shown as spaces.
    pub case: &'a str,
    /// Name of the plant, likewise.
    pub plant: &'a str,
    /// The plan that was run.
    pub plan: &'a Plan,
    /// The run.
    pub run: &'a Run,
}

impl Case<'_> {
    /// Name of the case for readers.
    fn title(&self) -> String {
        self.case.replace('_', " ")
    }

    /// Name of the plant for readers.
    fn plant_title(&self) -> String {
        self.plant.replace('_', " ")
    }

    /// How it ended, for readers.
    fn outcome(&self) -> String {
        self.run.summary.outcome.name().replace('_', " ")
    }

    /// First and last time of the plan, s.
    fn times(&self) -> [f64; 2] {
        let end = |point: Option<&crate::planner::plan::PlanPoint>| point.map_or(0.0, |p| p.t);
        [end(self.plan.points.first()), end(self.plan.points.last())]
    }

    /// The planned force over these times, s and N: two points of a constant one.
    fn planned_force(&self) -> Vec<[f64; 2]> {
        /// Enough for a curve.
        const STEPS: u32 = 256;
        let [from, to] = self.times();
        let steps = match self.plan.task.normal_force {
            NormalForce::Constant(_) => 1,
            NormalForce::Along(_) => STEPS,
        };
        let times = (0..=steps).map(|i| from + (to - from) * f64::from(i) / f64::from(steps));
        let force = |t| self.plan.task.tip_force(t).normal;
        times.map(|t| [t, force(t)]).collect()
    }
}

/// Why a report could not be written.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// There is nothing to report.
    #[error("a report of no cases: at least one is accepted")]
    NoCases,
    /// A file or its folder could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A figure could not be drawn.
    #[error("cannot draw the figure {figure}: {reason}")]
    Draw {
        /// The figure's name.
        figure: String,
        /// What the plotting library said.
        reason: String,
    },
    /// The page could not be put together.
    #[error("cannot make the page {}: {reason}", path.display())]
    Page {
        /// The page's file.
        path: PathBuf,
        /// What the template engine said.
        reason: String,
    },
}

/// Writes `text` to `path` and makes the folder it goes into.
fn write_file(path: &Path, text: &str) -> Result<(), ReportError> {
    let failed = |path: &Path| {
        let path = path.to_path_buf();
        |source| ReportError::Write { path, source }
    };
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(failed(folder))?;
    }
    std::fs::write(path, text).map_err(failed(path))
}

#[cfg(test)]
pub(crate) mod testing {
    //! A short planned motion and a run of it, and the records of a made-up campaign.
    use crate::planner::path::{LinePath, Profile};
    use crate::planner::plan::{Plan, PlanOptions};
    use crate::planner::planning::plan;
    use crate::planner::task::{Ends, Task, Travel, Window};
    use crate::planner::tip_force::SurfaceFriction;
    use crate::plant::PlantParameters;
    use crate::simulation::closed_loop::{Run, RunOptions, Simulation};
    use crate::simulation::start::Start;
    use crate::testing::PAPER;
    use flexor::control::{LawParameters, LimitParameters};

    /// Records that no run was made for: the force error grows with the friction, and the runs
    /// whose link 1 is far off its mass lose their path or diverge.
    #[cfg(feature = "campaign")]
    pub(crate) fn campaign_records(runs: u64) -> crate::campaign::record::CampaignRecords {
        use crate::campaign::record::{CampaignRecords, RunFigures, RunOutcome, RunRecord};
        use rand_xoshiro::Xoshiro256StarStar;
        use rand_xoshiro::rand_core::{RngCore, SeedableRng};
        let record = |run| {
            let seed = 9000 + run;
            let mut random = Xoshiro256StarStar::seed_from_u64(seed);
            let mut uniform = |low: f64, high: f64| {
                low + (high - low) * (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
            };
            let mass = uniform(7.2, 8.8);
            let friction = uniform(0.0, 0.3);
            let stiffness = 10f64.powf(uniform(3.3, 4.7));
            let inertia = 10f64.powf(uniform(-4.5, -3.5));
            let tilt = uniform(-0.0175, 0.0175);
            let off = (mass - 8.0).abs();
            let force = 0.06 + 0.8 * friction + uniform(0.0, 0.1);
            let outcome = match (off, inertia) {
                (off, _) if off > 0.62 => RunOutcome::TipOffPath,
                (_, inertia) if inertia < 3.6e-5 => RunOutcome::Diverged,
                _ => RunOutcome::Completed,
            };
            let wild = if outcome == RunOutcome::Diverged {
                f64::NAN
            } else {
                1.0
            };
            let lost = if friction > 0.25 {
                uniform(0.0, 0.05)
            } else {
                0.0
            };
            let values = [
                wild * force,
                wild * force * uniform(2.5, 4.0),
                wild * 0.03 * off,
                wild * (0.004 + 0.08 * off),
                lost,
                0.6 * lost,
                2.0 + force,
                30.0,
                2.5,
                if outcome.failed() {
                    uniform(0.2, 2.0)
                } else {
                    2.0
                },
                // Of runs that start pressing and end with the table.
                0.0,
                0.0,
                2.0,
                0.0,
                2.0,
                0.0,
                0.0,
                0.0,
            ];
            RunRecord {
                run,
                seed,
                drawn: vec![mass, friction, stiffness, inertia, tilt],
                figures: RunFigures::from_columns(outcome, values, 0),
            }
        };
        CampaignRecords {
            parameters: [
                "arm.link1.mass_kg",
                "surface.friction",
                "surface.stiffness_N_m",
                "arm.link2.root_inertia_kgm2",
                "surface.tilt_rad",
            ]
            .map(String::from)
            .to_vec(),
            runs: (0..runs).map(record).collect(),
        }
    }

    pub(crate) fn short_run() -> (Plan, Run) {
        let task = Task {
            path: LinePath {
                from: [0.6, 0.05],
                to: [0.5, 0.05],
                duration: 0.4,
                profile: Profile::Poly11,
            },
            travel: Travel::Line,
            normal_force: 2.0.into(),
            direction: None,
            friction: SurfaceFriction::default(),
            pre_actuation: Window::Fixed(0.1),
            post_actuation: Window::Fixed(0.0),
            ends: Ends::default(),
        };
        let plan = plan(&PAPER, &task, &PlanOptions::default()).unwrap();
        let image = crate::planner::table_fit::fit_table(&plan).unwrap().image;
        let options = RunOptions {
            law: LawParameters::FEEDFORWARD,
            limits: LimitParameters {
                torque_nm: [100.0, 10.0],
                torque_rate_nm_s: [1e5, 1e4],
            },
            plant: PlantParameters {
                elements: 3,
                ..PlantParameters::default()
            },
            start: Start::PlanAtRest,
        };
        let run = Simulation::<f32>::new(&plan, &image, &options)
            .unwrap()
            .run(|_| {});
        (plan, run)
    }
}

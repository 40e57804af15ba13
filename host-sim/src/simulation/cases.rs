//! The demo's cases: the paper's figures 3 to 6, and the same path five times faster
//! from rest, each on the nominal plant and on one with 0.9 of the bending stiffness.

use crate::planner::task::{Task, Window};
use crate::plant::PlantParameters;
use crate::simulation::start::Start;
use flexor::control::{LawParameters, PaperParameters};

/// Which part of the control law acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Feedforward torques alone.
    Feedforward,
    /// Feedback alone.
    Feedback,
    /// Both.
    Proposed,
}

impl Mode {
    /// `law` with only this part of it acting. The hybrid law has no feedback alone: without the
    /// planned torques it would not carry the arm's weight.
    pub fn of(self, law: &LawParameters) -> LawParameters {
        match (self, law) {
            (Self::Feedforward, _) => LawParameters::FEEDFORWARD,
            (_, LawParameters::Hybrid(_)) => *law,
            (_, LawParameters::Paper(paper)) => LawParameters::Paper(PaperParameters {
                feedforward: self == Self::Proposed,
                ..*paper
            }),
        }
    }
}

/// A case of the demo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Case {
    /// Name, as in the demo's JSON.
    pub name: &'static str,
    /// What the figure in the paper is, or what the case shows.
    pub shows: &'static str,
    /// Acting part of the law.
    pub mode: Mode,
    /// State that the plant starts in.
    pub start: Start,
    /// True for the path in a fifth of its time, with pre- and post-actuation.
    pub fast: bool,
}

/// The demo's cases, in the order of the paper's figures.
pub const CASES: [Case; 5] = [
    Case {
        name: "feedforward_with_initial_velocity",
        shows: "figure 3: starts with the plan's elastic velocity",
        mode: Mode::Feedforward,
        start: Start::PlanMoving,
        fast: false,
    },
    Case {
        name: "feedforward",
        shows: "figure 4: starts at rest",
        mode: Mode::Feedforward,
        start: Start::PlanAtRest,
        fast: false,
    },
    Case {
        name: "feedback",
        shows: "figure 5: no feedforward",
        mode: Mode::Feedback,
        start: Start::PlanAtRest,
        fast: false,
    },
    Case {
        name: "proposed",
        shows: "figure 6: feedforward and feedback",
        mode: Mode::Proposed,
        start: Start::PlanAtRest,
        fast: false,
    },
    Case {
        name: "fast_from_rest",
        shows: "five times faster, with pre-actuation",
        mode: Mode::Proposed,
        start: Start::PlanAtRest,
        fast: true,
    },
];

/// The demo's plants: name, and factor on the bending stiffness. They have the plan's
/// number of elements, so that the nominal one is what was planned for.
pub const PLANTS: [(&str, f64); 2] = [("nominal", 1.0), ("stiffness_x0.9", 0.9)];

/// A plant of the demo for a plan with `elements` elements.
pub fn plant(elements: usize, bending_stiffness_scale: f64) -> PlantParameters {
    PlantParameters {
        elements,
        bending_stiffness_scale,
        ..PlantParameters::default()
    }
}

/// `task` in a fifth of its time, with the link bending before and after the motion
/// until it rests to 1e-6.
pub fn fast(task: &Task) -> Task {
    const WINDOW: Window = Window::Auto { tolerance: 1e-6 };
    let mut fast = task.clone();
    fast.path.duration /= 5.0;
    fast.pre_actuation = WINDOW;
    fast.post_actuation = WINDOW;
    fast
}

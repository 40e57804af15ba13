//! The figures: the arm's configurations along its path, every case's time histories, and
//! the contact forces of the cases over each other.
//!
//! File names: `stick_figure.svg`, `contact_force_cases.svg` and, a case,
//! `<case>_<plant>.svg`, in lower case with everything but letters, digits, dots and
//! hyphens as underscores.

mod accuracy;
mod arm;
mod axis;
#[cfg(feature = "campaign")]
mod campaign;
mod cases;
pub(super) mod gains;
mod plot;

use self::arm::stick_figure;
use self::cases::{contact_forces, histories};
use super::{Case, ReportError, write_file};
use crate::planner::plan::Plan;
use std::path::{Path, PathBuf};

pub(super) use accuracy::accuracy_figures;
pub(super) use axis::number;
#[cfg(feature = "campaign")]
pub(super) use campaign::{campaign_figures, correlation_text, percent};
pub(super) use plot::Figure;

/// Writes the figures of `cases` into the folder `dir` as SVG files and returns their
/// paths.
///
/// `stick_figure.svg` shows the planned motion of the first case;
/// `contact_force_cases.svg` the contact forces of all cases that take as long as the
/// first one, a panel for each plant, with further panels for cases that are off by far
/// more than the others; `<case>_<plant>.svg` the time histories of a case.
///
/// # Errors
/// [`ReportError`].
pub fn write_figures(dir: &Path, cases: &[Case]) -> Result<Vec<PathBuf>, ReportError> {
    figures(cases)?
        .into_iter()
        .map(|figure| {
            let path = dir.join(format!("{}.svg", figure.name));
            write_file(&path, &figure.svg)?;
            Ok(path)
        })
        .collect()
}

/// The figures of a plan.
pub(super) fn plan_figures(plan: &Plan) -> Result<Vec<Figure>, ReportError> {
    Ok(vec![stick_figure(plan)?])
}

/// All figures of `cases`.
pub(super) fn figures(cases: &[Case]) -> Result<Vec<Figure>, ReportError> {
    let first = cases.first().ok_or(ReportError::NoCases)?;
    let mut figures = vec![stick_figure(first.plan)?, contact_forces(cases)?];
    for case in cases {
        let mut figure = histories(case)?;
        // Two cases must not overwrite each other's file.
        let name = figure.name.clone();
        let mut number = 2;
        while figures.iter().any(|other| other.name == figure.name) {
            figure.name = format!("{name}_{number}");
            number += 1;
        }
        figures.push(figure);
    }
    Ok(figures)
}

#[cfg(test)]
mod tests {
    use super::arm::POSTURES;
    use super::*;
    use crate::model::arm_model::deflection_matrix;
    use crate::report::testing::short_run;
    use crate::simulation::closed_loop::{LogRow, Run};

    /// Checks that a figure is well-formed and draws nothing outside itself.
    fn check(figure: &Figure) {
        let document = roxmltree::Document::parse(&figure.svg)
            .unwrap_or_else(|error| panic!("{}: {error}", figure.name));
        let root = document.root_element();
        let numbers = |text: &str| -> Vec<f64> {
            text.split([' ', ','])
                .filter(|t| !t.is_empty())
                .map(|t| t.parse().unwrap())
                .collect()
        };
        let size = numbers(root.attribute("viewBox").unwrap());
        let mut lines = 0;
        for node in root.descendants() {
            let points = numbers(node.attribute("points").unwrap_or_default());
            lines += usize::from(points.len() > 2);
            for point in points.chunks(2) {
                let inside =
                    (0.0..=size[2]).contains(&point[0]) && (0.0..=size[3]).contains(&point[1]);
                assert!(inside, "{}: {point:?} is outside {size:?}", figure.name);
            }
        }
        assert!(lines > 10, "{}: only {lines} lines", figure.name);
    }

    #[test]
    fn figures_are_well_formed_whatever_the_signals_are() {
        let (plan, run) = short_run();
        let changed = |change: &dyn Fn(usize, &mut LogRow)| {
            let mut run = run.clone();
            run.rows
                .iter_mut()
                .enumerate()
                .for_each(|(i, row)| change(i, row));
            run
        };
        let set = |row: &mut LogRow, x: f64| {
            row.reading.force = x;
            row.reading.tip = [x; 2];
            row.reading.root_slope = x;
            row.torque = [x; 2];
        };
        let empty = Run {
            rows: vec![],
            shapes: vec![],
            ..run.clone()
        };
        let runs = [
            run.clone(),
            changed(&|_, row| set(row, 0.0)),
            changed(&|_, row| set(row, 1e300)),
            changed(&|_, row| set(row, f64::NAN)),
            changed(&|i, row| set(row, if i % 7 == 3 { f64::INFINITY } else { -1.0 })),
            changed(&|i, row| set(row, (-1.1_f64).powi(i as i32))),
            empty,
        ];
        for run in &runs {
            let case = Case {
                case: "a <b> & \"c\"",
                plant: "p",
                plan: &plan,
                run,
            };
            let figures = figures(&[case]).unwrap();
            assert_eq!(figures.len(), 3);
            figures.iter().for_each(check);
        }
    }

    #[test]
    fn cases_far_off_get_panels_of_their_own() {
        let (plan, run) = short_run();
        let mut off = run.clone();
        off.rows.iter_mut().for_each(|row| row.reading.force += 1.0);
        off.summary.force_error_rms = 1.0;
        let case = |name, run| Case {
            case: name,
            plant: "nominal",
            plan: &plan,
            run,
        };
        let axes = |runs: &[Case]| {
            let svg = contact_forces(runs).unwrap().svg;
            svg.matches("contact force (N)").count()
        };
        assert_eq!(axes(&[case("a", &run), case("b", &run)]), 1);
        assert_eq!(
            axes(&[case("a", &run), case("b", &off), case("c", &run)]),
            2
        );
    }

    #[test]
    fn files_are_written_under_stable_names_or_the_error_names_the_path() {
        let (plan, run) = short_run();
        let case = |name| Case {
            case: name,
            plant: "stiffness_x0.9",
            plan: &plan,
            run: &run,
        };
        let scratch = tempfile::tempdir().unwrap();
        let folder = scratch.path().join("new");
        let cases = [case("feedback"), case("../My Run"), case("feedback")];
        let paths = write_figures(&folder, &cases).unwrap();
        let names: Vec<&str> = paths
            .iter()
            .map(|path| path.file_name().unwrap().to_str().unwrap())
            .collect();
        let wanted = [
            "stick_figure.svg",
            "contact_force_cases.svg",
            "feedback_stiffness_x0.9.svg",
            ".._my_run_stiffness_x0.9.svg",
            "feedback_stiffness_x0.9_2.svg",
        ];
        assert_eq!(names, wanted);
        assert!(
            paths
                .iter()
                .all(|path| path.is_file() && path.parent() == Some(&folder))
        );

        // A file is no folder.
        let error = write_figures(&paths[0], &cases).unwrap_err();
        assert!(error.to_string().contains("stick_figure.svg"), "{error}");
        assert!(matches!(
            write_figures(&folder, &[]),
            Err(ReportError::NoCases)
        ));
    }

    #[test]
    fn the_stick_figure_has_equal_scales_and_points_down() {
        let (plan, _) = short_run();
        let svg = stick_figure(&plan).unwrap().svg;
        let document = roxmltree::Document::parse(&svg).unwrap();
        // Link 1 is a line of two points in its colour, 0.5 m long, from joint 1 down.
        let links: Vec<Vec<f64>> = document
            .descendants()
            .filter(|node| node.attribute("stroke") == Some("#7A7F85"))
            .map(|node| {
                let points = node.attribute("points").unwrap_or_default();
                let numbers = points.split([' ', ',']).filter(|t| !t.is_empty());
                numbers.map(|t| t.parse().unwrap()).collect()
            })
            .skip(1)
            .collect();
        assert_eq!(links.len(), POSTURES);
        let lengths: Vec<f64> = links
            .iter()
            .map(|p| (p[2] - p[0]).hypot(p[3] - p[1]))
            .collect();
        for (link, length) in links.iter().zip(&lengths) {
            assert!((length / lengths[0] - 1.0).abs() < 2e-3, "{lengths:?}");
            assert!(link[3] > link[1], "joint 2 is below joint 1: {link:?}");
        }
    }

    #[test]
    fn a_move_through_the_air_has_no_surface() {
        let (mut plan, _) = short_run();
        let texts = |plan: &Plan| {
            let svg = stick_figure(plan).unwrap().svg;
            svg.contains("\nsurface\n")
        };
        assert!(texts(&plan));
        plan.task.travel = crate::planner::task::Travel::Joints(crate::planner::path::JointWay {
            ends: [plan.points[0].joint.angle, plan.points[900].joint.angle],
        });
        assert!(!texts(&plan));
    }

    #[test]
    fn outlines_are_the_models_deflection() {
        let (plan, _) = short_run();
        let model = &plan.model;
        let q: Vec<f64> = (0..model.dof()).map(|i| 0.01 / (1.0 + i as f64)).collect();
        let shape =
            deflection_matrix(&model.arm, model.elements, 7).unwrap() * model.deflection(&q);
        for i in 0..=7 {
            let rho = model.arm.link2_length_m * i as f64 / 7.0;
            assert!((shape[i] - model.deflection_at(&q, rho)[0]).abs() < 1e-14);
        }
        assert!(deflection_matrix(&model.arm, 0, 7).is_none());
    }
}

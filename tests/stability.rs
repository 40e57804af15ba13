//! The stability analysis against the nonlinear plant and the paper's figures.

// Tests may compare with the platform's functions.
#![allow(clippy::disallowed_methods)]

use flexor::control::{Controller, ForceProjection, LimitParameters, PaperParameters};
use flexor::model::{ArmParameters, Elbow};
use flexor::table::Table;
use flexor_sim::analysis::stability::StabilityError;
use flexor_sim::analysis::stability::advice::warning;
use flexor_sim::analysis::stability::linear::{
    ANGLE1, ANGLE2, FORCE, Linear, OperatingPoint, SLOPE, SLOPE_RATE, TIP,
};
use flexor_sim::analysis::stability::map::GainId;
use flexor_sim::analysis::stability::path;
use flexor_sim::analysis::stability::path::Report;
use flexor_sim::analysis::stability::printed::Printed;
use flexor_sim::analysis::stability::sampled::with_gains_times;
use flexor_sim::analysis::stability::tune::{Prediction, TuneOptions, tune};
use flexor_sim::files::config;
use flexor_sim::model::configuration::State;
use flexor_sim::model::forward::Workspace;
use flexor_sim::model::geometric_stiffness::GeometricStiffness;
use flexor_sim::planner::limits::default_limits;
use flexor_sim::planner::plan::{Plan, PlanOptions};
use flexor_sim::planner::planning::plan;
use flexor_sim::planner::table_fit;
use flexor_sim::planner::task::Task;
use flexor_sim::plant;
use flexor_sim::plant::PlantParameters;
use flexor_sim::plant::spread::{PlantVariant, Spread};
use flexor_sim::simulation::cases;
use flexor_sim::simulation::closed_loop::{Outcome, RunOptions, Simulation, measurement};
use flexor_sim::simulation::start::{Start, plant_for};
use flexor_tests::{paper_arm, paper_task, planned};

fn default_law() -> PaperParameters {
    flexor_tests::paper_law()
}

fn planned_plant(plan: &Plan) -> PlantParameters {
    cases::plant(plan.model.elements, 1.0)
}

fn paper_plan(tick_rate_hz: u32) -> Plan {
    let options = PlanOptions {
        tick_rate_hz,
        ..PlanOptions::default()
    };
    plan(&paper_arm(), &paper_task(), &options).unwrap()
}

#[test]
fn at_the_papers_start_the_poles_are_the_independent_ones() {
    let plan = paper_plan(5000);
    let variant = PlantVariant::planned(&plan.model, plan.tick_rate_hz);
    let point = OperatingPoint::new(&plan, &mut plan.sampler(), &variant, 0.0).unwrap();
    let poles = Linear::new(&variant, &point).unwrap().poles();
    assert_eq!(poles.len(), 14);
    // Computed by an independent model.
    let expected = [(0.0, 4.705), (-1.739, 34.486), (-6.941, 138.484)];
    for (i, (re, im)) in expected.into_iter().enumerate() {
        for (pole, sign) in [(poles[2 * i], 1.0), (poles[2 * i + 1], -1.0)] {
            assert!(
                (pole.re - re).abs() < 1e-3 && (pole.im - sign * im).abs() < 1e-3,
                "{pole}"
            );
        }
    }
}

/// Arms to linearise: the paper's, and one with everything, elbow up.
fn arms() -> [ArmParameters; 2] {
    [
        paper_arm(),
        ArmParameters {
            root_inertia_kgm2: 3e-5,
            tip_mass_kg: 0.01,
            tip_inertia_kgm2: 2e-6,
            gravity_m_s2: [1.5, 8.0],
            elbow: Elbow::Up,
            ..paper_arm()
        },
    ]
}

/// Rate of the independent state, and the outputs.
type Evaluated = (Vec<f64>, [f64; 6]);

/// The plant's full derivative at independent coordinates `y`: an own route to them by
/// Newton's method on the two angles, not the library's inverse kinematics.
fn nonlinear(
    variant: &PlantVariant,
    point: &OperatingPoint,
    near: [f64; 2],
    y: &[f64],
    torque: [f64; 2],
) -> Evaluated {
    let model = &variant.model;
    let (n, m) = (model.dof(), 1 + model.dof());
    let (along, normal) = (point.along, point.surface.normal);
    let mut angle = near;
    let solve = |angle: [f64; 2], right: [f64; 2]| {
        let j = model.kinematics.jacobian(angle);
        let determinant = j[0][0] * j[1][1] - j[0][1] * j[1][0];
        [
            (j[1][1] * right[0] - j[0][1] * right[1]) / determinant,
            (j[0][0] * right[1] - j[1][0] * right[0]) / determinant,
        ]
    };
    let target = [0, 1].map(|i| point.surface.offset_m * normal[i] + y[0] * along[i]);
    for _ in 0..20 {
        let tip = model.kinematics.forward(angle);
        let step = solve(angle, [target[0] - tip[0], target[1] - tip[1]]);
        angle = [angle[0] + step[0], angle[1] + step[1]];
    }
    let rate = solve(angle, along.map(|a| a * y[m]));
    let mut state = vec![angle[0], angle[1], rate[0], rate[1]];
    state.extend(&y[1..m]);
    state.extend(&y[m + 1..]);
    let mut slope = vec![0.0; state.len()];
    let force = plant::derivative(
        model,
        &variant.parameters,
        &point.surface,
        torque,
        &state,
        &mut slope,
        &mut Workspace::new(model),
    );
    // The tip's acceleration along the surface, by the change of its velocity.
    let velocity = |angle: [f64; 2], rate: [f64; 2]| {
        let j = model.kinematics.jacobian(angle);
        (0..2)
            .map(|i| along[i] * (j[i][0] * rate[0] + j[i][1] * rate[1]))
            .sum::<f64>()
    };
    let h = 1e-5;
    let moved = |h: f64| {
        velocity(
            [angle[0] + h * rate[0], angle[1] + h * rate[1]],
            [rate[0] + h * slope[2], rate[1] + h * slope[3]],
        )
    };
    let mut derivative = y[m..].to_vec();
    derivative.push((moved(h) - moved(-h)) / (2.0 * h));
    derivative.extend(&slope[4 + n..]);
    let mut output = [0.0; 6];
    let view = State(state.as_slice());
    output[FORCE] = force;
    output[SLOPE_RATE] = model.slope_at_root(view.q_rate());
    output[ANGLE1] = angle[0];
    output[ANGLE2] = angle[1];
    output[TIP] = y[0];
    output[SLOPE] = model.slope_at_root(view.q());
    (derivative, output)
}

#[test]
fn the_linearisation_is_the_derivative_of_the_constrained_plant() {
    for arm in arms() {
        let plan = plan(&arm, &paper_task(), &PlanOptions::default()).unwrap();
        let rich = PlantParameters {
            elements: 3,
            bending_stiffness_scale: 0.9,
            link2_mass_scale: 1.1,
            viscous_friction_nms_rad: [0.01, 0.001],
            geometric_stiffness: GeometricStiffness::Full,
            ..PlantParameters::default()
        };
        for (parameters, angle) in [(planned_plant(&plan), 0.0), (rich, 0.03)] {
            let variant =
                PlantVariant::new(&plan.model.arm, plan.tick_rate_hz, &parameters, angle).unwrap();
            let mut sampler = plan.sampler();
            for t in [0.0, 0.7, 1.1, 1.6, 2.0] {
                let point = OperatingPoint::new(&plan, &mut sampler, &variant, t).unwrap();
                let near = sampler.at(t).joint.angle;
                let linear = Linear::new(&variant, &point).unwrap();
                let size = point.state.len();
                let evaluate = |column: usize, h: f64| {
                    let mut y = point.state.clone();
                    let mut torque = point.torque;
                    if column < size {
                        y[column] += h;
                    } else {
                        torque[column - size] += h;
                    }
                    nonlinear(&variant, &point, near, &y, torque)
                };
                for column in 0..size + 2 {
                    // Two central differences, extrapolated: of fourth order.
                    let h = 1e-5;
                    let [a, b, c, d] = [h, -h, 0.5 * h, -0.5 * h].map(|h| evaluate(column, h));
                    let slope = |f: &dyn Fn(&Evaluated) -> f64| {
                        let coarse = (f(&a) - f(&b)) / (2.0 * h);
                        let fine = (f(&c) - f(&d)) / h;
                        (4.0 * fine - coarse) / 3.0
                    };
                    let (state, feed, k) = if column < size {
                        (&linear.a, &linear.c, column)
                    } else {
                        (&linear.b, &linear.d, column - size)
                    };
                    // Relative to the largest entry of the row's kind.
                    let close = |found: f64, expected: f64, scale: f64, what: &str| {
                        assert!(
                            (found - expected).abs() < 1e-6 * scale.max(expected.abs()),
                            "t = {t}, column {column}, {what}: {found:e} against {expected:e}"
                        );
                    };
                    for i in 0..size {
                        let scale = state.row(i).amax().max(1.0);
                        close(state[(i, k)], slope(&|x| x.0[i]), scale, "state");
                    }
                    for i in 0..6 {
                        let scale = feed.row(i).amax().max(1.0);
                        close(feed[(i, k)], slope(&|x| x.1[i]), scale, "output");
                    }
                }
            }
        }
    }
}

/// A task that all but stands still at a place of the paper's path. After its end the
/// controller holds its last reference.
fn standing(x: f64) -> Task {
    let mut task = paper_task();
    task.path.from = [x, 0.05];
    task.path.to = [x - 1e-5, 0.05];
    task.path.duration = 0.1;
    task
}

/// Whether a nonlinear simulation of `law`, knocked at its start, grows within `duration`
/// s: the force error's envelope in the last quarter against that in the second. The
/// tangential mode neither grows nor decays.
fn grows(plan: &Plan, image: &[u8], law: &PaperParameters, duration: f64) -> bool {
    let limits = LimitParameters {
        torque_nm: [1e3; 2],
        torque_rate_nm_s: [1e9; 2],
    };
    let table = Table::open(image).unwrap();
    let mut controller =
        Controller::<f64>::new(&table, &plan.model.arm, &(*law).into(), &limits).unwrap();
    let mut plant = plant_for(plan, &planned_plant(plan), Start::Equilibrium).unwrap();
    let mut state = plant.state().to_vec();
    let n = plan.model.dof();
    // Some millinewtons: far above the table's rounding, far below what bends the arm.
    for (i, slope) in plan.model.root_slope.iter().enumerate() {
        state[4 + n + i] += 1e-6 * slope;
    }
    plant.set_state(&state);
    let mut held = plan.points[0].torque;
    let ticks = (duration * f64::from(plan.tick_rate_hz)).ceil() as usize;
    let mut envelope = [0.0_f64; 4];
    for tick in 0..ticks {
        let reading = plant.read(held);
        let error = (reading.force - plan.points[0].force.normal).abs();
        // Not >, which passes NaN over.
        if !(error < 1.0) {
            return true;
        }
        let part = 4 * tick / ticks;
        envelope[part] = envelope[part].max(error);
        held = controller.tick(&measurement(&reading)).torque;
        plant.advance(held);
    }
    envelope[3] > 3.0 * envelope[1]
}

/// Rays of gain space: K_DF (s), K_PF, K_IF (1/s), K_w (N m s/rad) and the filters, Hz.
fn rays() -> Vec<PaperParameters> {
    let law = |kd, kp, ki, kw, force, slope| PaperParameters {
        force_derivative_s: kd,
        force_proportional: kp,
        force_integral_per_s: ki,
        slope_rate_nms_rad: kw,
        force_filter_hz: force,
        slope_rate_filter_hz: slope,
        ..PaperParameters::FEEDFORWARD
    };
    vec![
        law(0.0, 1.0, 0.0, 0.0, None, None),
        law(0.0, 1.0, 0.0, 0.0, Some(20.0), None),
        law(0.0, 0.0, 1.0, 0.0, None, None),
        law(0.0, 0.0, 0.0, 1.0, None, None),
        law(0.0, 0.0, 0.0, 1.0, None, Some(200.0)),
        law(1e-3, 0.0, 0.0, 0.0, Some(50.0), None),
        law(1e-3, 0.1, 0.0, 0.0, Some(100.0), None),
        law(0.0, 0.1, 1.0, 0.0, Some(30.0), None),
        law(0.0, 0.0, 10.0, 0.1, None, Some(50.0)),
        law(0.0, 0.5, 10.0, 0.1, Some(10.0), Some(50.0)),
        law(1e-3, 0.1, 5.0, 0.05, Some(30.0), Some(100.0)),
        law(0.0, 0.05, 20.0, 0.2, Some(100.0), Some(30.0)),
        law(2e-4, 0.0, 3.0, 0.1, Some(200.0), Some(300.0)),
    ]
}

/// The factor on `law`'s gains at which the predicted loop becomes unstable.
fn predicted_edge(plan: &Plan, law: &PaperParameters) -> f64 {
    let variant = PlantVariant::planned(&plan.model, plan.tick_rate_hz);
    let frozen_points = path::frozen_points(plan, &variant, &path::times(plan, 2)).unwrap();
    let stable = |factor: f64| {
        let law = with_gains_times(law, factor);
        frozen_points
            .iter()
            .all(|frozen| frozen.verdict(plan, &law, 0.0).is_stable())
    };
    let mut edge = 1e-4;
    assert!(stable(edge), "{law:?}");
    while stable(1.05 * edge) {
        edge *= 1.05;
        assert!(edge < 1e4, "always stable: {law:?}");
    }
    let (mut inside, mut outside) = (edge, 1.05 * edge);
    for _ in 0..20 {
        let middle = 0.5 * (inside + outside);
        if stable(middle) {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    inside
}

/// Tries the rays at `tick_rate_hz`, each standing at another place of the path.
fn compare_edges(tick_rate_hz: u32) {
    for (i, ray) in rays().iter().enumerate() {
        let x = [0.7, 0.5, 0.3, 0.2][i % 4];
        let options = PlanOptions {
            tick_rate_hz,
            ..PlanOptions::default()
        };
        let plan = plan(&paper_arm(), &standing(x), &options).unwrap();
        let image = table_fit::fit_table(&plan).unwrap().image;
        let edge = predicted_edge(&plan, ray);
        let beyond = with_gains_times(ray, 1.05 * edge);
        let variant = PlantVariant::planned(&plan.model, plan.tick_rate_hz);
        let frozen_points = path::frozen_points(&plan, &variant, &[0.0]).unwrap();
        let verdict = frozen_points[0].verdict(&plan, &beyond, 0.0);
        let growth = verdict.radius.ln() * f64::from(tick_rate_hz);
        // Long enough to see the predicted growth, and some periods of the tangential mode.
        let duration = (10.0 / growth).clamp(8.0, 200.0);
        for (factor, unstable) in [(0.95, false), (1.05, true)] {
            let law = with_gains_times(ray, factor * edge);
            assert_eq!(
                grows(&plan, &image, &law, duration),
                unstable,
                "{tick_rate_hz} Hz, x = {x}, ray {i}, {duration} s: {factor} of {edge}: {law:?}"
            );
        }
    }
}

#[test]
fn at_5_khz_the_nonlinear_simulation_diverges_where_it_is_predicted_to() {
    compare_edges(5000);
}

#[test]
fn at_1_khz_the_nonlinear_simulation_diverges_where_it_is_predicted_to() {
    compare_edges(1000);
}

#[test]
fn the_printed_s2_makes_the_integrator_unstable_at_the_paths_end() {
    let plan = paper_plan(5000);
    for (projection, stable) in [
        (ForceProjection::AsPrinted, false),
        (ForceProjection::JacobianTranspose, true),
    ] {
        for integral in [0.5, 2.0, 5.0] {
            let law = PaperParameters {
                force_integral_per_s: integral,
                slope_rate_nms_rad: 0.05,
                force_projection: projection,
                ..PaperParameters::FEEDFORWARD
            };
            let report = Report::new(
                &plan,
                &planned_plant(&plan),
                &Spread::none(),
                &law,
                50,
                &|| (),
            )
            .unwrap();
            let summary = report.nominal;
            assert_eq!(
                summary.stable, stable,
                "{integral} {projection:?}: {summary:?}"
            );
            assert_eq!(summary.spectral_radius_max >= 1.0, !stable);
            if !stable {
                assert!(
                    summary.worst_mode.contains("integrator"),
                    "{}",
                    summary.worst_mode
                );
                assert!(summary.worst_t_s > 1.0, "{}", summary.worst_t_s);
                assert!(summary.worst_pole.re > 0.2 * integral && summary.worst_pole.im == 0.0);
                let words = warning(&plan, &planned_plant(&plan), &law).unwrap();
                assert!(
                    words[0].contains("integrator") && words[0].contains("t = "),
                    "{words:?}"
                );
            }
        }
    }
}

/// The spread that the default gains are made for.
fn spread() -> Spread {
    config::parse_spread("example", config::DEFAULT_SPREAD).unwrap()
}

#[test]
fn the_default_gains_keep_their_margins_over_path_and_spread() {
    let plan = paper_plan(5000);
    let law = default_law();
    let report = Report::new(&plan, &planned_plant(&plan), &spread(), &law, 50, &|| ()).unwrap();
    assert_eq!((report.points.len(), report.spread.len()), (50, 27));
    for summary in report.spread.iter().chain([&report.nominal]) {
        assert!(summary.stable, "{summary:?}");
        assert!(summary.gain_margin_db >= 6.0, "{summary:?}");
        assert!(summary.delay_margin_ticks >= 1.0, "{summary:?}");
        assert!(summary.contact_damping_min > 0.1, "{summary:?}");
    }
    // The finer mesh of `run`'s plants and a turned surface as well.
    let other = Spread {
        elements: vec![2, 8],
        contact_angle_rad: vec![-0.05, 0.05],
        tick_rate_hz: vec![4000, 10_000],
        bending_stiffness_scale: vec![0.8, 1.2],
        ..Spread::none()
    };
    for (name, variant) in other
        .variants(&plan.model.arm, plan.tick_rate_hz, &planned_plant(&plan))
        .unwrap()
    {
        let times = path::times(&plan, 11);
        let summary = path::quick_check(&plan, &name, &variant, &law, &times).unwrap();
        assert!(summary.stable, "{summary:?}");
    }
}

/// Force error rms and tip error rms of a simulation on the stiffness x 0.9 plant.
fn simulated(plan: &Plan, image: &[u8], law: &PaperParameters, start: Start) -> [f64; 2] {
    let options = RunOptions {
        law: (*law).into(),
        limits: default_limits(plan),
        plant: cases::plant(plan.model.elements, 0.9),
        start,
    };
    let mut simulation = Simulation::<f32>::new(plan, image, &options).unwrap();
    let summary = simulation.run(|_| {}).summary;
    assert_eq!(summary.outcome, Outcome::Completed);
    [summary.force_error_rms, summary.tip_error_rms]
}

#[test]
fn the_default_gains_divide_the_softer_arms_force_error_by_three() {
    let (plan, table) = planned(&paper_arm(), &paper_task());
    let run = |law: &PaperParameters| simulated(&plan, &table.image, law, Start::Equilibrium);
    let without = run(&PaperParameters::FEEDFORWARD);
    let with = run(&default_law());
    assert!(3.0 * with[0] <= without[0], "{with:?} against {without:?}");
    assert!(with[1] <= 2.0 * without[1], "{with:?} against {without:?}");
}

#[test]
fn errors_are_predicted_as_they_are_simulated() {
    let (plan, table) = planned(&paper_arm(), &paper_task());
    let variant = PlantVariant::new(
        &plan.model.arm,
        plan.tick_rate_hz,
        &cases::plant(3, 0.9),
        0.0,
    )
    .unwrap();
    let prediction = Prediction::new(&plan, "softer", &variant).unwrap();
    for law in [PaperParameters::FEEDFORWARD, default_law()] {
        let predicted = prediction.errors(&plan, &law);
        for (i, start) in [Start::Equilibrium, Start::PlanAtRest]
            .into_iter()
            .enumerate()
        {
            let found = simulated(&plan, &table.image, &law, start);
            let pairs = [
                (predicted.force_rms_n[i], found[0]),
                (predicted.tip_rms_m[i], found[1]),
            ];
            for (predicted, found) in pairs {
                assert!(
                    (predicted / found - 1.0).abs() < 0.05,
                    "{start:?}: {predicted:e} predicted, {found:e} found"
                );
            }
        }
    }
}

#[test]
fn tuning_is_repeatable_and_keeps_its_margins() {
    let plan = paper_plan(5000);
    let options = TuneOptions {
        law: default_law(),
        plant: planned_plant(&plan),
        spread: spread(),
        points: 50,
        gain_margin_db: 8.0,
        delay_margin_ticks: 2.0,
        seed: 7,
        particles: 8,
        iterations: 6,
    };
    let [a, b] = [0, 1].map(|_| tune(&plan, &options, &|| ()).unwrap());
    assert_eq!((a.law, a.cost), (b.law, b.cost));
    assert_eq!(a.tried, 8 * 7);
    assert!(a.cost < 0.9, "{}", a.cost);
    for summary in a.report.spread.iter().chain([&a.report.nominal]) {
        assert!(summary.gain_margin_db >= 8.0 && summary.delay_margin_ticks >= 2.0);
    }
}

#[test]
fn margins_are_where_the_loop_becomes_unstable() {
    let plan = paper_plan(5000);
    let law = default_law();
    let variant = PlantVariant::planned(&plan.model, plan.tick_rate_hz);
    let frozen_points = path::frozen_points(&plan, &variant, &[0.0, 1.0, 1.9]).unwrap();
    for frozen in frozen_points {
        let gain = frozen.gain_margin_db(&plan, &law, 2.5, path::GAIN_MARGIN_MAX_DB);
        let delay = frozen.delay_margin_ticks(&plan, &law, path::DELAY_MARGIN_MAX_TICKS);
        let stable = |db: f64, delay: f64| {
            let law = with_gains_times(&law, 10f64.powf(db / 20.0));
            frozen.verdict(&plan, &law, delay).is_stable()
        };
        assert!(
            stable(gain - 0.02, 0.0) && !stable(gain + 0.02, 0.0),
            "{gain} dB"
        );
        assert!(
            stable(0.0, delay - 0.02) && !stable(0.0, delay + 0.02),
            "{delay} ticks"
        );
    }
}

#[test]
fn gains_too_big_for_the_tick_are_told_with_mode_point_and_remedy() {
    // Without a filter the bare root bounds K_w T: 0.05 diverges at 1 ms, not at 0.2 ms.
    let law = PaperParameters {
        slope_rate_nms_rad: 0.05,
        ..PaperParameters::FEEDFORWARD
    };
    let slow = paper_plan(1000);
    let words = warning(&slow, &planned_plant(&slow), &law).unwrap();
    assert_eq!(words.len(), 2, "{words:?}");
    assert!(
        words[0].contains("unstable") && words[0].contains("root") && words[0].contains("t = ")
    );
    assert!(
        words[1].contains("K_w_Nms_rad up to 0.0") && words[1].contains("Hz"),
        "{words:?}"
    );
    let fast = paper_plan(5000);
    assert!(
        warning(&fast, &planned_plant(&fast), &law)
            .unwrap()
            .is_empty()
    );
}

#[test]
fn gains_that_no_controller_has_are_refused_by_name() {
    let plan = paper_plan(5000);
    for (gain, value) in [
        (GainId::ForceIntegral, -1.0),
        (GainId::SlopeRate, f64::NAN),
        (GainId::ForceProportional, 1e9),
        (GainId::ForceDerivative, f64::INFINITY),
    ] {
        let law = gain.set(&default_law(), value);
        let result = Report::new(
            &plan,
            &planned_plant(&plan),
            &Spread::none(),
            &law,
            50,
            &|| (),
        );
        match result {
            Err(StabilityError::Gain { name, .. }) => assert_eq!(name, gain.key()),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn the_printed_linearisation_misses_the_tangential_mode() {
    let plan = paper_plan(5000);
    let variant = PlantVariant::planned(&plan.model, plan.tick_rate_hz);
    let point = OperatingPoint::new(&plan, &mut plan.sampler(), &variant, 0.0).unwrap();
    let law = PaperParameters {
        force_derivative_s: 1e-3,
        force_proportional: 0.1,
        force_integral_per_s: 2.0,
        ..PaperParameters::FEEDFORWARD
    };
    let printed = Printed::at(&variant, &law, plan.normal_angle(), &point).unwrap();
    assert_eq!((printed.h1.nrows(), printed.h2.ncols()), (14, 14));
    assert!(printed.is_square());
    let exact = Linear::new(&variant, &point).unwrap().poles();
    let poles = printed.poles();
    // Every one solves eq. 23.
    for pole in &poles {
        let pencil = printed.h1.map(|x| pole * x) + printed.h2.map(|x| (*pole).powi(0) * x);
        let singular = pencil.svd(false, false).singular_values;
        assert!(singular.min() < 1e-6 * singular.max(), "{pole}");
    }
    // No pair near the tangential mode of the whole arm.
    assert!(
        poles.iter().all(|p| (p - exact[0]).norm() > 1.0),
        "{poles:?}"
    );
    let without = Printed::at(
        &variant,
        &PaperParameters::FEEDFORWARD,
        plan.normal_angle(),
        &point,
    );
    assert!(!without.unwrap().is_square());
}

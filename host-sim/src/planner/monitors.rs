//! Thresholds of the monitors for a plan of which nothing else is known.

use super::plan::Plan;
use flexor::control::LawParameters;
use flexor::supervisor::MonitorParameters;

/// Joint 1 is held stiffly: this is two and a half times what an arm that was never calibrated shows
/// when it is enabled, rad.
const PATH1_RAD: f64 = 0.03;
/// Joint 2 gives way to the surface: what the place of an uncalibrated surface makes of it, rad,
const PATH2_RAD: f64 = 0.15;
/// and what a link of another stiffness does, of the planned root slope.
const PATH2_SLOPE_SHARE: f64 = 0.4;
/// Of the planned speeds, and beside them, rad/s. Joint 2 swings with the link.
const SPEED_SHARES: [f64; 2] = [1.5, 1.75];
const SPEED_RAD_S: f64 = 0.5;
/// Of the planned force, and beside it, N.
const FORCE_SHARE: f64 = 0.6;
const FORCE_N: f64 = 0.3;
/// Of the moment that the planned force makes at the root of a link that lies along the surface, and
/// of the planned torque: of what the torque loop leaves over.
const MOMENT_SHARES: [f64; 2] = [0.1, 0.25];
/// The same of the balance: friction on the surface, weight, and what the plan does not know of the
/// link's motion; and of the balance that lasts, where the motion counts for less.
const BALANCE_SHARES: [[f64; 2]; 2] = [[0.3, 0.85], [0.4, 0.15]];
/// In the air all of it is weight and motion, and what lasts may be as much as what is short; and a
/// slow torque loop leaves more over of a smaller torque.
const BALANCE_SHARES_FREE: [[f64; 2]; 2] = [[0.0, 0.85]; 2];
const MOMENT_SHARES_FREE: [f64; 2] = [0.0, 0.5];
/// Least threshold of a moment, N m: a gauge's offset and noise.
const LEAST_NM: f64 = 0.05;

/// Largest planned speeds of the motors, rad/s.
pub fn planned_speed(plan: &Plan) -> [f64; 2] {
    plan.points.iter().fold([0.0; 2], |most, point| {
        let [link1, link2] = point.joint.rate;
        // Motor 2 turns the root tangent against link 1.
        let motor2 = link2 + point.root_slope_rate - link1;
        [most[0].max(link1.abs()), most[1].max(motor2.abs())]
    })
}

/// Largest planned moment that the inertia at link 2's root takes of joint 2's torque, N m: what a
/// gauge behind it does not see.
fn hub_moment(plan: &Plan) -> f64 {
    let rate_hz = f64::from(plan.tick_rate_hz);
    let of_ticks = plan.points.windows(2).map(|pair| {
        let bending = (pair[1].root_slope_rate - pair[0].root_slope_rate) * rate_hz;
        (pair[0].joint.acceleration[1] + bending).abs()
    });
    plan.model.arm.root_inertia_kgm2 * of_ticks.fold(0.0, f64::max)
}

/// Thresholds for arms that differ from the plan as a careful, but uncalibrated set-up does: beyond
/// what 500 of those show, and beyond what is planned. Without a gauge in the law (no torque loop)
/// nothing is asked of one, and without feedback, or a force in the plan, nothing of the force cell
/// either.
pub fn default_monitors(plan: &Plan, law: &LawParameters) -> MonitorParameters {
    let slopes = plan.points.iter().map(|point| point.root_slope.abs());
    let root_slope = slopes.fold(0.0, f64::max);
    let force = plan.task.normal_force.largest();
    let of_force = plan.model.arm.link2_length_m * force;
    let hub = hub_moment(plan);
    let moment = |[force, torque]: [f64; 2]| {
        LEAST_NM.max(force * of_force + torque * plan.peaks.torque[1]) + hub
    };
    let (gauge, cell) = match law {
        LawParameters::Hybrid(hybrid) => (hybrid.torque_loop_per_s > 0.0, true),
        LawParameters::Paper(paper) => (paper.has_feedback(), paper.has_feedback()),
    };
    let of_gauge = |threshold: f64| {
        if gauge {
            threshold as f32
        } else {
            f32::INFINITY
        }
    };
    let (moment_shares, balance_shares) = if force > 0.0 {
        (MOMENT_SHARES, BALANCE_SHARES)
    } else {
        (MOMENT_SHARES_FREE, BALANCE_SHARES_FREE)
    };
    let speed = planned_speed(plan);
    let path2 = PATH2_RAD + PATH2_SLOPE_SHARE * root_slope;
    MonitorParameters {
        path_rad: [PATH1_RAD as f32, path2 as f32],
        speed_rad_s: [0, 1].map(|i| (SPEED_SHARES[i] * speed[i] + SPEED_RAD_S) as f32),
        // In the air a quiet cell shows one count throughout, and cannot be told from a frozen one.
        force_n: if cell && force > 0.0 {
            (FORCE_SHARE * force + FORCE_N) as f32
        } else {
            f32::INFINITY
        },
        root_moment_nm: of_gauge(moment(moment_shares)),
        balance_nm: balance_shares.map(|shares| of_gauge(moment(shares))),
    }
}

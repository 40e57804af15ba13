//! Plans and runs as files that other tools read: CSV with units in the header, flat
//! JSON.

use crate::planner::plan::Plan;
use crate::simulation::closed_loop::{Run, Summary};
use flexor::signals::Saturation;
use serde_json::{Map, Value, json};
use std::io::{self, Write};

/// Writes a plan as CSV, one row a tick: time, angles, nodal deflections and slopes
/// (`w0` is the root slope, in the order of [`flexor::model`]), root slope rate,
/// torques, then rates, tip position and joint powers.
///
/// # Errors
/// The writer's.
pub fn plan_csv(plan: &Plan, writer: impl Write) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(writer);
    let n = plan.model.dof();
    let mut header: Vec<String> = ["t_s", "theta10_rad", "theta20_rad"]
        .map(String::from)
        .to_vec();
    header.extend((0..n).map(|i| format!("w{i}")));
    header.extend(
        [
            "root_slope_rate_rad_s",
            "tau1_Nm",
            "tau2_Nm",
            "theta10_rate_rad_s",
            "theta20_rate_rad_s",
            "x1_m",
            "x2_m",
            "power1_W",
            "power2_W",
        ]
        .map(String::from),
    );
    csv.write_record(&header)?;
    let mut row: Vec<String> = Vec::with_capacity(header.len());
    for (tick, point) in (0..).zip(&plan.points) {
        row.clear();
        let power = point.power();
        let joint = point.joint;
        let mut put = |values: &[f64]| row.extend(values.iter().map(f64::to_string));
        put(&[point.t]);
        put(&joint.angle);
        put(plan.deflection_at(tick));
        put(&[point.root_slope_rate]);
        put(&point.torque);
        put(&joint.rate);
        put(&point.tip.position);
        put(&power);
        csv.write_record(&row)?;
    }
    csv.flush()
}

/// Writes a run as CSV, one row a tick. A row holds what was measured at the tick and
/// the torques commanded then. `limited1` is 1 or -1 where more or less torque was
/// asked for than the limits allow; `force_integral_N` is the law's integral term.
///
/// # Errors
/// The writer's.
pub fn run_csv(run: &Run, writer: impl Write) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(writer);
    csv.write_record([
        "t_s",
        "f_normal_N",
        "f_normal_ref_N",
        "x1_m",
        "x2_m",
        "x1_ref_m",
        "x2_ref_m",
        "theta10_rad",
        "theta20_rad",
        "root_slope_rad",
        "root_slope_rate_rad_s",
        "tau1_Nm",
        "tau2_Nm",
        "limited1",
        "limited2",
        "force_integral_N",
    ])?;
    let side = |saturation| match saturation {
        Saturation::None => 0.0,
        Saturation::Upper => 1.0,
        Saturation::Lower => -1.0,
    };
    for row in &run.rows {
        let r = &row.reading;
        let values = [
            row.t,
            r.force,
            row.force_reference,
            r.tip[0],
            r.tip[1],
            row.tip_reference[0],
            row.tip_reference[1],
            r.angle[0],
            r.angle[1],
            r.root_slope,
            r.root_slope_rate,
            row.torque[0],
            row.torque[1],
            side(row.saturation[0]),
            side(row.saturation[1]),
            row.integral,
        ];
        csv.write_record(values.map(|x| x.to_string()))?;
    }
    csv.flush()
}

/// The errors and outcome of a run, as every summary has them.
pub fn errors_json(summary: &Summary) -> Map<String, Value> {
    object([
        ("force_error_rms_N", json!(summary.force_error_rms)),
        ("force_error_max_N", json!(summary.force_error_max)),
        ("tip_error_rms_m", json!(summary.tip_error_rms)),
        ("tip_error_max_m", json!(summary.tip_error_max)),
        ("outcome", json!(summary.outcome.name())),
    ])
}

/// A run's figures as flat JSON, keys with units.
pub fn summary_json(summary: &Summary) -> Map<String, Value> {
    let mut map = errors_json(summary);
    map.extend(object([
        ("force_min_N", json!(summary.force_min)),
        ("torque1_max_Nm", json!(summary.torque_max[0])),
        ("torque2_max_Nm", json!(summary.torque_max[1])),
        ("limited_ticks", json!(summary.limited_ticks)),
        ("ticks", json!(summary.ticks)),
    ]));
    map
}

/// A JSON object of the given entries, in their order.
pub fn object<const N: usize>(entries: [(&str, Value); N]) -> Map<String, Value> {
    entries
        .map(|(key, value)| (key.to_string(), value))
        .into_iter()
        .collect()
}

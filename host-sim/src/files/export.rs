//! Plans and runs as files that other tools read: CSV with units in the header, flat
//! JSON.

use crate::planner::plan::Plan;
#[cfg(feature = "bench")]
use crate::simulation::bench::{BenchRow, RunFigures};
use crate::simulation::closed_loop::{LogRow, Run, Summary};
#[cfg(feature = "bench")]
use flexor::fault::Fault;
use flexor::signals::Saturation;
use serde_json::{Map, Value, json};
use std::io::{self, Write};

/// Writes a plan as CSV, one row a tick: time, angles, nodal deflections and slopes
/// (in the order of [`flexor::model`]; slopes of the geometric model are sines of section angles), the
/// rate of the section angle at link 2's root, torques, then rates, tip position, joint powers, the
/// normal force, the friction that the plan counts on, the section angle at the root and the chord's length.
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
            "normal_force_N",
            "friction_N",
            "root_slope_rad",
            "chord_m",
        ]
        .map(String::from),
    );
    csv.write_record(&header)?;
    let mut row: Vec<f64> = Vec::with_capacity(header.len());
    for (tick, point) in (0..).zip(&plan.points) {
        row.clear();
        let power = point.power();
        let joint = point.joint;
        let mut put = |values: &[f64]| row.extend(values);
        put(&[point.t]);
        put(&joint.angle);
        put(plan.deflection_at(tick));
        put(&[point.root_slope_rate]);
        put(&point.torque);
        put(&joint.rate);
        put(&point.tip.position);
        put(&power);
        put(&[point.force.normal, point.force.along]);
        put(&[point.root_slope, point.chord_m]);
        csv.serialize(&row)?;
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
    csv.write_record(RUN_COLUMNS)?;
    for row in &run.rows {
        csv.serialize(run_values(row))?;
    }
    csv.flush()
}

/// Columns of every run.
const RUN_COLUMNS: [&str; 16] = [
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
];

/// Columns that runs on the bench have besides.
#[cfg(feature = "bench")]
const BENCH_COLUMNS: [&str; 12] = [
    "f_friction_N",
    "root_moment_Nm",
    "motor1_rad",
    "motor2_rad",
    "drive1_Nm",
    "drive2_Nm",
    "encoder1_count",
    "encoder2_count",
    "force_count",
    "strain_count",
    "fault",
    "phase",
];

/// The values of [`RUN_COLUMNS`].
fn run_values(row: &LogRow) -> [f64; 16] {
    let side = |saturation| match saturation {
        Saturation::None => 0.0,
        Saturation::Upper => 1.0,
        Saturation::Lower => -1.0,
    };
    let r = &row.reading;
    [
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
    ]
}

/// Writes a run on the bench as CSV, one row a tick: the columns of [`run_csv`], then what only the
/// bench has: friction on the surface and moment at link 2's root, the motors' angles, what the
/// drives tend to, the counts that the board read, and the number of the fault that it has latched
/// (0 for none). All but the time has single precision, more than any sensor has: half as many
/// digits to write. `limited` and torques are the board's commands.
///
/// # Errors
/// The writer's.
#[cfg(feature = "bench")]
pub fn bench_csv(rows: &[BenchRow], writer: impl Write) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(writer);
    csv.write_record(bench_columns())?;
    for row in rows {
        let values = bench_values(row);
        csv.serialize((values[0], &values.map(|value| value as f32)[1..]))?;
    }
    csv.flush()
}

/// The columns of a run on the bench.
#[cfg(feature = "bench")]
pub(super) fn bench_columns() -> impl Iterator<Item = &'static str> {
    RUN_COLUMNS.into_iter().chain(BENCH_COLUMNS)
}

/// Their values.
#[cfg(feature = "bench")]
pub(super) fn bench_values(row: &BenchRow) -> [f64; RUN_COLUMNS.len() + BENCH_COLUMNS.len()] {
    let (r, raw) = (&row.reading, &row.sample);
    let own = [
        r.friction_force,
        r.root_moment,
        r.motor_angle[0],
        r.motor_angle[1],
        row.target[0],
        row.target[1],
        f64::from(raw.encoder[0]),
        f64::from(raw.encoder[1]),
        f64::from(raw.force),
        f64::from(raw.strain),
        f64::from(row.fault.map_or(0, Fault::number)),
        f64::from(row.phase.number()),
    ];
    let common = run_values(&LogRow::from(row));
    core::array::from_fn(|i| match i.checked_sub(common.len()) {
        None => common[i],
        Some(i) => own[i],
    })
}

/// What a run on the bench has besides [`summary_json`].
#[cfg(feature = "bench")]
pub fn bench_json(figures: &RunFigures) -> Map<String, Value> {
    object([
        ("along_error_rms_m", json!(figures.along_error_rms_m)),
        ("along_error_max_m", json!(figures.along_error_max_m)),
        ("contact_lost_s", json!(figures.contact_lost_s)),
        (
            "contact_lost_longest_s",
            json!(figures.contact_lost_longest_s),
        ),
        ("force_max_N", json!(figures.force_max_n)),
        ("parked_off_m", json!(figures.parked_off_m)),
    ])
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

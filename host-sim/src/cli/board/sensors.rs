//! `flexor board sensors`: what sensors and interlocks say, once or until a signal.

use super::failed;
use crate::cli::signals::stop_flag;
use crate::cli::{CliError, print};
use crate::files::export;
use crate::target::Target;
use flexor::link::SensorReport;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Map, Value, json};
use std::io::{self, IsTerminal};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Between two records of `sensors --follow`.
const FOLLOW: Duration = Duration::from_millis(100);

/// The sensors as flat JSON.
pub(super) fn json(report: &SensorReport) -> Map<String, Value> {
    let SensorReport {
        raw,
        measured,
        interlocks,
        in_range,
        homed,
    } = report;
    export::object([
        ("encoder1_counts", json!(raw.encoder[0])),
        ("encoder2_counts", json!(raw.encoder[1])),
        ("force_counts", json!(raw.force)),
        ("strain_counts", json!(raw.strain)),
        ("fresh", json!(raw.fresh)),
        ("in_range", json!(in_range)),
        ("homed", json!(homed)),
        ("theta10_rad", json!(measured.angle[0])),
        ("theta20_rad", json!(measured.angle[1])),
        ("root_slope_rad", json!(measured.root_slope)),
        ("root_slope_rate_rad_s", json!(measured.root_slope_rate)),
        ("force_N", json!(measured.force)),
        ("motor1_rad", json!(measured.motor[0])),
        ("motor2_rad", json!(measured.motor[1])),
        ("root_moment_Nm", json!(measured.root_moment)),
        ("estop_released", json!(interlocks.estop_released)),
        ("drives_ok", json!(interlocks.drives_ok)),
    ])
}

/// The same as facts for a reader.
pub(super) fn facts(report: &SensorReport) -> Vec<(&'static str, String)> {
    let SensorReport {
        raw,
        measured,
        interlocks,
        in_range,
        homed,
    } = report;
    let counts = |count: u16| format!("{count:8} counts");
    let rad = |angle: f32| format!("{angle:8.4} rad");
    vec![
        ("encoder 1", counts(raw.encoder[0])),
        ("encoder 2", counts(raw.encoder[1])),
        ("force cell", counts(raw.force)),
        ("strain gauge", counts(raw.strain)),
        (
            "conversions",
            match (raw.fresh, in_range) {
                (true, true) => "fresh".into(),
                (false, _) => "not fresh: force cell and strain gauge gave nothing new".into(),
                (true, false) => {
                    "force cell or strain gauge at its rail: a broken wire, or too much".into()
                }
            },
        ),
        (
            "positions",
            if *homed {
                "known".into()
            } else {
                "counted from where it stood at start: not homed".into()
            },
        ),
        ("theta10", rad(measured.angle[0])),
        ("theta20", rad(measured.angle[1])),
        ("root slope", rad(measured.root_slope)),
        (
            "root slope rate",
            format!("{:8.2} rad/s", measured.root_slope_rate),
        ),
        ("contact force", format!("{:8.3} N", measured.force)),
        (
            "emergency stop",
            if interlocks.estop_released {
                "released".into()
            } else {
                "pressed, or its wire is broken".into()
            },
        ),
        (
            "drives",
            if interlocks.drives_ok {
                "ok".into()
            } else {
                "a fault, or a wire is broken".into()
            },
        ),
    ]
}

/// Heads of [`sensors_line`]'s columns: names, units. 78 columns, for terminals of 80.
const SENSORS_HEAD: [&str; 2] = [
    " enc1  enc2 force strn theta10 theta20   slope    rate   force stop drives new",
    "              counts     rad     rad     rad   rad/s       N",
];

/// A number in a column; one too large for it, such as an encoder's that counts QEMU's time,
/// in powers of ten.
fn column(value: f32, width: usize, decimals: usize) -> String {
    let plain = format!("{value:width$.decimals$}");
    if plain.len() > width {
        return format!("{value:width$.0e}");
    }
    plain
}

/// The sensors in a line.
fn sensors_line(report: &SensorReport) -> String {
    let SensorReport {
        raw,
        measured: m,
        interlocks,
        in_range,
        ..
    } = report;
    let either = |good: bool, yes: &'static str, no: &'static str| if good { yes } else { no };
    format!(
        "{:5} {:5} {:5} {:4} {} {} {} {} {} {:4} {:6} {:3}",
        raw.encoder[0],
        raw.encoder[1],
        raw.force,
        raw.strain,
        column(m.angle[0], 7, 4),
        column(m.angle[1], 7, 4),
        column(m.root_slope, 7, 4),
        column(m.root_slope_rate, 7, 1),
        column(m.force, 7, 3),
        either(interlocks.estop_released, "free", "STOP"),
        either(interlocks.drives_ok, "ok", "FAULTY"),
        either(raw.fresh, either(*in_range, "yes", "END"), "NO"),
    )
}

/// Prints the sensors until a signal.
pub(super) fn follow(board: &mut Target, as_json: bool, bar: &ProgressBar) -> Result<(), CliError> {
    let stop = stop_flag()?;
    let on_terminal = !as_json && io::stdout().is_terminal();
    if let Ok(style) = ProgressStyle::with_template("{msg}") {
        bar.set_style(style);
    }
    if !as_json {
        SENSORS_HEAD.iter().try_for_each(print)?;
    }
    let begun = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        let report = match board.sensors() {
            Ok(report) => report,
            // The signal's end of QEMU, which gets it from the terminal too.
            Err(_) if stop.load(Ordering::Relaxed) => break,
            Err(error) => return Err(failed(error)),
        };
        if on_terminal {
            bar.set_message(sensors_line(&report));
        } else if as_json {
            let t_s = begun.elapsed().as_secs_f64();
            let mut keys = export::object([("t_s", json!(t_s))]);
            keys.extend(json(&report));
            print(Value::Object(keys))?;
        } else {
            print(sensors_line(&report))?;
        }
        std::thread::sleep(FOLLOW);
    }
    // The terminal's own "^C" has pushed the last record up, out of the bar's reach.
    bar.finish_and_clear();
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use flexor::link::{Interlocks, RawSample};
    use flexor::signals::Measurement;

    #[test]
    fn the_widest_values_stay_below_their_heads_within_80_columns() {
        let report = SensorReport {
            raw: RawSample {
                encoder: [65_535; 2],
                force: 4095,
                strain: 4095,
                fresh: false,
            },
            measured: Measurement {
                angle: [-9.9999, -9635.25],
                root_slope: f32::NEG_INFINITY,
                root_slope_rate: -2500.0,
                force: -20.0,
                ..Measurement::default()
            },
            interlocks: Interlocks {
                estop_released: false,
                drives_ok: false,
            },
            in_range: true,
            homed: true,
        };
        let line = sensors_line(&report);
        assert_eq!(line.len(), SENSORS_HEAD[0].len());
        assert!(line.len() < 80);
        // Each value ends below the last letter of its head, or begins below the first.
        let ends = |text: &str| -> Vec<usize> {
            let bytes = text.as_bytes();
            let last = |i: &usize| bytes[*i] != b' ' && bytes.get(i + 1).is_none_or(|b| *b == b' ');
            (0..text.len()).filter(last).collect()
        };
        assert_eq!(ends(&line)[..9], ends(SENSORS_HEAD[0])[..9]);
    }
}

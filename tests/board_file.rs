//! The board file: what it says reaches firmware, planner and simulator, and what is wrong with it
//! is said.

use flexor::link::RawSample;
use flexor::supervisor::{BoardParameters, Calibration, DriveScale, SafetyLimits, Sensing};
use flexor_sim::files::config::{DEFAULT_BOARD, parse_board};
use flexor_sim::plant::bench::{Channels, Sensed};
use proptest::prelude::*;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A folder of its own for a test, empty at its start.
fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(test);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn flexor(arguments: &[&str]) -> Output {
    let program = Path::new(env!("CARGO_BIN_EXE_flexor"));
    Command::new(program).args(arguments).output().unwrap()
}

fn default_board() -> BoardParameters {
    parse_board("board", DEFAULT_BOARD).unwrap().parameters
}

/// The default file with `from` replaced by `to`.
fn changed(from: &str, to: &str) -> String {
    assert!(DEFAULT_BOARD.contains(from), "{from}");
    DEFAULT_BOARD.replacen(from, to, 1)
}

/// Each value as the firmware derived it in `f32` when it still was a constant of its sources.
#[test]
fn the_default_board_is_bit_for_bit_the_one_that_the_firmware_had() {
    let config = parse_board("board", DEFAULT_BOARD).unwrap();
    assert_eq!(config.name, "stm32f405");
    let board = config.parameters;
    assert_eq!(board.tick_rate_hz, 5000);

    let Calibration {
        encoder_rad,
        home_rad,
        force_n,
        slope_rad,
        moment_nm_rad,
        range,
    } = board.calibration();
    let encoder = std::f32::consts::TAU / (4.0_f32 * 4096.0_f32 * 1.0_f32);
    let bits = |values: [f32; 2]| values.map(f32::to_bits);
    assert_eq!(bits(encoder_rad), bits([encoder; 2]));
    assert_eq!(bits(home_rad), bits([std::f32::consts::FRAC_PI_2, 0.0]));
    assert_eq!(bits(force_n.into()), bits([40.0_f32 / 4096.0, 2048.0]));
    assert_eq!(bits(slope_rad.into()), bits([1.0_f32 / 4096.0, 2048.0]));
    assert_eq!(moment_nm_rad, 0.0);
    assert_eq!(range, (16, 4079));

    for (drive, full_scale) in board.drives().into_iter().zip([40.0_f32, 4.0]) {
        let DriveScale {
            zero,
            full_scale_nm,
        } = drive;
        assert_eq!(zero, 2048);
        assert_eq!(full_scale_nm.to_bits(), full_scale.to_bits());
    }
    let usable = 1.45_f64 / 1.65;
    let limits = [usable * f64::from(40.0_f32), usable * f64::from(4.0_f32)];
    assert_eq!(
        board.drive_limit_nm().map(f64::to_bits),
        limits.map(f64::to_bits)
    );

    let SafetyLimits {
        start_rad,
        start_motor_rad,
        soft_start_ticks,
        link_timeout_ticks,
    } = board.safety();
    assert_eq!(
        start_rad.map(f32::to_bits),
        [0.01_f32, 0.01, 0.02].map(f32::to_bits)
    );
    assert_eq!(
        start_motor_rad.map(f32::to_bits),
        [0.01_f32, 0.05].map(f32::to_bits)
    );
    assert_eq!((soft_start_ticks, link_timeout_ticks), (500, 5000 / 10));
}

#[test]
fn what_no_single_range_says_is_refused_in_one_line() {
    for (from, to, words) in [
        (
            "sign = [1, 1]",
            "sign = [1, 2]",
            "b.toml: encoders.sign = [1, 2]; accepted: 1 or -1 for either joint",
        ),
        (
            "range_N = [-20.0, 20.0]",
            "range_N = [0.0, 20.0]",
            "b.toml: force_cell.range_N = [0, 20]; accepted: two forces in N, one below and one above 0, from -1e6 to 1e6, 1e-9 apart at least, whose 0 is converter.rail_counts from either end",
        ),
        (
            "range_N = [-20.0, 20.0]",
            "range_N = [5.0, 20.0]",
            "force_cell.range_N = [5, 20]",
        ),
        (
            "range_N = [-20.0, 20.0]",
            "range_N = [0.0, 0.0]",
            "force_cell.range_N = [0, 0]",
        ),
        (
            "range_rad = [-0.5, 0.5]",
            "range_rad = [1e-300, -1e-300]",
            "root_gauge.range_rad = [1e-300, -1e-300]",
        ),
        (
            "rail_counts = 16 ",
            "rail_counts = 1024 ",
            "b.toml: converter.rail_counts = 1024; accepted: a whole number of counts from 0 to 16384, at most a quarter",
        ),
        (
            "name = \"stm32f405\"",
            "name = \"../stm32\"",
            "b.toml: name = \"../stm32\"; accepted: a word of up to 32",
        ),
        (
            "name = \"stm32f405\"",
            "name = \"\"",
            "name = \"\"; accepted",
        ),
        (
            "lines = [4096, 4096]",
            "lines = [4096, 4096.5]",
            "encoders.lines[1] = 4096.5; accepted: two whole numbers of lines",
        ),
        (
            "lines = [4096, 4096]",
            "lines = [4096, 0]",
            "b.toml: encoders.lines[1] = 0; accepted: two whole numbers of lines from 1 to 1e6",
        ),
        (
            "bits = 12\n",
            "bits = 17\n",
            "converter.bits = 17; accepted",
        ),
    ] {
        let error = parse_board("b.toml", &changed(from, to)).unwrap_err();
        let error = error.to_string();
        assert!(error.contains(words), "{error}");
        assert!(!error.contains('\n'), "{error}");
    }
    // An amplifier that inverts is a board like any other.
    let inverting = changed("range_N = [-20.0, 20.0]", "range_N = [20.0, -20.0]");
    let board = parse_board("b.toml", &inverting).unwrap().parameters;
    assert_eq!(board.calibration().force_n, (-40.0 / 4096.0, 2048.0));
}

/// Boards of every wiring.
fn boards() -> impl Strategy<Value = BoardParameters> {
    (
        prop::array::uniform2(500..10_000_u32),
        prop::array::uniform2(0.5..100.0_f64),
        prop::array::uniform4(any::<bool>()),
        prop::array::uniform2(-3.0..3.0_f64),
        // Ends of the ranges, as magnitudes.
        prop::array::uniform2(1.0..100.0_f64),
        prop::array::uniform2(0.1..1.0_f64),
        8..=16_u32,
    )
        .prop_map(|(lines, gear, reversed, home, force, slope, bits)| {
            let range = |[low, high]: [f64; 2], inverted: bool| match inverted {
                false => [-low, high],
                true => [high, -low],
            };
            BoardParameters {
                encoder_lines: lines,
                encoder_gear_ratio: gear,
                encoder_reversed: [reversed[0], reversed[1]],
                home_rad: home,
                force_range_n: range(force, reversed[2]),
                gauge_range_rad: range(slope, reversed[3]),
                converter_bits: bits,
                rail_counts: 2,
                ..default_board()
            }
        })
}

proptest! {
    /// The simulator counts as the board does: what the bench's channels count comes back from the
    /// supervisor's sensing within half a count, whatever the board.
    #[test]
    fn what_is_counted_is_read_back(
        board in boards(),
        turned_counts in prop::array::uniform2(-32_000.0..32_000.0_f64),
        shares in prop::array::uniform2(0.05..0.95_f64),
    ) {
        let channels = Channels::from(&board);
        let rad_per_count = board.encoder_rad_per_count();
        let motor_angle = [0, 1].map(|i| board.home_rad[i] + turned_counts[i] * rad_per_count[i]);
        let within = |[low, high]: [f64; 2], share: f64| low + share * (high - low);
        let sensed = Sensed {
            motor_angle,
            force: within(board.force_range_n, shares[0]),
            strain: within(board.gauge_range_rad, shares[1]),
        };
        let home = Sensed { motor_angle: board.home_rad, ..sensed };
        let mut sensing = Sensing::new(
            &board.calibration(),
            board.tick_rate_hz,
            &home.counted(&channels, true),
        );
        let raw: RawSample = sensed.counted(&channels, true);
        sensing.update(&raw);
        let m = sensing.measurement();
        // Half a count, and what the tick's numbers round of a value in range.
        let rounding = 8.0 * f64::from(f32::EPSILON);
        let near = |read: f64, value: f64, step: f64, range: f64| {
            (read - value).abs() <= 0.5 * step.abs() + rounding * range
        };
        let width = |[low, high]: [f64; 2]| (high - low).abs();
        let (force, slope) = (board.force_scale(), board.slope_scale());
        prop_assert!(near(
            m.force.into(), sensed.force, force.per_count, width(board.force_range_n)
        ));
        prop_assert!(near(
            m.root_slope.into(), sensed.strain, slope.per_count, width(board.gauge_range_rad)
        ));
        // theta10, and theta20 = theta10 + motor 2 - w'(0).
        let motor2 = f64::from(m.angle[1]) - f64::from(m.angle[0]) + f64::from(m.root_slope);
        let angles = motor_angle[0].abs() + motor_angle[1].abs() + 6.0;
        prop_assert!(near(m.angle[0].into(), motor_angle[0], rad_per_count[0], angles));
        prop_assert!(near(motor2, motor_angle[1], rad_per_count[1], angles));
    }
}

#[test]
fn a_named_board_gives_the_rate_and_its_drives_must_give_the_torques() {
    let out = folder("board_file");
    let path = |name: &str| out.join(name).to_str().unwrap().to_string();
    let (file, results) = (path("board.toml"), path("results"));
    let run = |text: &str, more: &[&str]| {
        std::fs::write(&file, text).unwrap();
        let start = ["plan", "--json", "--out", &results, "--board", &file];
        flexor(&[&start, more].concat())
    };
    let summary = |output: &Output| -> Value {
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{message}");
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let slow = changed("tick_rate_Hz = 5000", "tick_rate_Hz = 2000");
    let json = summary(&run(&slow, &[]));
    assert_eq!(json["tick_rate_Hz"], 2000);
    assert_eq!(json["plan_ticks"], 2 * 2000);
    // The option goes before.
    let json = summary(&run(&slow, &["--tick-rate-hz", "1000"]));
    assert_eq!(json["tick_rate_Hz"], 1000);
    let default = flexor(&["plan", "--json", "--out", &results]);
    assert_eq!(summary(&default)["tick_rate_Hz"], 5000);

    // The paper's task takes 10.96 N m of joint 1.
    let weak = changed("full_scale_Nm = [40.0, 4.0]", "full_scale_Nm = [12.0, 4.0]");
    let refused = run(&weak, &[]);
    let message = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{message}");
    assert_eq!(message.lines().count(), 1, "{message}");
    for word in [
        "board.toml: drives.full_scale_Nm[0] = 12",
        "10.55 N m",
        "from 12.48 on",
        "joint 1 reaches 10.96 N m at t = 0.0",
    ] {
        assert!(message.contains(word), "no {word:?} in {message}");
    }
    let enough = changed(
        "full_scale_Nm = [40.0, 4.0]",
        "full_scale_Nm = [12.48, 4.0]",
    );
    assert!(run(&enough, &[]).status.success());
}

/// A named board's drives narrow the limits that a run is held within, and the default board's do
/// not: an arm need not be its own.
#[test]
fn a_run_keeps_within_a_named_boards_drives() {
    let out = folder("board_file_run");
    let path = |name: &str| out.join(name).to_str().unwrap().to_string();
    let file = path("board.toml");
    // Barely what is planned: it cannot hold a heavier arm on the path.
    let text = changed(
        "full_scale_Nm = [40.0, 4.0]",
        "full_scale_Nm = [12.48, 4.0]",
    );
    std::fs::write(&file, text).unwrap();
    let plant = path("plant.toml");
    std::fs::write(&plant, "link1_mass_scale = 1.2\n").unwrap();
    let ran = |more: &[&str]| -> Value {
        let results = path("results");
        let start = ["run", "--json", "--plant", &plant, "--out", &results];
        let output = flexor(&[&start, more].concat());
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{message}");
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let own = ran(&[]);
    assert_eq!(
        (&own["outcome"], &own["limited_ticks"]),
        (&"completed".into(), &0.into())
    );
    assert_eq!(ran(&["--board", &file])["outcome"], "path_deviation");
}

//! `flexor virtual-board` and `flexor board run`: whole runs enabled through the link, faults put into
//! them, every verb, and what becomes of the arm when its host goes.

#![cfg(unix)] // Pseudo-terminals and kill(1).

use flexor::fault::Fault;
use flexor::link::{FRAME_MAX, Mode, Program, Receiver, Refusal, Reply, Request, Status, encode};
use flexor::phase::Phase;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const NOMINAL: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/scenarios/nominal.toml"
);
const APPROACH: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/scenarios/approach.toml"
);

fn flexor(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_flexor"))
        .args(arguments)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The default board with a patient link: on a busy machine a host may be away for longer than 100 ms.
fn patient(folder: &Path) -> String {
    let board = include_str!("../boards/stm32f405.toml");
    let patient = board.replace("timeout_s = 0.1", "timeout_s = 2.0");
    assert_ne!(board, patient);
    let file = folder.join("patient.toml");
    std::fs::write(&file, patient).unwrap();
    file.display().to_string()
}

/// The program's own `virtual-board`, ended with the value.
struct Virtual {
    child: Child,
    port: String,
    /// Its board file.
    board_file: String,
    _folder: tempfile::TempDir,
}

impl Virtual {
    fn start(arguments: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let board_file = patient(folder.path());
        let mut child = Command::new(env!("CARGO_BIN_EXE_flexor"))
            .arg("virtual-board")
            .args(arguments)
            .args(["--board", &board_file])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut port = String::new();
        BufReader::new(child.stdout.take().unwrap())
            .read_line(&mut port)
            .unwrap();
        let port = port.trim().to_owned();
        Self {
            child,
            port,
            board_file,
            _folder: folder,
        }
    }

    fn on_tcp(arguments: &[&str]) -> Self {
        let started = Self::start(&[arguments, &["--listen", "127.0.0.1:0"]].concat());
        assert!(
            started.port.starts_with("tcp://127.0.0.1:"),
            "{}",
            started.port
        );
        started
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_flexor"));
        command
            .arg("board")
            .args(arguments)
            .args(["--port", &self.port, "--timeout-s", "20"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    fn board(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    fn json(&self, arguments: &[&str]) -> Value {
        let output = self.board(&[arguments, &["--json"]].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// A host of the test's own.
    fn host(&self) -> Host {
        let address = self.port.strip_prefix("tcp://").unwrap();
        let stream = TcpStream::connect(address).unwrap();
        stream.set_nodelay(true).unwrap();
        stream
            .set_read_timeout(Some(Duration::from_secs(20)))
            .unwrap();
        Host {
            stream,
            receiver: Receiver::new(),
            telemetry: Vec::new(),
        }
    }

    /// Waits until the board says so, through a host that only looks.
    fn until(&self, what: &str, is_so: impl Fn(&Status) -> bool) -> Status {
        let mut host = self.host();
        let begun = Instant::now();
        loop {
            let status = host.status();
            if is_so(&status) {
                return status;
            }
            assert!(
                begun.elapsed() < Duration::from_secs(60),
                "{what}: {status:?}"
            );
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Virtual {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Requests and replies on a connection of one's own.
struct Host {
    stream: TcpStream,
    receiver: Receiver,
    telemetry: Vec<u32>,
}

impl Host {
    fn ask(&mut self, request: &Request) -> Reply {
        let mut buffer = [0; FRAME_MAX];
        let frame = encode(request, &mut buffer).unwrap();
        self.stream.write_all(frame).unwrap();
        loop {
            let mut byte = [0];
            self.stream.read_exact(&mut byte).unwrap();
            match self.receiver.push(byte[0]) {
                Some(Reply::Telemetry(sample)) => self.telemetry.push(sample.tick),
                Some(reply) => return reply,
                None => {}
            }
        }
    }

    fn status(&mut self) -> Status {
        match self.ask(&Request::Status) {
            Reply::Status(status) => status,
            other => panic!("{other:?}"),
        }
    }

    fn program(&mut self) -> Program {
        match self.ask(&Request::Hello) {
            Reply::Identity(identity) => Program::of(&identity, flexor::table::Slot::A).unwrap(),
            other => panic!("{other:?}"),
        }
    }

    /// Homes and enables as `session`.
    fn enable(&mut self, session: u32) {
        assert_eq!(self.ask(&Request::Home), Reply::Done);
        let program = self.program();
        let enable = Request::Enable {
            slot: None,
            program,
            session,
        };
        let reply = self.ask(&enable);
        assert!(matches!(reply, Reply::Enabled { .. }), "{reply:?}");
    }
}

/// The columns of a CSV file.
fn columns(file: &Path) -> Vec<(String, Vec<String>)> {
    let mut reader = csv::Reader::from_path(file).unwrap();
    let names: Vec<String> = reader.headers().unwrap().iter().map(String::from).collect();
    let mut columns: Vec<_> = names.into_iter().map(|name| (name, Vec::new())).collect();
    for record in reader.records() {
        for (column, value) in columns.iter_mut().zip(record.unwrap().iter()) {
            column.1.push(value.to_owned());
        }
    }
    columns
}

/// Columns that a board knows of itself; the others are measured on it.
const OWN: [&str; 18] = [
    "t_s",
    "f_normal_ref_N",
    "x1_ref_m",
    "x2_ref_m",
    "tau1_Nm",
    "tau2_Nm",
    "limited1",
    "limited2",
    "force_integral_N",
    "encoder1_count",
    "encoder2_count",
    "force_count",
    "strain_count",
    "fault",
    "phase",
    "theta10_rad",
    "f_normal_N",
    "root_moment_Nm",
];

#[test]
fn a_run_within_the_process_is_the_benchs_tick_by_tick() {
    for (scenario, of_bench) in [(NOMINAL, 13_001), (APPROACH, 40_000)] {
        let folder = tempfile::tempdir().unwrap();
        let out = |name: &str| folder.path().join(name).display().to_string();
        let (bench, board) = (out("bench"), out("board"));
        let ran = flexor(&["run", "--scenario", scenario, "--out", &bench]);
        assert!(ran.status.success(), "{}", text(&ran.stderr));
        let arguments = ["board", "run", "--virtual", "--scenario", scenario];
        let ran = flexor(&[&arguments[..], &["--out", &board, "--json"]].concat());
        assert_eq!(ran.status.code(), Some(0), "{}", text(&ran.stderr));
        assert_eq!(text(&ran.stderr), "");
        let printed: Value = serde_json::from_slice(&ran.stdout).unwrap();
        assert_eq!(printed["outcome"], "completed");
        assert_eq!(printed["ended"], "completed");
        assert_eq!(printed["telemetry_missing"], 0);

        let files = ["plan.csv", "table.bin", "report.html", "summary.json"];
        for file in files {
            assert!(Path::new(&board).join(file).exists(), "{file}");
        }
        let table = |folder: &str| std::fs::read(Path::new(folder).join("table.bin")).unwrap();
        assert_eq!(table(&bench), table(&board));
        let csv = |folder: &str| columns(&Path::new(folder).join("run.csv"));
        let (bench, board) = (csv(&bench), csv(&board));
        let (name, same) = (
            |column: &(String, Vec<String>)| column.0.clone(),
            bench[0].1.len(),
        );
        assert!(bench.iter().map(name).eq(board.iter().map(name)));
        assert!(same >= of_bench && board[0].1.len() >= same, "{same}");
        for ((name, bench), (_, board)) in bench.iter().zip(&board) {
            // Counts, commands and references are the same bits; the first 15 of the names.
            if OWN[..15].contains(&name.as_str()) {
                assert!(bench[..] == board[..same], "{name} of {scenario}");
            }
            // What is measured is near.
            let far = match name.as_str() {
                "theta10_rad" => 5e-4,
                "f_normal_N" => 0.15,
                "root_moment_Nm" => 0.01,
                _ => continue,
            };
            for (is, told) in bench.iter().zip(board) {
                let off = is.parse::<f64>().unwrap() - told.parse::<f64>().unwrap();
                assert!(off.abs() < far, "{name}: {off}");
            }
        }
    }
}

/// A run within the process with a fault: exit code, what the summary says, standard error.
fn faulted(scenario: &str, fault: &str) -> (Option<i32>, Value, String) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().display().to_string();
    let arguments = ["board", "run", "--virtual", "--scenario", scenario];
    let rest = ["--fault", fault, "--out", &out];
    let ran = flexor(&[&arguments[..], &rest].concat());
    let summary = std::fs::read(folder.path().join("summary.json")).unwrap_or_default();
    let summary = serde_json::from_slice(&summary).unwrap_or(Value::Null);
    (ran.status.code(), summary, text(&ran.stderr))
}

#[test]
fn each_class_of_fault_has_its_declared_reaction() {
    for (fault, named) in [
        ("emergency_stop@1", Fault::EmergencyStop),
        ("drive_fault@1", Fault::Drive),
        ("tick_overrun@1", Fault::TickOverrun),
        ("ticks_lost@1", Fault::TicksLost),
        ("encoder2_jump=4096@1", Fault::EncoderStep),
        ("conversion_missing@1", Fault::SensorsStale),
        ("force_rail@1", Fault::SensorRange),
        ("encoder1_stuck@2", Fault::EncoderFrozen),
        ("link_lost@1", Fault::LinkTimeout),
    ] {
        let (code, summary, words) = faulted(NOMINAL, fault);
        // Without a link there is nobody to be told; the board has disabled or stands.
        if fault.starts_with("link_lost") {
            assert_eq!(code, Some(1), "{words}");
            assert!(words.contains("no answer"), "{words}");
            continue;
        }
        assert_eq!(code, Some(1), "{fault}: {words}");
        let number = format!("fault {} ({})", named.number(), named.name());
        assert!(words.contains(&number), "{fault}: {words}");
        assert_eq!(summary["outcome"], named.name(), "{fault}");
        assert_eq!(summary["ended"], "fault");
    }
    // What passes is let pass, and the operator's wish is no fault.
    let (code, _, words) = faulted(NOMINAL, "conversion_missing@1..1.0001");
    assert_eq!(code, Some(0), "{words}");
    let (code, summary, words) = faulted(NOMINAL, "retract@1");
    assert_eq!(code, Some(1), "{words}");
    assert_eq!(summary["ended"], "retracted");
}

#[test]
fn every_verb_works_on_a_terminal_and_over_tcp() {
    for board in [
        Virtual::start(&["--scenario", NOMINAL]),
        Virtual::on_tcp(&["--scenario", NOMINAL]),
    ] {
        let identity = board.json(&["identity"]);
        assert_eq!(identity["clock"], "simulated");
        assert_eq!(identity["slot_a"]["ticks"], 13_000);
        assert!(identity["slot_b"]["error"].is_string());
        // Nothing that it cannot do is missed: no log, no cycles.
        assert_eq!(text(&board.board(&["identity"]).stderr), "");
        let refused = board.board(&["enable"]);
        assert_eq!(refused.status.code(), Some(1));
        assert!(text(&refused.stderr).contains("home"));
        let checked = board.board(&["check"]);
        assert_eq!(checked.status.code(), Some(1));
        assert!(text(&checked.stdout).contains("put the arm in its home pose"));
        assert_eq!(board.json(&["home"])["mode"], "disabled");
        assert_eq!(board.json(&["check"])["may_enable"], true);
        let sensors = board.json(&["sensors"]);
        assert_eq!(sensors["homed"], true);
        assert!((sensors["theta10_rad"].as_f64().unwrap() - 0.964).abs() < 0.01);
        for verb in ["pause", "resume", "retract"] {
            let refused = board.board(&[verb]);
            assert!(text(&refused.stderr).contains("not enabled"), "{verb}");
        }
        let slot_b = board.board(&["enable", "--slot", "b"]);
        assert!(text(&slot_b.stderr).contains("holds no table"));
        assert_eq!(board.json(&["disable"])["mode"], "disabled");
        assert!(board.json(&["acknowledge"])["fault"].is_null());
        let status = board.json(&["status"]);
        assert!(status["ticks_total"].as_u64() > Some(100), "{status}");
    }
}

#[test]
fn a_run_goes_its_whole_course_and_another_host_may_look_pause_and_end_it() {
    let board = Virtual::on_tcp(&["--scenario", APPROACH, "--speed", "2"]);
    board.json(&["home"]);
    let attending = board.command(&["enable"]).spawn().unwrap();
    for phase in [Phase::Approach, Phase::Contact, Phase::Follow] {
        board.until(phase.name(), |status| {
            status.run.is_some_and(|run| run.phase == phase)
        });
    }
    // The table stands still while it is paused.
    board.json(&["pause"]);
    std::thread::sleep(Duration::from_millis(400));
    let mut host = board.host();
    let [first, second] = [0, 1].map(|_| {
        std::thread::sleep(Duration::from_millis(100));
        host.status()
    });
    assert!(first.run.unwrap().paused && first.tick > 0);
    assert_eq!(first.tick, second.tick);
    board.json(&["resume"]);
    board.until("the table goes on", |status| status.tick > first.tick + 100);
    assert_eq!(board.json(&["retract"])["mode"], "enabled");
    board.until("retract", |status| {
        status.run.is_some_and(|run| run.phase == Phase::Retract)
    });
    let ended = attending.wait_with_output().unwrap();
    assert!(
        text(&ended.stderr).contains("not by this command"),
        "{}",
        text(&ended.stderr)
    );
    assert_eq!(board.host().status().mode, Mode::Disabled);
}

#[test]
fn an_arm_whose_host_goes_ends_in_its_declared_state() {
    // Killed, or its cable pulled out: the board lifts the tip off and stands, drives on, for a host
    // that comes back.
    let board = Virtual::on_tcp(&["--scenario", NOMINAL]);
    board.json(&["home"]);
    let mut attending = board.command(&["enable"]).spawn().unwrap();
    board.until("follow", |status| status.tick > 6000);
    attending.kill().unwrap();
    attending.wait().unwrap();
    let status = board.until("it stands", |status| {
        status.run.is_some_and(|run| run.phase == Phase::Hold)
    });
    assert_eq!(status.mode, Mode::Enabled);
    assert_eq!(status.fault, Some(Fault::LinkTimeout));
    board.json(&["disable"]);
    let again = board.board(&["check"]);
    assert!(
        !again.status.success(),
        "the arm is not at its start: {}",
        text(&again.stdout)
    );
    board.json(&["acknowledge"]);
    board.json(&["home"]);
    // Ctrl-C: it retracts and disables by itself.
    let attending = board.command(&["enable"]).spawn().unwrap();
    board.until("follow", |status| status.tick > 1000);
    let pid = attending.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &pid])
            .status()
            .unwrap()
            .success()
    );
    let ended = attending.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(1));
    assert!(text(&ended.stderr).contains("interrupted and disabled"));
    assert_eq!(board.host().status().mode, Mode::Disabled);
}

#[test]
fn a_board_that_is_unplugged_ends_the_command() {
    let board = Virtual::on_tcp(&["--scenario", NOMINAL]);
    board.json(&["home"]);
    let attending = board.command(&["enable"]).spawn().unwrap();
    board.until("follow", |status| status.tick > 500);
    drop(board);
    let ended = attending.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(1));
    let words = text(&ended.stderr);
    assert!(words.contains("100 ms after the last request"), "{words}");
}

#[test]
fn only_who_enabled_keeps_it_enabled_and_only_what_was_named_runs() {
    let board = Virtual::on_tcp(&["--scenario", NOMINAL]);
    let mut host = board.host();
    assert_eq!(host.ask(&Request::Home), Reply::Done);
    let program = host.program();
    for change in [
        |p: &mut Program| p.table_crc ^= 1,
        |p: &mut Program| p.task_fingerprint ^= 1,
        |p: &mut Program| p.setup_crc ^= 1,
    ] {
        let mut named = program;
        change(&mut named);
        let enable = Request::Enable {
            slot: None,
            program: named,
            session: 1,
        };
        let other = Refusal::OtherProgram {
            found: program,
            named,
        };
        assert_eq!(host.ask(&enable), Reply::Refused(other));
        let check = Request::Check {
            slot: None,
            program: Some(named),
        };
        assert_eq!(
            host.ask(&check),
            Reply::Obstacles([other].into_iter().collect())
        );
    }
    host.enable(7);
    let mut other = board.host();
    let foreign = other.ask(&Request::KeepAlive { session: 8 });
    assert_eq!(foreign, Reply::Refused(Refusal::OtherSession));
    // Somebody who looks all the time does not keep it going.
    let status = board.until("the time-out", |status| status.fault.is_some());
    assert_eq!(status.fault, Some(Fault::LinkTimeout));
}

#[test]
fn telemetry_of_all_signals_at_1_khz_has_no_gap_in_60_s_on_a_line_of_1_mbaud() {
    // Paused on the path, so that it lasts; ten times as fast, so that this does not.
    let board = Virtual::on_tcp(&["--scenario", NOMINAL, "--speed", "10"]);
    let mut host = board.host();
    host.enable(7);
    assert_eq!(host.ask(&Request::Stream { every_ticks: 5 }), Reply::Done);
    let keep = Request::KeepAlive { session: 7 };
    let mut paused = false;
    while host.telemetry.len() < 60_000 {
        let Reply::Status(status) = host.ask(&keep) else {
            panic!("not kept alive");
        };
        assert_eq!((status.mode, status.fault), (Mode::Enabled, None));
        if !paused && status.tick > 3000 {
            assert_eq!(host.ask(&Request::Pause), Reply::Done);
            paused = true;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    let steps = host.telemetry.windows(2).map(|pair| pair[1] - pair[0]);
    assert_eq!(steps.filter(|step| *step != 5).count(), 0);
    assert_eq!(host.ask(&Request::Stream { every_ticks: 0 }), Reply::Done);
    // Every tick is more than the line bears: gaps, and answers all the same.
    host.telemetry.clear();
    assert_eq!(host.ask(&Request::Stream { every_ticks: 1 }), Reply::Done);
    while host.telemetry.len() < 2000 {
        assert!(matches!(host.ask(&keep), Reply::Status(_)));
    }
    assert!(host.telemetry.windows(2).any(|pair| pair[1] - pair[0] > 1));
    assert_eq!(host.ask(&Request::Disable), Reply::Done);
}

#[test]
fn a_run_is_recorded_over_the_line() {
    let board = Virtual::on_tcp(&["--scenario", NOMINAL]);
    board.json(&["home"]);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().display().to_string();
    let arguments = ["run", "--scenario", NOMINAL, "--board", &board.board_file];
    let summary = board.json(&[&arguments[..], &["--out", &out]].concat());
    assert_eq!(summary["outcome"], "completed");
    assert_eq!(summary["telemetry_every_ticks"], 5);
    assert_eq!(summary["telemetry_gaps"], 0);
    let rows = columns(&folder.path().join("run.csv"));
    assert!(rows[0].1.len() > 2600, "{}", rows[0].1.len());
    // Other settings than the board's are not run.
    let paper = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../examples/controller_paper.toml"
    );
    board.json(&["home"]);
    let rest = ["--controller", paper, "--out", &out];
    let other = board.board(&[&arguments[..], &rest].concat());
    assert_eq!(other.status.code(), Some(1));
    assert!(
        text(&other.stderr).contains("it has settings 0x"),
        "{}",
        text(&other.stderr)
    );
}

#[test]
fn what_cannot_be_is_code_2() {
    for arguments in [
        &["virtual-board", "--fault", "fire@1"][..],
        &["virtual-board", "--speed", "0"],
        &["virtual-board", "--listen", "nowhere"],
        &["board", "status", "--port", "tcp://127.0.0.1:1"],
        &["board", "run", "--virtual", "--port", "tcp://127.0.0.1:1"],
        &["board", "run", "--fault", "retract@1"],
    ] {
        let output = flexor(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(!output.stderr.is_empty());
    }
}

//! `flexor board`, against a board that the test plays on a pseudo-terminal, and against the
//! image in QEMU. `cargo xtask test` builds the image; `FLEXOR_ELF` says where it is.

#![cfg(unix)] // Pseudo-terminals and kill(1).

use flexor::fault::Fault;
use flexor::link::RawSample;
use flexor::link::{
    ClockSource, FRAME_MAX, FrameErrors, Identity, Receiver, Reply, Request, StartReason, Status,
    VERSION, encode,
};
use flexor::link::{Interlocks, Mode, Program, Refusal, RunStatus, SensorReport};
use flexor::phase::Phase;
use flexor::signals::Measurement;
use flexor::table::{Slot, SlotError, TableIdentity};
use serde_json::Value;
use serialport::{SerialPort, TTYPort};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

mod fake_board;

use fake_board::{Board, Fake, IDENTITY, KEEP_ALIVE, enable, failed, interrupt, text};

#[test]
fn identity_status_and_sensors_are_told_in_words_and_json() {
    let board = Fake::good();
    let output = board.run(&["identity"]);
    let words = text(&output.stdout);
    assert!(output.status.success());
    for word in [
        "3.14.15, commit 1234abcd+",
        "168 MHz, crystal and PLL",
        "the watchdog was not fed",
        "table 0xfeed0001, 50 ticks, 0.010 s, task 0x0000000b",
        "wrong checksum",
    ] {
        assert!(words.contains(word), "no {word:?} in {words}");
    }
    // Without the image's symbols there is no log, and nothing else is missing.
    assert!(text(&output.stderr).starts_with("no log: /nowhere/firmware"));
    let identity = board.json(&["identity"]);
    assert_eq!(identity["firmware_version"], "3.14.15");
    assert_eq!(identity["slot_a"]["ticks"], 50);
    assert!(identity["slot_b"]["error"].is_string());

    let words = text(&board.run(&["status"]).stdout);
    for word in ["disabled", "168 cycles", "2500 bytes", "3 with a wrong CRC"] {
        assert!(words.contains(word), "no {word:?} in {words}");
    }
    let status = board.json(&["status"]);
    assert_eq!(status["mode"], "disabled");
    assert!(status["fault"].is_null());
    assert_eq!(status["tick_max_cycles"], 168);

    let words = text(&board.run(&["sensors"]).stdout);
    for word in [
        "65535 counts",
        "1.5000 rad",
        "2.000 N",
        "released",
        "a fault, or a wire is broken",
    ] {
        assert!(words.contains(word), "no {word:?} in {words}");
    }
    let sensors = board.json(&["sensors"]);
    assert_eq!(sensors["theta20_rad"], -0.25);
    assert_eq!(sensors["estop_released"], true);
    assert_eq!(sensors["drives_ok"], false);
}

#[test]
fn the_sensors_are_followed_in_lines_until_the_signal() {
    let board = Fake::good();
    for (json, head) in [(false, 2), (true, 0)] {
        let options = ["sensors", "--follow", "--json"];
        let mut child = board.start(&options[..if json { 3 } else { 2 }]);
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let lines: Vec<String> = lines.by_ref().take(head + 3).map(Result::unwrap).collect();
        interrupt(&child);
        assert_eq!(child.wait().unwrap().code(), Some(0));
        for line in &lines[head..] {
            if json {
                let record: Value = serde_json::from_str(line).unwrap();
                assert_eq!(record["force_N"], 2.0);
            } else {
                assert!(line.starts_with("65535    12  2253 2048"), "{line}");
                assert!(line.ends_with("free FAULTY yes"), "{line}");
            }
        }
    }
}

#[test]
fn an_enabled_table_is_attended_to_its_end_and_disabled() {
    for (arguments, slot) in [
        (&["enable"][..], None),
        (&["enable", "--slot", "a"], Some(Slot::A)),
        (&["enable", "--slot", "b"], Some(Slot::B)),
    ] {
        let board = Fake::good();
        let output = board.run(arguments);
        let words = text(&output.stdout);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let named = format!(
            "enabled, slot {:?}: table 0xfeed0001",
            slot.unwrap_or(Slot::A)
        );
        assert!(words.starts_with(&named), "{words}");
        assert!(words.ends_with("completed, disabled\n"), "{words}");
        // In a pipe there is no progress bar.
        assert_eq!(text(&output.stderr).lines().count(), 1);
        let mut expected = vec![enable(slot)];
        expected.extend([KEEP_ALIVE; 5]);
        expected.push(Request::Disable);
        assert_eq!(board.asked(), expected);
    }
    let end = Fake::good().json(&["enable"]);
    assert_eq!(
        (&end["outcome"], &end["slot"]),
        (&"completed".into(), &"A".into())
    );
    assert_eq!((&end["tick"], &end["ticks"]), (&50.into(), &50.into()));
    assert_eq!(end["table_task"], "0x0000000b");
}

#[test]
fn a_fault_on_the_way_is_named_and_a_failure() {
    let fault = || {
        let mut board = Board::NEW;
        Fake::new(move |request| {
            if board.tick == 20 {
                board.mode = Mode::Disabled;
                board.fault = Some(Fault::SensorsStale);
                board.tick = 0;
            }
            Some(board.answer(request))
        })
    };
    let board = fault();
    let words = [
        "fault 18 (sensors_stale) after tick 20 of 50",
        "board acknowledge",
    ];
    failed(&board.run(&["enable"]), &words);
    assert_eq!(board.asked().last(), Some(&Request::Disable));
    let output = fault().run(&["enable", "--json"]);
    failed(&output, &words);
    let end: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(end["outcome"], "fault");
    assert_eq!(end["fault"], "sensors_stale");
    assert_eq!(end["fault_number"], 18);
}

#[test]
fn a_refusal_is_told_and_nothing_is_to_be_disabled() {
    let mut board = Board::NEW;
    let refusal = Refusal::AwayFromStart {
        deviation_rad: [0.5, -0.25, 0.0],
    };
    let board = Fake::new(move |request| match request {
        Request::Enable { .. } => Some(Reply::Refused(refusal)),
        other => Some(board.answer(other)),
    });
    let output = board.run(&["enable"]);
    failed(&output, &["refused", "[0.5, -0.25, 0.0] rad", "first row"]);
    assert!(output.stdout.is_empty());
    assert_eq!(board.asked(), [enable(None), Request::Status]);
}

#[test]
fn a_signal_disables() {
    let mut board = Board {
        pace: 0,
        ..Board::NEW
    };
    let board = Fake::new(move |request| Some(board.answer(request)));
    let mut child = board.start(&["enable"]);
    board.until_asked(10, &mut child);
    interrupt(&child);
    failed(
        &child.wait_with_output().unwrap(),
        &["interrupted and disabled after tick 0 of 50"],
    );
    assert_eq!(board.asked().last(), Some(&Request::Disable));
}

#[test]
fn an_arm_that_can_is_brought_to_stand_before_it_is_disabled() {
    // At the table's end.
    let mut board = Board::HYBRID;
    let board = Fake::new(move |request| Some(board.answer(request)));
    let output = board.run(&["enable"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stdout).ends_with("completed, disabled\n"));
    let asked = board.asked();
    let statuses = asked.iter().filter(|r| **r == KEEP_ALIVE).count();
    // Five to the end, and then two that find it standing.
    assert!(statuses >= 7, "{asked:?}");
    assert_eq!(asked.last(), Some(&Request::Disable));
    // For a fault with the drives on.
    let mut board = Board {
        fault: Some(Fault::NoContact),
        tick: 20,
        phase: Some(Phase::Retract),
        ..Board::NEW
    };
    let board = Fake::new(move |request| Some(board.answer(request)));
    failed(
        &board.run(&["enable"]),
        &["(no_contact) after tick 20 of 50"],
    );
    let asked = board.asked();
    let statuses = asked.iter().filter(|r| **r == KEEP_ALIVE).count();
    assert_eq!((statuses, asked.last()), (2, Some(&Request::Disable)));
    // By another's request.
    let mut board = Board {
        tick: 20,
        phase: Some(Phase::Retract),
        ..Board::NEW
    };
    let board = Fake::new(move |request| Some(board.answer(request)));
    let words = ["ended after tick 20 of 50", "not by this command"];
    failed(&board.run(&["enable"]), &words);
}

#[test]
fn a_signal_retracts_where_the_law_can_and_a_second_one_disables_at_once() {
    for twice in [false, true] {
        let mut board = Board {
            pace: 0,
            ..Board::HYBRID
        };
        let board = Fake::new(move |request| {
            let reply = board.answer(request);
            if twice && board.phase == Some(Phase::Hold) {
                // It never comes to stand.
                board.phase = Some(Phase::Retract);
            }
            Some(reply)
        });
        let mut child = board.start(&["enable"]);
        board.until_asked(10, &mut child);
        interrupt(&child);
        if twice {
            while !board.asked().contains(&Request::Retract) {
                std::thread::sleep(Duration::from_millis(5));
            }
            interrupt(&child);
        }
        let output = child.wait_with_output().unwrap();
        failed(&output, &["interrupted and disabled after tick 0 of 50"]);
        let asked = board.asked();
        let retracts = asked.iter().filter(|r| **r == Request::Retract).count();
        assert_eq!((retracts, asked.last()), (1, Some(&Request::Disable)));
    }
}

#[test]
fn a_run_is_paused_resumed_and_ended_and_its_progress_told() {
    let mut board = Board {
        mode: Mode::Enabled,
        tick: 20,
        ..Board::HYBRID
    };
    let board = Fake::new(move |request| Some(board.answer(request)));
    let end = board.json(&["pause"]);
    assert_eq!(
        (&end["phase"], &end["paused"]),
        (&"follow".into(), &true.into())
    );
    let words = text(&board.run(&["status"]).stdout);
    assert!(words.contains("follow, paused, tick 30 of 50"), "{words}");
    let end = board.json(&["resume"]);
    assert_eq!((&end["paused"], &end["ticks"]), (&false.into(), &50.into()));
    let end = board.json(&["retract"]);
    assert_eq!(end["mode"], "enabled");
    assert!(board.asked().contains(&Request::Retract));
    let idle = Fake::good();
    for verb in ["pause", "resume", "retract"] {
        failed(&idle.run(&[verb]), &["refused", "not enabled"]);
    }
    let status = idle.json(&["status"]);
    assert!(status["phase"].is_null() && status["paused"].is_null());
}

#[test]
fn a_board_that_starts_again_or_is_disabled_by_another_ends_the_run() {
    let run = |instead: fn(&mut Board) -> Reply| {
        let mut board = Board::NEW;
        Fake::new(move |request| match request {
            Request::KeepAlive { .. } if board.tick == 20 => Some(instead(&mut board)),
            other => Some(board.answer(other)),
        })
    };
    let again = run(|_| Reply::Identity(IDENTITY));
    failed(
        &again.run(&["enable"]),
        &["started again", "the watchdog was not fed", "disabled"],
    );
    assert_eq!(again.asked().last(), Some(&Request::Disable));
    let other = run(|board| {
        board.mode = Mode::Disabled;
        board.answer(&Request::Status)
    });
    failed(
        &other.run(&["enable"]),
        &["somebody else disabled it after tick 20"],
    );
}

#[test]
fn a_board_that_falls_silent_is_disabled_if_it_still_hears() {
    // Enables, and answers nothing but what disables from then on.
    let mut board = Board::NEW;
    let deaf = Fake::new(move |request| match request {
        Request::KeepAlive { .. } if board.mode == Mode::Enabled => None,
        other => Some(board.answer(other)),
    });
    let output = deaf.start(&["enable", "--timeout-s", "0.3"]);
    let output = output.wait_with_output().unwrap();
    failed(
        &output,
        &["no answer at 1000000 baud within 0.3 s", "disabled"],
    );
    assert_eq!(deaf.asked().last(), Some(&Request::Disable));

    // Nor that.
    let mut board = Board::NEW;
    let dead = Fake::new(move |request| match board.mode {
        Mode::Enabled => None,
        _ => Some(board.answer(request)),
    });
    let output = dead.start(&["enable", "--timeout-s", "0.3"]);
    let output = output.wait_with_output().unwrap();
    failed(
        &output,
        &["did not confirm", "100 ms after the last request"],
    );
    assert_eq!(dead.asked().last(), Some(&Request::Disable));
}

#[test]
fn an_answer_to_enable_that_gets_lost_is_followed_by_disabling() {
    let mut board = Board::NEW;
    let board = Fake::new(move |request| {
        let reply = board.answer(request);
        (!matches!(request, Request::Enable { .. })).then_some(reply)
    });
    let output = board.start(&["enable", "--timeout-s", "0.3"]);
    failed(&output.wait_with_output().unwrap(), &["no answer"]);
    let asked = board.asked();
    assert_eq!(asked, [enable(None), Request::Disable]);
}

#[test]
fn silence_and_other_speech_are_told_apart() {
    let silent = Fake::new(|_| None);
    let output = silent.start(&["identity"]).wait_with_output().unwrap();
    failed(
        &output,
        &[
            &silent.port,
            "no answer at 1000000 baud within 1.0 s",
            "powered",
        ],
    );
    assert!(!text(&output.stderr).contains("came"));

    let noise = Fake::raw(|_| vec![9, 1, 0, 7]);
    let output = noise.start(&["status"]).wait_with_output().unwrap();
    failed(&output, &["no answer", "4 bytes came, 1 unreadable"]);

    // "Done" of the protocol's version before, by hand: COBS leaves bytes without zeros as they
    // are, behind their number and one.
    let mut old = vec![VERSION - 1, 2];
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    old.extend(crc.checksum(&old).to_le_bytes());
    assert!(!old.contains(&0));
    old.insert(0, old.len() as u8 + 1);
    old.push(0);
    let old = Fake::raw(move |_| old.clone());
    let output = old.start(&["status"]).wait_with_output().unwrap();
    let words = format!("another protocol version than {VERSION}");
    failed(&output, &["no answer", &words]);
}

#[test]
fn home_disable_and_acknowledge_say_how_it_then_is() {
    let mut board = Board {
        mode: Mode::Enabled,
        fault: Some(Fault::Drive),
        ..Board::NEW
    };
    let board = Fake::new(move |request| Some(board.answer(request)));
    failed(&board.run(&["home"]), &["refused", "disable"]);
    let state = board.json(&["disable"]);
    assert_eq!(
        (&state["mode"], &state["fault"]),
        (&"disabled".into(), &"drive_fault".into())
    );
    assert_eq!(state["fault_number"], 17);
    assert_eq!(board.json(&["home"])["mode"], "disabled");
    assert!(board.asked().contains(&Request::Home));
    let words = text(&board.run(&["acknowledge"]).stdout);
    assert!(
        words.contains("disabled") && words.contains("none"),
        "{words}"
    );
}

#[test]
fn a_wrong_command_line_is_code_2() {
    let run = |arguments: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_flexor"))
            .arg("board")
            .args(arguments)
            .output()
            .unwrap()
    };
    for arguments in [
        &[][..],
        &["fly"],
        &["enable", "--slot", "c"],
        &["status", "--timeout-s", "0"],
        &["identity", "--port", "/nowhere/tty"],
        &["identity", "--elf", "/nowhere/firmware"],
    ] {
        let output = run(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(!output.stderr.is_empty());
    }
    for verb in [
        "identity",
        "status",
        "sensors",
        "enable",
        "check",
        "run",
        "home",
        "pause",
        "resume",
        "retract",
        "disable",
        "acknowledge",
    ] {
        let output = run(&[verb, "--help"]);
        let words = text(&output.stdout);
        assert!(output.status.success() && words.contains("Example: flexor board"));
        assert!(words.contains("--port <PORT>"), "{words}");
    }
}

/// The image in QEMU: exit code, standard output, standard error.
fn emulated(arguments: &[&str]) -> (i32, String, String) {
    let elf =
        std::env::var_os("FLEXOR_ELF").expect("FLEXOR_ELF is not set: run `cargo xtask test`");
    let output = Command::new(env!("CARGO_BIN_EXE_flexor"))
        .arg("board")
        .args(arguments)
        .args([Path::new("--elf"), Path::new(&elf)])
        .output()
        .unwrap();
    let code = output.status.code().unwrap();
    (code, text(&output.stdout), text(&output.stderr))
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn the_image_in_qemu_answers_every_verb() {
    let (code, words, log) = emulated(&["identity"]);
    assert_eq!(code, 0, "{log}");
    let version = concat!(env!("CARGO_PKG_VERSION"), ", commit ");
    assert!(
        words.contains(version) && words.contains("10000 ticks"),
        "{words}"
    );
    assert!(words.contains("slot B        holds no table"), "{words}");
    assert!(log.contains("firmware: info start: Normal"), "{log}");
    for (arguments, key, value) in [
        (&["status", "--json"][..], "mode", Value::from("disabled")),
        (&["sensors", "--json"], "fresh", false.into()),
        (&["sensors", "--json"], "strain_counts", 0.into()),
        (&["sensors", "--json"], "estop_released", false.into()),
        (&["sensors", "--json"], "homed", false.into()),
        (&["home", "--json"], "mode", "disabled".into()),
        (&["disable", "--json"], "mode", "disabled".into()),
        (&["acknowledge", "--json"], "fault", Value::Null),
    ] {
        let (code, words, log) = emulated(arguments);
        assert_eq!(code, 0, "{log}");
        let found: Value = serde_json::from_str(&words).unwrap();
        assert_eq!(found[key], value, "{words}");
    }
    for (arguments, reason) in [
        (
            &["enable"][..],
            "the cause of fault 16 (emergency_stop) is there",
        ),
        (&["enable", "--slot", "a"], "fault 16 (emergency_stop)"),
        (&["enable", "--slot", "b"], "the slot holds no table"),
    ] {
        let (code, words, log) = emulated(arguments);
        assert_eq!((code, &*words), (1, ""));
        assert!(log.contains(reason), "{log}");
    }
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn pil_that_is_told_to_end_leaves_nothing_behind() {
    let elf =
        std::env::var_os("FLEXOR_ELF").expect("FLEXOR_ELF is not set: run `cargo xtask test`");
    for signal in ["-INT", "-TERM"] {
        let scratch = tempfile::tempdir().unwrap();
        let (temporary, out) = (scratch.path().join("tmp"), scratch.path().join("out"));
        std::fs::create_dir(&temporary).unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_flexor"))
            .args(["pil", "--random", "100000000", "--elf"])
            .arg(&elf)
            .arg("--out")
            .arg(&out)
            .env("TMPDIR", &temporary)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // Its log's first line comes when the firmware runs.
        let mut log = BufReader::new(child.stderr.take().unwrap());
        let mut line = String::new();
        log.read_line(&mut line).unwrap();
        assert!(line.starts_with("firmware: "), "{line}");
        let pid = child.id().to_string();
        let kill = Command::new("kill").args([signal, &pid]).status().unwrap();
        assert!(kill.success());
        log.read_to_string(&mut line).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(1), "{line}");
        assert!(line.contains("error: interrupted after"), "{line}");
        let left: Vec<_> = std::fs::read_dir(&temporary).unwrap().collect();
        assert!(left.is_empty(), "{left:?}");
        // A run that was broken off has no results.
        assert!(!out.join("run.csv").exists());
    }
}

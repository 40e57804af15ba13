//! A board that a test plays on a pseudo-terminal, and `flexor board` on the other end of it.

use super::*;

pub(super) const TABLE: TableIdentity = TableIdentity {
    crc: 0xfeed_0001,
    arm_fingerprint: 0xa,
    task_fingerprint: 0xb,
    ticks: 50,
};

pub(super) const IDENTITY: Identity = Identity {
    version: [3, 14, 15],
    git: [0x12, 0x34, 0xab, 0xcd],
    modified: true,
    arm_fingerprint: Some(0xa),
    setup_crc: Some(0xc),
    slots: [Ok(TABLE), Err(SlotError::Crc)],
    tick_rate_hz: 5000,
    core_hz: 168_000_000,
    stopwatch_hz: 84_000_000,
    ticks_hw_per_1000_nops: 500,
    clock: ClockSource::Crystal,
    start: StartReason::Watchdog,
};

/// What it runs.
pub(super) const PROGRAM: Program = Program {
    table_crc: TABLE.crc,
    task_fingerprint: TABLE.task_fingerprint,
    setup_crc: 0xc,
};

/// A board in memory.
pub(super) struct Board {
    pub(super) mode: Mode,
    pub(super) tick: u32,
    pub(super) fault: Option<Fault>,
    /// Ticks that pass from status to status.
    pub(super) pace: u32,
    /// Where the run is, with a law that has a motion: what follows at each status that comes.
    pub(super) phase: Option<Phase>,
    pub(super) paused: bool,
    /// Who has enabled it.
    pub(super) session: Option<u32>,
}

impl Board {
    pub(super) const NEW: Self = Self {
        mode: Mode::Disabled,
        tick: 0,
        fault: None,
        pace: 10,
        phase: None,
        paused: false,
        session: None,
    };

    /// With the hybrid law.
    pub(super) const HYBRID: Self = Self {
        phase: Some(Phase::Follow),
        ..Self::NEW
    };

    /// As the firmware answers.
    pub(super) fn answer(&mut self, request: &Request) -> Reply {
        if let Request::KeepAlive { session } = request {
            assert_eq!(
                Some(*session),
                self.session,
                "whoever enabled keeps it alive"
            );
        }
        match request {
            Request::Hello => Reply::Identity(IDENTITY),
            Request::Status | Request::KeepAlive { .. } => {
                let goes_on = !self.paused && matches!(self.phase, None | Some(Phase::Follow));
                if self.mode == Mode::Enabled && goes_on {
                    self.tick = (self.tick + self.pace).min(TABLE.ticks);
                }
                self.phase = self.phase.map(|phase| match phase {
                    Phase::Follow if self.tick == TABLE.ticks => Phase::Retract,
                    Phase::Retract => Phase::Hold,
                    other => other,
                });
                let phase = self.phase.unwrap_or(Phase::Follow);
                let run = RunStatus {
                    phase,
                    ticks: TABLE.ticks,
                    paused: self.paused,
                    motion: self.phase.is_some(),
                };
                Reply::Status(Status {
                    mode: self.mode,
                    tick: self.tick,
                    fault: self.fault,
                    run: (self.mode == Mode::Enabled).then_some(run),
                    ticks_total: 1234,
                    ticks_hw_max: 84,
                    stack_bytes: 2500,
                    frame_errors: FrameErrors {
                        crc: 3,
                        ..FrameErrors::default()
                    },
                    bytes_lost: 0,
                    logs_lost: 0,
                })
            }
            Request::Enable {
                slot,
                program,
                session,
            } => {
                assert!(*slot == Some(Slot::B) || *program == PROGRAM);
                self.session = Some(*session);
                self.mode = Mode::Enabled;
                Reply::Enabled {
                    slot: slot.unwrap_or(Slot::A),
                    table: TABLE,
                }
            }
            Request::Disable => {
                self.mode = Mode::Disabled;
                Reply::Done
            }
            Request::Acknowledge => {
                self.fault = None;
                Reply::Done
            }
            Request::Pause | Request::Resume | Request::Retract if self.mode != Mode::Enabled => {
                Reply::Refused(Refusal::NotEnabled)
            }
            Request::Pause | Request::Resume => {
                self.paused = *request == Request::Pause;
                Reply::Done
            }
            Request::Retract => {
                self.phase = Some(Phase::Retract);
                Reply::Done
            }
            Request::Home if self.mode == Mode::Disabled => Reply::Done,
            Request::Home => Reply::Refused(Refusal::Busy),
            Request::Sensors => Reply::Sensors(SensorReport {
                raw: RawSample {
                    encoder: [65_535, 12],
                    force: 2253,
                    strain: 2048,
                    fresh: true,
                },
                measured: Measurement {
                    angle: [1.5, -0.25],
                    root_slope: 0.0,
                    root_slope_rate: -1.5,
                    force: 2.0,
                    ..Measurement::default()
                },
                interlocks: Interlocks {
                    estop_released: true,
                    drives_ok: false,
                },
                in_range: true,
                homed: false,
            }),
            other => panic!("flexor board asks {other:?}"),
        }
    }
}

/// The requests of an anonymous session.
pub(super) const KEEP_ALIVE: Request = Request::KeepAlive { session: 0 };

/// To enable a slot in it.
pub(super) fn enable(slot: Option<Slot>) -> Request {
    // Slot B has nothing that is usable.
    let program = match slot {
        Some(Slot::B) => Program::default(),
        _ => PROGRAM,
    };
    Request::Enable {
        slot,
        program,
        session: 0,
    }
}

/// A board on a pseudo-terminal, played by a thread.
pub(super) struct Fake {
    pub(super) port: String,
    pub(super) asked: Arc<Mutex<Vec<Request>>>,
    pub(super) over: Arc<AtomicBool>,
    pub(super) thread: Option<JoinHandle<()>>,
    /// Keeps the terminal from hanging up between two commands.
    pub(super) _slave: TTYPort,
}

impl Fake {
    /// A board that answers with bytes.
    pub(super) fn raw(mut answer: impl FnMut(&Request) -> Vec<u8> + Send + 'static) -> Self {
        // Neither end is locked: the command opens the slave by its name.
        let (mut line, slave) = TTYPort::pair().unwrap();
        line.set_timeout(Duration::from_millis(20)).unwrap();
        let asked = Arc::new(Mutex::new(Vec::new()));
        let over = Arc::new(AtomicBool::new(false));
        let (log, end) = (Arc::clone(&asked), Arc::clone(&over));
        let thread = std::thread::spawn(move || {
            let mut receiver = Receiver::new();
            let mut bytes = [0; 64];
            while !end.load(Ordering::Relaxed) {
                let count = line.read(&mut bytes).unwrap_or(0);
                for byte in &bytes[..count] {
                    if let Some(request) = receiver.push(*byte) {
                        log.lock().unwrap().push(request);
                        line.write_all(&answer(&request)).unwrap();
                    }
                }
            }
        });
        Self {
            port: slave.name().unwrap(),
            asked,
            over,
            thread: Some(thread),
            _slave: slave,
        }
    }

    /// A board that answers with a message, or not at all.
    pub(super) fn new(mut answer: impl FnMut(&Request) -> Option<Reply> + Send + 'static) -> Self {
        Self::raw(move |request| answer(request).map_or(Vec::new(), |reply| frame(&reply)))
    }

    /// A board that does as asked.
    pub(super) fn good() -> Self {
        let mut board = Board::NEW;
        Self::new(move |request| Some(board.answer(request)))
    }

    pub(super) fn start(&self, arguments: &[&str]) -> Child {
        Command::new(env!("CARGO_BIN_EXE_flexor"))
            .arg("board")
            .args(arguments)
            .args(["--port", &self.port, "--elf", "/nowhere/firmware"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    }

    pub(super) fn run(&self, arguments: &[&str]) -> Output {
        // However busy the machine is, the thread answers within this.
        let patient = [arguments, &["--timeout-s", "60"]].concat();
        self.start(&patient).wait_with_output().unwrap()
    }

    pub(super) fn json(&self, arguments: &[&str]) -> Value {
        let output = self.run(&[arguments, &["--json"]].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// All requests so far, in order, without those that every command begins with; sessions are of no
    /// matter.
    pub(super) fn asked(&self) -> Vec<Request> {
        let anonymous = |request: &Request| match *request {
            Request::Enable { slot, program, .. } => Request::Enable {
                slot,
                program,
                session: 0,
            },
            Request::KeepAlive { .. } => KEEP_ALIVE,
            other => other,
        };
        self.asked.lock().unwrap()[2..]
            .iter()
            .map(anonymous)
            .collect()
    }

    /// Waits until so many requests have come from the command, which must not end before.
    pub(super) fn until_asked(&self, count: usize, child: &mut Child) {
        while self.asked.lock().unwrap().len() < count {
            assert!(child.try_wait().unwrap().is_none(), "it ended");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Fake {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        let joined = self.thread.take().unwrap().join();
        assert!(joined.is_ok() || std::thread::panicking());
    }
}

pub(super) fn frame(reply: &Reply) -> Vec<u8> {
    encode(reply, &mut [0; FRAME_MAX]).unwrap().to_vec()
}

pub(super) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Checks exit code and standard error, which must have all the words.
pub(super) fn failed(output: &Output, words: &[&str]) {
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(!message.contains("panicked"), "{message}");
    for word in words {
        assert!(message.contains(word), "no {word:?} in {message}");
    }
}

pub(super) fn interrupt(child: &Child) {
    let pid = child.id().to_string();
    let kill = Command::new("kill").args(["-INT", &pid]).status().unwrap();
    assert!(kill.success());
}

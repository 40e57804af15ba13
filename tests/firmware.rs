//! The image in QEMU: bad tables, refusals, panics and faults, abuse of the link.
//! `cargo xtask test` builds the image and runs these; `FLEXOR_ELF` says where it is.

use flexor::control::{LawParameters, LimitParameters, PaperParameters};
use flexor::fault::Fault;
use flexor::link::{
    ClockSource, FRAME_MAX, Mode, Program, RawSample, Refusal, Reply, Request, Setup, StartReason,
    encode,
};
use flexor::signals::Measurement;
use flexor::supervisor::{ControllerParameters, MonitorParameters, Sensing};
use flexor::table::{Slot, SlotError};
use flexor_sim::files::config::{DEFAULT_BOARD, parse_board};
use flexor_sim::target::pil::compare_any;
use flexor_sim::target::{Emulation, Logs, Target, TargetError};
use flexor_tests::{elf, folder};
use object::{Object, ObjectSection, ObjectSymbol};
use std::cell::RefCell;
use std::ops::ControlFlow;
use std::path::Path;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// The arm of the default image's table, and feedback that uses every term of the law.
fn parameters() -> ControllerParameters {
    ControllerParameters {
        arm: flexor_tests::paper_arm(),
        law: LawParameters::Paper(PaperParameters {
            force_derivative_s: 0.01,
            force_proportional: 0.5,
            force_integral_per_s: 4.0,
            slope_rate_nms_rad: 0.1,
            force_filter_hz: Some(50.0),
            slope_rate_filter_hz: Some(20.0),
            ..PaperParameters::FEEDFORWARD
        }),
        limits: LimitParameters {
            torque_nm: [40.0, 4.0],
            torque_rate_nm_s: [4000.0, 400.0],
        },
        monitors: MonitorParameters::NONE,
    }
}

/// The same as the link carries it.
fn setup() -> Setup {
    Setup::from(&parameters())
}

/// The image's bytes, and where in them slot A's table is.
fn image() -> (Vec<u8>, core::ops::Range<usize>) {
    let bytes = std::fs::read(elf()).unwrap();
    let file = object::File::parse(&*bytes).unwrap();
    let section = file.section_by_name(".table_a").unwrap();
    let (start, length) = section.file_range().unwrap();
    let range = start as usize..(start + length) as usize;
    (bytes, range)
}

/// The table that the image was built with.
fn table() -> Vec<u8> {
    let (bytes, range) = image();
    bytes[range].to_vec()
}

/// QEMU with a changed table in slot A, and perhaps one in slot B.
fn boot(change: impl FnOnce(&mut [u8]), slot_b: Option<&[u8]>) -> Target {
    let (mut bytes, range) = image();
    change(&mut bytes[range]);
    boot_image(&bytes, slot_b)
}

/// QEMU with any image.
fn boot_image(bytes: &[u8], slot_b: Option<&[u8]>) -> Target {
    let folder = folder();
    let target = boot_logged(bytes, slot_b, &folder, None);
    std::fs::remove_dir_all(folder).unwrap();
    target
}

/// QEMU with any image; the accesses to peripherals that it lacks go to `accesses` in the
/// folder.
fn boot_logged(bytes: &[u8], slot_b: Option<&[u8]>, folder: &Path, logs: Option<Logs>) -> Target {
    let path = folder.join("image.elf");
    std::fs::write(&path, bytes).unwrap();
    let emulation = Emulation {
        elf: &path,
        table_b: slot_b,
        accesses: Some(&folder.join("accesses")),
    };
    Target::emulated(&emulation, logs).unwrap()
}

/// Writes to a peripheral's register, out of QEMU's log.
fn writes(folder: &Path, register: &str) -> Vec<u32> {
    accesses(folder, &[register])
        .into_iter()
        .map(|(_, value)| value)
        .collect()
}

/// Writes to registers ("device: offset") in their order: which, and the value.
fn accesses(folder: &Path, registers: &[&str]) -> Vec<(String, u32)> {
    let text = std::fs::read_to_string(folder.join("accesses")).unwrap();
    text.lines()
        .filter_map(|line| {
            let (device, rest) = line.split_once(": unimplemented device write (size ")?;
            let (_, rest) = rest.split_once("offset ")?;
            let (offset, value) = rest.split_once(", value 0x")?;
            let name = format!("{device}: {offset}");
            let value = u32::from_str_radix(value.trim_end_matches(')'), 16).ok()?;
            registers.contains(&&*name).then_some((name, value))
        })
        .collect()
}

/// Sets and clears the enable lines, bits 6 and 7, and the brakes' that open them, 11 and 12;
/// setting is the low half.
const ENABLES: &str = "GPIOC: 0x018";
const ENABLES_OFF: u32 = 0x18c0_0000;
/// The torque commands; half the range is no torque.
const TORQUES: [&str; 2] = ["DAC: 0x008", "DAC: 0x014"];
const TORQUE_ZERO: u32 = 0x0800;

/// What switches the drives off: registers and values, in their order.
fn off() -> [(String, u32); 3] {
    [
        (ENABLES, ENABLES_OFF),
        (TORQUES[0], TORQUE_ZERO),
        (TORQUES[1], TORQUE_ZERO),
    ]
    .map(|(register, value)| (register.to_owned(), value))
}

/// The image with the function that every tick calls replaced by other code.
fn image_with_tick(code: impl FnOnce(u32, &object::File) -> Vec<u8>) -> (Vec<u8>, u32) {
    let (mut bytes, _) = image();
    let file = object::File::parse(&*bytes).unwrap();
    let (run, size) = symbol(&file, "10supervisor10supervisor3run");
    let code = code(run, &file);
    assert!(code.len() < size as usize);
    let text = file.section_by_name(".text").unwrap();
    let offset = text.file_range().unwrap().0 + (u64::from(run) - text.address());
    bytes[offset as usize..][..code.len()].copy_from_slice(&code);
    (bytes, run)
}

/// A function's address and size.
fn symbol(file: &object::File, part: &str) -> (u32, u64) {
    let found = file
        .symbols()
        .find(|s| s.name().is_ok_and(|n| n.contains(part)))
        .unwrap_or_else(|| panic!("the image has no function {part}"));
    // Bit 0 of a Thumb function's address is set.
    (found.address() as u32 & !1, found.size())
}

/// Boots an image, lets it tick once, and returns why it started again. The drives must
/// have been switched off first thing.
fn restart(bytes: &[u8]) -> StartReason {
    let folder = folder();
    let mut target = boot_logged(bytes, None, &folder, None);
    assert_eq!(target.identity().start, StartReason::Normal);
    target.start(Slot::A, &setup()).unwrap();
    let outputs = [ENABLES, TORQUES[0], TORQUES[1]];
    let before = accesses(&folder, &outputs).len();
    // Instead of the command comes the identity that every start sends.
    let tick = Request::Measured {
        sequence: 0,
        measured: Measurement::default(),
    };
    let Reply::Identity(identity) = ask(&mut target, tick) else {
        panic!("no restart");
    };
    assert_eq!(target.status().unwrap().mode, Mode::Disabled);
    let after = accesses(&folder, &outputs);
    // By the handler, and again at the next start.
    assert_eq!(after[before..][..6], [off(), off()].concat());
    std::fs::remove_dir_all(folder).unwrap();
    identity.start
}

fn untouched(_: &mut [u8]) {}

/// Gives a changed table a good checksum again.
fn seal(table: &mut [u8]) {
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    let mut digest = crc.digest();
    digest.update(&table[..44]);
    digest.update(&table[48..]);
    table[44..48].copy_from_slice(&digest.finalize().to_le_bytes());
}

/// A request to enable the drives with a slot's table, or without one any that is usable, as it is.
fn enable(target: &Target, slot: Option<Slot>) -> Request {
    let slots = slot.map_or(Slot::ALL.to_vec(), |slot| vec![slot]);
    let mut programs = slots
        .iter()
        .filter_map(|slot| Program::of(target.identity(), *slot));
    Request::Enable {
        slot,
        program: programs.next().unwrap_or_default(),
        session: 1,
    }
}

fn ask_to_enable(target: &mut Target, slot: Option<Slot>) -> Reply {
    let request = enable(target, slot);
    ask(target, request)
}

fn ask(target: &mut Target, request: Request) -> Reply {
    target.ask(&request, "reply").unwrap()
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn it_starts_disabled_with_its_table_and_says_so() {
    let mut target = boot(untouched, None);
    let identity = *target.identity();
    let version = identity.version.map(|number| number.to_string()).join(".");
    // Firmware and host are released together.
    assert_eq!(version, env!("CARGO_PKG_VERSION"));
    assert_eq!(identity.arm_fingerprint, Some(setup().arm.fingerprint()));
    assert_eq!(identity.slots[0].unwrap().ticks, 10_000);
    assert_eq!(identity.slots[1], Err(SlotError::Magic));
    assert_eq!(identity.start, StartReason::Normal);
    // QEMU has neither crystal nor PLL: both waits ended, and the timers know.
    assert_eq!(identity.clock, ClockSource::Internal);
    assert_eq!(
        (identity.core_hz, identity.stopwatch_hz),
        (16_000_000, 16_000_000)
    );
    let status = target.status().unwrap();
    assert_eq!((status.mode, status.fault), (Mode::Disabled, None));
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn without_released_stop_it_does_not_enable() {
    // QEMU's inputs read 0: the stop is pressed.
    let good = table();
    let mut target = boot(untouched, Some(&good));
    let stop = Reply::Refused(Refusal::Cause(Fault::EmergencyStop));
    for slot in [None, Some(Slot::A), Some(Slot::B)] {
        assert_eq!(ask_to_enable(&mut target, slot), stop);
        assert_eq!(target.status().unwrap().mode, Mode::Disabled);
    }
    // A slot that was asked for is never replaced by the other.
    let mut target = boot(untouched, None);
    let (a, b) = (Some(Slot::A), Some(Slot::B));
    let refused = Reply::Refused(Refusal::Table(SlotError::Magic));
    assert_eq!(ask_to_enable(&mut target, a), stop);
    assert_eq!(ask_to_enable(&mut target, b), refused);
    let mut target = boot(|table| table[0] ^= 1, Some(&good));
    assert_eq!(ask_to_enable(&mut target, a), refused);
    assert_eq!(ask_to_enable(&mut target, b), stop);
    assert_eq!(ask_to_enable(&mut target, None), stop);
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn sensors_are_told_in_every_mode() {
    // QEMU has no converters, no inputs that are on, and timers that do not know encoders but
    // count the time.
    let mut target = boot(untouched, None);
    let check = |target: &mut Target| {
        let report = target.sensors().unwrap();
        let RawSample { force, strain, .. } = report.raw;
        assert_eq!((force, strain, report.raw.fresh), (0, 0, false));
        assert!(!report.interlocks.estop_released && !report.interlocks.drives_ok);
        assert!(!report.in_range, "no counts are a converter's rail");
        report
    };
    assert!(!check(&mut target).homed);
    target.home().unwrap();
    assert!(check(&mut target).homed);
    target.start(Slot::A, &setup()).unwrap();
    // What the sensors say, and not what the host says in their place.
    let simulated = Measurement {
        force: 7.0,
        ..Measurement::default()
    };
    target.tick(0, &simulated).unwrap();
    let report = check(&mut target);
    // The timers may have turned unseen.
    assert!(!report.homed);
    assert!(matches!(
        target.home(),
        Err(TargetError::Refused(Refusal::Busy))
    ));
    let measured = report.measured;
    // No counts are the lowest force and slope: the image has the numbers of the board file.
    assert_eq!((measured.force, measured.root_slope), (-20.0, -0.5));
    let board = parse_board("board", DEFAULT_BOARD).unwrap().parameters;
    let calibration = board.calibration().for_arm(&flexor_tests::paper_arm());
    let host = Sensing::new(&calibration, board.tick_rate_hz, &report.raw).measurement();
    let analog = |m: &Measurement<f32>| [m.force, m.root_slope, m.root_moment].map(f32::to_bits);
    assert_eq!(analog(&measured), analog(&host));
    assert_eq!(target.identity().tick_rate_hz, board.tick_rate_hz);
    assert_eq!(measured.root_slope_rate, 0.0);
    assert_eq!(target.status().unwrap().mode, Mode::LockStep);
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn a_bad_table_is_named_and_the_other_slot_used() {
    type Change = fn(&mut [u8]);
    let cases: [(SlotError, Change); 8] = [
        (SlotError::Magic, |t| t[0] ^= 1),
        (SlotError::Magic, |t| t.fill(0xff)), // erased
        (SlotError::Version, |t| t[4] = 1),
        (SlotError::Crc, |t| t[t.len() - 1] ^= 1),
        (SlotError::Length, |t| {
            t[40..44].copy_from_slice(&200_000_u32.to_le_bytes());
        }),
        // Cut off: the rest is erased.
        (SlotError::Crc, |t| {
            let half = t.len() / 2;
            t[half..].fill(0xff);
        }),
        (SlotError::Fingerprint, |t| {
            t[8] ^= 1;
            seal(t);
        }),
        (SlotError::TickRate, |t| {
            t[12..16].copy_from_slice(&4000_u32.to_le_bytes());
            seal(t);
        }),
    ];
    let good = table();
    for (error, change) in cases {
        let mut alone = boot(change, None);
        assert_eq!(alone.identity().slots[0], Err(error));
        let refused = Reply::Refused(Refusal::NoTable(error, SlotError::Magic));
        assert_eq!(ask_to_enable(&mut alone, None), refused);
        assert!(matches!(
            alone.start(Slot::A, &setup()),
            Err(TargetError::Refused(Refusal::Table(found))) if found == error
        ));

        let mut with_b = boot(change, Some(&good));
        assert!(with_b.identity().slots[1].is_ok());
        // Past the table, to the next thing that is missing.
        let refused = Reply::Refused(Refusal::Cause(Fault::EmergencyStop));
        assert_eq!(ask_to_enable(&mut with_b, None), refused);
        with_b.start(Slot::B, &setup()).unwrap();
    }
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn any_measurement_gives_the_same_command_as_on_the_host() {
    let mut target = boot(untouched, None);
    let differing = compare_any(&mut target, &table(), &parameters(), 2000, 7, |_| {
        ControlFlow::Continue(())
    })
    .unwrap();
    assert_eq!(differing, 0);
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn lock_step_begins_and_ends_on_request() {
    let mut target = boot(untouched, None);
    let measured = Measurement::default();
    let tick = Request::Measured {
        sequence: 1,
        measured,
    };
    let refused = Reply::Refused(Refusal::NotInLockStep);
    assert_eq!(ask(&mut target, tick), refused);
    assert_eq!(ask(&mut target, Request::StopLockStep), refused);
    for end in [Request::StopLockStep, Request::Disable] {
        target.start(Slot::A, &setup()).unwrap();
        assert_eq!(
            ask_to_enable(&mut target, None),
            Reply::Refused(Refusal::Busy)
        );
        for sequence in 0..3 {
            let reply = target.tick(sequence, &measured).unwrap();
            assert_eq!(reply.tick, sequence);
        }
        assert_eq!(target.status().unwrap().mode, Mode::LockStep);
        assert_eq!(ask(&mut target, end), Reply::Done);
        let before = target.status().unwrap();
        assert_eq!(before.mode, Mode::Disabled);
        // The timer runs again. A hundred questions may be over within one of its periods:
        // the emulator's clock follows the host's while the processor sleeps.
        let deadline = Instant::now() + Duration::from_secs(60);
        while target.status().unwrap().ticks_total == before.ticks_total {
            assert!(Instant::now() < deadline, "the control timer stands still");
        }
    }
    let mut another_arm = setup();
    another_arm.arm.link2_mass_kg = 0.3;
    assert!(matches!(
        target.start(Slot::A, &another_arm),
        Err(TargetError::Refused(Refusal::Table(SlotError::Fingerprint)))
    ));
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn a_fault_switches_off_resets_and_is_reported() {
    // `udf #0`, an undefined instruction.
    let (bytes, run) = image_with_tick(|_, _| vec![0x00, 0xde]);
    const UNDEFINED_INSTRUCTION: u32 = 1 << 16;
    let reason = StartReason::HardFault {
        pc: run,
        status: UNDEFINED_INSTRUCTION,
    };
    assert_eq!(restart(&bytes), reason);
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn a_stack_overflow_switches_off_resets_and_is_reported() {
    // `push {r0-r7, lr}` and back to it, after `sub sp, #4 * skip`: wherever in the nine words
    // the stack ends, whether or not the exception's frame still fits above that.
    for skip in 0..9 {
        let (bytes, _) = image_with_tick(|_, _| vec![0x80 | skip, 0xb0, 0xff, 0xb5, 0xfd, 0xe7]);
        let reason = restart(&bytes);
        let StartReason::StackOverflow { status } = reason else {
            panic!("taken for {reason:?}, {skip} words on");
        };
        const BUS_FAULTS: u32 = 0xff00;
        assert_ne!(status & BUS_FAULTS, 0);
    }
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn a_panic_switches_off_resets_and_is_reported() {
    const FILE: &[u8] = b"patched.rs";
    const LINE: u32 = 4711;
    let (bytes, _) = image_with_tick(|run, file| {
        // A call of `core::panicking::panic(message, length, location)`. The linker's
        // optimiser drops arguments that nobody reads and moves the others down, so the
        // location goes into all four registers. ip gets the function.
        let panic = symbol(file, "9panicking5panic").0 | 1;
        let location = run + 44;
        let mut code = Vec::new();
        for (register, value) in [0, 1, 2, 3]
            .map(|r| (r, location))
            .into_iter()
            .chain([(12, panic)])
        {
            // movw, movt
            for (opcode, half) in [(0xf240, value & 0xffff), (0xf2c0, value >> 16)] {
                let first = opcode | (half >> 11 & 1) << 10 | half >> 12;
                let second = (half >> 8 & 7) << 12 | register << 8 | half & 0xff;
                code.extend((first as u16).to_le_bytes());
                code.extend((second as u16).to_le_bytes());
            }
        }
        code.extend([0x60, 0x47]); // bx ip
        code.extend([0x00, 0xbf]); // nop, so that the location is aligned
        // core::panic::Location: file name (pointer, length), line, column.
        for word in [location + 16, FILE.len() as u32, LINE, 1] {
            code.extend(word.to_le_bytes());
        }
        code.extend(FILE);
        code
    });
    let file = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(FILE);
    assert_eq!(restart(&bytes), StartReason::Panic { line: LINE, file });
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn drives_stay_off_from_the_first_instant_and_in_lock_step() {
    let folder = folder();
    let (bytes, _) = image();
    let mut target = boot_logged(&bytes, None, &folder, None);
    target.start(Slot::A, &setup()).unwrap();
    let mut given = 0.0_f32;
    for sequence in 0..20 {
        let reply = target.tick(sequence, &Measurement::default()).unwrap();
        given = given.max(reply.torque[0].abs());
    }
    assert!(given > 1.0, "torques were computed all the same");
    // Before the first write that makes the lines outputs (mode register, offset 0) and the
    // one that enables the converter (control register, offset 0).
    let first = [
        ENABLES,
        TORQUES[0],
        TORQUES[1],
        "GPIOC: 0x000",
        "DAC: 0x000",
    ];
    assert_eq!(accesses(&folder, &first)[..3], off());
    let enables = writes(&folder, ENABLES);
    const SETS: u32 = 0xffff;
    assert!(enables.len() > 20 && enables.iter().all(|v| v & SETS == 0));
    for register in TORQUES {
        let torques = writes(&folder, register);
        assert!(torques.len() > 20 && torques.iter().all(|v| *v == TORQUE_ZERO));
    }
    // The watchdog's key register, which QEMU counts to its neighbour: started, fed.
    let watchdog = writes(&folder, "I2S2ext: 0x000");
    let started = watchdog.iter().position(|v| *v == 0xcccc).unwrap();
    assert!(watchdog[started..].contains(&0xaaaa));
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn the_log_comes_decoded_over_the_link() {
    let lines = Rc::new(RefCell::new(Vec::new()));
    let told = Rc::clone(&lines);
    let logs = Logs::new(&elf(), move |line| told.borrow_mut().push(line.to_owned())).unwrap();
    let folder = folder();
    let (mut bytes, range) = image();
    bytes[range.start] ^= 1;
    let mut target = boot_logged(&bytes, None, &folder, Some(logs));
    ask_to_enable(&mut target, None);
    let has = |words: &str| lines.borrow().iter().any(|line| line.contains(words));
    // The log may lag behind the answers.
    let deadline = Instant::now() + Duration::from_secs(60);
    while !has("refused") {
        assert!(Instant::now() < deadline, "no log: {:?}", lines.borrow());
        assert_eq!(target.status().unwrap().logs_lost, 0);
    }
    assert!(has("info start: Normal, clock: Internal"));
    assert!(has("info slot A: no usable table, Magic"));
    assert!(has("warn refused: NoTable(Magic, Magic) (comms.rs:"));
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn abuse_of_the_link_is_counted_and_survived() {
    let mut target = boot(untouched, None);
    let mut frame = [0; FRAME_MAX];
    let hello = encode(&Request::Hello, &mut frame).unwrap().to_vec();
    let mut bytes = Vec::new();
    // Oversized.
    bytes.extend([1; 3 * FRAME_MAX]);
    bytes.push(0);
    // Truncated: the beginning of a frame, then its end.
    bytes.extend(&hello[..3]);
    bytes.push(0);
    // Not COBS.
    bytes.extend([200, 1, 0]);
    // Another version, with a good CRC; its low byte is the first after the stuffing code.
    let payload = [flexor::link::VERSION + 1, 1];
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&payload);
    let mut other = payload.to_vec();
    other.extend(crc.to_le_bytes());
    assert!(!other.contains(&0), "choose a payload without zeros");
    bytes.push(other.len() as u8 + 1);
    bytes.extend(other);
    bytes.push(0);
    target.write(&bytes, "nothing").unwrap();
    let errors = target.status().unwrap().frame_errors;
    assert_eq!((errors.oversized, errors.version), (1, 1));
    assert_eq!(errors.crc + errors.stuffing, 2);

    // Noise: any bytes, from a fixed generator.
    let mut x = 1_u32;
    let noise: Vec<u8> = (0..20_000)
        .map(|_| {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (x >> 24) as u8
        })
        .chain([0])
        .collect();
    target.write(&noise, "nothing").unwrap();
    let after = target.status().unwrap();
    let count =
        |e: flexor::link::FrameErrors| e.oversized + e.stuffing + e.version + e.crc + e.message;
    assert!(count(after.frame_errors) > count(errors) + 20);
    assert_eq!(after.mode, Mode::Disabled);

    // A flood: as many good frames at a time as the receive queue holds, 512 bytes. Of more
    // without a pause bytes are lost, and counted, when QEMU hands them over faster than it
    // lets the firmware's main loop run, as on a machine with much else to do.
    const FRAMES: usize = 50;
    let status = encode(&Request::Status, &mut frame).unwrap().repeat(FRAMES);
    assert!((400..512).contains(&status.len()));
    for _ in 0..20 {
        target.write(&status, "nothing").unwrap();
        for _ in 0..FRAMES {
            let Reply::Status(status) = target.reply("status").unwrap() else {
                panic!("another answer than to a status");
            };
            assert_eq!(status.bytes_lost, after.bytes_lost);
        }
    }

    // And it still works.
    target.start(Slot::A, &setup()).unwrap();
    target.tick(9, &Measurement::default()).unwrap();
}

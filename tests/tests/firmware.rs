//! The image in QEMU: bad tables, refusals, abuse of the link. `cargo xtask test` builds
//! the image and runs these; `FLEXOR_ELF` says where it is.

use host_sim::pil::{PilError, Processor, compare_any};
use object::{Object, ObjectSection, ObjectSymbol};
use shared::arm::{ArmParameters, Elbow};
use shared::guard::{Fault, LimitParameters};
use shared::law::{LawParameters, Measurement};
use shared::link::{FRAME_MAX, Mode, Reply, Request, Setup, Slot, SlotError, StartReason, encode};
use shared::safety::Refusal;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// The arm of the default image's table, and feedback that uses every term of the law.
const SETUP: Setup = Setup {
    arm: ArmParameters {
        link1_length_m: 0.5,
        link1_mass_kg: 8.0,
        link2_length_m: 0.55,
        link2_mass_kg: 0.24,
        bending_stiffness_nm2: 0.48,
        damping_ratio: 0.05,
        root_inertia_kgm2: 0.0,
        tip_mass_kg: 0.0,
        tip_inertia_kgm2: 0.0,
        gravity_m_s2: [0.0, 9.81],
        elbow: Elbow::Down,
    },
    law: LawParameters {
        force_derivative_s: 0.01,
        force_proportional: 0.5,
        force_integral_per_s: 4.0,
        slope_rate_nms_rad: 0.1,
        force_filter_hz: Some(50.0),
        slope_rate_filter_hz: Some(20.0),
        ..LawParameters::FEEDFORWARD
    },
    limits: LimitParameters {
        torque_nm: [40.0, 4.0],
        torque_rate_nm_s: [4000.0, 400.0],
    },
};

fn elf() -> PathBuf {
    std::env::var_os("FLEXOR_ELF")
        .expect("FLEXOR_ELF is not set: run `cargo xtask test`")
        .into()
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
fn boot(change: impl FnOnce(&mut [u8]), slot_b: Option<&[u8]>) -> Processor {
    let (mut bytes, range) = image();
    change(&mut bytes[range]);
    boot_image(&bytes, slot_b)
}

/// QEMU with any image.
fn boot_image(bytes: &[u8], slot_b: Option<&[u8]>) -> Processor {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let name = format!(
        "flexor-test-{}-{}.elf",
        std::process::id(),
        COUNT.fetch_add(1, Ordering::Relaxed)
    );
    let path = std::env::temp_dir().join(name);
    std::fs::write(&path, bytes).unwrap();
    let processor = Processor::emulated(&path, slot_b);
    std::fs::remove_file(&path).unwrap();
    processor.unwrap()
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

fn ask(processor: &mut Processor, request: Request) -> Reply {
    processor.ask(&request, "reply").unwrap()
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn it_starts_disarmed_with_its_table_and_says_so() {
    let mut processor = boot(untouched, None);
    let identity = *processor.identity();
    assert_eq!(identity.arm_fingerprint, Some(SETUP.arm.fingerprint()));
    assert_eq!(identity.slots[0].unwrap().ticks, 10_000);
    assert_eq!(identity.slots[1], Err(SlotError::Magic));
    assert_eq!(identity.start, StartReason::Normal);
    let status = processor.status().unwrap();
    assert_eq!((status.mode, status.fault), (Mode::Disarmed, None));
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn without_released_stop_it_does_not_arm() {
    // QEMU's inputs read 0: the stop is pressed.
    let mut processor = boot(untouched, None);
    let refused = Reply::Refused(Refusal::Cause(Fault::EmergencyStop));
    assert_eq!(ask(&mut processor, Request::Arm), refused);
    assert_eq!(processor.status().unwrap().mode, Mode::Disarmed);
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn a_bad_table_is_named_and_the_other_slot_used() {
    type Change = fn(&mut [u8]);
    let cases: [(SlotError, Change); 8] = [
        (SlotError::Magic, |t| t[0] ^= 1),
        (SlotError::Magic, |t| t.fill(0xff)), // erased
        (SlotError::Version, |t| t[4] = 2),
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
        assert_eq!(ask(&mut alone, Request::Arm), refused);
        assert!(matches!(
            alone.start(Slot::A, &SETUP),
            Err(PilError::Refused(Refusal::Table(found))) if found == error
        ));

        let mut with_b = boot(change, Some(&good));
        assert!(with_b.identity().slots[1].is_ok());
        // Past the table, to the next thing that is missing.
        let refused = Reply::Refused(Refusal::Cause(Fault::EmergencyStop));
        assert_eq!(ask(&mut with_b, Request::Arm), refused);
        with_b.start(Slot::B, &SETUP).unwrap();
    }
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn any_measurement_gives_the_same_command_as_on_the_host() {
    let mut processor = boot(untouched, None);
    let differing = compare_any(&mut processor, Slot::A, &table(), &SETUP, 2000, 7).unwrap();
    assert_eq!(differing, 0);
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn lock_step_begins_and_ends_on_request() {
    let mut processor = boot(untouched, None);
    let measured = Measurement::default();
    let tick = Request::Measured {
        sequence: 1,
        measured,
    };
    let refused = Reply::Refused(Refusal::NotInLockStep);
    assert_eq!(ask(&mut processor, tick), refused);
    assert_eq!(ask(&mut processor, Request::StopLockStep), refused);
    for end in [Request::StopLockStep, Request::Disarm] {
        processor.start(Slot::A, &SETUP).unwrap();
        assert_eq!(
            ask(&mut processor, Request::Arm),
            Reply::Refused(Refusal::Busy)
        );
        for sequence in 0..3 {
            let reply = processor.tick(sequence, &measured).unwrap();
            assert_eq!(reply.tick, sequence);
        }
        assert_eq!(processor.status().unwrap().mode, Mode::LockStep);
        assert_eq!(ask(&mut processor, end), Reply::Done);
        let before = processor.status().unwrap();
        assert_eq!(before.mode, Mode::Disarmed);
        // The timer runs again. A hundred questions may be over within one of its periods:
        // the emulator's clock follows the host's while the processor sleeps.
        let deadline = Instant::now() + Duration::from_secs(20);
        while processor.status().unwrap().ticks_total == before.ticks_total {
            assert!(Instant::now() < deadline, "the control timer stands still");
        }
    }
    let mut another_arm = SETUP;
    another_arm.arm.link2_mass_kg = 0.3;
    assert!(matches!(
        processor.start(Slot::A, &another_arm),
        Err(PilError::Refused(Refusal::Table(SlotError::Fingerprint)))
    ));
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn a_fault_resets_and_the_next_start_reports_it() {
    let (mut bytes, _) = image();
    let file = object::File::parse(&*bytes).unwrap();
    // The controller's tick in the image; bit 0 of a Thumb function's address is set.
    let run = file
        .symbols()
        .find(|s| s.name().is_ok_and(|n| n.contains("7control3run")))
        .unwrap();
    let address = run.address() & !1;
    let text = file.section_by_name(".text").unwrap();
    let offset = text.file_range().unwrap().0 + (address - text.address());
    // `udf #0`, an undefined instruction.
    bytes[offset as usize..][..2].copy_from_slice(&[0x00, 0xde]);
    let mut processor = boot_image(&bytes, None);
    assert_eq!(processor.identity().start, StartReason::Normal);
    processor.start(Slot::A, &SETUP).unwrap();
    let measured = Measurement::default();
    // Instead of the command comes the identity that every start sends.
    let tick = Request::Measured {
        sequence: 0,
        measured,
    };
    let Reply::Identity(identity) = ask(&mut processor, tick) else {
        panic!("no restart");
    };
    const UNDEFINED_INSTRUCTION: u32 = 1 << 16;
    let reason = StartReason::HardFault {
        pc: address as u32,
        status: UNDEFINED_INSTRUCTION,
    };
    assert_eq!(identity.start, reason);
    assert_eq!(processor.status().unwrap().mode, Mode::Disarmed);
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn abuse_of_the_link_is_counted_and_survived() {
    let mut processor = boot(untouched, None);
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
    let payload = [shared::link::VERSION + 1, 1];
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&payload);
    let mut other = payload.to_vec();
    other.extend(crc.to_le_bytes());
    assert!(!other.contains(&0), "choose a payload without zeros");
    bytes.push(other.len() as u8 + 1);
    bytes.extend(other);
    bytes.push(0);
    processor.write(&bytes, "nothing").unwrap();
    let errors = processor.status().unwrap().frame_errors;
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
    processor.write(&noise, "nothing").unwrap();
    let after = processor.status().unwrap();
    let count =
        |e: shared::link::FrameErrors| e.oversized + e.stuffing + e.version + e.crc + e.message;
    assert!(count(after.frame_errors) > count(errors) + 20);
    assert_eq!(after.mode, Mode::Disarmed);

    // And it still works.
    processor.start(Slot::A, &SETUP).unwrap();
    processor.tick(9, &Measurement::default()).unwrap();
}

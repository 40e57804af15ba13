//! `flexor pil` with the image in QEMU, and on a serial port. `cargo xtask test` builds the
//! image and runs these; `FLEXOR_ELF` says where it is.

use flexor_tests::{elf, folder};
use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

/// `flexor` with these arguments and results in `out`; the summary, if it succeeds.
fn flexor(arguments: &[&str], out: &Path) -> Result<serde_json::Value, u8> {
    let mut line: Vec<OsString> = vec!["flexor".into()];
    line.extend(arguments.iter().map(Into::into));
    line.extend(["--out".into(), out.into()]);
    match flexor_sim::cli::run(line) {
        0 => {
            let text = std::fs::read_to_string(out.join("summary.json")).unwrap();
            Ok(serde_json::from_str(&text).unwrap())
        }
        code => Err(code),
    }
}

/// The example task in a fifth of a second.
fn short_task(folder: &Path) -> String {
    let text =
        flexor_sim::files::config::DEFAULT_TASK.replacen("duration_s = 2.0", "duration_s = 0.2", 1);
    let file = folder.join("short.toml");
    std::fs::write(&file, text).unwrap();
    file.to_str().unwrap().to_owned()
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn pil_gives_what_run_gives_to_the_last_byte() {
    let folder = folder();
    let task = short_task(&folder);
    // Another arm too: the setup goes over the link.
    let arm = flexor_sim::files::config::DEFAULT_ARM.replacen("mass_kg = 0.24", "mass_kg = 0.2", 1);
    let arm_file = folder.join("arm.toml");
    std::fs::write(&arm_file, arm).unwrap();
    let arm_file = arm_file.to_str().unwrap();
    let elf = elf();
    let common = [
        "--task",
        &task,
        "--arm",
        arm_file,
        "--bending-stiffness-scale",
        "0.9",
    ];
    let run = flexor(
        &[&["run", "--ideal"], &common[..]].concat(),
        &folder.join("run"),
    )
    .unwrap();
    let pil = ["pil", "--elf", elf.to_str().unwrap(), "--random", "100"];
    let pil = flexor(&[&pil[..], &common].concat(), &folder.join("pil")).unwrap();
    for file in ["run.csv", "plan.csv", "table.bin"] {
        let [a, b] = ["run", "pil"].map(|f| std::fs::read(folder.join(f).join(file)).unwrap());
        assert!(a == b, "{file} differs");
    }
    assert!(folder.join("pil/report.html").exists());
    assert_eq!(pil["firmware_version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(pil["outcome"], run["outcome"]);
    assert_eq!(
        (&pil["ticks"], &pil["differing_commands"]),
        (&1001.into(), &0.into())
    );
    assert_eq!(
        (&pil["random_differing"], &pil["slot"]),
        (&0.into(), &"B".into())
    );
    let [median, most] =
        ["instructions_median", "instructions_max"].map(|key| pil[key].as_u64().unwrap());
    assert!(100 < median && median <= most);
    // How long it took is no result.
    assert!(pil.get("timing").is_none());
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn pil_runs_on_a_serial_port() {
    let folder = folder();
    let task = short_task(&folder);
    flexor(&["plan", "--task", &task], &folder.join("plan")).unwrap();
    // A pseudo-terminal stands for the port, QEMU for the board behind it.
    let loader = format!(
        "loader,file={},addr=0x08040000,force-raw=on",
        folder.join("plan/table.bin").display()
    );
    let elf = elf();
    let elf = elf.to_str().unwrap();
    let mut qemu = Command::new("qemu-system-arm")
        .args(["-M", "olimex-stm32-h405", "-nographic", "-monitor", "none"])
        .args(["-icount", "shift=0", "-serial", "pty", "-m", "1M"])
        .args(["-device", &loader, "-kernel", elf])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::inherit())
        .spawn()
        .unwrap();
    // "char device redirected to /dev/pts/3 (label serial0)"
    let mut line = String::new();
    BufReader::new(qemu.stdout.take().unwrap())
        .read_line(&mut line)
        .unwrap();
    let port = line.split(' ').find(|word| word.starts_with("/dev/"));
    let port = port.unwrap_or_else(|| panic!("QEMU says {line:?}"));
    let arguments = ["pil", "--elf", elf, "--port", port, "--task"];
    let right = flexor(&[&arguments[..], &[&task]].concat(), &folder.join("pil"));
    // A table that is in neither slot.
    let other = flexor(
        &[
            &arguments[..],
            &[&task, "--tick-rate-hz", "5000", "--model", "as-printed"],
        ]
        .concat(),
        &folder.join("other"),
    );
    qemu.kill().unwrap();
    qemu.wait().unwrap();
    let right = right.unwrap();
    assert_eq!(
        (&right["ticks"], &right["differing_commands"]),
        (&1001.into(), &0.into())
    );
    assert!(right["instructions_median"].is_null());
    assert!(right["cycles_median"].as_u64().unwrap() > 0);
    assert_eq!(other, Err(2));
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn pil_refuses_what_the_firmware_cannot_do() {
    let folder = folder();
    let elf = elf();
    let elf = elf.to_str().unwrap();
    let out = folder.join("out");
    assert_eq!(flexor(&["pil", "--elf", "/nowhere/firmware"], &out), Err(2));
    assert_eq!(
        flexor(&["pil", "--elf", elf, "--port", "/nowhere"], &out),
        Err(2)
    );
    // Another rate than the image's timer.
    let rate = ["pil", "--elf", elf, "--tick-rate-hz", "4000"];
    assert_eq!(flexor(&rate, &out), Err(2));
    std::fs::remove_dir_all(folder).unwrap();
}

//! Builds the one ELF that is flashed and that QEMU boots: image, setup and table.

use crate::inputs::{Demo, Files};
use crate::setup::{TARGET, Toolchain};
use crate::{announce, image, inputs, output, root, run};
use anyhow::{Context, Result, ensure};
use clap::{Args, ValueEnum};
use flexor::link::Setup;
use flexor::supervisor::BoardParameters;
use flexor::table::Table;
use flexor_sim::target::{SLOT_ADDRESSES, SLOT_BYTES};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// cargo's folder for everything built.
pub(crate) fn target_folder() -> PathBuf {
    env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from)
}

/// cargo with `verb` for the firmware's image around these files, told where table, setup and
/// board are.
fn cargo(verb: &str, files: &Files) -> Result<Command> {
    let toolchain = Toolchain::wanted()?;
    let out = target_folder().join("firmware");
    fs::create_dir_all(&out)?;
    announce("planning the image's table");
    let Demo {
        plan,
        table,
        setup,
        board,
    } = inputs::plan_files(files)?;
    announce(&format!(
        "the table is of task {:#010x}, {} bytes",
        plan.task_fingerprint(),
        table.image.len()
    ));
    let mut buffer = [0; 512];
    let setup = Setup::from(&setup);
    let setup = setup.encode(&mut buffer)?;
    let mut command = toolchain.command("cargo");
    command
        .current_dir(root().join("firmware"))
        .args([verb, "--release", "--target-dir"])
        .arg(&out)
        .env("FLEXOR_TABLE", write(&out.join("table.bin"), &table.image)?)
        .env("FLEXOR_SETUP", write(&out.join("setup.bin"), setup)?)
        .env(
            "FLEXOR_BOARD",
            write(
                &out.join("board.rs"),
                board_source(&board.parameters).as_bytes(),
            )?,
        )
        .env("FLEXOR_GIT", git());
    Ok(command)
}

/// The board as an expression of Rust, of the type [`BoardParameters`].
///
/// That is what its `Debug` prints: fields by name, and of a finite f64 the shortest literal that
/// is read as the same number. The parser lets none through that is not finite.
fn board_source(board: &BoardParameters) -> String {
    format!("{board:#?}\n")
}

/// Writes a file, but not when it is the same already: cargo goes by its time.
pub(crate) fn write<'p>(path: &'p Path, bytes: &[u8]) -> Result<&'p Path> {
    if fs::read(path).ok().as_deref() != Some(bytes) {
        fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(path)
}

/// The commit, eight hex digits, and `+` where the sources differ from it.
fn git() -> String {
    let git = |arguments: &[&str]| output(Command::new("git").current_dir(root()).args(arguments));
    let commit = git(&["rev-parse", "--short=8", "HEAD"]).unwrap_or_default();
    let clean = git(&["status", "--porcelain"]).is_some_and(|changes| changes.is_empty());
    let short = commit.get(..8).unwrap_or_default();
    format!("{short}{}", if clean { "" } else { "+" })
}

/// Builds the image around the examples; returns the ELF's path.
pub(crate) fn build() -> Result<PathBuf> {
    build_with(&Files::default())
}

/// Builds the image around these files; returns the ELF's path, which is always the same: the
/// image that was built last is the one that is there.
pub(crate) fn build_with(files: &Files) -> Result<PathBuf> {
    run(&mut cargo("build", files)?)?;
    Ok(elf())
}

/// The one ELF: `flash` writes it, `pil` boots it.
fn elf() -> PathBuf {
    let folder = target_folder().join("firmware").join(TARGET);
    folder.join("release/firmware")
}

/// Lints the image's sources.
pub(crate) fn clippy() -> Result<()> {
    run(cargo("clippy", &Files::default())?.args(["--", "-D", "warnings"]))
}

/// Options of the verb `flash`.
#[derive(Args)]
pub(crate) struct FlashOptions {
    #[command(flatten)]
    files: Files,
    /// Write this table image alone (a file `table.bin` of `flexor plan`), and not the firmware.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["arm", "task", "controller"])]
    table: Option<PathBuf>,
    /// Where to write that table; `flexor board enable --slot` runs it.
    #[arg(long, value_enum, default_value_t = SlotArg::B, requires = "table")]
    slot: SlotArg,
    /// Only say what would be written, and by which command.
    #[arg(long)]
    list: bool,
}

/// A table's place in flash.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum SlotArg {
    A,
    B,
}

/// Builds the image and writes it, table included, to a board: the file that `pil` boots.
pub(crate) fn flash(options: &FlashOptions) -> Result<()> {
    let probe_rs = |verb: &str| {
        let mut command = Command::new("probe-rs");
        command.args([verb, "--chip", "STM32F405RGTx"]);
        command
    };
    let mut probe = probe_rs("download");
    probe.arg("--verify");
    // The download leaves the core halted, and the tables are read at start.
    let mut reset = probe_rs("reset");
    let file = match &options.table {
        Some(table) => {
            let rate = options.files.board()?.parameters.tick_rate_hz;
            let task = check_table(table, rate)?;
            announce(&format!("the table is of task {task:#010x}"));
            let address = SLOT_ADDRESSES[options.slot as usize];
            probe.args(["--binary-format", "bin", "--base-address"]);
            probe.arg(format!("{address:#010x}"));
            table.clone()
        }
        None => build_with(&options.files)?,
    };
    probe.arg(&file);
    if options.list {
        let bytes = fs::read(&file)?;
        let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&bytes);
        println!(
            "{}: {} bytes, CRC-32 {crc:#010x}",
            file.display(),
            bytes.len()
        );
        if options.table.is_none() {
            for (address, length) in image::segments(&bytes)? {
                println!("  {length:6} bytes to {address:#010x}");
            }
        }
        println!("{probe:?}\n{reset:?}");
        return Ok(());
    }
    run(&mut probe).context("probe-rs comes with `cargo install --locked probe-rs-tools`")?;
    run(&mut reset)
}

/// Makes sure that a file is a table that the firmware would take from a slot, at the rate of its
/// timer (Hz), but for the arm: only the board knows that. The fingerprint of its task.
fn check_table(file: &Path, tick_rate_hz: u32) -> Result<u32> {
    let name = file.display();
    let bytes = fs::read(file).with_context(|| format!("cannot read {name}"))?;
    let table = Table::open(&bytes).with_context(|| format!("{name} is no table"))?;
    let rate = table.header().tick_rate_hz;
    ensure!(
        rate == tick_rate_hz,
        "{name}: {rate} ticks a second, the board's timer has {tick_rate_hz}: plan with --tick-rate-hz {tick_rate_hz}"
    );
    let length = bytes.len();
    ensure!(
        length <= SLOT_BYTES,
        "{name}: {length} bytes, a slot takes {SLOT_BYTES}: a shorter duration_s is accepted"
    );
    Ok(table.header().task_fingerprint)
}

#[cfg(test)]
mod tests {
    use super::*;
    use flexor_sim::target::DEFAULT_ELF;

    #[test]
    fn what_is_flashed_is_what_pil_boots_by_itself() {
        let place = DEFAULT_ELF.strip_prefix("target/").unwrap();
        assert!(elf().ends_with(place));
    }

    /// The firmware's compiler reads it as it stands; that it does, its build shows.
    #[test]
    fn every_number_of_a_boards_source_is_read_as_itself() {
        let mut board = Files::default().board().unwrap().parameters;
        board.home_rad = [0.1 + 0.2, -1e-300];
        board.drive_full_scale_nm = [1e22, core::f64::consts::PI];
        let source = board_source(&board);
        assert!(source.starts_with("BoardParameters {"), "{source}");
        let numbers: Vec<f64> = source
            .split(['[', ']', ',', ':', '\n'])
            .filter_map(|word| word.trim().parse().ok())
            .collect();
        for number in board.home_rad.into_iter().chain(board.drive_full_scale_nm) {
            let same = |read: &f64| read.to_bits() == number.to_bits();
            assert!(numbers.iter().any(same), "no {number:e} in {source}");
        }
    }

    #[test]
    fn the_slots_are_where_the_memory_map_has_them() {
        let map = fs::read_to_string(root().join("memory.x")).unwrap();
        for (name, address) in ["TABLE_A", "TABLE_B"].into_iter().zip(SLOT_ADDRESSES) {
            let length = SLOT_BYTES / 1024;
            let region = format!("{name} : ORIGIN = {address:#010x}, LENGTH = {length}K");
            assert!(map.contains(&region), "no {region}");
        }
    }

    #[test]
    fn only_a_table_for_the_firmwares_rate_is_flashed() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("table.bin");
        let demo = inputs::demo().unwrap();
        let mut image = demo.table.image;
        fs::write(&file, &image).unwrap();
        let task = demo.plan.task_fingerprint();
        assert_eq!(check_table(&file, 5000).unwrap(), task);
        assert!(check_table(&file, 2500).is_err());
        // Another rate, with a good checksum.
        image[12..16].copy_from_slice(&4000_u32.to_le_bytes());
        let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
        let mut digest = crc.digest();
        digest.update(&image[..44]);
        digest.update(&image[48..]);
        image[44..48].copy_from_slice(&digest.finalize().to_le_bytes());
        fs::write(&file, &image).unwrap();
        let words = check_table(&file, 5000).unwrap_err().to_string();
        assert!(words.contains("table.bin: 4000 ticks"), "{words}");
        fs::write(&file, [0xff; 100]).unwrap();
        let words = check_table(&file, 5000).unwrap_err().to_string();
        assert!(words.contains("table.bin is no table"), "{words}");
    }
}

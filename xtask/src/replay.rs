//! The demo's run, with each law, replayed on cores without floating point, Cortex-M0 and
//! Cortex-M3, in fixed point and in emulated f32: every output bit against the host, instructions per
//! tick, sizes, and that no float routine is in the fixed-point image. What that takes is
//! held against `firmware/replay/budget.toml`.

use crate::inputs::Demo;
use crate::limits::{self, Figures};
use crate::setup::Toolchain;
use crate::{announce, firmware, inputs, root, run};
use anyhow::{Context, Result, ensure};
use clap::Args;
use flexor::control::{Coefficients, Command, LawParameters};
use flexor::fault::Fault;
use flexor::number::fixed::Fixed;
use flexor::signals::{Formats, Measurement, Saturation};
use flexor_sim::analysis::fixed_point::accuracy::run_fixed;
use flexor_sim::analysis::fixed_point::range;
use flexor_sim::files::config;
use flexor_sim::simulation::closed_loop::{RunOptions, Simulation};
use object::{Object, ObjectSymbol};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};
use std::{fs, thread};

/// Options of the verb `replay`.
#[derive(Args, Default)]
pub(crate) struct Options {
    /// Write what was measured into the file, as the figures of the compiler in use.
    #[arg(long)]
    update: bool,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// A core to run on: short name, target, QEMU's machine.
const CORES: [(&str, &str, &str); 2] = [
    ("m0", "thumbv6m-none-eabi", "microbit"),
    ("m3", "thumbv7m-none-eabi", "mps2-an385"),
];

/// The images.
const IMAGES: [&str; 2] = ["fixed", "float"];

/// The laws, each of which an image replays, and what the figures of a tick with it begin with.
const LAWS: [(&str, &str); 2] = [("paper", ""), ("hybrid", "hybrid_")];

/// Longest run of one image. The slowest, f32 on the Cortex-M0, takes a quarter of it.
const PATIENCE: Duration = Duration::from_secs(600);

/// How many times more instructions emulated f32 takes at least.
const GAIN_MIN: u64 = 4;

/// What a replay that comes to its end has shown.
pub(crate) const EQUAL: &str =
    "every bit of every tick is the host's; no float routine in fixed point";

/// Replays, compares, holds against the limits.
pub(crate) fn run_verb(options: &Options) -> Result<()> {
    let compiler = Toolchain::wanted()?.version()?;
    let figures = measure()?;
    let file = root().join("firmware/replay/budget.toml");
    let mut verdict = limits::hold(&file, &figures, &compiler, options.update)?;
    if options.json {
        println!("{}", serde_json::to_string_pretty(&figures)?);
    } else {
        verdict.lines.iter().for_each(|line| println!("{line}"));
        println!("{EQUAL}");
    }
    verdict.excess.extend(too_slow(&figures));
    let excess = verdict.excess;
    ensure!(excess.is_empty(), "over budget: {}", excess.join("; "));
    Ok(())
}

/// Where fixed point is not as much faster than emulated f32 as it should be.
pub(crate) fn too_slow(figures: &Figures) -> Vec<String> {
    let median = |core: &str, image: &str, of: &str| {
        let name = format!("{core}_{image}_{of}instructions_median");
        figures.get(&name).copied()
    };
    let laws = LAWS.into_iter();
    let medians = laws.flat_map(|(law, of)| {
        CORES.map(|(core, ..)| {
            let fixed = median(core, "fixed", of).unwrap_or(u64::MAX);
            (core, law, fixed, median(core, "float", of).unwrap_or(0))
        })
    });
    medians
        .filter(|(_, _, fixed, float)| *float < GAIN_MIN.saturating_mul(*fixed))
        .map(|(core, law, fixed, float)| {
            format!(
                "{core}, {law}: f32 takes {float} instructions, fixed point {fixed}: less than {GAIN_MIN} times fewer"
            )
        })
        .collect()
}

/// Measurements and the commands they should give, as words.
struct Recording {
    measurements: Vec<u8>,
    commands: Vec<[u32; 3]>,
}

impl Recording {
    fn new() -> Self {
        Self {
            measurements: vec![],
            commands: vec![],
        }
    }

    fn add<T: Copy>(&mut self, bits: impl Fn(T) -> u32, m: &Measurement<T>, c: &Command<T>) {
        for value in [
            m.angle[0],
            m.angle[1],
            m.root_slope,
            m.root_slope_rate,
            m.force,
            m.motor[0],
            m.motor[1],
            m.root_moment,
        ] {
            self.measurements.extend(bits(value).to_le_bytes());
        }
        let side = |saturation| match saturation {
            Saturation::None => 0,
            Saturation::Upper => 1,
            Saturation::Lower => 2,
        };
        let fault = c.fault.map_or(0, Fault::number);
        let state = u32::from_le_bytes([side(c.saturation[0]), side(c.saturation[1]), fault, 0]);
        self.commands
            .push([bits(c.torque[0]), bits(c.torque[1]), state]);
    }
}

/// What the images are built from and what they replay.
struct Prepared {
    /// Variables that name the files.
    environment: Vec<(&'static str, PathBuf)>,
    /// The laws' runs, of each image.
    recordings: [[Recording; 2]; 2],
}

/// Runs the demo with both laws in both number types and writes table and coefficients into the
/// returned folder.
fn prepare(demo: &Demo) -> Result<(Prepared, PathBuf)> {
    const VARIABLES: [[&str; 2]; 2] = [
        ["FLEXOR_PAPER_FIXED", "FLEXOR_PAPER_FLOAT"],
        ["FLEXOR_HYBRID_FIXED", "FLEXOR_HYBRID_FLOAT"],
    ];
    let out = firmware::target_folder().join("replay");
    fs::create_dir_all(&out)?;
    let file = |name: &str, bytes: &[u8]| -> Result<PathBuf> {
        Ok(std::path::absolute(firmware::write(
            &out.join(name),
            bytes,
        )?)?)
    };
    let mut environment = vec![("FLEXOR_TABLE", file("table.bin", &demo.table.image)?)];
    let paper = config::parse_controller("controller_paper.toml", config::PAPER_CONTROLLER)?;
    let mut runs = vec![];
    for ((variables, law), (name, _)) in
        VARIABLES.into_iter().zip([paper, demo.setup.law]).zip(LAWS)
    {
        let (coefficients, recordings) = record(demo, &law)?;
        for ((variable, bytes), image) in variables.into_iter().zip(coefficients).zip(IMAGES) {
            environment.push((variable, file(&format!("{name}_{image}.bin"), &bytes)?));
        }
        runs.push(recordings);
    }
    let mut runs = runs.into_iter();
    let [[fixed1, float1], [fixed2, float2]] = [runs.next(), runs.next()]
        .map(|run| run.unwrap_or_else(|| [Recording::new(), Recording::new()]));
    let prepared = Prepared {
        environment,
        recordings: [[fixed1, fixed2], [float1, float2]],
    };
    Ok((prepared, out))
}

/// Runs the demo with `law` in both number types: coefficients as bytes, and the runs.
fn record(demo: &Demo, law: &LawParameters) -> Result<([Vec<u8>; 2], [Recording; 2])> {
    let Demo {
        plan, table, setup, ..
    } = demo;
    // The run begins in contact, at the table's first tick.
    let law = law.without_settling();
    let options = RunOptions {
        law,
        ..inputs::options(setup)
    };
    let image = &table.image;
    let analysis = range::analyse(plan, image, &law, &setup.limits)?;
    let single = Coefficients::<f32>::new(
        &setup.arm,
        &law,
        &setup.limits,
        plan.tick_rate_hz,
        &Formats::default(),
    );
    let mut fixed = Recording::new();
    run_fixed(plan, image, &options, |step| {
        fixed.add(
            |x: Fixed| x.to_bits().cast_unsigned(),
            &step.measured,
            &step.command,
        );
    })?;
    let mut float = Recording::new();
    Simulation::<f32>::new(plan, image, &options)?
        .run(|step| float.add(f32::to_bits, &step.measured, &step.command));

    let mut buffer = [0; 1024];
    let coefficients = [
        postcard::to_slice(&analysis.coefficients, &mut buffer)?.to_vec(),
        postcard::to_slice(&single, &mut buffer)?.to_vec(),
    ];
    Ok((coefficients, [fixed, float]))
}

/// Builds and replays every image on every core; the figures.
pub(crate) fn measure() -> Result<Figures> {
    let demo = inputs::demo()?;
    announce("recording the demo's run in fixed point and in f32");
    let (prepared, out) = prepare(&demo)?;
    let mut figures = Figures::new();
    for (core, target, machine) in CORES {
        cargo("build", target, &out, &prepared.environment, &[])?;
        for (name, recordings) in IMAGES.into_iter().zip(&prepared.recordings) {
            let elf = out.join(target).join("release").join(name);
            check_float_routines(&elf, name == "float")
                .with_context(|| format!("{core}, {name}"))?;
            announce(&format!("replaying the run in {name} on {machine}"));
            let measured = measure_image(&elf, machine, recordings, &out)
                .with_context(|| format!("replaying {name} on {machine}"))?;
            let table_bytes = demo.table.image.len() as u64;
            let flash = crate::image::sizes_in(&elf, FLASH)?.flash - table_bytes;
            let tick = crate::image::reachable_bytes(&elf, "flexor_tick")?;
            let sizes = [("flash_bytes", flash), ("tick_flash_bytes", tick)];
            let sizes = sizes.map(|(figure, value)| (figure.to_owned(), value));
            for (figure, value) in sizes.into_iter().chain(measured) {
                figures.insert(format!("{core}_{name}_{figure}"), value);
            }
        }
    }
    Ok(figures)
}

/// Makes sure that an image has floating-point routines, or that it has none.
fn check_float_routines(elf: &Path, wanted: bool) -> Result<()> {
    let floats = float_routines(elf)?;
    if wanted {
        // Were the routines renamed, the check of fixed point would pass by mistake.
        ensure!(
            !floats.is_empty(),
            "the image has no float routine that this check knows"
        );
    } else {
        let list = floats.join(", ");
        ensure!(list.is_empty(), "the image has floating point: {list}");
    }
    Ok(())
}

/// Replays the laws' recordings and compares every command; what the image says of itself, and
/// instructions a tick.
fn measure_image(
    elf: &Path,
    machine: &str,
    recordings: &[Recording; 2],
    out: &Path,
) -> Result<Figures> {
    let folder = out.join("replay");
    fs::create_dir_all(&folder)?;
    for ((law, _), recording) in LAWS.into_iter().zip(recordings) {
        let measurements = folder.join(format!("{law}.measurements.bin"));
        fs::write(measurements, &recording.measurements)?;
        let _ = fs::remove_file(folder.join(format!("{law}.commands.bin")));
    }
    emulate(elf, machine, &folder)?;
    let mut figures = Figures::new();
    for ((law, of), recording) in LAWS.into_iter().zip(recordings) {
        let replayed = answers(&folder.join(format!("{law}.commands.bin")))?;
        let measured = compare(&replayed, recording).with_context(|| format!("law = \"{law}\""))?;
        for (figure, value) in measured {
            // Both laws are in one controller; the deeper stack counts.
            let name = if figure.starts_with("instructions") {
                format!("{of}{figure}")
            } else {
                figure.into()
            };
            let known = figures.entry(name).or_insert(0);
            *known = value.max(*known);
        }
    }
    Ok(figures)
}

/// Compares every command of a law; what the image says of itself, and instructions a tick.
fn compare(replayed: &Replayed, recording: &Recording) -> Result<[(&'static str, u64); 4]> {
    let [nops, controller, stack, runs] = replayed.head.map(u64::from);
    let pairs = recording.commands.iter().zip(&replayed.ticks);
    let differing = pairs
        .filter(|(host, [a, b, state, _])| **host != [*a, *b, *state])
        .count();
    let (commands, answers) = (recording.commands.len(), replayed.ticks.len());
    ensure!(
        differing == 0 && commands == answers,
        "{differing} of {commands} commands differ from the host's, {answers} were answered"
    );
    ensure!(nops > 0 && runs > 0, "the stopwatch does not count");
    let mut instructions: Vec<u64> = replayed
        .ticks
        .iter()
        .map(|[.., counts]| u64::from(*counts) * 100_000 / (nops * runs))
        .collect();
    instructions.sort_unstable();
    let [median, max] = [instructions.len() / 2, instructions.len() - 1].map(|i| instructions[i]);
    Ok([
        ("controller_bytes", controller),
        ("stack_bytes", stack),
        ("instructions_median", median),
        ("instructions_max", max),
    ])
}

/// First addresses: `FLASH` of `firmware/replay/memory.x`.
const FLASH: core::ops::Range<u64> = 0..0x4_0000;

/// Lints the images' sources, for one core.
pub(crate) fn clippy() -> Result<()> {
    let (prepared, out) = prepare(&inputs::demo()?)?;
    let lints = ["--", "-D", "warnings"];
    cargo("clippy", CORES[0].1, &out, &prepared.environment, &lints)
}

/// Runs cargo's `verb` on the images for a target.
fn cargo(
    verb: &str,
    target: &str,
    out: &Path,
    environment: &[(&str, PathBuf)],
    more: &[&str],
) -> Result<()> {
    let toolchain = Toolchain::wanted()?;
    let mut command = toolchain.command("cargo");
    command
        .current_dir(root().join("firmware/replay"))
        .args([verb, "--release", "--target", target, "--target-dir"])
        .arg(out)
        .args(more)
        .envs(environment.iter().map(|(name, value)| (name, value)));
    run(&mut command)
}

/// Names of the image's functions of floating point.
fn float_routines(elf: &Path) -> Result<Vec<String>> {
    let bytes = fs::read(elf).with_context(|| format!("cannot read {}", elf.display()))?;
    let file = object::File::parse(&*bytes)?;
    let names = file.symbols().filter_map(|symbol| symbol.name().ok());
    Ok(names
        .filter(|name| is_float(name))
        .map(String::from)
        .collect())
}

/// True for the run-time library's functions on f32 and f64, by their ARM and GCC names,
/// and for libm's.
fn is_float(name: &str) -> bool {
    let arm = name.strip_prefix("__aeabi_").is_some_and(|rest| {
        ["f", "d", "cf", "cd"].iter().any(|p| {
            rest.strip_prefix(p).is_some_and(|operation| {
                [
                    "add", "sub", "rsub", "mul", "div", "neg", "cmp", "rcmp", "2", "ge", "gt",
                    "le", "lt", "un",
                ]
                .iter()
                .any(|o| operation.starts_with(o))
            })
        }) || ["i2", "ui2", "l2", "ul2"]
            .iter()
            .any(|p| rest.strip_prefix(p) == Some("f") || rest.strip_prefix(p) == Some("d"))
    });
    let gcc = name.starts_with("__")
        && [
            "sf2", "df2", "sf3", "df3", "sfsi", "dfsi", "sfdi", "dfdi", "sisf", "sidf", "disf",
            "didf",
        ]
        .iter()
        .any(|ending| name.ends_with(ending));
    arm || gcc || name.contains("libm") || name.contains("5float") || name.contains("4math")
}

/// What an image answered.
struct Replayed {
    head: [u32; 4],
    ticks: Vec<[u32; 4]>,
}

/// Runs an image in QEMU, in the folder of its files.
fn emulate(elf: &Path, machine: &str, folder: &Path) -> Result<()> {
    let elf = std::path::absolute(elf)?;
    let mut child = std::process::Command::new("qemu-system-arm")
        .current_dir(folder)
        .args([
            "-M",
            machine,
            "-nographic",
            "-monitor",
            "none",
            "-serial",
            "none",
        ])
        .args([
            "-icount",
            "shift=0",
            "-semihosting-config",
            "enable=on,target=native",
        ])
        .arg("-kernel")
        .arg(&elf)
        .stdin(Stdio::null())
        .spawn()
        .context("cannot start qemu-system-arm: run `cargo xtask setup`")?;
    let deadline = Instant::now() + PATIENCE;
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if Instant::now() > deadline {
            let _ = child.kill();
            let _ = child.wait();
            anyhow::bail!("no end after {PATIENCE:?}");
        }
        thread::sleep(Duration::from_millis(20));
    };
    ensure!(status.success(), "the image ended with {status}");
    Ok(())
}

/// What an image answered, from its file.
fn answers(file: &Path) -> Result<Replayed> {
    let bytes = fs::read(file).with_context(|| format!("no {}", file.display()))?;
    let mut records = bytes.as_chunks::<16>().0.iter().map(|record| {
        let words = record.as_chunks::<4>().0;
        [0, 1, 2, 3].map(|i| words.get(i).map_or(0, |word| u32::from_le_bytes(*word)))
    });
    let head = records.next().context("the image answered nothing")?;
    Ok(Replayed {
        head,
        ticks: records.collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn float_routines_are_told_from_others() {
        for name in [
            "__aeabi_fadd",
            "__aeabi_dmul",
            "__aeabi_f2iz",
            "__aeabi_i2f",
            "__aeabi_ul2d",
            "__mulsf3",
            "__fixsfsi",
            "_ZN17compiler_builtins5float3mul8__mulsf317hE",
        ] {
            assert!(is_float(name), "{name}");
        }
        for name in [
            "__aeabi_memcpy4",
            "__aeabi_uidiv",
            "__aeabi_lmul",
            "__aeabi_uldivmod",
            "__aeabi_idivmod",
            "_ZN13flexor_replay11flexor_tick17hE",
            "_ZN6flexor6number4sine3sin17hE",
        ] {
            assert!(!is_float(name), "{name}");
        }
    }
}

//! The demo's run replayed on cores without floating point, Cortex-M0 and Cortex-M3, in
//! fixed point and in emulated f32: every output bit against the host, instructions per
//! tick, sizes, and that no float routine is in the fixed-point image. What that takes is
//! held against `firmware/replay/budget.toml`.

use crate::inputs::Demo;
use crate::setup::Toolchain;
use crate::{firmware, inputs, root, run};
use anyhow::{Context, Result, ensure};
use clap::Args;
use flexor::control::{Coefficients, Command};
use flexor::fault::Fault;
use flexor::number::fixed::Fixed;
use flexor::signals::{Formats, Measurement, Saturation};
use flexor_sim::analysis::fixed_point::accuracy::run_fixed;
use flexor_sim::analysis::fixed_point::range;
use flexor_sim::simulation::closed_loop::Simulation;
use object::{Object, ObjectSymbol};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};
use std::{fs, thread};

/// Options of the verb `replay`.
#[derive(Args, Default)]
pub(crate) struct Options {
    /// Write what was measured to the golden file.
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

/// Longest run of one image. The slowest, f32 on the Cortex-M0, takes a fifth of it.
const PATIENCE: Duration = Duration::from_secs(300);

/// What must hold: entry and most.
const BARS: [(&str, u64); 2] = [
    ("m0_fixed_instructions_median", 4000),
    ("m3_fixed_instructions_median", 900),
];

/// How many times more instructions emulated f32 takes at least.
const GAIN_MIN: u64 = 4;

/// Excess over the golden file that passes, percent, as for the firmware.
const TOLERANCE_PERCENT: u64 = 3;

/// Measured figures by name: `<core>_<image>_<figure>`.
pub(crate) type Figures = BTreeMap<String, u64>;

/// Replays, compares, holds against the golden file.
pub(crate) fn run_verb(options: &Options) -> Result<()> {
    let figures = measure()?;
    if options.json {
        println!("{}", serde_json::to_string_pretty(&figures)?);
    } else {
        show(&figures);
    }
    let excess = excess(&figures, options.update)?;
    ensure!(
        excess.is_empty(),
        "over budget: {}; if that is meant, `cargo xtask replay --update`",
        excess.join("; ")
    );
    Ok(())
}

/// Prints the figures.
pub(crate) fn show(figures: &Figures) {
    for (name, value) in figures {
        println!("{name:30} {value:6}");
    }
    println!("every bit of every tick is the host's; no float routine in fixed point");
}

#[derive(Serialize, Deserialize)]
struct Golden(Figures);

/// What exceeds the bars or the golden file, which `update` rewrites first.
pub(crate) fn excess(figures: &Figures, update: bool) -> Result<Vec<String>> {
    let golden = root().join("firmware/replay/budget.toml");
    if update {
        let text = format!(
            "# Written by `cargo xtask budget --update`; what the tick takes without floating point.\n{}",
            toml::to_string(&Golden(figures.clone()))?
        );
        fs::write(&golden, text)?;
    }
    let text =
        fs::read_to_string(&golden).with_context(|| format!("cannot read {}", golden.display()))?;
    let Golden(limits) = toml::from_str(&text)?;
    let mut excess = vec![];
    for (name, is) in figures {
        match limits.get(name) {
            Some(most) if is * 100 <= most * (100 + TOLERANCE_PERCENT) => {}
            Some(most) => excess.push(format!("{name} is {is}, at most {most} was expected")),
            None => excess.push(format!("{name} is not in the golden file")),
        }
    }
    for (name, most) in BARS {
        let is = figures.get(name).copied().unwrap_or(u64::MAX);
        if is > most {
            excess.push(format!("{name} is {is}, the bar is {most}"));
        }
    }
    for (core, ..) in CORES {
        let median = |image| {
            figures
                .get(&format!("{core}_{image}_instructions_median"))
                .copied()
        };
        let (fixed, float) = (
            median("fixed").unwrap_or(u64::MAX),
            median("float").unwrap_or(0),
        );
        if float < GAIN_MIN.saturating_mul(fixed) {
            excess.push(format!(
                "{core}: f32 takes {float} instructions, fixed point {fixed}: less than {GAIN_MIN} times fewer"
            ));
        }
    }
    Ok(excess)
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
    environment: [(&'static str, PathBuf); 3],
    fixed: Recording,
    float: Recording,
}

/// Runs the demo in both number types and writes table and coefficients into the returned
/// folder.
fn prepare(demo: &Demo) -> Result<(Prepared, PathBuf)> {
    let Demo { plan, table, setup } = demo;
    let options = inputs::options(setup);
    let image = &table.image;
    let analysis = range::analyse(plan, image, &setup.law, &setup.limits)?;
    let single = Coefficients::<f32>::new(
        &setup.arm,
        &setup.law,
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

    let out = firmware::target_folder().join("replay");
    fs::create_dir_all(&out)?;
    let mut buffer = [0; 512];
    let file = |name: &str, bytes: &[u8]| -> Result<PathBuf> {
        Ok(std::path::absolute(firmware::write(
            &out.join(name),
            bytes,
        )?)?)
    };
    let environment = [
        ("FLEXOR_TABLE", file("table.bin", image)?),
        (
            "FLEXOR_FIXED",
            file(
                "fixed.bin",
                postcard::to_slice(&analysis.coefficients, &mut buffer)?,
            )?,
        ),
        (
            "FLEXOR_FLOAT",
            file("float.bin", postcard::to_slice(&single, &mut buffer)?)?,
        ),
    ];
    let prepared = Prepared {
        environment,
        fixed,
        float,
    };
    Ok((prepared, out))
}

/// Runs everything; the figures.
pub(crate) fn measure() -> Result<Figures> {
    let demo = inputs::demo()?;
    let (
        Prepared {
            environment,
            fixed,
            float,
        },
        out,
    ) = prepare(&demo)?;
    let image = &demo.table.image;
    let mut figures = Figures::new();
    for (core, target, machine) in CORES {
        cargo("build", target, &out, &environment, &[])?;
        for (name, recording) in IMAGES.into_iter().zip([&fixed, &float]) {
            let elf = out.join(target).join("release").join(name);
            let floats = float_routines(&elf)?;
            if name == "fixed" {
                let list = floats.join(", ");
                ensure!(
                    list.is_empty(),
                    "{core}: the fixed-point image has floating point: {list}"
                );
            } else {
                // Were the routines renamed, the check would pass by mistake.
                ensure!(
                    !floats.is_empty(),
                    "{core}: the f32 image has no float routine that this check knows"
                );
            }
            let mut put = |figure: &str, value: u64| {
                figures.insert(format!("{core}_{name}_{figure}"), value);
            };
            let sizes = crate::image::sizes_in(&elf, FLASH)?;
            put("flash_bytes", sizes.flash - image.len() as u64);
            put(
                "tick_flash_bytes",
                crate::image::reachable_bytes(&elf, "flexor_tick")?,
            );
            let replayed = replay(&elf, machine, &recording.measurements, &out)
                .with_context(|| format!("replaying {name} on {machine}"))?;
            let [nops, controller, stack, runs] = replayed.head.map(u64::from);
            put("controller_bytes", controller);
            put("stack_bytes", stack);
            let differing = recording
                .commands
                .iter()
                .zip(&replayed.ticks)
                .filter(|(host, [a, b, state, _])| **host != [*a, *b, *state])
                .count();
            ensure!(
                differing == 0 && recording.commands.len() == replayed.ticks.len(),
                "{machine}, {name}: {differing} of {} commands differ from the host's, {} were answered",
                recording.commands.len(),
                replayed.ticks.len()
            );
            ensure!(
                nops > 0 && runs > 0,
                "{machine}: the stopwatch does not count"
            );
            let mut instructions: Vec<u64> = replayed
                .ticks
                .iter()
                .map(|[.., counts]| u64::from(*counts) * 100_000 / (nops * runs))
                .collect();
            instructions.sort_unstable();
            put("instructions_median", instructions[instructions.len() / 2]);
            put("instructions_max", instructions[instructions.len() - 1]);
        }
    }
    Ok(figures)
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
    let toolchain = Toolchain::find()
        .with_context(|| format!("no toolchain has {target}: run `cargo xtask setup`"))?;
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

/// Runs an image in QEMU on the measurements.
fn replay(elf: &Path, machine: &str, measurements: &[u8], out: &Path) -> Result<Replayed> {
    let folder = out.join("replay");
    fs::create_dir_all(&folder)?;
    fs::write(folder.join("measurements.bin"), measurements)?;
    let answers = folder.join("commands.bin");
    let _ = fs::remove_file(&answers);
    let elf = std::path::absolute(elf)?;
    let mut child = std::process::Command::new("qemu-system-arm")
        .current_dir(&folder)
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
    let bytes = fs::read(&answers).with_context(|| format!("no {}", answers.display()))?;
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
            "_ZN5cores11flexor_tick17hE",
            "_ZN6shared4trig3sin17hE",
        ] {
            assert!(!is_float(name), "{name}");
        }
    }
}

//! What can be read from the image without running it: its sizes, and whether the tick
//! can reach a panic.

use anyhow::{Context, Result, bail, ensure};
use object::{Object, ObjectSection, ObjectSymbol, SectionFlags, SectionKind, SymbolKind, elf};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command;

/// First address after the image's flash: `FLASH` of `memory.x`.
const FLASH: core::ops::Range<u64> = 0x0800_0000..0x0802_0000;

/// Bytes that an image takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sizes {
    /// Flash, without the table.
    pub(crate) flash: u64,
    /// RAM, without the stack.
    pub(crate) ram: u64,
}

/// Sizes of the sections that the firmware loads.
pub(crate) fn sizes(elf: &Path) -> Result<Sizes> {
    sizes_in(elf, FLASH)
}

/// Sizes of the sections that an image loads, whose flash is at these addresses.
pub(crate) fn sizes_in(path: &Path, flash: core::ops::Range<u64>) -> Result<Sizes> {
    let bytes = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let file = object::File::parse(&*bytes)?;
    let mut sizes = Sizes { flash: 0, ram: 0 };
    for section in file.sections() {
        // Debug information is not loaded, and has the address 0.
        let SectionFlags::Elf { sh_flags } = section.flags() else {
            continue;
        };
        if sh_flags & u64::from(elf::SHF_ALLOC) == 0 {
            continue;
        }
        match section.kind() {
            // Initialised data lie in RAM and their first values in flash.
            SectionKind::Data => {
                sizes.flash += section.size();
                sizes.ram += section.size();
            }
            SectionKind::UninitializedData => sizes.ram += section.size(),
            _ if flash.contains(&section.address()) => sizes.flash += section.size(),
            _ => {}
        }
    }
    Ok(sizes)
}

/// Bytes of code that the function whose name contains `root` can reach, itself included.
pub(crate) fn reachable_bytes(elf: &Path, root: &str) -> Result<u64> {
    let graph = CallGraph::parse(&disassembly(elf)?);
    let name = graph
        .calls
        .keys()
        .find(|name| name.contains(root))
        .with_context(|| format!("{} has no function {root}", elf.display()))?;
    let bytes = fs::read(elf).with_context(|| format!("cannot read {}", elf.display()))?;
    let file = object::File::parse(&*bytes)?;
    let reached = graph.reachable(name);
    // Aliases share an address.
    let mut sizes = BTreeMap::new();
    for symbol in file.symbols() {
        if symbol.kind() == SymbolKind::Text && symbol.name().is_ok_and(|n| reached.contains(n)) {
            sizes.insert(symbol.address(), symbol.size());
        }
    }
    Ok(sizes.values().sum())
}

/// `objdump --disassemble`.
fn disassembly(elf: &Path) -> Result<String> {
    let output = Command::new("arm-none-eabi-objdump")
        .args(["--disassemble", "--no-show-raw-insn"])
        .arg(elf)
        .output()
        .context("cannot start arm-none-eabi-objdump: run `cargo xtask setup`")?;
    ensure!(
        output.status.success(),
        "arm-none-eabi-objdump failed on {}",
        elf.display()
    );
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// Functions of a disassembly and what each calls or jumps to.
#[derive(Default)]
struct CallGraph {
    calls: BTreeMap<String, BTreeSet<String>>,
    /// Functions with calls through a register, whose targets cannot be seen.
    indirect: BTreeSet<String>,
}

impl CallGraph {
    /// Reads `objdump --disassemble`.
    fn parse(listing: &str) -> Self {
        let mut graph = Self::default();
        let mut current = String::new();
        for line in listing.lines() {
            if let Some(name) = line.strip_suffix(">:").and_then(|l| l.split_once(" <")) {
                name.1.clone_into(&mut current);
                graph.calls.entry(current.clone()).or_default();
                continue;
            }
            // "  80001f0:\tbl\t8001424 <name+0x10>"
            let mut parts = line.trim_start().splitn(3, '\t');
            let (_, Some(operation)) = (parts.next(), parts.next()) else {
                continue;
            };
            let operands = parts.next().unwrap_or_default();
            if operation.starts_with("blx") || operation.starts_with("bx") && operands != "lr" {
                graph.indirect.insert(current.clone());
            }
            // Branches and nothing else name a place in angle brackets without a comment.
            let target = operation
                .starts_with('b')
                .then(|| operands.split_once('<'))
                .flatten()
                .and_then(|(_, rest)| rest.split(['>', '+']).next());
            if let Some(target) = target.filter(|t| *t != current) {
                graph
                    .calls
                    .entry(current.clone())
                    .or_default()
                    .insert(target.to_owned());
            }
        }
        graph
    }

    /// Everything that `root` can reach, itself included.
    fn reachable(&self, root: &str) -> BTreeSet<&str> {
        let mut found = BTreeSet::new();
        let mut open: Vec<_> = self
            .calls
            .get_key_value(root)
            .map(|(k, _)| k.as_str())
            .into_iter()
            .collect();
        while let Some(name) = open.pop() {
            if found.insert(name) {
                open.extend(
                    self.calls
                        .get(name)
                        .into_iter()
                        .flatten()
                        .map(String::as_str),
                );
            }
        }
        found
    }
}

/// True for the functions that a panic goes through, and for those that end in one.
fn panics(name: &str) -> bool {
    [
        "panic",
        "unwrap_failed",
        "expect_failed",
        "slice_index_fail",
        "begin_unwind",
    ]
    .iter()
    .any(|part| name.contains(part))
}

/// Fails if the tick's interrupt can reach a panic, or calls what cannot be followed.
pub(crate) fn check_panic_free(elf: &Path) -> Result<()> {
    check_listing(&disassembly(elf)?)
}

fn check_listing(listing: &str) -> Result<()> {
    /// The vector table's name of the tick's handler.
    const TICK: &str = "TIM2";
    let graph = CallGraph::parse(listing);
    let reached = graph.reachable(TICK);
    ensure!(!reached.is_empty(), "the image has no {TICK} handler");
    // Were the panics renamed, the check would pass by mistake.
    ensure!(
        graph.calls.keys().any(|name| panics(name)),
        "the image has no panic function that this check knows"
    );
    for name in reached {
        if panics(name) {
            bail!("the tick can panic: {TICK} reaches {name}");
        }
        if graph.indirect.contains(name) {
            bail!("the tick calls through a pointer in {name}: its panics cannot be excluded");
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const LISTING: &str = "\
08000100 <TIM2>:
 8000100:\tpush\t{r7, lr}
 8000102:\tbl\t8000200 <run>
 8000106:\tb.n\t8000100 <TIM2+0x4>
 8000108:\tbx\tlr

08000200 <run>:
 8000200:\tbeq.w\t8000300 <helper+0x10>

08000300 <helper>:
 8000300:\tvldr\ts0, [pc, #8]\t@ 8000310 <other+0x10>
 8000304:\tbx\tlr

08000400 <_ZN4core9panicking5panic17h0E>:
 8000400:\tudf\t#254
";

    #[test]
    fn calls_and_jumps_are_followed() {
        let graph = CallGraph::parse(LISTING);
        let reached: Vec<_> = graph.reachable("TIM2").into_iter().collect();
        assert_eq!(reached, ["TIM2", "helper", "run"]);
        check_listing(LISTING).unwrap();
    }

    #[test]
    fn a_panic_or_a_call_through_a_pointer_is_found_at_any_depth() {
        let call = |operation: &str| LISTING.replace("8000304:\tbx\tlr", operation);
        let panics = call("8000304:\tbl\t8000400 <_ZN4core9panicking5panic17h0E>");
        assert!(check_listing(&panics).is_err());
        assert!(check_listing(&call("8000304:\tblx\tr3")).is_err());
        assert!(check_listing(&call("8000304:\tbx\tr3")).is_err());
        assert!(check_listing(&LISTING.replace("TIM2", "TIM3")).is_err());
        assert!(check_listing(&LISTING.replace("panic", "calm")).is_err());
    }
}

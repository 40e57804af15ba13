//! What can be read from the image without running it: its sizes, whether the tick can
//! reach a panic, and for how long interrupts are held off.

use anyhow::{Context, Result, bail, ensure};
use object::elf::PT_LOAD;
use object::read::elf::{ElfFile32, ProgramHeader};
use object::{
    Endianness, Object, ObjectSection, ObjectSymbol, SectionFlags, SectionKind, SymbolKind, elf,
};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command;

/// First address after the image's flash: `FLASH` of `memory.x`.
const FLASH: core::ops::Range<u64> = 0x0800_0000..0x0802_0000;

/// Where `RAM` of `memory.x` begins.
const RAM_START: u64 = 0x2000_0000;

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

/// Checks that the stack lies below all variables and ends where RAM begins, so that an
/// overflow is a bus fault: what linking with flip-link is for.
pub(crate) fn check_stack_below_data(path: &Path) -> Result<()> {
    let bytes = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let file = object::File::parse(&*bytes)?;
    let symbol = |name: &str| {
        let mut symbols = file.symbols();
        let symbol = symbols.find(|symbol| symbol.name() == Ok(name));
        symbol
            .map(|symbol| symbol.address())
            .with_context(|| format!("{} has no symbol {name}", path.display()))
    };
    let (start, end) = (symbol("_stack_start")?, symbol("_stack_end")?);
    let data = symbol("__sdata")?;
    ensure!(
        end == RAM_START && end < start && start <= data,
        "the stack ({end:#x} to {start:#x}) is not between RAM's beginning, {RAM_START:#x}, and \
         the variables from {data:#x}: was this linked by flip-link?"
    );
    Ok(())
}

/// Bytes of code that the function whose name contains `root` can reach, itself included.
pub(crate) fn reachable_bytes(elf: &Path, root: &str) -> Result<u64> {
    let graph = CallGraph::parse(&listing(elf)?);
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

/// What of an ELF goes into flash: addresses and lengths, bytes.
pub(crate) fn segments(elf: &[u8]) -> Result<Vec<(u64, u64)>> {
    let file = ElfFile32::<Endianness>::parse(elf)?;
    let endian = file.endian();
    let headers = file.elf_program_headers().iter();
    let loaded = headers.filter(|h| h.p_type(endian) == PT_LOAD && h.p_filesz(endian) > 0);
    // The physical address: where initialised data lie until start-up copies them.
    let places = loaded.map(|h| (h.p_paddr(endian).into(), h.p_filesz(endian).into()));
    Ok(places.collect())
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

/// The vector table's name of the tick's handler.
const TICK: &str = "TIM2";

/// Disassembles the image.
pub(crate) fn listing(elf: &Path) -> Result<String> {
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

/// Fails if the tick's interrupt can reach a panic, or calls what cannot be followed.
pub(crate) fn check_panic_free(listing: &str) -> Result<()> {
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

/// An instruction of a disassembly.
struct Instruction<'l> {
    address: u64,
    function: &'l str,
    operation: &'l str,
    operands: &'l str,
}

impl Instruction<'_> {
    /// Where it branches to, if it names that.
    fn target(&self) -> Option<u64> {
        let (before, _) = self.operands.split_once(" <")?;
        u64::from_str_radix(before.rsplit([' ', ',']).next()?, 16).ok()
    }

    /// Holds interrupts off: RTIC's lock, or all of them.
    fn masks(&self) -> bool {
        self.operation == "msr" && self.operands.starts_with("BASEPRI_MAX")
            || self.operation == "cpsid"
    }

    /// Lets them come again.
    fn unmasks(&self) -> bool {
        let register = self.operands.split(',').next().unwrap_or_default();
        self.operation == "msr" && ["BASEPRI", "PRIMASK"].contains(&register)
            || self.operation == "cpsie"
    }
}

/// All instructions, in the order of their addresses.
fn instructions(listing: &str) -> Vec<Instruction<'_>> {
    let mut function = "";
    let mut found = Vec::new();
    for line in listing.lines() {
        if let Some((_, name)) = line.strip_suffix(">:").and_then(|l| l.split_once(" <")) {
            function = name;
            continue;
        }
        let mut parts = line.trim_start().splitn(3, '\t');
        let address = parts.next().and_then(|a| a.strip_suffix(':'));
        let address = address.and_then(|a| u64::from_str_radix(a, 16).ok());
        if let (Some(address), Some(operation)) = (address, parts.next()) {
            found.push(Instruction {
                address,
                function,
                operation,
                operands: parts.next().unwrap_or_default(),
            });
        }
    }
    found.sort_by_key(|instruction| instruction.address);
    found
}

/// Most instructions for which interrupts may be held off, outside the tick.
pub(crate) const MASKED_MAX: u64 = 200;

/// Most instructions from where interrupts are held off to where they are let again, over
/// all paths, outside the tick. Start-up is left out, which ends when interrupts are first
/// allowed, and so is the panic handler, which ends in a reset.
///
/// # Errors
/// If a path is longer than [`MASKED_MAX`] (a loop always is) or cannot be followed.
pub(crate) fn masked_instructions(listing: &str) -> Result<u64> {
    let all = instructions(listing);
    let begins = |i: &Instruction| {
        i.masks() && ![TICK, "main"].contains(&i.function) && !ends_in_reset(i.function)
    };
    let starts: Vec<_> = (0..all.len()).filter(|i| begins(&all[*i])).collect();
    // RTIC renamed, or another way of locking: the check would pass by mistake.
    ensure!(!starts.is_empty(), "the image never holds interrupts off");
    starts
        .into_iter()
        .map(|start| masked_from(&all, start))
        .try_fold(0, |most, here| Ok(most.max(here?)))
}

/// The functions that never return.
fn ends_in_reset(function: &str) -> bool {
    panics(function) || function.contains("rust_begin_unwind")
}

/// The same from one instruction on.
fn masked_from(all: &[Instruction], start: usize) -> Result<u64> {
    let place = |address| all.binary_search_by_key(&address, |i| i.address).ok();
    // Where execution may be after so many instructions: place, places to return to, and
    // how often interrupts are held off.
    let mut open: BTreeSet<(usize, Vec<usize>, u32)> = BTreeSet::from([(start, Vec::new(), 0)]);
    let begin = || format!("{:#x} in {}", all[start].address, all[start].function);
    for count in 0..=MASKED_MAX {
        let mut next = BTreeSet::new();
        for (at, returns, depth) in open {
            let here = &all[at];
            let depth = depth + u32::from(here.masks()) - u32::from(here.unmasks());
            if depth == 0 || here.operation.starts_with("udf") || ends_in_reset(here.function) {
                continue;
            }
            let operation = here.operation.trim_end_matches(".n").trim_end_matches(".w");
            let leaves = operation.starts_with("bx")
                || here.operands.contains("pc}")
                || here.operands.starts_with("pc,");
            let computed = operation.starts_with("blx")
                || operation.starts_with("tb")
                || here.operands.starts_with("pc,")
                || operation.starts_with("bx") && here.operands != "lr";
            ensure!(
                !computed,
                "interrupts are held off from {}; the jump at {:#x} cannot be followed",
                begin(),
                here.address
            );
            let branch = (operation.starts_with('b') || operation.starts_with("cb"))
                .then(|| here.target().and_then(place))
                .flatten();
            if operation == "bl" {
                let mut returns = returns.clone();
                returns.push(at + 1);
                next.extend(branch.map(|to| (to, returns, depth)));
                continue;
            }
            if leaves {
                let mut returns = returns.clone();
                let back = returns.pop();
                let back = back.with_context(|| {
                    format!("interrupts stay held off after the function of {}", begin())
                })?;
                next.insert((back, returns, depth));
            }
            next.extend(branch.map(|to| (to, returns.clone(), depth)));
            // A conditional one in an IT block has its condition at the end.
            if !["b", "bx", "pop", "ldmia"].contains(&operation) || !leaves && branch.is_none() {
                next.insert((at + 1, returns, depth));
            }
        }
        if next.is_empty() {
            return Ok(count);
        }
        open = next;
    }
    bail!(
        "interrupts may be held off for more than {MASKED_MAX} instructions from {}",
        begin()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flash_and_ram_are_where_the_memory_map_has_them() {
        let map = fs::read_to_string(crate::root().join("memory.x")).unwrap();
        let flash = (FLASH.end - FLASH.start) / 1024;
        for region in [
            format!("FLASH : ORIGIN = {:#010x}, LENGTH = {flash}K", FLASH.start),
            format!("RAM : ORIGIN = {RAM_START:#010x}, "),
        ] {
            assert!(map.contains(&region), "no {region}");
        }
    }

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
        check_panic_free(LISTING).unwrap();
    }

    #[test]
    fn a_panic_or_a_call_through_a_pointer_is_found_at_any_depth() {
        let call = |operation: &str| LISTING.replace("8000304:\tbx\tlr", operation);
        let panics = call("8000304:\tbl\t8000400 <_ZN4core9panicking5panic17h0E>");
        assert!(check_panic_free(&panics).is_err());
        assert!(check_panic_free(&call("8000304:\tblx\tr3")).is_err());
        assert!(check_panic_free(&call("8000304:\tbx\tr3")).is_err());
        assert!(check_panic_free(&LISTING.replace("TIM2", "TIM3")).is_err());
        assert!(check_panic_free(&LISTING.replace("panic", "calm")).is_err());
    }

    const LOCK: &str = "\
08000100 <TIM2>:
 8000100:\tcpsid\ti
 8000102:\tb.n\t8000100 <TIM2>

08000200 <idle>:
 8000200:\tmrs\tr0, BASEPRI
 8000204:\tmsr\tBASEPRI_MAX, r6
 8000208:\tcbz\tr2, 800020e <idle+0xe>
 800020a:\tbl\t8000300 <helper>
 800020e:\tmsr\tBASEPRI, r0
 8000212:\tb.n\t8000200 <idle>

08000300 <helper>:
 8000300:\tldr\tr0, [r1, #0]
 8000302:\tbx\tlr
";

    #[test]
    fn the_longest_way_through_a_lock_is_counted() {
        // BASEPRI_MAX, cbz, bl, ldr, bx; the one that lets them come again is the end.
        assert_eq!(masked_instructions(LOCK).unwrap(), 5);
        let nested = LOCK.replace("8000300:\tldr\tr0, [r1, #0]", "8000300:\tcpsid\ti");
        let nested = nested.replace("8000302:\tbx\tlr", "8000302:\tcpsie\ti\n 8000304:\tbx\tlr");
        assert_eq!(masked_instructions(&nested).unwrap(), 6);
    }

    #[test]
    fn a_lock_with_a_loop_or_a_hidden_way_is_refused() {
        let body = |operation: &str| LOCK.replace("8000302:\tbx\tlr", operation);
        for bad in [
            "8000302:\tbne.n\t8000300 <helper>\n 8000304:\tbx\tlr",
            "8000302:\tblx\tr3",
            "8000302:\ttbb\t[pc, r0]",
            "8000302:\tb.n\t8000302 <helper+0x2>",
        ] {
            assert!(masked_instructions(&body(bad)).is_err(), "{bad}");
        }
        // A function that returns without letting them come again.
        let stays = LOCK.replace("msr\tBASEPRI, r0", "bx\tlr");
        assert!(masked_instructions(&stays).is_err());
        assert!(masked_instructions(&LOCK.replace("BASEPRI_MAX", "FAULTMASK")).is_err());
    }
}

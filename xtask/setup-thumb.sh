#!/usr/bin/env bash
# setup-thumb.sh - a Rust toolchain with the Cortex-M targets, and QEMU 10, on Debian 12,
# from Debian's own archive alone: for machines that reach a Debian mirror but not
# rustup's servers (continuous integration behind a proxy, for one).
#
# A machine that reaches rustup's servers does not need the toolchain part; there it is:
#     rustup target add thumbv7em-none-eabihf thumbv7m-none-eabi thumbv6m-none-eabi
# `cargo xtask setup` chooses.
#
# What it does: takes Debian's rustc-web / cargo-web / rust-web-src packages
# (and the shared libraries they need), unpacks them into a private folder
# (nothing is installed system-wide, no root needed unless apt's lists are
# missing), builds core + alloc + compiler_builtins for the thumb targets from
# the sources in rust-web-src with the same cargo profile that Rust's own
# release builds use, puts the rlibs where `rustup target add` would put them,
# and links the folder as a rustup toolchain called "thumb".
#
# After it:
#     cargo +thumb build --target thumbv7em-none-eabihf
#     RUSTUP_TOOLCHAIN=thumb cargo build ...     # also overrides rust-toolchain.toml
#
# Knobs (environment):
#   THUMB_TOOLCHAIN  name given to rustup            (default: thumb)
#   THUMB_TARGETS    targets, separated by spaces
#   THUMB_HOME       where the toolchain is put      (default: ~/.local/share/thumb-rust)
#   THUMB_RUST       version of rustc-web to use     (default: apt's candidate)
#   THUMB_FORCE=1    start again from nothing
#   --qemu           also install qemu-system-arm 10 (bookworm-backports), gdb-multiarch
#                    and binutils-arm-none-eabi (this part needs root)
#   --no-toolchain   leave the Rust toolchain alone
set -euo pipefail
export RUSTUP_AUTO_INSTALL=0 # rustup is only asked to link a folder, never to fetch

NAME=${THUMB_TOOLCHAIN:-thumb}
TARGETS=${THUMB_TARGETS:-thumbv7em-none-eabihf thumbv7m-none-eabi thumbv6m-none-eabi}
BASE=${THUMB_HOME:-${XDG_DATA_HOME:-$HOME/.local/share}/thumb-rust}
HOST=x86_64-unknown-linux-gnu
WANT_QEMU=0
WANT_TOOLCHAIN=1
for a in "$@"; do
  case $a in
    --qemu) WANT_QEMU=1 ;;
    --no-toolchain) WANT_TOOLCHAIN=0 ;;
    *) echo "usage: $0 [--qemu] [--no-toolchain]" >&2; exit 2 ;;
  esac
done

TMP=$(mktemp -d /tmp/setup-thumb.XXXXXX)
chmod 755 "$TMP"
trap 'rm -rf "$TMP"' EXIT

say() { printf 'setup-thumb: %s\n' "$*" >&2; }
die() { say "$*"; exit 1; }
as_root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi; }

# ---------------------------------------------------------------- qemu & co.
setup_qemu() {
  local need=() v
  command -v gdb-multiarch     >/dev/null || need+=(gdb-multiarch)
  command -v arm-none-eabi-size >/dev/null || need+=(binutils-arm-none-eabi)
  v=$(qemu-system-arm --version 2>/dev/null | sed -n 's/^QEMU emulator version \([0-9]*\).*/\1/p' || true)
  if [ "${v:-0}" -ge 10 ] && [ ${#need[@]} = 0 ]; then
    say "qemu-system-arm $v, gdb-multiarch, binutils-arm-none-eabi: already there"
    return
  fi
  # bookworm's own qemu-system-arm is 7.2 and would REMOVE a qemu-utils from
  # backports, so the backports suite is read as well - with private lists, so
  # that /etc/apt and apt's own lists stay as they are.
  local d; d=$TMP/apt
  mkdir -p "$d/parts" "$d/lists/partial"
  # the mirrors are those that apt is already set up with
  local main sec codename
  codename=$(. /etc/os-release && echo "$VERSION_CODENAME")
  main=$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' | grep '/debian/$' | head -1)
  sec=$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' | grep '/debian-security/$' | head -1)
  [ -n "$main" ] || die "apt has no Debian mirror set up"
  {
    printf 'Types: deb\nURIs: %s\nSuites: %s %s-updates %s-backports\nComponents: main\nSigned-By: %s\n' \
      "$main" "$codename" "$codename" "$codename" /usr/share/keyrings/debian-archive-keyring.gpg
    [ -z "$sec" ] || printf '\nTypes: deb\nURIs: %s\nSuites: %s-security\nComponents: main\nSigned-By: %s\n' \
      "$sec" "$codename" /usr/share/keyrings/debian-archive-keyring.gpg
  } > "$d/parts/debian.sources"
  local o=(-o Dir::Etc::sourcelist=/dev/null -o "Dir::Etc::sourceparts=$d/parts"
           -o "Dir::State::lists=$d/lists" -o APT::Sandbox::User=root -o Dpkg::Use-Pty=0)
  [ "${v:-0}" -ge 10 ] || need+=(qemu-system-arm/$codename-backports
                                 qemu-system-common/$codename-backports
                                 qemu-system-data/$codename-backports)
  as_root apt-get "${o[@]}" -qq update
  as_root env DEBIAN_FRONTEND=noninteractive apt-get "${o[@]}" -qq -y --no-install-recommends \
    --no-remove install "${need[@]}" >/dev/null
  as_root rm -rf "$d" # what root made there
  say "installed: $(qemu-system-arm --version | head -1)"
}

# ------------------------------------------------------------- the toolchain
# true when every target has a core library in folder $1
complete() {
  local t
  [ -x "$1/bin/rustc" ] || return 1
  for t in $TARGETS; do
    compgen -G "$1/lib/rustlib/$t/lib/libcore-*.rlib" >/dev/null || return 1
  done
}
linked() { [ "$(readlink -f "${RUSTUP_HOME:-$HOME/.rustup}/toolchains/$NAME" 2>/dev/null)" = "$(readlink -f "$1")" ]; }

unpack_debian_rust() { # $1 = version, $2 = folder to fill
  local v=$1 tc=$2 tmp llvm
  tmp=$(mktemp -d "$TMP/unpack.XXXXXX")
  llvm=$(apt-cache show "rust-web-llvm=$v" | sed -n 's/.*\bllvm-\([0-9]*\).*/\1/p' | head -1)
  [ -n "$llvm" ] || die "cannot tell which LLVM rustc-web $v uses"
  local rust=(rustc-web cargo-web libstd-rust-web-dev rust-web-clippy rustfmt-web)
  # everything apt would have to add for these packages on this machine, so
  # that the libraries which the machine lacks come along
  local all
  mapfile -t all < <(
    { apt-get -s --no-install-recommends install "${rust[@]/%/=$v}" "lld-$llvm" "libllvm$llvm" |
        awk '$1=="Inst"{gsub(/\(/,""); print $2"="(($3 ~ /^\[/)?$4:$3)}'
      printf '%s\n' "${rust[@]/%/=$v}" "rust-web-src=$v" patchelf
      for p in lld libllvm llvm; do
        p=$p$([ $p = libllvm ] || echo -)$llvm
        echo "$p=$(apt-cache policy "$p" | sed -n 's/^ *Candidate: //p')"
      done
    } | sort -u)
  say "fetching ${#all[@]} Debian packages (rustc $v, LLVM $llvm)"
  (cd "$tmp" && apt-get -o APT::Sandbox::User=root -qq download "${all[@]}")
  mkdir "$tmp/x"
  local p
  for p in "$tmp"/*.deb; do
    case ${p##*/} in
      rust-web-src_*) # 430 MB unpacked; only library/ (50 MB) is wanted
        dpkg-deb --fsys-tarfile "$p" | tar -x -C "$tmp/x" --wildcards './usr/src/rustc-*/library' ;;
      *) dpkg-deb -x "$p" "$tmp/x" ;;
    esac
  done
  local u=$tmp/x/usr f
  mkdir -p "$tc/bin" "$tc/lib"
  for f in rustc rustdoc cargo cargo-clippy clippy-driver rustfmt cargo-fmt; do
    [ ! -e "$u/bin/$f" ] || cp -a "$u/bin/$f" "$tc/bin/"
  done
  find "$tmp/x" -path '*/lib/x86_64-linux-gnu/*.so*' -not -path '*/x86_64-linux-gnu/*/*' -exec cp -a {} "$tc/lib/" \;
  cp -a "$u/lib/rustlib" "$tc/lib/"
  rm -rf "$tc/lib/rustlib/src" "$tc/lib/rustlib/$HOST/bin"
  mkdir -p "$tc/lib/rustlib/src/rust" "$tc/lib/rustlib/$HOST/bin/gcc-ld"
  mv "$u"/src/rustc-*/library "$tc/lib/rustlib/src/rust/library"
  cp "$u/lib/llvm-$llvm/bin/lld" "$tc/lib/rustlib/$HOST/bin/rust-lld"
  # what the llvm-tools component has and cargo-binutils, cargo-llvm-cov look for
  # (without them cargo-llvm-cov calls 'rustup component add' by itself)
  for f in ar cov nm objcopy objdump profdata readobj size strip; do
    cp "$u/lib/llvm-$llvm/bin/llvm-$f" "$tc/lib/rustlib/$HOST/bin/"
  done
  for f in ld.lld ld64.lld lld-link wasm-ld; do
    ln -s ../rust-lld "$tc/lib/rustlib/$HOST/bin/gcc-ld/$f"
  done
  # let the programs find these libraries also when rustup does not start them
  # (DT_RPATH, as it counts for the libraries' own libraries too)
  for f in "$tc"/bin/*; do "$u/bin/patchelf" --force-rpath --set-rpath '$ORIGIN/../lib' "$f"; done
  for f in "$tc/lib/rustlib/$HOST"/bin/*l[lv]*; do
    "$u/bin/patchelf" --force-rpath --set-rpath '$ORIGIN/../../..' "$f"
  done
  rm -rf "$tmp"
  if ldd "$tc/bin/rustc" "$tc/bin/cargo" "$tc/bin/clippy-driver" "$tc/bin/rustfmt" \
       "$tc/lib/rustlib/$HOST"/bin/*l[lv]* | grep 'not found' >&2; then
    die "the libraries above are missing"
  fi
}

build_sysroot() { # $1 = toolchain folder
  local tc=$1 lib=$1/lib/rustlib/src/rust/library tmp t args=() hash
  tmp=$(mktemp -d "$TMP/build.XXXXXX")
  for t in $TARGETS; do
    compgen -G "$tc/lib/rustlib/$t/lib/libcore-*.rlib" >/dev/null || args+=(--target "$t")
  done
  hash=$("$tc/bin/rustc" -vV | sed -n 's/^commit-hash: //p')
  say "building core, alloc and compiler_builtins for: ${args[*]//--target/}"
  # the cargo call and the flags are those of Rust's own bootstrap for no_std
  # targets (compile.rs std_cargo, builder/cargo.rs), less the compiler-rt C code
  (cd "$lib" && env -u CARGO_ENCODED_RUSTFLAGS -u CARGO_BUILD_RUSTFLAGS -u CARGO_BUILD_TARGET \
      -u CARGO_BUILD_RUSTC -u RUSTC_WRAPPER -u RUSTC_WORKSPACE_WRAPPER -u CARGO_TARGET_DIR \
      -u CARGO_INCREMENTAL -u RUSTUP_TOOLCHAIN \
      RUSTC="$tc/bin/rustc" RUSTC_BOOTSTRAP=1 \
      __CARGO_DEFAULT_LIB_METADATA=stablestd \
      RUSTFLAGS="-Zforce-unstable-if-unmarked -Zinline-mir -Zinline-mir-preserve-debug -Zmir_strip_debuginfo=locals-in-tiny-functions --remap-path-prefix=$tc/lib/rustlib/src/rust=/rustc/$hash" \
    "$tc/bin/cargo" build --quiet --locked --profile dist --target-dir "$tmp" "${args[@]}" \
      -p alloc --manifest-path "$lib/alloc/Cargo.toml" --features compiler-builtins-mem)
  for t in $TARGETS; do
    [ -d "$tmp/$t/dist/deps" ] || continue
    mkdir -p "$tc/lib/rustlib/$t/lib"
    cp "$tmp/$t"/dist/deps/lib{core,alloc,compiler_builtins}-*.rlib "$tc/lib/rustlib/$t/lib/"
  done
  rm -rf "$tmp"
}

setup_toolchain() {
  command -v rustup >/dev/null || die "rustup is not on PATH"
  local tc v up rc
  if [ "${THUMB_FORCE:-0}" = 1 ]; then
    rustup toolchain uninstall "$NAME" >/dev/null 2>&1 || true
    rm -rf "${BASE:?}"
  fi
  tc=$BASE/current
  if complete "$tc" && linked "$tc"; then
    say "toolchain '$NAME' ($(readlink "$tc")) has: $TARGETS"
    return
  fi
  if [ ! -x "$tc/bin/rustc" ]; then
    v=${THUMB_RUST:-$(apt-cache policy rustc-web 2>/dev/null | sed -n 's/^ *Candidate: //p')}
    if [ -z "$v" ] || [ "$v" = "(none)" ]; then
      as_root apt-get -qq update
      v=${THUMB_RUST:-$(apt-cache policy rustc-web | sed -n 's/^ *Candidate: //p')}
    fi
    up=${v%%+*}; mkdir -p "$BASE"; rm -rf "${BASE:?}/${up:?}.new" "${BASE:?}/${up:?}"
    set +e; (set -e; unpack_debian_rust "$v" "$BASE/$up.new"); rc=$?; set -e
    if [ $rc != 0 ]; then
      # apt's lists may be older than the archive: refresh once and try again
      say "trying again after apt-get update"
      rm -rf "$BASE/$up.new"
      as_root apt-get -qq update
      v=${THUMB_RUST:-$(apt-cache policy rustc-web | sed -n 's/^ *Candidate: //p')}; up=${v%%+*}
      rm -rf "${BASE:?}/${up:?}.new" "${BASE:?}/${up:?}"
      unpack_debian_rust "$v" "$BASE/$up.new"
    fi
    mv "$BASE/$up.new" "$BASE/$up"
    ln -sfn "$up" "$tc"
  fi
  complete "$tc" || build_sysroot "$(readlink -f "$tc")"
  complete "$tc" || die "the build left no core library"
  linked "$tc" || rustup toolchain link "$NAME" "$tc" 2>/dev/null || die "rustup toolchain link failed"
  say "toolchain '$NAME' is ready: $(rustc "+$NAME" -V)"
}

[ "$WANT_TOOLCHAIN" = 0 ] || setup_toolchain
[ "$WANT_QEMU" = 0 ] || setup_qemu

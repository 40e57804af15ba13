#!/usr/bin/env bash
# A campaign by GNU parallel: a shard after the other on every machine, all cores each.
#
#   bash parallel.sh SCENARIO RUNS SEED SHARDS OUT [-- OPTIONS OF flexor campaign]
#
# HOSTS names a file of machines that ssh reaches, one a line (":" is this one); they must see the
# present folder under the same path. Without it only this machine works. FLEXOR is the program
# [flexor].
set -euo pipefail

if [ $# -lt 5 ]; then
    sed -n '2,8s/^# \{0,1\}//p' "$0" >&2
    exit 2
fi
scenario=$1 runs=$2 seed=$3 shards=$4 out=$5
shift 5
[ "${1-}" = -- ] && shift
flexor=${FLEXOR:-flexor}
mkdir -p "$out"

hosts=()
if [ -n "${HOSTS-}" ]; then
    hosts=(--sshloginfile "$HOSTS" --workdir "$PWD")
fi

# Exit code 3 says that a limit does not hold, which is for the whole campaign to say.
command=$(printf '%q ' "$flexor" campaign --scenario "$scenario" --runs "$runs" --seed "$seed" "$@")
command+="--shard {}/$shards --out $(printf '%q' "$out")/shard-{} || [ \$? -eq 3 ]"

# --resume-failed: called again after a failure, only what is missing is done.
seq "$shards" | parallel --jobs 1 --halt soon,fail=1 --joblog "$out/parallel.log" \
    --resume-failed "${hosts[@]}" "$command"

folders=()
for ((shard = 1; shard <= shards; shard++)); do
    folders+=("$out/shard-$shard")
done
"$flexor" campaign merge "${folders[@]}" --out "$out/merged"

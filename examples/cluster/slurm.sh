#!/usr/bin/env bash
# A campaign as a Slurm array job, a shard a task, and a job after it that merges.
#
#   bash slurm.sh SCENARIO RUNS SEED SHARDS OUT [-- OPTIONS OF flexor campaign]
#
# SBATCH_PARTITION, SBATCH_ACCOUNT and the like choose where; FLEXOR is the program [flexor].
#SBATCH --job-name=flexor-campaign
#SBATCH --cpus-per-task=4
#SBATCH --time=01:00:00
#SBATCH --mem=2G
set -euo pipefail

if [ $# -lt 5 ]; then
    sed -n '2,6s/^# \{0,1\}//p' "$0" >&2
    exit 2
fi
scenario=$1 runs=$2 seed=$3 shards=$4 out=$5
shift 5
[ "${1-}" = -- ] && shift
flexor=${FLEXOR:-flexor}

if [ -z "${SLURM_ARRAY_TASK_ID-}" ]; then
    # On the login node: submit this file, and what comes after all its tasks.
    mkdir -p "$out"
    job=$(sbatch --parsable --array="1-$shards" --output="$out/slurm-%a.log" \
        "$0" "$scenario" "$runs" "$seed" "$shards" "$out" -- "$@")
    merge=$(printf '%q ' "$flexor" campaign merge)
    for ((shard = 1; shard <= shards; shard++)); do
        merge+=$(printf '%q ' "$out/shard-$shard")
    done
    merge+=$(printf '%q ' --out "$out/merged")
    sbatch --dependency="afterok:${job%%;*}" --kill-on-invalid-dep=yes \
        --job-name=flexor-merge --output="$out/slurm-merge.log" --wrap "$merge"
    exit
fi

# A task of the array.
export RAYON_NUM_THREADS=${SLURM_CPUS_PER_TASK:-1}
code=0
"$flexor" campaign --scenario "$scenario" --runs "$runs" --seed "$seed" \
    --shard "$SLURM_ARRAY_TASK_ID/$shards" --out "$out/shard-$SLURM_ARRAY_TASK_ID" "$@" || code=$?
# 3 says that a limit does not hold, which is for the whole campaign to say.
[ "$code" -eq 3 ] && code=0
exit "$code"

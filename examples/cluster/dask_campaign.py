#!/usr/bin/env python3
"""A campaign by Dask: a shard a task.

    pip install distributed
    python3 dask_campaign.py --scenario F --runs N --seed S --shards 32 --out DIR --scheduler HOST:8786
    python3 dask_campaign.py --scenario F --runs N --seed S --shards 8 --out DIR --local 2

The workers must see DIR under the same path and have `flexor`; start them with one thread each
(`dask worker --nthreads 1 HOST:8786`), since flexor takes all cores. What follows `--` goes to
every `flexor campaign`.
"""

import argparse
import os
import subprocess
import sys

# Exit codes of a shard that was done: 3 says that a limit does not hold, which is for the whole
# campaign to say.
DONE = (0, 3)


def shard_folder(out, shard):
    return os.path.join(out, f"shard-{shard}")


def run_shard(flexor, options, shard, shards, out, threads):
    """Runs a shard, on a worker. An error goes back to the caller; Dask then tries again."""
    command = [flexor, "campaign", *options, "--shard", f"{shard}/{shards}"]
    command += ["--out", shard_folder(out, shard)]
    environment = dict(os.environ)
    if threads:
        environment["RAYON_NUM_THREADS"] = str(threads)
    done = subprocess.run(command, env=environment, stderr=subprocess.PIPE, text=True)
    if done.returncode not in DONE:
        raise RuntimeError(f"{' '.join(command)}: exit code {done.returncode}: {done.stderr.strip()}")
    return shard


def main():
    line, extra = sys.argv[1:], []
    if "--" in line:
        at = line.index("--")
        line, extra = line[:at], line[at + 1 :]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", required=True)
    parser.add_argument("--runs", required=True, type=int)
    parser.add_argument("--seed", required=True, type=int)
    parser.add_argument("--shards", required=True, type=int)
    parser.add_argument("--out", required=True)
    parser.add_argument("--flexor", default=os.environ.get("FLEXOR", "flexor"))
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--scheduler", metavar="HOST:PORT", help="a Dask scheduler")
    where.add_argument("--local", metavar="N", type=int, help="N workers on this machine")
    arguments = parser.parse_args(line)

    from dask.distributed import Client, LocalCluster, as_completed

    out = os.path.abspath(arguments.out)
    options = ["--scenario", os.path.abspath(arguments.scenario)]
    options += ["--runs", str(arguments.runs), "--seed", str(arguments.seed), *extra]
    cluster, threads = arguments.scheduler, None
    if arguments.local:
        threads = max(1, (os.cpu_count() or 1) // arguments.local)
        cluster = LocalCluster(
            n_workers=arguments.local,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address=None,
        )
    shards = range(1, arguments.shards + 1)
    with Client(cluster) as client:
        tasks = [
            client.submit(
                run_shard, arguments.flexor, options, shard, arguments.shards, out, threads,
                pure=False, retries=1,
            )
            for shard in shards
        ]
        for count, task in enumerate(as_completed(tasks), 1):
            print(f"shard {task.result()} done, {count} of {len(tasks)}", file=sys.stderr)
    if arguments.local:
        cluster.close()
    merge = [arguments.flexor, "campaign", "merge", *(shard_folder(out, shard) for shard in shards)]
    return subprocess.run([*merge, "--out", os.path.join(out, "merged")]).returncode


if __name__ == "__main__":
    sys.exit(main())

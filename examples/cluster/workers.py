#!/usr/bin/env python3
"""A campaign by a queue of shards that workers connect to; the standard library is enough.

On one machine, with two workers:

    python3 workers.py serve --scenario F --runs N --seed S --shards 8 --out DIR --local 2

On several: `serve --host 0.0.0.0 --port 7420` on one, and on each of the others

    python3 workers.py work --host THE_FIRST --port 7420

A worker that goes away gives its shard back to the queue. All machines must see DIR under the same
path and have `flexor`. What follows `--` goes to every `flexor campaign`. Whoever reaches the port
can take part, and a worker runs what the server says: for networks that you trust.
"""

import argparse
import json
import os
import queue
import socket
import socketserver
import subprocess
import sys
import threading

# Exit codes of a shard that was done: 3 says that a limit does not hold, which is for the whole
# campaign to say.
DONE = (0, 3)
# How often a shard is tried.
TRIES = 2


def shard_folder(out, shard):
    return os.path.join(out, f"shard-{shard}")


def say(text):
    print(text, file=sys.stderr, flush=True)


class Queue(socketserver.ThreadingTCPServer):
    """Hands out the shards 1 to `shards`; `commands[shard]` is what a worker runs for one."""

    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, address, commands):
        super().__init__(address, Worker)
        self.commands = commands
        self.todo = queue.Queue()
        self.tries = dict.fromkeys(commands, 0)
        self.done, self.failed = [], []
        self.lock = threading.Lock()
        self.over = threading.Event()
        for shard in commands:
            self.todo.put(shard)

    def ended(self, shard, code, error=""):
        """Takes note of a shard's exit code; `None` where its worker went away."""
        with self.lock:
            self.tries[shard] += 1
            if code in DONE:
                self.done.append(shard)
                say(f"shard {shard} done, {len(self.done)} of {len(self.commands)}")
            elif self.tries[shard] < TRIES:
                say(f"shard {shard}: {error or 'its worker went away'}; once more")
                self.todo.put(shard)
            else:
                say(f"shard {shard}: {error or 'its worker went away'}; given up")
                self.failed.append(shard)
            if len(self.done) + len(self.failed) == len(self.commands):
                self.over.set()


class Worker(socketserver.StreamRequestHandler):
    """The server's end of a worker's connection: a line of JSON each way a shard."""

    def handle(self):
        while not self.server.over.is_set():
            try:
                shard = self.server.todo.get(timeout=0.2)
            except queue.Empty:
                # Another worker's shard may come back.
                continue
            answer = b""
            try:
                self.wfile.write(json.dumps(self.server.commands[shard]).encode() + b"\n")
                answer = self.rfile.readline()
            except OSError:
                pass
            if not answer.endswith(b"\n"):
                self.server.ended(shard, None)
                return
            answer = json.loads(answer)
            self.server.ended(shard, answer["code"], answer["error"])


def work(host, port, threads=None):
    """Runs shards until the server has none."""
    environment = dict(os.environ)
    if threads:
        environment["RAYON_NUM_THREADS"] = str(threads)
    with socket.create_connection((host, port)) as connection, connection.makefile("rw") as line:
        for command in line:
            code, error = None, ""
            try:
                done = subprocess.run(
                    json.loads(command),
                    env=environment,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.PIPE,
                    text=True,
                )
                code = done.returncode
                if code not in DONE:
                    error = f"exit code {code}: {done.stderr.strip()}"
            except OSError as cause:
                error = str(cause)
            line.write(json.dumps({"code": code, "error": error}) + "\n")
            line.flush()


def serve(arguments, extra):
    """Hands out the shards, and merges them when all are done."""
    out = os.path.abspath(arguments.out)
    shards = range(1, arguments.shards + 1)
    options = ["--scenario", os.path.abspath(arguments.scenario)]
    options += ["--runs", str(arguments.runs), "--seed", str(arguments.seed), *extra]
    commands = {
        shard: [
            arguments.flexor, "campaign", *options,
            "--shard", f"{shard}/{arguments.shards}", "--out", shard_folder(out, shard),
        ]
        for shard in shards
    }
    with Queue((arguments.host, arguments.port), commands) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        host, port = server.server_address[:2]
        say(f"{len(commands)} shards at {host} port {port}")
        workers = []
        if arguments.local:
            threads = max(1, (os.cpu_count() or 1) // arguments.local)
            line = [sys.executable, os.path.abspath(__file__), "work", "--port", str(port)]
            line += ["--threads", str(threads)]
            workers = [subprocess.Popen(line) for _ in range(arguments.local)]
        try:
            while not server.over.wait(0.2):
                if workers and all(worker.poll() is not None for worker in workers):
                    say("no worker is left")
                    return 1
        finally:
            server.shutdown()
            for worker in workers:
                worker.terminate()
                worker.wait()
    if server.failed:
        say(f"not merged, as shards failed: {sorted(server.failed)}")
        return 1
    merge = [arguments.flexor, "campaign", "merge", *(shard_folder(out, shard) for shard in shards)]
    return subprocess.run([*merge, "--out", os.path.join(out, "merged")]).returncode


def positive(text):
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{number}; accepted: from 1 on")
    return number


def main():
    line, extra = sys.argv[1:], []
    if "--" in line:
        at = line.index("--")
        line, extra = line[:at], line[at + 1 :]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    server = verbs.add_parser("serve", help="hand out the shards and merge them")
    server.add_argument("--scenario", required=True)
    server.add_argument("--runs", required=True, type=positive)
    server.add_argument("--seed", required=True, type=int)
    server.add_argument("--shards", required=True, type=positive)
    server.add_argument("--out", required=True)
    server.add_argument("--flexor", default=os.environ.get("FLEXOR", "flexor"))
    server.add_argument("--host", default="127.0.0.1", help="address to listen at")
    server.add_argument("--port", default=0, type=int, help="0: any free one")
    server.add_argument("--local", metavar="N", type=positive, help="start N workers here, too")
    worker = verbs.add_parser("work", help="run shards of a server")
    worker.add_argument("--host", default="127.0.0.1")
    worker.add_argument("--port", required=True, type=int)
    worker.add_argument("--threads", type=positive, help="threads of a shard; else all cores")
    arguments = parser.parse_args(line)
    if arguments.verb == "serve":
        return serve(arguments, extra)
    work(arguments.host, arguments.port, arguments.threads)
    return 0


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures answers per second over the number of workers (docs/workers.md): a table and a picture.

First, one and two real workers solve in turns on this machine's cores. The ratio is the median over the turns. Their
solve times are recorded. Then up to --sleepers workers sleep for those times instead of solving. Each has a separate
network namespace behind a bridge, as on a separate machine (needs root; --no-namespaces: all on this machine's
loopback). For more workers the rate is calculated: n workers give n / (solve + way) answers per second until the
simulator's thread, which spends a fixed time on each answer, is busy.

    bench/worker_scaling.py --out DIR
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

PAPER_COUNTS = [32, 64, 128, 256, 512, 1000]
BRIDGE = "fgbench"


def run(*command):
    subprocess.run(command, check=True, capture_output=True, text=True)


class Namespaces:
    """One namespace for the pool, with a bridge in it, and one per worker; removed at the end."""

    def __init__(self, workers):
        tag = f"fg{os.getpid()}"
        self.pool = f"{tag}pool"
        self.workers = [f"{tag}w{i}" for i in range(workers)]
        self.made = []

    def __enter__(self):
        try:
            self.make(self.pool)
            inside = ["ip", "-n", self.pool]
            run(*inside, "link", "add", BRIDGE, "type", "bridge")
            run(*inside, "addr", "add", "10.77.0.1/16", "dev", BRIDGE)
            run(*inside, "link", "set", BRIDGE, "up")
            for i, name in enumerate(self.workers):
                self.make(name)
                run(*inside, "link", "add", f"w{i}", "type", "veth", "peer", "name", "eth0", "netns", name)
                run(*inside, "link", "set", f"w{i}", "master", BRIDGE, "up")
                run("ip", "-n", name, "addr", "add", f"10.77.1.{i + 1}/16", "dev", "eth0")
                run("ip", "-n", name, "link", "set", "eth0", "up")
        except subprocess.CalledProcessError as error:
            self.__exit__()
            sys.exit(f"worker_scaling.py: {' '.join(error.cmd)}: {error.stderr.strip()}; "
                     "network namespaces need root, --no-namespaces does without")
        return self

    def make(self, name):
        run("ip", "netns", "add", name)
        self.made.append(name)
        run("ip", "-n", name, "link", "set", "lo", "up")

    def __exit__(self, *_):
        for name in self.made:
            subprocess.run(["ip", "netns", "del", name], check=False)


def measure(serve, worker_commands):
    """Runs the pool `serve` with the workers of `worker_commands(address)`; returns the pool's report."""
    pool = subprocess.Popen(serve, stdout=subprocess.PIPE, text=True)
    workers = []
    try:
        line = pool.stdout.readline().split()
        if not line or line[0] != "listening":
            sys.exit("worker_scaling.py: the pool did not start (its message is above)")
        workers = [subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)
                   for command in worker_commands(line[1])]
        report = pool.stdout.read()
        if pool.wait() != 0:
            sys.exit("worker_scaling.py: the pool ended early (its message is above)")
        return json.loads(report)
    finally:
        for process in workers + [pool]:
            process.kill()
            process.wait()


def on_paper(counts, solve_s, way_s, busy_s):
    """Calculated answers per second for each number of workers. `busy_s`: time of the simulator's thread per answer."""
    return [min(count / (solve_s + way_s), 1.0 / busy_s) for count in counts]


def rows_of(rounds, sleeping):
    """Answers per second and their ratio to one worker: medians over the rounds for the solving workers; for the
    sleeping ones, relative to a single sleeper."""
    rows = []
    for index in range(len(rounds[0])):
        ratios = [measured[index]["answers_per_s"] / measured[0]["answers_per_s"] for measured in rounds]
        rows.append({"kind": "solving", **rounds[0][index],
                     "answers_per_s": median([measured[index]["answers_per_s"] for measured in rounds]),
                     "taken_back": sum(measured[index]["taken_back"] for measured in rounds),
                     "ratio": median(ratios), "ratio_low": min(ratios), "ratio_high": max(ratios)})
    for result in sleeping:
        rows.append({"kind": "sleeping", "ratio": result["answers_per_s"] / sleeping[0]["answers_per_s"], **result})
    return rows


def text_of(rows, paper, solve_s, way_s, busy_s):
    lines = [f"{'workers':>8} {'kind':<9} {'answers/s':>10} {'ratio':>7} {'taken back':>11}"]
    for row in rows:
        lines.append(f"{row['workers']:>8} {row['kind']:<9} {row['answers_per_s']:>10.1f} {row['ratio']:>7.2f} "
                     f"{row['taken_back']:>11}")
    two = next(row for row in rows if row["kind"] == "solving" and row["workers"] == 2)
    for count, rate in paper:
        lines.append(f"{count:>8} {'on paper':<9} {rate:>10.1f} {rate * (solve_s + way_s):>7.2f}")
    lines.append(f"Two solving workers: {two['ratio_low']:.2f} to {two['ratio_high']:.2f} times one, by round.")
    lines.append(f"On average, a recorded solve takes {1e3 * solve_s:.2f} ms and the way there and back {1e3 * way_s:.2f} ms. "
                 f"The simulator's thread spends {1e6 * busy_s:.0f} us on each answer, so "
                 f"{(solve_s + way_s) / busy_s:.0f} workers or more keep it busy.")
    return "\n".join(lines)


def draw(folder, rows, paper):
    blocks = [[(row["workers"], row["answers_per_s"]) for row in rows if row["kind"] == kind]
              for kind in ("solving", "sleeping")] + [paper]
    data = "\n\n\n".join("\n".join(f"{count} {rate}" for count, rate in block) for block in blocks)
    (folder / "worker_scaling.dat").write_text(data + "\n")
    script = f"""set terminal svg size 720,420 background rgb 'white'
set output '{folder / "worker_scaling.svg"}'
set logscale xy
set xlabel 'workers'
set ylabel 'answers per second'
set grid
set key left top
plot '{folder / "worker_scaling.dat"}' index 0 with linespoints pt 7 title 'solving, on this machine', \\
     '' index 1 with linespoints pt 6 title 'sleeping for recorded solve times', \\
     '' index 2 with lines dt 2 title 'on paper'
"""
    subprocess.run(["gnuplot"], input=script, text=True, check=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=Path, default=Path("build/release"))
    parser.add_argument("--scene", default="block")
    parser.add_argument("--seconds", type=float, default=8.0, help="duration of each measurement (8)")
    parser.add_argument("--rounds", type=int, default=5, help="rounds of one and two solving workers (5)")
    parser.add_argument("--sleepers", type=int, default=16, help="largest number of sleeping workers (16)")
    parser.add_argument("--no-namespaces", action="store_true")
    parser.add_argument("--out", type=Path, required=True, help="folder for table, data and picture")
    arguments = parser.parse_args()
    if arguments.rounds < 1:
        sys.exit("worker_scaling.py: --rounds takes 1 or more")
    if not 1 <= arguments.sleepers <= 200:
        sys.exit("worker_scaling.py: --sleepers takes 1 to 200")
    arguments.out.mkdir(parents=True, exist_ok=True)

    program = str(arguments.build / "bin/forcegrid")
    bench = str(arguments.build / "bin/forcegrid_worker_bench")
    counts = [count for count in (1, 2, 4, 8, 16, 32, 64, 128) if count < arguments.sleepers] + [arguments.sleepers]
    sleeping = []
    with tempfile.TemporaryDirectory() as folder:
        key, times = f"{folder}/link.key", f"{folder}/times.txt"
        run(program, "keygen", key)
        def solve(count):
            return measure([bench, "serve", "127.0.0.1:0", key, arguments.scene, str(count), str(arguments.seconds)]
                           + ([times] if count == 1 else []),
                           lambda address: [[program, "--no-config", "worker", "--connect", address, "--key", key,
                                             "--scene", arguments.scene, "--until-stdin-closes"]] * count)

        rounds = [[solve(1), solve(2)] for _ in range(arguments.rounds)]
        for count in counts:
            def sleep(address):
                return [bench, "sleep", address, key, arguments.scene, times]

            serve = [key, arguments.scene, str(count), str(arguments.seconds)]
            if arguments.no_namespaces:
                sleeping.append(measure([bench, "serve", "127.0.0.1:0"] + serve,
                                                   lambda address, count=count: [sleep(address)] * count))
                continue
            with Namespaces(count) as spaces:
                sleeping.append(measure(
                    ["ip", "netns", "exec", spaces.pool, bench, "serve", "10.77.0.1:0"] + serve,
                    lambda address, spaces=spaces: [["ip", "netns", "exec", name] + sleep(address)
                                                    for name in spaces.workers]))

    one, many = sleeping[0], sleeping[-1]
    solve_s = one["solve_mean_s"]
    way_s = one["seconds"] / one["answers"] - solve_s
    busy_s = many["thread_cpu_s"] / many["answers"]
    paper = list(zip(PAPER_COUNTS, on_paper(PAPER_COUNTS, solve_s, way_s, busy_s)))
    rows = rows_of(rounds, sleeping)
    text = text_of(rows, paper, solve_s, way_s, busy_s)
    print(text)
    (arguments.out / "worker_scaling.txt").write_text(text + "\n")
    (arguments.out / "worker_scaling.json").write_text(json.dumps(
        {"rows": rows, "on_paper": paper, "solve_mean_s": solve_s, "way_s": way_s, "busy_s": busy_s}, indent=1) + "\n")
    draw(arguments.out, rows, paper)


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""CPU seconds of variants of one render, interleaved: medians, and the median over pairs of each against the first.

    benches/lean/pairs.py 5 full=target/release/twopass,--plan,full lean=target/release/twopass,--plan,lean -- SCENE --spp 64

A variant is NAME=PROGRAM[,FLAG...]; what follows -- goes to all of them. One thread each, loading and writing left out."""
import json
import os
import statistics
import subprocess
import sys
import tempfile

split = sys.argv.index("--")
repeats = int(sys.argv[1])
variants = [argument.split("=", 1) for argument in sys.argv[2:split]]
common = sys.argv[split + 1 :]
seconds = {name: [] for name, _ in variants}
stages = {name: {} for name, _ in variants}
pictures = {}
with tempfile.TemporaryDirectory() as folder:
    for repeat in range(repeats):
        for name, spec in variants if repeat % 2 == 0 else variants[::-1]:
            program, *flags = spec.split(",")
            report, out = os.path.join(folder, "report.json"), os.path.join(folder, name + ".exr")
            command = [program, "render", *common, *flags, "--threads", "1", "-q", "-o", out, "--report", report]
            subprocess.run(command, check=True)
            cpu = {s["name"]: s["cpu_s"] for s in json.load(open(report))["stages"]}
            seconds[name].append(sum(v for stage, v in cpu.items() if stage not in ("load", "write")))
            for stage, v in cpu.items():
                stages[name].setdefault(stage, []).append(v)
            pictures[name] = open(os.path.join(folder, name + ".png"), "rb").read()
first = variants[0][0]
for name, times in seconds.items():
    ratio = statistics.median(a / b for a, b in zip(seconds[first], times))
    same = "same picture" if pictures[name] == pictures[first] else "ANOTHER PICTURE"
    by_stage = ", ".join(f"{stage} {statistics.median(v):.3f}" for stage, v in stages[name].items())
    print(f"{name}: {statistics.median(times):.3f} CPU s, {first}/{name} {ratio:.3f}, {same}; {by_stage}")

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Gives every option of l4dtrain that takes a value numbers out of any range.

hostile_options.py L4DTRAIN CAPTURE RUN SCENE.ply, in a folder of its own. Each command has 2 GB of
memory and 60 s. It succeeds, or ends with one line and the status of wrong usage, wrong input or a
limit.
"""

import re
import resource
import shutil
import subprocess
import sys

VALUES = ["0", "-1", "1e-30", "1e30", "nan", "inf", "", "99999999999999999999"]
FINE = {0, 2, 3, 6}
# Long where the value is valid, and tested as `--time` and `--steps` otherwise.
ENDLESS = {("--checkpoint-every", "1e-30")}


def run(command):
    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))

    return subprocess.run(command, capture_output=True, text=True, timeout=60, preexec_fn=limit)


def options_of(tool, verb):
    text = run([tool, verb, "--help"]).stdout
    return re.findall(r"^\s+(?:-\w,)?(--[\w-]+) (?:TEXT|N|FILE|FOLDER)\b", text, re.MULTILINE)


def main():
    tool, capture, done, scene = sys.argv[1:]
    common = {"--threads": "1"}
    verbs = {
        "train": ([capture, "-o", "x"],
                  common | {"--steps": "3", "--gaussians": "50", "--sh-degree": "0"}),
        "inspect": ([capture], common),
        "capture": ([scene, "-o", "x"], common | {"--cameras": "3", "--size": "16x16", "--frames": "1"}),
        "eval": ([done], common),
    }
    count, wrong = 0, []
    for verb, (arguments, usual) in verbs.items():
        options = options_of(tool, verb)
        assert "--threads" in options, (verb, options)
        for option in options:
            if option in ("--output", "--sheet"):
                continue
            for value in VALUES:
                if (option, value) in ENDLESS:
                    continue
                shutil.rmtree("x", ignore_errors=True)
                others = {k: v for k, v in usual.items() if k != option}
                if option == "--time":
                    del others["--steps"]
                command = [tool, verb, "-q", *arguments, f"{option}={value}"]
                command += [f"{k}={v}" for k, v in others.items()]
                count += 1
                try:
                    result = run(command)
                except subprocess.TimeoutExpired:
                    wrong.append(f"{command}: does not end")
                    continue
                lines = result.stderr.splitlines()
                if result.returncode not in FINE or (result.returncode != 0 and len(lines) != 1):
                    wrong.append(f"{command}: status {result.returncode}: {result.stderr}")
    shutil.rmtree("x", ignore_errors=True)
    print("\n".join(wrong))
    if wrong or count < 300:
        sys.exit(f"{len(wrong)} of {count} commands do not end as they should")


if __name__ == "__main__":
    main()

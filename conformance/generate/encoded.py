# SPDX-License-Identifier: Apache-2.0
"""Vectors of the production encoder: what files in use look like. Small scenes of `l4dcodec synth`, each coded
with every preset."""

import subprocess
import tempfile
from pathlib import Path

from catalogue import Vector

SCENES = {
    "room": ["--gaussians", "250", "--seconds", "1", "--seed", "1"],
    "flicker": ["--gaussians", "200", "--seconds", "4", "--seed", "2", "--effects", "static,flicker,appear"],
    "moving": ["--gaussians", "200", "--seconds", "2", "--fps", "25", "--seed", "3", "--effects",
               "rigid,deform,view"]}
FEW = ["--set", "merge-count=0", "--set", "merge-fraction=0", "--codebook", "all=64", "--threads", "1"]
PRESETS = {name: ["--preset", name, *FEW] for name in (
    "default", "tiny", "small", "large", "archive", "indexed", "indexed-small", "indexed-high", "paper-small",
    "paper-large")}
for name in ("indexed", "indexed-small", "indexed-high"):
    PRESETS[name] = [*PRESETS[name], "--profile", "indexed"]
for name in ("paper-small", "paper-large"):
    PRESETS[name] = [*PRESETS[name], "--set", "prune-weight=-1"]
PRESETS["lossless"] = ["--preset", "lossless", "--threads", "1", "--set", "merge-count=0"]
# What presets leave to chance in scenes so small.
EXTRA = {"default-zstd": [*PRESETS["default"], "--set", "rans=0"],
         "indexed-zstd": [*PRESETS["indexed"], "--set", "rans=0", "--set", "page-size=64"],
         "rcq": ["--preset", "default", *FEW[:4], "--rcq", "always", "--rcq-size", "8", "--set", "coding=0",
                 "--codebook", "all=32"],
         "tiers": [*PRESETS["default"], "--tiers", "0.15,0.5"],
         "stages": ["--preset", "indexed", "--profile", "indexed", *FEW[:4], "--codebook", "all=16", "--stages",
                    "all=1,0.5,0.25"]}


def commands():
    """(name, scene, options)"""
    for scene in SCENES:
        for preset, options in PRESETS.items():
            yield f"{scene}-{preset}", scene, options
    for name, options in EXTRA.items():
        yield f"room-{name}", "room", options


def vectors(folder, tool):
    with tempfile.TemporaryDirectory() as work:
        if tool is not None:
            for scene, options in SCENES.items():
                run(tool, "synth", "--scene", "cloud", *options, "-o", f"{work}/{scene}.ply")
        for name, scene, options in commands():
            path = Path(folder) / "vectors" / "core" / f"encoder-{name}.l4d"
            if tool is not None:
                path = Path(work) / f"{name}.l4d"
                run(tool, "encode", f"{work}/{scene}.ply", "--no-first-view", "-o", str(path), *options)
            words = " ".join(["l4dcodec synth --scene cloud", *SCENES[scene], f"-o {scene}.ply && l4dcodec encode", f"{scene}.ply",
                              "--no-first-view", *options])
            yield Vector("core", f"encoder-{name}", "a stream of the production encoder", path.read_bytes(),
                         ["DEC-1", "DEC-2", "LAYR-2"], words, ends=True)


def run(tool, *arguments):
    done = subprocess.run([tool, *arguments, "-q"], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{arguments}: {done.stderr}")

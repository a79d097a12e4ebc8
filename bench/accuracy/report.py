#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes pages with tables and plots of what bench_accuracy wrote.

usage: report.py RESULTS.json FOLDER

Writes accuracy.md and ablations.md. Images go to the folder next to the page that has its name.
Sections that the results lack are left out. Every figure in the text is taken from the results.
"""

import json
import pathlib
import sys

import chapters
import chapters_ablations
import chapters_presets
import chapters_rate
import chapters_speed
import chapters_ways

# Section of the results, title, what writes it.
CHOICE = (("presets", "Which preset", chapters_presets.presets),
          ("ways", "What time buys", chapters_ways.ways),
          ("device-ways", "What time buys on a CUDA device", chapters_ways.device_ways))
ACCURACY = (
    ("presets", "Presets in detail", chapters_presets.details),
    ("jod", "Presets to the eye", chapters_presets.jod),
    ("device", "Presets on a CUDA device", chapters_presets.device),
    ("final", "Quality, bytes and layers in detail", chapters.final),
    ("rate", "Fidelity against bytes", chapters_rate.rate),
    ("sensitivity", "Importance weights: how many views", chapters.sensitivity),
    ("effort", "Effort", chapters_speed.effort),
    ("decoder", "Decoder", chapters_speed.decoder),
    ("renderer", "Renderer", chapters_speed.renderer),
    ("stages", "Where an encoder's time goes", chapters_speed.stages),
)
ABLATIONS = (
    ("ablation", "What each part brings", chapters_ablations.ablation),
    ("codebooks", "Codebook sizes", chapters_ablations.codebooks),
    ("thresholds", "Escape thresholds", chapters_ablations.thresholds),
    ("rcq", "Residual codebook quantisation", chapters_ablations.rcq),
    ("effects", "Effects", chapters_ablations.effects),
)

ACCURACY_TITLE = """\
# Accuracy against time and bytes

*basketball* is a trained scene of 213,874 Gaussians and 5 s. *Fidelity* says how close pictures of a stream are to pictures of the
scene that it codes. Which parts of the codec bring it: [ablations](ablations.md).
"""
ACCURACY_METHOD = """\
## How this is measured

`./dev bench accuracy` makes this page, its plots and the page of [ablations](ablations.md). It wants
the basketball scene (`$L4D_DATA_DIR`, else `../shared/data`); `./dev bench accuracy --quick` makes
the same pages of a small synthetic scene. Each section runs alone with the command under its title and keeps the
results of the others, which lie in `docs/accuracy/results.json`. Measured weights are kept beside the results
(`weights*.bin`): delete those after a change of the renderer.

*Fidelity* is the PSNR of the mean squared error between renders of the decoded and of the original
scene, both clamped to [0, 1]: it says how well a codec keeps the model that it was given, whatever
that model is worth. *Ratio* is the float32 numbers of all given Gaussians (260 bytes each at SH
degree 3) over the bytes of the file. Weights are Gauss-Newton weights, measured by the renderer
from the training views, unless a table says otherwise. Fidelity is over all cameras: at every 15th
frame in "Quality, bytes and layers in detail", at four instants in the others. CPU seconds are those of
all threads, which other work on the machine disturbs little.

Only "What time buys" prunes and fits opacities, as the tool does by default if cameras are given; it has the other figures
with `encode --refit 0`. README and [decision 23](decisions/0023-prune-refit-check.md) have more figures of fits.
"""
ABLATIONS_INTRODUCTION = """\
# Ablations

What each part of the codec brings: the tables and figures of the paper's ablations, and scenes of
one effect each. `./dev bench accuracy` makes this page; [accuracy](accuracy.md) says what its
columns mean. Unless a table says otherwise, components have codebooks of one stage of 4096
codewords, and fidelity is over all cameras at four instants. Differences of 0.2 dB can be chance
([0008](decisions/0008-codebooks-follow-the-quality.md)).
"""


def machine(section):
    m = section["machine"]
    return f"{m['cpu']}, {m['cores']} core{'s' if m['cores'] != 1 else ''}"


def chapters_of(document, chapter_list, folder):
    parts = []
    for name, title, chapter in chapter_list:
        if name not in document["sections"]:
            continue
        section = document["sections"][name]
        parts.append(f"## {title}\n")
        parts.append(f"`{section['command']}` ({section['seconds']:.0f} s; {machine(section)})\n")
        parts += chapter(section["tables"], folder)
    return parts


def builds_of(document, chapter_list):
    builds = sorted({document["sections"][name]["build"] for name, _, _ in chapter_list
                     if name in document["sections"]})
    return "Builds: " + " / ".join(builds) + ".\n"


def toy_warning(document):
    return ["**A quick run: its figures are of a toy scene and prove nothing about real ones.**\n"] if document["quick"] else []


def accuracy_page(document, folder):
    return [ACCURACY_TITLE, *toy_warning(document), *chapters_of(document, CHOICE, folder), ACCURACY_METHOD,
            builds_of(document, CHOICE + ACCURACY), *chapters_of(document, ACCURACY, folder)]


def ablations_page(document, folder):
    return [ABLATIONS_INTRODUCTION, builds_of(document, ABLATIONS), *toy_warning(document),
            *chapters_of(document, ABLATIONS, folder)]


def main(arguments):
    if len(arguments) != 2:
        print(__doc__.strip())
        return 2
    document = json.loads(pathlib.Path(arguments[0]).read_text(encoding="utf-8"))
    folder = pathlib.Path(arguments[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, chapter_list, make in (("accuracy", ACCURACY, accuracy_page), ("ablations", ABLATIONS, ablations_page)):
        if any(section in document["sections"] for section, _, _ in chapter_list):
            page = folder / f"{name}.md"
            page.write_text("\n".join(make(document, folder / name)).rstrip("\n") + "\n", encoding="utf-8")
            print(page)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

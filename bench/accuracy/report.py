#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes a page with tables and plots of what bench_accuracy wrote.

usage: report.py RESULTS.json PAGE.md

Images go to the folder beside the page that has its name. Sections that the results lack are left
out. Every figure in the text is taken from the results.
"""

import json
import pathlib
import sys

import chapters
import chapters_presets
import chapters_rate
import chapters_speed

CHAPTERS = (
    ("presets", "Which preset", chapters_presets.presets),
    ("device", "Which preset, on a CUDA device", chapters_presets.device),
    ("final", "Quality, bytes and layers in detail", chapters.final),
    ("rate", "Fidelity against bytes", chapters_rate.rate),
    ("ladder", "One tool at a time", chapters_rate.ladder),
    ("crossover", "Transforms and codebooks, part by part", chapters_rate.crossover),
    ("second", "A second scene", chapters_rate.second),
    ("sensitivity", "Importance weights: how many views", chapters.sensitivity),
    ("kmeans", "k-means: iterations and training points", chapters.kmeans),
    ("codebooks", "Codebook sizes", chapters.codebooks),
    ("thresholds", "Escape thresholds", chapters.thresholds),
    ("rcq", "Residual codebook quantisation", chapters.rcq),
    ("ablation", "What each part brings", chapters.ablation),
    ("effort", "Effort", chapters_speed.effort),
    ("decoder", "Decoder", chapters_speed.decoder),
    ("renderer", "Renderer", chapters_speed.renderer),
    ("effects", "Effects", chapters_speed.effects),
    ("stages", "Where an encoder's time goes", chapters_speed.stages),
)

INTRODUCTION = """\
# Accuracy against time and bytes

`./dev bench accuracy` makes this page and its plots. It wants the basketball scene
(`$L4D_DATA_DIR`, else `../shared/data`); `./dev bench accuracy --quick` makes the same page of a
small synthetic scene. Each section runs alone with the command under its title and keeps the
results of the others, which lie in `docs/accuracy/results.json`. Measured weights are kept in
`build/accuracy/weights*.bin`: delete those after a change of the renderer.

*Fidelity* is the PSNR of the mean squared error between renders of the decoded and of the original
scene, both clamped to [0, 1]: it says how well a codec keeps the model that it was given, whatever
that model is worth. *Ratio* is the float32 numbers of all given Gaussians (260 bytes each at SH
degree 3) over the bytes of the file. Weights are Gauss-Newton weights, measured by the renderer
from the training views, unless a table says otherwise. Fidelity is over all cameras: at every 15th
frame in the third section, at four instants in the others. Sections on codebooks use one stage of
4096 codewords per component. Seconds of encoding are CPU seconds of all threads, which other work
on the machine disturbs little.
"""


def machine(section):
    m = section["machine"]
    return f"{m['cpu']}, {m['cores']} core{'s' if m['cores'] != 1 else ''}"


def page_of(document, folder):
    sections = document["sections"]
    parts = [INTRODUCTION]
    seen = []
    for name, _, _ in CHAPTERS:
        if name in sections and machine(sections[name]) not in seen:
            seen.append(machine(sections[name]))
    builds = sorted({s["build"] for s in sections.values()})
    parts.append("Measured on: " + "; ".join(seen) + ". Build: " + " / ".join(builds) + ".\n")
    if document["quick"]:
        parts.append("**A quick run: its figures are of a toy scene and prove nothing about real "
                     "ones.**\n")
    for name, title, chapter in CHAPTERS:
        if name not in sections:
            continue
        section = sections[name]
        parts.append(f"## {title}\n")
        parts.append(f"`{section['command']}` ({section['seconds']:.0f} s)\n")
        parts += chapter(section["tables"], folder)
    return "\n".join(parts)


def main(arguments):
    if len(arguments) != 2:
        print(__doc__.strip())
        return 2
    document = json.loads(pathlib.Path(arguments[0]).read_text(encoding="utf-8"))
    page = pathlib.Path(arguments[1])
    page.parent.mkdir(parents=True, exist_ok=True)
    text = page_of(document, page.parent / page.stem)
    page.write_text(text.rstrip("\n") + "\n", encoding="utf-8")
    print(page)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs all sections of bench_accuracy on a tiny scene and checks what it writes.

usage: quick_test.py PROGRAM
"""

import json
import math
import pathlib
import subprocess
import sys
import tempfile

SECTIONS = ("presets", "jod", "ways", "final", "rate", "sensitivity", "effort", "decoder", "renderer", "stages",
            "ablation", "codebooks", "thresholds", "rcq", "effects")
# Only captured images fill it, and synthetic scenes have none.
MAY_BE_EMPTY = {("final", "uncompressed")}


def rows(document, section, table):
    return document["sections"][section]["tables"][table]


def figures(document):
    """Yields a message per value that is missing, and per number that is not finite."""
    for section in SECTIONS:
        if section not in document["sections"]:
            yield f"{section}: is missing"
            continue
        if f"--only {section}" not in document["sections"][section]["command"]:
            yield f"{section}: without its command"
        for table, content in document["sections"][section]["tables"].items():
            if not content and (section, table) not in MAY_BE_EMPTY:
                yield f"{section}, {table}: has no rows"
            for row in content:
                for key, value in row.items():
                    # JSON has no infinity: what is not finite was written as null.
                    if value is None or (isinstance(value, float) and not math.isfinite(value)):
                        yield f"{section}, {table}: {key} is not finite"


def layout(document, text):
    """Yields a message unless each row of each table is a line of its own."""
    lines = [json.loads(line.strip().rstrip(",")) for line in text.split("\n")
             if line.startswith("     {")]
    tables = [t for s in document["sections"].values() for t in s["tables"].values()]
    if lines != [row for table in tables for row in table]:
        yield "the document does not have a row a line"


def relations(document):
    """Yields a message per relation between figures that does not hold."""
    for row in rows(document, "presets", "presets"):
        if not (20 < row["fidelity_db"] <= 100 and row["worst_position"] >= 0 and
                row["worst_covariance"] >= 1 and 0 <= row["worst_opacity"] <= 1):
            yield f"presets: implausible: {row}"
        if not (row["decode_s"] > 0 and row["first_slice_s"] > 0 and row["encode_s"] > 0 and
                row["slice_memory_bytes"] > 0):
            yield f"presets: took no time or no memory: {row}"
    for row in rows(document, "jod", "jod"):
        if not 0 < row["min_jod"] <= row["jod"] <= 10:
            yield f"jod: implausible: {row}"
    for row in rows(document, "final", "codings"):
        if not (row["ratio"] > 1 and 20 < row["fidelity_db"] <= 100 and
                row["min_view_db"] <= row["fidelity_db"]):
            yield f"final: implausible: {row}"
    for row in rows(document, "ways", "ways"):
        if not (20 < row["fidelity_db"] <= 100 and row["bytes"] > 0 and row["seconds"] > 0):
            yield f"ways: implausible: {row}"
    transforms = rows(document, "rate", "transforms")
    worst, best = transforms[0], transforms[-1]
    if not (best["bytes"] > worst["bytes"] and best["fidelity_db"] > worst["fidelity_db"]):
        yield "rate: a higher quality is not larger and better than a lower one"
    for row, whole in zip(rows(document, "final", "sections"), rows(document, "final", "codings")):
        if sum(v for v in row.values() if isinstance(v, int)) != whole["bytes"]:
            yield f"final: the sections of {row['name']} do not add up to the file"
    most = max(rows(document, "sensitivity", "views")[:-1], key=lambda r: r["views_measured"])
    if most["spearman_sh"] != 1:
        yield "sensitivity: the most views do not agree with themselves"
    if any(row["error"] != 0 or row["compared_bytes"] == 0
           for row in rows(document, "decoder", "paths")):
        yield "decoder: not exact"
    for row in rows(document, "renderer", "paths"):
        if row["name"] != "double" and not (0 < row["rms_error"] < 1e-3):
            yield f"renderer: implausible: {row}"
    for row in rows(document, "effort", "efforts"):
        if not row["relative_time"] > 0:
            yield f"effort: implausible: {row}"
    effects = rows(document, "effects", "effects")
    if not effects[0]["bytes_per_gaussian"] < effects[-1]["bytes_per_gaussian"]:
        yield "effects: a static scene is no smaller than one with all effects"


def check_report(results, folder):
    """Makes the report where matplotlib is there. Yields messages."""
    script = pathlib.Path(__file__).resolve().parent / "report.py"
    for python in (sys.executable, "/usr/bin/python3"):
        probe = subprocess.run([python, "-c", "import matplotlib"], capture_output=True,
                               check=False)
        if probe.returncode == 0:
            break
    else:
        print("no matplotlib: the report is not checked")
        return
    subprocess.run([python, "-B", str(script), str(results), str(folder)], check=True)
    pages = {name: (folder / f"{name}.md").read_text(encoding="utf-8")
             for name in ("accuracy", "ablations")}
    for section in SECTIONS:
        if sum(f"--only {section}`" in text for text in pages.values()) != 1:
            yield f"report: {section} is not on one page"
    for name, text in pages.items():
        for image in sorted((folder / name).iterdir()):
            if image.stat().st_size < 1000:
                yield f"report: {image.name} is empty"
            if image.suffix != ".png" or f"{name}/{image.name}" not in text:
                yield f"report: {image.name} is in no place of {name}.md"


def main(arguments):
    if len(arguments) != 1:
        print(__doc__.strip())
        return 2
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        results = folder / "quick.json"
        subprocess.run([arguments[0], "--quick", "--gaussians", "2000", "--rows", "2", "--json",
                        str(results)], check=True, stderr=subprocess.DEVNULL)
        text = results.read_text(encoding="utf-8")
        document = json.loads(text)
        messages = list(figures(document)) + list(layout(document, text))
        if not messages:
            messages += list(relations(document)) + list(check_report(results, folder))
        for message in messages:
            print(message)
        print(f"{len(document['sections'])} sections, {len(messages)} complaints")
        return 1 if messages else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

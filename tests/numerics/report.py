#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes what l4d_numerics_test observed between the markers of a page, and its plot.

usage: report.py RESULTS.json PAGE.md
       report.py --check PAGE.md PROGRAM   fails where the page lacks a formula of the program, or
                                           has one that is none; figures are not compared

RESULTS.json is what the program writes to $L4D_NUMERICS_JSON. The plot goes to the folder beside
the page that has its name.
"""

import json
import pathlib
import re
import subprocess
import sys

GREY, BLUE, ORANGE = "#7d858f", "#3b82f6", "#e8770c"


def figure(value):
    if value == "inf":
        return "not finite"
    return "0" if value == 0 else f"{value:.3g}"


def cell(text):
    return text.replace("|", "\\|").replace("<", "&lt;").replace(">", "&gt;")


def table(titles, rows):
    lines = ["| " + " | ".join(titles) + " |", "|" + "---|" * len(titles)]
    lines += ["| " + " | ".join(map(cell, row)) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def formulas(document, prefix):
    rows = []
    for name, f in document["formulas"].items():
        if not name.startswith(prefix + "_"):
            continue
        naive = ""
        if "observed_naive" in f:
            naive = f"{f['naive']}: {figure(f['observed_naive'])}"
        rows.append((f"`{name}`", f"{f['ours']} against {f['oracle']}; {f['domain']}", f["error"],
                     figure(f["bound"]), f["origin"], figure(f["observed"]), naive))
    return table(("formula", "what, against what, where", "error", "bound", "where it comes from",
                  "observed", "naive, observed"), rows)


def schur(document, _):
    def cells(method):
        return (figure(method["median"]), figure(method["p99"]), figure(method["max"]),
                f"{100 * method['not_positive_definite']:.2g} %")
    rows = [(r["kind"], name, *cells(r[key])) for r in document["schur"]
            for key, name in (("schur", "Schur complement"), ("ours", "projected rows"))]
    return table(("scene", "method", "median", "p99", "max", "not positive definite"), rows)


def bounds(document, _):
    def cells(key):
        show = str if key == "bytes" else figure
        return [" to ".join(show(r[way][key]) for way in ("without", "with")) for r in rows]
    rows = document["bounds"]
    columns = [cells(key) for key in ("position", "covariance", "opacity", "bytes")]
    return table(("scene", "preset", "position, sizes", "covariance, factor", "opacity", "bytes",
                  "escapes"),
                 [(r["scene"], r["preset"], *figures, str(r["escapes"]))
                  for r, *figures in zip(rows, *columns)])


def plot(series, folder):
    import matplotlib
    matplotlib.use("agg")
    import matplotlib.pyplot as plt
    plt.rcParams.update({
        "figure.facecolor": "none", "axes.facecolor": "none", "savefig.facecolor": "none",
        "legend.framealpha": 0, "text.color": GREY, "axes.labelcolor": GREY,
        "axes.edgecolor": GREY, "xtick.color": GREY, "ytick.color": GREY, "font.size": 10,
        "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
        "grid.color": GREY, "grid.alpha": 0.25, "font.family": "sans-serif"})
    drawing, axes = plt.subplots(figsize=(8, 4.4))
    scales = [p["temporal_scale"] for p in series]
    for key, name, colour in (("schur", "Schur complement", ORANGE),
                              ("ours", "projected rows", BLUE)):
        axes.plot(scales, [p[key]["median"] for p in series], "o-", color=colour,
                  label=f"{name}, median", markersize=4)
        axes.plot(scales, [p[key]["p99"] for p in series], "--", color=colour,
                  label=f"{name}, 99th percentile")
    axes.set(xscale="log", yscale="log", xlabel="temporal scale (s)",
             ylabel="relative error of the covariance in binary32")
    axes.legend()
    folder.mkdir(parents=True, exist_ok=True)
    drawing.tight_layout()
    drawing.savefig(folder / "schur.png", dpi=130, metadata={"Software": None})


MAKERS = {"formulas": formulas, "schur": schur, "bounds": bounds}
BLOCK = re.compile(r"(<!-- (\w+)(?: (\w+))?: written by tests/numerics/report.py -->\n)"
                   r".*?(<!-- end -->)", re.S)


def write(results, page):
    document = json.loads(results.read_text(encoding="utf-8"))
    text = page.read_text(encoding="utf-8")
    text = BLOCK.sub(lambda m: m[1] + MAKERS[m[2]](document, m[3]) + m[4], text)
    page.write_text(text, encoding="utf-8")
    plot(document["schur_series"], page.parent / page.stem)
    missing = set(document["formulas"]) - names_of(text)
    if missing:
        print("the page has no place for " + ", ".join(sorted(missing)), file=sys.stderr)
        return 1
    return 0


def names_of(text):
    return {name for block in BLOCK.finditer(text)
            for name in re.findall(r"^\| `(\w+)` \|", block[0], re.M)}


def check(page, program):
    listed = set(subprocess.run([program, "--names"], check=True, capture_output=True,
                                text=True).stdout.split())
    written = names_of(page.read_text(encoding="utf-8"))
    for name in sorted(listed - written):
        print(f"{page} lacks {name}", file=sys.stderr)
    for name in sorted(written - listed):
        print(f"{page} has {name}, which is no formula", file=sys.stderr)
    print(f"{len(listed)} formulas, {len(written)} in {page}")
    return 0 if listed and listed == written else 1


def main(arguments):
    if len(arguments) == 3 and arguments[0] == "--check":
        return check(pathlib.Path(arguments[1]), arguments[2])
    if len(arguments) == 2:
        return write(pathlib.Path(arguments[0]), pathlib.Path(arguments[1]))
    print(__doc__.strip())
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

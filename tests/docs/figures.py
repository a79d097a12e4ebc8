#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks that documents have the same figure for the same file, and prints cheap ones again.

    figures.py               figures of several pages against docs/accuracy/results.json and against each other
    figures.py TOOL SCENE    encodes a scene and compares bytes with what the pages say. SCENE: square, that of
                             docs/place.md; basketball, which says SKIPPED where L4D_DATA_DIR does not have it
    figures.py --write TOOL  writes all of these into the pages
    figures.py --self-test   shows that a figure that is off by its last digit is found

Bytes do not depend on the number of threads. Where importance is measured from views they depend a little on the vector
unit of the machine, since renders round as it does: figures of such encodes may be off by 0.3 %.
"""

import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
RESULTS = json.loads((ROOT / "docs/accuracy/results.json").read_text(encoding="utf-8"))["sections"]


def row(section, table, name):
    return next(r for r in RESULTS[section]["tables"][table] if r["name"] == name)


def of_presets(name):
    return row("presets", "presets", name)


def raw_bytes():
    """The float32 numbers of all Gaussians of the scene: what ratios are relative to."""
    default = of_presets("default")
    return default["bytes"] * default["ratio"]


def measured(name):
    r = of_presets(name)
    return r["bytes"] / 1e6, r["ratio"], r["fidelity_db"]


def unmeasured(name):
    r = of_presets(name)
    return r["bytes_unweighted"] / 1e6, raw_bytes() / r["bytes_unweighted"], r["fidelity_unweighted_db"]


def refitted():
    page = read_page("docs/decisions/0023-prune-refit-check.md")
    made = int(re.search(r"\(the default\) \| ([\d,]+) \|", page)[1].replace(",", ""))
    return made / 1e6, raw_bytes() / made


def extremes():
    sizes = [of_presets(name)["bytes"] / 1e6 for name in ("tiny", "archive")]
    return min(sizes), max(sizes)


# A page, a pattern whose groups are figures, and what these are.
FIGURES = (
    ("README.md", r"`encode basketball\.ply` \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) dB", lambda: unmeasured("default")),
    ("README.md", r"`encode basketball\.ply --preset tiny` \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) dB",
     lambda: unmeasured("tiny")),
    ("README.md", r"`encode basketball\.ply --cameras cameras\.json --refit 0` \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) dB",
     lambda: measured("default")),
    ("README.md", r"--cameras cameras\.json --refit 0 --preset tiny` \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) dB", lambda: measured("tiny")),
    ("README.md", r"--cameras cameras\.json --refit 0 --preset archive` \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) dB",
     lambda: measured("archive")),
    ("README.md", r"`encode basketball\.ply --cameras cameras\.json` \| ([\d.]+) \| ([\d.]+) \|", refitted),
    ("README.md", r"makes them (\d+) to (\d+) times smaller", lambda: (unmeasured("default")[1], measured("tiny")[1])),
    ("README.md", r"a stream of this\nproject takes ([\d.]+) to ([\d.]+) MB", extremes),
    ("docs/cli.md", r"of \*basketball\* \(5 s, ([\d.]+) MB\)", lambda: (of_presets("default")["bytes_unweighted"] / 1e6,)),
)


def differs(printed, value, slack=0):
    """Whether value, rounded to as many digits as are printed, is another figure. slack: relative."""
    digits = len(printed.partition(".")[2])
    return abs(float(printed) - value) > 0.5 * 10 ** -digits * (1 + 1e-9) + slack * value


def rounded_as(printed, value):
    return f"{value:.{len(printed.partition('.')[2])}f}"


def written(text, pattern, values, flags=0):
    """The text with the groups of the pattern replaced by values, with as many digits as there were."""
    found = re.search(pattern, text, flags)
    if found is None:
        raise SystemExit(f"nothing like {pattern}")
    for group in range(len(values), 0, -1):
        begin, end = found.span(group)
        text = text[:begin] + rounded_as(found[group], values[group - 1]) + text[end:]
    return text


def write_all(tool):
    figures = [(page, pattern, values(), 0, 0) for page, pattern, values in FIGURES]
    for scene in SCENES:
        with tempfile.TemporaryDirectory() as folder:
            figures += [(page, pattern, (made,), re.DOTALL, slack) for page, pattern, made, slack in SCENES[scene](tool, folder)]
    for page, pattern, values, flags, slack in figures:
        text = read_page(page)
        found = re.search(pattern, text, flags)
        if slack and found and not differs(found[1], values[0], slack):
            continue  # another machine's figure
        changed = written(text, pattern, values, flags)
        if changed != text:
            print(f"{page}: {re.search(pattern, changed, flags)[0][-80:]}")
            (ROOT / page).write_text(changed, encoding="utf-8")


def problems(read, figures=FIGURES):
    for page, pattern, values in figures:
        found = re.search(pattern, read(page))
        if found is None:
            yield f"{page}: nothing like {pattern}"
            continue
        expected = values()
        if len(expected) != len(found.groups()):
            yield f"{page}: {len(found.groups())} figures where {len(expected)} are known: {pattern}"
        for printed, value in zip(found.groups(), expected):
            if differs(printed, value):
                yield f"{page}: {printed} where the results have {value:.6g}: {found[0]}"


def read_page(page):
    return (ROOT / page).read_text(encoding="utf-8")


# Relative: what renders on other vector units change.
MEASURED = 0.003


def coded_megabytes(tool, folder, *arguments):
    subprocess.run([tool, "encode", *arguments, "-o", "out.l4d", "--force"], cwd=folder, check=True, capture_output=True)
    return (pathlib.Path(folder) / "out.l4d").stat().st_size / 1e6


def figures_of_square(tool, folder):
    subprocess.run([tool, "synth", "-n", "100k", "-o", "square.ply"], cwd=folder, check=True, capture_output=True)
    for preset in ("default", "tiny"):
        made = coded_megabytes(tool, folder, "square.ply", "--preset", preset)
        yield "docs/place.md", rf"\*\*100,000 Gaussians.*?\| {preset} \| ([\d.]+) \|", made, MEASURED


def figures_of_basketball(tool, folder):
    scene = pathlib.Path(os.environ.get("L4D_DATA_DIR", ROOT.parent / "shared/data")).resolve() / "basketball/basketball.ply"
    if not scene.is_file():
        print("SKIPPED: L4D_DATA_DIR has no basketball")
        return
    made = coded_megabytes(tool, folder, scene)
    yield "README.md", r"`encode basketball\.ply` \| ([\d.]+)", made, MEASURED
    yield "docs/accuracy.md", r"unmeasured: encode s.*?\| default \| [\d.]+ \| [\d.]+ \| [\d.]+ \| ([\d.]+) \|", made, MEASURED
    for preset in ("default", "archive"):
        made = coded_megabytes(tool, folder, scene, "--preset", preset, "--estimate", "--no-first-view")
        yield "docs/numerics.md", rf"\n\| basketball \| {preset} \|[^\n]*\| (\d+) \|\n", 1e6 * made, 0


SCENES = {"square": figures_of_square, "basketball": figures_of_basketball}


def printed_again(tool, scene):
    with tempfile.TemporaryDirectory() as folder:
        for page, pattern, made, slack in SCENES[scene](tool, folder):
            print(f"{page}: {made:.6f}")
            found = re.search(pattern, read_page(page), re.DOTALL)
            if found is None:
                yield f"{page}: nothing like {pattern}"
            elif differs(found[1], made, slack):
                yield f"{page}: {found[1]} where the tool makes {made:.6f}"


def self_test():
    assert not differs("3.59", 3.589055) and differs("3.58", 3.589055) and differs("3.60", 3.589055)
    assert not differs("3589055", 3589055) and differs("3589054", 3589055)
    assert not differs("3.59", 3.60, MEASURED) and differs("3.59", 3.61, MEASURED)
    figures = (("page", r"takes ([\d.]+) MB", lambda: (2.456,)),)
    assert not list(problems(lambda _: "takes 2.46 MB", figures))
    assert len(list(problems(lambda _: "takes 2.45 MB", figures))) == 1
    assert len(list(problems(lambda _: "has 2.46 MB", figures))) == 1
    assert written("takes 2.40 to 9 MB", r"takes ([\d.]+) to (\d+) MB", (2.456, 10.7)) == "takes 2.46 to 11 MB"
    print("finds what it should")


def main():
    if sys.argv[1:] == ["--self-test"]:
        return self_test()
    if sys.argv[1:2] == ["--write"] and len(sys.argv) == 3:
        return write_all(pathlib.Path(sys.argv[2]).resolve())
    if len(sys.argv) == 1:
        found = list(problems(read_page))
    elif len(sys.argv) == 3 and sys.argv[2] in SCENES:
        found = list(printed_again(pathlib.Path(sys.argv[1]).resolve(), sys.argv[2]))
    else:
        raise SystemExit(__doc__)
    print("\n".join(found) if found else "all figures agree")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())

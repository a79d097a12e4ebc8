#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Counts how often the rules that everybody needs are written in the source: once each.

    once.py              prints each rule with its places; exit status 1 where one stands elsewhere
    once.py --self-test  shows on small trees that a second copy is found, and a lost first one

Comments do not count, tests neither: a test may know better.
"""
import pathlib
import re
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
FOLDERS = ("include", "libl4dcodec", "decoder", "encoder", "render", "io", "eval", "cli", "training", "python",
           "bench", "web/babylon/src", "web/core/src", "web/playcanvas/src", "web/spark/src", "web/three/src", "web/view/src",
           "web/wasm")
SUFFIXES = {".h", ".hpp", ".cc", ".cu", ".cuh", ".js"}

COMMENT = re.compile(r'//[^\n]*|/\*.*?\*/|"(?:[^"\\\n]|\\.)*"', re.DOTALL)


def code_of(text):
    """The text without comments, line for line; strings stay."""

    def blank(match):
        if match.group(0).startswith('"'):
            return match.group(0)
        return "\n" * match.group(0).count("\n")

    return COMMENT.sub(blank, text)


def matches(pattern):
    """A rule's places: lines on which the pattern begins."""
    compiled = re.compile(pattern)

    def find(code):
        return [code.count("\n", 0, m.start()) + 1 for m in compiled.finditer(code)]

    return find


ATTRIBUTES = ("position", "mean_t", "log_scale", "rotor", "opacity", "sh")
WINDOW = 12  # lines in which all attributes stand where somebody lists them


def attribute_lists(code):
    """Where lists of all attributes begin. Lists do not overlap."""
    names = [re.compile(rf"\b{name}(_\w+)?\b") for name in ATTRIBUTES]
    lines = code.split("\n")
    found, start = [], 0
    for last in range(len(lines)):
        first = max(start, last - WINDOW + 1)
        window = "\n".join(lines[first:last + 1])
        if all(name.search(window) for name in names):
            while first < last and all(
                    name.search("\n".join(lines[first + 1:last + 1])) for name in names):
                first += 1
            found.append(first + 1)
            start = last + 1
    return found


# Rule -> (how to find its places, file -> how often it may stand there at most, and why). The first
# file is the home of the rule, in which it stands exactly so often.
RULES = {
    "falloff: exp(-x^2 / 2)": (
        matches(r"\bexp[fl]?\s*\((?:[^;{}]{0,60}?-\s*0?\.50*f?\b|[^;{}]{0,60}?/\s*-\s*2)"),
        {"libl4dcodec/scene/slice.h": 1,
         "io/image/metrics.cc": 1,  # the window of SSIM
         "web/view/src/rules.js": 2,  # the text of all shaders: of a Gaussian's time, and of a pixel
         "web/view/src/sorter.js": 3}),  # which of them are worth sorting, and meet a ray
    "opacity of a logit: 1 / (1 + exp(-x))": (
        matches(r"\(1\.?0?f?\)? \+ (std::)?expf?\(-|static_cast<T>\(1\) \+ (std::)?exp\(-"),
        {"libl4dcodec/scene/slice.h": 1}),
    "list of attributes": (attribute_lists, {
        # The table, the visitor and the vectors.
        "include/l4d/attributes.hpp": 3,
        # Structs of C.
        "include/l4d/l4d.h": 1,
        "include/l4d/decode.h": 1,
        "include/l4d/cuda.h": 1,
        "include/l4d/render.h": 1,
        # Other code for each attribute: how it is decoded, encoded, made up, written or derived.
        "decoder/expand/expand.cc": 1,
        "decoder/expand/page_decoder.cc": 1,
        "decoder/cuda/expand.cu": 1,
        "decoder/check/validate.cc": 1,
        "decoder/check/inspection.h": 1,  # a page with binary64 times
        "encoder/file/written_check.cc": 1,
        "encoder/prepare/scene.h": 1,
        "encoder/prepare/scene.cc": 2,
        "decoder/session/bucket_cache.cc": 1,
        "io/ply/write_ply.cc": 1,
        "eval/pair/comparison.cc": 1,
        "render/renderer.cc": 1,
        "render/importance/sensitivity.cc": 1,
        "render/cuda/backward/gradient.cu": 2,
        "bench/tables/times.cc": 1,
        # The arrays of a digest, whose order is that of the specification.
        "cli/input/decode_arrays.cc": 1,
        # Rows of a model in training, and the rate of each.
        "training/model/rows.h": 1,
        "training/step/adam.h": 1,
        "training/step/schedule.cc": 1,
        # Rows of a model on a device, which cannot read the table, and its arrays.
        "training/step/adam_row.h": 1,
        "training/density/relocate_row.h": 2,
        "training/cuda/adam.cu": 1,
        "training/cuda/device_model.cc": 3,
        # Addresses that JavaScript is given, and the arrays that it makes of them.
        "web/wasm/bridge.cc": 2,
        "web/core/src/decoder.js": 1,
        # Arrays of a device that are made one by one.
        "bench/gpu/decode_bench.cc": 2,
        "bench/gpu/render_bench.cc": 4}),
    "reading of pages: the gap that one read bridges": (
        matches(r"\bkMaxReadGap\s*="),
        {"decoder/read/page_reads.cc": 1}),
    "images have at most 16384 pixels a side": (
        matches(r"\b16384u?\b"),
        {"include/l4d/render.h": 1,
         "web/core/src/store.js": 1,  # bytes of a read
         "bench/accuracy/sweeps.cc": 1}),  # entries of a codebook
    "scenes have at most 2^24 frames": (
        matches(r"(?i)frames[^;\n]{0,40}\b1u?l*\}? << 24\b|(?i:frames)[^;\n]{0,40}\b16777216\b|"
                r"\bkMaxFrames = \d"),
        {"include/l4d/l4d.h": 1}),
    "SH of degree 0: 0.28209479177387814": (
        matches(r"\b0?\.28209\d*"),
        {"libl4dcodec/scene/sh.h": 1, "web/view/src/rules.js": 1}),
    "SH of degree 3: 2.890611442640554": (
        matches(r"\b2\.8906114\d*"),
        {"libl4dcodec/scene/sh.h": 1,
         "web/view/src/rules.js": 1,  # the text of all shaders
         "io/synth/sh_basis.h": 1}),  # a scene of before, to the last bit of other constants
}


def check_tree(root, rules):
    """(lines of the report, number of rules broken)"""
    texts = {}
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in SUFFIXES and not path.is_relative_to(root / "training" / "tests"):
                relative = path.relative_to(root).as_posix()
                texts[relative] = code_of(path.read_text(encoding="utf-8"))
    report, broken = [], 0
    for rule, (find, allowed) in rules.items():
        places = {}
        for relative, code in texts.items():
            lines = find(code)
            if lines:
                places[relative] = lines
        wrong = []
        for relative in sorted(set(places) | set(allowed)):
            lines, wanted = places.get(relative, []), allowed.get(relative, 0)
            home = relative == next(iter(allowed))
            if len(lines) > wanted or (home and len(lines) < wanted):
                where = ", ".join(f"{relative}:{line}" for line in lines) or relative
                wrong.append(f"  {where}: {len(lines)} times, not {wanted}")
        total = sum(len(lines) for lines in places.values())
        report.append(f"{rule}: {total} in {len(places)} files" + (", WRONG" if wrong else ""))
        report += wrong
        broken += bool(wrong)
    return report, broken


def self_test():
    """Each rule on a tree in which it stands as it should, once more, and not at all."""
    samples = {
        "falloff: exp(-x^2 / 2)": "float f(float q) { return std::exp(-0.5f * q); }",
        "opacity of a logit: 1 / (1 + exp(-x))": "x = 1 / (1 + std::exp(-x));",
        "list of attributes": "a.position;\na.mean_t;\na.log_scale;\na.rotor;\na.opacity;\na.sh;",
        "reading of pages: the gap that one read bridges": "constexpr int kMaxReadGap = 1;",
        "images have at most 16384 pixels a side": "if (width > 16384) return;",
        "scenes have at most 2^24 frames": "#define L4D_MAX_FRAMES (1u << 24)",
        "SH of degree 0: 0.28209479177387814": "constexpr float kDc = 0.28209479f;",
        "SH of degree 3: 2.890611442640554": "basis[10] = 2.890611442640554 * x * y * z;",
    }
    failures = []
    if set(samples) != set(RULES):
        failures.append("a rule has no sample")
    for rule, sample in samples.items():
        find = RULES[rule][0]
        home = "decoder/home.cc"
        cases = [
            ("as it should", {home: sample}, 0),
            ("twice in its home", {home: sample + "\n" + sample}, 1),
            ("in a second file", {home: sample, "io/other.cc": sample}, 1),
            ("nowhere", {home: "int x;"}, 1),
            ("in comments", {home: sample, "io/other.cc": "/* " + sample + " */"}, 0),
            ("in tests", {home: sample, "tests/other.cc": sample}, 0),
        ]
        for name, files, wanted in cases:
            with tempfile.TemporaryDirectory() as folder:
                for path, text in files.items():
                    file = pathlib.Path(folder) / path
                    file.parent.mkdir(parents=True, exist_ok=True)
                    file.write_text(text + "\n", encoding="utf-8")
                broken = check_tree(pathlib.Path(folder), {rule: (find, {home: 1})})[1]
            if broken != wanted:
                failures.append(f"{rule}, {name}: {broken} broken, not {wanted}")
    for failure in failures:
        print("self-test: " + failure)
    print(f"{len(samples)} rules, {len(failures)} failures")
    return not failures


def main(arguments):
    if arguments == ["--self-test"]:
        return 0 if self_test() else 1
    if arguments:
        print(__doc__.strip())
        return 2
    report, broken = check_tree(ROOT, RULES)
    print("\n".join(report))
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

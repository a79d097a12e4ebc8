# SPDX-License-Identifier: Apache-2.0
"""The first chapters of docs/accuracy.md: which preset to take. As in chapters.py."""

import plots
from markdown import SIZE, front, megabytes, table

BYTES_OF_GAUSSIAN = 260  # float32 numbers at SH degree 3, of which `ratio` is


def milliseconds(key):
    return lambda row: row[key] * 1e3


def mebibytes(key):
    return lambda row: row[key] / 1e6


def million_gaussians_a_second(row):
    gaussians = row["ratio"] * row["bytes"] / BYTES_OF_GAUSSIAN
    return gaussians / row["decode_s"] / 1e6


# What each is for, in the order of a reader who chooses.
PURPOSES = {
    "tiny": "thin links, thumbnails", "small": "streaming to phones", "default": "streaming",
    "large": "large screens", "archive": "masters, further editing", "lossless": "the trainer's numbers, kept",
    "indexed-small": "codebooks, for players that draw from indices", "indexed": "the same",
    "indexed-high": "the same", "paper-small": "comparison with the paper", "paper-large": "the same"}


def presets(tables, folder):
    rows = sorted(tables["presets"], key=lambda r: list(PURPOSES).index(r["name"]))
    best = [r["name"] for r in front(rows)]
    return [plots.choice(rows, folder),
            "`encode` alone, and `encode --cameras`, which measures first how much each Gaussian matters to the "
            "pictures of the cameras. It does so once, and serves any number of encodings. Seconds are those of all cores; "
            "*first instant* is what one thread takes to open the file and show the middle of the scene.\n",
            table([("preset", "name", ""), ("for", lambda r: PURPOSES[r["name"]], ""),
                   ("MB", lambda r: r["bytes_unweighted"] / 1e6, ".2f"),
                   ("dB", "fidelity_unweighted_db", ".1f"),
                   ("s", "encode_unweighted_s", ".1f"),
                   ("`--cameras`: MB", megabytes, ".2f"), ("dB", "fidelity_db", ".1f"),
                   ("s", lambda r: r["measure_s"] + r["encode_s"], ".1f"),
                   ("first instant ms", milliseconds("first_slice_s"), ".0f")], rows),
            "With `--cameras` no other preset has both fewer bytes and more fidelity than: "
            f"{', '.join(best)}.\n"]


def details(tables, _):
    rows = tables["presets"]
    measured = sorted({round(r["measure_s"], 1) for r in rows})
    return ["The same run in detail, importance measured from the training "
            "views. *Worst* columns are largest errors of any single Gaussian, in the units of "
            "[the declared bounds](numerics.md#bounds-on-single-gaussians): of its place in its "
            "own sizes (a size is the standard deviation along the largest axis), of its mean time in its "
            "own temporal standard deviations, of its principal "
            "variances as a factor, and of the opacity seen at an instant.\n",
            table([("preset", "name", "")] + SIZE +
                  [("worst place", "worst_position", ".2g"),
                   ("mean time", "worst_mean_time", ".2g"),
                   ("variance", "worst_covariance", ".3g"),
                   ("opacity", "worst_opacity", ".2g")], rows),
            f"Time on all cores to encode; importance takes {' or '.join(map(str, measured))} s "
            "(Gauss-Newton, or sums for the paper's presets). Decoding and slicing are times of "
            "one thread; *next instant* has its buckets in the cache. Memory is the decoder's own, without the "
            "arrays that it fills.\n",
            table([("preset", "name", ""), ("measure s", "measure_s", ".1f"),
                   ("encode s", "encode_s", ".2f"),
                   ("unmeasured: encode s", "encode_unweighted_s", ".2f"),
                   ("MB", lambda r: r["bytes_unweighted"] / 1e6, ".3f"),
                   ("dB", "fidelity_unweighted_db", ".2f"),
                   ("decode ms", milliseconds("decode_s"), ".1f"),
                   ("million Gaussians/s", million_gaussians_a_second, ".1f"),
                   ("first instant ms", milliseconds("first_slice_s"), ".1f"),
                   ("next instant ms", milliseconds("next_slice_s"), ".2f"),
                   ("decode, MB of memory", mebibytes("decode_memory_bytes"), ".1f"),
                   ("instant, MB of memory", mebibytes("slice_memory_bytes"), ".1f")], rows)]


def jod(tables, _):
    rows = sorted(tables["jod"], key=lambda r: list(PURPOSES).index(r["name"]))
    return ["JOD of ColorVideoVDP at `standard_4k`: 10 is no difference, and one less means that three of four people prefer the "
            "scene's own video. Of the videos of four cameras, 30 frames in the middle of the scene, as `compare --cameras --jod` measures them.\n",
            table([("preset", "name", ""), ("MB", megabytes, ".2f"), ("JOD, mean of cameras", "jod", ".2f"),
                   ("worst camera", "min_jod", ".2f")], rows)]


def device(tables, _):
    rows = tables["presets"]
    return ["The same scene on a CUDA device: seconds to measure importance to an agreement of "
            "0.99, to encode, and to decode all of the file into host arrays.\n",
            table([("preset", "name", ""), ("MB", megabytes, ".3f"),
                   ("measure s", "measure_s", ".2f"), ("encode s", "encode_s", ".2f"),
                   ("decode ms", milliseconds("decode_s"), ".1f")], rows)]

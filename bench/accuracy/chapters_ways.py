# SPDX-License-Identifier: Apache-2.0
"""The chapters of docs/accuracy.md on what the time of an encode buys. As in chapters.py."""

import math

import plots
from markdown import table

FIDELITIES = (40, 43, 46, 50)  # dB


def bytes_at(rows, fidelity):
    """Bytes of one way at a fidelity: their logarithm is a polynomial through that of all rows. None more than a
    decibel outside of them."""
    at = [row["fidelity_db"] for row in rows]
    if not min(at) - 1 <= fidelity <= max(at) + 1:
        return None
    return math.exp(sum(math.log(row["bytes"]) * math.prod((fidelity - x) / (at[k] - x) for x in at if x != at[k])
                        for k, row in enumerate(rows)))


def points(tables):
    """For each way: its name, its seconds (the middle of its rows), and bytes at each fidelity."""
    names = list(dict.fromkeys(row["name"] for row in tables["ways"]))
    out = []
    for name in names:
        rows = [row for row in tables["ways"] if row["name"] == name]
        seconds = sorted(row["seconds"] for row in rows)
        out.append({"name": f"`{name}`" if name.startswith("-") else name,
                    "seconds": seconds[len(seconds) // 2],
                    **{fidelity: bytes_at(rows, fidelity) for fidelity in FIDELITIES}})
    return out


def megabytes_at(fidelity):
    return lambda row: row[fidelity] and row[fidelity] / 1e6


def ways_table(rows):
    return table([("added to `encode basketball.ply`", "name", ""), ("s", "seconds", ".1f")] +
                 [(f"MB at {fidelity} dB", megabytes_at(fidelity), ".2f") for fidelity in FIDELITIES], rows)


def ways(tables, folder):
    rows = points(tables)
    return ["Bytes at equal fidelity (the preset default at three qualities, and a parabola through them) against the "
            "seconds from scene to file, importance included, on a processor. `--cameras` "
            "stands for `--cameras cameras.json`. Fidelity is that over all cameras, those among them that the encode does not see.\n",
            plots.ways(rows, FIDELITIES, folder, "ways"), ways_table(rows)]


def device_ways(tables, folder):
    rows = points(tables)
    return ["The same on a CUDA device (`--backend cuda`).\n", plots.ways(rows, FIDELITIES, folder, "device_ways"),
            ways_table(rows)]

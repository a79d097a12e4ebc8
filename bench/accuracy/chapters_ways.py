# SPDX-License-Identifier: Apache-2.0
"""The chapters of docs/accuracy.md on what the time of an encode buys. As in chapters.py."""

import math

import plots
from markdown import table

FIDELITIES = (40, 43, 46, 50)  # dB


def bytes_at(rows, fidelity):
    """Bytes of one way at a fidelity, between the two rows around it, in which their logarithm is about linear;
    None outside of the rows."""
    rows = sorted(rows, key=lambda r: r["fidelity_db"])
    for low, high in zip(rows, rows[1:]):
        if low["fidelity_db"] <= fidelity <= high["fidelity_db"]:
            part = (fidelity - low["fidelity_db"]) / (high["fidelity_db"] - low["fidelity_db"])
            return math.exp((1 - part) * math.log(low["bytes"]) + part * math.log(high["bytes"]))
    return None


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
    return ["Bytes at equal fidelity against the seconds from scene to file, importance included, on a processor. `--cameras` "
            "stands for `--cameras cameras.json`. Fidelity is that over all cameras, those among them that the encode does not see.\n",
            plots.ways(rows, FIDELITIES, folder, "ways"), ways_table(rows)]


def device_ways(tables, folder):
    rows = points(tables)
    return ["The same on a CUDA device (`--backend cuda`).\n", plots.ways(rows, FIDELITIES, folder, "device_ways"),
            ways_table(rows)]

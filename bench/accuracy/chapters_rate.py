# SPDX-License-Identifier: Apache-2.0
"""Chapters of docs/accuracy.md on fidelity against bytes. As in chapters.py."""

import plots
from markdown import ENCODE, SIZE, signed, table


def interpolate(line, fidelity):
    """Bytes at which the line of (bytes, dB) points reaches a fidelity; None outside it."""
    line = sorted(line, key=lambda r: r["fidelity_db"])
    for a, b in zip(line, line[1:]):
        if a["fidelity_db"] <= fidelity <= b["fidelity_db"]:
            span = b["fidelity_db"] - a["fidelity_db"]
            share = (fidelity - a["fidelity_db"]) / span if span > 0 else 0
            return a["bytes"] * (b["bytes"] / a["bytes"]) ** share
    return None


def rate(tables, folder):
    transforms = tables["transforms"]
    codebooks = [{"number": i, **r} for i, r in enumerate(tables["codebooks"], start=1)]
    parts = []
    for row in codebooks:
        least = interpolate(transforms, row["fidelity_db"])
        if least:
            share = least / row["bytes"] * 100
            parts.append(f"{row['name']} {share:.0f} %")
    text = ""
    if parts:
        text = ("Transforms have the fidelity of each coding by codebooks in this share of its "
                f"bytes: {'; '.join(parts)}. ")
    off = [r["fidelity_db"] - r["quality"] for r in transforms]
    text += (f"Fidelity is {signed(min(off))} to {signed(max(off))} dB from the quality asked for.")
    return ["Both families over all cameras at four instants: transforms by quality, codebooks by "
            "the number, shares and sizes of residual stages.\n",
            plots.rate_fidelity(transforms, codebooks, folder),
            table([("quality", "quality", "g")] + SIZE + ENCODE, transforms),
            table([("", "number", "d"), ("codebooks", "name", "")] + SIZE + ENCODE, codebooks),
            text + "\n"]

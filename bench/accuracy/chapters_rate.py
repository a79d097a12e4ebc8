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


def ladder(tables, folder):
    rows = tables["steps"]
    steps = []
    for row, before in zip(rows, [None] + rows):
        change = None if before is None else signed((row["bytes"] / before["bytes"] - 1) * 100, 1)
        steps.append({**row, "change": change})
    first, last = rows[0], rows[-1]
    return ["From the paper's scheme to the preset `default`, one tool at a time. From the first "
            "step that follows the quality on, it is set for the fidelity of the last step that "
            "does not; what is coded by codebooks does not follow it, and limits what can be "
            "reached. Bits are those of the file over the Gaussians given.\n",
            table([("step", "name", "")] + SIZE +
                  [("bytes, %", "change", ""), ("bits a Gaussian", "bits_per_gaussian", ".1f"),
                   ("of it position", lambda r: 8 * r["position_bytes"] / r["gaussians"], ".1f"),
                   ("of it SH", lambda r: 8 * r["sh_bytes"] / r["gaussians"], ".1f"),
                   ("Gaussians", "gaussians", ",d"), ("quality", "quality", ".1f")] + ENCODE,
                  steps),
            plots.ladder_bars(rows, folder),
            f"Together they take {last['bytes'] / first['bytes'] * 100:.0f} % of the bytes at "
            f"{signed(last['fidelity_db'] - first['fidelity_db'])} dB.\n"]


def crossover(tables, folder):
    rows = tables["parts"]
    parts = []
    for name, text in plots.PARTS.items():
        transforms = [r for r in rows if r["name"] == name and r["family"] == "transform"]
        shares = []
        for row in rows:
            if row["name"] != name or row["family"] == "transform":
                continue
            least = interpolate(transforms, row["fidelity_db"])
            if least:
                shares.append(least / row["bytes"] * 100)
        if shares:
            parts.append(f"{text} {min(shares):.0f} to {max(shares):.0f} %")
    text = ("At the fidelities of the codebooks, transforms take of their bytes: " +
            "; ".join(parts) + ".\n") if parts else ""
    return ["One part by codebooks or by a transform of other qualities, the others by "
            "transforms of quality 64, as are positions; mean times in binary16, opacities in 12 "
            "bits, no Gaussian pruned. Bytes are those of the part with its codebooks, of scales with "
            "the scale factors that codebooks need. Both rotors are one part, since a transform takes "
            "them together. Codebooks by cost follow the quality, as the presets `indexed` do.\n",
            plots.crossover_plot(rows, folder),
            table([("part", lambda r: plots.PARTS[r["name"]], ""),
                   ("family", "family", ""), ("setting", "setting", ""),
                   ("kB", lambda r: r["bytes"] / 1e3, ",.0f"),
                   ("bits a Gaussian", "bits_per_gaussian", ".1f"),
                   ("fidelity dB", "fidelity_db", ".2f")], rows), text]


def second(tables, _):
    rows = tables["presets"]
    return [f"A synthetic scene (`l4dcodec synth`) of {rows[0]['gaussians']:,} Gaussians, 5 s, "
            f"seen in {rows[0]['views']} views of cameras around it. Its Gaussians were made, "
            "not trained, and nothing in the encoder was fitted to it.\n",
            table([("preset", "name", "")] + SIZE + [("Gaussians", "coded_gaussians", ",d")] +
                  ENCODE, rows)]

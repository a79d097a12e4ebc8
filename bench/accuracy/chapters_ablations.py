# SPDX-License-Identifier: Apache-2.0
"""Chapters of docs/ablations.md: what each part of the codec brings. As in chapters.py."""

import plots
from markdown import ENCODE, SIZE, named, signed, table


def by_component(rows):
    lines = {}
    for row in rows:
        if row["name"] in plots.COMPONENTS:
            lines.setdefault(row["name"], []).append(row)
    return lines


def codebooks(tables, folder):
    rows = tables["sizes"]
    lines = by_component(rows)
    out = ["Codewords of one component, the others at 4096 (the paper's Figure 4):\n",
           table([("component", "name", ""), ("size", "size", ".0f")] + SIZE + ENCODE, rows),
           plots.component_curves(rows, "size", "codebooks", folder)]
    gains = {name: line[-1]["fidelity_db"] - line[0]["fidelity_db"] for name, line in lines.items()}
    text = "From the smallest to the largest codebook fidelity moves by " + ", ".join(
        f"{signed(gain)} dB and {(lines[name][-1]['bytes'] - lines[name][0]['bytes']) / 1e6:.2f} "
        f"MB for {plots.COMPONENTS[name]}" for name, gain in gains.items())
    best = max(gains, key=gains.get)
    return out + [f"{text}. {plots.COMPONENTS[best]} gains most, as in the paper for SH.\n"
                  if best == "sh" else
                  f"{text}. {plots.COMPONENTS[best]} gains most; in the paper SH does.\n"]


def thresholds(tables, folder):
    rows = tables["thresholds"]
    none = named(rows, "none")
    out = ["Vectors whose weight exceeds the threshold are kept as escapes (binary16), one "
           "component at a time, over decades around the paper's threshold (its Figure 5):\n",
           table([("component", "name", ""), ("threshold", "threshold", ".0e"),
                  ("of the paper's", "of_paper", "g")] + SIZE, rows),
           plots.component_curves(rows, "of_paper", "thresholds", folder, none)]
    parts = []
    for name, line in by_component(rows).items():
        top = max(line, key=lambda r: r["fidelity_db"])
        parts.append(f"{plots.COMPONENTS[name]} "
                     f"{signed(top['fidelity_db'] - none['fidelity_db'])} dB for "
                     f"{signed((top['bytes'] - none['bytes']) / 1e6)} MB")
    return out + ["Escapes alone can bring at most: " + ", ".join(parts) +
                  ". [accuracy](accuracy.md) holds escapes, in the paper's presets, against residual "
                  "stages.\n"]


def rcq(tables, _):
    rows = tables["sizes"]
    off, pays = named(rows, "off"), named(rows, "where it pays, 512")
    forced = [r for r in rows if r["name"].startswith("forced")]
    text = ("Forced, it moves fidelity by "
            f"{signed(min(r['fidelity_db'] - off['fidelity_db'] for r in forced))} to "
            f"{signed(max(r['fidelity_db'] - off['fidelity_db'] for r in forced))} dB and bytes "
            f"by {signed(min((r['bytes'] / off['bytes'] - 1) * 100 for r in forced))} to "
            f"{signed(max((r['bytes'] / off['bytes'] - 1) * 100 for r in forced))} %. Where the "
            f"encoder decides, {signed(pays['fidelity_db'] - off['fidelity_db'])} dB and "
            f"{signed((pays['bytes'] / off['bytes'] - 1) * 100)} %: the default. The scene is "
            "short and most of its Gaussians are in level 0, which has no blocks.\n")
    return ["Block codebooks made of a layer's codebook and residuals (the paper's Table 5, where "
            "64 to 1024 residuals differ by 0.004 dB):\n",
            table([("RCQ", "name", "")] + SIZE + ENCODE, rows), text]


def ablation(tables, _):
    rows = tables["steps"]
    whole, one, layers, closed, block, closed_one = rows
    return ["The paper's Table 4. \"VQ of 4D covariances\" clusters the ten numbers of the "
            "covariance over its trace with 4096 codewords, as C3DGS does it in 3D, with SH, "
            "opacity, scale factors and means as in the row below; its bytes count the entropy of "
            "the indices. The format has no such coding: it lives in this benchmark.\n",
            table([("step", "name", ""), ("layers", "layers", "d")] + SIZE, rows),
            f"Whole covariances collapse to {whole['fidelity_db']:.1f} dB; factorised coding in "
            f"one layer brings {signed(one['fidelity_db'] - whole['fidelity_db'])} dB, layers "
            f"{signed(layers['fidelity_db'] - one['fidelity_db'])} dB for "
            f"{signed((layers['bytes'] - one['bytes']) / 1e6)} MB, and means chosen after geometry "
            f"{signed(closed['fidelity_db'] - layers['fidelity_db'])} dB for "
            f"{signed((closed['bytes'] - layers['bytes']) / 1e6)} MB; in one layer they bring "
            f"{signed(closed_one['fidelity_db'] - one['fidelity_db'])} dB. The paper, which has "
            "them not, goes from 11.35 over 22.09 to 28.90 dB of PSNR against captured frames. "
            f"RCQ brings {signed(block['fidelity_db'] - closed['fidelity_db'])} dB.\n"]


def effects(tables, folder):
    rows = tables["effects"]
    first, last = rows[0], rows[-1]
    return ["Synthetic scenes of one size with one effect more each, encoded with the preset "
            "`default`. Decoding and slicing on one thread.\n",
            table([("effects", "name", ""), ("tools in the file", "tools", ""),
                   ("SH degree", "sh_degree", "d"), ("visible", "visible", ",d"),
                   ("bytes a Gaussian", "bytes_per_gaussian", ".2f"),
                   ("of it SH", "sh_bytes", ".2f"),
                   ("mean time", "mean_t_bytes", ".2f"),
                   ("rotor, temporal", "rotor_temporal_bytes", ".2f"),
                   ("encode CPU s", "encode_cpu_s", ".2f"),
                   ("decode ns a Gaussian", "decode_ns_per_gaussian", ".1f"),
                   ("slice ms", "slice_ms", ".2f"), ("render ms", "render_ms", ".1f")], rows),
            plots.effect_bars(rows, folder),
            f"What is off costs nothing: \"{first['name']}\" spends {first['mean_t_bytes']:.2f} "
            f"bytes on mean times and {first['rotor_temporal_bytes']:.2f} on temporal rotors. In "
            f"all it takes {first['bytes_per_gaussian']:.1f} bytes, "
            f"{first['decode_ns_per_gaussian']:.1f} ns to decode and "
            f"{first['encode_cpu_s']:.1f} s to encode, \"{last['name']}\" "
            f"{last['bytes_per_gaussian']:.1f} bytes, "
            f"{last['decode_ns_per_gaussian']:.1f} ns and {last['encode_cpu_s']:.1f} s.\n"]

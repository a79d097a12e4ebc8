# SPDX-License-Identifier: Apache-2.0
"""Chapters of docs/accuracy.md on time: what it buys, and where it goes. As in chapters.py."""

import plots
from markdown import signed, table

# Table 6: seconds on the 40 s Flame Salmon scene, NVIDIA RTX 5090.
PAPER_SECONDS = {"sensitivity": 439.1, "pruning and merging": 0.5, "VQ, RCQ and SQ": 12.4}


def effort(tables, folder):
    scenes = [r["name"] for r in tables["slopes"]]
    per_scene = []
    for name in scenes:
        per_scene += [(f"{name} CPU s", f"{name}_cpu_s", ".2f"),
                      (f"{name} MB", lambda r, n=name: r[f"{n}_bytes"] / 1e6, ".3f"),
                      (f"{name} dB", f"{name}_fidelity_db", ".2f")]
    settings = [("iterations", "iterations", ".0f"), ("points a codeword", "sample", ".0f"),
                ("zstd level", "zstd_level", ".0f")]
    scores = [("relative time", "relative_time", ".2f"),
              ("dB at equal bytes", lambda r: signed(r["merit_db"], 3), "")]
    slopes = ", ".join(f"{r['db_per_doubling']:.1f} dB per doubling of bytes on {r['name']}"
                       for r in tables["slopes"])
    rows = tables["efforts"]
    first, last = rows[0], rows[-1]
    return ["`--effort` sets how hard k-means and zstd try: codebooks only, transforms have "
            "nothing to try. More bytes are charged with the fidelity that they would bring in a "
            "residual stage for half of the Gaussians: the slope between one stage and 100/50 %, "
            f"both with 4096 codewords, is {slopes}. That makes one figure, *fidelity at equal "
            "bytes*, relative to 10 iterations, 24 points a codeword and zstd 15, as the mean over "
            f"the scenes ({', '.join(scenes)}); times are geometric means of ratios of CPU "
            "seconds, which other work on the machine disturbs little.\n",
            table([("effort", "effort", "d")] + settings + scores + per_scene, rows),
            plots.effort_plot(tables, folder),
            f"From effort {first['effort']} to {last['effort']} time grows by a factor of "
            f"{last['relative_time'] / first['relative_time']:.1f} and quality by "
            f"{signed(last['merit_db'] - first['merit_db'])} dB.\n"]


def decoder(tables, _):
    rows = tables["paths"]
    pairs = []
    for output in ("expanded", "packed", "slice"):
        line = {(r["backend"], r["threads"]): r["seconds"] for r in rows if r["name"] == output}
        pairs.append(f"{output} {line['reference', 1] / line['SIMD', 1]:.1f}x by SIMD and "
                     f"{line['SIMD', 1] / line['SIMD', 2]:.1f}x by a second thread")
    return ["A file of the preset `indexed`, whose codebook indices can be handed out packed; the "
            "slice is of an instant whose buckets are in the cache. Every output is compared with "
            "that of the reference byte for byte before its row is written, so the last column is "
            "0 on every machine: decoding fast costs no accuracy.\n",
            table([("output", "name", ""), ("kernels", "backend", ""), ("threads", "threads", "d"),
                   ("ms", lambda r: r["seconds"] * 1e3, ".2f"),
                   ("bytes compared", "compared_bytes", ",d"), ("error", "error", "d")], rows),
            "Gains: " + "; ".join(pairs) + ".\n"]


def renderer(tables, _):
    rows = tables["paths"]
    fast = [r for r in rows if r["name"] == "float"]
    fastest = [r for r in rows if r["name"] == "float, fast exponential"]
    double = [r for r in rows if r["name"] == "double"]
    parts = [f"on {d['scene']} at {d['width']}x{d['height']} float takes "
             f"1/{d['ms_per_view'] / f['ms_per_view']:.0f} of the time at {f['psnr_db']:.0f} dB, "
             "and the fast exponential "
             f"{signed((e['ms_per_view'] / f['ms_per_view'] - 1) * 100, 0)} % of that at "
             f"{e['psnr_db']:.0f} dB"
             for d, f, e in zip(double, fast, fastest)]
    return ["Errors of images against the path in double precision, in units of the range [0, 1]; "
            "8-bit images have a step of 0.0039. Single pixels differ more where a Gaussian falls "
            "just below the cut at 1/255 on one path and not on the other.\n",
            table([("scene", "scene", ""), ("size", lambda r: f"{r['width']}x{r['height']}", ""),
                   ("visible", "visible", ",d"), ("path", "name", ""),
                   ("ms a view", "ms_per_view", ".1f"),
                   ("largest error", "max_error", ".1e"), ("RMS error", "rms_error", ".1e"),
                   ("PSNR dB", lambda r: None if r["rms_error"] == 0 else r["psnr_db"], ".1f")],
                  rows),
            parts[0][0].upper() + "; ".join(parts)[1:] + ".\n"]


def stages(tables, _):
    rows = tables["stages"]
    skip = {"name", "command", "sensitivity", "vq_rcq_sq", "encode_s"}
    steps = []
    for row in rows:
        steps += [k for k in row if k not in skip and k not in steps]
    names = [r["name"] for r in rows]
    lines = [{"step": "sensitivity (0.95 agreement)", "paper": PAPER_SECONDS["sensitivity"],
              **{r["name"]: r["sensitivity"] for r in rows}},
             {"step": "pruning, layering", "paper": PAPER_SECONDS["pruning and merging"],
              **{r["name"]: r.get("prepare", 0) + r.get("layering", 0) for r in rows}},
             {"step": "VQ, RCQ and SQ", "paper": PAPER_SECONDS["VQ, RCQ and SQ"],
              **{r["name"]: r["vq_rcq_sq"] for r in rows}}]
    for step in steps:
        if step not in ("prepare", "layering", "check", "write"):
            lines.append({"step": f"of it {step.replace('_', ' ')}",
                          **{r["name"]: r.get(step) for r in rows}})
    lines.append({"step": "write", **{r["name"]: r.get("write") for r in rows}})
    lines.append({"step": "encoding, all", **{r["name"]: r["encode_s"] for r in rows}})
    shares = ", ".join(f"{r['sensitivity'] / (r['sensitivity'] + r['encode_s']) * 100:.0f} % with "
                       f"{r['name']}" for r in rows)
    return ["Seconds per step (the paper's Table 6: its column is of another scene, 40 s Flame "
            "Salmon with over 20,000 views, on an NVIDIA RTX 5090). Sensitivity is measured once "
            "per scene and serves any number of encodings.\n",
            table([("step", "step", "")] + [(n, n, ".2f") for n in names] +
                  [("paper", "paper", ".1f")], lines),
            f"Sensitivity is {shares} of measuring and encoding together; 97 % in the paper.\n"]

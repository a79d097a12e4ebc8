# SPDX-License-Identifier: Apache-2.0
"""Chapters of docs/accuracy.md on what is coded and how. Each takes its section's tables and the
folder of images, and returns paragraphs."""

import plots
from markdown import ENCODE, SIZE, front, megabytes, named, signed, table

SHARES = [("sh", "SH"), ("scale", "scale"), ("rotor_spatial", "rotor, spatial"),
          ("rotor_temporal", "rotor, temporal"), ("position", "position"), ("mean_t", "mean time"),
          ("opacity", "opacity"), ("scale_factor", "scale factor"), ("codebooks", "codebooks"),
          ("rcq_tables", "RCQ tables"), ("directory", "directory"), ("header", "header"),
          ("page_overhead", "page overhead"), ("entropy_tables", "entropy tables")]


def final(tables, folder):
    codings = tables["codings"]
    out = [f"All presets, and codebooks with other shares of residual stages (in percent of the "
           f"Gaussians) and sizes, over the {views_text(tables)}. Changes of PSNR are those "
           "against captured frames, relative to the uncompressed model. Weights are measured: "
           "Gauss-Newton's, sums of derivatives for the paper's presets. How far seeds alone "
           "spread fidelity says the section on k-means.\n"]
    columns = [("coding", "name", "")] + SIZE + [("worst view dB", "min_view_db", ".2f"),
                                                 ("SSIM", "ssim", ".4f")]
    if "psnr_test_db" in codings[0]:
        for split in ("test", "train"):
            columns.append((f"PSNR {split} dB", lambda r, s=split: f"{r[f'psnr_{s}_db']:.2f} ("
                            f"{signed(r[f'psnr_{s}_change_db'])})", ""))
            columns.append((f"SSIM {split}", f"ssim_{split}", ".4f"))
    columns += [("Gaussians", "coded_gaussians", ",d")] + ENCODE
    out.append(table(columns, codings))
    out.append(learned_of_codings(codings))
    out.append("Where the bytes are (the paper's Figures 10 and 11), in kB:\n")
    present = [(key, text) for key, text in SHARES if any(r[key] for r in tables["sections"])]
    out.append(table([("coding", "name", "")] + [(text, lambda r, k=key: r[k] / 1e3, ",.0f")
                                                 for key, text in present], tables["sections"]))
    out.append(plots.section_bars(tables["sections"], [key for key, _ in present], folder))
    if tables["layers"]:
        out += level_tables(tables["layers"], folder)
    return out


def level_tables(layers, folder):
    by_coding = {}
    for row in layers:
        by_coding.setdefault(row["name"], []).append(row)
    return ["Gaussians of each temporal level as given, after pruning, and in the file (the "
            "paper's Figure 12), where thin layers are merged and Gaussians whose decoded extent "
            "no longer fits have moved to coarser ones; bytes of the layers:\n",
            table([("coding", "name", ""), ("level", "level", "d"), ("given", "gaussians", ",d"),
                   ("pruned", "after_pruning", ",d"), ("in the file", "after_merging", ",d"),
                   ("layer kB", lambda r: r["layer_bytes"] / 1e3, ",.0f"),
                   ("of it codebooks kB", lambda r: r["codebook_bytes"] / 1e3, ",.0f")], layers),
            plots.layer_bars(by_coding, folder)]


def views_text(tables):
    views = sum(r["views"] for r in tables["uncompressed"])
    if not views:
        return "same views as in all other sections"
    figures = [f"{r['psnr_db']:.2f} dB and SSIM {r['ssim']:.4f} on {r['name']} cameras"
               for r in tables["uncompressed"]]
    return (f"{views} views of all cameras at every 15th frame; the uncompressed model has " +
            ", ".join(figures))


def learned_of_codings(codings):
    best = front(codings)
    text = ("No other coding has both fewer bytes and more fidelity than: " +
            "; ".join(f"{r['name']} ({r['ratio']:.1f}x, {r['fidelity_db']:.1f} dB)" for r in best) +
            ".")
    for row in codings:
        if not row["name"].startswith("paper"):
            continue
        better = [r for r in codings if r["bytes"] < row["bytes"] and
                  r["fidelity_db"] > row["fidelity_db"]]
        if better:
            least = min(better, key=lambda r: r["bytes"])
            text += (f" {row['name']} has {row['fidelity_db']:.1f} dB at {row['ratio']:.1f}x, "
                     f"which \"{least['name']}\" exceeds with "
                     f"{least['bytes'] / row['bytes'] * 100:.0f} % of its bytes.")
        else:
            text += (f" {row['name']} ({row['ratio']:.1f}x, {row['fidelity_db']:.1f} dB) is not "
                     "beaten.")
    return text + "\n"


def sensitivity(tables, folder):
    views, measures, pruning = tables["views"], tables["measures"], tables["pruning"]
    agreed = views[-1]
    most = max(views, key=lambda r: r["views_measured"])
    correlations = [("SH", "spearman_sh", ".4f"), ("scale", "spearman_scale", ".4f"),
                    ("rotor, spatial", "spearman_rotor_spatial", ".4f"),
                    ("rotor, temporal", "spearman_rotor_temporal", ".4f")]
    out = ["Squared derivatives are added up over training views, of which a part is enough: the "
           "table gives Spearman's rank correlation with the weights of the largest part measured "
           "here, and the preset `default` encoded with the weights. \"Visibility-only\" views are only "
           "looked at for Gaussians that the measured ones did not show.\n",
           table([("share of the views", "name", ""), ("views measured", "views_measured", "d"),
                  ("visibility-only views", "views_visibility_only", "d"), ("seconds", "measure_s", ".1f"),
                  ("unseen", "unseen", ",d")] + correlations + SIZE, views),
           plots.sensitivity_plot(views[:-1], agreed, folder),
           "Measures and families of codings:\n",
           table([("weights, preset", "name", "")] + SIZE, measures),
           "Pruning by rate and distortion, for other prices of a Gaussian's bits:\n",
           table([("prune-cost", "prune_cost", "g"), ("pruned", "pruned", ",d")] + SIZE, pruning)]
    text = (f"Where halves of the measured views agree to 0.95, {agreed['views_measured']} views "
            f"and {agreed['measure_s']:.0f} s (visibility-only views included) instead of "
            f"{most['views_measured']} and {most['measure_s']:.0f} s move fidelity by "
            f"{signed(agreed['fidelity_db'] - most['fidelity_db'])} dB at "
            f"{signed((agreed['bytes'] / most['bytes'] - 1) * 100)} % of the bytes: this is the "
            "default. ")
    for preset in ("default", "indexed"):
        line = {m: named(measures, f"{m}, {preset}") for m in ("no weights", "sum", "gauss-newton")}
        if not all(line.values()):
            continue
        newton = line["gauss-newton"]
        text += f"With `{preset}`, " + " and ".join(
            f"{name} {signed(line[name]['fidelity_db'] - newton['fidelity_db'])} dB at "
            f"{signed((line[name]['bytes'] / newton['bytes'] - 1) * 100)} % of the bytes"
            for name in ("no weights", "sum")) + " against Gauss-Newton weights. "
    never, last = pruning[0], pruning[-1]
    text += (f"Pruning at {last['prune_cost']:g} drops {last['pruned']:,} Gaussians and "
             f"{(1 - last['bytes'] / never['bytes']) * 100:.1f} % of the bytes for "
             f"{signed(last['fidelity_db'] - never['fidelity_db'])} dB.")
    return out + [text + "\n"]


def kmeans(tables, folder):
    seeds, iterations, samples = tables["seeds"], tables["iterations"], tables["sample"]
    spread = max(r["fidelity_db"] for r in seeds) - min(r["fidelity_db"] for r in seeds)
    out = ["Other seeds, which shows what differences mean nothing:\n",
           table([("seed", "seed", "d")] + SIZE + ENCODE, seeds),
           "Lloyd iterations at 24 training points a codeword, and training points at 10 "
           "iterations (the last iterations see more of them):\n",
           table([("iterations", "iterations", ".0f")] + SIZE + ENCODE, iterations),
           table([("points a codeword", "sample", ".0f")] + SIZE + ENCODE, samples),
           plots.kmeans_plot(iterations, samples, folder)]
    base = named(samples, 24, "sample") or samples[-1]
    best = max(iterations + samples, key=lambda r: r["fidelity_db"])
    fast = min((r for r in iterations + samples
                if r["fidelity_db"] > best["fidelity_db"] - 2 * spread),
               key=lambda r: r["encode_cpu_s"])
    which = "iterations" if "iterations" in fast else "sample"
    text = (f"Seeds alone spread fidelity over {spread:.2f} dB. From "
            f"{iterations[0]['iterations']:.0f} to {iterations[-1]['iterations']:.0f} iterations "
            f"it moves by {signed(iterations[-1]['fidelity_db'] - iterations[0]['fidelity_db'])} "
            f"dB, from {samples[0]['sample']:.0f} to {samples[-1]['sample']:.0f} points a "
            f"codeword by {signed(samples[-1]['fidelity_db'] - samples[0]['fidelity_db'])} dB. "
            f"The best of the tables is {signed(best['fidelity_db'] - base['fidelity_db'])} dB "
            f"above 10 iterations with {base['sample']:.0f} points; the fastest within twice the "
            f"spread of the best takes {fast['encode_cpu_s']:.1f} CPU seconds ({fast[which]:.0f} "
            f"{'iterations' if which == 'iterations' else 'points a codeword'}).")
    return out + [text + "\n"]


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
                  ". The first section holds escapes, in the paper's presets, against residual "
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

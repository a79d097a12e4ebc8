# SPDX-License-Identifier: Apache-2.0
"""Chapters of docs/accuracy.md on what is coded and how. Each takes its section's tables and the
folder of images, and returns paragraphs."""

import plots
from markdown import ENCODE, SIZE, front, named, signed, table

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
           "Gauss-Newton's, sums of derivatives for the paper's presets.\n"]
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

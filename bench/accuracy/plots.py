# SPDX-License-Identifier: Apache-2.0
"""The plots of docs/accuracy.md and docs/ablations.md: one design that reads on white and on dark,
without background."""

import matplotlib
import matplotlib.ticker

matplotlib.use("agg")
import matplotlib.pyplot as plt  # noqa: E402  (the backend comes first)

GREY = "#7d858f"
COLOURS = ["#3b82f6", "#e8770c", "#2fa35a", "#a560e8", "#e0475f", "#12a5b5"]
COMPONENTS = {"sh": "SH", "scale": "scale", "rotor_spatial": "rotor, spatial",
              "rotor_temporal": "rotor, temporal"}
TIMES = (0.1, 0.2, 0.3, 0.5, 0.7, 1, 1.5, 2, 3, 5, 7, 10, 20, 50)

plt.rcParams.update({
    "figure.facecolor": "none", "axes.facecolor": "none", "savefig.facecolor": "none",
    "legend.framealpha": 0, "text.color": GREY, "axes.labelcolor": GREY, "axes.edgecolor": GREY,
    "xtick.color": GREY, "ytick.color": GREY, "axes.titlecolor": GREY, "axes.titlesize": 11,
    "font.size": 10, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
    "grid.color": GREY, "grid.alpha": 0.25, "grid.linewidth": 0.6, "lines.linewidth": 1.8,
    "lines.markersize": 5, "font.family": "sans-serif",
    "axes.prop_cycle": matplotlib.cycler(color=COLOURS)})


def save(figure, folder, name):
    folder.mkdir(parents=True, exist_ok=True)
    figure.tight_layout()
    figure.savefig(folder / f"{name}.png", dpi=130, metadata={"Software": None})
    plt.close(figure)
    return f"![{name}]({folder.name}/{name}.png)\n"


def label(axes, x, y, text, dx=6, dy=4, align="left"):
    axes.annotate(text, (x, y), textcoords="offset points", xytext=(dx, dy), fontsize=8, ha=align)


def short(name):
    """The name of a coding without what brackets add."""
    return name.split(" (")[0]


def rate_fidelity(transforms, codebooks, folder):
    figure, axes = plt.subplots(figsize=(8, 4.6))
    for rows, name, style in ((transforms, "transform, by quality", "o-"),
                              (codebooks, "codebooks, numbers as in the table", "s")):
        axes.plot([r["bytes"] / 1e6 for r in rows], [r["fidelity_db"] for r in rows], style,
                  label=name)
    for row in transforms:
        label(axes, row["bytes"] / 1e6, row["fidelity_db"], f"{row['quality']:g}", -4, 5, "right")
    for row in codebooks:
        label(axes, row["bytes"] / 1e6, row["fidelity_db"], str(row["number"]), 6, -10)
    axes.margins(0.08)
    axes.set(xlabel="MB", ylabel="fidelity (dB)")
    axes.legend(loc="lower right")
    return save(figure, folder, "rate_fidelity")


def section_bars(rows, order, folder):
    """Shares of the bytes, so that small files are as legible as large ones; totals beside them."""
    figure, axes = plt.subplots(figsize=(8, 1.3 + 0.34 * len(rows)))
    palette = COLOURS + ["#8a6d3b", "#5d6bd8", "#c24d9e", "#6f9c1f", "#b08800", "#4b8f8c",
                         "#98a2ad", "#d1495b"]
    left = [0.0] * len(rows)
    totals = [sum(r.get(section, 0) for section in order) for r in rows]
    for colour, section in zip(palette, order):
        width = [100 * r.get(section, 0) / total for r, total in zip(rows, totals)]
        axes.barh(range(len(rows)), width, left=left, color=colour, label=section.replace("_", " "))
        left = [a + b for a, b in zip(left, width)]
    for i, total in enumerate(totals):
        label(axes, 100, i, f"{total / 1e6:.2f} MB", 4, -3)
    axes.set_yticks(range(len(rows)), [short(r["name"]) for r in rows], fontsize=8)
    axes.set_xlim(0, 100)
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set(xlabel="% of the bytes")
    # A legend below the axes, half an inch down whatever the number of rows.
    axes.legend(fontsize=7, ncol=5, loc="upper center",
                bbox_to_anchor=(0.45, -0.5 / (0.34 * len(rows))))
    return save(figure, folder, "sections")


def layer_bars(by_coding, folder):
    figure, all_axes = plt.subplots(1, len(by_coding), figsize=(8, 3.2), squeeze=False)
    for axes, (name, rows) in zip(all_axes[0], by_coding.items()):
        for i, (key, text) in enumerate((("gaussians", "given"), ("after_pruning", "pruned"),
                                         ("after_merging", "in the file"))):
            axes.bar([r["level"] + 0.27 * (i - 1) for r in rows], [r[key] for r in rows], 0.27,
                     label=text)
        axes.set_yscale("log")
        axes.set_xticks([r["level"] for r in rows])
        axes.set(xlabel="level", ylabel="Gaussians", title=short(name))
    all_axes[0][0].legend(fontsize=8)
    return save(figure, folder, "layers")


def log_ticks(axes, values):
    """A logarithmic axis of few numbers, which are its ticks."""
    axes.set_xscale("log")
    axes.set_xticks(values, [f"{v:g}" for v in values])
    axes.minorticks_off()


def sensitivity_plot(views, agreed, folder):
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.4))
    views = sorted(views, key=lambda r: r["views_measured"])
    count = [r["views_measured"] for r in views]
    for component, text in COMPONENTS.items():
        left.plot(count, [r[f"spearman_{component}"] for r in views], "o-", label=text)
    log_ticks(left, count)
    left.set(xlabel="views measured", ylabel="rank correlation with most views")
    left.legend(fontsize=8)
    right.plot(count, [r["fidelity_db"] for r in views], "o-", label="shares of the views")
    right.plot([agreed["views_measured"]], [agreed["fidelity_db"]], "s",
               label="stopped by agreement")
    log_ticks(right, count)
    right.set(xlabel="views measured", ylabel="fidelity (dB)")
    right.legend(fontsize=8)
    return save(figure, folder, "sensitivity")


def component_curves(rows, key, name, folder, reference=None):
    """Bytes against fidelity, a panel per component (the paper's Figures 4 and 5): the first and
    the last value of each line are written beside it."""
    lines = {component: sorted((r for r in rows if r["name"] == component),
                               key=lambda r: r["bytes"]) for component in COMPONENTS}
    lines = {component: line for component, line in lines.items() if line}
    figure, all_axes = plt.subplots(1, len(lines), figsize=(9, 3), sharey=True, squeeze=False)
    for axes, colour, (component, line) in zip(all_axes[0], COLOURS, lines.items()):
        axes.plot([r["bytes"] / 1e6 for r in line], [r["fidelity_db"] for r in line], "o-",
                  color=colour)
        for r, dx, align in ((line[0], 5, "left"), (line[-1], -2, "right")):
            label(axes, r["bytes"] / 1e6, r["fidelity_db"], f"{r[key]:g}",
                  dx, -12 if align == "left" else 6, align)
        if reference:
            axes.plot(reference["bytes"] / 1e6, reference["fidelity_db"], "D", color=GREY,
                      label="none")
        axes.margins(x=0.18, y=0.12)
        axes.set(xlabel="MB", title=COMPONENTS[component])
    all_axes[0][0].set_ylabel("fidelity (dB)")
    if reference:
        all_axes[0][0].legend(fontsize=8)
    return save(figure, folder, name)


def choice(rows, folder):
    """Fidelity of presets against bytes and against time, with importance measured and without. Lossless
    files are above the plot, wherever they are."""
    rows = [r for r in rows if r["fidelity_db"] < 90]
    figure, panels = plt.subplots(1, 2, figsize=(10, 4.8), sharey=True)
    kinds = (("encode", "s", "fidelity_unweighted_db",
              (lambda r: r["bytes_unweighted"] / 1e6, lambda r: r["encode_unweighted_s"])),
             ("encode --cameras", "o", "fidelity_db",
              (lambda r: r["bytes"] / 1e6, lambda r: r["measure_s"] + r["encode_s"])))
    for axes, number, title in zip(panels, (0, 1), ("MB", "seconds from scene to file")):
        for (name, style, fidelity, across), colour in zip(kinds, COLOURS):
            axes.plot([across[number](r) for r in rows], [r[fidelity] for r in rows], style,
                      color=colour, label=name)
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(matplotlib.ticker.FormatStrFormatter("%g"))
        axes.xaxis.set_minor_formatter(matplotlib.ticker.NullFormatter())
        axes.set(xlabel=title)
    panels[0].set_xticks([1, 1.5, 2, 3, 5, 10, 20])
    panels[0].set_ylabel("fidelity (dB)")
    for axes, number, beside in ((panels[0], 0, 0.2), (panels[1], 1, 0.3)):
        axes.margins(x=beside, y=0.1)
        for _, _, fidelity, across in kinds:
            points = [(across[number](r), r[fidelity], r["name"]) for r in rows]
            if number == 0 and fidelity == "fidelity_db":  # the smaller files: labels on their free side
                for x, y, text in points:
                    label(axes, x, y, text, -7, -3, "right")
            else:
                spread_labels(axes, points)
    panels[0].legend(loc="lower right")
    return save(figure, folder, "choice")


def ways(rows, fidelities, folder, name):
    """Bytes at each fidelity against seconds; numbers at the points are rows of the table."""
    figure, axes = plt.subplots(figsize=(8, 4.4))
    for fidelity in fidelities:
        line = [(number, r) for number, r in enumerate(rows, 1) if r[fidelity] is not None]
        axes.plot([r["seconds"] for _, r in line], [r[fidelity] / 1e6 for _, r in line], "o", label=f"{fidelity} dB")
        for number, r in line:
            label(axes, r["seconds"], r[fidelity] / 1e6, str(number), 5, 3)
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(matplotlib.ticker.FormatStrFormatter("%g"))
        axis.set_minor_formatter(matplotlib.ticker.NullFormatter())
    axes.set_yticks([1, 1.5, 2, 3, 4, 5])
    axes.margins(x=0.1, y=0.1)
    axes.set(xlabel="seconds from scene to file (numbers: rows of the table)", ylabel="MB")
    axes.legend()
    return save(figure, folder, name)


def spread_labels(axes, points, step=10):
    """Labels to the right of points on a logarithmic axis, moved up where one would lie on
    another."""
    axes.figure.canvas.draw()
    dpi = axes.figure.dpi
    placed = []
    for x, y, text in sorted(points, key=lambda p: p[1]):
        left, bottom = (v * 72 / dpi for v in axes.transData.transform((x, y)))
        at = bottom - 3
        width = 5 * len(text)
        for other_left, other_right, other_at in placed:
            if left < other_right and other_left < left + width and abs(at - other_at) < step:
                at = other_at + step
        placed.append((left, left + width, at))
        label(axes, x, y, text, 7, at - bottom)


def effort_plot(tables, folder):
    figure, axes = plt.subplots(figsize=(8, 4))
    rows = tables["efforts"]
    axes.plot([r["relative_time"] for r in rows], [r["merit_db"] for r in rows], "o")
    for r in rows:
        label(axes, r["relative_time"], r["merit_db"], str(r["effort"]), 0, 6, "center")
    axes.set_xscale("log")
    times = [r["relative_time"] for r in rows]
    axes.set_xticks([t for t in TIMES if min(times) * 0.8 < t < max(times) * 1.25])
    axes.xaxis.set_major_formatter(matplotlib.ticker.FormatStrFormatter("%g"))
    axes.xaxis.set_minor_locator(matplotlib.ticker.NullLocator())
    axes.margins(y=0.12)
    axes.set(xlabel="time to encode, relative to 10 iterations, 24 points, zstd 15",
             ylabel="fidelity at equal bytes (dB)")
    return save(figure, folder, "effort")


def effect_bars(rows, folder):
    columns = (("bytes_per_gaussian", "bytes per Gaussian"), ("encode_cpu_s", "encode (CPU s)"),
               ("decode_ns_per_gaussian", "decode (ns per Gaussian)"), ("slice_ms", "slice (ms)"))
    figure, all_axes = plt.subplots(1, len(columns), figsize=(8, 2.6), sharey=True)
    for axes, (key, title) in zip(all_axes, columns):
        axes.barh(range(len(rows)), [r[key] for r in rows], color=COLOURS[0])
        axes.set_yticks(range(len(rows)), [r["name"] for r in rows], fontsize=8)
        axes.set_title(title, fontsize=9)
        axes.grid(axis="y", visible=False)
    all_axes[0].invert_yaxis()
    return save(figure, folder, "effects")

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The rules that the paper trains by against those of this trainer, and memory against length.

usage: paper_tables.py L4DTRAIN L4DCODEC FOLDER CAPTURE [--preset NAME] [--tables rules,layers,length]
                       [--lengths 0.25,0.5,1] [OPTION of `l4dtrain train`...]

Prints tables in Markdown:
  rules    relocation and the gradient rule of density, in every step and every 100, and the rate of
           the temporal rotor with its bound (DARLR) and without
  layers   the stream of the first of these, with a layer for each temporal level, and with all
           Gaussians in the coarsest; what a seek to the middle reads
  length   the first part of the capture, for steps or seconds in proportion: what a training has in
           memory; of that, the Gaussians and the renderer in the back end, the captured images that
           it keeps, and its Gaussians at most (--device-memory or --resident bound them); and
           what an instant needs of the scene

Options of a training hold for all rows, and --steps N or --time S must be one of them: on a
processor a small --scale and few Gaussians, on a device what the capture has.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import threading
import time

RULES = {
    "relocation in every step": (),
    "relocation every 100 steps": ("--density-every", "100"),
    "gradients in every step": ("--density", "gradient"),
    "gradients every 100 steps": ("--density", "gradient", "--density-every", "100"),
    "without DARLR": ("--drift", "0"),
}

LAYERS = {
    "as the preset has it": (),
    "a layer for each level": ("--set", "merge-fraction=0", "--set", "merge-count=0"),
    "one layer": ("--set", "merge-fraction=1"),
}


def run(*command):
    return subprocess.run([str(c) for c in command], check=True, stdout=subprocess.PIPE).stdout


def peak_memory(process, peak):
    """Of the process, bytes: the system's own peak, read while it lives."""
    status = pathlib.Path(f"/proc/{process.pid}/status")
    while process.poll() is None:
        try:
            for line in status.read_text(encoding="ascii").splitlines():
                if line.startswith("VmHWM:"):
                    peak[0] = max(peak[0], 1024 * int(line.split()[1]))
        except OSError:
            pass
        time.sleep(0.1)


class Bench:
    def __init__(self, own, options):
        self.train, self.codec = own.l4dtrain.resolve(), own.l4dcodec.resolve()
        self.capture, self.folder = own.capture.resolve(), own.folder.resolve()
        self.preset, self.options = own.preset, options

    def trained(self, name, *more):
        """The report of a training; peak_bytes is what it took of memory."""
        folder = self.folder / name.replace(" ", "-")
        command = [self.train, "train", self.capture, "-o", folder, "--force", "--quiet", "--json",
                   "--encode", self.preset, *self.options, *more]
        peak = [0]
        with subprocess.Popen([str(c) for c in command], stdout=subprocess.PIPE) as process:
            watch = threading.Thread(target=peak_memory, args=(process, peak))
            watch.start()
            output = process.stdout.read()
            watch.join()
        if process.returncode != 0:
            sys.exit(f"{name}: l4dtrain ended with status {process.returncode}")
        return {**json.loads(output), "folder": folder, "peak_bytes": peak[0]}

    def info(self, stream, seconds):
        return json.loads(run(self.codec, "info", stream, "--time", f"{seconds:g}", "--json"))


def quality(score):
    return f"{score['train']['psnr']:.2f}, {score['test']['psnr']:.2f} dB"


def table(*titles):
    print("\n| " + " | ".join(titles) + " |")
    print("|---|" + "---:|" * (len(titles) - 1), flush=True)


def row(*cells):
    print("| " + " | ".join(str(c) for c in cells) + " |", flush=True)


def rules(bench):
    table("rule", "Gaussians", "s", "training, test", "stream", "its training, test")
    first = None
    for name, options in RULES.items():
        report = bench.trained(name, *options)
        first = first or report
        row(name, f"{report['gaussians']:,}", f"{report['training_s']:.0f}", quality(report),
            f"{report['stream']['file_bytes'] / 1000:.1f} kB", quality(report["stream"]))
    return first


def layers(bench, report):
    report = report or bench.trained(next(iter(RULES)))
    folder, stream = report["folder"], report["folder"] / "scene.l4d"
    table("stream", "layers", "bytes", "its training, test", "a seek reads", "Gaussians of it")
    for name, options in LAYERS.items():
        run(bench.codec, "encode", folder / "scene.ply", "--weights", folder / "weights.ply",
            "--preset", bench.preset, *options, "-o", stream, "--force", "--quiet")
        scores = json.loads(run(bench.train, "eval", folder, "--json", "--quiet"))["stream"]
        info = bench.info(stream, 0)
        info = bench.info(stream, info["duration_s"] / 2)
        row(name, info["num_layers"], f"{scores['file_bytes']:,}", quality(scores),
            f"{info['seek']['bytes']:,}",
            f"{info['seek']['gaussians']:,} of {info['num_gaussians']:,}")


def shortened(options, share):
    """The options with a share of the steps or of the seconds."""
    out, names = list(options), ("--steps", "--time")
    for k, option in enumerate(out):
        name, _, value = option.partition("=")
        if name not in names:
            continue
        amount = float(value or out[k + 1]) * share
        text = str(max(1, round(amount))) if name == "--steps" else f"{amount:g}"
        if value:
            out[k] = f"{name}={text}"
        else:
            out[k + 1] = text
    return out


def length(bench, lengths):
    capture = json.loads(run(bench.train, "inspect", bench.capture, "--json"))
    whole = bench.options
    table("length", "Gaussians", "training, test", "stream", "memory of the training", "back end",
          "its images", "its Gaussians", "an instant needs")
    for share in lengths:
        frames = max(1, round(capture["frames"] * share))
        bench.options = shortened(whole, share)
        report = bench.trained(f"length {share:g}", "--frames", f"0:{frames}")
        stream = report["folder"] / "scene.l4d"
        seconds = frames / capture["fps"]
        info = bench.info(stream, seconds / 2)
        use = report["memory"]
        row(f"{seconds:g} s", f"{report['gaussians']:,}", quality(report),
            f"{report['stream']['file_bytes'] / 1000:.1f} kB", f"{report['peak_bytes'] / 1e6:.0f} MB",
            f"{(use['model_bytes'] + use['renderer_bytes']) / 1e6:.1f} MB",
            f"{use['target_bytes'] / 1e6:.1f} MB", f"{use['resident']:,}",
            f"{100 * info['seek']['gaussians'] / info['num_gaussians']:.0f} % of the Gaussians")
    bench.options = whole


def main():
    usage = __doc__.split("usage: ")[1].split("\n\n")[0]
    parser = argparse.ArgumentParser(usage=usage, allow_abbrev=False)
    for name in ("l4dtrain", "l4dcodec", "folder", "capture"):
        parser.add_argument(name, type=pathlib.Path)
    parser.add_argument("--preset", default="default")
    parser.add_argument("--tables", default="rules,layers,length")
    parser.add_argument("--lengths", default="0.25,0.5,1")
    own, options = parser.parse_known_args()
    if not any(o.split("=")[0] in ("--steps", "--time") for o in options):
        parser.error("--steps N or --time S must be given")
    own.folder.mkdir(parents=True, exist_ok=True)
    bench, wanted = Bench(own, options), own.tables.split(",")
    report = rules(bench) if "rules" in wanted else None
    if "layers" in wanted:
        layers(bench, report)
    if "length" in wanted:
        length(bench, [float(n) for n in own.lengths.split(",")])


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""Static scenes against formats of 3D Gaussians, at no less fidelity."""

import subprocess

import numpy

# Without views importance is a guess, and the presets fall short of their fidelity.
CODINGS = {preset: ("--preset", preset)
           for preset in ("tiny", "small", "default", "large", "archive")}
CODINGS.update({f"quality {q}": ("--quality", str(q)) for q in (62, 70)})
JUDGES = ("--orbit", "16", "--frames", "0")
# Between those of the judges, so that no view is both measured and judged.
MEASURED = ("--orbit", "23", "--frames", "0")
RIVALS = (("SPZ", "spz"), ("SOG", "sog"), ("compressed PLY", "compressed.ply"))


def convert(transform, source, target, limit):
    """Without a graphics processor some conversions run on the processor when told so."""
    for device in ((), ("-g", "cpu")):
        made = subprocess.run([*transform, "-q", "-w", *device, str(source), str(target)],
                              capture_output=True, text=True, timeout=limit, check=False)
        if made.returncode == 0 and target.exists():
            return
    raise RuntimeError(made.stderr.strip().splitlines()[-1] if made.stderr.strip() else "it failed")


def bounded(path):
    """Logits of opacities that came back as 0 and 1 are infinite: they become very large."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    values = numpy.frombuffer(data[end:], "<f4")
    path.write_bytes(data[:end] + numpy.nan_to_num(values, nan=numpy.nan, posinf=16.0,
                                                   neginf=-16.0).astype("<f4").tobytes())


def fidelity(tool, reference, scene):
    return tool("compare", reference, scene, *JUDGES)["fidelity_db"]


def rivals(tool, transform, name, scene, folder, limit, skip):
    for text, extension in RIVALS:
        made, back = folder / f"{name}.{extension}", folder / f"{name}_{extension}_back.ply"
        made.unlink(missing_ok=True)
        try:
            convert(transform, scene, made, limit)
            convert(transform, made, back, limit)
            bounded(back)
        except subprocess.TimeoutExpired:
            skip(f"{text} of {name}: not done after {limit:.0f} s")
            continue
        except RuntimeError as error:
            skip(f"{text} of {name}: {error}")
            continue
        yield {"scene": name, "name": text, "bytes": made.stat().st_size,
               "fidelity_db": fidelity(tool, scene, back)}


def ours(tool, name, scene, folder):
    """Every preset and two more qualities, as they come and with weights measured from views."""
    for measured in (False, True):
        views = MEASURED if measured else ()
        for coding, arguments in CODINGS.items():
            made = folder / f"{name}_ours.l4d"
            tool("encode", scene, "-o", made, "-f", *arguments, *views)
            yield {"scene": name, "name": coding, "measured": measured,
                   "bytes": made.stat().st_size, "fidelity_db": fidelity(tool, scene, made)}


def least(rows, fidelity_db, measured):
    """The smallest of our files that is no worse."""
    enough = [r for r in rows if r["measured"] == measured and r["fidelity_db"] >= fidelity_db]
    return min(enough, key=lambda r: r["bytes"], default=None)


def table(tool, transform, scenes, folder, limit, skip):
    """Rows of rivals with ours beside them, and all rows of ours."""
    compared, every = [], []
    for name, scene in scenes:
        own = list(ours(tool, name, scene, folder))
        every += own
        if transform is None:
            continue
        for row in rivals(tool, transform, name, scene, folder, limit, skip):
            for measured, key in ((False, "plain"), (True, "measured")):
                row[key] = least(own, row["fidelity_db"], measured)
            compared.append(row)
    return compared, every

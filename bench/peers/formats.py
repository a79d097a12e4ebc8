#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What programs of others find in the files that l4dcodec writes, and it in theirs, value by value.

usage: formats.py L4DCODEC FOLDER

Packages from npm are installed into FOLDER. Prints two tables in Markdown with the largest differences.
Status 1: a file is not read, or values differ by more than the steps of what holds them."""

import json
import pathlib
import subprocess
import sys

import numpy

import peers
import splat_files

PACKAGES = ("@playcanvas/splat-transform@3.7.0", "three@0.187.0", "@babylonjs/core@9.28.0",
            "@babylonjs/loaders@9.28.0", "@adobe/spz@0.2.3", "@mkkellogg/gaussian-splats-3d@0.4.7",
            "gltf-validator@2.0.0-dev.3.10", "fflate@0.8.2")
TRANSFORM = "splat-transform"

# Format, and who reads what we write of it.
WRITTEN = (("ply", (TRANSFORM, "three.js", "Babylon.js")),
           ("compressed.ply", (TRANSFORM, "Babylon.js")),
           ("stg.ply", (TRANSFORM, "three.js", "Babylon.js")),
           ("spz", (TRANSFORM, "three.js", "Niantic SPZ")),
           ("sog", (TRANSFORM,)),
           ("glb", ("three.js", "Babylon.js", "glTF validator")))
# Format, who writes it, and who else reads that.
READ = (("ply", TRANSFORM, ("three.js", "Babylon.js")),
        ("compressed.ply", TRANSFORM, ("Babylon.js",)),
        ("spz", TRANSFORM, ("three.js", "Niantic SPZ")),
        ("spz", "Niantic SPZ 2", ("three.js", "Babylon.js", TRANSFORM)),
        ("spz", "Niantic SPZ 3", ("three.js", "Babylon.js", TRANSFORM)),
        ("spz", "Niantic SPZ 4", ("three.js", TRANSFORM)),
        ("sog", TRANSFORM, ()),
        ("glb", TRANSFORM, ("three.js", "Babylon.js")),
        ("glb", "turned nodes", ("three.js", "Babylon.js")),
        ("splat", "its description", ("three.js", "Babylon.js", TRANSFORM)),
        ("ksplat", "GaussianSplats3D 0", ("three.js", TRANSFORM)),
        ("ksplat", "GaussianSplats3D 1", ("three.js", TRANSFORM)),
        ("ksplat", "GaussianSplats3D 2", ("three.js", TRANSFORM)))


class Bench:
    def __init__(self, tool, folder):
        self.tool, self.folder = tool, folder
        self.failed = False

    def node(self, jobs):
        """For each (party, format, from, to) what went wrong, or None."""
        listed = self.folder / "jobs.json"
        listed.write_text(json.dumps([dict(zip(("party", "format", "from", "to"), map(str, job)))
                                      for job in jobs]), encoding="utf-8")
        script = pathlib.Path(__file__).parent / "loaders" / "run.mjs"
        made = subprocess.run(["node", str(script), str(self.folder), str(listed)],
                              stdout=subprocess.PIPE, text=True, check=True)
        return json.loads(made.stdout.splitlines()[-1])

    def transform(self, source, target):
        program = self.folder / "node_modules" / ".bin" / "splat-transform"
        made = subprocess.run([str(program), "-q", "-w", "-g", "cpu", str(source), str(target)],
                              capture_output=True, text=True, check=False)
        return None if made.returncode == 0 else (made.stdout + made.stderr).strip()

    def theirs(self, party, kind, path):
        """What `party` finds in a file: Splats, or a text that says why not."""
        if party == TRANSFORM:
            out = path.with_name(f"{path.name}.their.ply")
            return self.transform(path, out) or splat_files.read_ply(out)
        out = path.with_name(f"{path.name}.{party.split()[0]}.json")
        wrong = self.node([(party, "ply" if kind == "stg.ply" else kind, path, out)])[0]
        return wrong or splat_files.read_json(out)

    def ours(self, path):
        out = path.with_name(f"{path.name}.our.ply")
        self.tool("convert", path, out, "-f")
        return splat_files.read_ply(out)

    def row(self, names, a, b, steps):
        """A line of a table: how far two readings are from each other."""
        for found in (a, b):
            if isinstance(found, str):
                self.failed = True
                return [*names, found.replace("\n", " "), "", "", ""]
        found = splat_files.differences(a, b)
        wrong = [name for name, value in found.items() if not value <= steps[name]]
        self.failed = self.failed or bool(wrong)
        return [*names, *(f"{value:.1g}{' (!)' if name in wrong else ''}"
                          for name, value in found.items())]

    def written(self):
        """Rows of what others find in our files, and one for each file against its source."""
        source = splat_files.make_ply(self.folder / "source.ply", 3)
        for kind, parties in WRITTEN:
            path = self.folder / f"ours.{kind}"
            self.tool("convert", source, path, "-f")
            mine = self.ours(path)
            yield self.row([kind, "the source"], splat_files.read_ply(source), mine,
                           splat_files.steps_of(kind))
            for party in parties:
                found = self.theirs(party, kind, path)
                if party == "glTF validator":
                    self.failed = self.failed or isinstance(found, str)
                    yield [kind, party, found if isinstance(found, str) else "no complaint", *[""] * 3]
                else:
                    yield self.row([kind, party], mine, found, splat_files.steps_of(party))

        yield from self.placed(source)

    def placed(self, source):
        """Rows of a scene with axes, origin and scale of its own, against what it has to be with y up."""
        raw = self.folder / "placed.safetensors"
        self.tool("convert", source, raw, "-f")
        world = splat_files.place(raw)
        for kind, party in (("glb", "three.js"), ("spz", "Niantic SPZ")):
            path = self.folder / f"placed.{kind}"
            self.tool("convert", raw, path, "-f")
            if kind == "spz":  # has axes alone
                world = numpy.diag([1.0, -1, -1, 1])
            yield self.row([f"{kind}, y down", party], splat_files.read_ply(source, world),
                           self.theirs(party, kind, path),
                           splat_files.steps_of(kind if kind == "spz" else party))

        splat_files.state_axes(self.folder / "ours.spz", self.folder / "axes.spz")
        self.tool("convert", self.folder / "axes.spz", self.folder / "up.spz", "-f")
        party = "Niantic SPZ, y up"
        yield self.row(["spz, axes of an extension", party], self.ours(self.folder / "up.spz"),
                       self.theirs(party, "spz", self.folder / "axes.spz"), splat_files.steps_of("spz"))

    def make(self, kind, party):
        """A file of the format by `party`; a text says why there is none."""
        path = self.folder / f"{party.replace(' ', '_')}.{kind}"
        source = splat_files.make_ply(self.folder / "source2.ply", 2 if kind == "ksplat" else 3)
        if party == "its description":
            return splat_files.make_splat(path)
        if party == "turned nodes":
            self.tool("convert", source, self.folder / "still.glb", "-f")
            return splat_files.turn_glb(self.folder / "still.glb", path)
        if party == TRANSFORM:
            return self.transform(source, path) or path
        if kind == "spz":
            spz = self.folder / "all.spz"
            self.tool("convert", source, spz, "-f")
            source = spz
        return self.node([(party, kind, source, path)])[0] or path

    def read(self):
        """Rows of what we find in files of others, and what others do."""
        for kind, maker, parties in READ:
            path = self.make(kind, maker)
            if isinstance(path, str):
                self.failed = True
                yield [kind, maker, path, *[""] * 4]
                continue
            mine = self.ours(path)
            for party in parties or (TRANSFORM,):
                yield self.row([kind, maker, party], mine, self.theirs(party, kind, path),
                               splat_files.steps_of(f"splat, {party}" if kind == "splat" and
                                                    party == TRANSFORM else party))


def table(heads, rows):
    heads = [*heads, *splat_files.NAMES]
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def main(arguments):
    if len(arguments) != 2:
        print(__doc__.strip())
        return 2
    folder = pathlib.Path(arguments[1])
    folder.mkdir(parents=True, exist_ok=True)
    if not peers.install(folder, PACKAGES):
        print("formats: npm or its packages are not there", file=sys.stderr)
        return 77
    bench = Bench(peers.Tool(arguments[0]), folder)
    print("Packages: " + ", ".join(PACKAGES) + ".\n\nWritten by l4dcodec, and read by it and by another:\n")
    print(table(("format", "against"), bench.written()))
    print("\nWritten by another, and read by l4dcodec and by a third:\n")
    print(table(("format", "written by", "against"), bench.read()))
    return int(bench.failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

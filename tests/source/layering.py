#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Holds the include edges of the source tree against the layers of docs/architecture.md.

usage: layering.py [--self-test]

Exit status 1 where a file includes what its layer must not know, or where a file lies in no layer.
"""

import pathlib
import re
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]

# Layer -> layers it may include, besides itself. A layer is a folder, or a single header that is so
# basic that its folder's rank does not matter. A file belongs to the longest matching name.
LAYERS = {
    "include/l4d": set(),
    "libl4dcodec/math/hd.h": set(),
    "libl4dcodec/base/threads.h": set(),
    # Library and tools write files alike. The header knows nothing but the standard library.
    "libl4dcodec/base/atomic_file.h": set(),
    "libl4dcodec/base": {"include/l4d", "libl4dcodec/math/hd.h", "libl4dcodec/base/threads.h",
                         "libl4dcodec/base/atomic_file.h"},
    "libl4dcodec/math": {"include/l4d", "libl4dcodec/base", "libl4dcodec/base/threads.h",
                         "libl4dcodec/math/hd.h"},
    # What a Gaussian is and what it looks like at an instant. Headers alone, which need nothing to be
    # linked, so that tools may use them too.
    "libl4dcodec/scene": {"include/l4d", "libl4dcodec/math", "libl4dcodec/math/hd.h"},
    "libl4dcodec/entropy": {"include/l4d", "libl4dcodec/base", "libl4dcodec/base/threads.h"},
}


def _above(name, *below):
    """Adds a layer that may include `below` and all that those may include."""
    allowed = set()
    for layer in below:
        allowed |= {layer} | LAYERS[layer]
    LAYERS[name] = allowed


_above("libl4dcodec/container", "libl4dcodec/entropy", "libl4dcodec/math", "libl4dcodec/scene")
_above("libl4dcodec/quant", "libl4dcodec/container")
_above("libl4dcodec/cuda", "libl4dcodec/base")
_above("decoder/read", "libl4dcodec/quant")
_above("decoder/expand", "decoder/read")
_above("decoder/session", "decoder/expand")
_above("decoder/playback", "decoder/session")
_above("decoder/check", "decoder/session")
_above("decoder/copy", "decoder/session")
_above("decoder/cuda", "decoder/session", "libl4dcodec/cuda")
_above("encoder", "decoder/check", "decoder/copy")
_above("encoder/search/cuda", "encoder", "libl4dcodec/cuda")
# The roof: it sees both directions, and nothing includes it.
_above("api", "encoder", "decoder/copy", "decoder/playback", "decoder/cuda", "encoder/search/cuda")
# Customers of the public API: of internals they know nothing.
_above("io", "include/l4d", "libl4dcodec/base/threads.h", "libl4dcodec/base/atomic_file.h")
# But for what a Gaussian is and looks like: inline functions of public types.
LAYERS["io"].add("libl4dcodec/scene")
# Beside the codec: it knows what both directions share, and streams through the public API.
# Contracts that device code fills, without a type of CUDA, so that renderers may know them.
LAYERS["render/view/view.h"] = {"include/l4d", "libl4dcodec/scene"}
LAYERS["render/cuda/frame/image_target.h"] = {"include/l4d"}
LAYERS["render/cuda/importance/device_importance.h"] = {"include/l4d", "libl4dcodec/base"}
_above("render/cuda/scene/device_renderer.h", "render/view/view.h", "render/cuda/frame/image_target.h",
       "render/cuda/importance/device_importance.h")
LAYERS["render/cuda/player/resident_buckets.h"] = set()
_above("render/cuda/player/bucket_feed.h", "libl4dcodec/base", "render/cuda/player/resident_buckets.h")
_above("render", "libl4dcodec/math", "libl4dcodec/scene", "render/cuda/scene/device_renderer.h",
       "render/cuda/player/bucket_feed.h")
_above("render/cuda", "render", "libl4dcodec/cuda")
_above("render/api", "render/cuda")
# Evaluations: neither command lines nor documents, so that whoever measures can use them.
_above("eval", "io")
# Man pages and completions of command lines.
_above("pages")
_above("cli", "eval", "pages")
_above("examples", "include/l4d")
# The companion that makes scenes of videos: a customer too.
_above("training", "eval", "pages")
LAYERS["training"].add("libl4dcodec/math/hd.h")
_above("training/cuda", "training", "libl4dcodec/cuda")
# The decoder for web pages: another customer.
_above("web/wasm", "include/l4d", "libl4dcodec/scene", "libl4dcodec/base")
# The Python package knows the C API by the headers of which it reads the declarations. One file brings
# what io and eval do beside it.
_above("python", "include/l4d")
_above("python/scenes.cc", "python", "eval")
_above("bench/tables", "eval")
_above("bench/accuracy", "eval")
_above("bench/micro", "encoder", "io", "render", "bench/tables")
_above("bench/gpu", "encoder/search/cuda", "decoder/cuda", "render/cuda", "bench/tables")
_above("tests", "encoder/search/cuda", "decoder/playback", "decoder/cuda", "eval", "render/cuda")
_above("tests/api", "include/l4d")
LAYERS["tests/api"].add("tests/common")
_above("tests/common", "encoder/search/cuda", "decoder/cuda", "io")
_above("tests/cli", "cli")
LAYERS["tests"].add("tests/common")
# With the module that they are of, so that nothing outside knows it.
_above("training/tests", "training/cuda", "tests")
_above("training/bench", "training/cuda", "bench/gpu")

# Headers from outside -> layers, or single files, that may include them. Others of the outside (the standard library, the
# operating system) are not restricted.
OUTSIDE = {
    "l4d_generated.h": {"libl4dcodec/container", "tests", "tests/common"},
    "flatbuffers/": {"libl4dcodec/container", "tests", "tests/common"},
    "zstd.h": {"libl4dcodec/entropy", "io", "tests", "tests/common", "bench/micro"},
    "xxhash.h": {"libl4dcodec/base", "cli/input/arrays.cc", "cli/http/file_body.h", "training", "training/tests", "tests",
                 "tests/common"},
    "hwy/": {"libl4dcodec/entropy", "api", "decoder/expand", "encoder", "render", "tests",
             "tests/common", "bench/micro", "bench/tables/decode.cc"},
    "cuda_runtime_api.h": {"libl4dcodec/cuda", "decoder/cuda", "encoder/search/cuda", "render/cuda",
                           "training/cuda", "training/tests", "training/bench", "tests", "bench/gpu", "examples"},
    "cuda_runtime.h": {"libl4dcodec/cuda", "decoder/cuda", "encoder/search/cuda", "render/cuda",
                       "training/cuda", "training/tests", "training/bench", "tests", "bench/gpu"},
    "cub/": {"decoder/cuda", "encoder/search/cuda", "render/cuda"},
    "omp.h": {"libl4dcodec/base/threads.h"},
    "Eigen/": {"encoder", "io", "eval/image/lpips_stages.cc", "training/run/train/refine.cc",
               "tests", "tests/common", "bench/micro", "bench/accuracy", "bench/tables/flat.cc"},
    "jpeglib.h": {"io", "tests/common"},
    "png.h": {"io"},
    "zlib.h": {"io", "tests"},
    "microhttpd.h": {"cli/http/listener.cc"},
    # These two take seconds to compile wherever they are included: the tool sees the parser of command
    # lines through cli/command/options.h, and JSON through cli/text/json.h.
    "CLI/": {"training/cli/command.h", "cli/main.cc", "cli/command/options.cc", "pages/manual.cc", "cli/command/help.h",
             "cli/verbs/version.cc"},
    "toml++/": {"training/capture/calibration_toml.cc"},
    "nlohmann/": {"io", "training", "training/tests", "cli/text/json.cc", "tests", "tests/cli", "tests/common",
                  "bench/tables", "bench/accuracy"},
    "gtest/": {"training/tests", "tests", "tests/api", "tests/cli", "tests/common"},
    "gmock/": {"training/tests", "tests", "tests/api", "tests/cli", "tests/common"},
    "benchmark/": {"bench/micro"},
}

# Folder -> its folders in the order in which data flows; "" is the folder's own files. A file includes
# files of its own folder and of those before it.
ORDER = {
    "cli": ["text", "command", "input", "http", "verbs", ""],
    "eval": ["", "scene", "pair", "views", "jod", "image", "target", "refit"],
    "encoder": ["prepare", "plan", "search", "component", "layer", "file", "", "session"],
    "io": ["scene", "file", "ply", "formats", "sequence", "image", "camera", "synth"],
    "render": ["view", "frame", "cpu", "cuda", "", "importance", "api"],
    "render/cuda": ["kernel", "store", "frame", "backward", "importance", "scene", "player"],
    "training": ["capture", "model", "density", "step", "images", "sync", "footage", "init", "cuda", "run", "cli", "tests", "bench"],
    "training/run": ["setup", "train", "record", "report", ""],
}

SOURCE_SUFFIXES = {".h", ".hpp", ".c", ".cc", ".inc", ".cu", ".cuh"}
TOP_FOLDERS = sorted({name.split("/")[0] for name in LAYERS})
# Programs of a stranger: they are compiled against an installed library and no file of the tree.
EXCLUDED = ("tests/install/",)

INCLUDE = re.compile(r'^\s*#\s*include\s*["<]([^">]+)[">]')


def layer_of(path):
    """The layer of a path relative to the root, or None."""
    best = None
    for name in LAYERS:
        if (path == name or path.startswith(name + "/")) and (best is None or len(name) > len(best)):
            best = name
    return best


def target_of(header, includer):
    """Root-relative path that an include line names, or None for a header from outside."""
    if header.startswith("l4d/"):
        return "include/" + header
    if header.split("/")[0] in TOP_FOLDERS:
        return header
    if header.startswith("."):
        return (pathlib.PurePosixPath(includer).parent / header).as_posix()
    return None


def place_in_order(folder, path):
    """The place of a path in ORDER[folder]: a number, or None if the folder does not have it."""
    if not path.startswith(folder + "/"):
        return None
    inner = path[len(folder) + 1:].split("/")
    name = inner[0] if len(inner) > 1 else ""
    return ORDER[folder].index(name) if name in ORDER[folder] else -1


def check_order(path, target):
    """A message if the file at `path` includes `target` against ORDER, or None."""
    for folder in ORDER:
        own, other = place_in_order(folder, path), place_in_order(folder, target)
        if own == -1:
            return f"{folder}: its folder is missing in ORDER"
        if own is not None and other is not None and other > own:
            return f"must not include {target}, which comes later in {folder}"
    return None


def check_file(path, text):
    """Yields one message per forbidden include of the file at the root-relative `path`."""
    layer = layer_of(path)
    if layer is None:
        yield f"{path}: lies in no layer of tests/source/layering.py"
        return
    for number, line in enumerate(text.splitlines(), start=1):
        match = INCLUDE.match(line)
        if not match:
            continue
        header = match.group(1)
        where = f"{path}:{number}"
        if ".." in header.split("/"):
            yield f"{where}: {header}: include paths start at the root"
            continue
        target = target_of(header, path)
        if target is not None:
            other = layer_of(target)
            if other is None:
                yield f"{where}: {header}: lies in no layer"
            elif other != layer and other not in LAYERS[layer]:
                yield f"{where}: {layer} must not include {other} ({header})"
            elif check_order(path, target):
                yield f"{where}: {check_order(path, target)}"
            continue
        for prefix, allowed in OUTSIDE.items():
            # Folder prefixes end in "/", the rest are whole names.
            hit = header.startswith(prefix) if prefix.endswith("/") else header == prefix
            if hit and layer not in allowed and path not in allowed:
                yield f"{where}: {layer} must not include {header}"


def check_tree(root):
    """(number of files looked at, messages)"""
    files = 0
    messages = []
    for top in TOP_FOLDERS:
        for path in sorted((root / top).rglob("*")):
            relative = path.relative_to(root).as_posix()
            if path.suffix not in SOURCE_SUFFIXES or relative.startswith(EXCLUDED):
                continue
            files += 1
            messages += check_file(relative, path.read_text(encoding="utf-8"))
    return files, messages


def folder_edges():
    """{folder at the top of the tree: other such folders that it may include}"""
    edges = {}
    for layer, allowed in LAYERS.items():
        top = layer.split("/")[0]
        edges.setdefault(top, set()).update({other.split("/")[0] for other in allowed} - {top})
    return edges


def find_cycle(edges):
    """A list of names that may include each other in a circle, or None."""
    state = {}

    def visit(layer, path):
        state[layer] = "open"
        for other in sorted(edges[layer]):
            if state.get(other) == "open":
                return path + [layer, other]
            if other not in state:
                cycle = visit(other, path + [layer])
                if cycle:
                    return cycle
        state[layer] = "done"
        return None

    for layer in edges:
        if layer not in state:
            cycle = visit(layer, [])
            if cycle:
                return cycle
    return None


def self_test():
    """Small trees of one file, each with a known verdict."""
    cases = [
        ("decoder/expand/a.cc", '#include "libl4dcodec/container/page.h"', True),
        ("decoder/expand/a.cc", '#include "encoder/encoder.h"', False),
        ("decoder/expand/a.cc", '  #  include  "encoder/encoder.h"', False),
        ("decoder/expand/a.cc", '// #include "encoder/encoder.h"', True),
        ("decoder/expand/a.cc", '#include "../encoder/encoder.h"', False),
        ("decoder/read/a.cc", '#include "decoder/expand/expand.h"', False),
        ("decoder/session/a.cc", '#include "decoder/check/inspection.h"', False),
        ("decoder/check/a.cc", '#include "decoder/session/decoder.h"', True),
        ("encoder/a.cc", '#include "decoder/read/plan.h"', True),
        ("encoder/a.cc", "#include <Eigen/Core>", True),
        ("decoder/expand/a.cc", "#include <Eigen/Core>", False),
        ("decoder/expand/a.cc", "#include <vector>", True),
        ("libl4dcodec/entropy/a.h", '#include "libl4dcodec/base/ordered.h"', True),
        ("render/a.cc", '#include "libl4dcodec/scene/slice.h"', True),
        ("render/a.cc", '#include "decoder/session/decoder.h"', False),
        ("encoder/a.cc", '#include "render/renderer.h"', False),
        ("io/file/a.cc", '#include "libl4dcodec/base/threads.h"', True),
        ("libl4dcodec/entropy/a.h", '#include "libl4dcodec/quant/codebook.h"', False),
        ("libl4dcodec/base/a.h", '#include "libl4dcodec/math/hd.h"', True),
        ("libl4dcodec/base/a.h", '#include "libl4dcodec/math/rotor.h"', False),
        ("libl4dcodec/container/a.h", '#include "libl4dcodec/quant/codebook.h"', False),
        ("libl4dcodec/container/a.cc", "#include <zstd.h>", False),
        ("include/l4d/a.h", '#include "libl4dcodec/base/status.h"', False),
        ("io/file/a.cc", '#include "l4d/decode.h"', True),
        ("io/file/a.cc", '#include "libl4dcodec/base/half.h"', False),
        ("io/file/a.cc", '#include "libl4dcodec/scene/slice.h"', True),
        ("cli/a.cc", '#include "libl4dcodec/scene/slice.h"', True),
        ("libl4dcodec/scene/a.h", '#include "libl4dcodec/base/status.h"', False),
        ("io/file/a.cc", '#include "libl4dcodec/base/atomic_file.h"', True),
        ("libl4dcodec/base/atomic_file.h", '#include "libl4dcodec/base/status.h"', False),
        ("libl4dcodec/base/atomic_file.cc", '#include "libl4dcodec/base/atomic_file.h"', True),
        ("libl4dcodec/math/a.h", '#include "libl4dcodec/base/atomic_file.h"', False),
        ("cli/a.cc", '#include "io/scene/scene.h"', True),
        ("cli/a.cc", '#include "decoder/session/decoder.h"', False),
        ("eval/a.cc", '#include "io/scene/scene.h"', True),
        ("eval/a.cc", '#include "l4d/render.hpp"', True),
        ("eval/a.cc", '#include "cli/command/context.h"', False),
        ("eval/a.cc", '#include "decoder/session/decoder.h"', False),
        ("eval/a.cc", '#include "libl4dcodec/base/threads.h"', True),
        ("eval/a.cc", "#include <nlohmann/json.hpp>", False),
        ("eval/a.cc", "#include <CLI/CLI.hpp>", False),
        ("io/file/a.cc", '#include "eval/pair/pairing.h"', False),
        ("cli/verbs/a.cc", '#include "eval/pair/pairing.h"', True),
        ("training/step/a.cc", '#include "io/image/image.h"', True),
        ("training/step/a.cc", '#include "libl4dcodec/scene/slice.h"', True),
        ("training/step/a.cc", '#include "libl4dcodec/base/status.h"', False),
        ("training/step/a.cc", '#include "render/frame/scene.h"', False),
        ("training/step/a.cc", '#include "cli/command/context.h"', False),
        ("io/file/a.cc", '#include "training/step/loss.h"', False),
        ("python/scenes.h", '#include "l4d/render.h"', True),
        ("python/scenes.h", '#include "io/scene/scene.h"', False),
        ("python/scenes.cc", '#include "eval/pair/pairing.h"', True),
        ("python/scenes.cc", '#include "cli/command/context.h"', False),
        ("python/scenes.cc", '#include "decoder/session/decoder.h"', False),
        ("python/other.cc", '#include "io/scene/scene.h"', False),
        ("eval/a.cc", '#include "python/scenes.h"', False),
        ("bench/accuracy/a.cc", '#include "eval/image/fidelity_meter.h"', True),
        ("cli/command/options.cc", "#include <CLI/CLI.hpp>", True),
        ("cli/verbs/a.cc", "#include <CLI/CLI.hpp>", False),
        ("cli/text/json.cc", "#include <nlohmann/json.hpp>", True),
        ("cli/command/context.h", "#include <nlohmann/json.hpp>", False),
        ("io/file/a.cc", "#include <nlohmann/json.hpp>", True),
        ("decoder/expand/a.cc", "#include <nlohmann/json.hpp>", False),
        ("io/file/a.cc", "#include <png.h>", True),
        ("cli/a.cc", "#include <png.h>", False),
        ("tests/math/a.cc", '#include "libl4dcodec/math/rotor.h"', True),
        ("tests/math/a.cc", '#include "cli/command/context.h"', False),
        ("tests/api/a.cc", '#include "decoder/session/decoder.h"', False),
        ("api/a.cc", '#include "encoder/encoder.h"', True),
        ("api/a.cc", '#include "decoder/cuda/device_decoder.h"', True),
        ("api/a.cc", '#include "io/scene/scene.h"', False),
        ("encoder/a.cc", '#include "api/decoder_handle.h"', False),
        ("libl4dcodec/base/a.cc", '#include "api/decoder_handle.h"', False),
        ("render/cuda/a.cc", '#include "api/decoder_handle.h"', False),
        ("tests/decoder/a.cc", '#include "api/decoder_handle.h"', False),
        ("libl4dcodec/novel/a.cc", "", False),
        ("encoder/layer/a.cc", '#include "encoder/plan/layers.h"', True),
        ("encoder/plan/a.cc", '#include "encoder/layer/layer_coder.h"', False),
        ("encoder/search/cuda/a.cc", '#include "encoder/search/nearest.h"', True),
        ("encoder/search/cuda/a.cc", '#include "encoder/layer/layer_coder.h"', False),
        ("io/ply/a.cc", '#include "io/file/file.h"', True),
        ("io/ply/a.cc", '#include "io/image/image.h"', False),
        ("io/a.cc", '#include "io/file/file.h"', False),
        ("render/frame/a.cc", '#include "render/view/view.h"', True),
        ("render/view/a.cc", '#include "render/frame/frame.h"', False),
        ("render/cuda/store/a.cc", '#include "render/cuda/player/a.h"', False),
        ("render/cuda/player/a.cc", '#include "render/cuda/store/a.h"', True),
        ("render/api/a.cc", '#include "render/renderer.h"', True),
        ("training/run/train/a.cc", '#include "training/run/setup/settings.h"', True),
        ("training/run/setup/a.cc", '#include "training/run/train/trainer.h"', False),
        ("training/model/a.cc", '#include "training/step/backend.h"', False),
        ("training/tests/a.cc", '#include "tests/common/codec.h"', True),
        ("training/run/a.cc", '#include "tests/common/codec.h"', False),
        ("tests/gpu/a.cc", '#include "training/cuda/device_model.h"', False),
        ("render/novel/a.cc", '#include "render/renderer.h"', False),
    ]
    failures = 0
    for path, line, good in cases:
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / path
            file.parent.mkdir(parents=True)
            file.write_text(line + "\n", encoding="utf-8")
            files, messages = check_tree(pathlib.Path(folder))
        if files != 1 or (not messages) != good:
            failures += 1
            print(f"self-test: {path}: {line}: expected {'no ' if good else ''}complaint")
    for what, edges in (("layers", LAYERS), ("folders at the top", folder_edges())):
        cycle = find_cycle(edges)
        if cycle:
            failures += 1
            print(f"self-test: the {what} have a cycle: " + " -> ".join(cycle))
    if find_cycle({"a": {"b"}, "b": {"c"}, "c": {"a"}}) is None:
        failures += 1
        print("self-test: a cycle is not found")
    print(f"{len(cases) + 3 - failures} of {len(cases) + 3} cases right")
    return failures == 0


def main(arguments):
    if arguments == ["--self-test"]:
        return 0 if self_test() else 1
    if arguments:
        print(__doc__.strip())
        return 2
    files, messages = check_tree(ROOT)
    for message in messages:
        print(message)
    print(f"{files} files, {len(messages)} forbidden includes")
    return 1 if messages or files == 0 else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

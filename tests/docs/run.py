#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs what documents print: every fenced block of shell, and every C or C++ program.

    run.py BUILD PAGE...             runs the blocks of each page in one empty folder, from the first to the last
    run.py BUILD PAGE... --with KIND,KIND   also those that are marked so
    run.py --installed PREFIX PAGE...       the same with what is installed in PREFIX
    run.py --list PAGE...            prints each block with its mark
    run.py --self-test               shows on small pages that what fails is found

A block runs unless a comment right above it marks it as one that needs something, such as
`<!-- needs: minutes -->`; kinds are below. Programs are saved as example.c or example.cc, and what CMake reads as
CMakeLists.txt, for the blocks after them, which find the libraries of BUILD by pkg-config and CMake, and its tools by their
names. Images of videos need ffmpeg.
"""

import argparse
import os
import pathlib
import re
import subprocess
import sys
import tempfile

KINDS = {"minutes": "takes minutes", "gpu": "wants a CUDA device", "data": "wants scenes of your own, or of L4D_DATA_DIR",
         "tree": "changes the tree, its build or the system", "tools": "wants programs that ./dev setup does not install",
         "browser": "does not end until it is told to"}
PROGRAMS = {"c": "example.c", "cpp": "example.cc", "cmake": "CMakeLists.txt"}
BLOCK = re.compile(r"(?:<!-- needs: ([^>]*?) -->\n)?^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


class Block:
    def __init__(self, page, text, match):
        self.place = f"{page}:{text.count(chr(10), 0, match.start(2)) + 1}"
        self.needs = [kind.strip() for kind in (match[1] or "").split(",") if kind.strip()]
        self.language, self.body = match[2], match[3]
        unknown = [kind for kind in self.needs if kind not in KINDS]
        if unknown:
            raise SystemExit(f"{self.place}: {', '.join(unknown)} is none of {', '.join(KINDS)}")


def blocks_of(page):
    text = pathlib.Path(page).read_text()
    return [block for block in (Block(page, text, match) for match in BLOCK.finditer(text))
            if block.language == "sh" or block.language in PROGRAMS]


def environment(build, installed):
    paths = [str(pathlib.Path(build).resolve() / "bin"), os.environ["PATH"]]
    out = dict(os.environ, PATH=os.pathsep.join(paths))
    if installed:
        configs = [str(folder) for folder in pathlib.Path(installed).glob("lib*/**/pkgconfig")]
        out["PKG_CONFIG_PATH"] = os.pathsep.join(configs)
        libraries = [str(pathlib.Path(folder).parent) for folder in configs]
        out["LD_LIBRARY_PATH"] = os.pathsep.join(libraries)
        out["CMAKE_PREFIX_PATH"] = installed
    return out


def run_page(page, env, allowed):
    """The number of blocks that ran, and those that were left out. Exits where one fails."""
    ran, left_out = 0, []
    with tempfile.TemporaryDirectory() as folder:
        for block in blocks_of(page):
            missing = [kind for kind in block.needs if kind not in allowed]
            if missing:
                left_out.append(f"{block.place}: {', '.join(KINDS[kind] for kind in missing)}")
                continue
            if block.language in PROGRAMS:
                (pathlib.Path(folder) / PROGRAMS[block.language]).write_text(block.body)
                continue
            done = subprocess.run(["bash", "-euo", "pipefail", "-c", block.body], cwd=folder, env=env, text=True,
                                  stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            if done.returncode != 0:
                raise SystemExit(f"{block.place}: exit status {done.returncode}\n{block.body}---\n{done.stdout}")
            ran += 1
    return ran, left_out


def self_test():
    with tempfile.TemporaryDirectory() as folder:
        def page(text):
            path = pathlib.Path(folder) / "page.md"
            path.write_text(text)
            return str(path)

        env = environment(folder, None)
        assert run_page(page("```sh\necho a > f\n```\n\n```sh\ngrep a f\n```\n"), env, []) == (2, [])
        assert run_page(page("```c\nint x;\n```\n```sh\ngrep x example.c\n```\n```\nfalse\n```\n"), env, []) == (1, [])
        marked = page("<!-- needs: gpu -->\n```sh\nfalse\n```\n")
        ran, left_out = run_page(marked, env, ["minutes"])
        assert ran == 0 and len(left_out) == 1 and "CUDA" in left_out[0], left_out
        for text, allowed in [("```sh\nfalse\ntrue\n```\n", []), ("```sh\nfalse | true\n```\n", []),
                              ("<!-- needs: gpu -->\n```sh\nfalse\n```\n", ["gpu"])]:
            try:
                run_page(page(text), env, allowed)
            except SystemExit as failure:
                assert "exit status" in str(failure)
            else:
                raise AssertionError(f"passed: {text}")
        try:
            blocks_of(page("<!-- needs: luck -->\n```sh\ntrue\n```\n"))
            raise AssertionError("an unknown mark")
        except SystemExit:
            pass
    print("the runner finds what fails")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("arguments", nargs="*")
    parser.add_argument("--with", dest="kinds", default="")
    parser.add_argument("--installed", action="store_true")
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--self-test", action="store_true")
    options = parser.parse_args()
    if options.self_test:
        return self_test()
    if options.list:
        for page in options.arguments:
            for block in blocks_of(page):
                print(f"{block.place}: {block.language}, {', '.join(block.needs) or 'runs'}")
        return None
    build, *pages = options.arguments
    allowed = [kind for kind in options.kinds.split(",") if kind]
    with tempfile.TemporaryDirectory() as made:
        installed = build if options.installed else made
        wants_libraries = any(block.language in PROGRAMS for page in pages for block in blocks_of(page))
        if wants_libraries and not options.installed:
            subprocess.run(["cmake", "--install", build, "--prefix", installed], check=True, stdout=subprocess.DEVNULL)
        env = environment(build, installed if wants_libraries else None)
        for page in pages:
            ran, left_out = run_page(page, env, allowed)
            print(f"{page}: {ran} blocks ran, {len(left_out)} were left out")
            print("".join(f"  {line}\n" for line in left_out), end="")
    return None


if __name__ == "__main__":
    sys.exit(main())

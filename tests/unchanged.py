#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs a test whose outcome depends on some files alone, unless it passed with these files before.

    unchanged.py NAME INPUT... -- COMMAND...
    unchanged.py --self-test

INPUT: a file or folder, from the root of the tree. unchanged.txt has lines "NAME DIGEST": the digest of the inputs
that NAME last passed with. If it is that of the inputs, the test is skipped (exit status 77). Otherwise COMMAND
runs, with the inputs in L4D_INPUTS; if it passes, the line that belongs into unchanged.txt is printed. A line that is out of date costs time and
hides nothing.

L4D_UNCHANGED=run runs it in any case, as ./dev nightly does; L4D_UNCHANGED=write also writes the line."""
import fcntl
import hashlib
import os
import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[1]
LEFT_OUT = {"__pycache__", ".hypothesis", ".pytest_cache"}


def digest(root, inputs):
    """Of the names and contents of all files."""
    paths = []
    for path in (root / name for name in inputs):
        if not path.exists():
            raise SystemExit(f"unchanged: {path} does not exist")
        paths += [path] if path.is_file() else [p for p in path.rglob("*") if p.is_file()]
    out = hashlib.sha256()
    for path in sorted({p for p in paths if not LEFT_OUT & set(p.parts)}):
        data = path.read_bytes()
        out.update(f"{path.relative_to(root)}\0{len(data)}\0".encode())
        out.update(data)
    return out.hexdigest()[:32]


def known(table):
    lines = table.read_text(encoding="utf-8").splitlines() if table.exists() else []
    return dict(line.split() for line in lines if line and not line.startswith("#"))


def write(table, name, value):
    """Several tests may end at once."""
    with open(table, "a+", encoding="utf-8") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        comments = [line for line in file.read().splitlines() if line.startswith("#")]
        lines = comments + [f"{key} {digest}" for key, digest in sorted({**known(table), name: value}.items())]
        file.truncate(0)
        file.write("\n".join([*lines, ""]))


def run(root, table, name, inputs, command, mode):
    before = digest(root, inputs)
    if known(table).get(name) == before and not mode:
        print(f"skipped: passed before with the same {', '.join(inputs)} (./dev nightly runs it)")
        return 77
    names = {**os.environ, "L4D_INPUTS": " ".join(inputs)}
    status = subprocess.run(command, check=False, env=names).returncode
    if status == 0 and digest(root, inputs) != before:
        print(f"FAIL: {name} changes its own inputs", file=sys.stderr)
        return 1
    if status == 0 and known(table).get(name) != before:
        if mode == "write":
            write(table, name, before)
        else:
            print(f"for tests/{table.name}: {name} {before}")
    return status


def self_test():
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        (root / "in").mkdir()
        (root / "in" / "a").write_text("1", encoding="utf-8")
        table = root / "unchanged.txt"
        passes, fails = ["true"], ["false"]
        assert run(root, table, "t", ["in"], fails, "write") == 1
        assert known(table) == {}, "what failed is not taken down"
        assert run(root, table, "t", ["in"], passes, "") == 0 and known(table) == {}
        assert run(root, table, "t", ["in"], passes, "write") == 0
        assert run(root, table, "t", ["in"], fails, "") == 77
        assert run(root, table, "t", ["in"], fails, "run") == 1
        assert run(root, table, "u", ["in"], fails, "") == 1, "another test"
        (root / "in" / "b").write_text("", encoding="utf-8")
        assert run(root, table, "t", ["in"], fails, "") == 1, "a new file"
        (root / "in" / "b").unlink()
        assert run(root, table, "t", ["in"], fails, "") == 77
        (root / "in" / "a").rename(root / "in" / "c")
        assert run(root, table, "t", ["in"], fails, "") == 1, "another name"
        told = ["sh", "-c", 'test "$L4D_INPUTS" = "in unchanged.txt"']
        assert run(root, table, "v", ["in", "unchanged.txt"], told, "") == 0, "the inputs are in L4D_INPUTS"
        touches = ["touch", str(root / "in" / "d")]
        assert run(root, table, "t", ["in"], touches, "") == 1, "a test that writes into its inputs"
    print("unchanged: self-test passed")
    return 0


def main(arguments):
    if arguments == ["--self-test"]:
        return self_test()
    cut = arguments.index("--")
    mode = os.environ.get("L4D_UNCHANGED", "")
    if mode not in ("", "run", "write"):
        raise SystemExit(f"unchanged: L4D_UNCHANGED is '{mode}'; it is run, write or empty")
    return run(ROOT, ROOT / "tests" / "unchanged.txt", arguments[0], arguments[1:cut], arguments[cut + 1:], mode)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

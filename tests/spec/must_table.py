#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The table of rules: every clause of spec/l4d.md, the code that checks it, the tests that hold it.

  must_table.py           prints the table
  must_table.py --write   writes spec/must_table.md
  must_table.py --check   prints the table and fails if
                            a clause is defined twice, or cited by code or tests and not defined,
                            a MUST has no test,
                            or spec/must_table.md is not what --write would write

A clause is defined by a list item of l4d.md that begins with its id in bold. Code cites it as a
string. A test file says with a comment which clauses a test holds: `spec: ID`, or several ids with
commas between.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SPEC = ROOT / "spec" / "l4d.md"
TABLE = ROOT / "spec" / "must_table.md"
CODE = ("libl4dcodec", "decoder", "encoder", "api")
ID = r"[A-Z]{2,4}-\d+"


def clauses():
    """[(id, text)] in order of the document."""
    spec = SPEC.read_text(encoding="utf-8")
    items = re.findall(rf"^- \*\*({ID})\*\* (.*(?:\n  .*)*)", spec, re.M)
    return [(key, " ".join(text.split())) for key, text in items]


def first_sentence(text):
    return re.split(r"(?<=[.)])\s+(?=[A-Z(])", text, maxsplit=1)[0].replace("|", "\\|")


def files(folders, suffixes):
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in suffixes and path.is_file() and "__pycache__" not in path.parts:
                yield path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")


def citations():
    """id -> files of code that cite it in a string; comments do not count."""
    out = {}
    for name, text in files(CODE, {".cc", ".h"}):
        for key in re.findall(rf'"({ID})"', re.sub(r"//[^\n]*", "", text)):
            out.setdefault(key, set()).add(name)
    return out


def tests():
    """id -> files of tests that are tagged with it."""
    out = {}
    for name, text in files(("tests",), {".cc", ".h", ".c", ".py", ".sh"}):
        for tag in re.findall(rf"\bspec: ({ID}(?:\s*,\s*{ID})*)", text):
            for key in re.findall(ID, tag):
                out.setdefault(key, set()).add(name)
    return out


def table(rules, code, held):
    lines = ["<!-- written by tests/spec/must_table.py -->", "# Rules of the bitstream", "",
             "Each rule of [l4d.md](l4d.md), the code that checks it, and the tests that hold it.",
             "",
             "| id | rule | checked in | tests |", "|---|---|---|---|"]
    cell = lambda names: "<br>".join(sorted(names)) or "-"
    lines += [f"| {key} | {first_sentence(text)} | {cell(code.get(key, ()))} "
              f"| {cell(held.get(key, ()))} |" for key, text in rules]
    return "\n".join(lines) + "\n"


def problems(rules, code, held):
    ids = [key for key, _ in rules]
    twice = sorted({key for key in ids if ids.count(key) > 1})
    out = [f"{key} is defined more than once" for key in twice]
    for what, found in (("cited", code), ("tagged", held)):
        out += [f"{key} is {what} in {', '.join(sorted(found[key]))} and not defined in l4d.md"
                for key in sorted(found) if key not in ids]
    out += [f"{key} has no test: add `spec: {key}` to one"
            for key, text in rules if "MUST" in text and key not in held]
    return out


def main():
    rules, code, held = clauses(), citations(), tests()
    text = table(rules, code, held)
    if "--write" in sys.argv:
        TABLE.write_text(text, encoding="utf-8")
        return 0
    print(text, end="")
    if "--check" not in sys.argv:
        return 0
    found = problems(rules, code, held)
    if not TABLE.exists() or TABLE.read_text(encoding="utf-8") != text:
        found.append("spec/must_table.md is out of date: run must_table.py --write")
    print("\n".join(found) if found else f"{len(rules)} rules, all with tests")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())

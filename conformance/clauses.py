#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The map of clauses: each MUST of spec/l4d.md and the vectors that hold it.

  clauses.py           prints it
  clauses.py --write   writes clauses.md
  clauses.py --check   exit status 1 if clauses.md is not what --write would write, if a clause that a file can
                       break has no faulty vector, or a vector names a clause that is not defined
"""

import json
import sys
from pathlib import Path

sys.dont_write_bytecode = True
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE / "generate"), str(HERE / "reference"), str(HERE.parent / "spec" / "examples"),
                str(HERE.parent / "tests" / "spec")]

import faults           # noqa: E402
import must_table       # noqa: E402

PAGE = HERE / "clauses.md"
MOST_NAMED = 3


def vectors():
    """clause -> (legal vectors, faulty ones)"""
    suite = json.loads((HERE / "suite.json").read_text(encoding="utf-8"))
    out = {}
    for vector in suite["vectors"]:
        for clause in vector["clauses"]:
            out.setdefault(clause, ([], []))[vector["group"] == "faulty"].append(vector["name"])
    return out


def musts():
    return [(key, text) for key, text in must_table.clauses() if "MUST" in text]


def cell(names):
    short = [name.split("/", 1)[1] for name in names[:MOST_NAMED]]
    more = len(names) - MOST_NAMED
    return ", ".join(short) + (f" and {more} more" if more > 0 else "") if names else "-"


def page(found):
    negative = [key for key, _ in musts() if found.get(key, ([], []))[1]]
    checkable = [key for key, _ in musts() if key not in faults.NOT_CHECKABLE]
    lines = ["<!-- written by conformance/clauses.py -->", "# Clauses and vectors", "",
             "Each rule of [the specification](../spec/l4d.md), the vectors of the suite that exercise it, those that",
             "break it. [Another page](../spec/must_table.md) lists the code that checks each rule, and tests of it.", "",
             f"{len(musts())} rules. A file can break {len(checkable)} of them, and {len(negative)} have a faulty vector",
             f"here; {', '.join(sorted(faults.LARGE))} need files of megabytes, which `generate.py --limits` makes.", "",
             "| rule | legal vectors | faulty vectors |", "|---|---|---|"]
    for key, _ in musts():
        legal, faulty = found.get(key, ([], []))
        lines.append(f"| {key} | {cell(legal)} | {cell(faulty)} |")
    lines += ["", "Rules that no file can break:", "", "| rule | why |", "|---|---|"]
    lines += [f"| {key} | {why} |" for key, why in faults.NOT_CHECKABLE.items()]
    return "\n".join(lines) + "\n"


def problems(found):
    defined = {key for key, _ in must_table.clauses()}
    out = [f"{key} of {sum(parts, [])[0]} is no clause" for key, parts in found.items() if key not in defined]
    for key, _ in musts():
        negative = found.get(key, ([], []))[1] or key in faults.LARGE
        if bool(negative) == (key in faults.NOT_CHECKABLE):
            out.append(f"{key} has " + ("a faulty vector and a reason to have none" if negative else
                                        "neither a faulty vector nor a reason to have none (faults.py)"))
    return out


def main(arguments):
    found = vectors()
    text = page(found)
    if "--write" in arguments:
        PAGE.write_text(text, encoding="utf-8")
    elif "--check" not in arguments:
        print(text, end="")
        return 0
    wrong = problems(found)
    if PAGE.read_text(encoding="utf-8") != text:
        wrong.append("clauses.md is out of date: clauses.py --write")
    print("\n".join(wrong) if wrong else f"{len(musts())} rules")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

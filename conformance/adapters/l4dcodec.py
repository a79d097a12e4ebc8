#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The tool l4dcodec as the contract of the suite has it:

  run.py -- python3 adapters/l4dcodec.py PATH_OF_L4DCODEC [--backend reference]
  run.py --adapter adapters/l4dcodec.py -- PATH_OF_L4DCODEC [--backend reference]      the same, faster

Everything before --query is the tool and options of its own.
"""

import json
import re
import subprocess
import sys

KINDS = {"L4D_ERR_NOT_L4D": "no-l4d", "L4D_ERR_VERSION_UNSUPPORTED": "version",
         "L4D_ERR_FEATURE_UNSUPPORTED": "feature", "L4D_ERR_TRUNCATED": "truncated",
         "L4D_ERR_CHECKSUM": "checksum", "L4D_ERR_CORRUPT": "rule", "L4D_ERR_LIMIT_EXCEEDED": "limit"}
PROFILES = {None: 0, "indexed": 1, "main": 2, "lossless": 3}
QUANTITIES = {"instant_gaussians": "gaussians", "table_bytes": "table_bytes", "instant_bytes": "instant_bytes",
              "start_bytes": "start_bytes", "memory_bytes": "memory_bytes", "instant_symbols": "symbols"}


def command_of(arguments):
    """(verb, options of the tool) of the arguments of the contract"""
    if arguments[1] in ("validate", "demand"):
        return "validate", []
    kind, *times = arguments[1].split(":")
    options = {"all": [], "time": ["--time={}"], "range": ["--from={}", "--to={}"]}[kind]
    out = ["--digest", *(o.format(t) for o, t in zip(options, times))]
    rest = arguments[2:]
    names = {"--level": "--max-level", "--tier": "--max-tier"}
    return "decode", out + [names.get(a, a) for a in rest]


def refusal(error):
    clause = re.search(r"\bspec ([A-Z]+-\d+)\b", error["message"])
    return clause.group(1) if clause else KINDS.get(error["name"], error["name"])


def answer(query, status, document):
    if "error" in document:
        return {"refused": refusal(document["error"]), "message": document["error"]["message"]}
    if query == "validate":
        if not document["valid"]:
            first = document["errors"][0]
            return {"refused": first["clause"] or KINDS[first["status"]], "message": first["message"]}
        return {"valid": True}
    if query == "demand":
        c = document["conformance"]
        if "members" in c:      # the contract asks for the first stream of a file
            c = c["members"][0]["conformance"]
        found = {QUANTITIES[q["name"]]: q["value"] for q in c["quantities"] if q["name"] in QUANTITIES}
        return {"demand": {"profile": PROFILES[c["profile"]], "level": c["level"], **found}}
    digests = document["digests"]
    return {"num_gaussians": digests["num_gaussians"],
            "digests": {**{a["name"]: a["digest"] for a in digests["arrays"]}, "all": digests["all"]}}


def answer_of(tool, asked, path, timeout=None):
    """(exit status, output, errors) of the contract"""
    verb, options = command_of(asked)
    done = subprocess.run([tool[0], verb, path, "--json", "--threads", "1", *options, *tool[1:]],
                          capture_output=True, text=True, timeout=timeout, check=False)
    try:
        said = answer(asked[1], done.returncode, json.loads(done.stdout))
    except (ValueError, KeyError, TypeError):
        return 3, b"", done.stderr.encode("utf-8")
    return int("refused" in said), json.dumps(said).encode("utf-8"), b""


def main(arguments):
    at = arguments.index("--query")
    status, out, err = answer_of(arguments[:at], arguments[at:-1], arguments[-1])
    print(out.decode("utf-8"))
    sys.stderr.write(err.decode("utf-8"))
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

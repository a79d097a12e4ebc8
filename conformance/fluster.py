#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Prints the suite as one of fluster (https://github.com/fluendo/fluster): fluster.py [--source URL]

A test vector for each legal stream. `result` is the digest of all its Gaussians (appendix F), which a decoder class of
fluster returns in place of an MD5 of pictures: the member digests.all of what the contract prints to `--query all`.
What fluster cannot state, queries of times and levels and the refusals of faulty streams, is in suite.json alone.
--source: where vectors/ is served; without it `source` is the path beside this file.
"""

import argparse
import hashlib
import json
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent


def vector_of(vector, source):
    whole = next(q for q in vector["queries"] if q["arguments"] == ["--query", "all"])
    data = (HERE / vector["file"]).read_bytes()
    return {"name": vector["name"].replace("/", "-"), "source": source + vector["file"],
            "source_checksum": hashlib.md5(data).hexdigest(), "input_file": Path(vector["file"]).name,
            "output_format": "Unknown", "result": whole["digests"]["all"]}


def main(arguments):
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("--source", default="")
    source = parser.parse_args(arguments).source
    source += "/" if source and not source.endswith("/") else ""
    suite = json.loads((HERE / "suite.json").read_text(encoding="utf-8"))
    legal = [v for v in suite["vectors"] if v["group"] in ("core", "uncommon")]
    print(json.dumps({"name": "L4D", "codec": "L4D", "description": suite["description"],
                      "test_vectors": [vector_of(v, source) for v in legal]}, indent=4))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

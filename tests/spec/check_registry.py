#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Holds spec/registry/*.json against their schema, the code and the tables of l4d.md.

  check_registry.py           exit status 1 and a line for each difference
  check_registry.py --write   writes the tables into l4d.md
"""

import json
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
REGISTRY = ROOT / "spec" / "registry"
SPEC = ROOT / "spec" / "l4d.md"
SOURCES = ("libl4dcodec/container/scene_header.h", "libl4dcodec/container/levels.h",
           "libl4dcodec/container/member.h",
           "libl4dcodec/entropy/stream.h",
           "include/l4d/l4d.h", "include/l4d/decode.h")
# Names of constants that have to be in a registry, all of them.
REGISTERED = re.compile(r"(ScalarCodingId|ComponentCodingId|ElementType|CoordinateCodingId|StreamLayout|"
                        r"ChunkCodec|ProfileId|ExtensionId|MemberRole)::\w+|L4D_(COORDINATES|COLOR|PLAYBACK|TOOL)_\w+")
ORDER = ("chunk-codec", "stream-layout", "scalar-coding", "component-coding", "coordinate-coding",
         "element-type", "coordinate-system", "color-space", "playback", "profile", "conformance-level",
         "extensions", "member-role", "tools")
BEGIN = "<!-- registries: written by tests/spec/check_registry.py -->\n"
END = "<!-- end of registries -->"
TYPES = {"object": dict, "array": list, "string": str, "integer": int}


def violations(value, schema, where):
    """What of the JSON Schema keywords that schema.json uses does not hold."""
    if "enum" in schema:
        known = value in schema["enum"]
        return [] if known else [f"{where}: {value!r} is none of {schema['enum']}"]
    kind = TYPES[schema["type"]]
    if not isinstance(value, kind) or isinstance(value, bool):
        return [f"{where}: is no {schema['type']}"]
    found = []
    if kind is str and not re.search(schema.get("pattern", ""), value):
        found.append(f"{where}: {value!r} does not match {schema['pattern']}")
    if kind is int and not schema.get("minimum", value) <= value <= schema.get("maximum", value):
        found.append(f"{where}: {value} is out of range")
    if kind is list:
        if len(value) < schema.get("minItems", 0):
            found.append(f"{where}: too few items")
        for i, item in enumerate(value):
            found += violations(item, schema["items"], f"{where}[{i}]")
    if kind is dict:
        found += [f"{where}: lacks {key}" for key in schema["required"] if key not in value]
        for key, item in value.items():
            if key in schema["properties"]:
                found += violations(item, schema["properties"][key], f"{where}.{key}")
            elif not schema["additionalProperties"]:
                found.append(f"{where}: unknown key {key}")
    return found


def constants():
    """Name -> value of every enumerator in SOURCES."""
    out = {}
    for source in SOURCES:
        text = (ROOT / source).read_text(encoding="utf-8")
        text = re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.S)
        enum = r"enum(?:\s+class\s+(\w+)\s*:\s*\w+|\s+\w+)?\s*{(.*?)}"
        for name, body in re.findall(enum, text, re.S):
            value = -1
            for item in filter(str.strip, body.split(",")):
                key, _, expression = (part.strip() for part in item.partition("="))
                if not expression:
                    value += 1
                else:
                    m = re.fullmatch(r"(-?\d+)u?(?:\s*<<\s*(\d+))?", expression)
                    if m is None:
                        continue
                    value = int(m.group(1)) << int(m.group(2) or 0)
                out[f"{name}::{key}" if name else key] = value
    return out


def differences(registries, schema, code):
    found = []
    named = set()
    for stem, r in registries.items():
        malformed = violations(r, schema, stem)
        found += malformed
        if malformed:
            continue
        if r["registry"] != stem:
            found.append(f"{stem}: calls itself {r['registry']}")
        ranges = r["ranges"]
        for a, b in zip(ranges, ranges[1:]):
            if b["first"] != a["last"] + 1:
                found.append(f"{stem}: ranges leave a gap or overlap at {b['first']}")
        for a in ranges:
            if a["first"] > a["last"]:
                found.append(f"{stem}: range {a['first']}..{a['last']}")
        for key in ("id", "name"):
            values = [e[key] for e in r["entries"]]
            if len(set(values)) != len(values):
                found.append(f"{stem}: an {key} occurs twice")
        for e in r["entries"]:
            where = f"{stem} {e['id']} {e['name']}"
            home = [a for a in ranges if a["first"] <= e["id"] <= a["last"]]
            if not home or home[0]["policy"] in ("private", "experimental"):
                found.append(f"{where}: its range assigns no ids")
            if "constant" in e:
                named.add(e["constant"])
                want = 1 << e["id"] if stem == "tools" else e["id"]
                got = code.get(e["constant"])
                if got != want:
                    found.append(f"{where}: {e['constant']} is {got} in the code")
    found += [f"{name} is in no registry" for name in sorted(code)
              if REGISTERED.fullmatch(name) and name not in named]
    return found


def tables(registries):
    out = []
    for stem in ORDER:
        r = registries[stem]
        ranges = ", ".join(f"{a['first']}-{a['last']} {a['policy']}" for a in r["ranges"])
        out.append(f"**{stem}**: {r['title']} ({r['field']}). {ranges}.\n")
        if "note" in r:
            out.append(r["note"] + "\n")
        if r["entries"]:
            out.append("| id | name | | |\n|---|---|---|---|")
            out += [f"| {e['id']} | {e['name']} | {e['description']} | "
                    f"{e['reference'].replace('l4d.md ', '')} |" for e in r["entries"]]
            out.append("")
        else:
            out.append("No id is assigned yet.\n")
    return "\n".join(out)


def main():
    load = lambda path: json.loads(path.read_text(encoding="utf-8"))
    registries = {p.stem: load(p) for p in sorted(REGISTRY.glob("*.json")) if p.stem != "schema"}
    found = differences(registries, load(REGISTRY / "schema.json"), constants())
    if sorted(registries) != sorted(ORDER):
        found.append("the list of registries in this script is not the list of files")
    text = SPEC.read_text(encoding="utf-8")
    begin, end = text.index(BEGIN) + len(BEGIN), text.index(END)
    if not found and text[begin:end] != tables(registries):
        if "--write" in sys.argv:
            SPEC.write_text(text[:begin] + tables(registries) + text[end:], encoding="utf-8")
        else:
            found.append("the tables in l4d.md are out of date: check_registry.py --write")
    print("\n".join(found) if found else f"{len(registries)} registries agree with the code")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())

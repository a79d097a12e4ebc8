#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks a JSON document of the tool against its schema: check_schema.py SCHEMA_FOLDER DOCUMENT.

Knows the part of JSON Schema that docs/schema uses, and fails on any other keyword, so that no rule is
passed over in silence. Properties that no schema names are errors: what the tool prints is documented.
"""
import json
import os
import sys

TYPES = {
    "object": lambda v: isinstance(v, dict),
    "array": lambda v: isinstance(v, list),
    "string": lambda v: isinstance(v, str),
    "boolean": lambda v: isinstance(v, bool),
    "null": lambda v: v is None,
    "integer": lambda v: isinstance(v, int) and not isinstance(v, bool),
    "number": lambda v: isinstance(v, (int, float)) and not isinstance(v, bool),
}
KNOWN = {"$schema", "title", "description", "type", "const", "enum", "minimum", "maximum", "items",
         "minItems", "maxItems", "properties", "required", "additionalProperties"}


def referred(reference):
    """What "FILE#/KEY/.." means, of the schemas beside each other."""
    name, _, pointer = reference.partition("#")
    with open(os.path.join(sys.argv[1], name), encoding="utf-8") as f:
        schema = json.load(f)
    for key in pointer.strip("/").split("/"):
        schema = schema[key]
    return schema


def check(value, schema, where, errors):
    if "$ref" in schema:
        check(value, referred(schema["$ref"]), where, errors)
        return
    unknown = set(schema) - KNOWN
    if unknown:
        errors.append(f"{where}: schema keywords {sorted(unknown)} are not supported")
    types = schema.get("type", [])
    types = [types] if isinstance(types, str) else types
    if types and not any(TYPES[t](value) for t in types):
        errors.append(f"{where}: {value!r} is not of type {types}")
        return
    if "const" in schema and value != schema["const"]:
        errors.append(f"{where}: {value!r} is not {schema['const']!r}")
    if "enum" in schema and value not in schema["enum"]:
        errors.append(f"{where}: {value!r} is not one of {schema['enum']}")
    if TYPES["number"](value):
        if value < schema.get("minimum", value) or value > schema.get("maximum", value):
            errors.append(f"{where}: {value} is out of range")
    if isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            errors.append(f"{where}: {len(value)} items")
        for i, item in enumerate(value):
            check(item, schema["items"], f"{where}[{i}]", errors)
    if isinstance(value, dict):
        properties = schema.get("properties", {})
        for key in schema.get("required", []):
            if key not in value:
                errors.append(f"{where}: no key {key}")
        for key, item in value.items():
            if key in properties:
                check(item, properties[key], f"{where}.{key}", errors)
            elif "additionalProperties" in schema:
                check(item, schema["additionalProperties"], f"{where}.{key}", errors)
            else:
                errors.append(f"{where}: undocumented key {key}")


def main():
    folder, path = sys.argv[1:]
    with open(path, encoding="utf-8") as f:
        document = json.load(f)
    name = document["schema"]
    verb = name.removeprefix("l4dcodec.").removesuffix("/1")
    with open(os.path.join(folder, verb + ".json"), encoding="utf-8") as f:
        schema = json.load(f)
    errors = []
    check(document, schema, "$", errors)
    for error in errors:
        print("  " + error, file=sys.stderr)
    return 1 if errors else 0


if __name__ == "__main__":
    sys.exit(main())

# SPDX-License-Identifier: Apache-2.0
"""The keywords of JSON Schema that conformance/suite.schema.json uses."""

import re

TYPES = {"object": dict, "array": list, "string": str, "integer": int}
KNOWN = {"$schema", "title", "description", "type", "required", "additionalProperties", "properties", "items",
         "minItems", "pattern", "minimum", "enum"}


def violations(value, schema, where="suite"):
    found = [f"{where}: the schema has {key}, which nothing here checks" for key in schema.keys() - KNOWN]
    if "enum" in schema and not any(value == v and type(value) is type(v) for v in schema["enum"]):
        found.append(f"{where}: {value!r} is none of {schema['enum']}")
    kind = TYPES.get(schema.get("type"))
    if kind and (not isinstance(value, kind) or isinstance(value, bool)):
        return [*found, f"{where}: is no {schema['type']}"]
    if kind is str and not re.search(schema.get("pattern", ""), value):
        found.append(f"{where}: {value!r} does not match {schema['pattern']}")
    if kind is int and value < schema.get("minimum", value):
        found.append(f"{where}: {value} is too small")
    if kind is list:
        if len(value) < schema.get("minItems", 0):
            found.append(f"{where}: too few items")
        for i, item in enumerate(value):
            found += violations(item, schema["items"], f"{where}[{i}]")
    if kind is dict:
        found += of_object(value, schema, where)
    return found


def of_object(value, schema, where):
    found = [f"{where}: lacks {key}" for key in schema.get("required", ()) if key not in value]
    others = schema.get("additionalProperties", True)
    for key, item in value.items():
        if key in schema.get("properties", {}):
            found += violations(item, schema["properties"][key], f"{where}.{key}")
        elif others is False:
            found.append(f"{where}: unknown key {key}")
        elif others is not True:
            found += violations(item, others, f"{where}.{key}")
    return found

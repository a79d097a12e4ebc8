#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Prints a C program that prints where each field of each public struct lies, each name's value and each function.

usage: fields.py HEADERS [stable]
stable: without the headers of experimental/
"""
import pathlib
import re
import sys


def struct_fields(body):
    """Names of the fields in a struct's body."""
    body = re.sub(r"/\*.*?\*/", "", body, flags=re.S)
    for declaration in body.split(";"):
        declaration = declaration.strip()
        if not declaration:
            continue
        pointer = re.search(r"\(\*(\w+)\)", declaration)
        if pointer:
            yield pointer.group(1)
            continue
        for part in declaration.split(","):
            yield re.sub(r"(\[[^]]*\])+$", "", part.strip()).split()[-1].lstrip("*")


def main():
    headers = sorted(pathlib.Path(sys.argv[1]).glob("l4d/*.h" if sys.argv[2:] == ["stable"] else "l4d/**/*.h"))
    print("#include <stddef.h>\n#include <stdio.h>")
    for header in headers:
        print(f'#include "{header.relative_to(sys.argv[1])}"')
    print("int main(void) {")
    structs = 0
    for header in headers:
        text = header.read_text()
        for name, body in re.findall(r"typedef struct (\w+) \{\n(.*?)\n\} \1;", text, flags=re.S):
            structs += 1
            fields = list(struct_fields(body))
            if fields[0] != "struct_size":  # frozen: its size too
                print(f'  printf("{name} %zu\\n", sizeof({name}));')
            for field in fields:
                print(f'  printf("{name}.{field} %zu %zu\\n", offsetof({name}, {field}), '
                      f"sizeof((({name}*)0)->{field}));")
        plain = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
        for function in re.findall(r"\nL4D_API ([^;]*);", plain):
            print(f'  puts("{" ".join(function.split())}");')
        for body in re.findall(r"enum \{(.*?)\}", text, flags=re.S):
            for name in re.findall(r"\b(L4D_\w+)\b(?=\s*[=,}\n]|\s*$)",
                                   re.sub(r"/\*.*?\*/", "", body, flags=re.S)):
                # The number of names grows, what each name stands for does not change.
                if not name.endswith("_COUNT") or name == "L4D_COMPONENT_COUNT":
                    print(f'  printf("{name} %lld\\n", (long long){name});')
    print("  return 0;\n}")
    if structs == 0:
        sys.exit("no structs found")


if __name__ == "__main__":
    main()

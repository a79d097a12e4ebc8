# SPDX-License-Identifier: Apache-2.0
"""FlatBuffers by hand: reads spec/l4d.fbs and decodes buffers of its tables, byte by byte."""

import re
import struct
from pathlib import Path

from arithmetic import Invalid, require

SCALARS = {"ubyte": "<B", "bool": "<?", "ushort": "<H", "uint": "<I", "ulong": "<Q",
           "float": "<f", "double": "<d"}


class Field:
    def __init__(self, line):
        m = re.fullmatch(r"(\w+):\s*(\[?)(\w+)(?::(\d+))?\]?(?:\s*=\s*([\w.]+))?"
                         r"(\s*\(required\))?", line)
        self.name, bracket, self.type, count, default, required = m.groups()
        self.count = int(count) if count else 0       # of a fixed array in a struct
        self.vector = bool(bracket) and not count
        self.required = required is not None
        self.default = float(default) if default else 0


class Schema:
    def __init__(self, path):
        text = re.sub(r"//.*", "", Path(path).read_text(encoding="utf-8"))
        self.kinds = {}
        self.fields = {}
        for kind, name, body in re.findall(r"(struct|table)\s+(\w+)\s*{(.*?)}", text, re.S):
            self.kinds[name] = kind
            self.fields[name] = [Field(" ".join(f.split())) for f in body.split(";") if f.strip()]

    def size_align(self, name):
        if name in SCALARS:
            size = struct.calcsize(SCALARS[name])
            return size, size
        at, largest = 0, 1
        for f in self.fields[name]:
            size, align = self.size_align(f.type)
            at = -(-at // align) * align + size * max(f.count, 1)
            largest = max(largest, align)
        return -(-at // largest) * largest, largest

    def inline_size(self, f):
        """Bytes of a field in its table."""
        is_scalar = f.type in SCALARS and not f.vector
        is_struct = self.kinds.get(f.type) == "struct" and not f.vector
        return self.size_align(f.type)[0] if is_scalar or is_struct else 4


class FlatBuffer:
    """claim(begin, end, text) hears of every byte that is read. base: where the buffer lies in the
    file, or None if it is not there as it is. most_tables: how many tables there may be."""

    def __init__(self, schema, data, clause, claim, base=None, most_tables=100000):
        self.schema, self.data, self.clause, self.claim = schema, data, clause, claim
        self.base, self.most_tables = base, most_tables
        self.tables = self.depth = 0

    def require(self, condition, message, at=0):
        require(condition, self.clause, message, None if self.base is None else self.base + at)

    def unpack(self, form, at):
        size = struct.calcsize(form)
        self.require(0 <= at <= len(self.data) - size and at % size == 0,
                     f"byte {at} of a FlatBuffer of {len(self.data)}",
                     min(max(at, 0), len(self.data)))
        return struct.unpack_from(form, self.data, at)[0]

    def offset(self, at):
        """The place that an offset at a place stands for."""
        distance = self.unpack("<I", at)
        self.require(distance != 0, "an offset of 0", at)
        return at + distance

    def root(self, name, identifier):
        at = self.offset(0)
        self.require(self.data[4:8] == identifier, "file identifier", 4)
        self.claim(0, 4, f"root table {name} at +0x{at:x}")
        self.claim(4, 8, f'file identifier "{identifier.decode()}"')
        return self.table(name, at, name)

    def table(self, name, at, path):
        self.tables += 1
        self.depth += 1
        self.require(self.tables <= self.most_tables and self.depth <= 16, "too many tables", at)
        vtable = at - self.unpack("<i", at)
        vtable_bytes, table_bytes = self.unpack("<H", vtable), self.unpack("<H", vtable + 2)
        self.require(vtable_bytes >= 4 and vtable_bytes % 2 == 0, f"vtable of {path}", vtable)
        self.require(table_bytes >= 4 and at + table_bytes <= len(self.data), f"size of {path}",
                     vtable + 2)
        self.claim(vtable, vtable + vtable_bytes, f"vtable of {path}: {vtable_bytes} bytes, table "
                   f"of {table_bytes}, offset of each field")
        fields = self.schema.fields[name]
        for i in range((vtable_bytes - 4) // 2):
            place = self.unpack("<H", vtable + 4 + 2 * i)
            size = self.schema.inline_size(fields[i]) if i < len(fields) else 1
            self.require(place == 0 or 4 <= place <= table_bytes - size, f"field {i} of {path}",
                         vtable + 4 + 2 * i)
        self.claim(at, at + 4, f"{path}: table {name}, its vtable is 0x{at - vtable:x} before")
        out = {}
        for i, f in enumerate(self.schema.fields[name]):
            slot = 4 + 2 * i
            offset = self.unpack("<H", vtable + slot) if slot + 2 <= vtable_bytes else 0
            self.require(offset > 0 or not f.required, f"{path}.{f.name} is missing", at)
            out[f.name] = self.field(f, at + offset if offset else None, f"{path}.{f.name}")
        self.depth -= 1
        return out

    def field(self, f, at, path):
        if at is None:
            return f.default if f.type in SCALARS and not f.vector else None
        if f.type in SCALARS and not f.vector:
            return self.scalar(f.type, at, path)
        if not f.vector and self.schema.kinds.get(f.type) == "struct":
            return self.struct(f.type, at, path)
        target = self.offset(at)
        self.claim(at, at + 4, f"{path}: at +0x{target:x}")
        if f.vector:
            return self.vector(f.type, target, path)
        return self.string(target, path) if f.type == "string" else self.table(f.type, target, path)

    def scalar(self, kind, at, path):
        value = self.unpack(SCALARS[kind], at)
        shown = f"0x{value:016x}" if path.endswith("hash") else f"{value}"
        self.claim(at, at + struct.calcsize(SCALARS[kind]), f"{path} = {shown}")
        return value

    def struct(self, name, begin, path):
        out, at = {}, begin
        for f in self.schema.fields[name]:
            size, align = self.schema.size_align(f.type)
            at += -(at - begin) % align
            names = [f"{path}.{f.name}" + f"[{i}]" * bool(f.count) for i in range(max(f.count, 1))]
            values = [self.scalar(f.type, at + i * size, name) for i, name in enumerate(names)]
            out[f.name] = values if f.count else values[0]
            at += size * max(f.count, 1)
        return out

    def vector(self, kind, at, path):
        n = self.unpack("<I", at)
        self.claim(at, at + 4, f"{path}: {n} elements")
        if kind in SCALARS:
            size = struct.calcsize(SCALARS[kind])
            return [self.scalar(kind, at + 4 + size * i, f"{path}[{i}]") for i in range(n)]
        if self.schema.kinds[kind] == "struct":
            size = self.schema.size_align(kind)[0]
            return [self.struct(kind, at + 4 + size * i, f"{path}[{i}]") for i in range(n)]
        out = []
        for i in range(n):
            slot = at + 4 + 4 * i
            target = self.offset(slot)
            self.claim(slot, slot + 4, f"{path}[{i}]: at +0x{target:x}")
            out.append(self.table(kind, target, f"{path}[{i}]"))
        return out

    def string(self, at, path):
        n = self.unpack("<I", at)
        self.require(self.unpack("<B", at + 4 + n) == 0, f"{path} without NUL", at)
        try:
            text = bytes(self.data[at + 4:at + 4 + n]).decode("utf-8")
        except UnicodeDecodeError:
            raise Invalid("HEAD-17", path, None if self.base is None else self.base + at + 4)
        self.claim(at, at + 4, f"{path}: {n} bytes")
        self.claim(at + 4, at + 5 + n, f'{path} = "{text}", NUL')
        return text

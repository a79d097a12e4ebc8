# SPDX-License-Identifier: Apache-2.0
"""Writes the C source of the module `l4dcodec._native`, with CFFI in API mode.

usage: declare.py OUTPUT.c

CFFI takes the declarations of the headers as they are. The C compiler then checks each of them against
the header itself, so that no struct and no number is written twice.
"""

import pathlib
import re
import sys
from typing import List

import cffi

ROOT = pathlib.Path(__file__).resolve().parents[1]
# In this order: each includes those before it.
HEADERS = ["l4d/l4d.h", "l4d/decode.h", "l4d/members.h", "l4d/experimental/inspect.h", "l4d/encode.h", "l4d/render.h",
           "l4d/cuda.h", "python/scenes.h"]

# Functions that C calls and that l4dcodec/core.py defines.
CALLBACKS = """
extern "Python" {
  int64_t l4dpy_read_at(void*, void*, size_t, uint64_t);
  int64_t l4dpy_size(void*);
  int l4dpy_write(void*, const void*, size_t);
  int l4dpy_progress(void*, uint64_t, uint64_t, const char*);
  void l4dpy_violation(void*, const l4d_violation*);
}
"""


def declarations(header: str) -> str:
    """The declarations and the numeric macros of a header, as CFFI reads them."""
    text = re.sub(r"/\*.*?\*/", " ", header, flags=re.S).replace("\\\n", " ")
    text = re.sub(r"#ifdef __cplusplus.*?#endif", "", text, flags=re.S)
    macros = re.findall(r"^#define (L4D(?:PY)?_[A-Z_]+) +(\(?-?\d\w*(?: << \d+)?\)?)\s*$", text, flags=re.M)
    text = re.sub(r"^\s*#.*$", "", text, flags=re.M).replace("L4D_API ", "")
    # The compiler finds the value of an expression, but lengths of arrays are known here.
    lines = [f"#define {name} {value if value.isdigit() else '...'}" for name, value in macros]
    return "\n".join(lines) + "\n" + text


def main(arguments: List[str]) -> int:
    if len(arguments) != 1:
        print(__doc__)
        return 2
    folders = {"l4d": ROOT / "include", "python": ROOT}
    texts = [(folders[name.split("/")[0]] / name).read_text(encoding="utf-8") for name in HEADERS]
    builder = cffi.FFI()
    builder.cdef("\n".join(declarations(text) for text in texts) + CALLBACKS)
    builder.set_source("l4dcodec._native", "".join(f'#include "{name}"\n' for name in HEADERS))
    builder.emit_c_code(arguments[0])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

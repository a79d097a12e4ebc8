# SPDX-License-Identifier: Apache-2.0
"""The reference decoder without a new interpreter for each query, which takes most of the time of small vectors:

  run.py --adapter adapters/reference.py -- reference
"""

import concurrent.futures
import contextlib
import io
import subprocess
import sys
from pathlib import Path

REFERENCE = str(Path(__file__).resolve().parents[1] / "reference")


def ask(arguments):
    """In a process of its own, for threads of Python take turns."""
    if REFERENCE not in sys.path:
        sys.path.insert(0, REFERENCE)
    import l4d                          # its folder is known now
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = l4d.main(arguments)
    return status, out.getvalue().encode("utf-8"), err.getvalue().encode("utf-8")


PROCESSES = concurrent.futures.ProcessPoolExecutor()


def answer_of(_, asked, path, timeout=None):
    """(exit status, output, errors) of the contract"""
    try:
        return PROCESSES.submit(ask, [*asked, path]).result(timeout)
    except concurrent.futures.TimeoutError:
        raise subprocess.TimeoutExpired("reference", timeout) from None
    except Exception as error:          # what would end the program
        return 3, b"", f"{type(error).__name__}: {error}".encode("utf-8")

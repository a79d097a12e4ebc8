# SPDX-License-Identifier: Apache-2.0
"""A decoder that answers many questions in one process, one for each thread of run.py:

  run.py --adapter adapters/batch.py -- ./answer
  run.py --adapter adapters/batch.py -- qemu-aarch64 -L /usr/aarch64-linux-gnu ./answer

The decoder is started with `--batch`. It reads a line for each question, the arguments of the contract and the file
between tabs, and prints a line: the exit status, a tab, the JSON object. answer.cc is such a program.
"""

import queue
import subprocess
import threading

LOCAL = threading.local()


class Batch:
    """One running decoder, and a thread that reads its lines."""

    def __init__(self, command):
        self.process = subprocess.Popen([*command, "--batch"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        stderr=subprocess.DEVNULL)
        self.lines = queue.Queue()
        threading.Thread(target=self.read, daemon=True).start()

    def read(self):
        for line in self.process.stdout:
            self.lines.put(line)
        self.lines.put(None)

    def ask(self, words, timeout):
        """A line, or None where the decoder has ended."""
        try:
            self.process.stdin.write("\t".join(words).encode("utf-8") + b"\n")
            self.process.stdin.flush()
        except OSError:
            return None
        return self.lines.get(timeout=timeout)

    def end(self):
        self.process.kill()
        return self.process.wait()


def answer_of(command, asked, path, timeout=None):
    """(exit status, output, errors) of the contract"""
    if getattr(LOCAL, "batch", None) is None:
        LOCAL.batch = Batch(command)
    try:
        line = LOCAL.batch.ask([*asked, path], timeout)
    except queue.Empty:
        LOCAL.batch.end()
        LOCAL.batch = None
        raise subprocess.TimeoutExpired(command, timeout) from None
    if line is None:
        process, LOCAL.batch = LOCAL.batch.process, None
        return process.wait(), b"", b"it ended in the middle of its questions"
    status, _, said = line.partition(b"\t")
    return int(status), said, b""

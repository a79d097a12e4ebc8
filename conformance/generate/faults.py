# SPDX-License-Identifier: Apache-2.0
"""The faulty vectors: each breaks one rule, named by its clause, and has the checksums of a file that breaks
none. All rules that a reader can check occur; NOT_CHECKABLE lists the others."""

import broken_levels
import broken_rans
import broken_streams
import faulty_frames
import member_files

# Of validators alone (DEC-3).
OF_VALIDATORS = {"FILE-7", "HEAD-21", "DIR-9", "DIR-10", "LAYR-1", "LAYR-3", *(f"LEVL-{k}" for k in range(1, 12)),
                 *(f"MEMB-{k}" for k in range(1, 12))}
# Files too large to be kept: the test spec/streams makes them.
LARGE = {"LEVL-5", "LEVL-6", "LEVL-7"}
# What else may be said of a file.
ALSO = {"FILE-1 short": ["CHNK-1"], "CHNK-1 size": ["CHNK-4"], "LAYR-1": ["DIR-9"], "LAYR-3": ["DIR-9"], "RANS-7 missing": ["VQ-1", "VQ-2", "STRM-3", "VAL-2", "TRAN-5", "TRAN-6"]}

NOT_CHECKABLE = {
    "STRM-5": "says how a decoder adds; the vectors with deltas beyond the border hold it",
    "PAGE-2": "a page in another order is a page of other values",
    "PAGE-3": "says what a decoder may use; queries for single pages hold it",
    "DEC-1": "about results: digests hold it",
    "DEC-2": "about results: digests hold it",
    "DEC-3": "says which rules a decoder checks: all faulty vectors hold it",
    "DEC-4": "says what a decoder does where a rule is broken: all faulty vectors hold it",
    "DEC-5": "says how refusals are reported: all faulty vectors hold it",
    "DEC-6": "about memory: the vectors of CHNK-1 and CODE-2 state sizes that do not fit",
    "DEC-7": "about results: queries with --detail base hold it",
    "LAYR-2": "about results: queries for times hold it",
    "ENC-1": "about encoders", "ENC-2": "about encoders",
    "VER-1": "about results: vectors of other minor versions hold it",
    "VER-2": "what it has refused breaks FILE-3, HEAD-7, HEAD-8, CHNK-6 or STRM-1",
    "VER-3": "about encoders; a decoder may refuse what is not final",
    "PLST-1": "about playlists, which are no streams", "PLST-2": "about playlists, which are no streams",
    "PLST-3": "about playlists, which are no streams"}

KINDS = {"FILE-1": ["no-l4d"], "FILE-2": ["version"], "FILE-3": ["feature"], "HEAD-7": ["feature"],
         "HEAD-8": ["feature"], "CHNK-6": ["feature"], "CHNK-1": ["truncated"], "HEAD-21": ["truncated"], "CHNK-2": ["checksum"],
         "FILE-4": ["checksum"], "FILE-6": ["checksum"], "DIR-1": ["checksum"],
         "CHNK-5": ["rule", "checksum"]}


def kinds(name):
    """DEC-5: the kinds of report that fit a broken rule, for decoders that name no clauses."""
    if name == "FILE-1 short":
        return ["truncated", "no-l4d"]
    also = [kind for clause in ALSO.get(name, []) for kind in KINDS.get(clause, ["rule"])]
    return sorted({*KINDS.get(name.split()[0], ["rule"]), *also})


def query_of(name):
    """The arguments of a query that meets the broken rule."""
    if name.split()[0] in OF_VALIDATORS:
        return ["--query", "validate"]
    instant = broken_streams.OF_INSTANTS.get(name)
    return ["--query", "all" if instant is None else f"time:{instant!r}"]


def faults():
    """(name, file): the first word of a name is the clause"""
    yield from broken_streams.broken()
    yield from broken_rans.broken()
    yield from faulty_frames.faults()
    yield from member_files.broken()
    yield from ((name, data) for name, data in broken_levels.broken() if name.split()[0] not in LARGE)


def slug(name):
    clause, *words = name.split()
    return "-".join([clause, *words]).replace("_", "-")

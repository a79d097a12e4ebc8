# SPDX-License-Identifier: Apache-2.0
"""What suite.json says of each vector: its queries and their digests, by the reference decoder."""

import functools
import hashlib
import json

import digests
import faults
import levels
import limits
from arithmetic import Invalid
from decoder import Decoder, Query
from header import RAW32, RAW64, TRANSFORM, VQ
from l4d import demand
from times import visible_interval
from validate import validate, validate_file

FORMAT = 1
LEAST_RANGE = 0.05                  # a query of a range has this share of the sequence at least


class Cached(Decoder):
    """Decodes each page once for all queries."""

    def __init__(self, data):
        super().__init__(data)
        self.known = {}
        self.directory.page = functools.lru_cache(None)(self.directory.page)
        self.directory.entry = functools.lru_cache(None)(self.directory.entry)

    def once(self, what, selected, base_only):
        key = (what, selected.index, selected.record["offset"], base_only)
        if key not in self.known:
            self.known[key] = getattr(super(), what)(selected, base_only)
        return self.known[key]

    def page(self, selected, base_only=False):
        return self.once("page", selected, base_only)

    def attributes(self, selected, base_only=False):
        return dict(self.once("attributes", selected, base_only))


def queries_of(decoder, times=()):
    """(arguments, Query, whether packed); times: of queries in addition"""
    begin, length = decoder.header["time_begin"], decoder.duration
    a, b, c = (begin + share * length for share in (0.21, 0.48, 0.9))
    base = ["--detail", "base"]
    yield ["--query", "all"], Query(), False
    yield ["--query", "all", *base], Query(base_only=True), False
    yield ["--query", f"time:{a!r}"], Query(a, a), False
    yield ["--query", f"time:{c!r}", "--level", "2"], Query(c, c, most_level=2), False
    yield ["--query", f"range:{a!r}:{b!r}", *base], Query(a, b, base_only=True), False
    if len({la["level"] for la in decoder.header["layers"]}) > 1:
        yield ["--query", "all", "--level", "0"], Query(most_level=0), False
    if len({la["tier"] for la in decoder.header["layers"]}) > 1:
        yield ["--query", "all", "--tier", "0"], Query(most_tier=0), False
        yield ["--query", f"time:{b!r}", "--tier", "1", *base], Query(b, b, most_tier=1, base_only=True), False
    for t in times:
        yield ["--query", f"time:{t!r}"], Query(t, t), False
    if levels.keeps_profile(decoder.header, levels.INDEXED):
        yield ["--query", "all", "--packed"], Query(), True
        yield ["--query", f"time:{a!r}", "--packed"], Query(a, a), True


def ends_of_pages(decoder):
    """A time at which a page begins to be visible and one at which a page ends to be: F.1 takes both."""
    header = decoder.header
    for key in (0, 1):
        for selected in decoder.select(Query()):
            layer = header["layers"][selected.index]
            t = visible_interval(header, layer["level"], selected.record)[key]
            is_open = selected.record["visible_begin"] == 0 if key == 0 else selected.record["visible_end"] == 255
            inside = header["time_begin"] < t < header["time_begin"] + decoder.duration
            if layer["permanent"] or is_open or not inside:
                continue
            if any(s.record is selected.record for s in decoder.select(Query(t, t))):
                yield t
                break


def answers(decoder, data, times):
    """The queries of a legal vector with their answers. Digests of single arrays are given once."""
    out, whole = [], set()
    for arguments, query, packed in queries_of(decoder, times):
        of = digests.of_packed_form if packed else digests.of_attributes
        found = of(decoder, query)
        count = sum(s.record["num_gaussians"] for s in decoder.select(query))
        answer = found if packed not in whole else {"all": found["all"]}
        whole.add(packed)
        out.append({"arguments": arguments, "num_gaussians": count, "digests": answer})
    validate(decoder) if not has_members(decoder) else validate_file(data)
    out.append({"arguments": ["--query", "validate"], "valid": True})
    out.append({"arguments": ["--query", "demand"], "demand": demand(decoder)})
    return out


def has_members(decoder):
    ids = {e["id"] for e in decoder.header["extensions"] or ()}
    return decoder.header["file_bytes"] > 0 or not ids.isdisjoint({1, 2})


def features(decoder):
    """What of the format's options a stream uses."""
    h, found = decoder.header, set()
    codings = [h["sh"], *(la[c] for la in h["layers"] for c in ("scale", "rotor_spatial", "rotor_temporal"))]
    for coding in codings:
        if coding["coding"] == VQ:
            found |= {"codebooks"} | {"stages"} & ({"stages"} if len(coding["stages"]) > 1 else set())
            found |= {"unquantised"} if coding["escapes"] else set()
            found |= {"rcq"} if coding["rcq"] is not None else set()
        found |= {"transform"} if coding["coding"] == TRANSFORM else set()
    raw = RAW32 in [c["coding"] for c in codings] or any(
        la["mean_t"] in (RAW32, RAW64) or la["raw_position"] for la in h["layers"])
    found |= {"raw"} if raw or h["position"] == RAW32 or h["opacity"]["coding"] == RAW32 else set()
    found |= {"permanent"} if any(la["permanent"] for la in h["layers"]) else set()
    for selected in decoder.select(Query()):
        found |= {("stored", "zstd", "rans")[selected.record["codec"]]}
        found |= {"two-parts"} if selected.record["sh_bytes"] else set()
    return sorted(found)


def entry(vector):
    """The vector in suite.json."""
    data = vector.data
    out = {"name": f"{vector.group}/{vector.name}", "file": f"vectors/{vector.path()}", "group": vector.group,
           "about": vector.about, "clauses": vector.clauses, "made_by": vector.made_by, "bytes": len(data),
           "sha256": hashlib.sha256(data).hexdigest()}
    if vector.group == "limits":
        return {**out, **limit(vector)}
    try:
        return {**out, **(faulty(vector) if vector.group == "faulty" else legal(data, vector.more))}
    except Invalid as error:
        raise ValueError(f"{vector.path()} is not what it is to be: {error}") from None


def limit(vector):
    """A stream at a limit of a level or beyond it. Only levels are checked here: it may have 8 million Gaussians."""
    decoder, clause = Decoder(vector.data), vector.clauses[0]
    broken, found = limits.broken_rule(vector.data), demand(decoder)
    if broken != (clause if vector.more["beyond"] else None):
        raise ValueError(f"{vector.name} breaks {broken}")
    queries = [{"arguments": ["--query", "demand"], "demand": found}]
    if vector.more["validated"]:
        verdict = {"refused": [clause], "kinds": ["rule"]} if vector.more["beyond"] else {"valid": True}
        queries.append({"arguments": ["--query", "validate"], **verdict})
    return {"profile": found["profile"], "level": found["level"], "features": ["validate"],
            "limits": {"num_gaussians": int(decoder.header["num_gaussians"]),
                       "memory_bytes": found["memory_bytes"]}, "queries": queries}


def legal(data, more):
    decoder = Cached(data)
    times = [*more.get("times", ()), *(ends_of_pages(decoder) if more.get("ends") else ())]
    asked = answers(decoder, data, times)
    limits = asked[-1]["demand"]
    return {"profile": limits["profile"], "level": limits["level"], "features": features(decoder),
            "limits": {"num_gaussians": int(decoder.header["num_gaussians"]),
                       "memory_bytes": limits["memory_bytes"]}, "queries": asked}


def faulty(vector):
    clause, data = vector.clauses[0], vector.data
    query = faults.query_of(vector.more["title"])
    check_refusal(vector, query[-1])
    answer = {"arguments": query, "refused": [clause, *faults.ALSO.get(vector.more["title"], [])],
              "kinds": faults.kinds(vector.more["title"])}
    profile = level = 0
    try:
        header = Decoder(data).header
        profile = min([p for p in (1, 2, 3) if levels.keeps_profile(header, p)], default=0)
        level = levels.demand(Decoder(data)).level()
    except (Invalid, ValueError, OverflowError, ZeroDivisionError):
        pass                              # nobody knows what it would keep to
    return {"profile": profile, "level": level, "features": ["validate"] if "validate" in query else [],
            "limits": {"num_gaussians": 0, "memory_bytes": 0}, "queries": [answer]}


def check_refusal(vector, query):
    instant = float(query[len("time:"):]) if query.startswith("time:") else None
    try:
        validate_file(vector.data) if query == "validate" else list(Decoder(vector.data).pages(Query(instant, instant)))
    except Invalid as broken:
        if broken.clause in [vector.clauses[0], *faults.ALSO.get(vector.more["title"], [])]:
            return
        raise ValueError(f"{vector.name} breaks {broken.clause}") from broken
    raise ValueError(f"{vector.name} breaks no rule")


def document(vectors, entries):
    return {"$schema": "suite.schema.json", "name": "l4d", "format": FORMAT, "bitstream": "1.0-rc.1",
            "description": "Conformance vectors of the L4D bitstream, spec/l4d.md", "vectors": entries}


def text(document_):
    """JSON with a vector to a line."""
    head = [f" {json.dumps(k)}: {json.dumps(v)}" for k, v in document_.items() if k != "vectors"]
    vectors = ",\n".join("  " + json.dumps(v) for v in document_["vectors"])
    return "{\n" + ",\n".join(head + [' "vectors": [\n' + vectors + "\n ]"]) + "\n}\n"

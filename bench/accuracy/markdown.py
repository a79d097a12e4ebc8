# SPDX-License-Identifier: Apache-2.0
"""Tables and figures as docs/accuracy.md writes them."""


def table(columns, rows):
    """columns: (title, key or function of the row, format). Lacking values leave cells empty."""
    lines = ["| " + " | ".join(c[0] for c in columns) + " |",
             "|" + "|".join("---" if c[2] == "" else "---:" for c in columns) + "|"]
    for row in rows:
        cells = []
        for _, key, form in columns:
            value = key(row) if callable(key) else row.get(key)
            cells.append("" if value is None else format(value, form))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def signed(value, digits=2):
    """A change: with its sign, and 0 without one."""
    text = f"{value:+.{digits}f}"
    return text[1:] if float(text) == 0 else text


def megabytes(row):
    return row["bytes"] / 1e6


def named(rows, name, key="name"):
    """The row of that name, or None."""
    return next((r for r in rows if r[key] == name), None)


def front(rows):
    """Rows that no other beats in both bytes and fidelity, smallest first."""
    best, kept = float("-inf"), []
    for row in sorted(rows, key=lambda r: (r["bytes"], -r["fidelity_db"])):
        if row["fidelity_db"] > best:
            best = row["fidelity_db"]
            kept.append(row)
    return kept


SIZE = [("MB", megabytes, ".3f"), ("ratio", "ratio", ".2f"), ("fidelity dB", "fidelity_db", ".2f")]
ENCODE = [("encode CPU s", "encode_cpu_s", ".2f")]

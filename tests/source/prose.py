#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Finds phrases in documents, public headers and comments of sources that CONTRIBUTING.md ("Prose")
replaces, and names in sources whose words mean something else.

    prose.py              prints each place; exit status 1 if there is one
    prose.py --self-test  shows that each phrase and name is found, and plain sentences are not

Generated tables, code and quoted phrases do not count. A style is more than a list of phrases: this
keeps out those that readers misunderstood most.
"""
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
# Phrase -> what to write, and a sentence with the phrase.
PHRASES = {
    r"(is|are|was|were|be|been|as) told": ("reports, states", "The number is told by finish."),
    r"tells? (what|how|which|whether|where)": ("returns, reports", "finish tells what is damaged."),
    r"(what|which|that) (was|is|were|are) asked for": ("requested", "It reads what is asked for"),
    r"there (is|was) (no |not )?room|not room": ("capacity, fits", "Once there is room, it does."),
    r"(that|what|which) (is|are) none": ("an invalid ..", "A camera that is none fails."),
    r"the way back|goes back (to|through)": ("backward pass", "The way back runs in double."),
    r"\bthose who\b|whoever": ("callers, programs", "This is for those who keep buckets."),
    r"(be|is|are|been) held against": ("compared with", "Images are held against the reference."),
    r"no kin of|what is left of (it|them|these)": ("unrelated, residual", "It is no kin of those."),
}
PATTERN = re.compile("|".join(f"({p})" for p in PHRASES), re.IGNORECASE)

# Word -> what it means in every name, and names that used it for something else.
NAMES = {
    "live": ("of a presentation that grows", ("LiveScene", "LiveView", "l4d_cuda_live")),
    "part": ("none: pages have chunks", ("SessionPart",)),
    "row": ("of pixels, a matrix, a table or a PLY", ("SessionPool::Row",)),
    "window": ("the frames in which a Gaussian is visible", ("ReaderWindow", "WindowStage")),
}
NAME = re.compile("|".join(rf"\b{name}\b" for _, names in NAMES.values() for name in names))


def documents():
    yield ROOT / "README.md"
    yield ROOT / "CONTRIBUTING.md"
    yield ROOT / "spec" / "l4d.md"
    yield from (p for p in sorted((ROOT / "docs").glob("*.md")) if p.name not in ("accuracy.md", "ablations.md"))
    yield from sorted((ROOT / "training").rglob("*.md"))
    yield from sorted((ROOT / "include" / "l4d").glob("*.h*"))


# Strings, so that no comment begins in one, or a comment.
COMMENT = re.compile(r'''"(?:[^"\\\n]|\\.)*"|'(?:[^'\\\n]|\\.)*'|(//[^\n]*|/\*.*?\*/)''', re.DOTALL)
SOURCE_SUFFIXES = {".h", ".hpp", ".c", ".cc", ".inc", ".cu", ".cuh", ".js"}
FOLDERS = ("api", "bench", "cli", "conformance", "decoder", "encoder", "eval", "examples", "io", "libl4dcodec",
           "python", "render", "tests", "training", "web/babylon", "web/core", "web/playcanvas", "web/spark", "web/test", "web/three",
           "web/view", "web/wasm")


def sources():
    for folder in FOLDERS:
        yield from (p for p in sorted((ROOT / folder).rglob("*"))
                    if p.suffix in SOURCE_SUFFIXES and "node_modules" not in p.parts)


def comments_of(text):
    """The comments of a source, without their marks, on the lines where they are."""
    out, end = [], 0
    for match in COMMENT.finditer(text):
        out.append("\n" * text.count("\n", end, match.start()))
        comment = match.group(1) or "\n" * match.group(0).count("\n")
        out.append(re.sub(r"^[ \t]*(//+|/\*+|\*+/?) ?|\*/", "", comment, flags=re.MULTILINE))
        end = match.end()
    return "".join(out)


def prose_of(text):
    """The text with code, tables and quoted phrases blank, and line ends as they are."""
    text = re.sub(r"```.*?```", lambda m: "\n" * m.group(0).count("\n"), text, flags=re.DOTALL)
    text = re.sub(r"^(\||    ).*$", "", text, flags=re.MULTILINE)
    return re.sub(r'"[^"\n]*"|`[^`\n]*`', "", text)


def places(text):
    """Lines and what is found in them, also where a phrase runs over a line end."""
    prose = re.sub(r"[ *]", " ", prose_of(text))
    flat = prose.replace("\n", " ")
    return [(prose.count("\n", 0, m.start()) + 1, m.group(0)) for m in PATTERN.finditer(flat)]


def names(text):
    return [(text.count("\n", 0, m.start()) + 1, m.group(0)) for m in NAME.finditer(text)]


def self_test():
    for name in (name for _, group in NAMES.values() for name in group):
        assert names(f"int a;\n{name} b;\n") == [(2, name)], name
        assert not names(f"My{name} b;"), name
    for phrase, (_, sentence) in PHRASES.items():
        expected = re.search(phrase, sentence, re.IGNORECASE).group(0)
        assert places("Plain.\n" + sentence) == [(2, expected)], phrase
    assert places("Images are\nheld against it.") == [(1, "are held against")]
    source = 'int a;  // Plain.\nconst char* b = "// Whoever";\n/* It reads\n * what is asked for. */ int whoever;\n'
    assert places(comments_of(source)) == [(4, "what is asked for")], places(comments_of(source))
    assert places(comments_of("// Images are\n// held against it.")) == [(1, "are held against")]
    for plain in ("The function returns the number.", "| a table | that is none |",
                  'not "there is no room".', "```\nfor those who\n```\n", "Use `those who`.", "Those whose mask is 0."):
        assert not places(plain), plain


def main():
    if sys.argv[1:] == ["--self-test"]:
        self_test()
        return 0
    texts = [(p, p.read_text(encoding="utf-8")) for p in documents()]
    code = [(p, p.read_text(encoding="utf-8")) for p in sources()]
    texts += [(p, comments_of(text)) for p, text in code]
    found = [f"{path.relative_to(ROOT)}:{line}: {phrase!r}: see CONTRIBUTING.md, Prose"
             for path, text in texts for line, phrase in places(text)]
    found += [f"{path.relative_to(ROOT)}:{line}: {name}: see NAMES in tests/source/prose.py"
              for path, text in code for line, name in names(text)]
    print(*found, sep="\n", end="\n" if found else "")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures the functions and the files of the source.

    functions.py              prints the ten longest functions and the median lengths; exit status 1 if
                              a function has more than 80 lines, or if an exception is not needed
    functions.py --self-test  shows that functions of all shapes are found and counted

A function begins with the first line of its declarator and ends with its closing brace. Lambdas are
part of the function in which they stand. Tests do not count.
"""
import pathlib
import re
import statistics
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
FOLDERS = ("include", "libl4dcodec", "decoder", "encoder", "api", "render", "io", "eval", "cli",
           "training", "python", "bench")
SUFFIXES = {".h", ".hpp", ".cc", ".cu", ".cuh"}
MOST_LINES = 80

# Functions that may be longer: kernels, whose loops do not come apart without a cost, and tables,
# which are long lists and no steps. (file, name) -> why.
EXCEPTIONS = {
    ("render/cpu/fast/project_simd.cc", "project_rows"): "a loop over vectors of registers",
    ("render/cpu/fast/blend_simd.cc", "backward_with"): "a loop over vectors of registers",
    ("render/cuda/frame/bin.cu", "emit"): "a kernel whose steps share registers and barriers",
    ("render/cuda/backward/backward.cu", "backward"): "a kernel whose steps share registers and barriers",
    ("render/cuda/kernel/radix_sort.cu", "sort_pass"): "a kernel whose steps share registers and barriers",
}

BLANKED = re.compile(r'//[^\n]*|/\*.*?\*/|R"(\w*)\(.*?\)\1"|"(?:[^"\\\n]|\\.)*"|'
                     r"(?<![0-9a-fA-F])'(?:[^'\\\n]|\\.)+'|^[ \t]*#(?:[^\n]*\\\n)*[^\n]*",
                     re.DOTALL | re.MULTILINE)
TYPE = re.compile(r"^(?:template\s*<.*?>\s*)?(?:typedef\s+)?(?:class|struct|union|enum)\b")
NAMESPACE = re.compile(r"\bnamespace\b[\w:\s]*$|\bextern\s*$|^extern\s*\"")


def blank(match):
    text = match.group(0)
    if text.startswith('"'):
        return '"' + " " * (len(text) - 2) + '"'
    return re.sub(r"[^\n]", " ", text)


def kind_of(head, before):
    """What a brace opens outside of functions: "scope", "function" or "other"."""
    if NAMESPACE.search(head) or head.startswith('extern "'):
        return "scope"
    if TYPE.match(head) and not head.rstrip().endswith(")"):
        return "scope"
    # A list of values: a brace right behind a name, or behind an equals sign.
    if not before.isspace() or re.search(r"=\s*$", head) or "(" not in head:
        return "other"
    return "function"


def name_of(head):
    """The name before the first parenthesis that belongs to a declarator."""
    head = re.sub(r"^template\s*<", "", head)
    for match in re.finditer(r"([\w:~]+|operator\s*\S+?)\s*\(", head):
        if match.group(1) not in ("alignas", "__attribute__", "decltype", "__launch_bounds__",
                                  "noexcept", "defined"):
            return match.group(1)
    return head[:40]


def functions_of(text):
    """(name, first line, lines) of the functions of a file."""
    code = BLANKED.sub(blank, text)
    found, stack = [], []
    start = 0  # of the declaration at hand
    for at, char in enumerate(code):
        inside = any(kind != "scope" for kind, _, _ in stack)
        if char == "{":
            raw = code[start:at]
            head = raw.strip()
            kind = "other" if inside else kind_of(head, code[at - 1] if at else " ")
            begin = start + len(raw) - len(raw.lstrip())
            stack.append((kind, head, begin))
            # The values of a constructor's members do not begin a declaration.
            if kind != "other":
                start = at + 1
        elif char == "}" and stack:
            kind, head, begin = stack.pop()
            if kind == "function":
                first = code.count("\n", 0, begin) + 1
                found.append((name_of(head), first, code.count("\n", 0, at) + 2 - first))
            if kind != "other":
                start = at + 1
        elif char == ";" and not inside:
            start = at + 1
        elif char == ":" and not inside and re.search(r"\b(public|private|protected)$",
                                                      code[start:at].strip()):
            start = at + 1
    return found


def check_tree(root):
    """(lines of the report, number of problems)"""
    functions, files = [], []
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*")):
            if path.suffix not in SUFFIXES or path.is_relative_to(root / "training" / "tests"):
                continue
            text = path.read_text(encoding="utf-8")
            relative = path.relative_to(root).as_posix()
            files.append((text.count("\n"), relative))
            functions += [(lines, relative, first, name)
                          for name, first, lines in functions_of(text)]
    functions.sort(key=lambda f: (-f[0], f[1:]))
    report = [f"{lines:4} {file}:{first} {name}" for lines, file, first, name in functions[:10]]
    report.append(f"{len(functions)} functions, the median has "
                  f"{statistics.median(f[0] for f in functions):g} lines; {len(files)} files, "
                  f"the median has {statistics.median(f[0] for f in files):g} lines, the longest "
                  f"{max(files)[0]} ({max(files)[1]})")
    problems = 0
    long = {(file, name): (lines, first) for lines, file, first, name in functions
            if lines > MOST_LINES}
    for (file, name), (lines, first) in long.items():
        if (file, name) not in EXCEPTIONS:
            report.append(f"{file}:{first}: {name} has {lines} lines, more than {MOST_LINES}")
            problems += 1
    for file, name in EXCEPTIONS:
        if (file, name) not in long:
            report.append(f"{file}: {name} is no longer too long: take it off the list")
            problems += 1
    return report, problems


def self_test():
    body = "  int x = 0;\n" * 10
    samples = [
        ("int plain(int a) {\n" + body + "}\n", [("plain", 12)]),
        ("template <typename T>\nT f(T (*g)(int),\n    T b) {\n" + body + "}\n", [("f", 14)]),
        ("namespace a::b {\nclass C {\n public:\n  C() : x_{1}, y_(2) {\n" + body
         + "  }\n  int get() const { return x_; }\n private:\n  int x_{0};\n};\n}\n",
         [("C", 12), ("get", 1)]),
        ("constexpr int kTable[] = {\n  1,\n  2};\nstruct S {\n  int a = 0;\n};\n", []),
        ("void outer() {\n  auto f = [&](int a) {\n    return a;\n  };\n  for (;;) {\n  }\n}\n",
         [("outer", 7)]),
        ("// { \n#define M(x) {\nchar c() { return '{'; }\nauto s = R\"({{)\";\n", [("c", 1)]),
        ("extern \"C\" {\nint api(const char* s) {\n  return *s == '\\'' ? 1'000 : 0;\n}\n}\n",
         [("api", 3)]),
        ("namespace {\nStatus A::operator()(int x) {\n  return {x};\n}\n}\n", [("operator", 3)]),
        ("enum class E : int { kA, kB };\nbool less(E a, E b) {\n  return a < b;\n}\n",
         [("less", 3)]),
    ]
    failures = 0
    for text, wanted in samples:
        got = [(name.split("::")[-1].split("(")[0].strip(), lines)
               for name, _, lines in functions_of(text)]
        if got != wanted:
            print(f"self-test: {got}, not {wanted}, in:\n{text}")
            failures += 1
    print(f"{len(samples)} samples, {failures} failures")
    return failures == 0


def main(arguments):
    if arguments == ["--self-test"]:
        return 0 if self_test() else 1
    if arguments:
        print(__doc__.strip())
        return 2
    report, problems = check_tree(ROOT)
    print("\n".join(report))
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

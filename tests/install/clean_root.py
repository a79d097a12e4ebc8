#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes a root of Debian packages that this machine has installed, without the network.

    clean_root.py ROOT PACKAGE...

ROOT then has the packages, all that they depend on, and nothing else: their files as they are here, and a database of
dpkg that lists them. What a package of ours needs and does not name is not there. Fails if a package is not installed.
"""

import pathlib
import re
import shutil
import subprocess
import sys

# What Debian expects to be there without a dependency that names it.
ESSENTIAL = ["base-files", "base-passwd", "bash", "coreutils", "dash", "debianutils", "diffutils", "dpkg", "findutils",
             "grep", "gzip", "hostname", "libc-bin", "sed", "tar", "perl-base", "util-linux", "init-system-helpers"]
INFO = pathlib.Path("/var/lib/dpkg/info")


def read_status():
    """Stanzas of installed packages by name, and names that provide another."""
    stanzas, providers = {}, {}
    for stanza in pathlib.Path("/var/lib/dpkg/status").read_text().split("\n\n"):
        fields = dict(re.findall(r"^(\S+): ?(.*(?:\n .*)*)", stanza, re.MULTILINE))
        if fields.get("Status") != "install ok installed":
            continue
        name = fields["Package"]
        stanzas[name] = (stanza, fields)
        for provided in re.split(r",\s*", fields.get("Provides", "")):
            providers.setdefault(provided.split(" ")[0].split(":")[0], []).append(name)
    return stanzas, providers


def closure(wanted):
    stanzas, providers = read_status()
    todo, chosen = list(wanted), {}
    while todo:
        name = todo.pop()
        if name in chosen:
            continue
        if name not in stanzas:
            raise SystemExit(f"clean_root.py: {name} is not installed here")
        stanza, fields = stanzas[name]
        chosen[name] = stanza, fields
        for group in re.split(r",\s*", ", ".join(filter(None, [fields.get("Depends"), fields.get("Pre-Depends")]))):
            names = [re.split(r"[ (:]", option.strip())[0] for option in group.split("|")]
            found = [n for n in names if n in stanzas] or [p for n in names for p in providers.get(n, [])]
            if names != [""] and not found:
                raise SystemExit(f"clean_root.py: {name} needs {group}, which is not installed here")
            todo += found[:1]
    return chosen


def main():
    if len(sys.argv) < 3:
        raise SystemExit(__doc__)
    root = pathlib.Path(sys.argv[1])
    chosen = closure(ESSENTIAL + sys.argv[2:])
    database = root / "var/lib/dpkg"
    for folder in ["info", "updates", "triggers", "alternatives"]:
        (database / folder).mkdir(parents=True)
    paths = set()
    for name, (_, fields) in chosen.items():
        listed = [INFO / f"{name}.list", INFO / f"{name}:{fields['Architecture']}.list"]
        for path in next(p for p in listed if p.exists()).read_text().splitlines():
            paths.add(path)
        for file in [*INFO.glob(f"{name}.*"), *INFO.glob(f"{name}:*")]:
            if file.suffix in (".list", ".md5sums", ".shlibs", ".symbols", ".triggers"):
                shutil.copy(file, database / "info")
    # /bin and the like are links where packages have folders.
    merged = [p for p in ["bin", "sbin", "lib", "lib32", "lib64", "libx32"] if pathlib.Path("/", p).is_symlink()]
    for name in merged:
        (root / name).symlink_to(pathlib.Path("/", name).readlink())
    paths = {f"/usr{p}" if p.split("/")[1] in merged else p for p in paths}
    # Links that scripts of packages make, of the alternatives that are here.
    kept = [p for p in pathlib.Path("/etc/alternatives").iterdir() if str(p.resolve()) in paths]
    links = [p for p in pathlib.Path("/usr/bin").iterdir() if p.is_symlink() and p.readlink() in kept]
    paths.update(map(str, [*kept, *links, "/etc/passwd", "/etc/group", "/etc/ld.so.cache"]))
    listed = "\0".join(p.lstrip("/") for p in sorted(paths) if pathlib.Path(p).is_symlink() or pathlib.Path(p).exists())
    packed = subprocess.Popen(["tar", "-C", "/", "--null", "--no-recursion", "--files-from=-", "-cf", "-"],
                              stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    unpacked = subprocess.Popen(["tar", "-C", root, "-xf", "-"], stdin=packed.stdout)
    packed.stdout.close()
    packed.stdin.write(listed.encode())
    packed.stdin.close()
    if unpacked.wait() != 0 or packed.wait() > 1:
        raise SystemExit("clean_root.py: files could not be copied")
    (database / "status").write_text("\n\n".join(stanza.strip("\n") for stanza, _ in chosen.values()) + "\n")
    (database / "available").write_text("")
    for folder in ["tmp", "dev", "proc", "root", "var/log"]:
        (root / folder).mkdir(parents=True, exist_ok=True)
    print(f"{len(chosen)} packages")


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The licences of a release, as SPDX 2.3: what it has, links, compiles in and starts.

    sbom.py              prints the document
    sbom.py --check      fails where the build looks for a package that the document lacks, or the other way round
"""

import datetime
import hashlib
import json
import os
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent

# Name as CMake looks for it, Debian package, SPDX licence, relation to the release, its project.
LINKED, COMPILED, STARTED = "DYNAMIC_LINK", "CONTAINS", "OPTIONAL_DEPENDENCY_OF"
DEPENDENCIES = [
    ("libzstd", "libzstd-dev", "BSD-3-Clause", LINKED, "https://github.com/facebook/zstd"),
    ("libxxhash", "libxxhash-dev", "BSD-2-Clause", LINKED, "https://github.com/Cyan4973/xxHash"),
    ("libhwy", "libhwy-dev", "Apache-2.0 OR BSD-3-Clause", LINKED, "https://github.com/google/highway"),
    ("JPEG", "libjpeg-dev", "IJG AND BSD-3-Clause AND Zlib", LINKED, "https://libjpeg-turbo.org"),
    ("PNG", "libpng-dev", "libpng-2.0", LINKED, "http://www.libpng.org/pub/png/libpng.html"),
    ("ZLIB", "zlib1g-dev", "Zlib", LINKED, "https://zlib.net"),
    ("libwebp", "libwebp-dev", "BSD-3-Clause", LINKED, "https://chromium.googlesource.com/webm/libwebp"),
    ("libmicrohttpd", "libmicrohttpd-dev", "LGPL-2.1-or-later", LINKED, "https://www.gnu.org/software/libmicrohttpd"),
    ("libsodium", "libsodium-dev", "ISC", LINKED, "https://github.com/jedisct1/libsodium"),
    ("Eigen3", "libeigen3-dev", "MPL-2.0", COMPILED, "https://eigen.tuxfamily.org"),
    ("flatc", "libflatbuffers-dev", "Apache-2.0", COMPILED, "https://github.com/google/flatbuffers"),
    ("CLI11", "libcli11-dev", "BSD-3-Clause", COMPILED, "https://github.com/CLIUtils/CLI11"),
    ("nlohmann_json", "nlohmann-json3-dev", "MIT", COMPILED, "https://github.com/nlohmann/json"),
    ("toml++", "libtomlplusplus-dev", "MIT", COMPILED, "https://github.com/marzer/tomlplusplus"),
    ("ffmpeg", "ffmpeg", "GPL-2.0-or-later", STARTED, "https://ffmpeg.org"),
]
# What the build finds and no release has: of the compiler and the system, of tests, or left out of packages.
NOT_IN_RELEASES = {"PkgConfig", "Threads", "OpenMP", "Python3", "GTest", "benchmark", "MPI", "CUDAToolkit", "l4dcodec"}


def version_of(package):
    done = subprocess.run(["dpkg-query", "-W", "-f", "${Version}", package], text=True, capture_output=True)
    return done.stdout or "NOASSERTION"


def looked_for():
    """Names of packages and programs in the files of CMake."""
    names = set()
    for file in [ROOT / "CMakeLists.txt", *ROOT.glob("cmake/*.cmake"), ROOT / "training/CMakeLists.txt"]:
        text = file.read_text()
        names.update(re.findall(r"find_package\((\w+)", text))
        names.update(re.findall(r"pkg_check_modules\(\w+ [^)]*IMPORTED_TARGET (\w+)", text))
        names.update(re.findall(r"find_path\(\w+ ([\w+]+)/", text))
        names.update(re.findall(r"find_program\(\w+ (flatc)", text))
    return names


def check():
    known = {name for name, *_ in DEPENDENCIES}
    found = looked_for() - NOT_IN_RELEASES
    missing, gone = found - known, known - found - {"ffmpeg"}
    if missing or gone:
        raise SystemExit(f"packaging/sbom.py: the build looks for {sorted(missing)}, which the list lacks, and no longer "
                         f"for {sorted(gone)}")
    print(f"{len(known)} dependencies, as the build has them")


def document():
    version = re.search(r"project\(l4dcodec VERSION ([\d.]+)", (ROOT / "CMakeLists.txt").read_text())[1]
    created = datetime.datetime.fromtimestamp(int(os.environ.get("SOURCE_DATE_EPOCH", "0")), datetime.timezone.utc)
    packages = [{"SPDXID": "SPDXRef-l4dcodec", "name": "l4dcodec", "versionInfo": version, "filesAnalyzed": False,
                 "downloadLocation": "NOASSERTION", "licenseDeclared": "Apache-2.0", "licenseConcluded": "Apache-2.0",
                 "copyrightText": "the l4dcodec contributors"}]
    relations = [{"spdxElementId": "SPDXRef-DOCUMENT", "relationshipType": "DESCRIBES",
                  "relatedSpdxElement": "SPDXRef-l4dcodec"}]
    for _, package, licence, relation, place in DEPENDENCIES:
        name = f"SPDXRef-{package}"
        packages.append({"SPDXID": name, "name": package, "versionInfo": version_of(package), "filesAnalyzed": False,
                         "downloadLocation": place, "licenseDeclared": licence, "licenseConcluded": licence,
                         "copyrightText": "NOASSERTION"})
        ours, theirs = "SPDXRef-l4dcodec", name
        if relation == STARTED:
            ours, theirs = theirs, ours
        relations.append({"spdxElementId": ours, "relationshipType": relation, "relatedSpdxElement": theirs})
    digest = hashlib.sha256(json.dumps([version, packages]).encode()).hexdigest()
    return {"spdxVersion": "SPDX-2.3", "dataLicense": "CC0-1.0", "SPDXID": "SPDXRef-DOCUMENT", "name": f"l4dcodec-{version}",
            "documentNamespace": f"urn:sha256:{digest}",
            "creationInfo": {"created": created.strftime("%Y-%m-%dT%H:%M:%SZ"), "creators": ["Tool: packaging/sbom.py"]},
            "packages": packages, "relationships": relations}


if __name__ == "__main__":
    if sys.argv[1:] == ["--check"]:
        check()
    elif sys.argv[1:]:
        raise SystemExit(__doc__)
    else:
        print(json.dumps(document(), indent=1))

# SPDX-License-Identifier: Apache-2.0
"""Makes the modules of conformance/generate, and those that they import, known to the tests here."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / folder) for folder in ("conformance/generate", "conformance/reference",
                                                   "spec/examples")]

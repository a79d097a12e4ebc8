# SPDX-License-Identifier: Apache-2.0
# The extension that CFFI makes: its names are those of the C headers.
from typing import Any

ffi: Any
lib: Any

# SPDX-License-Identifier: Apache-2.0
# The toolchain of web/wasm, for programs that node runs.
include(${CMAKE_CURRENT_LIST_DIR}/../../web/wasm/toolchain.cmake)
string(APPEND CMAKE_EXE_LINKER_FLAGS_INIT " -sNODERAWFS=1 -sEXIT_RUNTIME=1")

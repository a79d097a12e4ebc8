# SPDX-License-Identifier: Apache-2.0
# Emscripten with 128-bit SIMD and exceptions of WebAssembly: a want of memory stays a status.
find_program(emcc emcc REQUIRED)
file(REAL_PATH ${emcc} emcc)
cmake_path(GET emcc PARENT_PATH emscripten)
include(${emscripten}/cmake/Modules/Platform/Emscripten.cmake)
string(APPEND CMAKE_C_FLAGS_INIT " -msimd128")
string(APPEND CMAKE_CXX_FLAGS_INIT " -msimd128 -fwasm-exceptions")
string(APPEND CMAKE_EXE_LINKER_FLAGS_INIT
  " -fwasm-exceptions -sALLOW_MEMORY_GROWTH=1 -sMAXIMUM_MEMORY=2GB")

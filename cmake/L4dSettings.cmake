# SPDX-License-Identifier: Apache-2.0
# Build settings every target shares.
if(CMAKE_CXX_BYTE_ORDER STREQUAL "BIG_ENDIAN")
  message(FATAL_ERROR "l4dcodec does not run on big-endian machines (${CMAKE_SYSTEM_PROCESSOR}): "
                      "its inner loops take numbers from memory in the order of the stream")
endif()
include(CheckCXXSourceCompiles)
check_cxx_source_compiles("#include <cfloat>
static_assert(FLT_EVAL_METHOD == 0, \"\");
int main() {}" L4D_FLOATS_ARE_BINARY32)
if(NOT L4D_FLOATS_ARE_BINARY32)
  message(FATAL_ERROR "Decoding is defined bit for bit in binary32, but this compiler calculates with "
                      "more digits; on 32-bit x86, -msse2 -mfpmath=sse changes that")
endif()
set(CMAKE_CXX_STANDARD 17)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_C_STANDARD 99)
set(CMAKE_C_STANDARD_REQUIRED ON)
set(CMAKE_C_EXTENSIONS OFF)
# A module of WebAssembly is loaded once, at addresses that its linker knows: code that asks for them
# as it runs is larger and slower there.
if(EMSCRIPTEN)
  set(CMAKE_POSITION_INDEPENDENT_CODE OFF)
else()
  set(CMAKE_POSITION_INDEPENDENT_CODE ON)
endif()
set(CMAKE_C_VISIBILITY_PRESET hidden)
set(CMAKE_CXX_VISIBILITY_PRESET hidden)
set(CMAKE_VISIBILITY_INLINES_HIDDEN ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
# Shared libraries and the tool find each other wherever the tree lies. The build tree has the layout
# of the installed one and the same search path: with one of its own, CMake would pad that with empty
# entries, and an empty entry is the current directory.
set(CMAKE_BUILD_WITH_INSTALL_RPATH ON)
set(CMAKE_INSTALL_RPATH_USE_LINK_PATH ON)
if(BUILD_SHARED_LIBS AND NOT IS_ABSOLUTE "${CMAKE_INSTALL_LIBDIR}")
  set(CMAKE_LIBRARY_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/${CMAKE_INSTALL_LIBDIR})
  file(RELATIVE_PATH from_bin /prefix/bin /prefix/${CMAKE_INSTALL_LIBDIR})
  set(CMAKE_INSTALL_RPATH "$ORIGIN;$ORIGIN/${from_bin}")
endif()
if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  set(CMAKE_BUILD_TYPE Release)
endif()

set(L4D_SANITIZE "" CACHE STRING
  "Sanitizers for all code, as in -fsanitize= (address,undefined); empty for none")
if(L4D_SANITIZE)
  # Recovery is off, so that a report is a failed test and not a line in a log.
  add_compile_options(-fsanitize=${L4D_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer)
  # Not every compiler says by a macro of its own that it sanitizes.
  add_compile_definitions(L4D_SANITIZED)
  # Reports and debug information name files from the root of the tree on, so that the objects of one clone
  # serve another.
  add_compile_options(-ffile-prefix-map=${PROJECT_SOURCE_DIR}=.)
  if(L4D_SANITIZE MATCHES "address.*undefined|undefined.*address")
    # What follows a null pointer ends at the address sanitizer.
    add_compile_options(-fno-sanitize=null)
  endif()
  add_link_options(-fsanitize=${L4D_SANITIZE})
endif()

include(L4dHardening)
# Programs can be loaded anywhere, and what the loader has filled in cannot be written afterwards.
include(CheckPIESupported)
check_pie_supported()
include(CheckLinkerFlag)
file(WRITE ${PROJECT_BINARY_DIR}/CMakeFiles/probe.map "L4D_PROBE { local: *; };\n")
if(UNIX)
  check_linker_flag(CXX "LINKER:--version-script=${PROJECT_BINARY_DIR}/CMakeFiles/probe.map"
    L4D_LINKER_HAS_VERSION_SCRIPTS)
endif()
check_linker_flag(CXX "LINKER:-z,relro,-z,now" L4D_LINKER_BINDS_NOW)
if(L4D_LINKER_BINDS_NOW)
  add_link_options("LINKER:-z,relro,-z,now")
endif()

add_library(l4d_settings INTERFACE)
target_include_directories(l4d_settings INTERFACE
  $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>
  $<BUILD_INTERFACE:${L4D_PUBLIC_HEADERS}>)
# Contraction off everywhere: one flag for all is simpler to trust than a list of normative files, and
# code that wants a fused multiply-add says so (hn::MulAdd, std::fma).
if(MSVC) # no contraction is its default; no test has run with it
  set(l4d_flags /fp:precise /W3 /utf-8 $<$<BOOL:${L4D_WERROR}>:/WX>)
else()
  set(l4d_flags -ffp-contract=off -Wall -Wextra -Wshadow -Wconversion -Wsign-conversion -Wundef
    $<$<BOOL:${L4D_WERROR}>:-Werror>)
endif()
if(MINGW)
  # GCC aligns the stack to 16 bytes on Windows and still moves vectors of 32 and 64 bytes with
  # instructions that want more (its bug 54412).
  include(CheckCXXCompilerFlag)
  check_cxx_compiler_flag(-Wa,-muse-unaligned-vector-move L4D_ASSEMBLER_MOVES_UNALIGNED)
  if(NOT L4D_ASSEMBLER_MOVES_UNALIGNED)
    message(FATAL_ERROR "GCC's code for vectors is wrong on Windows without an assembler that knows "
                        "-muse-unaligned-vector-move: binutils 2.38 or later")
  endif()
  list(APPEND l4d_flags -Wa,-muse-unaligned-vector-move)
endif()
target_compile_options(l4d_settings INTERFACE
  "$<$<COMPILE_LANGUAGE:C,CXX>:${l4d_flags};${L4D_HARDENING_FLAGS}>")
if(L4D_FORTIFY_LEVEL GREATER 0) # which is for optimised code only
  target_compile_definitions(l4d_settings INTERFACE
    "$<$<AND:$<CONFIG:Release,RelWithDebInfo,MinSizeRel>,$<COMPILE_LANGUAGE:C,CXX>>:_FORTIFY_SOURCE=${L4D_FORTIFY_LEVEL}>")
endif()
if(L4D_HAVE_CUDA)
  # The host half of device code: nvcc's own output is not held to all warnings.
  target_compile_options(l4d_settings INTERFACE
    "$<$<COMPILE_LANGUAGE:CUDA>:-Xcompiler=-ffp-contract=off,-Wall;--expt-relaxed-constexpr>")
  # The lowest compute capability, from 9.0 on, that there is code for; see cuda/overlap.cuh.
  set(overlapping 1000)
  foreach(architecture IN LISTS CMAKE_CUDA_ARCHITECTURES)
    string(REGEX REPLACE "[^0-9]" "" number "${architecture}")
    if(number GREATER_EQUAL 90 AND number LESS overlapping)
      set(overlapping ${number})
    endif()
  endforeach()
  target_compile_definitions(l4d_settings INTERFACE
    L4D_HAVE_CUDA $<$<COMPILE_LANGUAGE:CUDA>:L4D_CUDA_MIN_OVERLAPPING=${overlapping}>)
endif()
# Arrays and structs cannot hold vectors of a size that is known at run time alone; where a processor
# has those, it has vectors of 128 bits too.
if(NOT CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64|x86|i.86)$")
  target_compile_definitions(l4d_settings INTERFACE
    "HWY_DISABLED_TARGETS=(HWY_SVE|HWY_SVE2|HWY_SVE_256|HWY_SVE2_128|HWY_RVV)")
endif()
if(L4D_OPENMP)
  target_compile_definitions(l4d_settings INTERFACE L4D_OPENMP)
endif()
# l4d.wasm has no reader that is asked ahead of need, and no kernels to compare with; where memory ends, so does the
# module. The linker sees all of it at once, which takes a twentieth off. Its tests (tests/cross) want all of that.
if(L4D_BUILD_WASM AND NOT L4D_BUILD_TESTS)
  target_compile_definitions(l4d_settings INTERFACE L4D_PLAYER_ONLY)
  target_compile_options(l4d_settings INTERFACE -fignore-exceptions -fno-rtti -flto)
endif()
# L4D_API means "export" while a shared library is compiled, and nothing in a static one. On other
# systems nothing is defined: builds of both kinds find each other's objects in a compiler cache.
if(WIN32)
  target_compile_definitions(l4d_settings INTERFACE
    $<IF:$<BOOL:${BUILD_SHARED_LIBS}>,L4D_EXPORTS,L4D_STATIC_DEFINE>)
endif()

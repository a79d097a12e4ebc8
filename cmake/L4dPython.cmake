# SPDX-License-Identifier: Apache-2.0
# A Python with CFFI and the headers for extensions. L4D_HAVE_PYTHON says whether the package is built.
set(L4D_PYTHON OFF CACHE STRING
  "The Python package (python/): ON, OFF, or AUTO: where a Python with CFFI and its headers is found")
set_property(CACHE L4D_PYTHON PROPERTY STRINGS AUTO ON OFF)

set(L4D_HAVE_PYTHON OFF)
if(NOT L4D_PYTHON)
  return()
endif()
# The distribution's packages belong to its own interpreter, which need not be the first on the path.
find_program(L4D_PYTHON_INTERPRETER python3 PATHS /usr/bin NO_DEFAULT_PATH)
find_program(L4D_PYTHON_INTERPRETER python3)
set(L4D_PYTHON_HEADERS "" CACHE STRING
  "Folders of Python's headers, for another machine than the interpreter's; empty: the interpreter's")
mark_as_advanced(L4D_PYTHON_INTERPRETER L4D_PYTHON_HEADERS)
set(lacks "")
if(NOT L4D_LINKER_HAS_VERSION_SCRIPTS)
  set(lacks "a system with ELF files")
elseif(BUILD_SHARED_LIBS OR (L4D_SANITIZE AND L4D_PYTHON STREQUAL AUTO))
  # With sanitizers, the interpreter has to be begun with their libraries.
  set(lacks "static libraries without sanitizers")
elseif(NOT L4D_BUILD_ENCODER OR NOT L4D_BUILD_RENDER)
  set(lacks "the encoder and the renderer")
else()
  execute_process(
    COMMAND ${L4D_PYTHON_INTERPRETER} -c "import cffi, os, sysconfig
folder = sysconfig.get_path('include')
os.stat(os.path.join(folder, 'Python.h'))
print(folder)"
    OUTPUT_VARIABLE L4D_PYTHON_INCLUDE OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE status)
  if(NOT status EQUAL 0)
    set(lacks "a Python with CFFI and headers (Debian: python3-cffi, python3-dev)")
  endif()
endif()
if(L4D_PYTHON_HEADERS)
  set(L4D_PYTHON_INCLUDE ${L4D_PYTHON_HEADERS})
endif()
if(NOT lacks)
  set(L4D_HAVE_PYTHON ON)
elseif(L4D_PYTHON STREQUAL AUTO)
  message(STATUS "The Python package is left out: it needs ${lacks}")
else()
  message(FATAL_ERROR "L4D_PYTHON is ON and needs ${lacks}")
endif()

# SPDX-License-Identifier: Apache-2.0
# The CUDA compiler, where there is one. L4D_HAVE_CUDA says whether device code is built.
include(CheckLanguage)

# What is built never depends on what happens to be installed, but for AUTO.
set(L4D_CUDA OFF CACHE STRING "Device code: ON, OFF, or AUTO: where a CUDA compiler is found")
set_property(CACHE L4D_CUDA PROPERTY STRINGS AUTO ON OFF)

set(L4D_HAVE_CUDA OFF)
if(L4D_CUDA)
  if(NOT CMAKE_CUDA_COMPILER AND NOT DEFINED ENV{CUDACXX})
    # The toolkit's own folder is seldom on the path.
    find_program(L4D_NVCC nvcc HINTS ENV CUDA_PATH PATHS /usr/local/cuda PATH_SUFFIXES bin)
    mark_as_advanced(L4D_NVCC)
    if(L4D_NVCC)
      set(CMAKE_CUDA_COMPILER ${L4D_NVCC})
    endif()
  endif()
  set(architectures "${CMAKE_CUDA_ARCHITECTURES}")
  check_language(CUDA)
  if(CMAKE_CUDA_COMPILER AND NOT architectures)
    # From 7.5 on all that the compiler knows, less those that differ from another only for modules
    # and boards of their own. Of the last one PTX is kept too, for devices to come.
    execute_process(COMMAND ${CMAKE_CUDA_COMPILER} --list-gpu-arch OUTPUT_VARIABLE known)
    foreach(architecture IN ITEMS 75 80 86 89 90 100 120)
      if(known MATCHES "compute_${architecture}\n")
        list(APPEND architectures ${architecture}-real)
        set(last ${architecture})
      endif()
    endforeach()
    if(NOT architectures)
      message(FATAL_ERROR "${CMAKE_CUDA_COMPILER} knows none of the devices that this code is for")
    endif()
    list(APPEND architectures ${last}-virtual)
    set(CMAKE_CUDA_ARCHITECTURES "${architectures}" CACHE STRING
      "Compute capabilities that device code is built for" FORCE)
  endif()
  if(CMAKE_CUDA_COMPILER)
    enable_language(CUDA)
    find_package(CUDAToolkit REQUIRED)
    set(CMAKE_CUDA_STANDARD 17)
    set(CMAKE_CUDA_STANDARD_REQUIRED ON)
    set(CMAKE_CUDA_EXTENSIONS OFF)
    set(L4D_HAVE_CUDA ON)
  elseif(NOT L4D_CUDA STREQUAL AUTO)
    message(FATAL_ERROR "L4D_CUDA is ${L4D_CUDA}, but no CUDA compiler was found: name one with "
                        "-DCMAKE_CUDA_COMPILER=/path/to/nvcc")
  endif()
endif()
if(NOT L4D_HAVE_CUDA)
  message(STATUS "No CUDA: device code is left out")
endif()

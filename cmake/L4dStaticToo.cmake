# SPDX-License-Identifier: Apache-2.0
# Static libraries next to the shared ones, of the same objects: l4dcodec_static and so on, files
# libl4dcodec.a and so on. On ELF an object of a shared library is one of a static library too, and
# L4D_API means the same to programs that use either, so one pkg-config file serves both.
function(l4d_static_too library)
  add_library(${library}_static STATIC ${ARGN})
  add_library(l4dcodec::${library}_static ALIAS ${library}_static)
  set_target_properties(${library}_static PROPERTIES
    OUTPUT_NAME ${library}
    LINKER_LANGUAGE CXX)
  target_link_libraries(${library}_static PRIVATE
    $<BUILD_INTERFACE:l4d_threads> PkgConfig::HWY l4d_installed_runtime)
  if(L4D_HAVE_CUDA)
    target_link_libraries(${library}_static PRIVATE $<BUILD_INTERFACE:CUDA::cudart_static>)
  endif()
endfunction()

l4d_static_too(l4dcodec
  $<TARGET_OBJECTS:l4dcodec> $<TARGET_OBJECTS:l4d_core> $<TARGET_OBJECTS:l4d_decoder>)
target_link_libraries(l4dcodec_static PRIVATE PkgConfig::ZSTD PkgConfig::XXHASH)
target_include_directories(l4dcodec_static PUBLIC
  $<BUILD_INTERFACE:${L4D_PUBLIC_HEADERS}>
  $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
if(TARGET l4dencoder)
  l4d_static_too(l4dencoder $<TARGET_OBJECTS:l4dencoder> $<TARGET_OBJECTS:l4d_encoder>)
  target_link_libraries(l4dencoder_static PUBLIC l4dcodec_static)
endif()
if(TARGET l4drender)
  # Without the internals of libl4dcodec that a shared libl4drender has for itself.
  l4d_static_too(l4drender $<FILTER:$<TARGET_OBJECTS:l4drender>,EXCLUDE,/__/libl4dcodec/>)
  target_link_libraries(l4drender_static PUBLIC l4dcodec_static)
endif()

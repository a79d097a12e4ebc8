# SPDX-License-Identifier: Apache-2.0
# Installation: headers, library, tool, CMake package and pkg-config file.
include(CMakePackageConfigHelpers)

set(l4d_cmake_dir ${CMAKE_INSTALL_LIBDIR}/cmake/l4dcodec)

install(TARGETS l4dcodec EXPORT l4dcodec
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}
  LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}
  RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/l4d DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
  FILES_MATCHING PATTERN "*.h" PATTERN "*.hpp")
install(FILES ${PROJECT_BINARY_DIR}/include/l4d/export.h
  DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/l4d)
if(TARGET l4drender)
  install(TARGETS l4drender EXPORT l4dcodec
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}
    LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}
    RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
endif()
if(TARGET l4dcodec_cli)
  install(TARGETS l4dcodec_cli RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
endif()

install(EXPORT l4dcodec NAMESPACE l4dcodec:: FILE l4dcodecTargets.cmake
  DESTINATION ${l4d_cmake_dir})
configure_package_config_file(
  ${PROJECT_SOURCE_DIR}/cmake/l4dcodecConfig.cmake.in
  ${PROJECT_BINARY_DIR}/l4dcodecConfig.cmake
  INSTALL_DESTINATION ${l4d_cmake_dir}
  NO_SET_AND_CHECK_MACRO)
# Until 1.0 a minor version may break what the one before promised.
if(PROJECT_VERSION_MAJOR EQUAL 0)
  set(l4d_compatibility SameMinorVersion)
else()
  set(l4d_compatibility SameMajorVersion)
endif()
write_basic_package_version_file(${PROJECT_BINARY_DIR}/l4dcodecConfigVersion.cmake
  COMPATIBILITY ${l4d_compatibility})
install(FILES
  ${PROJECT_BINARY_DIR}/l4dcodecConfig.cmake
  ${PROJECT_BINARY_DIR}/l4dcodecConfigVersion.cmake
  DESTINATION ${l4d_cmake_dir})

# pkg-config: a static library needs the C++ runtime and the OpenMP runtime of the compiler it was
# built with; a shared one brings its own.
set(L4D_PC_CFLAGS "")
set(L4D_PC_LIBS_PRIVATE "")
if(NOT BUILD_SHARED_LIBS)
  set(L4D_PC_CFLAGS " -DL4D_STATIC_DEFINE")
endif()
set(runtime ${CMAKE_CXX_IMPLICIT_LINK_LIBRARIES})
list(REMOVE_ITEM runtime ${CMAKE_C_IMPLICIT_LINK_LIBRARIES})
list(APPEND runtime ${OpenMP_CXX_LIB_NAMES} pthread m)
list(REMOVE_DUPLICATES runtime)
foreach(library IN LISTS runtime)
  string(APPEND L4D_PC_LIBS_PRIVATE " -l${library}")
endforeach()
if(L4D_HAVE_CUDA)
  # The runtime is linked into whoever links the static library; it looks for the driver by itself.
  string(APPEND L4D_PC_LIBS_PRIVATE " -L${CUDAToolkit_LIBRARY_DIR} -lcudart_static -lrt -ldl")
endif()
# The two directories stay relative to the prefix, so that a moved tree can be used with
# pkg-config --define-prefix; an absolute one is taken as it is.
foreach(dir IN ITEMS LIBDIR INCLUDEDIR)
  if(IS_ABSOLUTE ${CMAKE_INSTALL_${dir}})
    set(L4D_PC_${dir} ${CMAKE_INSTALL_${dir}})
  else()
    set(L4D_PC_${dir} "\${prefix}/${CMAKE_INSTALL_${dir}}")
  endif()
endforeach()
configure_file(${PROJECT_SOURCE_DIR}/cmake/l4dcodec.pc.in ${PROJECT_BINARY_DIR}/l4dcodec.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/l4dcodec.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
if(TARGET l4drender)
  configure_file(${PROJECT_SOURCE_DIR}/cmake/l4drender.pc.in ${PROJECT_BINARY_DIR}/l4drender.pc @ONLY)
  install(FILES ${PROJECT_BINARY_DIR}/l4drender.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
endif()

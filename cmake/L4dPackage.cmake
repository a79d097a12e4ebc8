# SPDX-License-Identifier: Apache-2.0
# Installation: headers, libraries, tool, CMake package and pkg-config files. Nothing that is
# installed names the prefix, so that the tree can be moved.
include(CMakePackageConfigHelpers)

set(l4d_cmake_dir ${CMAKE_INSTALL_LIBDIR}/cmake/l4dcodec)
set(l4d_libraries l4dcodec)
foreach(library IN ITEMS l4dencoder l4drender)
  if(TARGET ${library})
    list(APPEND l4d_libraries ${library})
  endif()
endforeach()

set(l4d_installs_static ON)
if(BUILD_SHARED_LIBS AND NOT L4D_STATIC_TOO)
  set(l4d_installs_static OFF)
endif()
set(runtime "")
if(NOT BUILD_SHARED_LIBS)
  set(runtime l4d_installed_runtime)
elseif(L4D_STATIC_TOO)
  # Targets of their own: who uses the shared ones needs none of the dependencies.
  list(TRANSFORM l4d_libraries APPEND _static OUTPUT_VARIABLE static_libraries)
  install(TARGETS ${static_libraries} l4d_installed_runtime EXPORT l4dcodec_static
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
  install(EXPORT l4dcodec_static NAMESPACE l4dcodec:: FILE l4dcodecStaticTargets.cmake
    DESTINATION ${l4d_cmake_dir})
endif()
install(TARGETS ${l4d_libraries} ${runtime} EXPORT l4dcodec
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}
  LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}
  RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
# Without the renderer, nothing defines what its headers declare. A decoder alone and without device
# code is for those who want nothing else.
set(l4d_left_out)
if(NOT TARGET l4drender)
  set(l4d_left_out PATTERN "render.*" EXCLUDE PATTERN "sensitivity.*" EXCLUDE
    PATTERN "cuda_render.h" EXCLUDE
    PATTERN "cuda_player.h" EXCLUDE PATTERN "cuda_train.h" EXCLUDE)
  if(NOT TARGET l4dencoder)
    list(APPEND l4d_left_out PATTERN "encode.*" EXCLUDE PATTERN "session.h" EXCLUDE
      PATTERN "parameters.h" EXCLUDE)
    if(NOT L4D_HAVE_CUDA)
      list(APPEND l4d_left_out PATTERN "cuda.*" EXCLUDE PATTERN "cuda_packed.h" EXCLUDE)
    endif()
  endif()
endif()
install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/l4d DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
  FILES_MATCHING PATTERN "*.h" PATTERN "*.hpp" ${l4d_left_out})
if(TARGET l4dcodec_cli)
  install(TARGETS l4dcodec_cli RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
  # After a build of the tool alone: these are installed if they are there.
  get_target_property(optional l4dcodec_cli L4D_PAGES)
  if(TARGET l4dtrain)
    get_target_property(pages l4dtrain L4D_PAGES)
    list(APPEND optional ${CMAKE_RUNTIME_OUTPUT_DIRECTORY}/l4dtrain ${pages})
  endif()
  foreach(file IN LISTS optional)
    if(file)
      install(CODE "if(NOT EXISTS \"${file}\")
        message(STATUS \"Left out: ${file} is not built\")
      endif()")
    endif()
  endforeach()
endif()
install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})
# What makes other programs recognise streams.
install(FILES ${PROJECT_SOURCE_DIR}/spec/media/l4dcodec.xml
  DESTINATION ${CMAKE_INSTALL_DATADIR}/mime/packages)
install(FILES ${PROJECT_SOURCE_DIR}/spec/media/l4d.magic
  DESTINATION ${CMAKE_INSTALL_DATADIR}/l4dcodec)

install(EXPORT l4dcodec NAMESPACE l4dcodec:: FILE l4dcodecTargets.cmake
  DESTINATION ${l4d_cmake_dir})
configure_package_config_file(
  ${PROJECT_SOURCE_DIR}/cmake/l4dcodecConfig.cmake.in
  ${PROJECT_BINARY_DIR}/l4dcodecConfig.cmake
  INSTALL_DESTINATION ${l4d_cmake_dir}
  PATH_VARS CMAKE_INSTALL_LIBDIR
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

# The CUDA runtime that static libraries with device code were built with goes with them, so that
# whoever links them needs no toolkit. It looks for the driver when it runs.
set(l4d_cuda_runtime "")
if(L4D_HAVE_CUDA AND l4d_installs_static)
  install(FILES ${CUDA_cudart_static_LIBRARY} DESTINATION ${CMAKE_INSTALL_LIBDIR}
    RENAME libl4dcudart.a)
  set(l4d_cuda_runtime " -ll4dcudart -lrt -ldl")
endif()

# pkg-config: a static library needs the C++ runtime (and perhaps the OpenMP runtime) of the compiler
# it was built with. It does so always, not only with --static; a shared one brings its own.
set(dependencies "libzstd libxxhash libhwy")
list(APPEND L4D_CXX_RUNTIME pthread m)
list(REMOVE_DUPLICATES L4D_CXX_RUNTIME)
list(TRANSFORM L4D_CXX_RUNTIME PREPEND " -l" OUTPUT_VARIABLE runtime)
list(JOIN runtime "" runtime)
string(PREPEND runtime "${l4d_cuda_runtime}")
if(BUILD_SHARED_LIBS)
  set(L4D_PC_REQUIRES "Requires.private: ${dependencies}")
  set(L4D_PC_LIBS "\nLibs.private:${runtime}")
  set(L4D_PC_CFLAGS "")
else()
  set(L4D_PC_REQUIRES "Requires: ${dependencies}")
  set(L4D_PC_LIBS "${runtime}")
  set(L4D_PC_CFLAGS "")
  if(WIN32)
    set(L4D_PC_CFLAGS " -DL4D_STATIC_DEFINE")
  endif()
endif()
# From the folder of the .pc file to the prefix.
if(IS_ABSOLUTE "${CMAKE_INSTALL_LIBDIR}")
  set(L4D_PC_PREFIX ${CMAKE_INSTALL_PREFIX})
else()
  file(RELATIVE_PATH up /prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig /prefix)
  string(REGEX REPLACE "/$" "" up "${up}")
  set(L4D_PC_PREFIX "\${pcfiledir}/${up}")
endif()
foreach(dir IN ITEMS LIBDIR INCLUDEDIR)
  if(IS_ABSOLUTE "${CMAKE_INSTALL_${dir}}")
    set(L4D_PC_${dir} ${CMAKE_INSTALL_${dir}})
  else()
    set(L4D_PC_${dir} "\${prefix}/${CMAKE_INSTALL_${dir}}")
  endif()
endforeach()
foreach(library IN LISTS l4d_libraries)
  configure_file(${PROJECT_SOURCE_DIR}/cmake/${library}.pc.in ${PROJECT_BINARY_DIR}/${library}.pc @ONLY)
  install(FILES ${PROJECT_BINARY_DIR}/${library}.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
endforeach()

# SPDX-License-Identifier: Apache-2.0
# The man page of the tool and its completions for bash, zsh and fish. A program of the build makes
# them from the tool's own command line. Where programs of this build do not run, one of another
# build of the same sources has to be named, or the tool comes without them.
set(L4D_PAGES_PROGRAM "" CACHE FILEPATH
  "l4dcodec_pages of a build for this machine, to make the tool's pages when cross-compiling")
if(CMAKE_CROSSCOMPILING AND NOT CMAKE_CROSSCOMPILING_EMULATOR AND NOT L4D_PAGES_PROGRAM)
  message(WARNING "Without L4D_PAGES_PROGRAM, the l4dcodec_pages of a build for this machine, the "
                  "tool comes without man page and completions")
  return()
endif()
if(L4D_PAGES_PROGRAM)
  set(program ${L4D_PAGES_PROGRAM})
else()
  add_executable(l4dcodec_pages
    pages/bash_completion.cc
    pages/fish_completion.cc
    pages/main.cc
    pages/man_page.cc
    pages/manual.cc
    pages/zsh_completion.cc
    $<FILTER:$<TARGET_OBJECTS:l4dcodec_cli>,EXCLUDE,/main[.]cc[.]>) # all of the tool but main()
  target_link_libraries(l4dcodec_pages PRIVATE $<TARGET_PROPERTY:l4dcodec_cli,LINK_LIBRARIES>)
  set(program l4dcodec_pages)
endif()

# Of $SOURCE_DATE_EPOCH where that is set, so that the same sources give the same page.
string(TIMESTAMP date "%Y-%m-%d" UTC)
# Each lies as it will be installed, so that the folder can be tried without installing it.
set(folder ${PROJECT_BINARY_DIR}/pages)
set(man man/man1/l4dcodec.1)
set(bash bash-completion/completions/l4dcodec)
set(zsh zsh/site-functions/_l4dcodec)
set(fish fish/vendor_completions.d/l4dcodec.fish)
set(files "")
foreach(page IN ITEMS man bash zsh fish)
  cmake_path(GET ${page} PARENT_PATH parent)
  file(MAKE_DIRECTORY ${folder}/${parent})
  list(APPEND files ${folder}/${${page}})
  if(page STREQUAL man)
    install(FILES ${folder}/${${page}} DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 OPTIONAL)
  else()
    install(FILES ${folder}/${${page}} DESTINATION ${CMAKE_INSTALL_DATADIR}/${parent} OPTIONAL)
  endif()
endforeach()
add_custom_command(OUTPUT ${files}
  COMMAND ${program} ${PROJECT_VERSION} ${date} ${files}
  DEPENDS ${program}
  COMMENT "Making the man page and the completions of the tool"
  VERBATIM)
set_target_properties(l4dcodec_cli PROPERTIES L4D_PAGES "${files}")
add_custom_target(l4d_pages ALL DEPENDS ${files})

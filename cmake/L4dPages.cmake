# SPDX-License-Identifier: Apache-2.0
# l4d_add_pages(TOOL PROGRAM COMPONENT SOURCE...): the man page of the executable TOOL and its completions for bash,
# zsh and fish. PROGRAM, of SOURCE and all of the executable but its main(), makes them from the tool's own command line.
# Where programs of this build do not run, one of another build of the same sources has to be named, or the tool comes
# without them.
function(l4d_add_pages target program component)
  get_target_property(name ${target} OUTPUT_NAME)
  if(NOT name)
    set(name ${target})
  endif()
  string(TOUPPER ${program}_PROGRAM given)
  set(${given} "" CACHE FILEPATH
    "${program} of a build for this machine, to make the pages of ${name} when cross-compiling")
  if(CMAKE_CROSSCOMPILING AND NOT CMAKE_CROSSCOMPILING_EMULATOR AND NOT ${given})
    message(WARNING "Without ${given}, the ${program} of a build for this machine, ${name} comes without man page and "
                    "completions")
    return()
  endif()
  if(${given})
    set(run ${${given}})
  else()
    set(run ${program})
    add_executable(${program}
      ${ARGN}
      ${CMAKE_CURRENT_FUNCTION_LIST_DIR}/../pages/bash_completion.cc
      ${CMAKE_CURRENT_FUNCTION_LIST_DIR}/../pages/fish_completion.cc
      ${CMAKE_CURRENT_FUNCTION_LIST_DIR}/../pages/man_page.cc
      ${CMAKE_CURRENT_FUNCTION_LIST_DIR}/../pages/manual.cc
      ${CMAKE_CURRENT_FUNCTION_LIST_DIR}/../pages/write_pages.cc
      ${CMAKE_CURRENT_FUNCTION_LIST_DIR}/../pages/zsh_completion.cc
      $<FILTER:$<TARGET_OBJECTS:${target}>,EXCLUDE,/main[.]cc[.]>)
    target_link_libraries(${program} PRIVATE $<TARGET_PROPERTY:${target},LINK_LIBRARIES>)
  endif()

  # Of $SOURCE_DATE_EPOCH where that is set, so that the same sources give the same page.
  string(TIMESTAMP date "%Y-%m-%d" UTC)
  # Each lies as it will be installed, so that the folder can be tried without installing it.
  set(folder ${PROJECT_BINARY_DIR}/pages)
  set(files "")
  foreach(page IN ITEMS man/man1/${name}.1 bash-completion/completions/${name} zsh/site-functions/_${name}
      fish/vendor_completions.d/${name}.fish)
    cmake_path(GET page PARENT_PATH parent)
    file(MAKE_DIRECTORY ${folder}/${parent})
    list(APPEND files ${folder}/${page})
    set(destination ${CMAKE_INSTALL_DATADIR}/${parent})
    if(parent STREQUAL man/man1)
      set(destination ${CMAKE_INSTALL_MANDIR}/man1)
    endif()
    install(FILES ${folder}/${page} DESTINATION ${destination} COMPONENT ${component} OPTIONAL)
  endforeach()
  add_custom_command(OUTPUT ${files}
    COMMAND ${run} ${PROJECT_VERSION} ${date} ${files}
    DEPENDS ${run}
    COMMENT "Making the man page and the completions of ${name}"
    VERBATIM)
  set_target_properties(${target} PROPERTIES L4D_PAGES "${files}")
  add_custom_target(${name}_pages_files ALL DEPENDS ${files})
endfunction()

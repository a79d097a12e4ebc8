# SPDX-License-Identifier: Apache-2.0
# cmake -DOUTPUT=embedded.cc -DPICTURE=cli/http/picture [-DPLAYER=build/web/player] -P embed.cmake: files for web
# pages as C++.
set(text "#include \"cli/http/embedded.h\"\n\nnamespace l4d::cli {\n")
# embed(FUNCTION FOLDER NAME...): none where the folder is not given.
function(embed function folder)
  set(list "")
  set(index 0)
  if(folder)
    foreach(name IN LISTS ARGN)
      file(READ ${folder}/${name} hex HEX)
      file(SIZE ${folder}/${name} size)
      string(REGEX REPLACE "(..)" "0x\\1," bytes "${hex}")
      string(APPEND text "static const unsigned char ${function}_${index}[] = {${bytes}};\n")
      string(APPEND list "      {\"${name}\", ${function}_${index}, ${size}},\n")
      math(EXPR index "${index} + 1")
    endforeach()
  endif()
  string(APPEND text "const std::vector<EmbeddedFile>& ${function}() {\n"
    "  static const std::vector<EmbeddedFile> files = {\n${list}  };\n  return files;\n}\n")
  set(text "${text}" PARENT_SCOPE)
endfunction()
embed(player_files "${PLAYER}" index.html player.js worker.js sort-worker.js l4d.wasm)
embed(picture_files "${PICTURE}" index.html page.js)
string(APPEND text "\n}  // namespace l4d::cli\n")
file(WRITE ${OUTPUT} "${text}")

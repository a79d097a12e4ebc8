# SPDX-License-Identifier: Apache-2.0
# cmake -DOUTPUT=player.cc [-DFOLDER=build/web/player] -P embed.cmake: the files of the player as C++.
set(text "#include \"cli/http/player.h\"\n\nnamespace l4d::cli {\n")
set(list "")
if(FOLDER)
  set(index 0)
  foreach(name IN ITEMS index.html player.js worker.js sort-worker.js l4d.wasm)
    file(READ ${FOLDER}/${name} hex HEX)
    file(SIZE ${FOLDER}/${name} size)
    string(REGEX REPLACE "(..)" "0x\\1," bytes "${hex}")
    string(APPEND text "static const unsigned char kFile${index}[] = {${bytes}};\n")
    string(APPEND list "      {\"${name}\", kFile${index}, ${size}},\n")
    math(EXPR index "${index} + 1")
  endforeach()
endif()
string(APPEND text "const std::vector<PlayerFile>& player_files() {\n"
  "  static const std::vector<PlayerFile> files = {\n${list}  };\n  return files;\n}\n\n}  // namespace l4d::cli\n")
file(WRITE ${OUTPUT} "${text}")

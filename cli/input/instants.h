// SPDX-License-Identifier: Apache-2.0
// Files that show a scene at one instant.
#pragma once

#include <string>

#include "cli/command/context.h"
#include "io/formats/instant_file.h"

namespace l4d::cli {

io::Splats take_splats(SplatArrays arrays);

// ending: in lower case; that of the name is in any.
bool ends_in(const std::string& name, const std::string& ending);
// Of io::instant_extensions(), the one that `name` ends in, or "".
std::string instant_extension(const std::string& name);

// Adds what one file came to to what those before did.
void add_notes(const io::WriteNotes& more, io::WriteNotes* notes);
void print_notes(Context& context, const io::WriteNotes& notes);
// io::write_ftgs_ply or io::write_stg_ply within the budget of the command; prints its notes.
void write_moving(Context& context, const std::string& path, const io::Scene& scene,
                  io::WriteNotes (*write)(const std::string&, const io::Scene&, const io::Check&));
// io::write_4dgs within the budget of the command; prints its notes.
void write_births(Context& context, const std::string& path, const io::Scene& scene);

}  // namespace l4d::cli

// SPDX-License-Identifier: Apache-2.0
#include "cli/input/instants.h"

#include <algorithm>
#include <cctype>
#include <utility>

#include "cli/command/progress.h"
#include "cli/text/units.h"
#include "io/formats/write_4dgs.h"
#include "io/ply/scene_ply.h"

namespace l4d::cli {

io::Splats take_splats(SplatArrays arrays) {
  io::Splats splats;
  splats.sh_degree = arrays.sh_degree;
  splats.position = std::move(arrays.position);
  splats.covariance = std::move(arrays.covariance);
  splats.opacity = std::move(arrays.opacity);
  splats.sh = std::move(arrays.sh);
  return splats;
}

bool ends_in(const std::string& name, const std::string& ending) {
  return name.size() >= ending.size() &&
         std::equal(ending.rbegin(), ending.rend(), name.rbegin(), [](char end, char c) {
           return std::tolower(static_cast<unsigned char>(c)) == end;
         });
}

std::string instant_extension(const std::string& name) {
  for (const std::string& known : io::instant_extensions()) {
    if (ends_in(name, known)) return known;
  }
  return "";
}

void add_notes(const io::WriteNotes& more, io::WriteNotes* notes) {
  for (const auto& [text, count] : more) (*notes)[text] += count;
}

void print_notes(Context& context, const io::WriteNotes& notes) {
  for (const auto& [text, count] : notes) {
    context.note(count == 0 ? text : format_count(count) + " " + text);
  }
}

void write_moving(Context& context, const std::string& path, const io::Scene& scene,
                  io::WriteNotes (*write)(const std::string&, const io::Scene&, const io::Check&)) {
  const auto memory =
      io::hold(context.budget().holder(), io::bytes_to_write_moving(scene), "the output as PLY");
  print_notes(context, write(path, scene, check_interrupt));
}

void write_births(Context& context, const std::string& path, const io::Scene& scene) {
  const auto memory =
      io::hold(context.budget().holder(), io::bytes_to_write_4dgs(scene), "the output as .4dgs");
  print_notes(context, io::write_4dgs(path, scene, check_interrupt));
}

}  // namespace l4d::cli

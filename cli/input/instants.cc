// SPDX-License-Identifier: Apache-2.0
#include "cli/input/instants.h"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <utility>

#include "cli/command/progress.h"
#include "cli/text/units.h"
#include "io/formats/write_4dgs.h"

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

std::string instant_extension(const std::string& name) {
  std::string lower = name;
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  for (const std::string& known : io::instant_extensions()) {
    if (lower.size() > known.size() &&
        lower.compare(lower.size() - known.size(), known.size(), known) == 0) {
      return known;
    }
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

void write_births(Context& context, const std::string& path, const io::Scene& scene) {
  const auto memory =
      io::hold(context.budget().holder(), io::bytes_to_write_4dgs(scene), "the output as .4dgs");
  print_notes(context, io::write_4dgs(path, scene, check_interrupt));
}

}  // namespace l4d::cli

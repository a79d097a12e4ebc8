// SPDX-License-Identifier: Apache-2.0
#include "io/scene/statements.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>

#include "io/scene/rendering_text.h"

namespace l4d::io {
namespace {

const char* skip_blanks(const char* text) { return text + std::strspn(text, " \t"); }

// Parses one number and moves on; false if there is none.
bool parse_number(const char** text, double* value) {
  const char* begin = skip_blanks(*text);
  const auto result = std::from_chars(begin, begin + std::strlen(begin), *value);
  if (result.ec != std::errc() || !std::isfinite(*value)) return false;
  *text = result.ptr;
  return true;
}

// A decimal, which every reader knows, unless only the fraction gives the same rate back.
std::string frame_rate(const l4d_timeline& timeline) {
  const double fps = static_cast<double>(timeline.fps_num) / timeline.fps_den;
  if (fps >= 1e-6 && fps <= 1e6) {
    l4d_timeline back{};
    set_fps(back, fps);
    if (back.fps_num == timeline.fps_num && back.fps_den == timeline.fps_den)
      return text_of_number(fps);
  }
  return std::to_string(timeline.fps_num) + "/" + std::to_string(timeline.fps_den);
}

[[noreturn]] void corrupt(const std::string& message) { throw Error(L4D_ERR_CORRUPT, message); }

void read_words(const TextOf& text_of, l4d_placement* placement) {
  if (const char* text = text_of("l4d_coordinates")) {
    if (std::strcmp(text, "right_up_back") == 0) {
      placement->coordinate_system = L4D_COORDINATES_RIGHT_UP_BACK;
    } else if (std::strcmp(text, "right_down_forward") == 0) {
      placement->coordinate_system = L4D_COORDINATES_RIGHT_DOWN_FORWARD;
    } else {
      throw Error(L4D_ERR_FEATURE_UNSUPPORTED, "unknown l4d_coordinates");
    }
  }
  if (const char* text = text_of("l4d_color_space")) {
    if (std::strcmp(text, "linear_srgb") != 0 && std::strcmp(text, "srgb") != 0) {
      throw Error(L4D_ERR_FEATURE_UNSUPPORTED, "unknown l4d_color_space");
    }
    placement->color_space = *text == 'l' ? L4D_COLOR_LINEAR_SRGB : L4D_COLOR_SRGB;
  }
}

}  // namespace

std::string text_of_number(double value) {
  char text[40];
  return {text, std::to_chars(text, text + sizeof(text), value).ptr};
}

bool is_statement(const std::string& key) {
  static constexpr const char* kKeys[] = {
      "l4d_origin",       "l4d_scale", "l4d_coordinates", "l4d_color_space", "l4d_rendering",
      "l4d_presentation", "time_unit", "time_begin",      "time_end",        "fps"};
  return std::any_of(std::begin(kKeys), std::end(kKeys),
                     [&](const char* known) { return key == known; });
}

double stated_number(const TextOf& text_of, const std::string& key, double fallback) {
  const char* text = text_of(key);
  if (text == nullptr) return fallback;
  double value = 0;
  if (!parse_number(&text, &value) || *skip_blanks(text) != '\0') corrupt(key + " holds no number");
  return value;
}

void read_stated_fps(const TextOf& text_of, l4d_timeline* timeline) {
  const char* text = text_of("fps");
  const char* slash = text != nullptr ? std::strchr(text, '/') : nullptr;
  if (slash == nullptr) return set_fps(*timeline, stated_number(text_of, "fps", 30));
  const char* end = text + std::strlen(text);
  const auto num = std::from_chars(text, slash, timeline->fps_num);
  const auto den = std::from_chars(slash + 1, end, timeline->fps_den);
  if (num.ec != std::errc() || den.ec != std::errc() || num.ptr != slash || den.ptr != end ||
      timeline->fps_num == 0 || timeline->fps_den == 0) {
    corrupt("fps is not a frame rate");
  }
}

void read_stated_placement(const TextOf& text_of, Scene* scene) {
  l4d_placement& placement = scene->placement;
  if (const char* text = text_of("l4d_origin")) {
    for (double& value : placement.origin) {
      if (!parse_number(&text, &value)) corrupt("l4d_origin needs three numbers");
    }
  }
  placement.scale = stated_number(text_of, "l4d_scale", 1);
  if (!(placement.scale > 0)) corrupt("l4d_scale must be above 0");
  read_words(text_of, &placement);
  std::string key = "l4d_rendering";
  try {
    if (const char* text = text_of(key)) parse_rendering(text, &scene->rendering);
    key = "l4d_presentation";
    if (const char* text = text_of(key)) parse_presentation(text, &scene->presentation);
  } catch (const Error& error) {
    corrupt(key + ": " + error.what());
  }
}

std::vector<std::string> clock_statements(const l4d_timeline& timeline) {
  return {"time_unit seconds", "time_begin " + text_of_number(timeline.time_begin),
          "time_end " + text_of_number(timeline.time_begin + duration(timeline)),
          "fps " + frame_rate(timeline)};
}

std::vector<std::string> begin_statements(const l4d_timeline& timeline) {
  if (timeline.time_begin == 0) return {};
  return {"time_begin " + text_of_number(timeline.time_begin)};
}

void note_lost_statements(const std::string& format, const std::vector<std::string>& statements,
                          WriteNotes* notes) {
  if (statements.empty()) return;
  std::string list;
  for (const std::string& line : statements) list += (list.empty() ? "" : "; ") + line;
  notes->emplace(format + " has no place for what the scene states: " + list, 0);
}

std::vector<std::string> placement_statements(const l4d_placement& placement,
                                              const l4d_rendering& rendering,
                                              const l4d_presentation& presentation) {
  std::vector<std::string> lines;
  const double* o = placement.origin;
  if (o[0] != 0 || o[1] != 0 || o[2] != 0) {
    lines.push_back("l4d_origin " + text_of_number(o[0]) + " " + text_of_number(o[1]) + " " +
                    text_of_number(o[2]));
  }
  if (placement.scale != 1) lines.push_back("l4d_scale " + text_of_number(placement.scale));
  if (placement.coordinate_system == L4D_COORDINATES_RIGHT_UP_BACK) {
    lines.push_back("l4d_coordinates right_up_back");
  } else if (placement.coordinate_system == L4D_COORDINATES_RIGHT_DOWN_FORWARD) {
    lines.push_back("l4d_coordinates right_down_forward");
  }
  if (placement.color_space == L4D_COLOR_LINEAR_SRGB) {
    lines.push_back("l4d_color_space linear_srgb");
  }
  const std::string drawn = rendering_text(rendering), shown = presentation_text(presentation);
  if (!drawn.empty()) lines.push_back("l4d_rendering " + drawn);
  if (!shown.empty()) lines.push_back("l4d_presentation " + shown);
  return lines;
}

}  // namespace l4d::io

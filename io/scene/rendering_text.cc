// SPDX-License-Identifier: Apache-2.0
#include "io/scene/rendering_text.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <functional>
#include <utility>
#include <vector>

#include "io/scene/scene.h"
#include "libl4dcodec/scene/rendering.h"

namespace l4d::io {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180;
constexpr std::array<const char*, 4> kPlayback = {"unstated", "once", "loop", "ping-pong"};

// The shortest decimal that reads back as the same number, whatever the locale.
template <typename T>
std::string shortest(T value) {
  char text[40];
  return {text, std::to_chars(text, text + sizeof(text), value).ptr};
}

void append(const char* name, const std::string& value, std::string* text) {
  *text += (text->empty() ? "" : ",") + std::string(name) + "=" + value;
}

template <typename T>
T number_of(const std::string& text, const std::string& name) {
  T value{};
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || stop != end) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, name + ": '" + text + "' is no number");
  }
  return value;
}

std::vector<std::string> split(const std::string& text, char at) {
  std::vector<std::string> parts;
  for (size_t begin = 0; begin <= text.size();) {
    const size_t end = std::min(text.find(at, begin), text.size());
    parts.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return parts;
}

std::vector<double> numbers_of(const std::string& text, const std::string& name, size_t count) {
  std::vector<double> numbers;
  for (const std::string& part : split(text, ':')) numbers.push_back(number_of<double>(part, name));
  if (numbers.size() != count) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                name + ": " + std::to_string(count) + " numbers are needed, separated by ':'");
  }
  return numbers;
}

std::string join(const std::vector<double>& numbers) {
  std::string text;
  for (const double n : numbers) text += (text.empty() ? "" : ":") + shortest(n);
  return text;
}

// Calls set(name, value) for each "name=value" of the text; set returns whether it knows the name.
void for_assignments(const std::string& text, const char* names,
                     const std::function<bool(const std::string&, const std::string&)>& set) {
  std::vector<std::string> seen;
  for (const std::string& part : split(text, ',')) {
    const size_t equals = part.find('=');
    const std::string name = part.substr(0, equals);
    if (equals == std::string::npos || !set(name, part.substr(equals + 1))) {
      throw Error(L4D_ERR_INVALID_ARGUMENT,
                  "'" + part + "' is no NAME=VALUE, with NAME one of " + names);
    }
    if (std::find(seen.begin(), seen.end(), name) != seen.end()) {
      throw Error(L4D_ERR_INVALID_ARGUMENT, name + " is there twice");
    }
    seen.push_back(name);
  }
}

uint32_t playback_of(const std::string& text) {
  for (uint32_t id = L4D_PLAYBACK_ONCE; id < kPlayback.size(); ++id) {
    if (text == kPlayback[id]) return id;
  }
  throw Error(L4D_ERR_INVALID_ARGUMENT,
              "playback: '" + text + "' is none of once, loop, ping-pong");
}

}  // namespace

std::string rendering_text(const l4d_rendering& r) {
  const l4d_rendering usual = default_rendering();
  std::string text;
  const auto tell = [&](const char* name, float value, float default_value) {
    if (value != default_value) append(name, shortest(value), &text);
  };
  tell("dilation", r.dilation, usual.dilation);
  tell("cutoff", r.cutoff, usual.cutoff);
  tell("min_alpha", r.min_alpha, usual.min_alpha);
  tell("max_alpha", r.max_alpha, usual.max_alpha);
  if (r.compensation != 0) append("compensation", "1", &text);
  return text;
}

std::string presentation_text(const l4d_presentation& p) {
  std::string text;
  if (p.playback != L4D_PLAYBACK_UNSTATED && p.playback < kPlayback.size()) {
    append("playback", kPlayback[p.playback], &text);
  }
  if (p.has_bounds != 0) {
    const double *a = p.bounds_min, *b = p.bounds_max;
    append("bounds", join({a[0], a[1], a[2], b[0], b[1], b[2]}), &text);
  }
  if (p.has_camera != 0) {
    const double *a = p.camera_position, *b = p.camera_target, *c = p.camera_up;
    append("camera",
           join({a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2], p.camera_fov / kDegree}),
           &text);
  }
  if (p.metres_per_unit != 0) append("metres_per_unit", shortest(p.metres_per_unit), &text);
  return text;
}

void parse_rendering(const std::string& text, l4d_rendering* rendering) {
  l4d_rendering r = *rendering;
  const std::pair<const char*, float*> numbers[] = {{"dilation", &r.dilation},
                                                    {"cutoff", &r.cutoff},
                                                    {"min_alpha", &r.min_alpha},
                                                    {"max_alpha", &r.max_alpha}};
  for_assignments(text, "dilation, cutoff, min_alpha, max_alpha, compensation",
                  [&](const std::string& name, const std::string& value) {
                    for (const auto& [known, number] : numbers) {
                      if (name != known) continue;
                      *number = number_of<float>(value, name);
                      return true;
                    }
                    if (name != "compensation") return false;
                    r.compensation = number_of<uint32_t>(value, name);
                    return true;
                  });
  if (!is_valid(r)) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "'" + text +
                    "': dilation is in 0..16, cutoff 0 or in 1..16, min_alpha in 1/255..1/4, "
                    "max_alpha in 0.5..0.999, compensation 0 or 1");
  }
  *rendering = r;
}

void parse_presentation(const std::string& text, l4d_presentation* presentation) {
  l4d_presentation p = *presentation;
  for_assignments(text, "playback, bounds, camera, metres_per_unit",
                  [&](const std::string& name, const std::string& value) {
                    if (name == "playback") {
                      p.playback = playback_of(value);
                    } else if (name == "bounds") {
                      const std::vector<double> n = numbers_of(value, name, 6);
                      std::copy_n(n.data(), 3, p.bounds_min);
                      std::copy_n(n.data() + 3, 3, p.bounds_max);
                      p.has_bounds = 1;
                    } else if (name == "camera") {
                      const std::vector<double> n = numbers_of(value, name, 10);
                      std::copy_n(n.data(), 3, p.camera_position);
                      std::copy_n(n.data() + 3, 3, p.camera_target);
                      std::copy_n(n.data() + 6, 3, p.camera_up);
                      p.camera_fov = n[9] * kDegree;
                      p.has_camera = 1;
                    } else if (name == "metres_per_unit") {
                      p.metres_per_unit = number_of<double>(value, name);
                    } else {
                      return false;
                    }
                    return true;
                  });
  if (!is_valid(p)) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "'" + text +
                    "': bounds are finite and ordered, a camera looks at another point than its "
                    "own and not along its up direction, its field of view is in (0, 171) degrees, "
                    "and metres_per_unit is not negative");
  }
  *presentation = p;
}

}  // namespace l4d::io

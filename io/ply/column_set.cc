// SPDX-License-Identifier: Apache-2.0
#include "io/ply/column_set.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "io/ply/read_ply.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d::io {
namespace {

// Absolute map coordinates in float32 have lost what was below their steps before anyone reads
// them.
void note_coarse_positions(Scene& scene) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  double extent = 0;
  float far = 0;
  for (size_t k = 0; k < 3; ++k) {
    float low = kInfinity, high = -low;
    for (size_t i = k; i < scene.position.size(); i += 3) {
      if (!std::isfinite(scene.position[i])) continue;
      low = std::min(low, scene.position[i]);
      high = std::max(high, scene.position[i]);
    }
    if (!(low <= high)) return;
    extent = std::max(extent, static_cast<double>(high) - static_cast<double>(low));
    far = std::max({far, std::fabs(low), std::fabs(high)});
  }
  // Of points that fall together all of it may be lost.
  if (scene.count() < 2 || static_cast<double>(far) < 1000 * extent) return;
  if (extent == 0 && far < 1e6F) return;
  const double step = static_cast<double>(std::nextafter(far, kInfinity) - far);
  char text[200];
  std::snprintf(text, sizeof(text),
                "Coordinates around %.3g are float32, in steps of %.2g: `property double x` and so "
                "on would keep them.",
                static_cast<double>(far), step);
  scene.notes.push_back(text);
}

}  // namespace

ShColumns sh_columns_of(const PlyReader& reader, bool over_time) {
  size_t count = 0;
  for (const PlyProperty& property : reader.element().properties) {
    if (property.name.compare(0, 7, "f_rest_") == 0) ++count;
  }
  ShColumns sh;
  sh.rest = count / 3;
  for (uint32_t degree = 0; degree <= 4; ++degree) {
    const size_t coefficients = size_t{degree + 1} * (degree + 1);
    // Over time, each coefficient has harmonics of degree 0, then 1, then 2.
    const size_t times_each = over_time ? 3 : 1;
    for (size_t times = 1; times <= times_each; ++times) {
      if (count != 3 * (times * coefficients - 1)) continue;
      sh.degree = std::min(degree, 3U);
      if (times > 1) {
        sh.note = "Colours that change over time were not read but for the part that stays.";
      } else if (degree > 3) {
        sh.note = "Spherical harmonics of degree 4 were cut to degree 3.";
      }
      return sh;
    }
  }
  reader.fail(L4D_ERR_CORRUPT, std::to_string(count) +
                                   " f_rest properties belong to no degree of spherical harmonics");
}

// No layout has integers of 16 bits; some programs write binary16 under their names.
size_t ColumnSet::require(const std::string& property) {
  const size_t index = reader_.element().find(property);
  if (index == PlyElement::kNone) {
    reader_.fail(L4D_ERR_CORRUPT, "property " + property + " is missing");
  }
  const PlyType type = reader_.element().properties[index].type;
  if (type >= PlyType::kFloat16) return index;
  if (type != PlyType::kInt16 && type != PlyType::kUint16) {
    if (std::find(integers_.begin(), integers_.end(), property) == integers_.end()) {
      integers_.push_back(property);
    }
    return index;
  }
  if (reader_.header().format == PlyFormat::kAscii) {
    reader_.fail(L4D_ERR_FEATURE_UNSUPPORTED,
                 "property " + property + " is of a 16-bit integer type (short or ushort), which " +
                     "no layout of Gaussians has");
  }
  reader_.take_for_binary16(index);
  ++halves_;
  return index;
}

void ColumnSet::add(const std::string& property, float* to, size_t first, size_t stride) {
  PlyColumn column;
  column.property = require(property);
  column.to_float = to;
  column.first = first;
  column.stride = stride;
  columns_.push_back(column);
}

void ColumnSet::add_indexed(const std::string& name, size_t count, float* to, size_t stride) {
  for (size_t k = 0; k < count; ++k) add(name + "_" + std::to_string(k), to, k, stride);
}

void ColumnSet::add_sh(const ShColumns& sh) {
  const size_t coefficients = scene_.sh_coefficients();
  const size_t stride = coefficients * 3;
  const PlyElement& element = reader_.element();
  if (!element.has("f_dc_0") && element.has("red")) {
    static constexpr const char* kNames[3] = {"red", "green", "blue"};
    for (size_t k = 0; k < 3; ++k) {
      const size_t index = element.find(kNames[k]);
      if (index == PlyElement::kNone) {
        reader_.fail(L4D_ERR_CORRUPT, std::string("property ") + kNames[k] + " is missing");
      }
      color_type_ = element.properties[index].type;
      columns_.push_back({index, scene_.sh.data(), nullptr, k, stride});
    }
    has_colors_ = true;
  } else {
    add_indexed("f_dc", 3, scene_.sh.data(), stride);
  }
  for (size_t channel = 0; channel < 3; ++channel) {
    for (size_t k = 1; k < coefficients; ++k) {
      const size_t source = channel * sh.rest + (k - 1);
      add("f_rest_" + std::to_string(source), scene_.sh.data(), 3 * k + channel, stride);
    }
  }
  if (!sh.note.empty()) scene_.notes.push_back(sh.note);
}

void ColumnSet::add_position() {
  static constexpr const char* kNames[3] = {"x", "y", "z"};
  bool doubles = false;
  for (const char* name : kNames) {
    // 32-bit integers exceed float32 as well.
    const PlyType type = reader_.element().properties[require(name)].type;
    doubles |= type == PlyType::kFloat64 || type == PlyType::kInt32 || type == PlyType::kUint32;
  }
  if (!doubles) {
    for (size_t k = 0; k < 3; ++k) add(kNames[k], scene_.position.data(), k, 3);
    has_floats_ = true;
    return;
  }
  positions_.resize(scene_.count() * 3);
  for (size_t k = 0; k < 3; ++k) {
    PlyColumn column;
    column.property = require(kNames[k]);
    column.to_double = positions_.data();
    column.first = k;
    column.stride = 3;
    columns_.push_back(column);
  }
}

void ColumnSet::add_time(const std::string& property) {
  const PlyType type = reader_.element().properties[require(property)].type;
  if (type != PlyType::kFloat64 && type != PlyType::kInt32 && type != PlyType::kUint32) {
    return add(property, scene_.mean_t.data(), 0, 1);
  }
  times_.resize(scene_.count());
  PlyColumn column;
  column.property = require(property);
  column.to_double = times_.data();
  columns_.push_back(column);
}

void ColumnSet::read() {
  reader_.read_rows(columns_);
  leave_out_zeros();
  if (has_colors_) store_colors();
  if (!times_.empty()) scene_.set_mean_times(std::move(times_));
  if (has_floats_) note_coarse_positions(scene_);
  if (!positions_.empty()) {
    subtract_origin(positions_.data(), scene_.count(), &scene_.placement, scene_.position.data());
    positions_ = {};
  }
  if (halves_ > 0) {
    scene_.notes.push_back(std::to_string(halves_) +
                           " properties are of a 16-bit integer type; their bits are read as "
                           "binary16, which some programs write under that name.");
  }
  if (!integers_.empty()) {
    scene_.notes.push_back("Properties of an integer type, whose numbers are taken as they are: " +
                           list_of_names(integers_) + ".");
  }
  note_unread();
}

void ColumnSet::leave_out_zeros() {
  const auto is_zero = [&](size_t row) {
    return std::all_of(columns_.begin(), columns_.end(), [&](const PlyColumn& column) {
      const size_t at = column.first + row * column.stride;
      return column.to_float != nullptr ? column.to_float[at] == 0 : column.to_double[at] == 0;
    });
  };
  const size_t count = scene_.count();
  size_t kept = 0;
  for (size_t row = 0; row < count; ++row) {
    if (is_zero(row)) continue;
    for (const PlyColumn& column : columns_) {
      const size_t from = column.first + row * column.stride;
      const size_t to = column.first + kept * column.stride;
      if (column.to_float != nullptr) {
        column.to_float[to] = column.to_float[from];
      } else {
        column.to_double[to] = column.to_double[from];
      }
    }
    ++kept;
  }
  if (kept == count) return;
  scene_.resize(kept);
  if (!positions_.empty()) positions_.resize(3 * kept);
  if (!times_.empty()) times_.resize(kept);
  scene_.notes.push_back(zeros_note(count - kept, count));
}

// To coefficients of degree 0.
void ColumnSet::store_colors() {
  const size_t stride = scene_.sh_coefficients() * 3;
  double unit = color_type_ == PlyType::kUint8 ? 255 : 65535;
  if (color_type_ >= PlyType::kFloat16) {
    float most = 0;
    for (size_t i = 0; i < scene_.count(); ++i) {
      for (size_t k = 0; k < 3; ++k) most = std::max(most, scene_.sh[stride * i + k]);
    }
    unit = most > 1 ? 255 : 1;
  }
  for (size_t i = 0; i < scene_.count(); ++i) {
    for (size_t k = 0; k < 3; ++k) {
      float& c = scene_.sh[stride * i + k];
      c = static_cast<float>((static_cast<double>(c) / unit - 0.5) / sh_constant::k0);
    }
  }
  char text[120];
  std::snprintf(text, sizeof(text),
                "Colours are those of the properties red, green and blue, from 0 to %g.", unit);
  scene_.notes.push_back(text);
}

// Programs for Gaussians write normals out of habit, mostly zeros: a Gaussian has none.
bool is_normal(const std::string& name) { return name == "nx" || name == "ny" || name == "nz"; }

// Properties of the element that no column names, and elements besides it.
void ColumnSet::note_unread() {
  const std::vector<PlyProperty>& properties = reader_.element().properties;
  std::vector<char> is_read(properties.size(), 0);
  for (const PlyColumn& column : columns_) is_read[column.property] = 1;
  std::vector<std::string> unread;
  for (size_t k = 0; k < properties.size(); ++k) {
    if (is_read[k] == 0 && !is_normal(properties[k].name)) unread.push_back(properties[k].name);
  }
  if (scene_.source != "l4d_ply") refuse_unread_time(reader_, unread);
  if (!unread.empty()) {
    scene_.notes.push_back(std::to_string(unread.size()) + " of " +
                           std::to_string(properties.size()) +
                           " properties were not read: " + list_of_names(unread) + ".");
  }
  std::vector<std::string> elements;
  for (const PlyElement& element : reader_.header().elements) {
    if (&element == &reader_.element()) continue;
    elements.push_back(element.name + " (" + std::to_string(element.count) + " rows)");
  }
  if (elements.empty()) return;
  scene_.notes.push_back("Elements that were not read: " + list_of_names(elements) + ".");
}

}  // namespace l4d::io

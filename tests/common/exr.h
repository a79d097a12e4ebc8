// SPDX-License-Identifier: Apache-2.0
// OpenEXR files of tests, byte by byte: an oracle of its own.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

namespace l4d::test {

struct ExrForm {
  uint32_t width = 1, height = 1;
  // Names, in their order, and halves, [height, width].
  std::vector<std::pair<std::string, std::vector<uint16_t>>> channels;
  uint32_t tile = 0;                                      // pixels a side; 0: rows
  std::vector<std::pair<std::string, std::string>> more;  // attributes whose name is their type
  // What the file says, and is not so.
  uint32_t flags = 0, type_of_first = 1, type_of_last = 1, sampling = 1;
  uint32_t claimed_width = 0, display_width = 0, left = 0;
  uint8_t compression = 0, tile_mode = 0;
};

template <typename T>
void put_exr(std::string* to, T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof bytes);  // little-endian, as machines that run tests are
  to->append(bytes, sizeof bytes);
}

inline void put_attribute(std::string* to, const std::string& name, const std::string& type,
                          const std::string& value) {
  *to += name + '\0' + type + '\0';
  put_exr(to, static_cast<uint32_t>(value.size()));
  *to += value;
}

inline std::string exr_window(uint32_t left, uint32_t width, uint32_t height) {
  std::string value;
  for (const uint32_t side : {left, 0U, left + width - 1, height - 1}) put_exr(&value, side);
  return value;
}

inline std::string exr_header(const ExrForm& form) {
  std::string out = "\x76\x2f\x31\x01";
  put_exr(&out, 2 | form.flags | (form.tile > 0 ? 0x200U : 0U));
  std::string channels, tiles;
  for (const auto& [name, values] : form.channels) {
    channels += name + '\0';
    const bool is_first = name == form.channels.front().first;
    const bool is_last = name == form.channels.back().first;
    put_exr(&channels, is_first ? form.type_of_first : is_last ? form.type_of_last : 1U);
    for (const uint32_t word : {0U, form.sampling, form.sampling}) put_exr(&channels, word);
  }
  put_attribute(&out, "channels", "chlist", channels + '\0');
  for (const auto& [name, value] : form.more) put_attribute(&out, name, name, value);
  put_attribute(&out, "compression", "compression", {static_cast<char>(form.compression)});
  const uint32_t width = form.claimed_width > 0 ? form.claimed_width : form.width;
  put_attribute(&out, "dataWindow", "box2i", exr_window(form.left, width, form.height));
  put_attribute(
      &out, "displayWindow", "box2i",
      exr_window(form.left, form.display_width > 0 ? form.display_width : width, form.height));
  put_attribute(&out, "lineOrder", "lineOrder", {'\0'});
  std::string one;
  put_exr(&one, 1.0F);
  put_attribute(&out, "pixelAspectRatio", "float", one);
  put_attribute(&out, "screenWindowCenter", "v2f", std::string(8, '\0'));
  put_attribute(&out, "screenWindowWidth", "float", one);
  if (form.tile > 0) {
    for (int k = 0; k < 2; ++k) put_exr(&tiles, form.tile);
    put_attribute(&out, "tiles", "tiledesc", tiles + static_cast<char>(form.tile_mode));
  }
  return out + '\0';
}

inline std::string exr_of(const ExrForm& form) {
  const std::string header = exr_header(form);
  const uint32_t across = form.tile > 0 ? form.tile : form.width;
  const uint32_t down = form.tile > 0 ? form.tile : 1;
  std::vector<std::string> blocks;
  for (uint32_t top = 0; top < form.height; top += down) {
    for (uint32_t left = 0; left < form.width; left += across) {
      std::string block, values;
      if (form.tile > 0) {
        for (const uint32_t word : {left / across, top / down, 0U, 0U}) put_exr(&block, word);
      } else {
        put_exr(&block, top);
      }
      for (uint32_t y = top; y < std::min(top + down, form.height); ++y) {
        for (const auto& channel : form.channels) {
          for (uint32_t x = left; x < std::min(left + across, form.width); ++x) {
            put_exr(&values, channel.second.at(y * form.width + x));
          }
        }
      }
      put_exr(&block, static_cast<uint32_t>(values.size()));
      blocks.push_back(block + values);
    }
  }
  std::string table, all;
  for (const std::string& block : blocks) {
    put_exr(&table, static_cast<uint64_t>(header.size() + 8 * blocks.size() + all.size()));
    all += block;
  }
  return header + table + all;
}

// 3 x 2 pixels.
inline ExrForm small_exr() {
  ExrForm form;
  form.width = 3;
  form.height = 2;
  form.channels = {{"A", {0x3c00, 0x3c00, 0x3800, 0x3c00, 0x3400, 0x3c00}},
                   {"B", {0x3400, 0x3000, 0x3000, 0x0000, 0x2c00, 0x3800}},
                   {"G", {0x3800, 0x3a00, 0x3400, 0x3c00, 0x3000, 0x2400}},
                   {"R", {0x3c00, 0x2800, 0x3600, 0x3400, 0x3200, 0x3000}}};
  return form;
}

// Those of sRGB, but for red and white.
inline std::string primaries(float red, float white) {
  std::string value;
  for (const float v : {red, 0.33F, 0.30F, 0.60F, 0.15F, 0.06F, white, 0.3290F}) put_exr(&value, v);
  return value;
}

}  // namespace l4d::test

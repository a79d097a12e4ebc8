// SPDX-License-Identifier: Apache-2.0
#include "cli/arrays.h"

#include <xxhash.h>

#include <algorithm>
#include <cstring>
#include <numeric>

#include "cli/text/units.h"
#include "io/file/file.h"

namespace l4d::cli {
namespace {

bool host_is_little_endian() {
  const uint16_t one = 1;
  unsigned char first = 0;
  std::memcpy(&first, &one, 1);
  return first == 1;
}

// Appends eight bytes, least significant first.
void append(std::vector<unsigned char>& to, uint64_t value) {
  for (unsigned k = 0; k < 8; ++k) to.push_back(static_cast<unsigned char>(value >> 8 * k));
}

std::string hex(uint64_t digest) {
  return format("%016llx", static_cast<unsigned long long>(digest));
}

std::string shape_text(const std::vector<uint64_t>& shape) {
  std::string text;
  for (const uint64_t n : shape) text += (text.empty() ? "[" : ", ") + std::to_string(n);
  return text + "]";
}

}  // namespace

void Array::make_little_endian() {
  const size_t width = element_bytes();
  if (host_is_little_endian() || width == 1) return;
  const size_t bytes = num_bytes();
  for (size_t at = 0; at < bytes; at += width) std::reverse(data + at, data + at + width);
}

size_t Array::element_bytes() const {
  return type == "u8" ? 1 : type == "u16" ? 2 : type == "f32" || type == "u32" ? 4 : 8;
}

uint64_t Array::num_elements() const {
  return std::accumulate(shape.begin(), shape.end(), uint64_t{1},
                         [](uint64_t a, uint64_t b) { return a * b; });
}

Arrays arrays_of(SplatArrays&& splats) {
  Arrays out;
  out.form = "slice";
  out.count = splats.count();
  const auto add = [&](const char* name, std::vector<uint64_t> shape, std::vector<float>& values) {
    const auto owner = std::make_shared<std::vector<float>>(std::move(values));
    out.arrays.push_back(
        {name, "f32", std::move(shape), owner, reinterpret_cast<unsigned char*>(owner->data())});
    out.arrays.back().make_little_endian();
  };
  const uint64_t coefficients = uint64_t{splats.sh_degree + 1} * (splats.sh_degree + 1);
  add("position", {out.count, 3}, splats.position);
  add("covariance", {out.count, 6}, splats.covariance);
  add("opacity", {out.count}, splats.opacity);
  add("sh", {out.count, coefficients, 3}, splats.sh);
  return out;
}

Digests::Digests(const Arrays& arrays) : form_(arrays.form), count_(arrays.count) {
  std::vector<unsigned char> list;
  append(list, arrays.count);
  for (const Array& array : arrays.arrays) {
    digests_.push_back(XXH3_64bits(array.data, array.num_bytes()));
    append(list, digests_.back());
    arrays_.push_back({array.name, array.type, array.shape, nullptr, nullptr});
  }
  all_ = XXH3_64bits(list.data(), list.size());
}

Json Digests::json() const {
  Json list = Json::array();
  for (size_t k = 0; k < arrays_.size(); ++k) {
    list.push_back({{"name", arrays_[k].name},
                    {"type", arrays_[k].type},
                    {"shape", arrays_[k].shape},
                    {"digest", hex(digests_[k])}});
  }
  return {{"form", form_}, {"num_gaussians", count_}, {"all", hex(all_)}, {"arrays", list}};
}

std::string Digests::text() const {
  std::string text;
  for (size_t k = 0; k < arrays_.size(); ++k) {
    text += hex(digests_[k]) + "  " + arrays_[k].name + " " + arrays_[k].type + " " +
            shape_text(arrays_[k].shape) + "\n";
  }
  return text + hex(all_) + "  all " + std::to_string(count_) + "\n";
}

void write_raw(const std::string& path, const Arrays& arrays, const l4d_info& info) {
  // Larger elements first, so that each array is aligned to its elements.
  std::vector<const Array*> order;
  for (const Array& array : arrays.arrays) order.push_back(&array);
  std::stable_sort(order.begin(), order.end(), [](const Array* a, const Array* b) {
    return a->element_bytes() > b->element_bytes();
  });
  const auto upper = [](std::string type) {
    type[0] = static_cast<char>(type[0] - 'a' + 'A');
    return type;
  };
  Json header = Json::object();
  header["__metadata__"] = {{"schema", "l4dcodec.raw/1"},
                            {"form", arrays.form},
                            {"byte_order", "little"},
                            {"num_gaussians", std::to_string(arrays.count)},
                            {"sh_degree", std::to_string(info.sh_degree)},
                            {"flags", std::to_string(info.flags)}};
  uint64_t offset = 0;
  for (const Array* array : order) {
    const uint64_t end = offset + array->num_bytes();
    Json place = Json::array();
    place.push_back(offset);
    place.push_back(end);
    header[array->name] = {
        {"dtype", upper(array->type)}, {"shape", array->shape}, {"data_offsets", place}};
    offset = end;
  }
  std::string text = header.dump();
  text.resize((text.size() + 7) / 8 * 8, ' ');
  std::vector<unsigned char> length;
  append(length, text.size());
  io::OutputFile file(path);
  file.write(length.data(), length.size());
  file.write(text.data(), text.size());
  for (const Array* array : order) file.write(array->data, array->num_bytes());
  file.commit();
}

}  // namespace l4d::cli

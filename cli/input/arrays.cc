// SPDX-License-Identifier: Apache-2.0
#include "cli/input/arrays.h"

#include <xxhash.h>

#include <utility>

#include "cli/text/units.h"

namespace l4d::cli {
namespace {

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

Arrays arrays_of(SplatArrays&& splats) {
  Arrays out;
  out.form = "slice";
  out.count = splats.count();
  const auto add = [&](const char* name, std::vector<uint64_t> shape, std::vector<float>& values) {
    out.arrays.push_back(io::raw_array(name, std::move(shape), std::move(values)));
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
  for (const io::RawArray& array : arrays.arrays) {
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

void write_raw(const std::string& path, const Arrays& arrays, const DecoderHandle& decoder) {
  const l4d_info info = decoder.info();
  io::write_raw(path,
                {arrays.form, arrays.count, info.sh_degree, info.flags, info.timeline,
                 info.placement, decoder.rendering(), decoder.presentation()},
                arrays.arrays);
}

}  // namespace l4d::cli

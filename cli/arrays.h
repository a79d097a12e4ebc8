// SPDX-License-Identifier: Apache-2.0
// Arrays exactly as decoded, their digests (appendix F of the specification), and the file of
// `decode --format raw`.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "cli/common.h"

namespace l4d::cli {

// The little-endian numbers of an array, rows one after the other.
struct Array {
  std::string name;
  std::string type;  // f32, f64, u8, u16, u32, u64
  std::vector<uint64_t> shape;
  std::shared_ptr<void> owner;  // of `data`
  unsigned char* data = nullptr;

  size_t element_bytes() const;
  uint64_t num_elements() const;
  // From host order, in place.
  void make_little_endian();
  size_t num_bytes() const { return static_cast<size_t>(num_elements()) * element_bytes(); }
};

// What a query gives, in the order in which appendix F lists the arrays.
struct Arrays {
  std::string form;    // "attributes", "packed", "slice"
  uint64_t count = 0;  // Gaussians
  std::vector<Array> arrays;
  std::shared_ptr<void> memory;  // what they are counted as
};

// Every attribute of what the query selects.
Arrays decode_attributes(Context& context, const DecoderHandle& decoder, const l4d_query& query);
// The same Gaussians in packed form. Throws where the stream has none.
Arrays decode_packed(Context& context, const DecoderHandle& decoder, const l4d_query& query);
// Takes the arrays of a slice.
Arrays arrays_of(SplatArrays&& splats);

// XXH3-64 of each array, and of them all.
struct Digests {
  explicit Digests(const Arrays& arrays);
  Json json() const;
  // A line per array and one for all: digest, name, type, shape.
  std::string text() const;

 private:
  std::string form_;
  uint64_t count_ = 0;
  uint64_t all_ = 0;
  std::vector<uint64_t> digests_;
  std::vector<Array> arrays_;  // without their data
};

// Writes the arrays in the layout of docs/formats.md, "Raw arrays".
void write_raw(const std::string& path, const Arrays& arrays, const l4d_info& info);

}  // namespace l4d::cli

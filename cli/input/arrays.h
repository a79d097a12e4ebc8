// SPDX-License-Identifier: Apache-2.0
// Arrays exactly as decoded, and their digests (appendix F of the specification).
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "cli/command/context.h"
#include "io/formats/raw_arrays.h"

namespace l4d::cli {

// What a query gives, in the order in which appendix F lists the arrays.
struct Arrays {
  std::string form;    // "attributes", "packed", "slice"
  uint64_t count = 0;  // Gaussians
  std::vector<io::RawArray> arrays;
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
  std::vector<io::RawArray> arrays_;  // without their data
};

// Writes the arrays of a stream.
void write_raw(const std::string& path, const Arrays& arrays, const DecoderHandle& decoder);

}  // namespace l4d::cli

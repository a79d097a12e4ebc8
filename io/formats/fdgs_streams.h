// SPDX-License-Identifier: Apache-2.0
// Fields and attribute streams of .4dgs.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace l4d::io::fdgs {

using Texts = std::map<std::string, std::string>;

// Reads fields one after the other. Throws Error(L4D_ERR_CORRUPT), whose message begins with
// `name`, where there are fewer bytes than are asked for.
class Fields {
 public:
  Fields(const uint8_t* data, uint64_t size, std::string name)
      : at_(data), left_(size), name_(std::move(name)) {}

  uint64_t left() const { return left_; }
  const std::string& name() const { return name_; }
  const uint8_t* bytes(uint64_t size);
  uint8_t u8() { return *bytes(1); }
  uint32_t u32();
  uint64_t u64();
  double f64();
  std::string text();
  Texts texts();
  [[noreturn]] void fail(const std::string& message) const;

 private:
  const uint8_t* at_;
  uint64_t left_;
  std::string name_;
};

// An attribute stream before it is expanded.
struct PackedStream {
  uint8_t attribute = 0, width = 0, mode = 0, codec = 0, channels = 0;
  uint32_t count = 0;
  const uint8_t* payload = nullptr;
  uint64_t bytes = 0;  // of it
};
PackedStream next_stream(Fields* fields);

// The integers of an attribute. One row stands for all where it is constant, whatever the count.
struct Bins {
  size_t channels = 0;
  bool is_constant = false;
  std::vector<int32_t> values;

  int32_t at(size_t i, size_t k = 0) const { return values[(is_constant ? 0 : i * channels) + k]; }
};
// `name` begins messages. Takes memory for what the payload has, not for what it promises.
Bins expand_stream(const PackedStream& stream, const std::string& name);

// values: [count, channels]. The smaller of plain and delta coding, deflated.
std::vector<uint8_t> pack_stream(uint8_t attribute, uint8_t channels,
                                 const std::vector<int32_t>& values);

}  // namespace l4d::io::fdgs

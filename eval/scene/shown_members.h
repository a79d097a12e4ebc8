// SPDX-License-Identifier: Apache-2.0
// A file of several streams as one scene: at each instant the media member and those that it needs.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "io/file/memory.h"
#include "l4d/l4d.hpp"

namespace l4d::eval {

class ShownMembers {
 public:
  // reader: must stay as long as this object. options: of one decoder; decoders that are open at a
  // time share max_memory_bytes. Throws Error where the file has no media member.
  ShownMembers(const l4d_reader& reader, const l4d_decoder_options& options);

  // From the first span to the last, in frames of the first media member.
  const l4d_timeline& timeline() const { return timeline_; }
  // Of members other than indices, together; of those whose headers are damaged nothing is known.
  uint64_t num_gaussians();
  // The first media member whose headers are whole.
  const DecoderHandle& first();

  struct Shown {
    DecoderHandle* decoder;
    uint32_t index;
    double shift;     // time of the presentation less time of the stream
    double time;      // of the stream
    uint64_t offset;  // of the member in the file
  };
  // Opens what shows the instant. What was shown before stays open until close_others(). Members
  // whose headers are damaged are left out if the options are tolerant; else show() throws an
  // Error.
  const std::vector<Shown>& show(double seconds);
  // What was left out so far: which member, and why. By index.
  const std::map<uint32_t, std::string>& left_out() const { return left_out_; }
  const std::vector<Shown>& shown() const { return shown_; }
  // The time of the presentation that is shown: the one asked for, or the nearest of a span.
  double time() const { return time_; }
  void close_others();
  // Of all decoders so far, those that are closed included.
  l4d_counters counters() const;

  SplatArrays slice(double seconds, const l4d_operating_point& point = {});
  uint64_t slice_bytes(double seconds);

 private:
  DecoderHandle& open(uint32_t index);
  // Calls body(). Errors name the member, and their offsets count from its first byte.
  template <typename Body>
  auto of_member(uint32_t index, const Body& body) const;
  void choose_first(uint64_t count);

  l4d_decoder_options options_;
  MembersHandle list_;
  l4d_timeline timeline_{};
  uint32_t first_ = 0;                      // index of the first media member
  std::map<uint32_t, DecoderHandle> open_;  // by index
  l4d_counters closed_{};                   // sums
  double time_ = 0;
  std::vector<Shown> shown_;
  std::vector<uint32_t> shown_indices_;
  std::map<uint32_t, std::string> left_out_;
};

}  // namespace l4d::eval

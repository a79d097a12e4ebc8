// SPDX-License-Identifier: Apache-2.0
// What `slice` shows: a scene, or all streams of a file of several.
#pragma once

#include <memory>

#include "cli/input/tolerant.h"
#include "eval/scene/shown_members.h"

namespace l4d::cli {

class ShownScene {
 public:
  ShownScene(Context& context, const Input& input, const ImportArguments& arguments, bool tolerant);

  l4d_timeline timeline() const;
  l4d_placement placement() const;
  l4d_rendering rendering() const;
  l4d_presentation presentation() const;

  uint64_t slice_bytes(double seconds) const;
  // point: how much of the streams is shown. Adds what was lost to `losses`.
  SplatArrays slice(double seconds, const l4d_operating_point& point, LossReport* losses);

  // Whether the last slice shows another instant than was asked for, since no stream has that one.
  bool has_moved() const { return has_moved_; }

  // Of all decoders so far.
  uint64_t buckets_decoded() const;
  uint64_t cache_hits() const;

 private:
  const DecoderHandle& first() const;
  l4d_counters counters() const;

  Context& context_;
  std::string name_;
  std::unique_ptr<TolerantStream> stream_;
  std::unique_ptr<FileReader> reader_;
  std::unique_ptr<eval::ShownMembers> members_;
  bool has_moved_ = false;
};

}  // namespace l4d::cli

// SPDX-License-Identifier: Apache-2.0
// An open stream, and what every query of it needs: its headers and directory, the decoder of its
// pages, the losses of the query at hand.
#pragma once

#include <memory>

#include "decoder/expand/page_decoder.h"
#include "decoder/read/losses.h"
#include "decoder/read/plan.h"
#include "decoder/read/scene_file.h"
#include "l4d/decode.h"
#include "libl4dcodec/base/file_reader.h"

namespace l4d {

class OpenStream {
 public:
  // An option that is 0 takes its default.
  explicit OpenStream(const l4d_decoder_options& options);

  Status open(ByteSource source);
  Status open_file(const char* path);
  void close();
  bool is_open() const { return pages_ != nullptr; }
  SceneFile& file() { return *file_; }
  const SceneFile& file() const { return *file_; }
  PageDecoder& pages() { return *pages_; }
  const PageDecoder& pages() const { return *pages_; }

  const l4d_decoder_options& options() const { return options_; }
  // Streams that are opened from now on share a budget, which outlives them.
  void share_memory(MemoryBudget* of_all) { shared_memory_ = of_all; }
  int threads() const { return static_cast<int>(options_.threads); }
  void set_progress(l4d_progress_fn fn, void* user) {
    progress_ = fn;
    progress_user_ = user;
  }
  PageDecoder::Progress progress(const char* stage) const;

  // Forgets the losses of the query before, and drops caches that have become too large.
  void begin_query();
  Status plan(const l4d_query& query, Plan* plan);
  Losses& losses() { return losses_; }
  const Losses& losses() const { return losses_; }
  bool is_tolerant() const { return options_.tolerant != 0; }
  // Where losses go; null where the first one fails the query.
  Losses* losses_if_tolerant() { return is_tolerant() ? &losses_ : nullptr; }
  LostPages* if_tolerant(LostPages* lost) const { return is_tolerant() ? lost : nullptr; }

 private:
  Status start(ByteSource source);

  l4d_decoder_options options_;
  DecodeKernels kernels_;
  MemoryBudget* shared_memory_ = nullptr;
  std::unique_ptr<FileReader> own_file_;
  std::unique_ptr<SceneFile> file_;
  std::unique_ptr<PageDecoder> pages_;
  l4d_progress_fn progress_ = nullptr;
  void* progress_user_ = nullptr;
  Losses losses_;
};

}  // namespace l4d

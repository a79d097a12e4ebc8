// SPDX-License-Identifier: Apache-2.0
// What an l4d_decoder handle is: an open stream, its queries and its slices.
#pragma once

#include <utility>
#include <vector>

#include "decoder/session/open_stream.h"
#include "decoder/session/slicer.h"
#include "l4d/decode.h"
#include "l4d/experimental/packed.h"

namespace l4d {

class Decoder {
 public:
  explicit Decoder(const l4d_decoder_options& options) : stream_(options), slicer_(stream_) {}

  Status open(ByteSource source);
  Status open_file(const char* path);
  void close();
  bool is_open() const { return stream_.is_open(); }
  SceneFile& file() { return stream_.file(); }
  const SceneFile& file() const { return stream_.file(); }
  PageDecoder& pages() { return stream_.pages(); }
  int threads() const { return stream_.threads(); }
  OpenStream& stream() { return stream_; }
  Slicer& slicer() { return slicer_; }

  Status decode(const l4d_query& query, l4d_gaussian_buffers* out);
  Status decode_packed(const l4d_query& query, l4d_packed_buffers* out);
  void counters(l4d_counters* out) const;
  const std::vector<l4d_loss>& losses() const { return stream_.losses().query(); }

 private:
  OpenStream stream_;
  Slicer slicer_;
  uint64_t buckets_decoded_ = 0;  // by queries
};

}  // namespace l4d

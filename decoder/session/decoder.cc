// SPDX-License-Identifier: Apache-2.0
#include "decoder/session/decoder.h"

#include "decoder/session/query.h"
#include "l4d/experimental/packed.h"

namespace l4d {

void Decoder::close() {
  slicer_.close();
  buckets_decoded_ = 0;
  stream_.close();
}

Status Decoder::open(ByteSource source) {
  close();
  return stream_.open(std::move(source));
}

Status Decoder::open_file(const char* path) {
  close();
  return stream_.open_file(path);
}

Status Decoder::decode(const l4d_query& query, l4d_gaussian_buffers* out) {
  uint64_t buckets = 0;
  L4D_RETURN_IF_ERROR(decode_query(stream_, query, out, &buckets));
  buckets_decoded_ += buckets;
  return {};
}

Status Decoder::decode_packed(const l4d_query& query, l4d_packed_buffers* out) {
  uint64_t buckets = 0;
  L4D_RETURN_IF_ERROR(decode_query_packed(stream_, query, out, &buckets));
  buckets_decoded_ += buckets;
  return {};
}

void Decoder::counters(l4d_counters* out) const {
  const SceneFile& file = stream_.file();
  out->reads = file.source().reads();
  out->bytes_read = file.source().bytes_read();
  out->pages_decoded = stream_.pages().pages_decoded();
  out->buckets_decoded = buckets_decoded_ + slicer_.cache().buckets_decoded();
  out->cache_hits = slicer_.cache().hits();
  out->memory_bytes = file.memory().used();
  out->peak_memory_bytes = file.memory().peak();
  const Losses& losses = stream_.losses();
  out->pages_lost = losses.pages();
  out->buckets_lost = losses.buckets();
  out->gaussians_lost = losses.gaussians();
  out->details_lost = losses.details();
}

}  // namespace l4d

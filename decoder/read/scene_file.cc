// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/scene_file.h"

#include <algorithm>
#include <string>

#include "libl4dcodec/base/hash.h"

namespace l4d {

SceneFile::SceneFile(ByteSource source, const l4d_decoder_options& limits,
                     const StreamKernels& kernels)
    : limits_(limits),
      reader_(std::move(source), limits.max_memory_bytes, kernels),
      directory_(reader_, header_),
      codebooks_(reader_, header_) {}

Status SceneFile::open() {
  Bytes storage;
  ByteSpan bytes;
  const uint64_t size = reader_.source().size();
  reader_.source().fetch({{0, std::min(size, reader_.source().block_bytes())}}, FetchedFor::kStream,
                         reader_.memory());
  const uint64_t head = std::min<uint64_t>(size, FileHeader::kBytes);
  L4D_RETURN_IF_ERROR(reader_.source().read(0, head, storage, &bytes));
  L4D_RETURN_IF_ERROR(FileHeader::parse(bytes, &file_header_));
  MemoryCharge charge(reader_.memory());
  L4D_RETURN_IF_ERROR(charge.take(file_header_.header_bytes, "the scene header"));
  L4D_RETURN_IF_ERROR(reader_.source().read(file_header_.header_offset, file_header_.header_bytes,
                                            storage, &bytes));
  if (hash64(bytes) != file_header_.header_hash) {
    return reader_.source().after_check(Status(L4D_ERR_CHECKSUM, "FILE-6",
                                               file_header_.header_offset,
                                               "checksum of the scene header does not match"));
  }
  L4D_RETURN_IF_ERROR(parse_scene_header(bytes, file_header_.header_offset, &header_));
  if (header_.needs_members && limits_.accept_needs == 0) {
    return Status(L4D_ERR_FEATURE_UNSUPPORTED, "HEAD-8", file_header_.header_offset,
                  "a member that needs others");
  }
  if (header_.file_bytes > 0) reader_.source().limit(header_.file_bytes);
  if (header_.num_gaussians > limits_.max_gaussians) {
    return Status(L4D_ERR_LIMIT_EXCEEDED, std::to_string(header_.num_gaussians) +
                                              " Gaussians; the limit is " +
                                              std::to_string(limits_.max_gaussians));
  }
  if (header_.timeline.num_frames > limits_.max_frames) {
    return Status(L4D_ERR_LIMIT_EXCEEDED, std::to_string(header_.timeline.num_frames) +
                                              " frames; the limit is " +
                                              std::to_string(limits_.max_frames));
  }
  charge.keep();
  return {};
}

void SceneFile::begin_query() {
  reader_.source().begin_query();
  trim();
  retry();
}

void SceneFile::trim() {
  directory_.trim();
  codebooks_.trim();
}

uint64_t SceneFile::codebook_stored_bytes(uint32_t layer) const {
  uint64_t bytes = 0;
  for (const ComponentCoding& c : header_.layers[layer].component) {
    for (size_t s = 0; s < c.num_codebooks(); ++s) bytes += c.codebook(s).codebook.stored_bytes;
    if (c.has_rcq) bytes += c.rcq.codebook.stored_bytes;
  }
  return bytes;
}

}  // namespace l4d

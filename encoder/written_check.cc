// SPDX-License-Identifier: Apache-2.0
#include "encoder/written_check.h"

#include <algorithm>
#include <limits>
#include <string>

#include "decoder/read/scene_file.h"
#include "libl4dcodec/scene/layers.h"

namespace l4d {
namespace {

// A reader over bytes that lie in pieces.
class Pieces {
 public:
  explicit Pieces(const std::vector<Bytes>& chunks) : chunks_(chunks) {
    for (const Bytes& c : chunks) {
      begin_.push_back(size_);
      size_ += c.size();
    }
  }

  l4d_reader reader() {
    l4d_reader r{};
    r.struct_size = sizeof r;
    r.user = this;
    r.size = [](void* user) { return static_cast<int64_t>(static_cast<Pieces*>(user)->size_); };
    r.read_at = [](void* user, void* to, size_t n, uint64_t offset) {
      return static_cast<Pieces*>(user)->read(static_cast<uint8_t*>(to), n, offset);
    };
    return r;
  }

 private:
  int64_t read(uint8_t* to, size_t n, uint64_t offset) const {
    size_t c = static_cast<size_t>(std::upper_bound(begin_.begin(), begin_.end(), offset) -
                                   begin_.begin()) -
               1;
    size_t done = 0;
    for (; done < n && c < chunks_.size(); ++c) {
      const size_t from = static_cast<size_t>(offset + done - begin_[c]);
      const size_t part = std::min(n - done, chunks_[c].size() - from);
      std::copy_n(chunks_[c].data() + from, part, to + done);
      done += part;
    }
    return static_cast<int64_t>(done);
  }

  const std::vector<Bytes>& chunks_;
  std::vector<uint64_t> begin_;
  uint64_t size_ = 0;
};

Status read_codebooks(SceneFile& file, const ComponentCoding& coding, uint32_t layer, unsigned c) {
  const CodebookData* codebook = nullptr;
  for (unsigned s = 0; s < coding.num_codebooks(); ++s) {
    L4D_RETURN_IF_ERROR(file.codebooks().codebook(layer, c, s, &codebook));
  }
  if (!coding.has_rcq) return {};
  return file.codebooks().codebook(layer, c, CodebookCache::kRcqStage, &codebook);
}

Status read_layer(SceneFile& file, uint32_t l) {
  const LayerHeader& layer = file.header().layers[l];
  for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
    L4D_RETURN_IF_ERROR(read_codebooks(file, layer.component[c], l, c));
  }
  if (layer.num_gaussians == 0) return {};
  const EntropyTables* tables = nullptr;
  if (layer.has_entropy) L4D_RETURN_IF_ERROR(file.codebooks().entropy_tables(l, &tables));
  uint64_t total = 0;
  for (uint32_t d = 0; d < num_directory_pages(layer); ++d) {
    DirectoryPageRef read;
    L4D_RETURN_IF_ERROR(file.directory().page(l, d, &read));
    for (const PageRecord& record : read->page.pages) {
      total += record.num_gaussians;
      for (const ChunkRef* chunk : {&record.chunk, &record.sh_detail}) {
        if (chunk->offset + chunk->stored_bytes > file.source().size()) {
          return corrupt("CHNK-1", chunk->offset, "a page reaches beyond the file");
        }
      }
    }
    file.trim();
  }
  return total == layer.num_gaussians
             ? Status()
             : corrupt("DIR-5", layer.page_table_offset,
                       "layer " + std::to_string(l) + " holds " + std::to_string(total) +
                           " Gaussians, its header says " + std::to_string(layer.num_gaussians));
}

Status read_all(Pieces& pieces) {
  ByteSource source;
  L4D_RETURN_IF_ERROR(ByteSource::from_reader(pieces.reader(), &source));
  l4d_decoder_options limits{};
  limits.max_memory_bytes = std::numeric_limits<uint64_t>::max();
  limits.max_gaussians = std::numeric_limits<uint64_t>::max();
  limits.max_frames = kMaxFrames;
  SceneFile file(std::move(source), limits, stream_kernels_simd());
  L4D_RETURN_IF_ERROR(file.open());
  L4D_RETURN_IF_ERROR(read_codebooks(file, file.header().sh, 0, L4D_COMPONENT_SH));
  for (uint32_t l = 0; l < file.header().layers.size(); ++l) {
    L4D_RETURN_IF_ERROR(read_layer(file, l));
  }
  return {};
}

}  // namespace

Status check_written(const std::vector<Bytes>& chunks) {
  Pieces pieces(chunks);
  const Status status = read_all(pieces);
  if (status.ok() || status.code() == L4D_ERR_OUT_OF_MEMORY) return status;
  return Status(L4D_ERR_INTERNAL, status.clause(), status.offset(),
                "internal error: a decoder would refuse the encoded stream: " + status.message());
}

}  // namespace l4d

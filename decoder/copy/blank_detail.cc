// SPDX-License-Identifier: Apache-2.0
#include "decoder/copy/blank_detail.h"

#include <cstdlib>
#include <utility>
#include <vector>

#include "decoder/copy/damaged_pages.h"
#include "decoder/read/page_reads.h"
#include "libl4dcodec/container/page.h"
#include "libl4dcodec/entropy/rans_encoder.h"

namespace l4d {
namespace {

// Writes channels of which each symbol is the least that its table has a code for.
class LeastWriter {
 public:
  LeastWriter(const EntropyTables& tables, size_t first) : tables_(tables), next_(first) {
    channels_.resize(tables.channels.size());
    for (size_t begin = 0; begin < tables.entries.size(); begin += kRansSlots) {
      // A table of which each token occurs as often as it has slots is the best for these counts,
      // so that the writer's is the same.
      std::vector<uint64_t> counts(kRansMaxTokens);
      for (size_t slot = 0; slot < kRansSlots; ++slot) {
        ++counts[tables.entries[begin + slot] & 0xff];
      }
      writer_tables_.emplace_back(counts);
      uint16_t least = 0;
      while (writer_tables_.back().frequency(hybrid_token(least).token) == 0 && least < UINT16_MAX)
        ++least;
      least_.push_back(least);
    }
  }

  uint16_t put(uint8_t context) {
    const uint8_t table = tables_.maps[next_][context];
    channels_[next_].tables.push_back(table);
    channels_[next_].values.push_back(least_[table]);
    return least_[table];
  }
  void end_channel() { ++next_; }

  void finish(Bytes* out) const {
    RansBlockWriter writer;
    for (const Channel& c : channels_) {
      writer.add_hybrid(writer_tables_.data(), c.tables.data(), c.values);
    }
    writer.finish(*out);
  }

 private:
  struct Channel {
    std::vector<uint16_t> values;
    std::vector<uint8_t> tables;
  };
  const EntropyTables& tables_;
  size_t next_;
  std::vector<RansTable> writer_tables_;
  std::vector<uint16_t> least_;  // value, of each table
  std::vector<Channel> channels_;
};

// The coefficients of SH detail, behind those of the base.
void write_coefficients(const SceneHeader& header, const PageColumns& columns,
                        LeastWriter* writer) {
  const ComponentColumns& sh = columns.component[L4D_COMPONENT_SH];
  std::vector<int> last(columns.n, 0), before(columns.n, 0);  // magnitudes
  for (unsigned k = 0; k < header.sh.coefficients(); ++k) {
    const bool is_there = k < header.sh_base;
    for (size_t i = 0, at = 0; i < columns.n; ++i) {
      if (eob_coefficients(header.sh, sh.eob_index[i]) <= k) continue;
      const auto sum = static_cast<unsigned>(last[i] + before[i]);
      const unsigned context = kMagnitudes * sh.step_exponent[i] + magnitude_context(sum);
      const int16_t q = is_there ? sh.coefficient[k][at++]
                                 : unzigzag16(writer->put(static_cast<uint8_t>(context)));
      before[i] = last[i];
      last[i] = std::abs(int{q});
    }
    if (!is_there) writer->end_channel();
  }
}

// All of a page but its SH detail.
Status decode_base(SceneFile& file, const PageTask& task, const EntropyTables& tables,
                   PageColumns* columns) {
  const SceneHeader& header = file.header();
  MemoryCharge charge(file.memory());
  Bytes storage;
  RansPageChunks chunks;
  L4D_RETURN_IF_ERROR(read_stored(file, task.record.chunk, &charge, storage, &chunks.first));
  L4D_RETURN_IF_ERROR(check_page_chunk(header, task.record, false, chunks.first));
  chunks.first_at = task.record.chunk.offset;
  chunks.has_detail = true;
  RansDecoder decoder;
  decoder.kernels = &rans_kernels_simd();
  decoder.streams = &stream_kernels_simd();
  PageWants wants;
  wants.sh_detail = false;
  RansPage page{&decoder, chunks, task.block(), task.record.num_gaussians, columns};
  decode_rans_page(header, header.layers[task.layer], tables, wants, &page);
  return std::move(page.status);
}

}  // namespace

Status make_blank_detail(SceneFile& file, const PageTask& task, Bytes* out) {
  const SceneHeader& header = file.header();
  if (header.sh_base == 0) return {};
  const EntropyTables* tables = nullptr;
  L4D_RETURN_IF_ERROR(file.codebooks().entropy_tables(task.layer, &tables));
  PageColumns columns;
  L4D_RETURN_IF_ERROR(decode_base(file, task, *tables, &columns));
  LeastWriter writer(*tables, first_detail_channel(header, tables->channels));
  write_coefficients(header, columns, &writer);
  writer.finish(out);
  return {};
}

}  // namespace l4d

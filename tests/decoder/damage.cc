// SPDX-License-Identifier: Apache-2.0
#include "tests/decoder/damage.h"

#include <algorithm>

#include "l4d/experimental/copy.h"

namespace l4d::test {

Anatomy::Anatomy(const Bytes& file) : editor(file) {
  const SceneHeader& header = editor.header;
  const auto add = [&](Chunk chunk, const ChunkRef& ref, std::string name) {
    chunk.ref = ref;
    chunk.name = std::move(name);
    chunks.push_back(std::move(chunk));
  };
  Chunk chunk;
  chunk.kind = Chunk::kCodebook;
  chunk.needed_by_all = true;
  for (const StageCoding& s : header.sh.stages) add(chunk, s.codebook, "SH codebook");
  chunk.needed_by_all = false;
  uint64_t first = 0;
  for (uint32_t l = 0; l < header.layers.size(); ++l) {
    const LayerHeader& layer = header.layers[l];
    const std::string in = " of layer " + std::to_string(l);
    chunk.layer = l;
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      chunk.component = c;
      chunk.kind = Chunk::kCodebook;
      for (const StageCoding& s : layer.component[c].stages)
        add(chunk, s.codebook, "codebook" + in);
      chunk.kind = Chunk::kResidualCodebook;
      if (layer.component[c].has_rcq) {
        add(chunk, layer.component[c].rcq.codebook, "residual codebook" + in);
      }
    }
    for (uint32_t d = 0; d < editor.layers[l].directory.size(); ++d) {
      const EditedDirectoryPage& directory = editor.layers[l].directory[d];
      if (!directory.present) continue;
      chunk.directory = d;
      chunk.kind = Chunk::kDirectory;
      const uint64_t at = layer.page_table_offset + uint64_t{d} * PageTableEntry::kBytes;
      PageTableEntry entry;
      EXPECT_TRUE(
          PageTableEntry::parse(
              ByteSpan(file).subspan(static_cast<size_t>(at), PageTableEntry::kBytes), at, &entry)
              .ok());
      add(chunk, entry.chunk, "directory page " + std::to_string(d) + in);
      chunk.kind = Chunk::kBlockCodebook;
      for (uint32_t b = 0; b < directory.page.blocks.size(); ++b) {
        chunk.block = b;
        for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
          chunk.component = c;
          const RcqTableRef& table = directory.page.blocks[b].tables[c];
          if (table.num_entries > 0) add(chunk, table.chunk, "block codebook" + in);
        }
      }
      chunk.kind = Chunk::kPage;
      for (uint32_t p = 0; p < directory.page.pages.size(); ++p) {
        const PageRecord& record = directory.page.pages[p];
        chunk.page = p;
        add(chunk, record.chunk, "page " + std::to_string(pages.size()) + in);
        Page page{record.chunk,         l, d, p, record.bucket, record.block, first,
                  record.num_gaussians, {}};
        for (unsigned c = 0; record.block != kNoBlock && c < L4D_COMPONENT_COUNT; ++c) {
          page.has_table[c] = directory.page.blocks[record.block].tables[c].num_entries > 0;
        }
        pages.push_back(page);
        first += record.num_gaussians;
      }
    }
  }
}

std::vector<Chunk> Anatomy::some_chunks(size_t most) const {
  std::array<size_t, Chunk::kCodebook + 1> total{}, seen{};
  for (const Chunk& c : chunks) ++total[c.kind];
  std::vector<Chunk> some;
  for (const Chunk& c : chunks) {
    if (seen[c.kind]++ % (1 + (total[c.kind] - 1) / most) == 0) some.push_back(c);
  }
  return some;
}

Chunk Anatomy::page_chunk(size_t page) const {
  size_t seen = 0;
  for (const Chunk& c : chunks) {
    if (c.kind == Chunk::kPage && seen++ == page) return c;
  }
  return {};
}

std::vector<size_t> Anatomy::lost_with(const Chunk& chunk) const {
  std::vector<size_t> lost;
  for (size_t p = 0; p < pages.size(); ++p) {
    const Page& page = pages[p];
    if (page.layer != chunk.layer) continue;
    const bool here = page.directory == chunk.directory;
    bool needs = false;
    switch (chunk.kind) {
      case Chunk::kPage:
        needs = here && page.index == chunk.page;
        break;
      case Chunk::kDirectory:
        needs = here;
        break;
      case Chunk::kBlockCodebook:
        needs = here && page.block == chunk.block;
        break;
      case Chunk::kResidualCodebook:
        needs = page.has_table[chunk.component];
        break;
      case Chunk::kCodebook:
        needs = true;
        break;
    }
    if (needs) lost.push_back(p);
  }
  return lost;
}

uint64_t Anatomy::gaussians(const std::vector<size_t>& of) const {
  uint64_t sum = 0;
  for (const size_t p : of) sum += pages[p].count;
  return sum;
}

Bytes Anatomy::rebuilt_without(size_t page) const {
  const Page& p = pages[page];
  StreamEditor without_it = editor;
  EditedDirectoryPage& d = without_it.layers[p.layer].directory[p.directory];
  d.page.pages.erase(d.page.pages.begin() + static_cast<std::ptrdiff_t>(p.index));
  d.pages.erase(d.pages.begin() + static_cast<std::ptrdiff_t>(p.index));
  if (d.page.pages.empty()) d.present = false;
  without_it.header.num_gaussians -= p.count;
  without_it.header.layers[p.layer].num_gaussians -= p.count;
  return without_it.build();
}

uint64_t Anatomy::tables_begin() const {
  uint64_t begin = ~uint64_t{0};
  for (const LayerHeader& l : editor.header.layers) begin = std::min(begin, l.page_table_offset);
  return begin;
}

uint64_t Anatomy::payload_begin() const {
  uint64_t begin = ~uint64_t{0};
  for (const Page& p : pages) begin = std::min(begin, p.ref.offset);
  return begin;
}

Bytes damage(const Bytes& file, const Chunk& chunk) {
  Bytes damaged = file;
  damaged[static_cast<size_t>(chunk.ref.offset + chunk.ref.stored_bytes / 2)] ^= 0x40;
  return damaged;
}

DecoderHandle tolerant_decoder(const Bytes& bytes) {
  l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  o.tolerant = 1;
  DecoderHandle d(&o);
  d.open_memory(bytes.data(), bytes.size());
  return d;
}

GaussianArrays decode_rest(const DecoderHandle& decoder, const l4d_query& query) {
  GaussianArrays a = decoder.decode(query);
  // Ranges beyond those handed out stay empty.
  size_t n = 0;
  while (!a.spans.empty() && a.spans.back().count == 0) a.spans.pop_back();
  for (const l4d_bucket_span& r : a.spans) n += static_cast<size_t>(r.count);
  a.position.resize(3 * n);
  a.mean_t.resize(n);
  a.mean_t_local.resize(n);
  a.log_scale.resize(4 * n);
  a.rotor.resize(8 * n);
  a.opacity.resize(n);
  a.sh.resize(3 * (a.sh_degree + 1) * (a.sh_degree + 1) * n);
  return a;
}

GaussianArrays without(const GaussianArrays& all, const Anatomy& anatomy,
                       const std::vector<size_t>& lost) {
  GaussianArrays rest;
  rest.sh_degree = all.sh_degree;
  rest.flags = all.flags;
  const size_t sh = 3 * (all.sh_degree + 1) * (all.sh_degree + 1);
  for (size_t p = 0; p < anatomy.pages.size(); ++p) {
    if (std::find(lost.begin(), lost.end(), p) != lost.end()) continue;
    const uint64_t first = anatomy.pages[p].first, count = anatomy.pages[p].count;
    const auto from = std::find_if(
        all.spans.begin(), all.spans.end(),
        [&](const l4d_bucket_span& r) { return first >= r.first && first < r.first + r.count; });
    if (rest.spans.empty() || rest.spans.back().layer != from->layer ||
        rest.spans.back().bucket != from->bucket) {
      rest.spans.push_back(*from);
      rest.spans.back().first = rest.count();
      rest.spans.back().count = 0;
    }
    rest.spans.back().count += count;
    const auto append = [&](const std::vector<float>& source, size_t dim, std::vector<float>* to) {
      const auto begin = source.begin() + static_cast<std::ptrdiff_t>(dim * first);
      to->insert(to->end(), begin, begin + static_cast<std::ptrdiff_t>(dim * count));
    };
    append(all.position, 3, &rest.position);
    append(all.mean_t, 1, &rest.mean_t);
    append(all.mean_t_local, 1, &rest.mean_t_local);
    append(all.log_scale, 4, &rest.log_scale);
    append(all.rotor, 8, &rest.rotor);
    append(all.opacity, 1, &rest.opacity);
    append(all.sh, sh, &rest.sh);
  }
  return rest;
}

std::vector<l4d_loss> losses_of(const DecoderHandle& decoder) {
  uint64_t count = 0;
  decoder.check(l4d_decoder_get_losses(decoder.get(), nullptr, 0, &count));
  std::vector<l4d_loss> losses(static_cast<size_t>(count));
  decoder.check(l4d_decoder_get_losses(decoder.get(), losses.data(), count, &count));
  return losses;
}

l4d_counters counters_of(const DecoderHandle& decoder) {
  l4d_counters c = L4D_INIT(l4d_counters);
  decoder.check(l4d_decoder_get_counters(decoder.get(), &c));
  return c;
}

l4d_status strict_failure(const Bytes& bytes, const std::string& clause) {
  try {
    decode(bytes, all_query());
  } catch (const Error& e) {
    EXPECT_NE(std::string(e.what()).find("spec " + clause), std::string::npos) << e.what();
    return e.status();
  }
  return L4D_OK;
}

l4d_writer writer_to(Bytes* out) {
  l4d_writer writer = L4D_INIT(l4d_writer);
  writer.user = out;
  writer.write = [](void* user, const void* src, size_t n) {
    const auto* bytes = static_cast<const unsigned char*>(src);
    auto& to = *static_cast<Bytes*>(user);
    to.insert(to.end(), bytes, bytes + n);
    return 0;
  };
  return writer;
}

l4d_status copy_rest(const Bytes& stream, Bytes* out) {
  l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
  options.tolerant = 1;
  l4d_member_parameters p = L4D_INIT(l4d_member_parameters);
  const l4d_reader reader = memory_reader(stream);
  const l4d_writer writer = writer_to(out);
  return l4d_copy_member(&reader, &options, &p, &writer, nullptr);
}

}  // namespace l4d::test

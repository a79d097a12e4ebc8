// SPDX-License-Identifier: Apache-2.0
#include "tests/common/stream_editor.h"

#include <stdexcept>

#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/entropy/stream.h"

namespace l4d::test {
namespace {

void require(const Status& s) {
  if (!s.ok()) throw std::runtime_error(s.detail());
}

ByteSpan part(const Bytes& file, uint64_t offset, uint64_t n) {
  return ByteSpan(file).subspan(static_cast<size_t>(offset), static_cast<size_t>(n));
}

StreamDecoder& decoder() {
  static StreamDecoder* const kDecoder = [] {
    auto* d = new StreamDecoder;
    d->kernels = &stream_kernels_reference();
    return d;
  }();
  return *kDecoder;
}

EditedChunk take(const Bytes& file, const ChunkRef& ref) {
  EditedChunk chunk;
  chunk.codec = ref.codec;
  if (ref.codec == static_cast<uint32_t>(ChunkCodec::kRans32)) {
    const ByteSpan stored = part(file, ref.offset, ref.stored_bytes);
    chunk.raw.assign(stored.begin(), stored.end());
    return chunk;
  }
  Bytes storage;
  ByteSpan raw;
  require(decode_chunk(decoder(), ref.codec, part(file, ref.offset, ref.stored_bytes),
                       ref.raw_bytes, ref.raw_bytes, ref.offset, storage, &raw));
  chunk.raw.assign(raw.begin(), raw.end());
  return chunk;
}

// Appends the chunk; the reference says where it is, counted from `base`.
ChunkRef put(const EditedChunk& chunk, uint64_t base, Bytes* out) {
  ChunkRef ref;
  Bytes stored = chunk.raw;
  if (chunk.stored.has_value()) {
    stored = *chunk.stored;
  } else if (chunk.codec == static_cast<uint32_t>(ChunkCodec::kZstd)) {
    stored = ZstdCompressor(3).compress(chunk.raw);
  }
  ref.codec = chunk.codec;
  ref.offset = chunk.offset.value_or(out->size() - base);
  ref.stored_bytes = static_cast<uint32_t>(stored.size());
  ref.raw_bytes = chunk.raw_bytes.value_or(static_cast<uint32_t>(chunk.raw.size()));
  ref.hash = hash64(stored) ^ (chunk.wrong_hash ? 1u : 0u);
  out->insert(out->end(), stored.begin(), stored.end());
  return ref;
}

EditedDirectoryPage take_directory_page(const Bytes& file, const SceneHeader& header,
                                        uint32_t layer, uint32_t index) {
  EditedDirectoryPage out;
  out.says_layer = layer;
  out.says_index = index;
  const uint64_t at = header.layers[layer].page_table_offset + index * PageTableEntry::kBytes;
  PageTableEntry entry;
  require(PageTableEntry::parse(part(file, at, PageTableEntry::kBytes), at, &entry));
  if (entry.chunk.stored_bytes == 0) return out;
  out.present = true;
  out.chunk = take(file, entry.chunk);
  require(parse_directory_page(out.chunk.raw, 0, header, layer, index, &out.page));
  for (const PageRecord& p : out.page.pages) {
    out.pages.push_back(take(file, p.chunk));
    out.details.push_back(p.has_sh_detail() ? take(file, p.sh_detail) : EditedChunk());
  }
  for (const BlockRecord& b : out.page.blocks) {
    std::array<EditedChunk, L4D_COMPONENT_COUNT> tables;
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      if (b.tables[c].num_entries != 0) tables[c] = take(file, b.tables[c].chunk);
    }
    out.tables.push_back(std::move(tables));
  }
  return out;
}

}  // namespace

StreamEditor::StreamEditor(const Bytes& bytes) {
  require(FileHeader::parse(part(bytes, 0, FileHeader::kBytes), &file));
  // build() writes in another order.
  file.flags &= static_cast<uint16_t>(~FileHeader::kStreamableFlag);
  require(parse_scene_header(part(bytes, file.header_offset, file.header_bytes), file.header_offset,
                             &header));
  for (size_t s = 0; s < header.sh.num_codebooks(); ++s) {
    sh_codebooks.push_back(take(bytes, header.sh.codebook(s).codebook));
  }
  for (uint32_t l = 0; l < header.layers.size(); ++l) {
    const LayerHeader& layer = header.layers[l];
    EditedLayer out;
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      const ComponentCoding& coding = layer.component[c];
      for (size_t s = 0; s < coding.num_codebooks(); ++s) {
        out.codebooks[c].push_back(take(bytes, coding.codebook(s).codebook));
      }
      if (coding.has_rcq) out.rcq[c] = take(bytes, coding.rcq.codebook);
    }
    if (layer.has_entropy) out.entropy = take(bytes, layer.entropy);
    for (uint32_t d = 0; layer.num_gaussians > 0 && d < num_directory_pages(layer); ++d) {
      out.directory.push_back(take_directory_page(bytes, header, l, d));
    }
    layers.push_back(std::move(out));
  }
}

Bytes StreamEditor::build() {
  SceneHeader h = header;
  Bytes out(FileHeader::kBytes, 0);
  for (size_t s = 0; s < sh_codebooks.size() && s < h.sh.num_codebooks(); ++s) {
    h.sh.codebook(s).codebook = put(sh_codebooks[s], 0, &out);
  }
  for (size_t l = 0; l < layers.size() && l < h.layers.size(); ++l) {
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      ComponentCoding& coding = h.layers[l].component[c];
      for (size_t s = 0; s < layers[l].codebooks[c].size() && s < coding.num_codebooks(); ++s) {
        coding.codebook(s).codebook = put(layers[l].codebooks[c][s], 0, &out);
      }
      if (coding.has_rcq) coding.rcq.codebook = put(layers[l].rcq[c], 0, &out);
    }
    if (h.layers[l].has_entropy) h.layers[l].entropy = put(layers[l].entropy, 0, &out);
  }
  h.payload_offset = out.size();
  for (EditedLayer& layer : layers) {
    for (EditedDirectoryPage& d : layer.directory) {
      for (size_t b = 0; b < d.page.blocks.size() && b < d.tables.size(); ++b) {
        for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
          if (d.page.blocks[b].tables[c].num_entries == 0) continue;
          d.page.blocks[b].tables[c].chunk = put(d.tables[b][c], h.payload_offset, &out);
        }
      }
      for (size_t p = 0; p < d.page.pages.size(); ++p) {
        d.page.pages[p].chunk = put(d.pages[p], h.payload_offset, &out);
        if (p >= d.details.size() || d.details[p].raw.empty()) continue;
        d.page.pages[p].sh_detail = put(d.details[p], h.payload_offset, &out);
      }
    }
  }
  for (size_t l = 0; l < layers.size() && l < h.layers.size(); ++l) {
    Bytes table;
    for (EditedDirectoryPage& d : layers[l].directory) {
      PageTableEntry entry;
      if (d.present) {
        d.chunk.raw = serialize_directory_page(d.page, d.says_layer, d.says_index);
        if (d.on_bytes) d.on_bytes(d.chunk.raw);
        entry.chunk = put(d.chunk, 0, &out);
      }
      entry.append(table);
    }
    if (layers[l].on_page_table) layers[l].on_page_table(table);
    h.layers[l].page_table_offset = out.size();
    out.insert(out.end(), table.begin(), table.end());
  }
  Bytes scene_header = serialize_scene_header(h);
  if (on_scene_header) on_scene_header(scene_header);
  out.resize((out.size() + 15) / 16 * 16);
  FileHeader f = file;
  f.header_offset = out.size();
  f.header_bytes = static_cast<uint32_t>(scene_header.size());
  f.header_hash = hash64(scene_header);
  out.insert(out.end(), scene_header.begin(), scene_header.end());
  Bytes head;
  f.append(head);
  if (on_file_header) on_file_header(head);
  std::copy(head.begin(), head.end(), out.begin());
  return out;
}

StreamEditor::Place StreamEditor::find(
    const std::function<bool(const LayerHeader&)>& wanted) const {
  for (size_t l = 0; l < layers.size(); ++l) {
    if (!wanted(header.layers[l])) continue;
    for (size_t d = 0; d < layers[l].directory.size(); ++d) {
      if (layers[l].directory[d].present) return {l, d};
    }
  }
  throw std::runtime_error("the file has no such layer");
}

const BlockRecord* StreamEditor::block_of(const Place& place, size_t page) const {
  const EditedDirectoryPage& d = layers[place.layer].directory[place.directory];
  const uint32_t block = d.page.pages[page].block;
  return block == kNoBlock ? nullptr : &d.page.blocks[block];
}

std::vector<PageStream> StreamEditor::streams(const Place& place, size_t page) const {
  const EditedDirectoryPage& d = layers[place.layer].directory[place.directory];
  const LayerHeader& layer = header.layers[place.layer];
  const size_t n = d.page.pages[page].num_gaussians;
  const Bytes& raw = d.pages[page].raw;
  ByteReader in(raw);
  std::vector<PageStream> list;
  const auto step = [&](const std::string& name, size_t count, unsigned width) {
    PageStream s{name, in.position(), 0, count, width};
    require(skip_stream(in, 0, count, width));
    s.end = in.position();
    list.push_back(s);
  };
  const auto mean = [&](const std::string& name, CoordinateCodingId coding) {
    if (coding != CoordinateCodingId::kNone)
      step(name, n, coding == CoordinateCodingId::kF16 ? 16 : 32);
  };
  const auto scalar = [&](const std::string& name, const ScalarCoding& coding) {
    if (coding.coding == ScalarCodingId::kSq) step(name, n, coding.bits);
    if (coding.coding == ScalarCodingId::kRaw32) step(name, n, 32);
  };
  for (const char* axis : {"x", "y", "z"}) {
    mean(std::string("position.") + axis, header.position_of(layer));
  }
  if (layer.mean_t == CoordinateCodingId::kF16) {
    step("mean_t", n, 16 - layer.mean_t_shift);
  } else {
    mean("mean_t", layer.mean_t);
  }
  scalar("opacity", header.opacity);
  scalar("scale_factor", layer.scale_factor);
  static constexpr const char* kNames[] = {"sh", "scale", "rotor_spatial", "rotor_temporal"};
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    const ComponentCoding& coding = header.component(layer, c);
    const unsigned dim = header.component_dim(layer, c);
    const std::string name = kNames[c];
    if (coding.coding == ComponentCodingId::kRaw32) {
      for (unsigned k = 0; k < dim; ++k) step(name + ".raw." + std::to_string(k), n, 32);
    }
    if (coding.transform()) {
      step(name + ".step_exponent", n, 4);
      std::vector<uint16_t> eob_index(n, 1);
      if (coding.eob_table.size() > 1) {
        const unsigned width = bit_width(static_cast<uint32_t>(coding.eob_table.size() + 1));
        ByteReader again(ByteSpan(raw).subspan(in.position(), in.remaining()));
        require(decode_stream(decoder(), again, 0, n, width, 0, "", eob_index.data()));
        step(name + ".eob_index", n, width);
      }
      for (unsigned k = 0; k < coding.coefficients(); ++k) {
        size_t count = 0;
        for (const uint16_t r : eob_index) count += eob_coefficients(coding, r) > k;
        step(name + ".coefficient." + std::to_string(k), count, 16);
      }
    }
    if (!coding.vq()) continue;
    std::vector<uint16_t> depth(n, static_cast<uint16_t>(coding.stages.size()));
    if (coding.has_depth()) {
      ByteReader again(ByteSpan(raw).subspan(in.position(), in.remaining()));
      require(decode_stream(decoder(), again, 0, n, 4, 0, "", depth.data()));
      step(name + ".depth", n, 4);
    }
    size_t escapes = 0;
    for (const uint16_t v : depth) escapes += v == kEscapeDepth;
    for (size_t s = 0; s < coding.stages.size(); ++s) {
      size_t count = 0;
      for (const uint16_t v : depth) count += v != kEscapeDepth && v > s;
      const uint32_t limit = s == 0 ? stage0_entries(header, layer, c, block_of(place, page))
                                    : coding.stages[s].num_entries;
      step(name + ".index." + std::to_string(s), count, bit_width(limit));
    }
    for (unsigned k = 0; k < dim; ++k) step(name + ".escape." + std::to_string(k), escapes, 16);
  }
  if (in.remaining() != 0) throw std::runtime_error("streams do not fill the page");
  return list;
}

PageStream StreamEditor::stream(const Place& place, size_t page, const std::string& name) const {
  for (const PageStream& s : streams(place, page)) {
    if (s.name == name) return s;
  }
  throw std::runtime_error("no stream " + name);
}

void StreamEditor::replace_stream(const Place& place, size_t page, const std::string& name,
                                  const Bytes& bytes) {
  const PageStream s = stream(place, page, name);
  Bytes& raw = at(place).pages[page].raw;
  raw.erase(raw.begin() + static_cast<std::ptrdiff_t>(s.begin),
            raw.begin() + static_cast<std::ptrdiff_t>(s.end));
  raw.insert(raw.begin() + static_cast<std::ptrdiff_t>(s.begin), bytes.begin(), bytes.end());
}

}  // namespace l4d::test

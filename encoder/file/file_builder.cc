// SPDX-License-Identifier: Apache-2.0
#include "encoder/file/file_builder.h"

#include <algorithm>
#include <map>

#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/container/file_header.h"
#include "libl4dcodec/container/level_meter.h"
#include "libl4dcodec/container/streamable.h"
#include "libl4dcodec/quant/codebook.h"

namespace l4d {
namespace {

// Far below kMaxDirectoryPageBytes at the 72 bytes of a page record.
constexpr size_t kMaxPagesPerDirectoryPage = size_t{1} << 19;

class FileBuilder {
 public:
  FileBuilder(const EncoderScene& scene, const EncoderSettings& settings, SceneHeader header,
              const CodedScene& coded, int threads, const std::function<bool()>* cancelled)
      : scene_(scene),
        settings_(settings),
        header_(std::move(header)),
        layers_(coded.layers),
        sh_(coded.sh),
        threads_(threads),
        cancelled_(cancelled),
        streams_(settings.get_int(Parameter::kZstdLevel)),
        zstd_(settings.get_int(Parameter::kZstdLevel)) {}

  Status run(FileParts* out) {
    add_codebooks();
    build_pages();
    build_payload();
    build_directory();
    L4D_RETURN_IF_ERROR(declare());
    assemble();
    *out = std::move(parts_);
    return {};
  }

 private:
  // A chunk whose place in the file is not yet known.
  ChunkRef make_chunk(Bytes raw, std::vector<Bytes>* to) {
    ChunkRef ref;
    ref.raw_bytes = static_cast<uint32_t>(raw.size());
    Bytes frame = zstd_.compress(raw);
    if (frame.size() < raw.size()) {
      raw = std::move(frame);
      ref.codec = static_cast<uint32_t>(ChunkCodec::kZstd);
    }
    ref.stored_bytes = static_cast<uint32_t>(raw.size());
    ref.hash = hash64(raw);
    to->push_back(std::move(raw));
    return ref;
  }

  void add_component(const CodedComponent& c, ComponentCoding* coding) {
    const uint32_t dim = static_cast<uint32_t>(rows_of(c).dim);
    const auto add = [&](const std::vector<float>& entries, StageCoding* to) {
      to->codebook = make_chunk(encode_codebook(streams_, *to, entries.data(), dim), &codebooks_);
    };
    if (const auto* transform = std::get_if<CodedTransform>(&c)) {
      add(transform->basis, &coding->basis);
    } else if (const auto* vq = std::get_if<CodedVq>(&c)) {
      for (size_t s = 0; s < vq->codebooks.size(); ++s) add(vq->codebooks[s], &coding->stages[s]);
      if (coding->has_rcq) add(vq->residual_codebook, &coding->rcq);
    }
  }

  void add_codebooks() {
    add_component(sh_, &header_.sh);
    for (size_t l = 0; l < layers_.size(); ++l) {
      for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
        add_component(layers_[l].component[c], &header_.layers[l].component[c]);
      }
    }
  }

  void build_pages() {
    for (size_t l = 0; l < layers_.size(); ++l) {
      // A bucket's pages are described in one directory page, whose size the format bounds.
      const size_t page_size =
          std::max(static_cast<size_t>(settings_.get(Parameter::kPageSize)),
                   layers_[l].gaussians.size() / kMaxPagesPerDirectoryPage + 1);
      const PageOptions options{page_size, settings_.get_int(Parameter::kZstdLevel),
                                settings_.get_bool(Parameter::kRans), cancelled_};
      built_.push_back(
          build_layer(scene_, header_, header_.layers[l], layers_[l], options, threads_));
      if (!built_.back().entropy.empty()) {
        header_.layers[l].has_entropy = true;
        header_.layers[l].entropy = make_chunk(std::move(built_.back().entropy), &entropy_);
        header_.layers[l].symbols_per_gaussian = built_.back().symbols_per_gaussian;
      }
      for (const uint32_t i : built_.back().order) parts_.order.push_back(scene_.source[i]);
    }
  }

  // Level 0 first, tier by tier, then buckets by the time they begin, so that playback reads
  // forward (spec: section 12.1). The tables of a block lie before its first page. Of a bucket, the
  // base chunks of all pages lie before the second ones: a reader of base colours alone reads one
  // range, and so does one of everything.
  void build_payload() {
    struct Item {
      uint64_t place;
      size_t layer, page;
    };
    std::vector<Item> items;
    for (size_t l = 0; l < built_.size(); ++l) {
      for (size_t p = 0; p < built_[l].pages.size(); ++p) {
        items.push_back({payload_place(header_.layers[l], built_[l].pages[p].record.bucket), l, p});
      }
    }
    std::stable_sort(items.begin(), items.end(),
                     [](const Item& a, const Item& b) { return a.place < b.place; });
    block_tables_.resize(layers_.size());
    const auto add = [&](Bytes bytes, ChunkRef* ref) {
      if (bytes.empty()) return;
      ref->offset = payload_bytes_;
      payload_bytes_ += bytes.size();
      payload_.push_back(std::move(bytes));
    };
    const auto page_of = [&](size_t i) -> BuiltPage& {
      return built_[items[i].layer].pages[items[i].page];
    };
    for (size_t begin = 0, end = 0; begin < items.size(); begin = end) {
      const uint32_t bucket = page_of(begin).record.bucket;
      for (; end < items.size() && items[end].layer == items[begin].layer &&
             page_of(end).record.bucket == bucket;
           ++end) {
        BuiltPage& page = page_of(end);
        if (page.record.block != kNoBlock) add_block(items[end].layer, page.record.block);
        add(std::move(page.bytes), &page.record.chunk);
      }
      for (size_t i = begin; i < end; ++i) {
        add(std::move(page_of(i).sh_detail), &page_of(i).record.sh_detail);
      }
    }
  }

  void add_block(size_t l, uint32_t block) {
    if (block_tables_[l].count(block) != 0) return;
    BlockRecord record = block_entries(layers_[l], block);
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      if (record.tables[c].num_entries == 0) continue;
      const ComponentCoding& coding = header_.layers[l].component[c];
      ChunkRef ref = make_chunk(
          encode_rcq_table(streams_, std::get<CodedVq>(layers_[l].component[c]).block_tables[block],
                           coding.stages[0].num_entries, coding.rcq.num_entries),
          &payload_);
      ref.offset = payload_bytes_;
      payload_bytes_ += ref.stored_bytes;
      record.tables[c].chunk = ref;
    }
    block_tables_[l][block] = record;
  }

  void build_directory() {
    tables_.resize(layers_.size());
    for (size_t l = 0; l < layers_.size(); ++l) {
      if (header_.layers[l].num_gaussians == 0) continue;
      const unsigned bits = header_.layers[l].directory_bits;
      const auto& pages = built_[l].pages;
      size_t p = 0;
      for (uint32_t d = 0; d < num_directory_pages(header_.layers[l]); ++d) {
        DirectoryPage page;
        std::map<uint32_t, uint32_t> local;  // block of the layer -> block of this page
        for (; p < pages.size() && pages[p].record.bucket >> bits == d; ++p) {
          PageRecord record = pages[p].record;
          if (record.block != kNoBlock) {
            const auto [it, added] =
                local.emplace(record.block, static_cast<uint32_t>(page.blocks.size()));
            if (added) page.blocks.push_back(block_tables_[l][record.block]);
            record.block = it->second;
          }
          page.pages.push_back(record);
        }
        PageTableEntry entry;
        if (!page.pages.empty()) {
          directory_order_.push_back(
              {directory_place(header_.layers[l], d), directory_.size(), l, d});
          entry.chunk =
              make_chunk(serialize_directory_page(page, static_cast<uint32_t>(l), d), &directory_);
        }
        meter_.add_directory_page(static_cast<uint32_t>(l), d,
                                  PageTableEntry::kBytes + entry.chunk.stored_bytes, &page);
        tables_[l].push_back(entry);
      }
    }
  }

  // The header's size does not depend on numbers in it as long as none is zero, so it is known
  // before they are.
  uint32_t header_bytes() {
    for (LayerHeader& layer : header_.layers) layer.page_table_offset = layer.num_gaussians != 0;
    header_.payload_offset = 1;
    return static_cast<uint32_t>(serialize_scene_header(header_).size());
  }

  // Profile and level. The level is about sizes, that of the header with a level in it among them.
  Status declare() {
    const int profile = settings_.get_int(Parameter::kProfile);
    header_.profile =
        profile < 0 ? static_cast<unsigned>(profile_of(header_)) : static_cast<unsigned>(profile);
    const int level = settings_.get_int(Parameter::kLevel);
    if (level == 0) return {};
    header_.conformance_level = static_cast<unsigned>(std::max(level, 1));
    meter_.finish(FileHeader::kBytes + uint64_t{header_bytes()});
    if (level < 0) {
      header_.conformance_level = meter_.smallest_level();
      return {};
    }
    std::string text;
    for (const LimitViolation& e : meter_.beyond(header_.conformance_level)) {
      text += (text.empty() ? "" : "; ") + e.message;
    }
    return text.empty() ? Status() : Status(L4D_ERR_LIMIT_EXCEEDED, text);
  }

  // Gives every chunk its place.
  void assemble() {
    FileHeader file;
    file.flags = FileHeader::kDevelopmentFlag | FileHeader::kStreamableFlag;
    file.header_bytes = header_bytes();
    uint64_t at = FileHeader::kBytes + file.header_bytes;

    const auto place = [&](ChunkRef& ref) {
      ref.offset = at;
      at += ref.stored_bytes;
    };
    const auto place_component = [&](ComponentCoding& coding) {
      for (size_t s = 0; s < coding.num_codebooks(); ++s) place(coding.codebook(s).codebook);
      if (coding.has_rcq) place(coding.rcq.codebook);
    };
    place_component(header_.sh);
    for (LayerHeader& layer : header_.layers) {
      for (ComponentCoding& c : layer.component) place_component(c);
    }
    for (LayerHeader& layer : header_.layers) {
      if (layer.has_entropy) place(layer.entropy);
    }
    const uint64_t tables_at = at;
    for (const auto& table : tables_) at += table.size() * PageTableEntry::kBytes;
    std::stable_sort(directory_order_.begin(), directory_order_.end(),
                     [](const auto& a, const auto& b) { return a.place < b.place; });
    for (const PlacedDirectoryPage& page : directory_order_) {
      place(tables_[page.layer][page.index].chunk);
    }
    header_.payload_offset = at;
    Bytes tables;
    for (size_t l = 0; l < tables_.size(); ++l) {
      if (tables_[l].empty()) continue;
      header_.layers[l].page_table_offset = tables_at + tables.size();
      for (const PageTableEntry& entry : tables_[l]) entry.append(tables);
    }

    Bytes scene_header = serialize_scene_header(header_);
    file.header_hash = hash64(scene_header);
    Bytes head;
    file.append(head);
    const auto add = [&](Bytes bytes) {
      parts_.bytes += bytes.size();
      parts_.chunks.push_back(std::move(bytes));
    };
    add(std::move(head));
    add(std::move(scene_header));
    for (Bytes& b : codebooks_) add(std::move(b));
    for (Bytes& b : entropy_) add(std::move(b));
    add(std::move(tables));
    for (const PlacedDirectoryPage& page : directory_order_) add(std::move(directory_[page.chunk]));
    for (Bytes& b : payload_) add(std::move(b));
  }

  const EncoderScene& scene_;
  const EncoderSettings& settings_;
  SceneHeader header_;
  const std::vector<CodedLayer>& layers_;
  const CodedComponent& sh_;
  int threads_;
  const std::function<bool()>* const cancelled_;
  StreamEncoder streams_;
  ZstdCompressor zstd_;
  FileParts parts_;
  struct PlacedDirectoryPage {
    uint64_t place;  // directory_place
    size_t chunk;    // of directory_
    size_t layer;
    uint32_t index;
  };
  std::vector<PlacedDirectoryPage> directory_order_;
  std::vector<Bytes> codebooks_, entropy_, directory_, payload_;
  uint64_t payload_bytes_ = 0;
  std::vector<BuiltLayer> built_;
  std::vector<std::map<uint32_t, BlockRecord>> block_tables_;
  std::vector<std::vector<PageTableEntry>> tables_;
  LevelMeter meter_{header_};
};

}  // namespace

Status build_file(const EncoderScene& scene, const EncoderSettings& settings, SceneHeader header,
                  const CodedScene& coded, int threads, FileParts* out,
                  const std::function<bool()>* cancelled) {
  return FileBuilder(scene, settings, std::move(header), coded, threads, cancelled).run(out);
}

}  // namespace l4d

// SPDX-License-Identifier: Apache-2.0
#include "decoder/copy/copy_stream.h"

#include <algorithm>
#include <map>
#include <tuple>

#include "decoder/copy/damaged_pages.h"
#include "decoder/read/losses.h"
#include "decoder/read/plan.h"
#include "decoder/session/open_stream.h"
#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/container/level_meter.h"
#include "libl4dcodec/container/levels.h"
#include "libl4dcodec/container/streamable.h"
#include "libl4dcodec/entropy/stream.h"
#include "libl4dcodec/entropy/zstd_codec.h"

namespace l4d {
namespace {

constexpr int kZstdLevel = 9;  // of directory pages, which are all that is compressed again

class StreamCopy {
 public:
  // tolerant: pages that are damaged are left out, and SH chunks are replaced.
  StreamCopy(const CopyRequest& request, const l4d_decoder_options& options, bool tolerant,
             const WriteFn& write)
      : request_(request),
        tolerant_(tolerant),
        stream_(options),
        write_(write),
        zstd_(kZstdLevel) {}

  Status run(const l4d_reader& reader, uint64_t* bytes) {
    L4D_RETURN_IF_ERROR(open(reader));
    L4D_RETURN_IF_ERROR(choose_extensions());
    L4D_RETURN_IF_ERROR(select_pages());
    collect_tables();
    L4D_RETURN_IF_ERROR(place_payload());
    L4D_RETURN_IF_ERROR(build_directory());
    declare();
    place_all();
    L4D_RETURN_IF_ERROR(write_all());
    *bytes = written_;
    return {};
  }

 private:
  using BlockKey = std::tuple<uint32_t, uint32_t, uint32_t>;  // layer, directory page, block

  SceneFile& file() { return stream_.file(); }

  Status open(const l4d_reader& reader) {
    ByteSource headers, source;
    L4D_RETURN_IF_ERROR(ByteSource::from_reader(reader, &headers));
    budget_.set_limit(stream_.options().max_memory_bytes);
    MemberList list(headers, budget_);
    L4D_RETURN_IF_ERROR(list.read_header(0, &old_));
    if (old_.file_header.version_minor > L4D_BITSTREAM_MINOR) {
      return Status(L4D_ERR_FEATURE_UNSUPPORTED, "VER-1", 9,
                    "a stream of a later minor version, of which a copy would lose a part");
    }
    L4D_RETURN_IF_ERROR(ByteSource::from_reader(reader, &source));
    L4D_RETURN_IF_ERROR(stream_.open(std::move(source)));
    header_ = file().header();
    return {};
  }

  // The chunks of extensions that are written, in their order, and those that are copied.
  Status choose_extensions() {
    const auto add = [&](ExtensionId id, bool critical, Bytes bytes) {
      Extension e;
      e.id = static_cast<uint32_t>(id);
      e.critical = critical;
      e.chunk.hash = hash64(bytes);
      e.chunk.stored_bytes = e.chunk.raw_bytes = static_cast<uint32_t>(bytes.size());
      extensions_.push_back(e);
      extension_bytes_.push_back(std::move(bytes));
    };
    header_.needs_members = false;
    if (request_.is_member) {
      const Bytes bytes = serialize_member(request_.member);
      Member checked;
      L4D_RETURN_IF_ERROR(as_argument(parse_member(bytes, 0, &checked)));
      add(ExtensionId::kMember, !request_.member.needs.empty(), bytes);
    }
    if (request_.has_edit || old_.has_edit) {
      edit_ = edit_of_copy();
      const Bytes bytes = serialize_edit(edit_);
      Edit checked;
      L4D_RETURN_IF_ERROR(as_argument(parse_edit(bytes, 0, header_.timeline, &checked)));
      add(ExtensionId::kEdit, false, bytes);
    }
    for (const Extension& e : old_.extensions) {
      const bool ours = e.id == static_cast<uint32_t>(ExtensionId::kMember) ||
                        e.id == static_cast<uint32_t>(ExtensionId::kEdit);
      if (ours) continue;
      kept_.push_back(e.chunk);
      extensions_.push_back(e);
    }
    return {};
  }
  // The presentation of the stream with the requested changes. Fields that are NaN stay NaN.
  Edit edit_of_copy() const {
    const l4d_timeline& t = header_.timeline;
    Edit edit = {t.time_begin, t.time_begin + sequence_duration(t)};
    if (old_.has_edit) edit = old_.edit;
    if (!request_.has_edit) return edit;
    return {std::max(request_.edit.begin, edit.begin), std::min(request_.edit.end, edit.end)};
  }
  static Status as_argument(const Status& status) {
    return status.ok() ? status : invalid_argument(status.message());
  }

  Status select_pages() {
    l4d_query query{};
    query.struct_size = sizeof query;
    query.kind = request_.has_edit ? L4D_QUERY_RANGE : L4D_QUERY_ALL;
    query.time_begin = edit_.begin;
    query.time_end = edit_.end;
    query.point.levels = request_.levels;
    query.point.tiers = request_.tiers;
    Losses losses;  // the directory pages among them; the caller sees what is left
    L4D_RETURN_IF_ERROR(make_plan(file(), query, tolerant_ ? &losses : nullptr, &plan_));
    if (plan_.tasks.empty() && !losses.query().empty()) {
      const l4d_loss& loss = losses.query().front();
      return Status(loss.status, loss.clause, loss.offset, "no page is left");
    }
    if (tolerant_) L4D_RETURN_IF_ERROR(drop_damaged(file(), stream_.pages(), &plan_, &blanks_));
    header_.num_gaussians = plan_.num_gaussians;
    for (LayerHeader& layer : header_.layers) layer.num_gaussians = 0;
    for (const PageTask& task : plan_.tasks) {
      header_.layers[task.layer].num_gaussians += task.record.num_gaussians;
    }
    for (LayerHeader& layer : header_.layers) {
      if (layer.num_gaussians == 0) drop_tables(&layer);
    }
    return {};
  }

  // Of a layer without Gaussians nothing needs a codebook. What needs none stays as it is: profiles
  // ask for it.
  static void drop_tables(LayerHeader* layer) {
    layer->has_entropy = false;
    layer->scale_factor = ScalarCoding();
    for (ComponentCoding& c : layer->component) {
      if (c.coding != ComponentCodingId::kRaw32) c = ComponentCoding();
    }
  }

  // Codebooks, bases, residual codebooks and entropy chunks, all of which the header names.
  void collect_tables() {
    const auto add = [&](ChunkRef& chunk) {
      tables_.push_back(chunk);
      table_refs_.push_back(&chunk);
    };
    for_each_table(header_.sh, add);
    for (LayerHeader& layer : header_.layers) {
      for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
        for_each_table(layer.component[c], add);
      }
    }
    for (LayerHeader& layer : header_.layers) {
      if (layer.has_entropy) add(layer.entropy);
    }
  }

  // Gives a chunk its place in the payload of the copy.
  void place_piece(ChunkRef* chunk) {
    if (chunk->stored_bytes > 0) payload_.push_back(*chunk);
    chunk->offset = payload_bytes_;
    payload_bytes_ += chunk->stored_bytes;
  }

  // In the order of section 12.1. New offsets go to `plan_`; the pieces keep the old ones.
  Status place_payload() {
    std::vector<PageTask>& tasks = plan_.tasks;
    std::vector<size_t> order(tasks.size());
    for (size_t i = 0; i < order.size(); ++i) order[i] = i;
    const auto place_of = [&](size_t i) {
      return payload_place(header_.layers[tasks[i].layer], tasks[i].record.bucket);
    };
    std::stable_sort(order.begin(), order.end(),
                     [&](size_t a, size_t b) { return place_of(a) < place_of(b); });
    uint64_t made_bytes = 0;
    for (size_t begin = 0, end = 0; begin < order.size(); begin = end) {
      const PageTask& first = tasks[order[begin]];
      for (; end < order.size() && tasks[order[end]].layer == first.layer &&
             tasks[order[end]].record.bucket == first.record.bucket;
           ++end) {
        PageTask& task = tasks[order[end]];
        place_block(task);
        place_piece(&task.record.chunk);
      }
      for (size_t i = begin; i < end; ++i) {
        PageRecord& record = tasks[order[i]].record;
        const auto blank = blanks_.find(order[i]);
        if (blank != blanks_.end()) {
          made_bytes += blank->second.size();
          made_.emplace(payload_.size(), std::move(blank->second));
        }
        if (record.has_sh_detail()) place_piece(&record.sh_detail);
      }
    }
    const uint64_t size = file().source().size();
    for (const ChunkRef& piece : payload_) {
      if (piece.offset <= size && piece.stored_bytes <= size - piece.offset) continue;
      return Status(L4D_ERR_TRUNCATED, "CHNK-1", piece.offset,
                    "a page lies behind the end of the file");
    }
    if (payload_bytes_ - made_bytes <= size) return {};
    return corrupt("CHNK-4", header_.payload_offset, "block codebooks share stored bytes");
  }

  void place_block(const PageTask& task) {
    if (task.record.block == kNoBlock) return;
    const auto [it, added] = blocks_.try_emplace(
        BlockKey{task.layer, task.directory_index, task.record.block}, *task.block());
    if (!added) return;
    for (RcqTableRef& table : it->second.tables) {
      if (table.num_entries > 0) place_piece(&table.chunk);
    }
  }

  Status build_directory() {
    page_tables_.resize(header_.layers.size());
    size_t next = 0;
    for (uint32_t l = 0; l < header_.layers.size(); ++l) {
      if (header_.layers[l].num_gaussians == 0) continue;
      const uint32_t num_pages = num_directory_pages(header_.layers[l]);
      L4D_RETURN_IF_ERROR(
          memory_.take(uint64_t{num_pages} * sizeof(PageTableEntry), "a page table"));
      page_tables_[l].resize(num_pages);
      for (uint32_t d = 0; d < num_pages; ++d) {
        DirectoryPage page;
        std::map<uint32_t, uint32_t> local;  // old block -> block of the copy
        for (; next < plan_.tasks.size() && plan_.tasks[next].layer == l &&
               plan_.tasks[next].directory_index == d;
             ++next) {
          PageRecord record = plan_.tasks[next].record;
          if (record.block != kNoBlock) {
            const auto [it, added] =
                local.emplace(record.block, static_cast<uint32_t>(page.blocks.size()));
            if (added) page.blocks.push_back(blocks_.at({l, d, record.block}));
            record.block = it->second;
          }
          page.pages.push_back(record);
        }
        L4D_RETURN_IF_ERROR(add_directory_page(l, d, page));
      }
    }
    return {};
  }

  Status add_directory_page(uint32_t l, uint32_t d, const DirectoryPage& page) {
    ChunkRef& chunk = page_tables_[l][d].chunk;
    if (!page.pages.empty()) {
      Bytes raw = serialize_directory_page(page, l, d);
      chunk.raw_bytes = static_cast<uint32_t>(raw.size());
      Bytes frame = zstd_.compress(raw);
      if (frame.size() < raw.size()) {
        raw = std::move(frame);
        chunk.codec = static_cast<uint32_t>(ChunkCodec::kZstd);
      }
      chunk.stored_bytes = static_cast<uint32_t>(raw.size());
      chunk.hash = hash64(raw);
      L4D_RETURN_IF_ERROR(memory_.take(raw.size(), "the directory"));
      directory_.push_back({directory_place(header_.layers[l], d), l, d, std::move(raw)});
    }
    meter_.add_directory_page(l, d, PageTableEntry::kBytes + chunk.stored_bytes, &page);
    return {};
  }

  // The size of the header does not depend on numbers in it as long as none becomes zero.
  uint32_t header_bytes() {
    for (LayerHeader& layer : header_.layers) layer.page_table_offset = layer.num_gaussians != 0;
    header_.payload_offset = 1;
    header_.file_bytes = request_.is_member;
    return static_cast<uint32_t>(serialize_scene_header(header_, extensions_).size());
  }

  // A stream that declares a level declares the lowest that the copy keeps to. A tolerant copy
  // declares no profile that it does not keep to.
  void declare() {
    const auto profile = static_cast<ProfileId>(header_.profile);
    if (tolerant_ && (profile_name(header_.profile) == nullptr ||
                      !profile_violation(header_, profile).empty())) {
      header_.profile = static_cast<uint32_t>(profile_of(header_));
    }
    if (header_.conformance_level == 0) return;
    meter_.finish(FileHeader::kBytes + uint64_t{header_bytes()});
    header_.conformance_level = meter_.smallest_level();
  }

  void place_all() {
    head_.version_minor = old_.file_header.version_minor;
    head_.flags = static_cast<uint16_t>(old_.file_header.flags | FileHeader::kStreamableFlag);
    head_.header_bytes = header_bytes();
    uint64_t at = FileHeader::kBytes + head_.header_bytes;
    const auto place = [&](ChunkRef* chunk) {
      chunk->offset = at;
      at += chunk->stored_bytes;
    };
    for (Extension& e : extensions_) place(&e.chunk);
    for (ChunkRef* chunk : table_refs_) place(chunk);
    for (size_t l = 0; l < page_tables_.size(); ++l) {
      if (page_tables_[l].empty()) continue;
      header_.layers[l].page_table_offset = at;
      at += page_tables_[l].size() * PageTableEntry::kBytes;
    }
    std::stable_sort(directory_.begin(), directory_.end(),
                     [](const auto& a, const auto& b) { return a.place < b.place; });
    for (const PlacedPage& page : directory_) place(&page_tables_[page.layer][page.index].chunk);
    header_.payload_offset = at;
    if (request_.is_member) header_.file_bytes = at + payload_bytes_;
  }

  Status write_all() {
    const Bytes scene_header = serialize_scene_header(header_, extensions_);
    if (scene_header.size() != head_.header_bytes) {
      return Status(L4D_ERR_INTERNAL, "the scene header of a copy changed its size");
    }
    head_.header_hash = hash64(scene_header);
    Bytes head;
    head_.append(head);
    L4D_RETURN_IF_ERROR(put(head));
    L4D_RETURN_IF_ERROR(put(scene_header));
    for (const Bytes& bytes : extension_bytes_) L4D_RETURN_IF_ERROR(put(bytes));
    for (const ChunkRef& piece : kept_) L4D_RETURN_IF_ERROR(put_piece(piece));
    for (const ChunkRef& piece : tables_) L4D_RETURN_IF_ERROR(put_piece(piece));
    for (const std::vector<PageTableEntry>& entries : page_tables_) {
      Bytes table;
      for (const PageTableEntry& entry : entries) entry.append(table);
      L4D_RETURN_IF_ERROR(put(table));
    }
    for (const PlacedPage& page : directory_) L4D_RETURN_IF_ERROR(put(page.bytes));
    for (size_t i = 0; i < payload_.size(); ++i) {
      const auto made = made_.find(i);
      L4D_RETURN_IF_ERROR(made == made_.end() ? put_piece(payload_[i]) : put(made->second));
    }
    return {};
  }

  Status put(ByteSpan bytes) {
    written_ += bytes.size();
    return bytes.size() == 0 ? Status() : write_(bytes);
  }
  Status put_piece(const ChunkRef& piece) {
    if (piece.stored_bytes == 0) return {};  // an extension may have no chunk
    MemoryCharge charge(file().memory());
    Bytes storage;
    ByteSpan bytes;
    L4D_RETURN_IF_ERROR(read_stored(file(), piece, &charge, storage, &bytes));
    return put(bytes);
  }

  struct PlacedPage {
    uint64_t place;
    uint32_t layer, index;
    Bytes bytes;
  };

  const CopyRequest& request_;
  const bool tolerant_;
  OpenStream stream_;
  const WriteFn& write_;
  ZstdCompressor zstd_;
  MemberHeader old_;
  FileHeader head_;
  SceneHeader header_;
  Edit edit_;
  std::vector<Extension> extensions_;  // those of extension_bytes_, then those of kept_
  std::vector<Bytes> extension_bytes_;
  std::vector<ChunkRef> kept_, tables_, payload_;  // with their places in what is copied
  std::vector<ChunkRef*> table_refs_;              // in header_, as tables_
  uint64_t payload_bytes_ = 0;
  Plan plan_;
  std::map<size_t, Bytes> blanks_, made_;  // SH chunks by place in the plan, and in payload_
  std::map<BlockKey, BlockRecord> blocks_;
  std::vector<std::vector<PageTableEntry>> page_tables_;
  std::vector<PlacedPage> directory_;
  LevelMeter meter_{header_};
  MemoryBudget budget_;
  MemoryCharge memory_{budget_};
  uint64_t written_ = 0;
};

}  // namespace

Status copy_stream(const l4d_reader& reader, const l4d_decoder_options& given,
                   const CopyRequest& request, const WriteFn& write, uint64_t* bytes) {
  l4d_decoder_options options = given;
  options.accept_needs = 1;
  options.tolerant = 0;  // of headers nothing can be left out
  return StreamCopy(request, options, given.tolerant != 0, write).run(reader, bytes);
}

}  // namespace l4d

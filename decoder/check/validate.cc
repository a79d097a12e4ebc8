// SPDX-License-Identifier: Apache-2.0
// Checks of a whole stream, including those that a decoder need not make.
#include <algorithm>
#include <limits>
#include <map>

#include "decoder/check/conformance.h"
#include "decoder/check/inspection.h"
#include "decoder/expand/page_rules.h"
#include "decoder/read/member_list.h"
#include "decoder/session/decoder.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/container/streamable.h"
#include "libl4dcodec/scene/layers.h"

namespace l4d {
namespace {

// The part of all pages that one of several validators of a stream decodes, and who gets them.
struct PageShare {
  uint64_t index = 0, of = 1;
  const CheckedPageFn* page = nullptr;  // or null
};

class Validator {
 public:
  Validator(SceneFile& file, PageDecoder& pages, const l4d_decoder_options& options,
            const ViolationFn& report, const PageShare& share)
      : file_(file),
        pages_(pages),
        options_(options),
        report_(report),
        share_(share),
        memory_(file.memory()) {}

  // chunks: of extensions.
  Status run(const std::vector<ChunkRef>& chunks) {
    const SceneHeader& header = file_.header();
    Taken taken;
    L4D_RETURN_IF_ERROR(take({0, 0, FileHeader::kBytes, 0, 0}, "the file header", 0, &taken));
    L4D_RETURN_IF_ERROR(
        take({file_.file_header().header_offset, 0, file_.file_header().header_bytes, 0, 0},
             "the scene header", 0, &taken));
    for (const ChunkRef& chunk : chunks) {
      L4D_RETURN_IF_ERROR(take(chunk, "the chunk of an extension", 0, &taken));
    }
    note_shared(taken);
    L4D_RETURN_IF_ERROR(check_codebooks(header.sh, 0, L4D_COMPONENT_SH));
    for (uint32_t l = 0; l < header.layers.size(); ++l) {
      for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
        L4D_RETURN_IF_ERROR(check_codebooks(header.layers[l].component[c], l, c));
      }
      L4D_RETURN_IF_ERROR(advance(0));
      L4D_RETURN_IF_ERROR(check_layer(l));
    }
    check_layout();
    return check_declared();
  }

 private:
  // A range of the file that something refers to.
  struct Range {
    uint64_t end;
    const char* what;
    uint64_t place;  // in the streamable layout
  };
  // How many ranges, of those that were taken with it, share bytes with others, and the first.
  struct Taken {
    uint64_t num_shared = 0;
    uint64_t offset = 0;
    const char* what = nullptr;
    const char* with = nullptr;
  };
  static constexpr uint64_t kBytesPerSpan = 96;  // a node of the map

  // Gaussians are what is counted: their number is known, that of the pages is not.
  Status advance(uint64_t gaussians) {
    done_ += gaussians;
    if (options_.progress == nullptr) return {};
    const uint64_t total = file_.header().num_gaussians;
    if (options_.progress(options_.progress_user, std::min(done_, total), total, "validate") == 0) {
      return {};
    }
    return Status(L4D_ERR_CANCELLED, "cancelled by the progress callback");
  }

  static bool is_of_host(const Status& status) {
    return status.code() == L4D_ERR_IO || status.code() == L4D_ERR_OUT_OF_MEMORY ||
           status.code() == L4D_ERR_LIMIT_EXCEEDED || status.code() == L4D_ERR_CANCELLED;
  }

  // Errors of the stream are reported and passed over; those of the host end the check.
  Status note(Status status) {
    if (status.ok() || is_of_host(status)) return status;
    report_(status);
    return {};
  }

  // Takes the stored bytes of a chunk. What shares bytes with something taken before is counted in
  // *taken, and is not to be read: so each byte of the file is read and decoded once, whatever
  // refers to it.
  Status take(const ChunkRef& chunk, const char* what, uint64_t place, Taken* taken) {
    return take(chunk.offset, chunk.stored_bytes, what, place, taken);
  }
  Status take(uint64_t begin, uint64_t bytes, const char* what, uint64_t place, Taken* taken) {
    if (bytes == 0 || !in_file(begin, bytes)) return {};
    const uint64_t end = begin + bytes;
    const auto next = ranges_.lower_bound(begin);
    const Range* with = nullptr;
    if (next != ranges_.end() && next->first < end) with = &next->second;
    if (next != ranges_.begin() && std::prev(next)->second.end > begin) {
      with = &std::prev(next)->second;
    }
    if (with == nullptr) {
      L4D_RETURN_IF_ERROR(memory_.take(kBytesPerSpan, "the ranges of the file"));
      ranges_.emplace_hint(next, begin, Range{end, what, place});
    } else if (taken->num_shared++ == 0) {
      taken->offset = begin;
      taken->what = what;
      taken->with = with->what;
    }
    return {};
  }
  // One violation for all that were taken together: a directory page can name a page many times.
  void note_shared(const Taken& taken) {
    if (taken.num_shared == 0) return;
    std::string message = std::string(taken.what) + " overlaps " + taken.with;
    if (taken.num_shared > 1) {
      message += ", and " + std::to_string(taken.num_shared - 1) + " more likewise";
    }
    report_(corrupt("CHNK-4", taken.offset, std::move(message)));
  }
  bool in_file(uint64_t offset, uint64_t bytes) const {
    const uint64_t size = file_.source().size();
    return offset <= size && bytes <= size - offset;
  }
  Status beyond_file(const ChunkRef& chunk) const {
    return Status(L4D_ERR_TRUNCATED, "CHNK-1", chunk.offset,
                  std::to_string(chunk.stored_bytes) + " bytes wanted, the file has " +
                      std::to_string(file_.source().size()));
  }

  Status check_codebook(const StageCoding& stage, const char* what, uint32_t layer, unsigned c,
                        unsigned index) {
    const CodebookData* codebook = nullptr;
    Taken taken;
    L4D_RETURN_IF_ERROR(take(stage.codebook, what, kTablesPlace, &taken));
    note_shared(taken);
    if (taken.num_shared > 0) return {};
    return note(file_.codebooks().codebook(layer, c, index, &codebook));
  }

  Status check_codebooks(const ComponentCoding& coding, uint32_t layer, unsigned c) {
    for (unsigned s = 0; s < coding.num_codebooks(); ++s) {
      L4D_RETURN_IF_ERROR(check_codebook(coding.codebook(s), "a codebook", layer, c, s));
    }
    if (!coding.has_rcq) return {};
    return check_codebook(coding.rcq, "a residual codebook", layer, c, CodebookCache::kRcqStage);
  }

  Status check_layer(uint32_t l) {
    const LayerHeader& layer = file_.header().layers[l];
    if (layer.num_gaussians == 0) return {};
    if (layer.has_entropy) {
      const EntropyTables* tables = nullptr;
      Taken taken;
      L4D_RETURN_IF_ERROR(take(layer.entropy, "entropy tables", kTablesPlace, &taken));
      note_shared(taken);
      // Whether the layer may have rANS pages matters where it has one.
      if (taken.num_shared == 0 && rans_codable(file_.header(), layer)) {
        L4D_RETURN_IF_ERROR(note(file_.codebooks().entropy_tables(l, &tables)));
      }
    }
    // Of a table that the file does not hold, what it does hold.
    const uint64_t size = file_.source().size();
    const uint64_t room = size - std::min(size, layer.page_table_offset);
    const uint32_t num_entries = static_cast<uint32_t>(
        std::min<uint64_t>(num_directory_pages(layer), room / PageTableEntry::kBytes));
    Taken taken;
    L4D_RETURN_IF_ERROR(take(layer.page_table_offset, num_entries * PageTableEntry::kBytes,
                             "a page table", kPageTablesPlace, &taken));
    note_shared(taken);
    if (taken.num_shared > 0) return {};
    if (num_entries < num_directory_pages(layer)) {
      report_(Status(L4D_ERR_TRUNCATED, "CHNK-1",
                     layer.page_table_offset + num_entries * PageTableEntry::kBytes,
                     "the file ends within the page table of layer " + std::to_string(l)));
    }
    uint64_t total = 0;
    bool whole = num_entries == num_directory_pages(layer);
    for (uint32_t d = 0; d < num_entries && total <= layer.num_gaussians; ++d) {
      L4D_RETURN_IF_ERROR(check_directory_page(l, d, &total, &whole));
      L4D_RETURN_IF_ERROR(advance(0));
    }
    if (total > layer.num_gaussians || (whole && total < layer.num_gaussians)) {
      report_(corrupt("DIR-5", layer.page_table_offset,
                      "layer " + std::to_string(l) + " holds " +
                          (total > layer.num_gaussians ? "at least " : "") + std::to_string(total) +
                          " Gaussians, its header says " + std::to_string(layer.num_gaussians)));
    }
    return {};
  }

  // Adds to *total; *whole becomes false where the page cannot be read.
  Status check_directory_page(uint32_t l, uint32_t d, uint64_t* total, bool* whole) {
    const LayerHeader& layer = file_.header().layers[l];
    Bytes storage;
    ByteSpan bytes;
    const uint64_t at = layer.page_table_offset + uint64_t{d} * PageTableEntry::kBytes;
    L4D_RETURN_IF_ERROR(file_.source().read(at, PageTableEntry::kBytes, storage, &bytes));
    PageTableEntry entry;
    Status status = PageTableEntry::parse(bytes, at, &entry);
    Taken taken;
    if (status.ok()) {
      L4D_RETURN_IF_ERROR(take(entry.chunk, "a directory page", directory_place(layer, d), &taken));
    }
    note_shared(taken);
    DirectoryPageRef read;
    if (status.ok() && taken.num_shared == 0) status = file_.directory().page(l, d, &read);
    *whole = *whole && status.ok() && taken.num_shared == 0;
    if (!status.ok()) return note(status);
    if (read == nullptr) return {};
    const DirectoryPage& page = read->page;
    check_parts(page);
    Taken parts;
    std::vector<bool> block_is_shared(page.blocks.size());
    const std::vector<uint64_t> block_places = places_of_blocks(layer, d, page);
    for (size_t b = 0; b < page.blocks.size(); ++b) {
      const uint64_t before = parts.num_shared;
      for (const RcqTableRef& t : page.blocks[b].tables) {
        L4D_RETURN_IF_ERROR(take(t.chunk, "a block codebook", block_places[b], &parts));
      }
      block_is_shared[b] = parts.num_shared > before;
    }
    for (const PageRecord& record : page.pages) {
      *total += record.num_gaussians;
      if (*total > layer.num_gaussians) break;
      const uint64_t before = parts.num_shared;
      const uint64_t place = payload_place(layer, record.bucket);
      L4D_RETURN_IF_ERROR(take(record.chunk, "a page", place, &parts));
      L4D_RETURN_IF_ERROR(take(record.sh_detail, "the SH detail of a page", place, &parts));
      const bool shared =
          parts.num_shared > before || (record.block != kNoBlock && block_is_shared[record.block]);
      if (!shared && num_pages_++ % share_.of == share_.index) {
        L4D_RETURN_IF_ERROR(note(check_page(l, d, read, record)));
      }
      L4D_RETURN_IF_ERROR(advance(record.num_gaussians));
    }
    note_shared(parts);
    file_.trim();
    return {};
  }

  bool is_streamable() const {
    return (file_.file_header().flags & FileHeader::kStreamableFlag) != 0;
  }

  // A block codebook lies with the first bucket that uses it, or with the first of all.
  static std::vector<uint64_t> places_of_blocks(const LayerHeader& layer, uint32_t d,
                                                const DirectoryPage& page) {
    std::vector<uint64_t> places(page.blocks.size(), UINT64_MAX);
    for (const PageRecord& record : page.pages) {
      if (record.block == kNoBlock) continue;
      uint64_t& place = places[record.block];
      place = std::min(place, payload_place(layer, record.bucket));
    }
    const uint64_t unused = payload_place(layer, d << layer.directory_bits);
    std::replace(places.begin(), places.end(), UINT64_MAX, unused);
    return places;
  }

  // FILE-7, of the pages of each bucket: base chunks come before SH chunks.
  void check_parts(const DirectoryPage& page) {
    if (!is_streamable()) return;
    const std::vector<PageRecord>& pages = page.pages;
    for (size_t begin = 0, end = 0; begin < pages.size(); begin = end) {
      uint64_t last_base = 0, first_detail = UINT64_MAX;
      for (; end < pages.size() && pages[end].bucket == pages[begin].bucket; ++end) {
        last_base = std::max(last_base, pages[end].chunk.offset);
        if (!pages[end].has_sh_detail()) continue;
        first_detail = std::min(first_detail, pages[end].sh_detail.offset);
      }
      if (first_detail > last_base) continue;
      report_(
          corrupt("FILE-7", first_detail, "an SH chunk lies before a base chunk of its bucket"));
      return;
    }
  }

  // FILE-7, of everything else. Ranges that overlap others are not there.
  void check_layout() {
    if (!is_streamable()) return;
    const auto is_late = [](const auto& a, const auto& b) {
      return a.second.place > b.second.place;
    };
    const auto first = std::adjacent_find(ranges_.begin(), ranges_.end(), is_late);
    if (first == ranges_.end()) return;
    const auto next = std::next(first);
    report_(corrupt("FILE-7", next->first,
                    std::string(next->second.what) + " lies behind " + first->second.what +
                        ", and not as the streamable layout has it"));
  }

  // Decodes one page and holds its Gaussians against the bucket it lies in.
  Status check_page(uint32_t l, uint32_t d, const DirectoryPageRef& directory,
                    const PageRecord& record) {
    for (const ChunkRef* part : {&record.chunk, &record.sh_detail}) {
      if (!in_file(part->offset, part->stored_bytes)) return beyond_file(*part);
    }
    const SceneHeader& header = file_.header();
    const LayerHeader& layer = header.layers[l];
    const size_t n = record.num_gaussians;
    Plan plan;
    l4d_bucket_span range{};
    range.count = n;
    range.center = bucket_center(header.timeline, layer.level, record.bucket);
    range.width = bucket_width(header.timeline, layer.level);
    range.layer = l;
    range.bucket = record.bucket;
    plan.spans.push_back(range);
    PageTask task;
    task.record = record;
    task.layer = l;
    task.directory_index = d;
    if (record.block != kNoBlock) task.directory = directory;
    plan.tasks.push_back(task);
    position_.resize(3 * n);
    mean_.resize(n);
    log_scale_.resize(4 * n);
    rotor_.resize(8 * n);
    opacity_.resize(n);
    sh_.resize(header.sh_dim() * n);
    l4d_gaussian_buffers out{};
    out.position = position_.data();
    out.mean_t_double = mean_.data();
    window_.resize(layer.flat() ? 2 * n : 0);
    out.window = layer.flat() ? window_.data() : nullptr;
    out.log_scale = log_scale_.data();
    out.rotor = rotor_.data();
    out.opacity = opacity_.data();
    out.sh = sh_.data();
    const uint64_t symbols_before = pages_.symbols_decoded();
    L4D_RETURN_IF_ERROR(pages_.expand(plan, 0, 1, out, nullptr, nullptr));
    const uint64_t symbols = pages_.symbols_decoded() - symbols_before;
    if (share_.page != nullptr) {
      (*share_.page)({done_, n, position_.data(), mean_.data(), log_scale_.data(), rotor_.data(),
                      opacity_.data(), sh_.data()});
    }
    return check_page_rules(header, layer, record, range, out, symbols, &slices_);
  }

  // Last, for a directory that cannot be read is reported by then.
  Status check_declared() {
    const SceneHeader& header = file_.header();
    const Status status =
        check_conformance(file_, header.profile, header.conformance_level, report_);
    return is_of_host(status) ? status : Status();
  }

  SceneFile& file_;
  PageDecoder& pages_;
  const l4d_decoder_options& options_;
  const ViolationFn& report_;
  const PageShare share_;
  uint64_t num_pages_ = 0;
  uint64_t done_ = 0;
  MemoryCharge memory_;               // of ranges_
  std::map<uint64_t, Range> ranges_;  // by their begins; none overlaps another
  std::vector<double> mean_;
  std::vector<Slice4D<double>> slices_;  // scratch of check_page_rules
  std::vector<uint32_t> window_;         // [n, 2] of flat layers
  std::vector<float> position_, log_scale_, rotor_, opacity_, sh_;
};

}  // namespace

namespace {

bool ends_the_check(const Status& status) {
  return status.code() == L4D_ERR_IO || status.code() == L4D_ERR_OUT_OF_MEMORY ||
         status.code() == L4D_ERR_LIMIT_EXCEEDED;
}

Status validate_stream(const l4d_reader& reader, const l4d_decoder_options& options,
                       const std::vector<ChunkRef>& chunks, const DecodeKernels& kernels,
                       const PageShare& share, const ViolationFn& report) {
  ByteSource source;
  L4D_RETURN_IF_ERROR(ByteSource::from_reader(reader, &source));
  Decoder decoder(options);
  const Status opened = decoder.open(std::move(source));
  if (!opened.ok()) {
    if (ends_the_check(opened)) return opened;
    report(opened);
    return {};
  }
  PageDecoder pages(decoder.file(), kernels, static_cast<int>(options.threads));
  return Validator(decoder.file(), pages, options, report, share).run(chunks);
}

}  // namespace

Status validate_file(const l4d_reader& reader, const l4d_decoder_options& given,
                     const ViolationFn& report) {
  l4d_decoder_options options = given;
  options.accept_needs = 1;
  ByteSource source;
  L4D_RETURN_IF_ERROR(ByteSource::from_reader(reader, &source));
  MemoryBudget memory;
  if (options.max_memory_bytes > 0) memory.set_limit(options.max_memory_bytes);
  MemberList list(source, memory);
  const Status walked = list.walk();
  if (!walked.ok()) {
    if (ends_the_check(walked)) return walked;
    report(walked);
    return {};
  }
  for (const ListedMember& m : list.members()) {
    MemberHeader header;
    L4D_RETURN_IF_ERROR(list.read_header(m.offset, &header));
    MemberReader member(reader, m.offset, m.bytes);
    const auto report_at = [&](const Status& s) {
      const bool placed = s.offset() != Status::kNoOffset;
      report(placed ? Status(s.code(), s.clause(), m.offset + s.offset(), s.message()) : s);
    };
    // The reference loops: what a validator finds must not depend on the machine.
    L4D_RETURN_IF_ERROR(validate_stream(member.reader(), options, header.chunks,
                                        decode_kernels_reference(), {}, report_at));
  }
  if (!list.rest().ok()) report(list.rest());
  const Status index = list.rest().ok() ? list.check_index() : Status();
  if (ends_the_check(index)) return index;
  if (!index.ok()) report(index);
  return {};
}

Status validate_written(const l4d_reader& reader, int threads, const ViolationFn& report,
                        const CheckedPageFn& page) {
  l4d_decoder_options limits{};
  limits.max_memory_bytes = std::numeric_limits<uint64_t>::max();
  limits.max_gaussians = std::numeric_limits<uint64_t>::max();
  limits.max_frames = kMaxFrames;
  limits.threads = 1;
  limits.accept_needs = 1;
  const size_t shares = static_cast<size_t>(resolve_threads(threads));
  std::vector<Status> done(shares);
  parallel_for(threads, shares, 1, [&](size_t begin, size_t end) {
    for (size_t k = begin; k < end; ++k) {
      done[k] =
          validate_stream(reader, limits, {}, decode_kernels_simd(), {k, shares, &page}, report);
    }
  });
  for (const Status& status : done) L4D_RETURN_IF_ERROR(status);
  return {};
}

}  // namespace l4d

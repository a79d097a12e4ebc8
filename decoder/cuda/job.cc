// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/job.h"

#include <algorithm>

#include "l4d/cuda.h"
#include "libl4dcodec/base/checked.h"
#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/container/page.h"
#include "libl4dcodec/entropy/rans.h"

namespace l4d::cuda {
namespace {

// Neighbouring parts are read in one call where no more than this lies between them, and no more
// than this at a time.
constexpr uint64_t kMaxReadGap = 4096;
constexpr uint64_t kMaxReadBytes = uint64_t{32} << 20;
// Kernels take blocks and books from multiples of this, and arrays of the workspace from whole
// lines.
constexpr uint64_t kPartAlignment = 16;
constexpr uint64_t kLine = 256;
// Columns of a page begin where those of a warp do.
constexpr uint32_t kSlotAlignment = 32;

// Appends `bytes` at a multiple of `alignment` and tells where.
uint64_t place(uint64_t bytes, uint64_t alignment, uint64_t* end) {
  const uint64_t at = align_up(*end, alignment);
  *end = at + bytes;
  return at;
}

template <typename T>
void put(const std::vector<T>& values, uint64_t at, unsigned char* staging) {
  std::copy_n(reinterpret_cast<const unsigned char*>(values.data()), values.size() * sizeof(T),
              staging + at);
}

// The first failure in the order of the parts.
Status first_failure(std::vector<Status>& all) {
  const auto failed = std::find_if(all.begin(), all.end(), [](const Status& s) { return !s.ok(); });
  return failed == all.end() ? Status() : std::move(*failed);
}

}  // namespace

Status Job::prepare(const l4d_query& query, uint32_t attributes, uint32_t forms) {
  file_.begin_query();
  charge_ = std::make_unique<MemoryCharge>(file_.memory());
  L4D_RETURN_IF_ERROR(make_plan(file_, query, nullptr, &plan_));
  const bool expands = (forms & L4D_CUDA_FORM_EXPANDED) != 0;
  const bool packs = (forms & L4D_CUDA_FORM_PACKED) != 0;
  // Codebooks are not asked for by those who keep the indices.
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    wants_[c] = expands && (attributes & component_attribute(c)) != 0;
  }
  with_detail_ = (attributes & L4D_CUDA_SH) != 0 && plan_.detail == L4D_DETAIL_FULL;
  L4D_RETURN_IF_ERROR(add_pages());
  L4D_RETURN_IF_ERROR(tables_.update());
  host_.find(plan_);
  if (packs) L4D_RETURN_IF_ERROR(host_.pack(plan_, attributes, charge_.get()));
  if (!packs) may_have_literals_ = false;
  number_pieces();
  choose_warps();
  L4D_RETURN_IF_ERROR(lay_out());
  L4D_RETURN_IF_ERROR(fill_staging());
  return expands ? host_.expand(plan_, attributes, charge_.get()) : Status();
}

Status Job::add_pages() {
  const SceneHeader& header = file_.header();
  page_tasks_.clear();
  pages_.clear();
  expands_.clear();
  parts_.clear();
  books_.clear();
  book_of_.clear();
  num_slots_ = 0;
  num_states_ = 0;
  may_have_literals_ = false;
  for (size_t t = 0; t < plan_.tasks.size(); ++t) {
    const PageTask& task = plan_.tasks[t];
    const PageRecord& record = task.record;
    const uint32_t n = record.num_gaussians;
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      may_have_literals_ |= header.component(header.layers[task.layer], c).literals;
    }
    if (!is_device_page(record)) continue;
    L4D_RETURN_IF_ERROR(tables_.load(task.layer, wants_));
    const EntropyTables* entropy = nullptr;
    L4D_RETURN_IF_ERROR(file_.codebooks().entropy_tables(task.layer, &entropy));
    const bool detail = record.has_sh_detail() && with_detail_;
    const bool whole = detail || !record.has_sh_detail();
    const l4d_range& range = plan_.ranges[task.range];
    DevicePage page{};
    page.first = task.first;
    page.center = range.center;
    page.width = static_cast<float>(range.width);
    page.slot = static_cast<uint32_t>(num_slots_);
    page.state = static_cast<uint32_t>(num_states_);
    page.n = n;
    page.layer = task.layer;
    page.part_bytes[0] = record.chunk.stored_bytes;
    page.part_bytes[1] = detail ? record.sh_detail.stored_bytes : 0;
    page.middle =
        static_cast<uint32_t>(record.has_sh_detail() ? first_detail_plane(header, entropy->planes)
                                                     : entropy->planes.size());
    page.sh_limit = whole ? kMaxCoefficients : header.sh_base;
    page.has_sh = whole || header.sh_base > 0;
    L4D_RETURN_IF_ERROR(add_books(task, &page));
    const uint32_t index = static_cast<uint32_t>(pages_.size());
    parts_.push_back({record.chunk, index, 0});
    if (detail) parts_.push_back({record.sh_detail, index, 1});
    for (uint32_t first = 0; first < n; first += kExpandGaussians) {
      expands_.push_back({index, first});
    }
    pages_.push_back(page);
    page_tasks_.push_back(t);
    num_slots_ += align_up(n, kSlotAlignment);
    num_states_ += align_up(n, kSlotAlignment) + kStatesBehind;
  }
  if (num_states_ > UINT32_MAX) {
    return Status(L4D_ERR_LIMIT_EXCEEDED, "the query selects more Gaussians than one decode takes");
  }
  return {};
}

Status Job::add_books(const PageTask& task, DevicePage* page) {
  const SceneHeader& header = file_.header();
  const LayerHeader& layer = header.layers[task.layer];
  const BlockRecord* const block = task.block();
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    page->book[c] = kNoBook;
    page->stage0_entries[c] = stage0_entries(header, layer, c, block);
    if (!wants_[c] || block == nullptr || block->tables[c].num_entries == 0) continue;
    const BlockKey key{task.layer, task.directory_index, task.record.block, c};
    const auto known = book_of_.find(key);
    if (known != book_of_.end()) {
      page->book[c] = known->second;
      continue;
    }
    const CodebookData* book = nullptr;
    L4D_RETURN_IF_ERROR(
        file_.codebooks().block_codebook(task.block_id(), c, block->tables[c], &book));
    // Until lay_out(), its place in the list.
    page->book[c] = book_of_[key] = books_.size();
    books_.emplace_back(book, 0);
  }
  return {};
}

// Pages of a layer share its tables, which a block of threads keeps in shared memory; as long as
// there are fewer pages than multiprocessors each gets one for itself. Long pages go first, and
// beside others as long.
void Job::choose_warps() {
  warps_.clear();
  blocks_.clear();
  planes_launch_ = {};
  const bool apart = file_.header().sh.vq();  // SH needs nothing of the first part
  const auto cost = [&](const WarpTask& w) {
    const DevicePage& page = pages_[w.page];
    return uint64_t{(w.parts & 1) != 0 ? page.part_bytes[0] : 0} +
           ((w.parts & 2) != 0 ? page.part_bytes[1] : 0);
  };
  for (uint32_t p = 0; p < pages_.size(); ++p) {
    const bool detail = pages_[p].part_bytes[1] != 0;
    warps_.push_back({p, detail && !apart ? 3u : 1u});
    if (detail && apart) warps_.push_back({p, 2u});
  }
  if (warps_.empty()) return;
  std::stable_sort(warps_.begin(), warps_.end(), [&](const WarpTask& a, const WarpTask& b) {
    const uint32_t la = pages_[a.page].layer, lb = pages_[b.page].layer;
    return la != lb ? la < lb : cost(a) > cost(b);
  });
  const size_t each = (warps_.size() + multiprocessors_ - 1) / multiprocessors_;
  // Of blocks that leave room for another one beside them, small ones: the device takes the next
  // one as soon as one has ended.
  const auto shared_bytes = [&](uint32_t block_pages) {
    uint32_t most = 0;
    for (const WarpTask& w : warps_) {
      const DeviceLayer& layer = tables_.layers()[pages_[w.page].layer];
      most = std::max(most, planes_shared_bytes(layer, block_pages));
    }
    return most;
  };
  const bool large = 2 * shared_bytes(kFewBlockPages) > kSharedBytes &&
                     shared_bytes(kMaxBlockPages) <= kSharedBytes;
  planes_launch_.block_pages =
      static_cast<uint32_t>(std::min<size_t>(each, large ? kMaxBlockPages : kFewBlockPages));
  planes_launch_.shared_bytes = shared_bytes(planes_launch_.block_pages);
  for (uint32_t w = 0; w < warps_.size(); ++w) {
    const uint32_t layer = pages_[warps_[w].page].layer;
    if (blocks_.empty() || blocks_.back().layer != layer ||
        blocks_.back().count == planes_launch_.block_pages) {
      blocks_.push_back({layer, w, 0});
    }
    ++blocks_.back().count;
  }
  std::stable_sort(blocks_.begin(), blocks_.end(), [&](const BlockTask& a, const BlockTask& b) {
    return cost(warps_[a.first]) > cost(warps_[b.first]);
  });
  planes_launch_.num_blocks = static_cast<uint32_t>(blocks_.size());
}

void Job::number_pieces() {
  const SceneHeader& header = file_.header();
  host_pieces_.clear();
  num_pieces_ = 0;
  if (!may_have_literals_) return;
  size_t page = 0;
  const auto number_until = [&](size_t task) {
    for (; page < pages_.size() && page_tasks_[page] < task; ++page) {
      pages_[page].piece = num_pieces_;
      num_pieces_ += (pages_[page].n + kExpandGaussians - 1) / kExpandGaussians;
    }
  };
  for (const HostRun& run : host_.runs()) {
    number_until(run.first_task);
    HostPiece piece{};
    piece.piece = num_pieces_++;
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      piece.at[c] = run.literal_at[c] * sizeof(uint16_t);  // until lay_out(), among all literals
      piece.rows[c] = run.literal_rows[c];
      piece.dim[c] = header.component_dim(header.layers[run.layer], c);
    }
    host_pieces_.push_back(piece);
  }
  number_until(plan_.tasks.size());
}

// Columns of values that component c needs in the layers at hand.
unsigned Job::value_columns(unsigned c) const {
  const SceneHeader& header = file_.header();
  unsigned most = 0;
  for (const DevicePage& page : pages_) {
    if (c == L4D_COMPONENT_SH && page.has_sh == 0) continue;
    const LayerHeader& layer = header.layers[page.layer];
    const ComponentCoding& coding = header.component(layer, c);
    unsigned columns = static_cast<unsigned>(coding.stages.size());
    if (coding.literals) columns += header.component_dim(layer, c);
    if (coding.transform()) columns = coding.coefficients();
    if (c == L4D_COMPONENT_SH && coding.transform()) columns = std::min(columns, page.sh_limit);
    most = std::max(most, columns);
  }
  return most;
}

Status Job::lay_out() {
  const SceneHeader& header = file_.header();
  uint64_t end = 0;
  place(pages_.size() * sizeof(DevicePage), kLine, &end);  // at 0
  warps_at_ = place(warps_.size() * sizeof(WarpTask), kLine, &end);
  blocks_at_ = place(blocks_.size() * sizeof(BlockTask), kLine, &end);
  expands_at_ = place(expands_.size() * sizeof(ExpandTask), kLine, &end);
  faults_at_ = place(2 * pages_.size() * sizeof(uint32_t), kLine, &end);
  num_literals_at_ = place(kNumLiteralsBytes, sizeof(uint64_t), &end);
  host_pieces_at_ = place(host_pieces_.size() * sizeof(HostPiece), kLine, &end);
  host_literals_at_ = place(host_.literals().size() * sizeof(uint16_t), kLine, &end);
  for (HostPiece& piece : host_pieces_) {
    for (uint64_t& at : piece.at) at += host_literals_at_;
  }
  for (auto& [book, at] : books_) at = place(book->memory_bytes(), kPartAlignment, &end);
  for (DevicePage& page : pages_) {
    for (uint64_t& book : page.book) {
      if (book != kNoBook) book = books_[static_cast<size_t>(book)].second;
    }
  }
  for (const Part& part : parts_) {
    pages_[part.page].part_at[part.part] = place(part.chunk.stored_bytes, kPartAlignment, &end);
  }
  const bool idle = pages_.empty() && num_pieces_ == 0;
  staging_bytes_ = idle ? 0 : end;
  const uint64_t sums = uint64_t{num_pieces_} * L4D_COMPONENT_COUNT;
  literals_at_ = place(sums * sizeof(LiteralSum), kLine, &end);
  const auto column = [&](uint64_t bytes) { return place(num_slots_ * bytes, kLine, &end); };
  columns_.morton = column(sizeof(uint64_t));
  columns_.mean_t = column(sizeof(uint16_t));
  columns_.mean_t_fine = column(sizeof(uint16_t));
  columns_.opacity = column(sizeof(uint16_t));
  columns_.scale_factor = column(sizeof(uint16_t));
  columns_.state = place((header.sh.vq() ? 2 : 1) * num_states_ * sizeof(uint32_t), kLine, &end);
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    columns_.component[c].head = place(num_slots_ + kStatesBehind, kLine, &end);
    columns_.component[c].rung = column(1);
    columns_.component[c].value = column(value_columns(c) * sizeof(uint16_t));
  }
  workspace_bytes_ = idle ? 0 : align_up(end, kLine);
  expand_launch_.num_blocks = static_cast<uint32_t>(expands_.size());
  expand_launch_.sh_dim = header.sh_dim();
  expand_launch_.sh_transform = header.sh.transform();
  return {};
}

Status Job::check_part(const Part& part, ByteSpan bytes) const {
  const bool detail = part.part == 1;
  const auto check_hash = [&]() -> Status {
    if (hash64(bytes) == part.chunk.hash) return {};
    return Status(L4D_ERR_CHECKSUM, "CHNK-2", part.chunk.offset,
                  detail ? "checksum of the SH detail of a page does not match"
                         : "checksum of a page does not match");
  };
  if (!detail) L4D_RETURN_IF_ERROR(check_hash());
  if (part.chunk.raw_bytes != part.chunk.stored_bytes) {
    return corrupt("CHNK-3", part.chunk.offset, "rANS page whose sizes differ");
  }
  if (part.chunk.stored_bytes > max_page_bytes(file_.header(), pages_[part.page].n)) {
    return corrupt("CHNK-8", part.chunk.offset, "rANS page longer than its content can be");
  }
  if (detail) L4D_RETURN_IF_ERROR(check_hash());
  RansLanes lanes;
  return open_rans_block(bytes, part.chunk.offset, &lanes);
}

Status Job::fill_staging() {
  if (staging_bytes_ == 0) return {};
  L4D_RETURN_IF_ERROR(charge_->take(staging_bytes_, "the upload of a decode"));
  L4D_RETURN_IF_ERROR(staging_.reserve(static_cast<size_t>(staging_bytes_)));
  unsigned char* to = staging_.as<unsigned char>();
  std::fill_n(to, num_literals_at_ + kNumLiteralsBytes, static_cast<unsigned char>(0));
  put(pages_, 0, to);
  put(warps_, warps_at_, to);
  put(blocks_, blocks_at_, to);
  put(expands_, expands_at_, to);
  put(host_pieces_, host_pieces_at_, to);
  put(host_.literals(), host_literals_at_, to);
  for (const auto& [book, at] : books_) put(book->entries, at, to);

  std::vector<size_t> order(parts_.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    return parts_[a].chunk.offset < parts_[b].chunk.offset;
  });
  const bool skips_detail = std::any_of(pages_.begin(), pages_.end(), [&](const DevicePage& p) {
    return p.part_bytes[1] == 0 && p.middle != tables_.layers()[p.layer].num_planes;
  });
  // What lies between may be the very parts that are not wanted.
  const uint64_t max_gap = skips_detail ? 0 : kMaxReadGap;
  std::vector<Status> status(parts_.size());
  // Neighbouring parts are read together.
  for (size_t i = 0; i < order.size();) {
    const uint64_t begin = parts_[order[i]].chunk.offset;
    uint64_t end = begin + parts_[order[i]].chunk.stored_bytes;
    size_t last = i + 1;
    for (; last < order.size(); ++last) {
      const ChunkRef& next = parts_[order[last]].chunk;
      if (next.offset < end || next.offset - end > max_gap) break;
      if (next.offset + next.stored_bytes - begin > kMaxReadBytes) break;
      end = next.offset + next.stored_bytes;
    }
    MemoryCharge charge(file_.memory());
    L4D_RETURN_IF_ERROR(charge.take(end - begin, "a batch of pages"));
    ByteSpan run;
    L4D_RETURN_IF_ERROR(file_.source().read(begin, end - begin, read_buffer_, &run));
    parallel_for(threads_, last - i, 4, [&](size_t a, size_t b) {
      for (size_t k = i + a; k < i + b; ++k) {
        const Part& part = parts_[order[k]];
        const ByteSpan bytes =
            run.subspan(static_cast<size_t>(part.chunk.offset - begin), part.chunk.stored_bytes);
        status[order[k]] = check_part(part, bytes);
        std::copy(bytes.begin(), bytes.end(), to + pages_[part.page].part_at[part.part]);
      }
    });
    i = last;
  }
  return first_failure(status);
}

DeviceJob Job::device_job(unsigned char* workspace) const {
  DeviceJob job{};
  job.layers = tables_.device_layers();
  job.upload = workspace;
  job.pages = reinterpret_cast<const DevicePage*>(workspace);
  job.warps = reinterpret_cast<const WarpTask*>(workspace + warps_at_);
  job.blocks = reinterpret_cast<const BlockTask*>(workspace + blocks_at_);
  job.expands = reinterpret_cast<const ExpandTask*>(workspace + expands_at_);
  job.faults = reinterpret_cast<uint32_t*>(workspace + faults_at_);
  job.host_pieces = reinterpret_cast<const HostPiece*>(workspace + host_pieces_at_);
  job.literals = reinterpret_cast<LiteralSum*>(workspace + literals_at_);
  job.num_literals = reinterpret_cast<uint64_t*>(workspace + num_literals_at_);
  job.num_expands = static_cast<uint32_t>(expands_.size());
  job.num_host_pieces = static_cast<uint32_t>(host_pieces_.size());
  job.num_pieces = num_pieces_;
  Columns& to = job.columns;
  to.morton = reinterpret_cast<uint64_t*>(workspace + columns_.morton);
  to.mean_t = reinterpret_cast<uint16_t*>(workspace + columns_.mean_t);
  to.mean_t_fine = reinterpret_cast<uint16_t*>(workspace + columns_.mean_t_fine);
  to.opacity = reinterpret_cast<uint16_t*>(workspace + columns_.opacity);
  to.scale_factor = reinterpret_cast<uint16_t*>(workspace + columns_.scale_factor);
  to.state = reinterpret_cast<uint32_t*>(workspace + columns_.state);
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    to.component[c] = {workspace + columns_.component[c].head,
                       workspace + columns_.component[c].rung,
                       reinterpret_cast<uint16_t*>(workspace + columns_.component[c].value)};
  }
  to.stride = static_cast<size_t>(num_slots_);
  to.state_stride = static_cast<size_t>(num_states_);
  return job;
}

Status Job::check(const uint32_t* faults) const {
  struct Meaning {
    const char* clause;
    const char* message;
  };
  // By PageFault.
  static constexpr Meaning kMeanings[] = {
      {"", ""},
      {"RANS-7", "a rANS block does not end with its words and in its first state"},
      {"RANS-8", "a position is outside its range"},
      {"STRM-3", "a code is not below its limit"},
      {"VAL-1", "a coded value is not finite"},
      {"VAL-2", "a coded value is not finite"},
      {"VQ-1", "a depth is above the number of stages"},
      {"VQ-2", "an index is not below the number of codewords"},
      {"TRAN-5", "a class is not below the number of classes"},
      {"TRAN-6", "a rung is above the ladder"},
  };
  for (size_t i = 0; i < 2 * pages_.size(); ++i) {
    if (faults[i] == kPageOk) continue;
    if (faults[i] >= std::size(kMeanings)) {
      return Status(L4D_ERR_INTERNAL, "the device tells an unknown fault of a page");
    }
    const PageRecord& record = plan_.tasks[page_tasks_[i / 2]].record;
    return corrupt(kMeanings[faults[i]].clause,
                   i % 2 == 0 ? record.chunk.offset : record.sh_detail.offset,
                   kMeanings[faults[i]].message);
  }
  return {};
}

}  // namespace l4d::cuda

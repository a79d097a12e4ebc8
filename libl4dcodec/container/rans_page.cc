// SPDX-License-Identifier: Apache-2.0
// Pages whose channels are coded by rANS (spec: "rANS pages").
#include <algorithm>
#include <array>

#include "l4d/experimental/inspect.h"
#include "libl4dcodec/base/ordered.h"
#include "libl4dcodec/container/page_columns.h"

namespace l4d {
namespace {

// Values are known to fit.
template <typename From, typename To>
void narrow(const From* src, size_t n, To* dst) {
  for (size_t i = 0; i < n; ++i) dst[i] = static_cast<To>(src[i]);
}

// A page whose channels are taken one after the other: next() prepares what one takes from the
// lanes, task() or take_wide() takes it, and done() checks it and turns it into columns.
class RansPageParser {
 public:
  RansPageParser(const SceneHeader& header, const LayerHeader& layer, const EntropyTables& tables,
                 const PageWants& wants, RansPage& page)
      : d_(*page.decoder),
        header_(header),
        layer_(layer),
        tables_(tables),
        wants_(wants),
        page_(page),
        out_(*page.out),
        n_(page.n),
        status_(&page.status) {
    out_.n = n_;
    out_.symbols = 0;
    out_.sh_detail = !page.parts.has_detail;
    for (ComponentColumns& c : out_.component) {
      c.index_count.fill(0);
      c.num_escapes = 0;
      c.coefficient_count.fill(0);
    }
    const size_t channels = tables_.channels.size();
    middle_ = page.parts.has_detail ? first_detail_channel(header_, tables_.channels) : channels;
    start_block(page.parts.first, page.parts.first_at, 0, middle_);
  }

  // False behind the last channel, and where the page is damaged.
  bool next() {
    while (status_->ok() && channel_ == last_) {
      if (last_ == end_ && !rans_block_finished(lanes_)) {
        *status_ = corrupt("RANS-7", at_,
                           "a rANS block does not end with its words and in its first state");
      } else if (page_.detail == nullptr || status_ == page_.detail) {
        return false;
      } else {
        status_ = page_.detail;
        start_block(page_.parts.detail, page_.parts.detail_at, middle_, tables_.channels.size());
      }
      // What became of the SH chunk, at its start and at its end.
      if (status_ == page_.detail) out_.sh_detail = status_->ok();
    }
    if (status_->ok()) prepare(channel_);
    return status_->ok();
  }

  size_t channel() const { return channel_; }
  bool is_wide() const { return tables_.channels[channel_].kind == ChannelKind::kPosition; }
  RansHybridTask& task() { return task_; }
  // The tables of the channel at hand, for task() and take_wide().
  const uint32_t* tables() const { return entries_; }
  void take_wide() { d_.kernels->wide(lanes_, entries_, nullptr, n_, d_.wide.data()); }

  void done() {
    *status_ = finish(channel_);
    if (status_ == page_.detail) out_.sh_detail = status_->ok();
    if (page_.sections != nullptr) {
      (*page_.sections)[section_of(tables_.channels[channel_])] +=
          static_cast<uint64_t>(lanes_.next - counted_);
      counted_ = lanes_.next;
    }
    ++channel_;
  }

 private:
  // Channels behind the last one that is wanted stay coded.
  void start_block(ByteSpan block, uint64_t at, size_t first, size_t end) {
    at_ = at;
    *status_ = open_rans_block(block, at_, &lanes_);
    counted_ = lanes_.next;
    channel_ = first;
    last_ = end_ = end;
    while (page_.sections == nullptr && last_ > first && !wanted(tables_.channels[last_ - 1])) {
      --last_;
    }
  }

  bool wanted(const ChannelSpec& p) const {
    switch (p.kind) {
      case ChannelKind::kPosition:
        return wants_.position;
      case ChannelKind::kMeanT:
      case ChannelKind::kMeanTFine:
      case ChannelKind::kWindow:
        return wants_.mean_t;
      case ChannelKind::kOpacity:
        return wants_.opacity;
      case ChannelKind::kScaleFactor:
        return wants_.scale;
      default:
        break;
    }
    if (p.component == L4D_COMPONENT_SH) return wants_.sh;
    return p.component == L4D_COMPONENT_SCALE ? wants_.scale : wants_.rotor;
  }

  static unsigned section_of(const ChannelSpec& p) {
    switch (p.kind) {
      case ChannelKind::kPosition:
        return L4D_SECTION_POSITION;
      case ChannelKind::kMeanT:
      case ChannelKind::kMeanTFine:
      case ChannelKind::kWindow:
        return L4D_SECTION_MEAN_T;
      case ChannelKind::kOpacity:
        return L4D_SECTION_OPACITY;
      case ChannelKind::kScaleFactor:
        return L4D_SECTION_SCALE_FACTOR;
      default:
        return L4D_SECTION_SH + p.component;
    }
  }

  // Channel p takes `count` values to dst, with a context for each where it has more than one; they
  // are below `limit`.
  void take(size_t p, const uint8_t* contexts, size_t count, uint16_t* dst,
            size_t limit = kMaxEntropyTables) {
    out_.symbols += count;
    const std::vector<uint8_t>& map = tables_.maps[p];
    const bool one = std::all_of(map.begin(), map.end(), [&](uint8_t t) { return t == map[0]; });
    task_ = {&lanes_, nullptr, count, dst};
    entries_ = tables_.entries.data();
    if (contexts == nullptr || one) {
      entries_ += size_t{map[0]} * kRansSlots;
      return;
    }
    grow(d_.tables, count);
    std::array<uint8_t, kMaxEntropyTables> padded{};
    std::copy(map.begin(), map.end(), padded.begin());
    d_.streams->map_bytes(padded.data(), std::min(map.size(), limit), contexts, count,
                          d_.tables.data());
    task_.contexts = d_.tables.data();
  }
  void take(size_t p, size_t count, std::vector<uint16_t>* dst) {
    grow(*dst, count);
    take(p, nullptr, count, dst->data());
  }

  // Of what the channel at hand has taken.
  Status below(uint32_t limit, const char* clause, uint32_t* found = nullptr) const {
    if (limit > 0xffff) return {};
    const uint32_t largest = d_.streams->max_value(task_.dst, task_.count);
    if (found != nullptr) *found = largest;
    if (largest < limit) return {};
    return corrupt(clause, at_,
                   "value " + std::to_string(largest) + " is not below " + std::to_string(limit));
  }

  void prepare(size_t p) {
    const ChannelSpec& spec = tables_.channels[p];
    ComponentColumns& c = out_.component[spec.component];
    switch (spec.kind) {
      case ChannelKind::kPosition:
        grow(d_.wide, n_);
        out_.symbols += n_;
        entries_ = tables_.entries.data() + size_t{tables_.maps[p][0]} * kRansSlots;
        break;
      case ChannelKind::kMeanT:
        take(p, n_, &out_.mean_t);
        break;
      case ChannelKind::kMeanTFine:
        take(p, n_, &out_.mean_t_fine);
        break;
      case ChannelKind::kWindow:
        take(p, n_, &out_.window[spec.index]);
        break;
      case ChannelKind::kOpacity:
        take(p, n_, &out_.opacity);
        break;
      case ChannelKind::kScaleFactor:
        take(p, n_, &out_.scale_factor);
        break;
      case ChannelKind::kDepth:
        take(p, n_, &d_.codes);
        break;
      case ChannelKind::kIndex:
        if (!header_.component(layer_, spec.component).has_depth()) c.index_count[spec.index] = n_;
        take(p, c.index_count[spec.index], &c.index[spec.index]);
        break;
      case ChannelKind::kEscape:
        take(p, c.num_escapes, &d_.codes);
        break;
      case ChannelKind::kStepExponent: {
        grow(d_.codes, n_);
        grow(d_.step_exponent, n_);
        const ComponentColumns* before = step_exponent_component_;
        if (before == nullptr) std::fill_n(d_.step_exponent.begin(), n_, uint8_t{0});
        take(p, before == nullptr ? d_.step_exponent.data() : before->step_exponent.data(), n_,
             d_.codes.data(), step_exponents_);
        break;
      }
      case ChannelKind::kEobIndex:
        grow(d_.codes, n_);
        take(p, c.step_exponent.data(), n_, d_.codes.data(), step_exponents_);
        break;
      case ChannelKind::kCoefficient:
        prepare_coefficient(p, c, header_.component(layer_, spec.component), spec.index);
        break;
    }
  }

  Status finish(size_t p) {
    const ChannelSpec& spec = tables_.channels[p];
    ComponentColumns& c = out_.component[spec.component];
    const ComponentCoding& coding = header_.component(layer_, spec.component);
    switch (spec.kind) {
      case ChannelKind::kPosition:
        return positions();
      case ChannelKind::kMeanT:
        L4D_RETURN_IF_ERROR(below(1u << layer_.mean_t_width(), "STRM-3"));
        return finish_mean_t(layer_, *d_.streams, n_, at_, out_.mean_t.data());
      case ChannelKind::kMeanTFine:
        return {};
      case ChannelKind::kWindow:
        return below(1u << layer_.window_width(spec.index), "STRM-3");
      case ChannelKind::kOpacity:
        return below(1u << header_.opacity.bits, "STRM-3");
      case ChannelKind::kScaleFactor:
        return below(1u << layer_.scale_factor.bits, "STRM-3");
      case ChannelKind::kDepth:
        grow(c.depth, n_);
        return count_depths(coding, d_.codes.data(), n_, at_, &c);
      case ChannelKind::kIndex:
        return below(spec.index == 0 ? stage0_entries(header_, layer_, spec.component, page_.block)
                                     : coding.stages[spec.index].num_entries,
                     "VQ-2");
      case ChannelKind::kEscape:
        return escapes(spec);
      case ChannelKind::kStepExponent:
        return step_exponents(coding, c);
      case ChannelKind::kEobIndex:
        grow(c.eob_index, n_);
        L4D_RETURN_IF_ERROR(below(static_cast<uint32_t>(coding.eob_table.size() + 1), "TRAN-6"));
        narrow(d_.codes.data(), n_, c.eob_index.data());
        return {};
      case ChannelKind::kCoefficient:
        c.coefficient_count[spec.index] = members_;
        grow(c.coefficient[spec.index], members_ + kCoefficientPadding);
        d_.before.swap(d_.last);
        d_.streams->unzigzag(d_.codes.data(), members_, c.coefficient[spec.index].data(),
                             d_.last.data());
        return {};
    }
    return {};
  }

  Status positions() {
    const bool fixed = header_.position == CoordinateCodingId::kFixed;
    const unsigned bits = fixed ? header_.position_bits : 16;
    uint64_t code = 0, above = 0;
    for (size_t i = 0; i < n_; ++i) {
      code += d_.wide[i];
      // Each gap is below 2^63: a sum that passes 2^63 sets the top bit before it can wrap.
      above |= code;
      code &= ~uint64_t{0} >> 1;
      d_.wide[i] = code;
    }
    if ((above >> (3 * bits)) != 0) {
      return corrupt("RANS-8", at_, "a position is outside its range");
    }
    if (fixed) {
      uint32_t* columns[3];
      for (size_t axis = 0; axis < 3; ++axis) {
        grow(out_.fixed_position[axis], n_);
        columns[axis] = out_.fixed_position[axis].data();
      }
      d_.streams->split_morton(d_.wide.data(), n_, columns);
      return {};
    }
    constexpr size_t kBlock = 256;
    uint32_t block[3][kBlock];
    uint32_t* const columns[3] = {block[0], block[1], block[2]};
    for (auto& column : out_.position) grow(column, n_);
    for (size_t i = 0; i < n_; i += kBlock) {
      const size_t count = std::min(kBlock, n_ - i);
      d_.streams->split_morton(d_.wide.data() + i, count, columns);
      for (size_t axis = 0; axis < 3; ++axis) {
        narrow(block[axis], count, out_.position[axis].data() + i);
      }
    }
    for (auto& column : out_.position) {
      if (d_.streams->unorder_halves(column.data(), n_) >= 0x7c00u) {
        return corrupt("VAL-1", at_, "a coded value is not finite");
      }
    }
    return {};
  }

  Status escapes(const ChannelSpec& spec) {
    ComponentColumns& c = out_.component[spec.component];
    const size_t dim = header_.component_dim(layer_, spec.component);
    const size_t count = c.num_escapes;
    if (d_.streams->unorder_halves(d_.codes.data(), count) >= 0x7c00u) {
      return corrupt("VAL-2", at_, "a coded value is not finite");
    }
    grow(c.escape, count * dim);
    for (size_t i = 0; i < count; ++i) c.escape[i * dim + spec.index] = d_.codes[i];
    return {};
  }

  Status step_exponents(const ComponentCoding& coding, ComponentColumns& c) {
    uint32_t largest = 0;
    L4D_RETURN_IF_ERROR(below(kTransformStepExponents, "TRAN-5", &largest));
    step_exponents_ = largest + 1;
    grow(c.step_exponent, n_);
    narrow(d_.codes.data(), n_, c.step_exponent.data());
    step_exponent_component_ = &c;
    if (coding.eob_table.size() > 1) return {};
    grow(c.eob_index, n_);
    std::fill_n(c.eob_index.begin(), n_, uint8_t{1});
    return {};
  }

  void prepare_coefficient(size_t p, const ComponentColumns& c, const ComponentCoding& coding,
                           unsigned k) {
    if (k == 0) {
      step_ = 0;
      members_ = n_;
      d_.step_exponent.assign(c.step_exponent.begin(),
                              c.step_exponent.begin() + static_cast<std::ptrdiff_t>(n_));
      d_.eob_index.assign(c.eob_index.begin(),
                          c.eob_index.begin() + static_cast<std::ptrdiff_t>(n_));
      d_.last.assign(n_, 0);
      d_.before.assign(n_, 0);
      compact();
    } else if (k == coding.eob_table[step_]) {
      ++step_;
      compact();
    }
    const uint8_t* contexts = d_.step_exponent.data();
    if (k > 0) {
      grow(d_.contexts, members_);
      d_.streams->coefficient_contexts(d_.step_exponent.data(), d_.last.data(), d_.before.data(),
                                       members_, d_.contexts.data());
      contexts = d_.contexts.data();
    }
    grow(d_.codes, members_);
    take(p, contexts, members_, d_.codes.data(),
         k > 0 ? kMagnitudes * step_exponents_ : step_exponents_);
  }

  // Leaves those Gaussians whose EOB index reaches the step at hand.
  void compact() {
    uint8_t* const arrays[] = {d_.eob_index.data(), d_.step_exponent.data(), d_.last.data(),
                               d_.before.data()};
    members_ = d_.streams->keep_above(arrays, 4, members_, static_cast<uint8_t>(step_));
  }

  RansDecoder& d_;
  const SceneHeader& header_;
  const LayerHeader& layer_;
  const EntropyTables& tables_;
  const PageWants& wants_;
  RansPage& page_;
  PageColumns& out_;
  size_t n_;
  Status* status_;                           // of the block at hand
  size_t middle_ = 0;                        // the first channel of the SH chunk
  size_t channel_ = 0, last_ = 0, end_ = 0;  // of the block: at hand, end of those wanted, end
  uint64_t at_ = 0;
  RansLanes lanes_{};
  const unsigned char* counted_ = nullptr;
  RansHybridTask task_{};
  const uint32_t* entries_ = nullptr;
  const ComponentColumns* step_exponent_component_ = nullptr;  // the last one with step_exponents
  size_t step_exponents_ = 1;  // that component has no more, from 0 on
  size_t step_ = 0;            // of the EOB table
  size_t members_ = 0;         // Gaussians that have the coefficient at hand
};

void take_alone(const RansKernels& kernels, RansPageParser& page) {
  if (page.is_wide()) {
    page.take_wide();
  } else {
    const RansHybridTask& task = page.task();
    kernels.hybrid(*task.lanes, page.tables(), task.contexts, task.count, task.dst);
  }
}

}  // namespace

void decode_rans_page(const SceneHeader& header, const LayerHeader& layer,
                      const EntropyTables& tables, const PageWants& wants, RansPage* page) {
  RansPageParser parser(header, layer, tables, wants, *page);
  while (parser.next()) {
    take_alone(*page->decoder->kernels, parser);
    parser.done();
  }
}

void decode_rans_pages(const SceneHeader& header, const LayerHeader& layer,
                       const EntropyTables& tables, const PageWants& wants, RansPage* first,
                       RansPage* second) {
  const RansKernels& kernels = *first->decoder->kernels;
  if (kernels.hybrid_pair == nullptr) {
    for (RansPage* page : {first, second}) decode_rans_page(header, layer, tables, wants, page);
    return;
  }
  RansPageParser a(header, layer, tables, wants, *first);
  RansPageParser b(header, layer, tables, wants, *second);
  bool has_a = a.next(), has_b = b.next();
  while (has_a || has_b) {
    // The one that is behind goes on alone: a page may have no SH chunk, or be damaged.
    const bool takes_a = has_a && (!has_b || a.channel() <= b.channel());
    const bool takes_b = has_b && (!has_a || b.channel() <= a.channel());
    // With symbols in both, the tables are the same.
    if (takes_a && takes_b && !a.is_wide() && a.task().count > 0 && b.task().count > 0) {
      kernels.hybrid_pair(a.tables(), a.task(), b.task());
    } else {
      if (takes_a) take_alone(kernels, a);
      if (takes_b) take_alone(kernels, b);
    }
    if (takes_a) a.done();
    if (takes_b) b.done();
    if (takes_a) has_a = a.next();
    if (takes_b) has_b = b.next();
  }
}

}  // namespace l4d

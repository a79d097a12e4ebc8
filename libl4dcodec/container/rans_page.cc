// SPDX-License-Identifier: Apache-2.0
// Pages whose channels are coded by rANS (spec: "rANS pages").
#include <algorithm>
#include <array>

#include "l4d/experimental/inspect.h"
#include "libl4dcodec/base/ordered.h"
#include "libl4dcodec/container/page_columns.h"

namespace l4d {
namespace {

constexpr uint8_t kLargeMagnitude = 15;  // all contexts end below

uint8_t small_magnitude(int16_t q) {
  const int magnitude = q < 0 ? -int{q} : int{q};
  return static_cast<uint8_t>(std::min<int>(magnitude, kLargeMagnitude));
}

// Values are known to fit.
template <typename From, typename To>
void narrow(const From* src, size_t n, To* dst) {
  for (size_t i = 0; i < n; ++i) dst[i] = static_cast<To>(src[i]);
}

class RansPageParser {
 public:
  RansPageParser(RansDecoder& decoder, const SceneHeader& header, const LayerHeader& layer,
                 const EntropyTables& tables, const BlockRecord* block, size_t n,
                 const PageWants& wants, PageColumns* out, SectionBytes* sections)
      : d_(decoder),
        header_(header),
        layer_(layer),
        tables_(tables),
        block_(block),
        n_(n),
        wants_(wants),
        out_(*out),
        sections_(sections) {}

  Status run(const RansPageChunks& parts, Status* detail) {
    out_.n = n_;
    out_.symbols = 0;
    out_.sh_detail = !parts.has_detail;
    for (ComponentColumns& c : out_.component) {
      c.index_count.fill(0);
      c.num_escapes = 0;
      c.coefficient_count.fill(0);
    }
    const size_t channels = tables_.channels.size();
    const size_t middle =
        parts.has_detail ? first_detail_channel(header_, tables_.channels) : channels;
    L4D_RETURN_IF_ERROR(run_block(parts.first, parts.first_at, 0, middle));
    if (detail == nullptr) return {};
    *detail = run_block(parts.detail, parts.detail_at, middle, channels);
    out_.sh_detail = detail->ok();
    return {};
  }

 private:
  Status run_block(ByteSpan block, uint64_t at, size_t first, size_t last) {
    at_ = at;
    L4D_RETURN_IF_ERROR(open_rans_block(block, at_, &lanes_));
    const unsigned char* counted = lanes_.next;
    // Channels behind the last one that is wanted stay coded.
    const size_t all = last;
    while (sections_ == nullptr && last > first && !wanted(tables_.channels[last - 1])) --last;
    for (size_t p = first; p < last; ++p) {
      L4D_RETURN_IF_ERROR(run_channel(p));
      if (sections_ == nullptr) continue;
      (*sections_)[section_of(tables_.channels[p])] += static_cast<uint64_t>(lanes_.next - counted);
      counted = lanes_.next;
    }
    if (last == all && !rans_block_finished(lanes_)) {
      return corrupt("RANS-7", at_,
                     "a rANS block does not end with its words and in its first state");
    }
    return {};
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

  // Decodes channel p for `count` Gaussians, whose contexts are given where it has more than one.
  // They are below `limit`.
  void hybrid(size_t p, const uint8_t* contexts, size_t count, uint16_t* dst,
              size_t limit = kMaxEntropyTables) {
    out_.symbols += count;
    const std::vector<uint8_t>& map = tables_.maps[p];
    const bool one = std::all_of(map.begin(), map.end(), [&](uint8_t t) { return t == map[0]; });
    if (contexts == nullptr || one) {
      d_.kernels->hybrid(lanes_, tables_.entries.data() + size_t{map[0]} * kRansSlots, nullptr,
                         count, dst);
      return;
    }
    grow(d_.tables, count);
    std::array<uint8_t, kMaxEntropyTables> padded{};
    std::copy(map.begin(), map.end(), padded.begin());
    d_.streams->map_bytes(padded.data(), std::min(map.size(), limit), contexts, count,
                          d_.tables.data());
    d_.kernels->hybrid(lanes_, tables_.entries.data(), d_.tables.data(), count, dst);
  }

  Status below(const uint16_t* values, size_t count, uint32_t limit, const char* clause,
               uint32_t* found = nullptr) const {
    if (limit > 0xffff) return {};
    const uint32_t largest = d_.streams->max_value(values, count);
    if (found != nullptr) *found = largest;
    if (largest < limit) return {};
    return corrupt(clause, at_,
                   "value " + std::to_string(largest) + " is not below " + std::to_string(limit));
  }

  Status run_channel(size_t p) {
    const ChannelSpec& spec = tables_.channels[p];
    ComponentColumns& c = out_.component[spec.component];
    switch (spec.kind) {
      case ChannelKind::kPosition:
        return positions(p);
      case ChannelKind::kMeanT:
        grow(out_.mean_t, n_);
        hybrid(p, nullptr, n_, out_.mean_t.data());
        L4D_RETURN_IF_ERROR(below(out_.mean_t.data(), n_, 1u << layer_.mean_t_width(), "STRM-3"));
        return finish_mean_t(layer_, *d_.streams, n_, at_, out_.mean_t.data());
      case ChannelKind::kMeanTFine:
        grow(out_.mean_t_fine, n_);
        hybrid(p, nullptr, n_, out_.mean_t_fine.data());
        return {};
      case ChannelKind::kWindow: {
        std::vector<uint16_t>& column = out_.window[spec.index];
        grow(column, n_);
        hybrid(p, nullptr, n_, column.data());
        return below(column.data(), n_, 1u << layer_.window_width(spec.index), "STRM-3");
      }
      case ChannelKind::kOpacity:
        grow(out_.opacity, n_);
        hybrid(p, nullptr, n_, out_.opacity.data());
        return below(out_.opacity.data(), n_, 1u << header_.opacity.bits, "STRM-3");
      case ChannelKind::kScaleFactor:
        grow(out_.scale_factor, n_);
        hybrid(p, nullptr, n_, out_.scale_factor.data());
        return below(out_.scale_factor.data(), n_, 1u << layer_.scale_factor.bits, "STRM-3");
      case ChannelKind::kDepth:
        return depths(p, spec.component);
      case ChannelKind::kIndex: {
        const ComponentCoding& coding = header_.component(layer_, spec.component);
        if (!coding.has_depth()) c.index_count[spec.index] = n_;
        const size_t count = c.index_count[spec.index];
        grow(c.index[spec.index], count);
        hybrid(p, nullptr, count, c.index[spec.index].data());
        const uint32_t limit = spec.index == 0
                                   ? stage0_entries(header_, layer_, spec.component, block_)
                                   : coding.stages[spec.index].num_entries;
        return below(c.index[spec.index].data(), count, limit, "VQ-2");
      }
      case ChannelKind::kEscape:
        return escapes(p, spec);
      case ChannelKind::kStepExponent:
        return step_exponents(p, spec.component);
      case ChannelKind::kEobIndex:
        return eob_indices(p, spec.component);
      case ChannelKind::kCoefficient:
        return coefficients(p, spec.component, spec.index);
    }
    return {};
  }

  Status positions(size_t p) {
    grow(d_.wide, n_);
    out_.symbols += n_;
    d_.kernels->wide(lanes_, tables_.entries.data() + size_t{tables_.maps[p][0]} * kRansSlots,
                     nullptr, n_, d_.wide.data());
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

  Status depths(size_t p, unsigned component) {
    ComponentColumns& c = out_.component[component];
    const ComponentCoding& coding = header_.component(layer_, component);
    grow(d_.codes, n_);
    grow(c.depth, n_);
    hybrid(p, nullptr, n_, d_.codes.data());
    return count_depths(coding, d_.codes.data(), n_, at_, &c);
  }

  Status escapes(size_t p, const ChannelSpec& spec) {
    ComponentColumns& c = out_.component[spec.component];
    const size_t dim = header_.component_dim(layer_, spec.component);
    const size_t count = c.num_escapes;
    grow(d_.codes, count);
    hybrid(p, nullptr, count, d_.codes.data());
    if (d_.streams->unorder_halves(d_.codes.data(), count) >= 0x7c00u) {
      return corrupt("VAL-2", at_, "a coded value is not finite");
    }
    grow(c.escape, count * dim);
    for (size_t i = 0; i < count; ++i) c.escape[i * dim + spec.index] = d_.codes[i];
    return {};
  }

  Status step_exponents(size_t p, unsigned component) {
    ComponentColumns& c = out_.component[component];
    grow(d_.codes, n_);
    grow(c.step_exponent, n_);
    grow(d_.step_exponent, n_);
    if (step_exponent_component_ == nullptr) std::fill_n(d_.step_exponent.begin(), n_, uint8_t{0});
    const uint8_t* contexts = step_exponent_component_ == nullptr
                                  ? d_.step_exponent.data()
                                  : step_exponent_component_->step_exponent.data();
    hybrid(p, contexts, n_, d_.codes.data(), step_exponents_);
    uint32_t largest = 0;
    L4D_RETURN_IF_ERROR(below(d_.codes.data(), n_, kTransformStepExponents, "TRAN-5", &largest));
    step_exponents_ = largest + 1;
    narrow(d_.codes.data(), n_, c.step_exponent.data());
    step_exponent_component_ = &c;
    if (header_.component(layer_, component).eob_table.size() > 1) return {};
    grow(c.eob_index, n_);
    std::fill_n(c.eob_index.begin(), n_, uint8_t{1});
    return {};
  }

  Status eob_indices(size_t p, unsigned component) {
    ComponentColumns& c = out_.component[component];
    grow(d_.codes, n_);
    grow(c.eob_index, n_);
    hybrid(p, c.step_exponent.data(), n_, d_.codes.data(), step_exponents_);
    const size_t steps = header_.component(layer_, component).eob_table.size();
    L4D_RETURN_IF_ERROR(below(d_.codes.data(), n_, static_cast<uint32_t>(steps + 1), "TRAN-6"));
    narrow(d_.codes.data(), n_, c.eob_index.data());
    return {};
  }

  Status coefficients(size_t p, unsigned component, unsigned k) {
    ComponentColumns& c = out_.component[component];
    const ComponentCoding& coding = header_.component(layer_, component);
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
      grow(contexts_, members_);
      d_.streams->coefficient_contexts(d_.step_exponent.data(), d_.last.data(), d_.before.data(),
                                       members_, contexts_.data());
      contexts = contexts_.data();
    }
    grow(d_.codes, members_);
    hybrid(p, contexts, members_, d_.codes.data(),
           k > 0 ? kMagnitudes * step_exponents_ : step_exponents_);
    c.coefficient_count[k] = members_;
    grow(c.coefficient[k], members_ + kCoefficientPadding);
    d_.before.swap(d_.last);
    d_.streams->unzigzag(d_.codes.data(), members_, c.coefficient[k].data(), d_.last.data());
    return {};
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
  const BlockRecord* block_;
  size_t n_;
  const PageWants& wants_;
  PageColumns& out_;
  SectionBytes* sections_;
  uint64_t at_ = 0;
  RansLanes lanes_{};
  const ComponentColumns* step_exponent_component_ = nullptr;  // the last one with step_exponents
  size_t step_exponents_ = 1;  // that component has no more, from 0 on
  size_t step_ = 0;            // of the EOB table
  size_t members_ = 0;         // Gaussians that have the coefficient at hand
  std::vector<uint8_t> contexts_;
};

}  // namespace

void coefficient_contexts(const uint8_t* step_exponent, const uint8_t* last, const uint8_t* before,
                          size_t n, unsigned k, uint8_t* contexts) {
  if (k == 0) {
    std::copy_n(step_exponent, n, contexts);
    return;
  }
  for (size_t i = 0; i < n; ++i) {
    const unsigned sum = unsigned{last[i]} + unsigned{before[i]};
    contexts[i] = static_cast<uint8_t>(step_exponent[i] * kMagnitudes + magnitude_context(sum));
  }
}

Status decode_rans_page(RansDecoder& decoder, const RansPageChunks& parts,
                        const SceneHeader& header, const LayerHeader& layer,
                        const EntropyTables& tables, const BlockRecord* block, size_t n,
                        const PageWants& wants, PageColumns* out, SectionBytes* sections,
                        Status* detail) {
  return RansPageParser(decoder, header, layer, tables, block, n, wants, out, sections)
      .run(parts, detail);
}

namespace {

// The symbols of the channels of a page that is encoded, one channel after the other.
class ChannelWalk {
 public:
  ChannelWalk(const SceneHeader& header, const LayerHeader& layer, const PageColumns& columns)
      : header_(header), layer_(layer), columns_(columns) {}

  // In arrays of this object, until the next call. Channels come in the order of the page.
  ChannelSymbols symbols_of(const ChannelSpec& spec) {
    const size_t n = columns_.n;
    const ComponentColumns& c = columns_.component[spec.component];
    ChannelSymbols symbols;
    switch (spec.kind) {
      case ChannelKind::kPosition:
        position(&symbols);
        break;
      case ChannelKind::kMeanT:
        narrow(
            columns_.mean_t, n,
            [&](uint16_t v) {
              return layer_.mean_t == CoordinateCodingId::kFixed
                         ? v
                         : order_half(v) >> layer_.mean_t_shift;
            },
            &symbols);
        break;
      case ChannelKind::kMeanTFine:
        same(columns_.mean_t_fine, n, &symbols);
        break;
      case ChannelKind::kWindow:
        same(columns_.window[spec.index], n, &symbols);
        break;
      case ChannelKind::kOpacity:
        same(columns_.opacity, n, &symbols);
        break;
      case ChannelKind::kScaleFactor:
        same(columns_.scale_factor, n, &symbols);
        break;
      case ChannelKind::kDepth:
        same(c.depth, n, &symbols);
        break;
      case ChannelKind::kIndex:
        same(c.index[spec.index], c.index_count[spec.index], &symbols);
        break;
      case ChannelKind::kEscape:
        escapes(c, header_.component_dim(layer_, spec.component), spec.index, &symbols);
        break;
      case ChannelKind::kStepExponent:
        same(c.step_exponent, n, &symbols);
        if (with_classes_ != nullptr) symbols.contexts = with_classes_->step_exponent;
        with_classes_ = &c;
        break;
      case ChannelKind::kEobIndex:
        same(c.eob_index, n, &symbols);
        symbols.contexts = c.step_exponent;
        break;
      case ChannelKind::kCoefficient:
        coefficients(header_.component(layer_, spec.component), c, spec.index, &symbols);
        break;
    }
    return symbols;
  }

 private:
  template <typename Values, typename CodeOf>
  void narrow(const Values& values, size_t count, const CodeOf& code_of, ChannelSymbols* symbols) {
    codes_.resize(count);
    for (size_t i = 0; i < count; ++i) codes_[i] = static_cast<uint16_t>(code_of(values[i]));
    symbols->hybrid = codes_;
  }
  template <typename Values>
  void same(const Values& values, size_t count, ChannelSymbols* symbols) {
    narrow(
        values, count, [](uint16_t v) { return v; }, symbols);
  }

  void position(ChannelSymbols* symbols) {
    wide_.resize(columns_.n);
    uint64_t previous = 0;
    for (size_t i = 0; i < columns_.n; ++i) {
      const uint64_t code = page_morton(header_, columns_, i);
      wide_[i] = code - previous;
      previous = code;
    }
    symbols->wide = wide_;
  }

  void escapes(const ComponentColumns& c, size_t dim, size_t number, ChannelSymbols* symbols) {
    codes_.resize(c.num_escapes);
    for (size_t i = 0; i < c.num_escapes; ++i) {
      codes_[i] = order_half(c.escape[i * dim + number]);
    }
    symbols->hybrid = codes_;
  }

  // Coefficient k of the Gaussians that have it. Contexts come from the two before.
  void coefficients(const ComponentCoding& coding, const ComponentColumns& c, unsigned k,
                    ChannelSymbols* symbols) {
    if (k == 0) {
      last_.assign(columns_.n, 0);
      before_.assign(columns_.n, 0);
    }
    members_.clear();
    for (size_t i = 0; i < columns_.n; ++i) {
      if (eob_coefficients(coding, c.eob_index[i]) > k)
        members_.push_back(static_cast<uint32_t>(i));
    }
    const size_t count = members_.size();
    codes_.resize(count);
    contexts_.resize(count);
    cls_.resize(3 * count);
    for (size_t i = 0; i < count; ++i) {
      cls_[i] = c.step_exponent[members_[i]];
      cls_[count + i] = last_[members_[i]];
      cls_[2 * count + i] = before_[members_[i]];
    }
    coefficient_contexts(cls_.data(), cls_.data() + count, cls_.data() + 2 * count, count, k,
                         contexts_.data());
    for (size_t i = 0; i < count; ++i) {
      const int16_t q = c.coefficient[k][i];
      codes_[i] = zigzag16(q);
      before_[members_[i]] = last_[members_[i]];
      last_[members_[i]] = small_magnitude(q);
    }
    symbols->hybrid = codes_;
    symbols->contexts = contexts_;
  }

  const SceneHeader& header_;
  const LayerHeader& layer_;
  const PageColumns& columns_;
  std::vector<uint64_t> wide_;
  std::vector<uint16_t> codes_;
  std::vector<uint8_t> contexts_, cls_, last_, before_;
  std::vector<uint32_t> members_;
  const ComponentColumns* with_classes_ = nullptr;
};

}  // namespace

void visit_channels(const SceneHeader& header, const LayerHeader& layer,
                    const std::vector<ChannelSpec>& channels, const PageColumns& columns,
                    ChannelVisitor& visitor) {
  ChannelWalk walk(header, layer, columns);
  for (size_t p = 0; p < channels.size(); ++p) {
    ChannelSymbols symbols = walk.symbols_of(channels[p]);
    symbols.channel = p;
    visitor.visit(symbols);
  }
}

}  // namespace l4d

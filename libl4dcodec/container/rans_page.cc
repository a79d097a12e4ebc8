// SPDX-License-Identifier: Apache-2.0
// Pages whose planes are coded by rANS (spec: "rANS pages").
#include <algorithm>
#include <array>

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
                 const EntropyTables& tables, const BlockRecord* block, size_t n, PageColumns* out,
                 SectionBytes* sections)
      : d_(decoder),
        header_(header),
        layer_(layer),
        tables_(tables),
        block_(block),
        n_(n),
        out_(*out),
        sections_(sections) {}

  Status run(const RansPageParts& parts, Status* detail) {
    out_.n = n_;
    out_.sh_detail = !parts.has_detail;
    for (ComponentColumns& c : out_.component) {
      c.index_count.fill(0);
      c.num_literals = 0;
      c.coefficient_count.fill(0);
    }
    const size_t planes = tables_.planes.size();
    const size_t middle = parts.has_detail ? first_detail_plane(header_, tables_.planes) : planes;
    L4D_RETURN_IF_ERROR(run_block(parts.first, parts.first_at, 0, middle));
    if (detail == nullptr) return {};
    *detail = run_block(parts.detail, parts.detail_at, middle, planes);
    out_.sh_detail = detail->ok();
    return {};
  }

 private:
  Status run_block(ByteSpan block, uint64_t at, size_t first, size_t last) {
    at_ = at;
    L4D_RETURN_IF_ERROR(open_rans_block(block, at_, &lanes_));
    const unsigned char* counted = lanes_.next;
    for (size_t p = first; p < last; ++p) {
      L4D_RETURN_IF_ERROR(run_plane(p));
      if (sections_ == nullptr) continue;
      (*sections_)[section_of(tables_.planes[p])] += static_cast<uint64_t>(lanes_.next - counted);
      counted = lanes_.next;
    }
    if (!rans_block_finished(lanes_)) {
      return corrupt("RANS-7", at_,
                     "a rANS block does not end with its words and in its first state");
    }
    return {};
  }

  static unsigned section_of(const PlaneSpec& p) {
    switch (p.kind) {
      case PlaneKind::kPosition:
        return L4D_SECTION_POSITION;
      case PlaneKind::kMeanT:
      case PlaneKind::kMeanTFine:
        return L4D_SECTION_MEAN_T;
      case PlaneKind::kOpacity:
        return L4D_SECTION_OPACITY;
      case PlaneKind::kScaleFactor:
        return L4D_SECTION_SCALE_FACTOR;
      default:
        return L4D_SECTION_SH + p.component;
    }
  }

  // Decodes plane p for `count` Gaussians, whose contexts are given where it has more than one.
  void hybrid(size_t p, const uint8_t* contexts, size_t count, uint16_t* dst) {
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
    d_.streams->map_bytes(padded.data(), map.size(), contexts, count, d_.tables.data());
    d_.kernels->hybrid(lanes_, tables_.entries.data(), d_.tables.data(), count, dst);
  }

  Status below(const uint16_t* values, size_t count, uint32_t limit, const char* clause) const {
    if (limit > 0xffff) return {};
    const uint32_t largest = d_.streams->max_value(values, count);
    if (largest < limit) return {};
    return corrupt(clause, at_,
                   "value " + std::to_string(largest) + " is not below " + std::to_string(limit));
  }

  Status run_plane(size_t p) {
    const PlaneSpec& spec = tables_.planes[p];
    ComponentColumns& c = out_.component[spec.component];
    switch (spec.kind) {
      case PlaneKind::kPosition:
        return positions(p);
      case PlaneKind::kMeanT:
        grow(out_.mean_t, n_);
        hybrid(p, nullptr, n_, out_.mean_t.data());
        L4D_RETURN_IF_ERROR(below(out_.mean_t.data(), n_, 1u << layer_.mean_t_width(), "STRM-3"));
        return finish_mean_t(layer_, *d_.streams, n_, at_, out_.mean_t.data());
      case PlaneKind::kMeanTFine:
        grow(out_.mean_t_fine, n_);
        hybrid(p, nullptr, n_, out_.mean_t_fine.data());
        return {};
      case PlaneKind::kOpacity:
        grow(out_.opacity, n_);
        hybrid(p, nullptr, n_, out_.opacity.data());
        return below(out_.opacity.data(), n_, 1u << header_.opacity.bits, "STRM-3");
      case PlaneKind::kScaleFactor:
        grow(out_.scale_factor, n_);
        hybrid(p, nullptr, n_, out_.scale_factor.data());
        return below(out_.scale_factor.data(), n_, 1u << layer_.scale_factor.bits, "STRM-3");
      case PlaneKind::kDepth:
        return depths(p, spec.component);
      case PlaneKind::kIndex: {
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
      case PlaneKind::kLiteral:
        return literals(p, spec);
      case PlaneKind::kClass:
        return classes(p, spec.component);
      case PlaneKind::kRung:
        return rungs(p, spec.component);
      case PlaneKind::kCoefficient:
        return coefficients(p, spec.component, spec.index);
    }
    return {};
  }

  Status positions(size_t p) {
    grow(d_.wide, n_);
    d_.kernels->wide(lanes_, tables_.entries.data() + size_t{tables_.maps[p][0]} * kRansSlots,
                     nullptr, n_, d_.wide.data());
    const bool fixed = header_.position == MeanCodingId::kFixed;
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

  Status literals(size_t p, const PlaneSpec& spec) {
    ComponentColumns& c = out_.component[spec.component];
    const size_t dim = header_.component_dim(layer_, spec.component);
    const size_t count = c.num_literals;
    grow(d_.codes, count);
    hybrid(p, nullptr, count, d_.codes.data());
    if (d_.streams->unorder_halves(d_.codes.data(), count) >= 0x7c00u) {
      return corrupt("VAL-2", at_, "a coded value is not finite");
    }
    grow(c.literal, count * dim);
    for (size_t i = 0; i < count; ++i) c.literal[i * dim + spec.index] = d_.codes[i];
    return {};
  }

  Status classes(size_t p, unsigned component) {
    ComponentColumns& c = out_.component[component];
    grow(d_.codes, n_);
    grow(c.cls, n_);
    grow(d_.cls, n_);
    if (class_component_ == nullptr) std::fill_n(d_.cls.begin(), n_, uint8_t{0});
    const uint8_t* contexts =
        class_component_ == nullptr ? d_.cls.data() : class_component_->cls.data();
    hybrid(p, contexts, n_, d_.codes.data());
    L4D_RETURN_IF_ERROR(below(d_.codes.data(), n_, kTransformClasses, "TRAN-5"));
    narrow(d_.codes.data(), n_, c.cls.data());
    class_component_ = &c;
    if (header_.component(layer_, component).ladder.size() > 1) return {};
    grow(c.rung, n_);
    std::fill_n(c.rung.begin(), n_, uint8_t{1});
    return {};
  }

  Status rungs(size_t p, unsigned component) {
    ComponentColumns& c = out_.component[component];
    grow(d_.codes, n_);
    grow(c.rung, n_);
    hybrid(p, c.cls.data(), n_, d_.codes.data());
    const size_t steps = header_.component(layer_, component).ladder.size();
    L4D_RETURN_IF_ERROR(below(d_.codes.data(), n_, static_cast<uint32_t>(steps + 1), "TRAN-6"));
    narrow(d_.codes.data(), n_, c.rung.data());
    return {};
  }

  Status coefficients(size_t p, unsigned component, unsigned k) {
    ComponentColumns& c = out_.component[component];
    const ComponentCoding& coding = header_.component(layer_, component);
    if (k == 0) {
      step_ = 0;
      members_ = n_;
      d_.cls.assign(c.cls.begin(), c.cls.begin() + static_cast<std::ptrdiff_t>(n_));
      d_.rung.assign(c.rung.begin(), c.rung.begin() + static_cast<std::ptrdiff_t>(n_));
      d_.last.assign(n_, 0);
      d_.before.assign(n_, 0);
      compact();
    } else if (k == coding.ladder[step_]) {
      ++step_;
      compact();
    }
    const uint8_t* contexts = d_.cls.data();
    if (k > 0) {
      grow(contexts_, members_);
      d_.streams->coefficient_contexts(d_.cls.data(), d_.last.data(), d_.before.data(), members_,
                                       contexts_.data());
      contexts = contexts_.data();
    }
    grow(d_.codes, members_);
    hybrid(p, contexts, members_, d_.codes.data());
    c.coefficient_count[k] = members_;
    grow(c.coefficient[k], members_);
    d_.before.swap(d_.last);
    d_.streams->unzigzag(d_.codes.data(), members_, c.coefficient[k].data(), d_.last.data());
    return {};
  }

  // Leaves those Gaussians whose rung reaches the step at hand.
  void compact() {
    uint8_t* const arrays[] = {d_.rung.data(), d_.cls.data(), d_.last.data(), d_.before.data()};
    members_ = d_.streams->keep_above(arrays, 4, members_, static_cast<uint8_t>(step_));
  }

  RansDecoder& d_;
  const SceneHeader& header_;
  const LayerHeader& layer_;
  const EntropyTables& tables_;
  const BlockRecord* block_;
  size_t n_;
  PageColumns& out_;
  SectionBytes* sections_;
  uint64_t at_ = 0;
  RansLanes lanes_{};
  const ComponentColumns* class_component_ = nullptr;  // the last one with classes
  size_t step_ = 0;                                    // of the ladder
  size_t members_ = 0;  // Gaussians that have the coefficient at hand
  std::vector<uint8_t> contexts_;
};

}  // namespace

void coefficient_contexts(const uint8_t* cls, const uint8_t* last, const uint8_t* before, size_t n,
                          unsigned k, uint8_t* contexts) {
  if (k == 0) {
    std::copy_n(cls, n, contexts);
    return;
  }
  for (size_t i = 0; i < n; ++i) {
    const unsigned sum = unsigned{last[i]} + unsigned{before[i]};
    contexts[i] = static_cast<uint8_t>(cls[i] * kMagnitudes + magnitude_context(sum));
  }
}

Status decode_rans_page(RansDecoder& decoder, const RansPageParts& parts, const SceneHeader& header,
                        const LayerHeader& layer, const EntropyTables& tables,
                        const BlockRecord* block, size_t n, PageColumns* out,
                        SectionBytes* sections, Status* detail) {
  return RansPageParser(decoder, header, layer, tables, block, n, out, sections).run(parts, detail);
}

void visit_planes(const SceneHeader& header, const LayerHeader& layer,
                  const std::vector<PlaneSpec>& planes, const PageColumns& columns,
                  PlaneVisitor& visitor) {
  const size_t n = columns.n;
  std::vector<uint64_t> wide;
  std::vector<uint16_t> codes;
  std::vector<uint8_t> contexts, cls, last, before;
  std::vector<uint32_t> members;
  const ComponentColumns* with_classes = nullptr;
  for (size_t p = 0; p < planes.size(); ++p) {
    const PlaneSpec& spec = planes[p];
    const ComponentColumns& c = columns.component[spec.component];
    PlaneSymbols symbols;
    symbols.plane = p;
    const auto narrow = [&](const auto& values, size_t count, auto&& code_of) {
      codes.resize(count);
      for (size_t i = 0; i < count; ++i) codes[i] = static_cast<uint16_t>(code_of(values[i]));
      symbols.hybrid = codes;
    };
    const auto same = [](uint16_t v) { return v; };
    switch (spec.kind) {
      case PlaneKind::kPosition: {
        wide.resize(n);
        uint64_t previous = 0;
        for (size_t i = 0; i < n; ++i) {
          const uint64_t code = page_morton(header, columns, i);
          wide[i] = code - previous;
          previous = code;
        }
        symbols.wide = wide;
        break;
      }
      case PlaneKind::kMeanT:
        narrow(columns.mean_t, n, [&](uint16_t v) {
          return layer.mean_t == MeanCodingId::kFixed ? v : order_half(v) >> layer.mean_t_shift;
        });
        break;
      case PlaneKind::kMeanTFine:
        narrow(columns.mean_t_fine, n, same);
        break;
      case PlaneKind::kOpacity:
        narrow(columns.opacity, n, same);
        break;
      case PlaneKind::kScaleFactor:
        narrow(columns.scale_factor, n, same);
        break;
      case PlaneKind::kDepth:
        narrow(c.depth, n, same);
        break;
      case PlaneKind::kIndex:
        narrow(c.index[spec.index], c.index_count[spec.index], same);
        break;
      case PlaneKind::kLiteral: {
        const size_t dim = header.component_dim(layer, spec.component);
        codes.resize(c.num_literals);
        for (size_t i = 0; i < c.num_literals; ++i) {
          codes[i] = order_half(c.literal[i * dim + spec.index]);
        }
        symbols.hybrid = codes;
        break;
      }
      case PlaneKind::kClass:
        narrow(c.cls, n, same);
        if (with_classes != nullptr) symbols.contexts = with_classes->cls;
        with_classes = &c;
        break;
      case PlaneKind::kRung:
        narrow(c.rung, n, same);
        symbols.contexts = c.cls;
        break;
      case PlaneKind::kCoefficient: {
        const ComponentCoding& coding = header.component(layer, spec.component);
        const unsigned k = spec.index;
        if (k == 0) {
          last.assign(n, 0);
          before.assign(n, 0);
        }
        members.clear();
        for (size_t i = 0; i < n; ++i) {
          if (rung_coefficients(coding, c.rung[i]) > k) members.push_back(static_cast<uint32_t>(i));
        }
        const size_t count = members.size();
        codes.resize(count);
        contexts.resize(count);
        cls.resize(3 * count);
        for (size_t i = 0; i < count; ++i) {
          cls[i] = c.cls[members[i]];
          cls[count + i] = last[members[i]];
          cls[2 * count + i] = before[members[i]];
        }
        coefficient_contexts(cls.data(), cls.data() + count, cls.data() + 2 * count, count, k,
                             contexts.data());
        for (size_t i = 0; i < count; ++i) {
          const int16_t q = c.coefficient[k][i];
          codes[i] = zigzag16(q);
          before[members[i]] = last[members[i]];
          last[members[i]] = small_magnitude(q);
        }
        symbols.hybrid = codes;
        symbols.contexts = contexts;
        break;
      }
    }
    visitor.visit(symbols);
  }
}

}  // namespace l4d

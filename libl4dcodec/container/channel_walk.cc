// SPDX-License-Identifier: Apache-2.0
// The symbols of a page that rANS codes, channel by channel (spec: "rANS pages").
#include <algorithm>

#include "libl4dcodec/container/page_columns.h"

namespace l4d {
namespace {

constexpr uint8_t kLargeMagnitude = 15;  // all contexts end below

uint8_t small_magnitude(int16_t q) {
  const int magnitude = q < 0 ? -int{q} : int{q};
  return static_cast<uint8_t>(std::min<int>(magnitude, kLargeMagnitude));
}

// Contexts of coefficient k of n Gaussians: their step_exponents, and the magnitudes (15 = that or
// more) of the two coefficients before.
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

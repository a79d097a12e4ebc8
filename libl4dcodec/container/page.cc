// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cfloat>
#include <cmath>

#include "l4d/experimental/inspect.h"
#include "libl4dcodec/base/ordered.h"
#include "libl4dcodec/container/page_columns.h"
#include "libl4dcodec/scene/attributes.h"

namespace l4d {
namespace {

// Reads the streams of one page in their order, counting bytes by section.
class PageParser {
 public:
  PageParser(StreamDecoder& decoder, ByteSpan raw, uint64_t base, size_t n, PageColumns* out,
             SectionBytes* sections)
      : decoder_(decoder), in_(raw), base_(base), n_(n), out_(*out), sections_(sections) {}

  Status parse(const SceneHeader& header, const LayerHeader& layer, const BlockRecord* block,
               const PageWants& wants) {
    out_.n = n_;
    out_.sh_detail = true;
    for (unsigned axis = 0; axis < 3; ++axis) {
      L4D_RETURN_IF_ERROR(position(header, layer, wants.position, axis));
    }
    count(L4D_SECTION_POSITION);
    L4D_RETURN_IF_ERROR(mean_t(layer, wants.mean_t));
    count(L4D_SECTION_MEAN_T);
    L4D_RETURN_IF_ERROR(scalar(header.opacity, wants.opacity, &out_.opacity, &out_.raw_opacity,
                               header.opacity_logit ? kAnyValue : kOpacityRange));
    count(L4D_SECTION_OPACITY);
    L4D_RETURN_IF_ERROR(scalar(layer.scale_factor, wants.scale, &out_.scale_factor,
                               &out_.raw_scale_factor, kAnyValue));
    count(L4D_SECTION_SCALE_FACTOR);
    const bool want[L4D_COMPONENT_COUNT] = {wants.sh, wants.scale, wants.rotor, wants.rotor};
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      L4D_RETURN_IF_ERROR(component(header.component(layer, c), header.component_dim(layer, c),
                                    stage0_entries(header, layer, c, block), want[c],
                                    c == L4D_COMPONENT_SCALE ? kLogScaleRange : kAnyValue,
                                    &out_.component[c]));
      count(L4D_SECTION_SH + c);
    }
    if (in_.remaining() != 0) {
      return corrupt("PAGE-1", base_ + in_.position(),
                     std::to_string(in_.remaining()) + " bytes left over at the end of a page");
    }
    return {};
  }

 private:
  // What raw values may be.
  struct Range {
    float low, high;
  };
  static constexpr Range kAnyValue = {-FLT_MAX, FLT_MAX};
  static constexpr Range kOpacityRange = {0.0f, 1.0f};
  static constexpr Range kLogScaleRange = {-kMaxLogScale, kMaxLogScale};

  void count(unsigned section) {
    if (sections_ != nullptr) (*sections_)[section] += in_.position() - counted_;
    counted_ = in_.position();
  }

  Status halves(bool wanted, size_t n, const char* clause, uint16_t* dst) {
    if (!wanted) return skip_stream(in_, base_, n, 16);
    const uint64_t at = base_ + in_.position();
    L4D_RETURN_IF_ERROR(decode_stream(decoder_, in_, base_, n, 16, 0, "", dst));
    if (decoder_.kernels->unorder_halves(dst, n) >= 0x7c00u) {
      return corrupt(clause, at, "a coded value is not finite");
    }
    return {};
  }

  Status raw(bool wanted, size_t n, float* dst, size_t stride, Range range = kAnyValue) {
    if (!wanted) return skip_stream(in_, base_, n, 32);
    const uint64_t at = base_ + in_.position();
    grow(raw_bits_, n);
    L4D_RETURN_IF_ERROR(decode_stream32(decoder_, in_, base_, n, raw_bits_.data()));
    for (size_t i = 0; i < n; ++i) {
      const float v = unorder_float(raw_bits_[i]);
      if (!std::isfinite(v)) return corrupt("VAL-3", at, "a raw value is not finite");
      if (v < range.low || v > range.high) {
        return corrupt("VAL-4", at, "a raw opacity or log scale is out of range");
      }
      dst[i * stride] = v;
    }
    return {};
  }

  Status raw64(bool wanted, double* dst) {
    if (!wanted) {
      L4D_RETURN_IF_ERROR(skip_stream(in_, base_, n_, 32));
      return skip_stream(in_, base_, n_, 32);
    }
    const uint64_t at = base_ + in_.position();
    std::vector<uint32_t> high(n_);
    L4D_RETURN_IF_ERROR(decode_stream32(decoder_, in_, base_, n_, high.data()));
    grow(raw_bits_, n_);
    L4D_RETURN_IF_ERROR(decode_stream32(decoder_, in_, base_, n_, raw_bits_.data()));
    for (size_t i = 0; i < n_; ++i) {
      dst[i] = unorder_double(uint64_t{high[i]} << 32 | raw_bits_[i]);
      if (!(std::fabs(dst[i]) <= 0x1p60))
        return corrupt("VAL-3", at, "a raw value is out of range");
    }
    return {};
  }

  Status position(const SceneHeader& header, const LayerHeader& layer, bool wanted, unsigned axis) {
    const CoordinateCodingId coding = header.position_of(layer);
    if (coding == CoordinateCodingId::kF16) {
      grow(out_.position[axis], n_);
      return halves(wanted, n_, "VAL-1", out_.position[axis].data());
    }
    if (coding == CoordinateCodingId::kRaw32) {
      grow(out_.raw_position[axis], n_);
      return raw(wanted, n_, out_.raw_position[axis].data(), 1);
    }
    if (!wanted) return skip_stream(in_, base_, n_, 32);
    const uint64_t at = base_ + in_.position();
    std::vector<uint32_t>& codes = out_.fixed_position[axis];
    grow(codes, n_);
    L4D_RETURN_IF_ERROR(decode_stream32(decoder_, in_, base_, n_, codes.data()));
    uint32_t above = 0;
    for (size_t i = 0; i < n_; ++i) above |= codes[i];
    if ((above >> header.position_bits) == 0) return {};
    return corrupt("STRM-3", at,
                   "a coordinate is not below 2^" + std::to_string(header.position_bits));
  }

  Status mean_t(const LayerHeader& layer, bool wanted) {
    if (layer.mean_t == CoordinateCodingId::kNone) return {};
    if (layer.flat()) return windows(layer, wanted);
    if (layer.mean_t == CoordinateCodingId::kRaw32) {
      grow(out_.raw_mean_t, n_);
      return raw(wanted, n_, out_.raw_mean_t.data(), 1);
    }
    if (layer.mean_t == CoordinateCodingId::kRaw64) {
      grow(out_.raw64_mean_t, n_);
      return raw64(wanted, out_.raw64_mean_t.data());
    }
    const unsigned width = layer.mean_t_width();
    if (!wanted) {
      L4D_RETURN_IF_ERROR(skip_stream(in_, base_, n_, width));
      return layer.mean_t_fine ? skip_stream(in_, base_, n_, 16) : Status();
    }
    const uint64_t at = base_ + in_.position();
    grow(out_.mean_t, n_);
    L4D_RETURN_IF_ERROR(decode_stream(decoder_, in_, base_, n_, width, 0, "", out_.mean_t.data()));
    L4D_RETURN_IF_ERROR(finish_mean_t(layer, *decoder_.kernels, n_, at, out_.mean_t.data()));
    if (!layer.mean_t_fine) return {};
    grow(out_.mean_t_fine, n_);
    return decode_stream(decoder_, in_, base_, n_, 16, 0, "", out_.mean_t_fine.data());
  }

  Status windows(const LayerHeader& layer, bool wanted) {
    for (size_t k = 0; k < kWindowColumns; ++k) {
      const unsigned width = layer.window_width(k);
      if (!wanted) {
        L4D_RETURN_IF_ERROR(skip_stream(in_, base_, n_, width));
        continue;
      }
      grow(out_.window[k], n_);
      L4D_RETURN_IF_ERROR(
          decode_stream(decoder_, in_, base_, n_, width, 0, "", out_.window[k].data()));
    }
    return {};
  }

  Status scalar(const ScalarCoding& coding, bool wanted, std::vector<uint16_t>* codes,
                std::vector<float>* raw_values, Range range) {
    if (coding.coding == ScalarCodingId::kRaw32) {
      grow(*raw_values, n_);
      return raw(wanted, n_, raw_values->data(), 1, range);
    }
    if (coding.coding != ScalarCodingId::kSq) return {};
    grow(*codes, n_);
    if (!wanted) return skip_stream(in_, base_, n_, coding.bits);
    return decode_stream(decoder_, in_, base_, n_, coding.bits, 0, "", codes->data());
  }

  Status component(const ComponentCoding& coding, unsigned dim, uint32_t entries0, bool wanted,
                   Range range, ComponentColumns* out) {
    // The buffers keep what the page before left in them; the counts say what is of this page.
    out->index_count.fill(0);
    out->num_escapes = 0;
    out->coefficient_count.fill(0);
    if (coding.transform()) return transform(coding, wanted, out);
    if (coding.coding == ComponentCodingId::kRaw32) {
      grow(out->raw, n_ * dim);
      for (unsigned d = 0; d < dim; ++d)
        L4D_RETURN_IF_ERROR(raw(wanted, n_, out->raw.data() + d, dim, range));
      return {};
    }
    if (!coding.vq()) return {};
    const size_t stages = coding.stages.size();
    if (coding.has_depth()) {
      // Depths say how long the other streams are, so they are read even when those are skipped.
      L4D_RETURN_IF_ERROR(depths(coding, out));
    } else {
      std::fill(out->index_count.begin(), out->index_count.begin() + static_cast<long>(stages), n_);
    }
    for (size_t s = 0; s < stages; ++s) {
      const uint32_t limit = s == 0 ? entries0 : coding.stages[s].num_entries;
      if (!wanted) {
        L4D_RETURN_IF_ERROR(skip_stream(in_, base_, out->index_count[s], bit_width(limit)));
        continue;
      }
      grow(out->index[s], out->index_count[s]);
      L4D_RETURN_IF_ERROR(decode_stream(decoder_, in_, base_, out->index_count[s], bit_width(limit),
                                        limit, "VQ-2", out->index[s].data()));
    }
    return escapes(dim, wanted, out);
  }

  Status depths(const ComponentCoding& coding, ComponentColumns* out) {
    const uint64_t at = base_ + in_.position();
    grow(codes_, n_);
    grow(out->depth, n_);
    L4D_RETURN_IF_ERROR(decode_stream(decoder_, in_, base_, n_, 4, 0, "", codes_.data()));
    return count_depths(coding, codes_.data(), n_, at, out);
  }

  Status transform(const ComponentCoding& coding, bool wanted, ComponentColumns* out) {
    // As depths do, EOB indices say how long the other streams are.
    grow(codes_, n_);
    grow(out->step_exponent, n_);
    grow(out->eob_index, n_);
    L4D_RETURN_IF_ERROR(decode_stream(decoder_, in_, base_, n_, 4, 0, "", codes_.data()));
    for (size_t i = 0; i < n_; ++i) out->step_exponent[i] = static_cast<uint8_t>(codes_[i]);
    const size_t steps = coding.eob_table.size();
    if (steps == 1) {
      std::fill_n(out->eob_index.begin(), n_, uint8_t{1});
    } else {
      L4D_RETURN_IF_ERROR(decode_stream(decoder_, in_, base_, n_,
                                        bit_width(static_cast<uint32_t>(steps + 1)),
                                        static_cast<uint32_t>(steps + 1), "TRAN-6", codes_.data()));
      for (size_t i = 0; i < n_; ++i) out->eob_index[i] = static_cast<uint8_t>(codes_[i]);
    }
    for (size_t i = 0; i < n_; ++i) {
      for (unsigned k = 0; k < eob_coefficients(coding, out->eob_index[i]); ++k) {
        ++out->coefficient_count[k];
      }
    }
    for (unsigned k = 0; k < coding.coefficients(); ++k) {
      const size_t count = out->coefficient_count[k];
      if (!wanted) {
        L4D_RETURN_IF_ERROR(skip_stream(in_, base_, count, 16));
        continue;
      }
      grow(out->coefficient[k], count + kCoefficientPadding);
      L4D_RETURN_IF_ERROR(decode_stream(decoder_, in_, base_, count, 16, 0, "", codes_.data()));
      for (size_t i = 0; i < count; ++i) out->coefficient[k][i] = unzigzag16(codes_[i]);
    }
    return {};
  }

  Status escapes(unsigned dim, bool wanted, ComponentColumns* out) {
    const size_t n = out->num_escapes;
    grow(out->escape, n * dim);
    grow(codes_, n);
    for (unsigned d = 0; d < dim; ++d) {
      L4D_RETURN_IF_ERROR(halves(wanted, n, "VAL-2", codes_.data()));
      if (!wanted) continue;
      for (size_t i = 0; i < n; ++i) out->escape[i * dim + d] = codes_[i];
    }
    return {};
  }

  StreamDecoder& decoder_;
  ByteReader in_;
  uint64_t base_;
  size_t n_;
  PageColumns& out_;
  SectionBytes* sections_;
  size_t counted_ = 0;
  std::vector<uint32_t> raw_bits_;
  std::vector<uint16_t> codes_;
};

class PageWriter {
 public:
  PageWriter(StreamEncoder& encoder, size_t n) : encoder_(encoder), n_(n), codes_(n) {}

  // Neighbours in Morton order are close in space, so differences are tried for means; for other
  // attributes they only cost encoding time.
  void position(CoordinateCodingId coding, const PageColumns& columns, unsigned axis) {
    if (coding == CoordinateCodingId::kF16) half_stream(columns.position[axis].data(), 1, n_, true);
    if (coding == CoordinateCodingId::kRaw32)
      raw_stream(columns.raw_position[axis].data(), 1, true);
    if (coding == CoordinateCodingId::kFixed) {
      encoder_.encode32(columns.fixed_position[axis].data(), n_, true, out_);
    }
  }
  void mean_t(const LayerHeader& layer, const PageColumns& columns) {
    if (layer.mean_t == CoordinateCodingId::kRaw32) raw_stream(columns.raw_mean_t.data(), 1, true);
    if (layer.mean_t == CoordinateCodingId::kRaw64) raw64_stream(columns.raw64_mean_t.data());
    if (layer.mean_t == CoordinateCodingId::kFixed) {
      encoder_.encode(columns.mean_t.data(), n_, layer.mean_t_bits, true, out_);
      if (layer.mean_t_fine) encoder_.encode(columns.mean_t_fine.data(), n_, 16, false, out_);
    }
    for (size_t k = 0; layer.flat() && k < kWindowColumns; ++k) {
      encoder_.encode(columns.window[k].data(), n_, layer.window_width(k), false, out_);
    }
    if (layer.mean_t != CoordinateCodingId::kF16) return;
    for (size_t i = 0; i < n_; ++i) {
      codes_[i] = static_cast<uint16_t>(order_half(columns.mean_t[i]) >> layer.mean_t_shift);
    }
    encoder_.encode(codes_.data(), n_, 16 - layer.mean_t_shift, true, out_);
  }

  void scalar(const ScalarCoding& coding, const std::vector<uint16_t>& codes,
              const std::vector<float>& raw) {
    if (coding.coding == ScalarCodingId::kRaw32) raw_stream(raw.data(), 1, false);
    if (coding.coding == ScalarCodingId::kSq) {
      encoder_.encode(codes.data(), n_, coding.bits, false, out_);
    }
  }

  void component(const ComponentCoding& coding, unsigned dim, uint32_t entries0,
                 const ComponentColumns& c) {
    if (coding.coding == ComponentCodingId::kRaw32) {
      for (unsigned d = 0; d < dim; ++d) raw_stream(c.raw.data() + d, dim, false);
    }
    if (coding.transform()) transform(coding, c);
    if (!coding.vq()) return;
    if (coding.has_depth()) {
      for (size_t i = 0; i < n_; ++i) codes_[i] = c.depth[i];
      encoder_.encode(codes_.data(), n_, 4, false, out_);
    }
    for (size_t s = 0; s < coding.stages.size(); ++s) {
      const uint32_t limit = s == 0 ? entries0 : coding.stages[s].num_entries;
      encoder_.encode(c.index[s].data(), c.index_count[s], bit_width(limit), false, out_);
    }
    if (c.num_escapes == 0) return;  // a column of nothing has no address
    for (unsigned d = 0; d < dim; ++d) half_stream(c.escape.data() + d, dim, c.num_escapes, false);
  }

  void transform(const ComponentCoding& coding, const ComponentColumns& c) {
    for (size_t i = 0; i < n_; ++i) codes_[i] = c.step_exponent[i];
    encoder_.encode(codes_.data(), n_, 4, false, out_);
    if (coding.eob_table.size() > 1) {
      for (size_t i = 0; i < n_; ++i) codes_[i] = c.eob_index[i];
      const uint32_t eob_indices = static_cast<uint32_t>(coding.eob_table.size() + 1);
      encoder_.encode(codes_.data(), n_, bit_width(eob_indices), false, out_);
    }
    for (unsigned k = 0; k < coding.coefficients(); ++k) {
      const size_t count = c.coefficient_count[k];
      for (size_t i = 0; i < count; ++i) codes_[i] = zigzag16(c.coefficient[k][i]);
      encoder_.encode(codes_.data(), count, 16, false, out_);
    }
  }

  Bytes take() { return std::move(out_); }

 private:
  void half_stream(const uint16_t* halves, size_t stride, size_t n, bool try_delta) {
    for (size_t i = 0; i < n; ++i) codes_[i] = order_half(halves[i * stride]);
    encoder_.encode(codes_.data(), n, 16, try_delta, out_);
  }
  void raw_stream(const float* values, size_t stride, bool try_delta) {
    raw_bits_.resize(n_);
    for (size_t i = 0; i < n_; ++i) raw_bits_[i] = order_float(values[i * stride]);
    encoder_.encode32(raw_bits_.data(), n_, try_delta, out_);
  }

  // High halves, then low ones.
  void raw64_stream(const double* values) {
    for (const unsigned shift : {32u, 0u}) {
      raw_bits_.resize(n_);
      for (size_t i = 0; i < n_; ++i) {
        raw_bits_[i] = static_cast<uint32_t>(order_double(values[i]) >> shift);
      }
      encoder_.encode32(raw_bits_.data(), n_, true, out_);
    }
  }

  StreamEncoder& encoder_;
  size_t n_;
  std::vector<uint16_t> codes_;
  std::vector<uint32_t> raw_bits_;
  Bytes out_;
};

}  // namespace

Status finish_mean_t(const LayerHeader& layer, const StreamKernels& kernels, size_t n, uint64_t at,
                     uint16_t* values) {
  if (layer.mean_t == CoordinateCodingId::kFixed) return {};  // every code is a time
  const unsigned shift = layer.mean_t_shift;
  if (shift > 0) {
    // The middle of what the code stands for.
    for (size_t i = 0; i < n; ++i) {
      values[i] = static_cast<uint16_t>((unsigned{values[i]} << shift) | (1u << (shift - 1)));
    }
  }
  if (kernels.unorder_halves(values, n) < 0x7c00u) return {};
  return corrupt("VAL-1", at, "a coded value is not finite");
}

Status count_depths(const ComponentCoding& coding, const uint16_t* depths, size_t n, uint64_t at,
                    ComponentColumns* out) {
  const size_t stages = coding.stages.size();
  for (size_t i = 0; i < n; ++i) {
    const unsigned depth = depths[i];
    out->depth[i] = static_cast<uint8_t>(depth);
    if (depth == kEscapeDepth && coding.escapes) {
      ++out->num_escapes;
    } else if (depth <= stages) {
      for (size_t s = 0; s < depth; ++s) ++out->index_count[s];
    } else {
      return corrupt("VQ-1", at,
                     "depth " + std::to_string(depth) + " of a component with " +
                         std::to_string(stages) + " stages");
    }
  }
  return {};
}

FrameWindow window_of(const LayerHeader& layer, uint32_t bucket, uint32_t num_frames,
                      const PageColumns& columns, size_t i) {
  const auto value = [&](size_t column) {
    const auto part = [&](size_t k) {
      return layer.window_width(k) == 0 ? uint32_t{0} : uint32_t{columns.window[k][i]};
    };
    return part(column) | part(column + 1) << 16;
  };
  const uint32_t begin = window_base(bucket, layer.level, num_frames) + value(0);
  return {begin, begin + layer.window_length + value(2)};
}

Status check_windows(const SceneHeader& header, const LayerHeader& layer, uint32_t bucket,
                     uint64_t at, const PageColumns& columns) {
  const uint32_t num_frames = header.timeline.num_frames;
  for (size_t i = 0; i < columns.n; ++i) {
    const FrameWindow w = window_of(layer, bucket, num_frames, columns, i);
    if (w.is_valid(num_frames)) continue;
    return corrupt("WIND-3", at,
                   "Gaussian " + std::to_string(i) + " has the window " + std::to_string(w.begin) +
                       " to " + std::to_string(w.end) + " in a sequence of " +
                       std::to_string(num_frames) + " frames");
  }
  return {};
}

uint32_t stage0_entries(const SceneHeader& header, const LayerHeader& layer, unsigned c,
                        const BlockRecord* block) {
  if (block != nullptr && block->tables[c].num_entries != 0) return block->tables[c].num_entries;
  const ComponentCoding& coding = header.component(layer, c);
  return coding.stages.empty() ? 0 : coding.stages[0].num_entries;
}

uint64_t max_page_bytes(const SceneHeader& header, size_t n) {
  // Numbers of a Gaussian at four bytes, and one depth and all stages of four components at two.
  const uint64_t numbers = 17 + uint64_t{header.sh_dim()};
  const uint64_t indices = uint64_t{L4D_COMPONENT_COUNT} * (1 + L4D_MAX_STAGES);
  return n * (4 * numbers + 2 * indices) + (numbers + indices) * kMaxStreamOverhead;
}

Status decode_page(StreamDecoder& decoder, ByteSpan raw, uint64_t base, const SceneHeader& header,
                   const LayerHeader& layer, const BlockRecord* block, size_t n,
                   const PageWants& wants, PageColumns* out, SectionBytes* sections) {
  out->symbols = 0;
  return PageParser(decoder, raw, base, n, out, sections).parse(header, layer, block, wants);
}

Bytes encode_page(StreamEncoder& encoder, const SceneHeader& header, const LayerHeader& layer,
                  const BlockRecord* block, const PageColumns& columns) {
  PageWriter writer(encoder, columns.n);
  for (unsigned axis = 0; axis < 3; ++axis) {
    writer.position(header.position_of(layer), columns, axis);
  }
  writer.mean_t(layer, columns);
  writer.scalar(header.opacity, columns.opacity, columns.raw_opacity);
  writer.scalar(layer.scale_factor, columns.scale_factor, columns.raw_scale_factor);
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    writer.component(header.component(layer, c), header.component_dim(layer, c),
                     stage0_entries(header, layer, c, block), columns.component[c]);
  }
  return writer.take();
}

}  // namespace l4d

// SPDX-License-Identifier: Apache-2.0
#include "decoder/expand/expand.h"

#include <algorithm>

#include "libl4dcodec/scene/attributes.h"

namespace l4d {
namespace {

// From this many Gaussians on (260 bytes each) the output is larger than the caches of a core.
constexpr uint64_t kPastCacheGaussians = 32768;
// Gaussians reconstructed at a time: the rows between two steps stay in the first-level cache.
constexpr size_t kRowBlock = 256;
// Rows of SH at a time that become binary16: in the second-level cache.
constexpr size_t kHalfBlock = 512;

// The rows of one component, taken front to back.
class ComponentRows {
 public:
  // most: coefficients of a transform that are there, others count as 0.
  ComponentRows(const ReconstructKernels& kernels, const TransformKernels& transform,
                const ComponentCoding& coding, unsigned dim, const ComponentColumns& columns,
                const std::array<const CodebookData*, L4D_MAX_STAGES>& codebooks,
                unsigned most = kMaxCoefficients)
      : kernels_(kernels),
        transform_(transform),
        coding_(coding.coding),
        dim_(dim),
        raw_(columns.raw.data()) {
    if (coding.transform()) {
      coefficients_.dim = dim;
      coefficients_.num_coefficients = std::min(coding.coefficients(), most);
      coefficients_.basis = codebooks[0]->entries.data();
      coefficients_.steps = coding.steps.data();
      if (!codebooks[0]->integer.vectors.empty()) {
        coefficients_.integer_basis = codebooks[0]->integer.vectors.data();
        coefficients_.integer_scale = codebooks[0]->integer.scale;
      }
      coefficients_.step_exponent = columns.step_exponent.data();
      if (coding.eob_table.size() > 1) {
        for (size_t s = 0; s < coding.eob_table.size(); ++s) {
          eob_table_[s] = static_cast<uint8_t>(std::min<unsigned>(coding.eob_table[s], most));
        }
        coefficients_.eob_index = columns.eob_index.data();
        coefficients_.eob_table = eob_table_.data();
      }
      for (size_t k = 0; k < coefficients_.num_coefficients; ++k) {
        coefficients_.coefficient[k] = columns.coefficient[k].data();
      }
    }
    if (!coding.vq()) return;
    source_.dim = dim;
    source_.num_stages = coding.stages.size();
    for (size_t s = 0; s < source_.num_stages; ++s) {
      source_.codebook[s] = codebooks[s]->entries.data();
      source_.index[s] = columns.index[s].data();
    }
    if (coding.has_depth()) source_.depth = columns.depth.data();
    source_.escape = columns.escape.data();
  }

  void rows(size_t begin, size_t end, float* dst, bool past_cache) {
    switch (coding_) {
      case ComponentCodingId::kZero:
        std::fill(dst, dst + (end - begin) * dim_, 0.0f);
        break;
      case ComponentCodingId::kRaw32:
        std::copy(raw_ + begin * dim_, raw_ + end * dim_, dst);
        break;
      case ComponentCodingId::kVq:
        kernels_.vq_rows(source_, cursor_, begin, end, dst, past_cache);
        break;
      case ComponentCodingId::kTransform:
        if (coefficients_.integer_basis != nullptr) {
          transform_.integer_rows(coefficients_, coefficient_cursor_, begin, end, dst, past_cache);
        } else {
          transform_.rows(coefficients_, coefficient_cursor_, begin, end, dst);
        }
        break;
    }
  }

 private:
  const ReconstructKernels& kernels_;
  const TransformKernels& transform_;
  ComponentCodingId coding_;
  unsigned dim_;
  const float* raw_;
  VqSource source_;
  VqCursor cursor_;
  TransformSource coefficients_;
  TransformCursor coefficient_cursor_;
  std::array<uint8_t, kMaxCoefficients> eob_table_{};
};

// Rows of three numbers to rows of four, in place: from the back, so that none is overwritten
// unread.
void spread_rows(float* rows, size_t n) {
  for (size_t i = n; i-- > 0;) {
    for (size_t k = 3; k-- > 0;) rows[4 * i + k] = rows[3 * i + k];
    rows[4 * i + 3] = 0.0f;
  }
}

}  // namespace

void PageExpander::run(const l4d_bucket_span& span, size_t first, const l4d_gaussian_buffers& out) {
  past_cache_ = out.capacity >= kPastCacheGaussians;
  if (out.position != nullptr) positions(out.position + 3 * first);
  if (layer_.flat()) {
    windows(span, first, out);
  } else {
    if (out.mean_t != nullptr || out.mean_t_local != nullptr || out.mean_t_double != nullptr) {
      means(span, first, out);
    }
    if (out.window != nullptr) std::fill_n(out.window + 2 * first, 2 * columns_.n, uint32_t{0});
  }
  if (out.opacity != nullptr) {
    opacities(out.opacity + first);
  }
  if (out.sh != nullptr || out.sh_half != nullptr) spherical_harmonics(first, out);
  if (out.log_scale != nullptr) log_scales(out.log_scale + 4 * first);
  if (out.rotor != nullptr) rotors(out.rotor + 8 * first);
}

void PageExpander::positions(float* dst) const {
  const CoordinateCodingId coding = header_.position_of(layer_);
  if (coding == CoordinateCodingId::kF16) {
    const uint16_t* axes[3] = {columns_.position[0].data(), columns_.position[1].data(),
                               columns_.position[2].data()};
    kernels_.positions(axes, columns_.n, header_.position_center, header_.position_scale, dst);
    return;
  }
  if (coding == CoordinateCodingId::kFixed) {
    const uint32_t* axes[3] = {columns_.fixed_position[0].data(), columns_.fixed_position[1].data(),
                               columns_.fixed_position[2].data()};
    transform_.positions(axes, columns_.n, header_.position_center, header_.position_scale, dst);
    return;
  }
  for (size_t i = 0; i < columns_.n; ++i) {
    for (size_t k = 0; k < 3; ++k) dst[3 * i + k] = columns_.raw_position[k][i];
  }
}

// What is decoded lies anywhere in time: from the bucket's centre, to binary32 and to binary64.
void PageExpander::means(const l4d_bucket_span& span, size_t first,
                         const l4d_gaussian_buffers& out) {
  const size_t n = columns_.n;
  float* const mean_t = out.mean_t == nullptr ? nullptr : out.mean_t + first;
  float* const mean_t_local = out.mean_t_local == nullptr ? nullptr : out.mean_t_local + first;
  double* const exact = out.mean_t_double == nullptr ? nullptr : out.mean_t_double + first;
  if (layer_.has_raw_means()) {
    const bool is_float = layer_.mean_t == CoordinateCodingId::kRaw32;
    for (size_t i = 0; i < n; ++i) {
      const double mean =
          is_float ? static_cast<double>(columns_.raw_mean_t[i]) : columns_.raw64_mean_t[i];
      if (mean_t != nullptr) {
        mean_t[i] = is_float ? columns_.raw_mean_t[i] : static_cast<float>(mean);
      }
      if (mean_t_local != nullptr) mean_t_local[i] = static_cast<float>(mean - span.center);
      if (exact != nullptr) exact[i] = mean;
    }
    return;
  }
  scratch_.means.resize(n);
  float* local = mean_t_local != nullptr ? mean_t_local : scratch_.means.data();
  if (layer_.mean_t == CoordinateCodingId::kF16) {
    kernels_.means(columns_.mean_t.data(), n, static_cast<float>(span.width), local);
  } else if (layer_.mean_t == CoordinateCodingId::kFixed) {
    kernels_.fixed_means(columns_.mean_t.data(),
                         layer_.mean_t_fine ? columns_.mean_t_fine.data() : nullptr, n,
                         layer_.mean_t_step, layer_.mean_t_zero, local);
  } else {
    std::fill(local, local + n, 0.0f);
  }
  if (mean_t != nullptr) kernels_.absolute_means(local, n, span.center, mean_t);
  for (size_t i = 0; i < n && exact != nullptr; ++i) {
    exact[i] = span.center + static_cast<double>(local[i]);
  }
}

// The mean time of a window is its middle.
void PageExpander::windows(const l4d_bucket_span& span, size_t first,
                           const l4d_gaussian_buffers& out) const {
  const l4d_timeline& timeline = header_.timeline;
  const bool wants_means =
      out.mean_t != nullptr || out.mean_t_local != nullptr || out.mean_t_double != nullptr;
  if (!wants_means && out.window == nullptr) return;
  for (size_t i = 0; i < columns_.n; ++i) {
    const FrameWindow window = window_of(layer_, span.bucket, timeline.num_frames, columns_, i);
    if (out.window != nullptr) {
      out.window[2 * (first + i)] = window.begin;
      out.window[2 * (first + i) + 1] = window.end;
    }
    if (!wants_means) continue;
    const double mean = window_middle(timeline, window);
    if (out.mean_t != nullptr) out.mean_t[first + i] = static_cast<float>(mean);
    if (out.mean_t_local != nullptr) {
      out.mean_t_local[first + i] = static_cast<float>(mean - span.center);
    }
    if (out.mean_t_double != nullptr) out.mean_t_double[first + i] = mean;
  }
}

void PageExpander::scalars(const ScalarCoding& coding, const std::vector<uint16_t>& codes,
                           const std::vector<float>& raw, float* dst) const {
  switch (coding.coding) {
    case ScalarCodingId::kConstant:
      std::fill(dst, dst + columns_.n, coding.offset);
      break;
    case ScalarCodingId::kRaw32:
      std::copy_n(raw.data(), columns_.n, dst);
      break;
    case ScalarCodingId::kSq:
      kernels_.scalars(codes.data(), columns_.n, coding.offset, coding.step, dst);
      break;
  }
}

void PageExpander::opacities(float* dst) const {
  const ScalarCoding& coding = header_.opacity;
  scalars(coding, columns_.opacity, columns_.raw_opacity, dst);
  if (header_.opacity_logit || coding.coding == ScalarCodingId::kRaw32) return;
  // Rounding keeps the order of codes: where the first and the last are in range, all are.
  const float codes =
      coding.coding == ScalarCodingId::kSq ? static_cast<float>((1u << coding.bits) - 1u) : 0.0f;
  const auto in_range = [](float v) { return v >= 0.0f && v <= 1.0f; };
  if (in_range(coding.offset) && in_range(coding.offset + coding.step * codes)) return;
  for (size_t i = 0; i < columns_.n; ++i) dst[i] = clamp_opacity(dst[i]);
}

void PageExpander::spherical_harmonics(size_t first, const l4d_gaussian_buffers& out) {
  const size_t dim = header_.sh_dim();
  const auto& codebooks = codebooks_.codebook[L4D_COMPONENT_SH];
  const bool detail = columns_.sh_detail;
  ComponentRows sh(kernels_, transform_, header_.sh, header_.sh_dim(),
                   columns_.component[L4D_COMPONENT_SH], codebooks,
                   detail ? kMaxCoefficients : header_.sh_base);
  const auto rows = [&](size_t begin, size_t end, float* dst) {
    if (detail || header_.sh_base != 0) {
      sh.rows(begin, end, dst, past_cache_ && out.sh_half == nullptr);
      return;
    }
    // Neither step_exponents nor depths are there: rows of no coefficients, or of depth 0.
    for (size_t i = begin; i < end; ++i, dst += dim) {
      if (header_.sh.transform()) {
        std::copy_n(codebooks[0]->entries.data(), dim, dst);
      } else {
        std::fill_n(dst, dim, 0.0f);
      }
    }
  };
  if (out.sh_half == nullptr) return rows(0, columns_.n, out.sh + dim * first);
  scratch_.sh.resize(out.sh == nullptr ? dim * kHalfBlock : 0);
  for (size_t begin = 0; begin < columns_.n; begin += kHalfBlock) {
    const size_t end = std::min(begin + kHalfBlock, columns_.n);
    const size_t at = dim * (first + begin);
    float* const to = out.sh == nullptr ? scratch_.sh.data() : out.sh + at;
    rows(begin, end, to);
    kernels_.halves(to, dim * (end - begin), out.sh_half + at);
  }
}

void PageExpander::log_scales(float* dst) {
  const size_t n = columns_.n;
  const unsigned dim = layer_.scale_dim();
  const ComponentCoding& coding = layer_.component[L4D_COMPONENT_SCALE];
  const bool raw = coding.coding == ComponentCodingId::kRaw32;
  ComponentRows scale(kernels_, transform_, coding, dim, columns_.component[L4D_COMPONENT_SCALE],
                      codebooks_.codebook[L4D_COMPONENT_SCALE]);
  scratch_.rows_a.resize(4 * kRowBlock);
  scratch_.factor.resize(n);
  scalars(layer_.scale_factor, columns_.scale_factor, columns_.raw_scale_factor,
          scratch_.factor.data());
  for (size_t begin = 0; begin < n; begin += kRowBlock, dst += 4 * kRowBlock) {
    const size_t count = std::min(kRowBlock, n - begin);
    float* rows = scratch_.rows_a.data();
    scale.rows(begin, begin + count, rows, false);
    if (dim == 3) spread_rows(rows, count);
    if (raw) {
      std::copy(rows, rows + 4 * count, dst);
    } else {
      // Permanent layers are patched afterwards: those lines are wanted in the cache.
      kernels_.log_scales(scratch_.factor.data() + begin, rows, count, dst,
                          past_cache_ && !layer_.permanent);
    }
    if (layer_.permanent) {
      const float log_scale_t = clamp_log_scale(layer_.log_scale_t);
      for (size_t i = 0; i < count; ++i) dst[4 * i + 3] = log_scale_t;
    }
  }
}

void PageExpander::stereographic_rotors(float* dst) {
  const size_t n = columns_.n;
  const auto rows_of = [&](unsigned c) {
    return ComponentRows(kernels_, transform_, layer_.component[c], 3, columns_.component[c],
                         codebooks_.codebook[c]);
  };
  ComponentRows spatial = rows_of(L4D_COMPONENT_ROTOR_SPATIAL);
  ComponentRows temporal = rows_of(L4D_COMPONENT_ROTOR_TEMPORAL);
  const bool moves = layer_.component[L4D_COMPONENT_ROTOR_TEMPORAL].transform();
  scratch_.rows_a.resize(4 * kRowBlock);
  scratch_.rows_b.resize(4 * kRowBlock);
  float* a = scratch_.rows_a.data();
  float* b = moves ? scratch_.rows_b.data() : nullptr;
  for (size_t begin = 0; begin < n; begin += kRowBlock, dst += 8 * kRowBlock) {
    const size_t count = std::min(kRowBlock, n - begin);
    spatial.rows(begin, begin + count, a, false);
    if (moves) temporal.rows(begin, begin + count, b, false);
    transform_.rotors(a, b, count, dst, past_cache_);
  }
}

void PageExpander::rotors(float* dst) {
  if (SceneHeader::stereographic_rotor(layer_)) return stereographic_rotors(dst);
  const size_t n = columns_.n;
  const auto rows_of = [&](unsigned c) {
    return ComponentRows(kernels_, transform_, layer_.component[c], 4, columns_.component[c],
                         codebooks_.codebook[c]);
  };
  ComponentRows spatial = rows_of(L4D_COMPONENT_ROTOR_SPATIAL);
  ComponentRows temporal = rows_of(L4D_COMPONENT_ROTOR_TEMPORAL);
  scratch_.rows_a.resize(4 * kRowBlock);
  scratch_.rows_b.resize(4 * kRowBlock);
  float* a = scratch_.rows_a.data();
  float* b = scratch_.rows_b.data();
  for (size_t begin = 0; begin < n; begin += kRowBlock, dst += 8 * kRowBlock) {
    const size_t count = std::min(kRowBlock, n - begin);
    spatial.rows(begin, begin + count, a, false);
    temporal.rows(begin, begin + count, b, false);
    if (SceneHeader::normalizes_rotor(layer_)) {
      kernels_.rotors(a, b, count, dst, past_cache_);
      continue;
    }
    for (size_t i = 0; i < count; ++i) {
      std::copy_n(a + 4 * i, 4, dst + 8 * i);
      std::copy_n(b + 4 * i, 4, dst + 8 * i + 4);
    }
  }
}

}  // namespace l4d

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstring>

#include "libl4dcodec/base/half.h"
#include "libl4dcodec/container/scene_header.h"
#include "libl4dcodec/quant/codebook.h"
#include "tests/kernels/kernel_call.h"

namespace l4d::test {
namespace {

// Parameters at the ends of what a scene header may hold, and ordinary ones.
float parameter(const CallOptions& o, Random& random) {
  switch (o.fill) {
    case Fill::kRandom:
      return random.uniformf(-10, 10);
    case Fill::kLow:
      return 0x1p-60f;
    case Fill::kHigh:
      return -0x1p60f;
    default:
      return random.below(2) == 0 ? 0.0f : 0x1.fffffep-3f;
  }
}

std::vector<float> floats_of_halves(const CallOptions& o, size_t n, uint64_t salt) {
  CallOptions salted = o;
  salted.seed += salt * 1000;
  std::vector<float> out;
  for (const uint16_t h : halves(salted, n)) out.push_back(half_to_float(h));
  return out;
}

std::unique_ptr<Call> make_positions(const CallOptions& o) {
  Random random(o.seed);
  std::vector<uint16_t> columns[3];
  for (uint64_t k = 0; k < 3; ++k) {
    CallOptions salted = o;
    salted.seed += k;
    columns[k] = halves(salted, o.n + o.offset);
  }
  const float center[3] = {parameter(o, random), parameter(o, random), parameter(o, random)};
  const float scale = o.fill == Fill::kHigh ? 0x1p60f : 0x1p-7f;
  return std::make_unique<ArrayCall<float>>(
      3 * o.n, o.offset, std::vector<float>(),
      [x = columns[0], y = columns[1], z = columns[2], c0 = center[0], c1 = center[1],
       c2 = center[2], scale, o](const Kernels& k, float* out) -> uint64_t {
        const uint16_t* const axes[3] = {x.data() + o.offset, y.data() + o.offset,
                                         z.data() + o.offset};
        const float c[3] = {c0, c1, c2};
        k.reconstruct->positions(axes, o.n, c, scale, out);
        return 0;
      });
}

std::unique_ptr<Call> make_means(const CallOptions& o) {
  const float width = o.fill == Fill::kLow ? 0x1p-57f : 1.25f;
  return std::make_unique<ArrayCall<float>>(
      o.n, o.offset, std::vector<float>(),
      [in = halves(o, o.n + o.offset), width, o](const Kernels& k, float* out) -> uint64_t {
        k.reconstruct->means(in.data() + o.offset, o.n, width, out);
        return 0;
      });
}

// With the finer part of mean times or without.
template <bool kFine>
std::unique_ptr<Call> make_fixed_means(const CallOptions& o) {
  CallOptions salted = o;
  salted.seed += 1;
  const float step = o.fill == Fill::kLow ? 0x1p-57f : 0.0125f;
  const uint32_t zero = o.fill == Fill::kHigh ? 65535 : 300;
  return std::make_unique<ArrayCall<float>>(
      o.n, o.offset, std::vector<float>(),
      [in = integers(o, o.n + o.offset, 16), fine = integers(salted, o.n + o.offset, 16), step,
       zero, o](const Kernels& k, float* out) -> uint64_t {
        k.reconstruct->fixed_means(in.data() + o.offset, kFine ? fine.data() + o.offset : nullptr,
                                   o.n, step, zero, out);
        return 0;
      });
}

std::unique_ptr<Call> make_absolute_means(const CallOptions& o) {
  const double center = o.fill == Fill::kHigh ? 86399.98765 : 1.0 / 3;
  return std::make_unique<ArrayCall<float>>(o.n, o.offset, std::vector<float>(),
                                            [in = floats_of_halves(o, o.n + o.offset, 3), center,
                                             o](const Kernels& k, float* out) -> uint64_t {
                                              k.reconstruct->absolute_means(in.data() + o.offset,
                                                                            o.n, center, out);
                                              return 0;
                                            });
}

std::unique_ptr<Call> make_scalars(const CallOptions& o) {
  Random random(o.seed);
  const float offset = parameter(o, random);
  const float step = parameter(o, random);
  return std::make_unique<ArrayCall<float>>(o.n, o.offset, std::vector<float>(),
                                            [in = integers(o, o.n + o.offset, 16), offset, step, o](
                                                const Kernels& k, float* out) -> uint64_t {
                                              k.reconstruct->scalars(in.data() + o.offset, o.n,
                                                                     offset, step, out);
                                              return 0;
                                            });
}

// A VQ component; rows are taken in two calls to see that the cursor is carried.
struct VqInput {
  std::vector<std::vector<float>> codebooks;
  std::vector<std::vector<uint16_t>> index;
  std::vector<uint8_t> depth;
  std::vector<uint16_t> escape;
};

template <size_t kDim, size_t kStages, bool kDepth>
std::unique_ptr<Call> make_vq(const CallOptions& o) {
  Random random(o.seed + kDim);
  constexpr uint32_t kEntries = 257;
  auto input = std::make_shared<VqInput>();
  std::vector<size_t> count(kStages, kDepth ? 0 : o.n);
  size_t num_escapes = 0;
  for (size_t i = 0; kDepth && i < o.n; ++i) {
    const uint32_t r = random.below(kStages + 3);
    const uint32_t depth = o.fill == Fill::kLow    ? 0
                           : o.fill == Fill::kHigh ? kEscapeDepth
                           : r > kStages           ? kEscapeDepth
                                                   : r;
    input->depth.push_back(static_cast<uint8_t>(depth));
    num_escapes += depth == kEscapeDepth;
    for (size_t s = 0; s < kStages && depth != kEscapeDepth && s < depth; ++s) ++count[s];
  }
  for (size_t s = 0; s < kStages; ++s) {
    input->codebooks.push_back(floats_of_halves(o, kEntries * kDim, s + 1));
    input->codebooks.back().resize(kEntries * kDim + CodebookData::kPadding, 0.0f);
    std::vector<uint16_t> index(count[s]);
    for (uint16_t& v : index) {
      v = static_cast<uint16_t>(o.fill == Fill::kLow    ? 0
                                : o.fill == Fill::kHigh ? kEntries - 1
                                                        : random.below(kEntries));
    }
    input->index.push_back(std::move(index));
  }
  input->escape = halves(o, num_escapes * kDim);
  return std::make_unique<ArrayCall<float>>(
      o.n * kDim, o.offset, std::vector<float>(),
      [input, o](const Kernels& k, float* out) -> uint64_t {
        VqSource source;
        source.dim = kDim;
        source.num_stages = kStages;
        for (size_t s = 0; s < kStages; ++s) {
          source.codebook[s] = input->codebooks[s].data();
          source.index[s] = input->index[s].data();
        }
        if (kDepth) source.depth = input->depth.data();
        source.escape = input->escape.data();
        VqCursor cursor;
        const size_t middle = o.n / 3;
        k.reconstruct->vq_rows(source, cursor, 0, middle, out, o.past_cache);
        k.reconstruct->vq_rows(source, cursor, middle, o.n, out + kDim * middle, o.past_cache);
        uint64_t places = cursor.escape;
        for (const size_t i : cursor.index) places = places * 31 + i;
        return places;
      });
}

std::unique_ptr<Call> make_log_scales(const CallOptions& o) {
  Random random(o.seed);
  const float offset = parameter(o, random);
  std::vector<float> factor(o.n + o.offset);
  for (float& f : factor) f = offset + 0.03125f * static_cast<float>(random.below(65536));
  return std::make_unique<ArrayCall<float>>(
      4 * o.n, o.offset, std::vector<float>(),
      [factor, rows = floats_of_halves(o, 4 * (o.n + o.offset), 7), o](const Kernels& k,
                                                                       float* out) -> uint64_t {
        k.reconstruct->log_scales(factor.data() + o.offset, rows.data() + 4 * o.offset, o.n, out,
                                  o.past_cache);
        return 0;
      });
}

std::unique_ptr<Call> make_rotors(const CallOptions& o) {
  Random random(o.seed);
  std::vector<float> spatial = floats_of_halves(o, 4 * (o.n + o.offset), 8);
  std::vector<float> temporal = floats_of_halves(o, 4 * (o.n + o.offset), 9);
  for (size_t i = 0; i + 4 <= spatial.size() && o.fill != Fill::kHigh; i += 4) {
    // Ordinary rotors, halves that vanish exactly, and some about the threshold of 1e-12.
    const uint32_t kind = random.below(5);
    for (size_t k = 0; k < 4; ++k) {
      if (kind == 0) spatial[i + k] = random.uniformf(-1, 1);
      if (kind == 0) temporal[i + k] = random.uniformf(-0.1, 0.1);
      if (kind == 1) spatial[i + k] = random.below(2) == 0 ? 0.0f : -0.0f;
      if (kind == 1) temporal[i + k] = 0;
      if (kind == 2) spatial[i + k] = k == 0 ? 0x1p-20f * random.uniformf(0.9, 1.1) : 0;
      if (kind == 2) temporal[i + k] = 0;
    }
    if (kind == 3) {  // one half vanishes: A = S + Q
      temporal[i + 3] = -spatial[i];
      temporal[i + 2] = spatial[i + 1];
      temporal[i + 1] = -spatial[i + 2];
      temporal[i] = spatial[i + 3];
    }
  }
  return std::make_unique<ArrayCall<float>>(
      8 * o.n, o.offset, std::vector<float>(),
      [spatial, temporal, o](const Kernels& k, float* out) -> uint64_t {
        k.reconstruct->rotors(spatial.data() + 4 * o.offset, temporal.data() + 4 * o.offset, o.n,
                              out, o.past_cache);
        return 0;
      });
}

// Numbers of any bits, halves, and what lies halfway between two of them or a bit beside that.
std::unique_ptr<Call> make_halves(const CallOptions& o) {
  Random random(o.seed);
  std::vector<float> from(o.n + o.offset);
  for (float& x : from) {
    uint32_t bits = random.below(0x10000) << 16 | random.below(0x10000);
    const uint32_t kind = random.below(4);
    if (kind != 0) {
      const float half = half_to_float(static_cast<uint16_t>(bits));
      std::memcpy(&bits, &half, sizeof(bits));
      if (kind != 1) bits += 0x1000 + random.below(3) - 1;
    }
    std::memcpy(&x, &bits, sizeof(bits));
  }
  return std::make_unique<ArrayCall<uint16_t>>(
      o.n, o.offset, std::vector<uint16_t>(),
      [from, o](const Kernels& k, uint16_t* out) -> uint64_t {
        k.reconstruct->halves(from.data() + o.offset, o.n, out);
        return 0;
      });
}

}  // namespace

const std::vector<Operation>& reconstruct_operations() {
  static const std::vector<Operation> kOperations = {
      {"positions", make_positions},
      {"means", make_means},
      {"fixed_means", make_fixed_means<false>},
      {"fixed_means_fine", make_fixed_means<true>},
      {"absolute_means", make_absolute_means},
      {"scalars", make_scalars},
      {"vq_rows_3", make_vq<3, 1, false>},
      {"vq_rows_4", make_vq<4, 1, false>},
      {"vq_rows_12", make_vq<12, 1, false>},
      {"vq_rows_27", make_vq<27, 1, false>},
      {"vq_rows_48", make_vq<48, 1, false>},
      {"vq_rows_4_stages_3", make_vq<4, 3, true>},
      {"vq_rows_48_stages_3", make_vq<48, 3, true>},
      {"vq_rows_3_stages_8", make_vq<3, 8, true>},
      {"vq_rows_12_stages_2_full", make_vq<12, 2, false>},
      {"vq_rows_4_escapes", make_vq<4, 1, true>},
      {"log_scales", make_log_scales},
      {"rotors", make_rotors},
      {"halves", make_halves}};
  return kOperations;
}

}  // namespace l4d::test

// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/base/half.h"
#include "libl4dcodec/container/page.h"
#include "libl4dcodec/quant/codebook.h"
#include "tests/kernels/kernel_call.h"

namespace l4d::test {
namespace {

// How common the EOB indices of an EOB table of five steps are in SH of a typical scene, in
// percent.
constexpr uint32_t kEobIndexPercent[] = {5, 30, 17, 33, 11, 4};

uint8_t typical_eob_index(Random& random) {
  uint32_t r = random.below(100);
  uint8_t eob_index = 0;
  while (r >= kEobIndexPercent[eob_index]) r -= kEobIndexPercent[eob_index++];
  return eob_index;
}

// A value of `fill` among 0..last.
uint8_t choice(const CallOptions& o, Random& random, size_t last) {
  switch (o.fill) {
    case Fill::kRandom:
      return static_cast<uint8_t>(random.below(static_cast<uint32_t>(last + 1)));
    case Fill::kLow:
      return static_cast<uint8_t>(random.below(16) == 0 ? last : 0);
    case Fill::kHigh:
      return static_cast<uint8_t>(random.below(16) == 0 ? 0 : last);
    default:
      return static_cast<uint8_t>(random.below(2) == 0 ? 0 : last);
  }
}

// A step within what a scene header may hold.
float step_of(const CallOptions& o, Random& random) {
  if (o.fill == Fill::kRandom) return random.uniformf(0.001, 0.1);
  return choice(o, random, 1) == 0 ? 0x1p-30f : 0x1p10f;
}

struct TransformInput {
  std::vector<float> basis, steps;
  std::vector<int16_t> integer_basis;  // empty: rows of floats
  std::vector<uint8_t> step_exponent, eob_index, eob_table;
  std::vector<std::vector<int16_t>> coefficient;
};

// Any 16-bit numbers but the least, which no basis has: their sums pass 2^31 at the ends.
std::vector<int16_t> integer_vectors(const CallOptions& o, size_t n) {
  CallOptions salted = o;
  salted.seed += 7000;
  std::vector<int16_t> out;
  for (const uint16_t v : integers(salted, n, 16)) {
    out.push_back(static_cast<int16_t>(v == 0x8000 ? 0x8001 : v));
  }
  return out;
}

// Rows are taken in two calls to see that the cursor is carried. An empty EOB table: all have all.
template <bool kIntegers = false>
std::unique_ptr<Call> make_rows(const CallOptions& o, size_t dim, size_t num_coefficients,
                                std::vector<uint8_t> eob_table) {
  Random random(o.seed + dim);
  auto input = std::make_shared<TransformInput>();
  for (const uint16_t h : halves(o, (num_coefficients + 1) * dim)) {
    input->basis.push_back(half_to_float(h));
  }
  input->basis.resize(input->basis.size() + CodebookData::kPadding, 1e30f);
  if (kIntegers) input->integer_basis = integer_vectors(o, num_coefficients * dim);
  input->step_exponent.resize(o.offset);
  input->eob_index.resize(o.offset);
  std::vector<size_t> count(num_coefficients, 0);
  for (size_t i = 0; i < o.n; ++i) {
    input->step_exponent.push_back(choice(o, random, 15));
    const bool typical = eob_table.size() == 5 && o.fill == Fill::kRandom;
    const uint8_t eob_index =
        typical ? typical_eob_index(random) : choice(o, random, eob_table.size());
    input->eob_index.push_back(eob_index);
    const size_t has = eob_table.empty() ? num_coefficients
                       : eob_index == 0  ? 0
                                         : eob_table[eob_index - 1u];
    for (size_t k = 0; k < has; ++k) ++count[k];
  }
  for (size_t k = 0; k < num_coefficients; ++k) {
    input->steps.push_back(step_of(o, random));
    CallOptions salted = o;
    salted.seed += 100 * (k + 1);
    std::vector<int16_t> q;
    for (const uint16_t v : integers(salted, count[k], 16)) {
      // Integers about 0, 2^15 and 2^16: here 0, -2^15 and -1.
      q.push_back(static_cast<int16_t>(v));
    }
    q.insert(q.end(), kCoefficientPadding, int16_t{0x7a5a});
    input->coefficient.push_back(std::move(q));
  }
  input->eob_table = std::move(eob_table);
  return std::make_unique<ArrayCall<float>>(
      o.n * dim, o.offset, std::vector<float>(),
      [input, dim, o](const Kernels& k, float* out) -> uint64_t {
        TransformSource source;
        source.dim = dim;
        source.num_coefficients = input->steps.size();
        source.basis = input->basis.data();
        source.steps = input->steps.data();
        source.step_exponent = input->step_exponent.data() + o.offset;
        if (!input->eob_table.empty()) {
          source.eob_index = input->eob_index.data() + o.offset;
          source.eob_table = input->eob_table.data();
        }
        for (size_t c = 0; c < input->steps.size(); ++c) {
          source.coefficient[c] = input->coefficient[c].data();
        }
        TransformCursor cursor;
        const size_t middle = o.n / 3;
        float* const rest = out + dim * middle;
        if (kIntegers) {
          source.integer_basis = input->integer_basis.data();
          source.integer_scale = 0x1p-20f;
          k.transform->integer_rows(source, cursor, 0, middle, out, o.past_cache);
          k.transform->integer_rows(source, cursor, middle, o.n, rest, o.past_cache);
        } else {
          k.transform->rows(source, cursor, 0, middle, out);
          k.transform->rows(source, cursor, middle, o.n, rest);
        }
        uint64_t places = 0;
        for (const size_t at : cursor.coefficient) places = places * 31 + at;
        return places;
      });
}

std::unique_ptr<Call> make_rows_3(const CallOptions& o) { return make_rows(o, 3, 3, {}); }
std::unique_ptr<Call> make_rows_4(const CallOptions& o) { return make_rows(o, 4, 4, {}); }
std::unique_ptr<Call> make_rows_4_few(const CallOptions& o) { return make_rows(o, 4, 2, {}); }
std::unique_ptr<Call> make_rows_3_eob_table(const CallOptions& o) {
  return make_rows(o, 3, 3, {1, 3});
}
std::unique_ptr<Call> make_integer_rows_3(const CallOptions& o) {
  return make_rows<true>(o, 3, 3, {});
}
std::unique_ptr<Call> make_integer_rows_12(const CallOptions& o) {
  return make_rows<true>(o, 12, 12, {2, 4, 6, 9, 12});
}
std::unique_ptr<Call> make_integer_rows_27(const CallOptions& o) {
  return make_rows<true>(o, 27, 27, {3, 8, 13, 20, 27});
}
std::unique_ptr<Call> make_integer_rows_48(const CallOptions& o) {
  return make_rows<true>(o, 48, 48, {3, 8, 16, 28, 48});
}
std::unique_ptr<Call> make_integer_rows_48_full(const CallOptions& o) {
  return make_rows<true>(o, 48, 48, {});
}
// The longest EOB table: a step for each coefficient.
std::unique_ptr<Call> make_integer_rows_48_steps(const CallOptions& o) {
  std::vector<uint8_t> eob_table;
  while (eob_table.size() < 48) eob_table.push_back(static_cast<uint8_t>(eob_table.size() + 1));
  return make_rows<true>(o, 48, 48, std::move(eob_table));
}
// What the base of SH leaves of an EOB table: equal numbers at its end.
std::unique_ptr<Call> make_integer_rows_48_base(const CallOptions& o) {
  return make_rows<true>(o, 48, 3, {2, 3, 3, 3, 3});
}

std::vector<float> stereographic(const CallOptions& o, size_t n, uint64_t salt) {
  static constexpr float kEdges[] = {0.0f, -0.0f, 1.0f, -1.0f, 0x1p-60f, -0x1p20f, 0x1.fffffep-1f};
  Random random(o.seed + salt);
  std::vector<float> u(3 * n);
  for (float& x : u) {
    x = o.fill == Fill::kRandom ? random.uniformf(-1.5, 1.5)
        : o.fill == Fill::kLow  ? random.uniformf(-0x1p-40, 0x1p-40)
        : o.fill == Fill::kHigh ? random.uniformf(-0x1p20, 0x1p20)
                                : kEdges[random.below(7)];
  }
  return u;
}

template <bool kMoves>
std::unique_ptr<Call> make_rotors(const CallOptions& o) {
  return std::make_unique<ArrayCall<float>>(8 * o.n, o.offset, std::vector<float>(),
                                            [spatial = stereographic(o, o.n + o.offset, 1),
                                             temporal = stereographic(o, o.n + o.offset, 2),
                                             o](const Kernels& k, float* out) -> uint64_t {
                                              k.transform->rotors(
                                                  spatial.data() + 3 * o.offset,
                                                  kMoves ? temporal.data() + 3 * o.offset : nullptr,
                                                  o.n, out, o.past_cache);
                                              return 0;
                                            });
}

std::unique_ptr<Call> make_positions(const CallOptions& o) {
  Random random(o.seed);
  std::vector<uint32_t> columns[3];
  for (std::vector<uint32_t>& column : columns) {
    for (size_t i = 0; i < o.n + o.offset; ++i) {
      column.push_back(o.fill == Fill::kRandom ? random.below(1u << 21)
                                               : 0x1fffffu * choice(o, random, 1));
    }
  }
  const float step = o.fill == Fill::kHigh ? 0x1.8p40f : 0x1.234p-15f;
  const float corner[3] = {random.uniformf(-50, 50), random.uniformf(-50, 50),
                           random.uniformf(-50, 50)};
  return std::make_unique<ArrayCall<float>>(
      3 * o.n, o.offset, std::vector<float>(),
      [x = columns[0], y = columns[1], z = columns[2], c0 = corner[0], c1 = corner[1],
       c2 = corner[2], step, o](const Kernels& k, float* out) -> uint64_t {
        const uint32_t* const axes[3] = {x.data() + o.offset, y.data() + o.offset,
                                         z.data() + o.offset};
        const float c[3] = {c0, c1, c2};
        k.transform->positions(axes, o.n, c, step, out);
        return 0;
      });
}

}  // namespace

const std::vector<Operation>& transform_operations() {
  static const std::vector<Operation> kOperations = {
      {"transform_rows_3", make_rows_3},
      {"transform_rows_4", make_rows_4},
      {"transform_rows_4_few", make_rows_4_few},
      {"transform_rows_3_eob_table", make_rows_3_eob_table},
      {"integer_rows_3", make_integer_rows_3},
      {"integer_rows_12", make_integer_rows_12},
      {"integer_rows_27", make_integer_rows_27},
      {"integer_rows_48", make_integer_rows_48},
      {"integer_rows_48_full", make_integer_rows_48_full},
      {"integer_rows_48_steps", make_integer_rows_48_steps},
      {"integer_rows_48_base", make_integer_rows_48_base},
      {"transform_rotors", make_rotors<true>},
      {"transform_rotors_still", make_rotors<false>},
      {"transform_positions", make_positions}};
  return kOperations;
}

}  // namespace l4d::test

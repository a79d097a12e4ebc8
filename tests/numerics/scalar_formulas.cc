// SPDX-License-Identifier: Apache-2.0
// Numbers one at a time: binary16, ordered integers, scalar codes.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "encoder/prepare/scalar.h"
#include "libl4dcodec/base/half.h"
#include "libl4dcodec/base/ordered.h"
#include "tests/math/reference.h"
#include "tests/numerics/formula.h"

namespace l4d::numerics {
namespace {

using reference::Random;
using reference::Real;

// A prime, so that all low bits occur.
uint64_t stride() { return full() ? 1 : 997; }

float float_of(uint32_t bits) {
  float v;
  std::memcpy(&v, &bits, sizeof v);
  return v;
}

// The value of a finite binary16 by its definition.
Real half_value(uint16_t h) {
  const int exponent = (h >> 10) & 31;
  const int mantissa = h & 1023;
  const Real magnitude = exponent == 0 ? std::ldexp(Real(mantissa), -24)
                                       : std::ldexp(Real(1024 + mantissa), exponent - 25);
  return (h & 0x8000) != 0 ? -magnitude : magnitude;
}

Observed half_decode() {
  Observed o;
  for (uint32_t h = 0; h <= 0xffff; ++h) {
    const uint16_t half = static_cast<uint16_t>(h);
    if (!half_is_finite(half)) continue;
    o.add(static_cast<double>(std::fabs(Real(half_to_float(half)) - half_value(half))));
  }
  return o;
}

// Error of a rounding, in half steps of the result. The naive way cuts bits off.
Observed half_encode() {
  Observed o;
  for (uint64_t bits = 0; bits <= 0xffffffffu; bits += stride()) {
    const float v = float_of(static_cast<uint32_t>(bits));
    if (!(std::fabs(v) < 65520)) continue;
    const uint16_t h = float_to_half(v);
    const int exponent = std::max(std::ilogb(std::fabs(v)), -14);
    const double half_step = v == 0 ? 1 : std::ldexp(1.0, exponent - 11);
    o.add(std::fabs(static_cast<double>(half_to_float(h)) - static_cast<double>(v)) / half_step);
    const Real steps = std::trunc(Real(v) / Real(2 * half_step));
    o.add_naive(static_cast<double>(std::fabs(steps * 2 - Real(v) / Real(half_step))));
  }
  return o;
}

// Integers out of order, or values that do not come back.
Observed ordered_half() {
  Observed o;
  for (uint32_t a = 0; a <= 0xffff; ++a) {
    const uint16_t half = unorder_half(static_cast<uint16_t>(a));
    bool wrong = order_half(half) != a;
    if (a > 0) {
      const uint16_t before = unorder_half(static_cast<uint16_t>(a - 1));
      if (half_is_finite(half) && half_is_finite(before)) {
        // Only the two zeros are equal.
        wrong = wrong || half_value(before) > half_value(half) ||
                (half_value(before) == half_value(half) && (half & 0x7fff) != 0);
      }
    }
    o.add(wrong);
  }
  return o;
}

Observed ordered_float() {
  Observed o;
  float before = -HUGE_VALF;
  for (uint64_t a = 0x00800000; a < 0xff800000u; a += stride()) {
    const float v = unorder_float(static_cast<uint32_t>(a));
    if (std::isnan(v)) continue;
    o.add(order_float(v) != a || before > v);
    before = v;
  }
  return o;
}

// All codes of a coding over a range of values, for all numbers of bits up to 8 and some above.
template <typename Check>
void for_all_codes(uint64_t seed, bool opacity, const Check& check) {
  Random random(seed);
  for (int i = 0; i < 4000; ++i) {
    const unsigned bits = i % 40 == 0 ? 16 : i % 40 == 1 ? 12 : 1 + static_cast<unsigned>(i % 8);
    float low, high;
    if (opacity) {
      low = i % 3 == 0 ? 0.0f : static_cast<float>(random.log_uniform(1e-6, 0.5));
      high = i % 2 == 0 ? 1.0f : static_cast<float>(random.uniform(0.5, 1.0));
    } else {
      const double a = random.uniform(-16.0, 16.0);
      low = static_cast<float>(a);
      high = static_cast<float>(std::min(16.0, a + random.log_uniform(1e-3, 32.0)));
      if (!(high > low)) continue;
    }
    const ScalarCoding coding = choose_scalar_coding({low, high}, bits);
    if (coding.coding != ScalarCodingId::kSq) continue;
    for (uint32_t code = 0; code < 1u << bits; ++code) {
      check(coding, code, coding.offset + coding.step * static_cast<float>(code), low, high);
    }
  }
}

// The arithmetic of the decoder against the line that offset and step declare.
Observed code_value() {
  Observed o;
  for_all_codes(121, false, [&](const ScalarCoding& c, uint32_t code, float value, float, float) {
    const Real expected = Real(c.offset) + Real(c.step) * Real(code);
    const Real unit = std::max(std::fabs(Real(c.offset)), std::fabs(Real(c.step) * Real(code)));
    o.add(unit > 0 ? static_cast<double>(std::fabs(Real(value) - expected) / unit) : 0);
  });
  return o;
}

// Any value of the range to its code and back: half a step and the rounding of the end.
Observed code_error() {
  Observed o;
  Random random(122);
  for_all_codes(123, false, [&](const ScalarCoding& c, uint32_t, float, float low, float high) {
    const float v =
        std::min(high, std::max(low, static_cast<float>(random.uniform(
                                         static_cast<double>(low), static_cast<double>(high)))));
    const float back = c.offset + c.step * static_cast<float>(scalar_code(c, v));
    const Real largest = std::max(std::fabs(Real(low)), std::fabs(Real(high)));
    const Real allowed = Real(c.step) / 2 + Real(2 * kU32) * largest;
    o.add(static_cast<double>(std::fabs(Real(back) - Real(v)) / allowed));
    // Codes by cutting off instead of rounding.
    const float cut = c.offset + c.step * std::floor((v - c.offset) / c.step);
    o.add_naive(static_cast<double>(std::fabs(Real(cut) - Real(v)) / allowed));
  });
  return o;
}

// How far beyond 0..1 a decoded opacity lies: such a scene could not be encoded again.
Observed opacity_excess() {
  Observed o;
  for_all_codes(124, true, [&](const ScalarCoding&, uint32_t, float value, float, float) {
    o.add(std::max({0.0, static_cast<double>(value) - 1, -static_cast<double>(value)}));
  });
  return o;
}

std::vector<Formula> list() {
  return {
      {"half_decode", "half_to_float", "definition, long double", "all finite binary16",
       "absolute error", "exact", "", 0, half_decode},
      {"half_encode", "float_to_half", "the float itself",
       "all floats below 65520 (at a stride unless --full)", "error in half steps of the result",
       "rounding to nearest", "cutting bits off", 1, half_encode},
      {"half_order", "order_half, unorder_half", "definition, long double", "all binary16",
       "1 where the order or the way back is wrong", "exact", "", 0, ordered_half},
      {"float_order", "order_float, unorder_float", "order of floats",
       "all floats (at a stride unless --full)", "1 where the order or the way back is wrong",
       "exact", "", 0, ordered_float},
      {"scalar_value", "offset + step code in binary32", "long double",
       "every code of 1 to 8, 12 and 16 bits, ranges of log scales", "error : largest of the terms",
       "2 roundings, of a product and of a sum up to twice as large", "", 3 * kU32, code_value},
      {"scalar_error", "scalar_code and back", "the value",
       "values of ranges of log scales, 1 to 16 bits",
       "error : half a step + 2 roundings of the larger end", "rounding to nearest", "cutting off",
       1.5, code_error},
      {"opacity_range", "offset + step code in binary32", "0 and 1",
       "every code of 1 to 8, 12 and 16 bits, ranges within 0..1", "excess over 0..1",
       "the step is chosen so that its last code does not exceed the range", "", 0, opacity_excess},
  };
}
const Register kRegister(list);

}  // namespace
}  // namespace l4d::numerics

// SPDX-License-Identifier: Apache-2.0
#include "eval/jod/jod.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

// Against what ColorVideoVDP 0.5.6 says of videos that are made of whole numbers.
namespace l4d::eval {
namespace {

struct Video {
  uint32_t frames, height, width;
  std::vector<uint8_t> bytes;  // [frames, height, width, 3]
  Video(uint32_t f, uint32_t h, uint32_t w)
      : frames(f), height(h), width(w), bytes(size_t{3} * f * h * w) {}
  uint8_t& at(uint32_t f, uint32_t y, uint32_t x, uint32_t c) {
    return bytes[((size_t{f} * height + y) * width + x) * 3 + c];
  }
  uint8_t at(uint32_t f, uint32_t y, uint32_t x, uint32_t c) const {
    return bytes[((size_t{f} * height + y) * width + x) * 3 + c];
  }
  template <typename Value>
  Video& fill(const Value& value) {
    for (uint32_t f = 0; f < frames; ++f) {
      for (uint32_t y = 0; y < height; ++y) {
        for (uint32_t x = 0; x < width; ++x) {
          for (uint32_t c = 0; c < 3; ++c) {
            at(f, y, x, c) = static_cast<uint8_t>(std::clamp(value(f, y, x, c), 0, 255));
          }
        }
      }
    }
    return *this;
  }
  io::Image image(uint32_t frame) const {
    io::Image out(width, height);
    io::from_bytes(&bytes[size_t{3} * frame * height * width], out.rgb.size(), out.rgb.data());
    return out;
  }
  uint64_t hash() const {
    uint64_t hash = 0xcbf29ce484222325U;
    for (const uint8_t byte : bytes) hash = (hash ^ byte) * 0x100000001b3U;
    return hash;
  }
};

uint32_t hash_of(uint32_t v) {
  v ^= v >> 16;
  v *= 0x7feb352dU;
  v ^= v >> 15;
  v *= 0x846ca68bU;
  return v ^ v >> 16;
}
int noise(const Video& v, uint32_t seed, uint32_t f, uint32_t y, uint32_t x, uint32_t c) {
  const uint32_t index = ((f * v.height + y) * v.width + x) * 3 + c;
  return static_cast<int>(hash_of(index + seed * 0x9e3779b9U) & 255U);
}
int triangle(int t, int period) {
  const int m = (t % period + period) % period;
  return (m < period / 2 ? m : period - m) * 510 / period;
}

Video scene(uint32_t frames, uint32_t height, uint32_t width) {
  Video v(frames, height, width);
  return v.fill([&](uint32_t f, uint32_t y, uint32_t x, uint32_t c) {
    const uint32_t side = std::min(height, width) / 4;
    const uint32_t left = width / 8 + 2 * f, top = height / 3;
    if (x >= left && x < left + side && y >= top && y < top + side) return 200;
    const int at = static_cast<int>(x), down = static_cast<int>(y), when = static_cast<int>(f);
    const int base = c == 0   ? 40 + triangle(4 * at + 2 * down + 6 * when, 128) * 160 / 255
                     : c == 1 ? 30 + triangle(3 * down - at + 4 * when, 96) * 180 / 255
                              : 60 + triangle(2 * at + 5 * down, 200) * 120 / 255;
    return base + (noise(v, 7, 0, y, x, c) & 31) - 16;
  });
}

Video with_noise(const Video& of, uint32_t seed, int most, bool is_static = false) {
  Video v = of;
  return v.fill([&](uint32_t f, uint32_t y, uint32_t x, uint32_t c) {
    return of.at(f, y, x, c) + noise(of, seed, is_static ? 0 : f, y, x, c) % (2 * most + 1) - most;
  });
}

Video boxed(const Video& of) {
  Video v = of;
  return v.fill([&](uint32_t f, uint32_t y, uint32_t x, uint32_t c) {
    int sum = 12;
    for (int dy = -2; dy <= 2; ++dy) {
      for (int dx = -2; dx <= 2; ++dx) {
        const int row = std::clamp(static_cast<int>(y) + dy, 0, static_cast<int>(of.height) - 1);
        const int column = std::clamp(static_cast<int>(x) + dx, 0, static_cast<int>(of.width) - 1);
        sum += of.at(f, static_cast<uint32_t>(row), static_cast<uint32_t>(column), c);
      }
    }
    return sum / 25;
  });
}

// Reference and test.
std::pair<Video, Video> pair_of(const std::string& name, uint32_t n, uint32_t h, uint32_t w) {
  Video reference = scene(n, h, w);
  Video test = reference;
  const auto changed = [&](const auto& step) {
    return test.fill([&](uint32_t f, uint32_t y, uint32_t x, uint32_t c) {
      return reference.at(f, y, x, c) + step(f, c);
    });
  };
  if (name.rfind("noise_", 0) == 0) {
    test = with_noise(reference, 1, std::stoi(name.substr(6)));
  } else if (name.rfind("blur", 0) == 0) {
    test = boxed(reference);
  } else if (name == "colour_shift") {
    changed([](uint32_t, uint32_t c) { return c == 0 ? 12 : c == 2 ? -12 : 0; });
  } else if (name == "flicker") {
    changed([](uint32_t f, uint32_t) { return f % 4 < 2 ? 8 : -8; });
  } else if (name == "grating_odd_width") {
    const auto grating = [](uint32_t f, uint32_t x) {
      return triangle(static_cast<int>(16 * x + 24 * f), 256);
    };
    reference.fill(
        [&](uint32_t f, uint32_t, uint32_t x, uint32_t c) { return c == 1 ? grating(f, x) : 128; });
    test.fill([&](uint32_t f, uint32_t, uint32_t x, uint32_t c) {
      return c == 1 ? 16 + 7 * grating(f, x) / 8 : 128;
    });
  } else if (name == "static_noise_odd_height") {
    test = with_noise(reference, 3, 12, true);
  } else if (name == "frozen") {
    test.fill([&](uint32_t f, uint32_t y, uint32_t x, uint32_t c) {
      return int{reference.at(3 * (f / 3), y, x, c)};
    });
  } else if (name == "tiny") {
    test = with_noise(reference, 5, 16);
  } else if (name == "image") {
    test = with_noise(reference, 4, 10);
  }
  return {reference, test};
}

JodMeter meter_of(const Video& test, const Video& reference, double fps,
                  const char* display = "standard_4k", uint32_t threads = 1) {
  JodMeter meter(test.width, test.height, test.frames, fps, *find_jod_display(display), threads,
                 {});
  for (uint32_t f = 0; f < test.frames; ++f) meter.add(test.image(f), reference.image(f));
  return meter;
}

struct Case {
  const char* name;
  uint32_t frames, height, width;
  double fps;
  const char* display;
  uint64_t reference, test;  // FNV-1a of the bytes
  double jod;
};
const Case kCases[] = {
    {"identical", 4, 48, 64, 30, "standard_4k", 0xdbec50dcd1518ac6U, 0xdbec50dcd1518ac6U, 10.0},
    {"noise_2", 12, 64, 96, 30, "standard_4k", 0x429137259ef0c56cU, 0xa5a1831394c492c7U, 9.98205},
    {"noise_5", 12, 64, 96, 30, "standard_4k", 0x429137259ef0c56cU, 0x4e9df85ed69b6abbU, 9.95573},
    {"noise_10", 12, 64, 96, 30, "standard_4k", 0x429137259ef0c56cU, 0xa44f20b8da8bbc9dU, 9.86501},
    {"noise_20", 12, 64, 96, 30, "standard_4k", 0x429137259ef0c56cU, 0x04d37462d58bc647U, 9.5387},
    {"noise_40", 12, 64, 96, 30, "standard_4k", 0x429137259ef0c56cU, 0x2c5e31a54f6c3084U, 8.59736},
    {"blur", 8, 180, 320, 30, "standard_4k", 0x29e3e9d32aec6fe9U, 0x6a6737b5c8cb2c31U, 9.33114},
    {"blur_fhd", 8, 180, 320, 30, "standard_fhd", 0x29e3e9d32aec6fe9U, 0x6a6737b5c8cb2c31U,
     8.75979},
    {"colour_shift", 10, 64, 64, 25, "standard_4k", 0xc455d729f1876ffcU, 0xb07b98187402877cU,
     9.15554},
    {"flicker", 24, 72, 128, 24, "standard_4k", 0xcd04be49648cd620U, 0x68844971d1c7a6f0U, 3.59932},
    {"grating_odd_width", 30, 90, 161, 60, "standard_4k", 0xa4562d3c93af2cbfU, 0x893b029f23091c13U,
     9.51159},
    {"static_noise_odd_height", 9, 91, 160, 30, "standard_4k", 0xb92909fb1ff21897U,
     0xedafbf7edbe1eccdU, 9.70903},
    {"frozen", 30, 72, 128, 30, "standard_4k", 0x070698bae556bfdfU, 0x7e890eacd12946f6U, 8.0977},
    {"tiny", 6, 12, 16, 30, "standard_4k", 0x68ceaf6fc2035952U, 0xb7e2541aa2cd6c47U, 9.46245},
    {"image", 1, 96, 128, 0, "standard_4k", 0x1f4e6040c22ee08fU, 0xed4ca8cf9cbe4fceU, 9.89471},
};

TEST(Jod, IsThatOfTheOriginal) {
  for (const Case& c : kCases) {
    const auto [reference, test] = pair_of(c.name, c.frames, c.height, c.width);
    ASSERT_EQ(reference.hash(), c.reference) << c.name;
    ASSERT_EQ(test.hash(), c.test) << c.name;
    const JodMeter meter = meter_of(test, reference, c.fps, c.display);
    EXPECT_NEAR(meter.jod(), c.jod, 1e-3) << c.name;
    if (std::string(c.name) != "tiny") continue;
    EXPECT_EQ(meter_of(test, reference, c.fps, c.display, 3).jod(), meter.jod());
  }
}

// A flat change of colours: all in the base band, in closed form.
TEST(Jod, OfFlatColours) {
  const auto flat = [](int r, int g, int b) {
    return Video(1, 64, 64).fill([&](uint32_t, uint32_t, uint32_t, uint32_t c) {
      return c == 0 ? r : c == 1 ? g : b;
    });
  };
  EXPECT_NEAR(meter_of(flat(160, 160, 160), flat(128, 128, 128), 0).jod(), 10, 1e-4);
  const JodMeter meter = meter_of(flat(140, 128, 116), flat(128, 128, 128), 0);
  EXPECT_NEAR(meter.jod(), 9.47231, 1e-4);
  const JodFrame& frame = meter.frames()[0];
  EXPECT_TRUE(frame[3].empty());
  const double wanted[3] = {0, 4.99086, 6.08674};
  for (size_t c = 0; c < 3; ++c) {
    EXPECT_NEAR(frame[c].back(), wanted[c], 1e-3);
    for (size_t band = 0; band + 1 < frame[c].size(); ++band) EXPECT_LT(frame[c][band], 1e-3);
  }
}

TEST(Jod, SensitivityIsThatOfTheTable) {
  const auto of = [](size_t channel, double cpd, float luminance) {
    return Sensitivity(channel, cpd)(Sensitivity::place_of(luminance));
  };
  EXPECT_NEAR(of(0, 3.04, 50), 287.574, 0.05);
  EXPECT_NEAR(of(1, 3.04, 50), 199.987, 0.05);
  EXPECT_NEAR(of(2, 0.1, 100), 37.4182, 0.01);
  EXPECT_NEAR(of(3, 37.7, 1), 0.73022, 0.001);
}

TEST(Jod, RefusesWhatItCannotCompare) {
  const JodDisplay& display = *find_jod_display("standard_fhd");
  EXPECT_EQ(find_jod_display("cinema"), nullptr);
  EXPECT_THROW(JodMeter(7, 64, 2, 30, display, 1, {}), io::Error);
  EXPECT_THROW(JodMeter(64, 64, 2, 0, display, 1, {}), io::Error);
  JodMeter meter(16, 16, 2, 30, display, 1, {});
  EXPECT_THROW(meter.add(io::Image(16, 16), io::Image(16, 17)), io::Error);
}

}  // namespace
}  // namespace l4d::eval

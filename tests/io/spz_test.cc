// SPDX-License-Identifier: Apache-2.0
#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <cmath>

#include "io/formats/scene_file.h"
#include "io/formats/write_spz.h"
#include "io/synth/sh_basis.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

class SpzTest : public test::IoTest {
 protected:
  static constexpr size_t kCount = 3;
  static std::string header(uint32_t version, uint8_t degree, uint8_t last = 0,
                            uint32_t count = kCount) {
    std::string bytes = "NGSP";
    test::append(bytes, version);
    test::append(bytes, count);
    for (const int byte : {int{degree}, 12, 1, int{last}}) bytes += static_cast<char>(byte);
    return bytes;
  }
  // The attributes by the text of the format, one stream each.
  static std::vector<std::string> streams(uint32_t version, uint8_t degree) {
    std::vector<std::string> out(6);
    const auto put = [](std::string& to, int byte) { to += static_cast<char>(byte); };
    for (size_t i = 0; i < kCount; ++i) {
      for (const double x : {1.5, -2.25, static_cast<double>(i)}) {
        const int fixed = static_cast<int>(x * 4096);
        for (int b = 0; b < 3; ++b) put(out[0], (fixed >> (8 * b)) & 255);
      }
      put(out[1], 51);                                    // opacity 0.2
      for (const int c : {255, 0, 128}) put(out[2], c);   // colours
      for (const int s : {160, 80, 112}) put(out[3], s);  // 0, -5, -3
      if (version == 2) {
        for (const int q : {255, 127, 128}) put(out[4], q);  // x = 1
      } else {
        // w largest; x = -1/2 sqrt(1/2), y = sqrt(1/2), z = 0
        test::append<uint32_t>(out[4], (3U << 30) | ((512U + 256) << 20) | (511U << 10));
      }
      const int coefficients = (degree + 1) * (degree + 1) - 1;
      for (int k = 0; k < 3 * coefficients; ++k) put(out[5], k);
    }
    return out;
  }
  static std::string gzip(const std::string& bytes) {
    z_stream stream{};
    EXPECT_EQ(deflateInit2(&stream, 9, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY), Z_OK);
    std::string out(bytes.size() + 1000, '\0');
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
    stream.avail_in = static_cast<uInt>(bytes.size());
    stream.next_out = reinterpret_cast<Bytef*>(out.data());
    stream.avail_out = static_cast<uInt>(out.size());
    EXPECT_EQ(deflate(&stream, Z_FINISH), Z_STREAM_END);
    out.resize(stream.total_out);
    deflateEnd(&stream);
    return out;
  }
  static std::string file_of(uint32_t version, uint8_t degree) {
    const std::vector<std::string> parts = streams(version, degree);
    std::string bytes;
    if (version < 4) {
      bytes = header(version, degree);
      for (const std::string& part : parts) bytes += part;
      return gzip(bytes);
    }
    const uint8_t count = degree > 0 ? 6 : 5;
    bytes = header(4, degree, count);
    test::append<uint32_t>(bytes, 32);
    bytes.append(12, '\0');
    std::string body;
    for (size_t k = 0; k < count; ++k) {
      std::string packed(ZSTD_compressBound(parts[k].size()), '\0');
      packed.resize(
          ZSTD_compress(packed.data(), packed.size(), parts[k].data(), parts[k].size(), 3));
      test::append<uint64_t>(bytes, packed.size());
      test::append<uint64_t>(bytes, parts[k].size());
      body += packed;
    }
    return bytes + body;
  }
  Scene read(const std::string& bytes, const Hold& holder = {}) {
    ImportOptions options;
    options.seconds = 2;
    options.fps = 10;
    options.holder = holder;
    const std::string file = write("a.spz", bytes);
    return read_scene_file(file, file, options);
  }
};

TEST_F(SpzTest, AllVersionsAreRead) {
  for (const uint32_t version : {2U, 3U, 4U}) {
    for (uint8_t degree = 0; degree <= 3; ++degree) {
      const Scene scene = read(file_of(version, degree));
      ASSERT_EQ(scene.count(), kCount) << version;
      EXPECT_EQ(scene.source, "spz");
      EXPECT_EQ(scene.sh_degree, degree);
      EXPECT_EQ(scene.timeline.num_frames, 20U);
      EXPECT_EQ(scene.placement.coordinate_system,
                static_cast<uint32_t>(L4D_COORDINATES_RIGHT_UP_BACK));
      EXPECT_EQ(scene.rendering.compensation, 1U);
      EXPECT_EQ(std::vector<float>(scene.position.begin() + 6, scene.position.end()),
                (std::vector<float>{1.5F, -2.25F, 2}));
      EXPECT_EQ(scene.opacity[1], 0.2F);
      EXPECT_EQ(scene.log_scale[1], -5);
      EXPECT_NEAR(scene.sh[0], 0.5 / 0.15, 1e-6);
      const size_t numbers = 3 * scene.sh_coefficients();
      if (degree > 0) {
        EXPECT_EQ(scene.sh[numbers + 3 + 4], (4 - 128) / 128.0F);
      }
      // s, -z, y, -x of the quaternion
      const float half = std::sqrt(0.5F);
      const std::vector<float> expected =
          version == 2
              ? std::vector<float>{0, 0, 0, -1}
              : std::vector<float>{std::sqrt(1 - 0.5F - 0.5F * (256 * 256.0F) / (511 * 511)), 0,
                                   half, half * 256 / 511};
      for (size_t k = 0; k < 4; ++k) EXPECT_NEAR(scene.rotor[k], expected[k], 0.01) << version << k;
    }
  }
}

// The extension SPZ_ADOBE_coordinate_system, behind one that is not known.
TEST_F(SpzTest, AnExtensionStatesTheAxes) {
  struct Case {
    uint32_t axes, system;
  };
  for (const Case& c : {Case{6, L4D_COORDINATES_RIGHT_DOWN_FORWARD},
                        Case{4, L4D_COORDINATES_RIGHT_UP_BACK}, Case{7, L4D_COORDINATES_UNKNOWN}}) {
    std::string records;
    for (const uint32_t word : {0x12340001U, 3U}) test::append(records, word);
    records += "abc";
    for (const uint32_t word : {0xADBE0003U, 4U, c.axes}) test::append(records, word);
    std::string four = file_of(4, 1);
    four[14] = 2;
    four[16] = static_cast<char>(32 + records.size());
    four.insert(32, records);
    std::string three = header(3, 1);
    three[14] = 2;
    for (const std::string& part : streams(3, 1)) three += part;
    write("four.spz", four);
    write("three.spz", gzip(three + records));
    for (const char* name : {"four.spz", "three.spz"}) {
      const Scene scene = read_scene_file(path(name), name);
      EXPECT_EQ(scene.count(), kCount);
      EXPECT_EQ(scene.placement.coordinate_system, c.system) << name << " " << c.axes;
    }
  }
}

TEST_F(SpzTest, EveryTruncationIsRefused) {
  for (const uint32_t version : {2U, 3U, 4U}) {
    const std::string whole = file_of(version, 1);
    for (size_t size = 3; size < whole.size(); ++size) {
      std::string message;
      ASSERT_EQ(test::status_of([&] { read(whole.substr(0, size)); }, &message), L4D_ERR_CORRUPT)
          << version << " " << size;
    }
  }
}

TEST_F(SpzTest, MoreThanItStatesIsRefused) {
  const auto refused = [&](const std::string& bytes, const char* expected) {
    std::string message;
    EXPECT_EQ(test::status_of([&] { read(bytes); }, &message), L4D_ERR_CORRUPT) << expected;
    EXPECT_NE(message.find(expected), std::string::npos) << message;
  };
  for (const uint32_t version : {2U, 3U}) {
    std::string body;
    for (const std::string& part : streams(version, 1)) body += part;
    refused(gzip(header(version, 1, 0, kCount - 1) + body), "more bytes of Gaussians than stated");
    refused(gzip(header(version, 0) + body), "more bytes of Gaussians than stated");
    refused(file_of(version, 1) + file_of(version, 1), "more bytes follow");
  }
  refused(file_of(4, 1) + "x", "more bytes follow the streams");
}

// Every byte changed: it is refused, or read without harm.
TEST_F(SpzTest, ChangedBytesDoNoHarm) {
  for (const uint32_t version : {3U, 4U}) {
    const std::string whole = file_of(version, 1);
    for (size_t at = 0; at < whole.size(); ++at) {
      for (const int change : {1, 128, 255}) {
        std::string bytes = whole;
        bytes[at] = static_cast<char>(bytes[at] ^ change);
        const l4d_status status = test::status_of([&] { read(bytes); });
        EXPECT_TRUE(status == L4D_OK || status == L4D_ERR_CORRUPT ||
                    status == L4D_ERR_FEATURE_UNSUPPORTED)
            << at << " " << status;
      }
    }
  }
}

TEST_F(SpzTest, CountsWhatAHeaderPromises) {
  const MemoryBudget budget("limit", 1 << 20);
  const std::string promise = gzip(header(3, 3, 0, 0xffffffff) + std::string(99, '\0'));
  EXPECT_EQ(test::status_of([&] { read(promise, budget.holder()); }), L4D_ERR_LIMIT_EXCEEDED);
  // Without a limit nothing is allocated that the file does not have.
  EXPECT_EQ(test::status_of([&] { read(promise); }), L4D_ERR_CORRUPT);
  std::string message;
  EXPECT_EQ(test::status_of([&] { read(gzip(header(5, 0))); }, &message),
            L4D_ERR_FEATURE_UNSUPPORTED);
  EXPECT_NE(message.find("2 to 4"), std::string::npos) << message;
  EXPECT_EQ(test::status_of([&] { read(gzip(header(3, 4))); }), L4D_ERR_FEATURE_UNSUPPORTED);
}

TEST_F(SpzTest, SplatRowsAreRead) {
  std::string bytes;
  for (const float x : {1.0F, 2.0F, 3.0F, 1.0F, std::exp(-2.0F), 0.5F}) test::append(bytes, x);
  for (const int b : {255, 0, 51, 102, 255, 128, 128, 128}) bytes += static_cast<char>(b);
  const std::string file = write("a.splat", bytes + bytes);
  const Scene scene = read_scene_file(file, file);
  ASSERT_EQ(scene.count(), 2U);
  EXPECT_EQ(scene.source, "splat");
  EXPECT_EQ(scene.position[5], 3);
  EXPECT_NEAR(scene.log_scale[1], -2, 1e-6);
  EXPECT_EQ(scene.opacity[1], 0.4F);
  EXPECT_NEAR(scene.sh[0] * 0.28209479F + 0.5F, 1, 1e-6);
  EXPECT_NEAR(scene.sh[2] * 0.28209479F + 0.5F, 0.2, 1e-6);
  EXPECT_EQ(scene.rotor[0], 1);
  const Scene without = read_scene_file(
      write("zeros.splat", std::string(32, 0) + bytes + std::string(64, 0)), "zeros.splat");
  EXPECT_EQ(without.count(), 1U);
  EXPECT_EQ(std::count(without.notes.begin(), without.notes.end(),
                       "3 of 4 rows are nothing but zeros and were left out."),
            1);
  std::string negative = bytes;
  negative[15] = static_cast<char>(0x80 | negative[15]);
  EXPECT_EQ(test::status_of(
                [&] { read_scene_file(write("negative.splat", negative), "negative.splat"); }),
            L4D_ERR_INVALID_SCENE);
  const std::string cut = write("b.splat", bytes + "x");
  EXPECT_EQ(test::status_of([&] { read_scene_file(cut, cut); }), L4D_ERR_CORRUPT);
}

// ---- what is written ----

Splats two_splats(uint32_t degree) {
  Splats splats;
  splats.sh_degree = degree;
  splats.position = {1.5F, -2.25F, 0.125F, 100, 0, -3};
  // Axes of standard deviation 1, e^-1 and e^-2: along x y z, and turned by a right angle around z.
  const auto square = [](double log) { return static_cast<float>(std::exp(2 * log)); };
  splats.covariance = {1, 0, 0, square(-1), 0, square(-2), square(-1), 0, 0, 1, 0, square(-2)};
  splats.opacity = {0.2F, 1};
  const size_t numbers = size_t{3} * (degree + 1) * (degree + 1);
  for (size_t k = 0; k < 2 * numbers; ++k) {
    splats.sh.push_back(k % numbers < 3 ? static_cast<float>(k % numbers) - 1
                                        : static_cast<float>(k % 64) / 128 - 0.25F);
  }
  return splats;
}

using SpzOutTest = SpzTest;

TEST_F(SpzOutTest, WhatIsWrittenIsRead) {
  for (uint32_t degree = 0; degree <= 3; ++degree) {
    const Splats splats = two_splats(degree);
    InstantSetting setting;
    setting.placement.coordinate_system = L4D_COORDINATES_RIGHT_UP_BACK;
    setting.rendering.compensation = 1;
    const WriteNotes notes = write_spz(path("out.spz"), splats, setting);
    EXPECT_TRUE(notes.empty());
    const Scene scene = read_scene_file(path("out.spz"), path("out.spz"));
    ASSERT_EQ(scene.count(), 2U);
    EXPECT_EQ(scene.sh_degree, degree);
    EXPECT_EQ(scene.rendering.compensation, 1U);
    EXPECT_EQ(scene.position, splats.position);  // 16 fractional bits hold these
    EXPECT_EQ(scene.opacity, splats.opacity);
    const size_t numbers = 3 * scene.sh_coefficients();
    for (size_t k = 0; k < 2 * numbers; ++k) {
      const float step = k % numbers < 3 ? 1 / (255 * 0.15F) : 0;  // 128ths are kept
      EXPECT_NEAR(scene.sh[k], splats.sh[k], step / 2 + 1e-6F) << k;
    }
    for (size_t i = 0; i < 2; ++i) {
      std::vector<float> logs(&scene.log_scale[4 * i], &scene.log_scale[4 * i] + 3);
      std::sort(logs.begin(), logs.end());
      EXPECT_EQ(logs, (std::vector<float>{-2, -1, 0}));
    }
  }
}

// Down and forward become up and back; what is odd in y and z together changes its sign.
TEST_F(SpzOutTest, AxesBecomeThoseOfSpz) {
  Splats splats = two_splats(3);
  splats.covariance = {1, 0.25F, 0.5F, 1, 0.125F, 1, 1, 0, 0, 1, 0, 1};
  const Splats before = splats;
  InstantSetting setting;
  setting.placement.coordinate_system = L4D_COORDINATES_RIGHT_DOWN_FORWARD;
  const WriteNotes notes = write_spz(path("out.spz"), splats, setting);
  EXPECT_TRUE(notes.empty());
  const Scene scene = read_scene_file(path("out.spz"), path("out.spz"));
  EXPECT_EQ(scene.position, (std::vector<float>{1.5F, 2.25F, -0.125F, 100, 0, 3}));
  turn_around_x(&splats);
  EXPECT_EQ(splats.covariance[1], -0.25F);
  EXPECT_EQ(splats.covariance[2], -0.5F);
  EXPECT_EQ(splats.covariance[4], 0.125F);
  // The colour towards a direction is that towards the turned direction before.
  const Vec3 d = {0.48, -0.64, 0.6};
  double basis[15], turned[15];
  synth::sh_basis(d, basis);
  synth::sh_basis({d[0], -d[1], -d[2]}, turned);
  for (size_t channel = 0; channel < 3; ++channel) {
    double a = 0, b = 0;
    for (size_t k = 0; k < 15; ++k) {
      a += basis[k] * static_cast<double>(splats.sh[3 * (k + 1) + channel]);
      b += turned[k] * static_cast<double>(before.sh[3 * (k + 1) + channel]);
    }
    EXPECT_NEAR(a, b, 1e-12);
  }
}

TEST_F(SpzOutTest, LimitsAreSaidAndKept) {
  Splats splats = two_splats(1);
  splats.sh[0] = 4;
  splats.sh[3 * 4 + 5] = -1.5F;
  splats.covariance[0] = splats.covariance[3] = splats.covariance[5] = std::exp(-22.0F);
  WriteNotes notes = write_spz(path("out.spz"), splats, {});
  EXPECT_EQ(notes.size(), 4U);  // the axes are not known, too
  for (const auto& [text, count] : notes) {
    EXPECT_EQ(count, text.find("axes of the scene") == std::string::npos ? 1U : 0U) << text;
  }
  splats = two_splats(0);
  splats.position[1] = -70000;  // 6 of 24 bits are left
  write_spz(path("out.spz"), splats, {});
  const Scene far = read_scene_file(path("out.spz"), path("out.spz"));
  EXPECT_EQ(far.position[1], -70000);
  EXPECT_EQ(far.position[2], 0.125F);
  splats.position[1] = 8388608;
  EXPECT_EQ(test::status_of([&] { write_spz(path("x.spz"), splats, {}); }), L4D_ERR_LIMIT_EXCEEDED);
  splats.position[1] = std::nanf("");
  EXPECT_EQ(test::status_of([&] { write_spz(path("x.spz"), splats, {}); }), L4D_ERR_INVALID_SCENE);
  write_spz(path("none.spz"), Splats(), {});
  EXPECT_EQ(read_scene_file(path("none.spz"), path("none.spz")).count(), 0U);
  EXPECT_EQ(files_in_directory(), 2U);
}

}  // namespace
}  // namespace l4d::io

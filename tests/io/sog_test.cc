// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <functional>

#include "io/formats/scene_file.h"
#include "io/formats/webp.h"
#include "io/formats/write_sog.h"
#include "io/formats/zip.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

// A SOG file by the text of the format: 5 Gaussians in images of 4 x 2 pixels.
class SogTest : public test::IoTest {
 protected:
  static constexpr uint32_t kCount = 5, kWidth = 4, kHeight = 2;

  void SetUp() override {
    try {
      encode_webp(RgbaImage{1, 1, {1, 2, 3, 4}, nullptr}, "test");
    } catch (const Error&) {
      GTEST_SKIP() << "built without libwebp";
    }
  }

  using Pixel = std::function<std::array<uint8_t, 4>(uint32_t)>;
  static std::vector<uint8_t> webp(uint32_t width, uint32_t height, const Pixel& pixel) {
    RgbaImage image{width, height, {}, nullptr};
    for (uint32_t i = 0; i < width * height; ++i) {
      for (const uint8_t byte : pixel(i)) image.rgba.push_back(byte);
    }
    return encode_webp(image, "test");
  }
  // 256 numbers: begin, begin + step, ...
  static std::string book(double begin, double step) {
    std::string text = "[";
    for (int k = 0; k < 256; ++k) text += (k > 0 ? "," : "") + std::to_string(begin + k * step);
    return text + "]";
  }

  struct Parts {
    int version = 2;
    std::string count = "5";
    bool has_harmonics = true;
    uint8_t label = 65;
  };
  static std::string meta(const Parts& parts) {
    const bool old = parts.version == 1;
    const std::string means = R"({"mins":[-1,0,-2],"maxs":[1,0,2],"files":["l.webp","u.webp"])" +
                              std::string(old ? R"(,"shape":[)" + parts.count + ",3]" : "") + "}";
    std::string text = "{";
    if (!old) {
      text += R"("version":)" + std::to_string(parts.version) + R"(,"count":)" + parts.count + ",";
    }
    text += R"("means":)" + means + R"(,"quats":{"files":["q.webp"]})";
    text +=
        R"(,"scales":{"files":["s.webp"],)" + (old ? R"("mins":[-10,-8,-6],"maxs":[0,-7,-5]})"
                                                   : R"("codebook":)" + book(-10, 0.03125) + "}");
    text += R"(,"sh0":{"files":["c.webp"],)" + (old ? R"("mins":[-1,-1,-1,-2],"maxs":[1,2,1,3]})"
                                                    : R"("codebook":)" + book(-4, 0.03125) + "}");
    if (parts.has_harmonics) {
      text += R"(,"shN":{"files":["p.webp","n.webp"],)" +
              (old ? R"("mins":-1,"maxs":1})"
                   : R"("count":70,"bands":1,"codebook":)" + book(-1, 0.0078125) + "}");
    }
    return text + "}";
  }
  std::string file_of(const Parts& parts, const std::string& text = "") const {
    const std::string name = path("a.sog");
    ZipWriter zip(name);
    const auto add = [&](const char* file, uint32_t width, uint32_t height, const Pixel& pixel) {
      const std::vector<uint8_t> bytes = webp(width, height, pixel);
      zip.add(file, bytes.data(), bytes.size());
    };
    const auto all = [](uint8_t r, uint8_t g, uint8_t b, uint8_t a) {
      return [=](uint32_t) { return std::array<uint8_t, 4>{r, g, b, a}; };
    };
    add("l.webp", kWidth, kHeight, all(255, 7, 0, 255));
    add("u.webp", kWidth, kHeight, all(255, 9, 0, 255));
    // x the largest: w, y and z have a byte each; the last Gaussian has no rotation.
    add("q.webp", kWidth, kHeight, [](uint32_t i) {
      return std::array<uint8_t, 4>{0, 255, 128, static_cast<uint8_t>(i == 4 ? 7 : 253)};
    });
    add("s.webp", kWidth, kHeight, all(64, 128, 255, 255));
    add("c.webp", kWidth, kHeight, all(128, 0, 255, 51));
    add("n.webp", kWidth, kHeight, all(parts.label, 0, 0, 255));
    // Centroid 65 is the second of the second row: pixels 3 to 5 of it.
    add("p.webp", 64 * 3, 2, [](uint32_t i) {
      return std::array<uint8_t, 4>{static_cast<uint8_t>(i % 192 + 100 * (i / 192)),
                                    static_cast<uint8_t>(i % 192), 128, 255};
    });
    const std::string json = text.empty() ? meta(parts) : text;
    zip.add("meta.json", json.data(), json.size());
    zip.commit();
    return name;
  }
  static Scene read(const std::string& file, const Hold& holder = {}) {
    ImportOptions options;
    options.seconds = 2;
    options.fps = 10;
    options.holder = holder;
    return read_scene_file(file, file, options);
  }
};

TEST_F(SogTest, FilesMayLieInAFolder) {
  const Scene packed = read(file_of({}));
  InputFile input(path("a.sog"));
  std::vector<uint8_t> bytes(static_cast<size_t>(input.size()));
  bytes.resize(input.read(bytes.data(), bytes.size()));
  const ZipArchive archive(bytes, "a.sog");
  const auto text_of = [&](const char* file) {
    std::shared_ptr<void> memory;
    const std::vector<uint8_t> content = archive.read(file, {}, &memory);
    return std::string(content.begin(), content.end());
  };
  for (const char* file : {"l.webp", "u.webp", "q.webp", "s.webp", "c.webp", "n.webp", "p.webp"}) {
    write(file, text_of(file));
  }
  const std::string meta = write("meta.json", text_of("meta.json"));
  const Scene scene = read(meta);
  EXPECT_EQ(scene.source, "sog");
  EXPECT_EQ(scene.position, packed.position);
  EXPECT_EQ(scene.sh, packed.sh);
  std::string leaving = text_of("meta.json");
  leaving.insert(leaving.find("l.webp"), "../");
  write("meta.json", leaving);
  std::string message;
  EXPECT_EQ(test::status_of([&] { read(meta); }, &message), L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("not beside it"), std::string::npos) << message;
}

TEST_F(SogTest, BothVersionsAreRead) {
  for (const int version : {1, 2}) {
    Parts parts;
    parts.version = version;
    const Scene scene = read(file_of(parts));
    ASSERT_EQ(scene.count(), kCount);
    EXPECT_EQ(scene.source, "sog");
    EXPECT_EQ(scene.sh_degree, 1U);
    EXPECT_EQ(scene.timeline.num_frames, 20U);
    // sign(x) (e^|x| - 1) of 1, 0 and -2
    EXPECT_NEAR(scene.position[3], std::expm1(1.0), 1e-6);
    EXPECT_EQ(scene.position[4], 0);
    EXPECT_NEAR(scene.position[5], -std::expm1(2.0), 1e-6);
    const std::vector<float> scale = {-10 + 64 * 10 / 255.0F, -8 + 128 / 255.0F, -5};
    EXPECT_NEAR(scene.log_scale[4], version == 1 ? scale[0] : -8, 1e-6);
    EXPECT_NEAR(scene.log_scale[5], version == 1 ? scale[1] : -6, 1e-6);
    EXPECT_NEAR(scene.log_scale[6], version == 1 ? scale[2] : -10 + 255 / 32.0F, 1e-6);
    const size_t at = 12;
    EXPECT_NEAR(scene.sh[at], version == 1 ? -1 + 256 / 255.0F : 0, 1e-6);
    EXPECT_NEAR(scene.sh[at + 1], version == 1 ? -1 : -4, 1e-6);
    EXPECT_NEAR(scene.opacity[1], version == 1 ? 1 / (1 + std::exp(1.0F)) : 0.2F, 1e-6);
    for (size_t k = 0; k < 3; ++k) {
      const auto value = [&](double code) {
        return version == 1 ? -1 + 2 * code / 255 : -1 + code / 128;
      };
      EXPECT_NEAR(scene.sh[at + 3 + 3 * k], value(103 + static_cast<double>(k)), 1e-6) << k;
      EXPECT_NEAR(scene.sh[at + 4 + 3 * k], value(3 + static_cast<double>(k)), 1e-6) << k;
      EXPECT_NEAR(scene.sh[at + 5 + 3 * k], value(128), 1e-6) << k;
    }
    // s, -z, y, -x of w x y z: -sqrt(1/2), the largest, sqrt(1/2) and nearly 0.
    const float half = std::sqrt(0.5F);
    EXPECT_NEAR(scene.rotor[0], -half, 1e-5);
    EXPECT_NEAR(scene.rotor[1], 0, 0.004);
    EXPECT_NEAR(scene.rotor[2], half, 1e-5);
    EXPECT_NEAR(scene.rotor[3], 0, 0.01);
    EXPECT_EQ(scene.rotor[8 * 4], 1);
  }
  Parts parts;
  parts.has_harmonics = false;
  EXPECT_EQ(read(file_of(parts)).sh_degree, 0U);
}

TEST_F(SogTest, WhatDoesNotFitTogetherIsRefused) {
  std::string message;
  const auto status = [&](const Parts& parts, const std::string& text = "") {
    return test::status_of([&] { read(file_of(parts, text)); }, &message);
  };
  Parts parts;
  parts.count = "9";
  EXPECT_EQ(status(parts), L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("8 pixels for 9"), std::string::npos) << message;
  for (const char* count : {"-1", "4294967296", "1e99", "\"5\""}) {
    parts.count = count;
    EXPECT_EQ(status(parts), L4D_ERR_CORRUPT) << count;
  }
  parts = {};
  parts.label = 70;
  EXPECT_EQ(status(parts), L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("centroid 70 of 70"), std::string::npos) << message;
  parts = {};
  parts.version = 3;
  EXPECT_EQ(status(parts), L4D_ERR_FEATURE_UNSUPPORTED);
  const std::string good = meta({});
  const auto without = [&](const std::string& word) {
    std::string text = good;
    return text.replace(text.find(word), word.size(), "\"x\"");
  };
  for (const char* word : {"\"means\"", "\"quats\"", "\"scales\"", "\"sh0\"", "\"mins\"",
                           "\"codebook\"", "\"files\"", "\"count\"", "\"bands\"", "\"l.webp\""}) {
    EXPECT_EQ(status({}, without(word)), L4D_ERR_CORRUPT) << word;
  }
  EXPECT_EQ(status({}, test::replaced(good, "\"mins\":[-1,", "\"mins\":[1.5,")), L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("mins are above maxs"), std::string::npos) << message;
  EXPECT_EQ(status({}, test::replaced(good, "\"mins\"", "\"maxs\":[9,9,9],\"mins\"")),
            L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("an object in means has a key twice"), std::string::npos) << message;
  for (const char* text : {"[]", "{", "{\"version\":2}", "{\"means\":{}}", "\xff"}) {
    EXPECT_EQ(status({}, text), L4D_ERR_CORRUPT) << text;
  }
  EXPECT_EQ(status({}, good + std::string(size_t{1} << 20, ' ')), L4D_ERR_LIMIT_EXCEEDED);
}

TEST_F(SogTest, EveryTruncationIsRefused) {
  const std::string whole = test::read_bytes(file_of({}));
  for (size_t size = 4; size < whole.size(); size += 13) {
    const std::string file = write("cut.sog", whole.substr(0, size));
    ASSERT_EQ(test::status_of([&] { read(file); }), L4D_ERR_CORRUPT) << size;
  }
}

// Changed bytes, all of them where the images are: the file is refused, or read without harm.
TEST_F(SogTest, ChangedBytesDoNoHarm) {
  Parts parts;
  const std::string whole = test::read_bytes(file_of(parts));
  const size_t text = whole.find("{\"");
  for (size_t at = 0; at < whole.size(); at += at < text ? 1 : 11) {
    std::string bytes = whole;
    bytes[at] = static_cast<char>(bytes[at] ^ (at % 2 == 0 ? 1 : 255));
    const std::string file = write("changed.sog", bytes);
    const l4d_status status = test::status_of([&] { read(file); });
    EXPECT_TRUE(status == L4D_OK || status == L4D_ERR_CORRUPT ||
                status == L4D_ERR_FEATURE_UNSUPPORTED)
        << at << " " << status;
  }
}

TEST_F(SogTest, CountsImagesBeforeTheyAreDecoded) {
  // 100 MB of pixels in a file of a few hundred bytes.
  const std::vector<uint8_t> large = webp(5000, 5000, [](uint32_t) {
    return std::array<uint8_t, 4>{1, 2, 3, 255};
  });
  ASSERT_LT(large.size(), 10000U);
  const MemoryBudget budget("limit", 10 << 20);
  EXPECT_EQ(test::status_of([&] { decode_webp(large, "large", budget.holder()); }),
            L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_EQ(budget.held(), 0U);
  const std::string file = file_of({});
  const MemoryBudget small("limit", 20000);
  EXPECT_EQ(test::status_of([&] { read(file, small.holder()); }), L4D_ERR_LIMIT_EXCEEDED);
  const MemoryBudget enough("limit", 20 << 20);
  {
    const Scene scene = read(file, enough.holder());
    EXPECT_GT(enough.held(), 0U);
  }
  EXPECT_EQ(enough.held(), 0U);
}

// ---- what is written ----

TEST_F(SogTest, WhatIsWrittenIsRead) {
  for (uint32_t degree = 0; degree <= 3; ++degree) {
    const size_t n = 50, numbers = size_t{3} * (degree + 1) * (degree + 1);
    reference::Random random(degree);
    Splats splats;
    splats.sh_degree = degree;
    for (size_t i = 0; i < n; ++i) {
      for (size_t k = 0; k < 3; ++k) {
        splats.position.push_back(static_cast<float>(10 * random.normal()));
      }
      // Standard deviations 1, e^-1 and e^-2 along axes.
      const float a = 1, b = std::exp(-2.0F), c = std::exp(-4.0F);
      const float variance[3] = {i % 3 == 0 ? a : b, i % 3 == 0 ? b : a, c};
      splats.covariance.insert(splats.covariance.end(),
                               {variance[0], 0, 0, variance[1], 0, variance[2]});
      splats.opacity.push_back(static_cast<float>(i) / 51);
      // 40 values in all: a codebook has each of them.
      for (size_t k = 0; k < numbers; ++k) {
        splats.sh.push_back(static_cast<float>((i * 7 + k) % 40) / 16 - 1);
      }
    }
    EXPECT_TRUE(write_sog(path("out.sog"), splats, {}).empty());
    const Scene scene = read(path("out.sog"));
    ASSERT_EQ(scene.count(), n);
    EXPECT_EQ(scene.sh_degree, degree);
    for (size_t i = 0; i < n; ++i) {
      // Opacities tell the rows, whose order is another.
      const size_t from = static_cast<size_t>(std::lround(scene.opacity[i] * 51));
      EXPECT_NEAR(scene.opacity[i], splats.opacity[from], 0.5 / 255);
      for (size_t k = 0; k < 3; ++k) {
        // A 65535th of the range of logarithms, times 1 + |x|.
        EXPECT_NEAR(scene.position[3 * i + k], splats.position[3 * from + k], 0.005);
      }
      std::vector<float> logs(&scene.log_scale[4 * i], &scene.log_scale[4 * i] + 3);
      std::sort(logs.begin(), logs.end());
      for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(logs[k], static_cast<float>(k) - 2, 1e-5);
      for (size_t k = 0; k < 3; ++k) {
        EXPECT_EQ(scene.sh[numbers * i + k], splats.sh[numbers * from + k]);
      }
      // 32 centroids for 40 different rows of harmonics: most are kept as they are.
    }
    size_t kept = 0;
    for (size_t i = 0; i < n; ++i) {
      const size_t from = static_cast<size_t>(std::lround(scene.opacity[i] * 51));
      kept += std::equal(&scene.sh[numbers * i], &scene.sh[numbers * i] + numbers,
                         &splats.sh[numbers * from]);
    }
    EXPECT_GE(kept, degree == 0 ? n : n / 2) << degree;
  }
}

TEST_F(SogTest, WhatCannotBeWrittenIsRefused) {
  EXPECT_EQ(test::status_of([&] { write_sog(path("x.sog"), Splats(), {}); }),
            L4D_ERR_INVALID_SCENE);
  Splats splats;
  splats.position = {0, std::nanf(""), 0};
  splats.covariance = {1, 0, 0, 1, 0, 1};
  splats.opacity = {1};
  splats.sh = {0, 0, 0};
  EXPECT_EQ(test::status_of([&] { write_sog(path("x.sog"), splats, {}); }), L4D_ERR_INVALID_SCENE);
  EXPECT_EQ(files_in_directory(), 0U);
  // One Gaussian has no ranges; its axes stay as they are.
  splats.position = {3, -4, 5};
  InstantSetting setting;
  setting.placement.coordinate_system = L4D_COORDINATES_RIGHT_UP_BACK;
  write_sog(path("one.sog"), splats, setting);
  const Scene scene = read(path("one.sog"));
  ASSERT_EQ(scene.count(), 1U);
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(scene.position[k], splats.position[k], 1e-5);
  }
}

}  // namespace
}  // namespace l4d::io

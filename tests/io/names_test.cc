// SPDX-License-Identifier: Apache-2.0
// Files under the names of other formats: each is read by what it holds, or named as what it is.
#include <zlib.h>

#include <map>
#include <sstream>

#include "io/formats/instant_file.h"
#include "io/formats/raw_arrays.h"
#include "io/formats/scene_file.h"
#include "io/formats/write_4dgs.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

class NamesTest : public test::IoTest {
 protected:
  static constexpr uint32_t kCount = 40;

  static std::string splat() {
    std::string file;
    for (uint32_t i = 0; i < kCount; ++i) {
      // The first byte is one with which JSON begins.
      const float x = i == 0 ? 1.0000146F : static_cast<float>(i) / 8;
      for (const float value : {x, 0.0F, 1.0F, 0.1F, 0.2F, 0.1F}) test::append(file, value);
      for (const int c : {200, 100, 50, 255, 255, 128, 128, 128}) file += static_cast<char>(c);
    }
    return file;
  }
  static std::string ksplat() {
    std::string file(4096 + 1024, '\0');
    file[1] = 1;
    for (const size_t at : {4U, 8U}) file[at] = 1;
    for (const size_t at : {16U, 4096U, 4096U + 4}) file[at] = kCount;
    for (uint32_t i = 0; i < kCount; ++i) {
      for (const float value : {static_cast<float>(i), 0.0F, 1.0F, 0.1F, 0.2F, 0.1F}) {
        test::append(file, value);
      }
      for (const float value : {1.0F, 0.0F, 0.0F, 0.0F}) test::append(file, value);
      for (const int c : {200, 100, 50, 255}) file += static_cast<char>(c);
    }
    return file;
  }
  // Version 3, all of which is one stream of gzip; most programs write that.
  std::string gzipped_spz() const {
    std::string bytes = "NGSP";
    for (const uint32_t value : {3U, 1U, 12U << 8}) test::append(bytes, value);
    const std::string file = path("gzipped");
    const gzFile out = gzopen(file.c_str(), "wb");
    bytes += std::string(20, '\1');
    EXPECT_EQ(gzwrite(out, bytes.data(), static_cast<unsigned>(bytes.size())), 36);
    EXPECT_EQ(gzclose(out), Z_OK);
    return test::read_bytes(file);
  }
  // Sources and the bytes of a file of each.
  std::map<std::string, std::string> files() const {
    const Scene scene = test::random_scene(3, kCount, 0);
    Splats splats;
    splats.position.assign(3 * kCount, 0.5F);
    for (uint32_t i = 0; i < kCount; ++i) {
      splats.covariance.insert(splats.covariance.end(), {1, 0, 0, 1, 0, 1});
    }
    splats.opacity.assign(kCount, 0.5F);
    splats.sh.assign(3 * kCount, 0.5F);
    const std::string at = path("made");
    const auto instant = [&](const char* extension) {
      write_instant_file(at, extension, splats, {});
      return test::read_bytes(at);
    };
    std::map<std::string, std::string> out = {
        {"splat", splat()},       {"ksplat", ksplat()},      {"3dgs_ply", instant(".ply")},
        {"spz", instant(".spz")}, {"gltf", instant(".glb")}, {"spz in gzip", gzipped_spz()}};
    write_4dgs(at, scene);
    out["4dgs"] = test::read_bytes(at);
    write_raw(at, scene);
    out["raw"] = test::read_bytes(at);
    try {
      out["sog"] = instant(".sog");
    } catch (const Error& error) {
      EXPECT_EQ(error.status(), L4D_ERR_FEATURE_UNSUPPORTED);  // built without libwebp
    }
    return out;
  }
};

TEST_F(NamesTest, AFileIsReadOrNamedWhateverItsNameSays) {
  for (const auto& [source, bytes] : files()) {
    const std::string is = source.substr(0, source.find(' '));
    std::istringstream extensions(list_of_scene_files() + ", .l4d");
    std::string extension;
    while (extensions >> extension) {
      const std::string name = "a" + extension.substr(0, extension.find(','));
      SCOPED_TRACE(source);
      SCOPED_TRACE(name);
      const std::string file = write(name, bytes);
      std::string message = "read";
      const l4d_status status =
          test::status_of([&] { EXPECT_EQ(read_scene_file(file, name).source, is); }, &message);
      const bool is_named = is == "splat" && name != "a.splat";
      EXPECT_EQ(status, is_named ? L4D_ERR_FEATURE_UNSUPPORTED : L4D_OK) << message;
      EXPECT_EQ(message, is_named ? name +
                                        ": this is a SPLAT file by its numbers, and no stream "
                                        "or PLY; it is read under a name that ends in .splat"
                                  : "read");
    }
  }
}

// A file of something else is refused by the reader that the name asks for.
TEST_F(NamesTest, WhatHoldsNothingKnownIsRefusedByItsName) {
  const std::map<std::string, std::string> words = {{"a.spz", "no SPZ file"},
                                                    {"a.sog", "no SOG file"},
                                                    {"a.ksplat", "of KSPLAT"},
                                                    {"a.splat", "scale below 0"},
                                                    {"a.4dgs", "no .4dgs file"}};
  for (const auto& word : words) {
    const std::string name = word.first, said = word.second;
    std::string message;
    const std::string file = write(name, std::string(8192, '\xbf'));
    EXPECT_NE(test::status_of([&] { read_scene_file(file, name); }, &message), L4D_OK);
    EXPECT_NE(message.find(said), std::string::npos) << message;
  }
}

}  // namespace
}  // namespace l4d::io

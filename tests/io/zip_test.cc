// SPDX-License-Identifier: Apache-2.0
#include "io/formats/zip.h"

#include <zlib.h>

#include "tests/io/support.h"

namespace l4d::io {
namespace {

class ZipTest : public test::IoTest {
 protected:
  static ZipArchive open(const std::string& bytes) {
    return {{bytes.begin(), bytes.end()}, "a.zip"};
  }
  static std::string read(const ZipArchive& zip, const std::string& file, const Hold& holder = {}) {
    std::shared_ptr<void> memory;
    const std::vector<uint8_t> bytes = zip.read(file, holder, &memory);
    return {bytes.begin(), bytes.end()};
  }
  // An archive of one deflated file, whose entry says that it has `size` bytes.
  static std::string deflated(const std::string& text, uint32_t size) {
    z_stream stream{};
    EXPECT_EQ(deflateInit2(&stream, 9, Z_DEFLATED, -15, 8, Z_DEFAULT_STRATEGY), Z_OK);
    std::string packed(text.size() + 100, '\0');
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
    stream.avail_in = static_cast<uInt>(text.size());
    stream.next_out = reinterpret_cast<Bytef*>(packed.data());
    stream.avail_out = static_cast<uInt>(packed.size());
    EXPECT_EQ(deflate(&stream, Z_FINISH), Z_STREAM_END);
    packed.resize(stream.total_out);
    deflateEnd(&stream);
    std::string common;
    for (const int x : {20, 0, 8, 0, 0}) test::append<uint16_t>(common, static_cast<uint16_t>(x));
    const auto* data = reinterpret_cast<const Bytef*>(text.data());
    test::append<uint32_t>(common,
                           static_cast<uint32_t>(crc32(0, data, static_cast<uInt>(text.size()))));
    test::append<uint32_t>(common, static_cast<uint32_t>(packed.size()));
    test::append<uint32_t>(common, size);
    test::append<uint16_t>(common, 1);
    test::append<uint16_t>(common, 0);
    std::string file = "PK\x03\x04" + common + "f" + packed;
    const auto directory = static_cast<uint32_t>(file.size());
    file += "PK\x01\x02";
    test::append<uint16_t>(file, 20);
    file += common + std::string(10, '\0');
    test::append<uint32_t>(file, 0);
    file += "f";
    const auto length = static_cast<uint32_t>(file.size()) - directory;
    file += "PK\x05\x06" + std::string(4, '\0');
    for (int k = 0; k < 2; ++k) test::append<uint16_t>(file, 1);
    test::append<uint32_t>(file, length);
    test::append<uint32_t>(file, directory);
    test::append<uint16_t>(file, 7);
    return file + "comment";
  }
};

TEST_F(ZipTest, WhatIsWrittenIsRead) {
  const std::string name = path("out.zip"), one(1000, 'x');
  ZipWriter writer(name);
  writer.add("one", one.data(), one.size());
  writer.add("folder/two", "", 0);
  writer.commit();
  const ZipArchive zip = open(test::read_bytes(name));
  EXPECT_TRUE(zip.has("one"));
  EXPECT_FALSE(zip.has("two"));
  EXPECT_EQ(read(zip, "one"), one);
  EXPECT_EQ(read(zip, "folder/two"), "");
  EXPECT_EQ(test::status_of([&] { read(zip, "two"); }), L4D_ERR_CORRUPT);
}

TEST_F(ZipTest, DeflatedFilesAreReadAsLongAsTheySay) {
  const std::string text(100000, 'y');
  EXPECT_EQ(read(open(deflated(text, 100000)), "f"), text);
  const MemoryBudget budget("limit", 50000);
  EXPECT_EQ(test::status_of([&] { read(open(deflated(text, 100000)), "f", budget.holder()); }),
            L4D_ERR_LIMIT_EXCEEDED);
  for (const uint32_t size : {0U, 99999U, 100001U, 0xfffffff0U}) {
    EXPECT_EQ(test::status_of([&] { read(open(deflated(text, size)), "f"); }), L4D_ERR_CORRUPT)
        << size;
  }
}

TEST_F(ZipTest, DamageIsRefusedOrHarmless) {
  const std::string whole = deflated("some text that has to be longer than its code", 45);
  for (size_t size = 0; size < whole.size(); ++size) {
    EXPECT_EQ(test::status_of([&] { open(whole.substr(0, size)); }), L4D_ERR_CORRUPT) << size;
  }
  for (size_t at = 0; at < whole.size(); ++at) {
    for (const int change : {1, 8, 128, 255}) {
      std::string bytes = whole;
      bytes[at] = static_cast<char>(bytes[at] ^ change);
      std::string text;
      const l4d_status status = test::status_of([&] { text = read(open(bytes), "f"); });
      EXPECT_TRUE(status == L4D_ERR_CORRUPT || status == L4D_ERR_FEATURE_UNSUPPORTED ||
                  text == "some text that has to be longer than its code")
          << at << " " << status << " " << text;
    }
  }
}

}  // namespace
}  // namespace l4d::io

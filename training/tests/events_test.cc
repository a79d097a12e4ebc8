// SPDX-License-Identifier: Apache-2.0
// Events for TensorBoard, against bytes that follow from the definitions of TFRecord, CRC-32C and
// protocol buffers alone.
#include "training/run/record/events.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

namespace l4d::train {
namespace {

uint64_t little_endian(const std::string& bytes, size_t at, size_t size) {
  uint64_t value = 0;
  for (size_t k = size; k-- > 0;) value = value << 8 | static_cast<uint8_t>(bytes.at(at + k));
  return value;
}

// Bit by bit, as the definition has it.
uint32_t crc32c(const std::string& bytes) {
  uint32_t crc = 0xffffffff;
  for (const char c : bytes) {
    for (int bit = 0; bit < 8; ++bit) {
      const uint32_t low = (crc ^ (static_cast<uint8_t>(c) >> bit)) & 1;
      crc = (crc >> 1) ^ (low * 0x82f63b78U);
    }
  }
  return ~crc;
}

uint32_t unmasked(uint32_t stored) {
  const uint32_t rotated = stored - 0xa282ead8U;
  return rotated << 15 | rotated >> 17;
}

// The payloads of frames whose checksums hold.
std::vector<std::string> payloads(const std::string& file) {
  std::vector<std::string> out;
  for (size_t at = 0; at < file.size();) {
    const size_t size = static_cast<size_t>(little_endian(file, at, 8));
    EXPECT_EQ(unmasked(static_cast<uint32_t>(little_endian(file, at + 8, 4))),
              crc32c(file.substr(at, 8)));
    out.push_back(file.substr(at + 12, size));
    EXPECT_EQ(unmasked(static_cast<uint32_t>(little_endian(file, at + 12 + size, 4))),
              crc32c(out.back()));
    at += 16 + size;
  }
  return out;
}

TEST(Events, AreFramedWithChecksums) {
  ASSERT_EQ(crc32c("123456789"), 0xe3069283U);  // the check value of CRC-32C
  const std::vector<std::string> found =
      payloads(version_record(1.5) + event_record(2.5, 300, {{"loss", 0.25}, {"psnr/test", 28}}));
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0], std::string("\x09\x00\x00\x00\x00\x00\x00\xf8\x3f"  // field 1, double 1.5
                                  "\x1a\x0d"
                                  "brain.Event:2",
                                  24));
  const std::string loss = "\x0a\x04loss\x15" + std::string("\x00\x00\x80\x3e", 4);
  const std::string test = "\x0a\x09psnr/test\x15" + std::string("\x00\x00\xe0\x41", 4);
  EXPECT_EQ(found[1], std::string("\x09\x00\x00\x00\x00\x00\x00\x04\x40", 9) +  // 2.5
                          "\x10\xac\x02"  // field 2, varint 300
                          "\x2a\x1f"      // field 5, 31 bytes
                          "\x0a\x0b" +
                          loss + "\x0a\x10" + test);
}

TEST(Events, LeaveOutWhatIsNotFinite) {
  LogEntry entry;
  entry.loss = NAN;
  entry.psnr = 30;
  const Scalars found = scalars_of(entry);
  for (const auto& [tag, value] : found) EXPECT_NE(tag, "loss");
  EXPECT_EQ(found[0], (std::pair<std::string, double>{"psnr/steps", 30}));
  entry.has_score = true;
  entry.test.plain.mean_psnr = 27;
  entry.train.plain.mean_psnr = NAN;
  double test = 0;
  for (const auto& [tag, value] : scalars_of(entry)) {
    EXPECT_NE(tag, "psnr/train");
    if (tag == "psnr/test") test = value;
  }
  EXPECT_EQ(test, 27);
}

}  // namespace
}  // namespace l4d::train

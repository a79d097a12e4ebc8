// SPDX-License-Identifier: Apache-2.0
// The test values of the specification (F.4 and G.1), as the document has them, against the library
// and, of XXH3-64, against libxxhash.
#include <gtest/gtest.h>
#include <xxhash.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <regex>
#include <string>
#include <vector>

#include "libl4dcodec/base/hash.h"
#include "tests/common/files.h"
#include "tests/entropy/rans_channels.h"

namespace l4d {
namespace {

using Row = std::vector<std::string>;

// The groups of what matches in a section of the specification, from its heading to the next one.
std::vector<Row> rows(const std::string& heading, const std::string& pattern) {
  std::ifstream in(test::source_file("spec/l4d.md"));
  const std::string text((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  const size_t begin = text.find("### " + heading);
  EXPECT_NE(begin, std::string::npos) << heading;
  if (begin == std::string::npos) return {};
  const std::string section = text.substr(begin, text.find("\n##", begin) - begin);
  const std::regex regex(pattern);
  std::vector<Row> out;
  for (std::sregex_iterator m(section.begin(), section.end(), regex), end; m != end; ++m) {
    out.emplace_back();
    for (size_t k = 1; k < m->size(); ++k) out.back().push_back((*m)[k]);
  }
  return out;
}

uint64_t hexadecimal(const std::string& digits) { return std::stoull(digits, nullptr, 16); }

TEST(SpecValues, ChecksumsAreThoseOfLibxxhash) {
  const auto table = rows("F.4 ", R"(\| (\d+) \| `([0-9a-f]{16})` \|)");
  EXPECT_GE(table.size(), 20u);
  std::vector<size_t> branches = {0, 1, 4, 9, 17, 129, 241, 1025};
  for (const Row& row : table) {
    const size_t n = std::stoul(row[0]);
    Bytes data(n);
    for (size_t i = 0; i < n; ++i) data[i] = static_cast<unsigned char>(31 * i % 251);
    EXPECT_EQ(hash64(data), hexadecimal(row[1])) << n;
    EXPECT_EQ(XXH3_64bits(data.data(), n), hexadecimal(row[1])) << n;
    branches.erase(std::remove(branches.begin(), branches.end(), n), branches.end());
  }
  EXPECT_TRUE(branches.empty()) << branches[0];
}

// "TOKEN" or "TOKEN, RAW of BITS bits, ..", pieces least significant first.
std::string text_of(const RansToken& t, uint32_t piece_bits) {
  std::string out = std::to_string(t.token);
  for (uint32_t at = 0; at < t.bits; at += piece_bits) {
    const uint32_t bits = std::min(piece_bits, t.bits - at);
    const uint64_t raw = (t.raw >> at) & ((uint64_t{1} << bits) - 1);
    out += ", " + std::to_string(raw) + " of " + std::to_string(bits) + " bits";
  }
  return out;
}

TEST(SpecValues, Tokens) {
  const auto table = rows("G.1 ", R"(\n\| (\d+) \| ([^|]*) \| ([^|]*) \|(?!.))");
  EXPECT_EQ(table.size(), 15u);
  for (const Row& row : table) {
    const uint64_t value = std::stoull(row[0]);
    const std::string hybrid =
        value < 65536 ? text_of(hybrid_token(static_cast<uint16_t>(value)), 16) : "-";
    EXPECT_EQ(hybrid, row[1]) << value;
    EXPECT_EQ(text_of(wide_token(value), 16), row[2]) << value;
  }
}

// Integer i of the table's blocks.
uint16_t integer(size_t i, uint16_t*) {
  return static_cast<uint16_t>((i * 40503 % 65536) >> (i % 13));
}
uint64_t integer(size_t i, uint64_t*) { return (i * uint64_t{0x9e3779b97f4a7c15}) >> (1 + i % 63); }

template <typename T>
test::RansChannel<T> channel(size_t n, size_t tokens) {
  std::vector<uint64_t> counts(tokens);
  for (size_t t = 0; t < tokens; ++t)
    counts[t] = kRansSlots / tokens + (t < kRansSlots % tokens ? 1 : 0);
  test::RansChannel<T> out;
  for (size_t i = 0; i < n; ++i) out.values.push_back(integer(i, static_cast<T*>(nullptr)));
  out.tables.emplace_back(counts);
  for (size_t t = 0; t < tokens; ++t) EXPECT_EQ(out.tables[0].frequency(t), counts[t]) << t;
  out.entries.resize(kRansSlots);
  out.tables[0].expand(out.entries.data());
  return out;
}

TEST(SpecValues, Blocks) {
  const auto table = rows("G.1 ", R"(\| (hybrid|wide) \| (\d+) \| (\d+) \| `([0-9a-f]{16})` \|)");
  EXPECT_EQ(table.size(), 12u);
  for (const Row& row : table) {
    const size_t n = std::stoul(row[1]);
    test::RansCase c;
    if (row[0] == "hybrid") {
      c.hybrid.push_back(channel<uint16_t>(n, kRansHybridTokens));
    } else {
      c.wide.push_back(channel<uint64_t>(n, kRansWideTokens));
    }
    const Bytes block = c.block();
    EXPECT_EQ(block.size(), std::stoul(row[2])) << row[0] << " " << n;
    EXPECT_EQ(hash64(block), hexadecimal(row[3])) << row[0] << " " << n;
    for (const RansKernels* kernels : {&rans_kernels_reference(), &rans_kernels_simd()}) {
      const test::RansResult result = test::decode(*kernels, c, block);
      EXPECT_TRUE(result.finished) << row[0] << " " << n;
      for (size_t i = 0; i < n; ++i) {
        const uint64_t got = row[0] == "hybrid" ? result.hybrid[0][i] : result.wide[0][i];
        const uint64_t want = row[0] == "hybrid" ? c.hybrid[0].values[i] : c.wide[0].values[i];
        ASSERT_EQ(got, want) << row[0] << " " << n << " " << i;
      }
    }
  }
}

}  // namespace
}  // namespace l4d

// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/container/member.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/common/headers.h"

namespace l4d {
namespace {

const l4d_timeline kTwoSeconds = {1.0, 60, 30, 1, 0};

Member example_member() {
  Member m;
  m.stream = 77;
  m.number = 12;
  m.shift = -0.25;
  m.needs = {0, 3, 11};
  return m;
}

TEST(Member, ComesBack) {
  Member m = example_member(), out;
  ASSERT_TRUE(parse_member(serialize_member(m), 0, &out).ok());
  EXPECT_EQ(out.stream, m.stream);
  EXPECT_EQ(out.number, m.number);
  EXPECT_EQ(out.shift, m.shift);
  EXPECT_EQ(out.needs, m.needs);
  EXPECT_TRUE(out.is(MemberRole::kMedia));
}

TEST(Member, IndexComesBack) {
  Member m, out;
  m.number = 2;
  m.role = static_cast<uint32_t>(MemberRole::kIndex);
  m.records = {{0, 100, 7, 0, 1.5, 0.25, 0, 1, 0}, {100, 200, 8, 1.5, 2, 0, 1, 0, 1}};
  m.record_needs = {0};
  ASSERT_TRUE(parse_member(serialize_member(m), 0, &out).ok());
  ASSERT_EQ(out.records.size(), 2u);
  EXPECT_EQ(out.records[1].offset, 100u);
  EXPECT_EQ(out.records[1].bytes, 200u);
  EXPECT_EQ(out.records[1].header_hash, 8u);
  EXPECT_EQ(out.records[0].end, 1.5);
  EXPECT_EQ(out.records[0].shift, 0.25);
  EXPECT_EQ(out.records[0].role, 1u);
  EXPECT_EQ(out.records[1].num_needs, 1u);
  EXPECT_EQ(out.record_needs, m.record_needs);
}

void expect_broken(const char* clause, const Member& member) {
  Member out;
  const Status status = parse_member(serialize_member(member), 5, &out);
  EXPECT_EQ(status.code(), L4D_ERR_CORRUPT);
  EXPECT_STREQ(status.clause(), clause);
  EXPECT_EQ(status.offset(), 5u);
}

// spec: MEMB-4
TEST(Member, ShiftsAreSound) {
  const double inf = std::numeric_limits<double>::infinity();
  for (const double shift : {inf, -inf, std::nan(""), 0x1p61, -0x1p-61}) {
    Member m = example_member();
    m.shift = shift;
    expect_broken("MEMB-4", m);
  }
}

// spec: MEMB-5
TEST(Member, NeedsAreOfMembersBefore) {
  Member m = example_member();
  for (const std::vector<uint32_t>& needs :
       {std::vector<uint32_t>{12}, {13}, {3, 3}, {4, 3}, {0, UINT32_MAX}}) {
    m.needs = needs;
    expect_broken("MEMB-5", m);
  }
  m = example_member();
  m.role = static_cast<uint32_t>(MemberRole::kStanding);
  expect_broken("MEMB-5", m);
}

// spec: MEMB-2
TEST(Member, EveryCutIsRefused) {
  const Bytes whole = serialize_member(example_member());
  Member out;
  for (size_t n = 0; n < whole.size(); ++n) {
    const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(n));
    const Status status = parse_member(cut, 0, &out);
    EXPECT_STREQ(status.clause(), "MEMB-2") << n;
  }
  EXPECT_STREQ(parse_member(serialize_edit({1, 2}), 0, &out).clause(), "MEMB-2");
}

// spec: MEMB-3
TEST(Edit, IsAPartOfTheSequence) {
  Edit out;
  ASSERT_TRUE(parse_edit(serialize_edit({1, 3}), 0, kTwoSeconds, &out).ok());
  ASSERT_TRUE(parse_edit(serialize_edit({1.5, 1.75}), 0, kTwoSeconds, &out).ok());
  EXPECT_EQ(out.begin, 1.5);
  EXPECT_EQ(out.end, 1.75);
  const double nan = std::nan("");
  for (const Edit& edit :
       {Edit{1.5, 1.5}, Edit{2, 1.5}, Edit{0.999, 2}, Edit{1, 3.001}, Edit{nan, 2}, Edit{1, nan}}) {
    EXPECT_STREQ(parse_edit(serialize_edit(edit), 0, kTwoSeconds, &out).clause(), "MEMB-3");
  }
}

// spec: MEMB-10
TEST(IndexFooter, ComesBackAndEveryOtherByteIsRefused) {
  Bytes bytes;
  IndexFooter{4711}.append(bytes);
  ASSERT_EQ(bytes.size(), IndexFooter::kBytes);
  IndexFooter out;
  ASSERT_TRUE(IndexFooter::parse(bytes, &out));
  EXPECT_EQ(out.bytes, 4711u);
  for (size_t i = 0; i < bytes.size(); ++i) {
    bytes[i] ^= 0x10;
    EXPECT_FALSE(IndexFooter::parse(bytes, &out)) << i;
    bytes[i] ^= 0x10;
  }
  EXPECT_FALSE(IndexFooter::parse(ByteSpan(bytes.data(), 23), &out));
}

// spec: MEMB-1, HEAD-8
TEST(SceneHeader, ExtensionsComeBack) {
  SceneHeader a = test::example_header(), b;
  a.file_bytes = 123456;
  const std::vector<Extension> given = {{1, true, {40, 1, 8, 8, 0}},
                                        {70000, false, {48, 2, 9, 9, 0}}};
  const Bytes bytes = serialize_scene_header(a, given);
  ASSERT_TRUE(parse_scene_header(bytes, 0, &b).ok());
  EXPECT_EQ(b.file_bytes, a.file_bytes);
  EXPECT_TRUE(b.needs_members);
  const std::vector<Extension> found = read_extensions(bytes);
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[0].id, 1u);
  EXPECT_TRUE(found[0].critical);
  EXPECT_EQ(found[1].id, 70000u);
  EXPECT_EQ(found[1].chunk.offset, 48u);
  EXPECT_EQ(found[1].chunk.stored_bytes, 9u);
  EXPECT_FALSE(found[1].critical);
  // Critical ones that are not known are refused.
  EXPECT_STREQ(parse_scene_header(serialize_scene_header(a, {{2, true, {}}}), 0, &b).clause(),
               "HEAD-8");
}

}  // namespace
}  // namespace l4d

// SPDX-License-Identifier: Apache-2.0
// Files of several streams: what copies show, what a list of members says, and what is left of a
// file that ends anywhere.
#include "l4d/members.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>

#include "l4d/experimental/copy.h"
#include "tests/common/codec.h"
#include "tests/decoder/damage.h"

namespace l4d {
namespace {

using namespace test;

struct Destroy {
  void operator()(l4d_members* m) const { l4d_members_destroy(m); }
};
using Members = std::unique_ptr<l4d_members, Destroy>;

Members open(const Bytes& file, bool ignore_index = false, l4d_status want = L4D_OK) {
  const l4d_reader reader = memory_reader(file);
  l4d_members_options options = L4D_INIT(l4d_members_options);
  options.ignore_index = ignore_index ? 1 : 0;
  l4d_members* out = nullptr;
  EXPECT_EQ(l4d_members_open(&reader, &options, &out), want) << l4d_last_error_message();
  return Members(out);
}

l4d_members_info info_of(const Members& members) {
  l4d_members_info info = L4D_INIT(l4d_members_info);
  EXPECT_EQ(l4d_members_get_info(members.get(), &info), L4D_OK);
  return info;
}

l4d_member member_of(const Members& members, uint64_t index) {
  l4d_member member = L4D_INIT(l4d_member);
  EXPECT_EQ(l4d_members_get(members.get(), index, &member), L4D_OK);
  return member;
}

l4d_member_parameters parameters() {
  l4d_member_parameters p = L4D_INIT(l4d_member_parameters);
  return p;
}

l4d_member_parameters member(uint32_t number, double shift, uint32_t role = L4D_MEMBER_MEDIA) {
  l4d_member_parameters p = parameters();
  p.is_member = 1;
  p.number = number;
  p.shift = shift;
  p.role = role;
  return p;
}

// Appends a copy of a stream.
void append(const Bytes& stream, const l4d_member_parameters& p, Bytes* file,
            l4d_status want = L4D_OK) {
  const l4d_reader reader = memory_reader(stream);
  const l4d_writer writer = writer_to(file);
  const size_t before = file->size();
  uint64_t bytes = 0;
  ASSERT_EQ(l4d_copy_member(&reader, nullptr, &p, &writer, &bytes), want)
      << l4d_last_error_message();
  if (want == L4D_OK) {
    EXPECT_EQ(bytes, file->size() - before);
  }
}

void append_index(Bytes* file) {
  const Members members = open(*file, true);
  Bytes index;
  const l4d_writer writer = writer_to(&index);
  uint64_t bytes = 0;
  ASSERT_EQ(l4d_write_member_index(members.get(), &writer, &bytes), L4D_OK);
  EXPECT_EQ(bytes, index.size());
  file->insert(file->end(), index.begin(), index.end());
}

// A standing member, one that needs it, one that does not, and an index.
Bytes small_chain() {
  Bytes file;
  append(tiny_file(), member(0, 0, L4D_MEMBER_STANDING), &file);
  const uint32_t zero = 0;
  l4d_member_parameters p = member(3, 0);
  p.needs = &zero;
  p.num_needs = 1;
  append(tiny_file(), p, &file);
  append(tiny_file(), member(4, 100), &file);
  append_index(&file);
  return file;
}

class Copies : public testing::TestWithParam<NamedFile> {};

TEST_P(Copies, DecodeToTheSameBits) {
  const Bytes& whole = GetParam().bytes();
  Bytes copy, again;
  append(whole, parameters(), &copy);
  EXPECT_TRUE(same_bits(decode(copy, all_query()), decode(whole, all_query())));
  EXPECT_TRUE(validate(copy).empty());
  EXPECT_LT(copy.size(), whole.size() + whole.size() / 50 + 64);
  append(copy, parameters(), &again);
  EXPECT_EQ(again, copy);
}

TEST_P(Copies, ShowAPartAsTheWholeDoes) {
  const Bytes& whole = GetParam().bytes();
  DecoderHandle a, b;
  a.open_memory(whole.data(), whole.size());
  const double begin = a.info().timeline.time_begin, length = a.info().duration;
  l4d_member_parameters p = parameters();
  p.has_edit = 1;
  p.edit_begin = begin + 0.3 * length;
  p.edit_end = begin + 0.45 * length;
  Bytes part;
  append(whole, p, &part);
  EXPECT_TRUE(validate(part).empty());
  b.open_memory(part.data(), part.size());
  EXPECT_LE(b.info().num_gaussians, a.info().num_gaussians);
  for (int k = 0; k <= 16; ++k) {
    const double t = p.edit_begin + k / 16.0 * (p.edit_end - p.edit_begin);
    EXPECT_TRUE(same_bits(b.slice(t), a.slice(t))) << t;
  }
  const Members members = open(part);
  EXPECT_EQ(member_of(members, 0).begin, p.edit_begin);
  EXPECT_EQ(member_of(members, 0).end, p.edit_end);
}

INSTANTIATE_TEST_SUITE_P(
    Files, Copies,
    testing::Values(NamedFile{"dynamic", dynamic_file}, NamedFile{"staged", staged_file},
                    NamedFile{"rcq", rcq_file}, NamedFile{"transform", transform_file},
                    NamedFile{"lossless", lossless_file}, NamedFile{"wandering", wandering_file}),
    file_name);

// A tolerant copy is a whole stream with what a tolerant decoder has of the damaged one, also of
// Gaussians that only lack SH detail.
void expect_rest(const Bytes& hurt) {
  const DecoderHandle decoder = tolerant_decoder(hurt);
  const GaussianArrays rest = decode_rest(decoder, all_query());
  Bytes copy;
  const l4d_status status = copy_rest(hurt, &copy);
  if (rest.count() == 0) {
    EXPECT_NE(status, L4D_OK);
    return;
  }
  ASSERT_EQ(status, L4D_OK) << l4d_last_error_message();
  for (const auto& v : validate(copy)) ADD_FAILURE() << v.clause << " " << v.message;
  EXPECT_TRUE(same_bits(decode(copy, all_query()), rest));
}

TEST_P(Copies, OfDamagedStreamsHaveWhatIsLeft) {
  const Bytes& whole = GetParam().bytes();
  Bytes copy, strict;
  ASSERT_EQ(copy_rest(whole, &copy), L4D_OK);
  append(whole, parameters(), &strict);
  EXPECT_EQ(copy, strict);
  for (const Chunk& chunk : Anatomy(whole).some_chunks(6)) {
    SCOPED_TRACE(chunk.name);
    const Bytes hurt = damage(whole, chunk);
    append(hurt, parameters(), &strict, L4D_ERR_CHECKSUM);
    if (!chunk.needed_by_all) {
      expect_rest(hurt);
    } else {
      EXPECT_EQ(copy_rest(hurt, &copy), L4D_ERR_CHECKSUM);
    }
  }
}

TEST_P(Copies, OfShortStreamsHaveWhatIsLeft) {
  const Bytes& whole = GetParam().bytes();
  const Anatomy anatomy(whole);
  for (const double part : {0.2, 0.5, 0.9, 0.999}) {
    const auto payload = static_cast<double>(whole.size() - anatomy.payload_begin());
    const size_t size = anatomy.payload_begin() + static_cast<size_t>(part * payload);
    expect_rest(Bytes(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size)));
  }
  // Of a stream that ends before its pages nothing is left.
  for (const uint64_t size : {anatomy.tables_begin(), anatomy.payload_begin()}) {
    Bytes copy;
    const Bytes hurt(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_NE(copy_rest(hurt, &copy), L4D_OK);
  }
}

TEST(Copies, OfAPartLeavePagesOut) {
  Bytes part;
  l4d_member_parameters p = parameters();
  p.has_edit = 1;
  p.edit_begin = 0.5;
  p.edit_end = 0.6;
  append(wandering_file(), p, &part);
  EXPECT_LT(part.size(), wandering_file().size() / 2);
}

TEST(Copies, OfTiersAndLevelsHaveWhatDecodersOfThoseSee) {
  EncodeOptions options = small_options();
  options.preset = "default";
  options.tiers = {0.2f, 0.5f};
  const Bytes whole = encode(make_scene(SceneOptions()), options).bytes;
  DecoderHandle d;
  d.open_memory(whole.data(), whole.size());
  size_t before = whole.size() + whole.size() / 50;
  for (const uint32_t tier : {2u, 1u, 0u}) {
    for (const uint32_t level : {UINT32_MAX, 0u}) {
      l4d_member_parameters p = parameters();
      p.tiers = tier + 1;
      p.levels = level + 1;
      Bytes copy;
      append(whole, p, &copy);
      EXPECT_TRUE(validate(copy).empty());
      l4d_query query = all_query();
      query.point.tiers = tier + 1;
      query.point.levels = level + 1;
      EXPECT_TRUE(same_bits(decode(copy, all_query()), decode(whole, query)));
      EXPECT_LT(copy.size(), before);
      if (level == UINT32_MAX) before = copy.size();
    }
  }
}

// spec: MEMB-3, MEMB-4, MEMB-5
TEST(Copies, RefuseWhatBreaksARule) {
  Bytes out;
  const uint32_t needs[] = {1, 1};
  l4d_member_parameters p = member(5, 0);
  p.needs = needs;
  p.num_needs = 2;
  append(tiny_file(), p, &out, L4D_ERR_INVALID_ARGUMENT);
  p = member(5, 1e300);
  append(tiny_file(), p, &out, L4D_ERR_INVALID_ARGUMENT);
  p = member(5, 0, L4D_MEMBER_INDEX);
  append(tiny_file(), p, &out, L4D_ERR_INVALID_ARGUMENT);
  p = parameters();
  p.has_edit = 1;
  p.edit_begin = p.edit_end = 0.5;
  append(tiny_file(), p, &out, L4D_ERR_INVALID_ARGUMENT);
  EXPECT_TRUE(out.empty());
}

void expect_same_list(const Members& a, const Members& b) {
  ASSERT_EQ(info_of(a).count, info_of(b).count);
  for (uint64_t i = 0; i < info_of(a).count; ++i) {
    const l4d_member x = member_of(a, i), y = member_of(b, i);
    EXPECT_EQ(x.offset, y.offset);
    EXPECT_EQ(x.bytes, y.bytes);
    EXPECT_EQ(x.header_hash, y.header_hash);
    EXPECT_EQ(x.begin, y.begin);
    EXPECT_EQ(x.end, y.end);
    EXPECT_EQ(x.shift, y.shift);
    // What a walk read is exact; what follows from an index is rounded.
    EXPECT_EQ(x.sequence_begin + x.shift, x.begin);
    EXPECT_NEAR(x.sequence_begin, y.sequence_begin, 1e-12);
    EXPECT_NEAR(x.sequence_end, y.sequence_end, 1e-12);
    EXPECT_EQ(x.number, y.number);
    EXPECT_EQ(x.role, y.role);
    EXPECT_EQ(x.num_needs, y.num_needs);
  }
}

// spec: MEMB-9, MEMB-10
TEST(MemberList, OfTheIndexIsThatOfTheHeaders) {
  const Bytes file = small_chain();
  EXPECT_TRUE(validate(file).empty());
  const Members listed = open(file), walked = open(file, true);
  EXPECT_EQ(info_of(listed).from_index, 1u);
  EXPECT_EQ(info_of(walked).from_index, 0u);
  EXPECT_EQ(info_of(walked).count, 4u);
  EXPECT_EQ(info_of(walked).bytes, file.size());
  expect_same_list(listed, walked);
  uint32_t number = 7;
  uint64_t count = 0;
  ASSERT_EQ(l4d_members_get_needs(listed.get(), 1, &number, 1, &count), L4D_OK);
  EXPECT_EQ(count, 1u);
  EXPECT_EQ(number, 0u);
}

TEST(MemberList, NamesWhatIsShown) {
  const Bytes file = small_chain();
  const Members members = open(file);
  const auto shown = [&](double t) {
    std::vector<uint32_t> out(4);
    uint64_t count = 0;
    EXPECT_EQ(l4d_members_get_shown(members.get(), t, out.data(), out.size(), &count), L4D_OK);
    out.resize(static_cast<size_t>(count));
    return out;
  };
  const std::vector<uint32_t> first = {1, 0}, second = {2};
  EXPECT_EQ(shown(-5), first);
  EXPECT_EQ(shown(0), first);
  EXPECT_EQ(shown(30), first);  // nearer to the first span than to the second
  EXPECT_EQ(shown(90), second);
  EXPECT_EQ(shown(100), second);
  EXPECT_EQ(shown(1e9), second);
}

// Every file of members that ends somewhere lists those that are whole, and they decode.
// spec: MEMB-6, HEAD-21
TEST(MemberList, HasTheWholeMembersOfAFileThatIsCutAnywhere) {
  const Bytes file = small_chain();
  const Members all = open(file, true);
  std::vector<uint64_t> ends;
  for (uint64_t i = 0; i < info_of(all).count; ++i) {
    ends.push_back(member_of(all, i).offset + member_of(all, i).bytes);
  }
  const GaussianArrays want = decode(tiny_file(), all_query());
  for (size_t n = 0; n < file.size(); ++n) {
    const Bytes cut(file.begin(), file.begin() + static_cast<std::ptrdiff_t>(n));
    const auto whole = static_cast<uint64_t>(
        std::count_if(ends.begin(), ends.end(), [&](uint64_t end) { return end <= n; }));
    if (whole == 0) {
      open(cut, false, n == 0 ? L4D_ERR_NOT_L4D : L4D_ERR_TRUNCATED);
      continue;
    }
    const Members members = open(cut);
    ASSERT_EQ(info_of(members).count, whole) << n;
    ASSERT_EQ(info_of(members).rest, n == ends[whole - 1] ? L4D_OK : L4D_ERR_TRUNCATED) << n;
    ASSERT_EQ(validate(cut).size(), n == ends[whole - 1] ? 0u : 1u) << n;
    if (n % 64 != 0 && n != ends[whole - 1]) continue;
    l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
    options.accept_needs = 1;
    for (uint64_t i = 0; i < std::min<uint64_t>(whole, 3); ++i) {
      l4d_reader reader = L4D_INIT(l4d_reader);
      ASSERT_EQ(l4d_members_get_reader(members.get(), i, &reader), L4D_OK);
      DecoderHandle decoder(&options);
      decoder.open(reader);
      ASSERT_TRUE(same_bits(decoder.decode(all_query()), want)) << n;
    }
  }
}

// spec: HEAD-8, HEAD-21
TEST(MemberList, ADecoderPlaysTheFirstMember) {
  const Bytes file = small_chain();
  EXPECT_TRUE(same_bits(decode(file, all_query()), decode(tiny_file(), all_query())));
  const l4d_member second = member_of(open(file), 1);
  const Bytes alone(file.begin() + static_cast<std::ptrdiff_t>(second.offset), file.end());
  DecoderHandle decoder;
  try {
    decoder.open_memory(alone.data(), alone.size());
    ADD_FAILURE() << "a member opens without those that it needs";
  } catch (const Error& e) {
    EXPECT_EQ(e.status(), L4D_ERR_FEATURE_UNSUPPORTED);
  }
}

TEST(MemberList, PiecesOfAStreamShowWhatItShows) {
  const Bytes& whole = transform_file();
  DecoderHandle a;
  a.open_memory(whole.data(), whole.size());
  const double begin = a.info().timeline.time_begin, length = a.info().duration;
  Bytes file;
  for (uint32_t k = 0; k < 4; ++k) {
    l4d_member_parameters p = member(k, 0);
    p.has_edit = 1;
    p.edit_begin = begin + k / 4.0 * length;
    p.edit_end = begin + (k + 1) / 4.0 * length;
    append(whole, p, &file);
  }
  EXPECT_TRUE(validate(file).empty());
  const Members members = open(file);
  for (int k = 0; k < 40; ++k) {
    const double t = begin + k / 40.0 * length;
    uint32_t shown = 99;
    uint64_t count = 0;
    ASSERT_EQ(l4d_members_get_shown(members.get(), t, &shown, 1, &count), L4D_OK);
    EXPECT_EQ(shown, static_cast<uint32_t>(k / 10));
    l4d_reader reader = L4D_INIT(l4d_reader);
    ASSERT_EQ(l4d_members_get_reader(members.get(), shown, &reader), L4D_OK);
    DecoderHandle b;
    b.open(reader);
    EXPECT_TRUE(same_bits(b.slice(t), a.slice(t))) << t;
  }
}

TEST(MemberList, AStaleIndexIsNoticed) {
  Bytes file = small_chain();
  const l4d_member first = member_of(open(file), 0);
  // Another stream of the same size, in place of the first one.
  file[static_cast<size_t>(first.offset) + 10] ^= 2;
  const Members members = open(file);
  ASSERT_EQ(info_of(members).from_index, 1u);
  l4d_reader reader = L4D_INIT(l4d_reader);
  EXPECT_EQ(l4d_members_get_reader(members.get(), 1, &reader), L4D_OK);
  EXPECT_EQ(l4d_members_get_reader(members.get(), 0, &reader), L4D_ERR_CHECKSUM);
}

TEST(MemberList, ArgumentsAreChecked) {
  const Bytes file = small_chain();
  const Members members = open(file);
  l4d_member out = L4D_INIT(l4d_member);
  EXPECT_EQ(l4d_members_get(members.get(), 4, &out), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_members_get(nullptr, 0, &out), L4D_ERR_INVALID_ARGUMENT);
  uint64_t count = 0;
  EXPECT_EQ(l4d_members_get_shown(members.get(), 0, nullptr, 1, &count), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_members_get_shown(members.get(), 0.0 / 0.0, nullptr, 0, &count),
            L4D_ERR_INVALID_ARGUMENT);
  Bytes index;
  const l4d_writer writer = writer_to(&index);
  EXPECT_EQ(l4d_write_member_index(members.get(), &writer, nullptr), L4D_ERR_INVALID_ARGUMENT);
  l4d_members_destroy(nullptr);
}

}  // namespace
}  // namespace l4d

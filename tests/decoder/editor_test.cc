// SPDX-License-Identifier: Apache-2.0
// The editor that the clause tests build on changes nothing by itself.
#include <gtest/gtest.h>

#include "tests/common/codec.h"
#include "tests/common/flat.h"
#include "tests/common/stream_editor.h"
#include "tests/common/stream_writer.h"

namespace l4d {
namespace {

using namespace test;

class Editor : public testing::TestWithParam<NamedFile> {};

TEST_P(Editor, RebuildsAnEquivalentFile) {
  const Bytes& bytes = GetParam().bytes();
  StreamEditor editor(bytes);
  const Bytes rebuilt = editor.build();
  EXPECT_TRUE(same_bits(decode(bytes, all_query()), decode(rebuilt, all_query())));
  const auto before = validate(bytes), after = validate(rebuilt);
  EXPECT_EQ(before.size(), after.size());
}

TEST_P(Editor, ListsTheStreamsOfEveryPage) {
  const StreamEditor editor(GetParam().bytes());
  for (size_t l = 0; l < editor.layers.size(); ++l) {
    for (size_t d = 0; d < editor.layers[l].directory.size(); ++d) {
      const size_t pages = editor.layers[l].directory[d].pages.size();
      for (size_t p = 0; p < pages; ++p) {
        const auto list = editor.streams({l, d}, p);
        ASSERT_GE(list.size(), 6u);
        EXPECT_EQ(list.back().end, editor.layers[l].directory[d].pages[p].raw.size());
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Streams, Editor,
                         testing::Values(NamedFile{"dynamic", dynamic_file},
                                         NamedFile{"staged", staged_file},
                                         NamedFile{"rcq", rcq_file},
                                         NamedFile{"lossless", lossless_file},
                                         NamedFile{"tiny", tiny_file}),
                         file_name);

// A reader knows no extension, so it passes over those that are not critical.
// spec: VER-2
TEST(Editor, ExtensionsThatAreNotCriticalAreIgnored) {
  StreamEditor editor(tiny_file());
  editor.on_scene_header = [](Bytes& b) { add_extension(b, 77, false); };
  const Bytes bytes = editor.build();
  EXPECT_TRUE(same_bits(decode(tiny_file(), all_query()), decode(bytes, all_query())));
}

// Streams may take any layout that is allowed: rewritten ones decode to the same.
TEST(Editor, OtherLayoutsDecodeAlike) {
  StreamEditor editor(dynamic_file());
  const auto place = editor.find([](const LayerHeader& l) { return !l.permanent; });
  const PageStream s = editor.stream(place, 0, "position.y");
  const Bytes& raw = editor.at(place).pages[0].raw;
  ByteReader in(ByteSpan(raw).subspan(s.begin, s.end - s.begin));
  StreamDecoder decoder;
  decoder.kernels = &stream_kernels_reference();
  std::vector<uint16_t> values(s.n);
  ASSERT_TRUE(decode_stream(decoder, in, 0, s.n, 16, 0, "", values.data()).ok());
  const GaussianArrays want = decode(dynamic_file(), all_query());
  for (const Bytes& form :
       {packed_stream(values, 16, true), packed_stream(values, 16, false),
        planes_stream(values, 16, true, 1), planes_stream(values, 16, false, 2)}) {
    StreamEditor other(dynamic_file());
    other.replace_stream(place, 0, "position.y", form);
    EXPECT_TRUE(same_bits(want, decode(other.build(), all_query())));
  }
}

}  // namespace
}  // namespace l4d

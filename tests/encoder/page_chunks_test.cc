// SPDX-License-Identifier: Apache-2.0
// Where an encoder puts the parts of pages.
#include <gtest/gtest.h>

#include <map>

#include "tests/common/codec.h"
#include "tests/common/sh_detail.h"

namespace l4d {
namespace {

using namespace test;

// Two pages of one bucket, large enough for SH chunks, and small ones of others.
Encoded encode_large() {
  SceneOptions o;
  o.count = 26000;
  o.sh_degree = 1;
  o.permanent = 0.97;
  EncodeOptions e;
  e.preset = "default";
  e.rans = true;
  e.settings = {{L4D_ENC_PAGE_SIZE, 16384},
                {L4D_ENC_CODING, 1},
                {L4D_ENC_PRUNE_COST, 0},
                {L4D_ENC_MERGE_COUNT, 40},
                {L4D_ENC_MERGE_FRACTION, 0}};
  return encode(make_scene(o), e);
}

TEST(PageChunks, OfABucketBaseChunksLieBeforeShChunks) {
  const Bytes file = encode_large().bytes;
  EXPECT_TRUE(validate(file).empty());
  const StreamEditor editor(file);
  size_t with_two = 0, small = 0;
  for (const EditedLayer& layer : editor.layers) {
    for (const EditedDirectoryPage& d : layer.directory) {
      std::map<uint32_t, std::vector<const PageRecord*>> buckets;
      for (const PageRecord& r : d.page.pages) buckets[r.bucket].push_back(&r);
      for (const auto& [bucket, pages] : buckets) {
        // All base chunks, then all SH chunks, without a gap.
        uint64_t at = pages[0]->chunk.offset;
        for (const PageRecord* r : pages) {
          EXPECT_EQ(r->chunk.offset, at);
          at += r->chunk.stored_bytes;
        }
        for (const PageRecord* r : pages) {
          small += !r->has_sh_detail();
          if (!r->has_sh_detail()) continue;
          EXPECT_GE(r->sh_detail.stored_bytes, 4096u);
          EXPECT_EQ(r->sh_detail.offset, at);
          at += r->sh_detail.stored_bytes;
          ++with_two;
        }
      }
    }
  }
  EXPECT_GE(with_two, 2u);
  EXPECT_GT(small, 0u);
}

}  // namespace
}  // namespace l4d

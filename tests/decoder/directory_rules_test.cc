// SPDX-License-Identifier: Apache-2.0
// What a query has to notice in the directory: layers that hold fewer Gaussians than they say, and
// pages that share their stored bytes.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "l4d/experimental/inspect.h"
#include "tests/common/codec.h"
#include "tests/common/stream_editor.h"
#include "tests/decoder/damage.h"

namespace l4d {
namespace {

using namespace test;

// The layer `index` says that it holds one Gaussian more.
Bytes one_too_many(const Bytes& file, size_t index) {
  StreamEditor editor(file);
  ++editor.header.num_gaussians;
  ++editor.header.layers.at(index).num_gaussians;
  return editor.build();
}

l4d_status select_status(const DecoderHandle& decoder, const l4d_query& query) {
  l4d_selection selection = L4D_INIT(l4d_selection);
  return l4d_decoder_select(decoder.get(), &query, &selection);
}

void expect_refused(l4d_status status, const char* clause) {
  EXPECT_EQ(l4d_status_name(status), std::string("L4D_ERR_CORRUPT"));
  const std::string detail = l4d_last_error_message();
  EXPECT_EQ(detail.rfind(std::string("spec ") + clause + " at byte ", 0), 0u) << detail;
}

std::vector<l4d_bucket> all_buckets(uint32_t layer, unsigned level) {
  std::vector<l4d_bucket> buckets;
  for (uint32_t b = 0; b < num_buckets(level); ++b) buckets.push_back({layer, b});
  return buckets;
}

l4d_query list_query(const std::vector<l4d_bucket>& buckets) {
  l4d_query query = all_query();
  query.kind = L4D_QUERY_BUCKETS;
  query.buckets = buckets.data();
  query.num_buckets = buckets.size();
  return query;
}

// Each layer in turn, whatever kind of query reads all of its directory.
// spec: DIR-5
TEST(DirectoryRules, ALayerWithoutAllItsGaussiansIsRefused) {
  for (const Bytes* file : {&dynamic_file(), &rcq_file(), &transform_file(), &lossless_file()}) {
    const StreamEditor editor(*file);
    for (uint32_t l = 0; l < editor.header.layers.size(); ++l) {
      const LayerHeader& layer = editor.header.layers[l];
      if (layer.num_gaussians == 0) continue;
      SCOPED_TRACE("layer " + std::to_string(l));
      const Bytes bytes = one_too_many(*file, l);
      const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
      DecoderHandle d(&o);
      d.open_memory(bytes.data(), bytes.size());
      expect_refused(select_status(d, all_query()), "DIR-5");
      const std::vector<l4d_bucket> whole = all_buckets(l, layer.level);
      expect_refused(select_status(d, list_query(whole)), "DIR-5");
      l4d_query coarser = all_query();
      if (layer.level > 0) {
        coarser.point.levels = layer.level;
        EXPECT_EQ(select_status(d, coarser), L4D_OK);
      } else {
        // Level 0 has one directory page, which every instant reads.
        expect_refused(select_status(d, time_query(0)), "DIR-5");
        l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
        expect_refused(l4d_decoder_slice(d.get(), 0, &splats), "DIR-5");
      }
      l4d_stream_demand demand = L4D_INIT(l4d_stream_demand);
      expect_refused(l4d_decoder_get_stream_demand(d.get(), &demand), "DIR-5");
    }
  }
}

// A tolerant decoder hands out what is there and reports what is not.
// spec: DEC-4
TEST(DirectoryRules, ATolerantDecoderReportsGaussiansThatAreNotThere) {
  const Bytes bytes = one_too_many(dynamic_file(), 0);
  const DecoderHandle d = tolerant_decoder(bytes);
  EXPECT_TRUE(same_bits(decode_rest(d, all_query()), decode(dynamic_file(), all_query())));
  const std::vector<l4d_loss> losses = losses_of(d);
  ASSERT_EQ(losses.size(), 1u);
  EXPECT_EQ(losses[0].status, L4D_ERR_CORRUPT);
  EXPECT_STREQ(losses[0].clause, "DIR-5");
  EXPECT_EQ(losses[0].layer, 0u);
  EXPECT_EQ(losses[0].num_pages, 0u);
  EXPECT_EQ(losses[0].num_gaussians, 1u);
  EXPECT_EQ(counters_of(d).gaussians_lost, 2u);  // of the selection, and of the decode
}

// Two pages, of different buckets of a layer, one of which names the bytes of the other.
struct SharedPages {
  Bytes bytes;
  uint32_t layer = 0;
  uint32_t buckets[2] = {0, 0};
};

SharedPages shared_pages(const Bytes& file) {
  SharedPages shared;
  StreamEditor editor(file);
  editor.build();
  for (uint32_t l = 0; l < editor.layers.size(); ++l) {
    for (EditedDirectoryPage& d : editor.layers[l].directory) {
      if (!d.present || d.page.pages.size() < 2) continue;
      std::vector<PageRecord>& records = d.page.pages;
      if (records.front().bucket == records.back().bucket) continue;
      const size_t last = records.size() - 1;
      const uint64_t gained = records[0].num_gaussians - uint64_t{records[last].num_gaussians};
      editor.header.num_gaussians += gained;
      editor.header.layers[l].num_gaussians += gained;
      shared.layer = l;
      shared.buckets[0] = records[0].bucket;
      shared.buckets[1] = records[last].bucket;
      records[last].num_gaussians = records[0].num_gaussians;
      records[last].block = records[0].block;
      d.pages[last] = d.pages[0];
      d.pages[last].offset = records[0].chunk.offset;
      shared.bytes = editor.build();
      return shared;
    }
  }
  ADD_FAILURE() << "no layer with two buckets";
  return shared;
}

// spec: CHNK-4
TEST(DirectoryRules, PagesThatShareBytesAreRefusedWhereAQueryMeetsBoth) {
  for (const bool tolerant : {false, true}) {
    const SharedPages shared = shared_pages(dynamic_file());
    l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
    o.tolerant = tolerant;
    DecoderHandle d(&o);
    d.open_memory(shared.bytes.data(), shared.bytes.size());
    expect_refused(select_status(d, all_query()), "CHNK-4");
    const std::vector<l4d_bucket> both = {{shared.layer, shared.buckets[0]},
                                          {shared.layer, shared.buckets[1]}};
    expect_refused(select_status(d, list_query(both)), "CHNK-4");
    for (const l4d_bucket& one : both) {
      EXPECT_EQ(select_status(d, list_query({one})), L4D_OK) << l4d_last_error_message();
    }
  }
}

}  // namespace
}  // namespace l4d

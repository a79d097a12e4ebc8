// SPDX-License-Identifier: Apache-2.0
// A tolerant copy leaves out single pages that are wrong under right checksums, and nothing else.
#include <gtest/gtest.h>

#include "libl4dcodec/container/levels.h"
#include "tests/common/codec.h"
#include "tests/common/sh_detail.h"
#include "tests/decoder/damage.h"

namespace l4d {
namespace {

using namespace test;

class ProvenCopies : public testing::TestWithParam<NamedFile> {
 protected:
  // `hurt`: the whole, with page `page` of it wrong.
  void expect_without(const Bytes& hurt, size_t page) {
    EXPECT_FALSE(validate(hurt).empty());
    Bytes copy;
    ASSERT_EQ(copy_rest(hurt, &copy), L4D_OK) << l4d_last_error_message();
    for (const Violation& v : validate(copy)) ADD_FAILURE() << v.clause << " " << v.message;
    EXPECT_TRUE(same_bits(decode(copy, all_query()), without(all_, anatomy_, {page})));
  }
  template <typename F>
  void for_some_pages(const F& f) {
    ASSERT_GT(anatomy_.pages.size(), 1u);
    for (size_t p = 0; p < anatomy_.pages.size(); p += 1 + anatomy_.pages.size() / 5) {
      SCOPED_TRACE(p);
      const Anatomy::Page& page = anatomy_.pages[p];
      StreamEditor editor = anatomy_.editor;
      f(p, editor.layers[page.layer].directory[page.directory], page.index);
      expect_without(editor.build(), p);
    }
  }

  const Bytes& whole_ = GetParam().bytes();
  const Anatomy anatomy_{whole_};
  const GaussianArrays all_ = decode(whole_, all_query());
};

// spec: DIR-10
TEST_P(ProvenCopies, LeaveOutPagesWhoseGaussiansBreakRules) {
  for_some_pages([](size_t, EditedDirectoryPage& directory, uint32_t index) {
    PageRecord& record = directory.page.pages[index];
    for (size_t k = 0; k < 3; ++k) record.bounds[k] = record.bounds[3 + k];
  });
}

TEST_P(ProvenCopies, LeaveOutPagesThatDoNotDecode) {
  for_some_pages([](size_t, EditedDirectoryPage& directory, uint32_t index) {
    directory.pages[index].raw.resize(directory.pages[index].raw.size() / 2);
  });
}

INSTANTIATE_TEST_SUITE_P(
    Files, ProvenCopies,
    testing::Values(NamedFile{"dynamic", dynamic_file}, NamedFile{"staged", staged_file},
                    NamedFile{"rcq", rcq_file}, NamedFile{"transform", transform_file},
                    NamedFile{"lossless", lossless_file}, NamedFile{"wandering", wandering_file}),
    file_name);

// Of a page whose SH chunk does not decode the base colours stay.
TEST(ProvenCopiesOf, KeepBaseColoursOfDetailThatDoesNotDecode) {
  const Bytes whole = with_sh_detail(transform_file(), 1);
  StreamEditor editor(whole);
  const StreamEditor::Place place = editor.find([](const LayerHeader&) { return true; });
  EditedDirectoryPage& directory = editor.at(place);
  ASSERT_TRUE(directory.page.pages[0].has_sh_detail());
  Bytes& detail = directory.details[0].raw;
  detail.resize(detail.size() / 2);
  const Bytes hurt = editor.build();
  EXPECT_FALSE(validate(hurt).empty());
  Bytes copy;
  ASSERT_EQ(copy_rest(hurt, &copy), L4D_OK) << l4d_last_error_message();
  for (const Violation& v : validate(copy)) ADD_FAILURE() << v.clause << " " << v.message;
  l4d_query base = all_query();
  base.point.detail = L4D_DETAIL_BASE_COLOR;
  EXPECT_TRUE(same_bits(decode(copy, base), decode(whole, base)));
}

// spec: LEVL-1, LEVL-2. A copy declares no profile that it does not keep to.
TEST(ProvenCopiesOf, StreamsThatDeclareAnotherProfileDeclareTheirOwn) {
  for (const uint32_t profile : {12u, static_cast<uint32_t>(ProfileId::kLossless)}) {
    StreamEditor editor(dynamic_file());
    editor.header.profile = profile;
    const Bytes hurt = editor.build();
    EXPECT_EQ(validate(hurt).size(), 1u);
    Bytes copy;
    ASSERT_EQ(copy_rest(hurt, &copy), L4D_OK) << l4d_last_error_message();
    for (const Violation& v : validate(copy)) ADD_FAILURE() << v.clause << " " << v.message;
    EXPECT_TRUE(same_bits(decode(copy, all_query()), decode(dynamic_file(), all_query())));
  }
}

}  // namespace
}  // namespace l4d

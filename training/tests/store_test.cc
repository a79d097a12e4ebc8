// SPDX-License-Identifier: Apache-2.0
#include "training/images/store.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <set>

#include "training/tests/tiny_capture.h"

namespace l4d::train {
namespace {

class StoreTest : public testing::Test {
 protected:
  StoreTest()
      : capture_(read_capture(test::tiny_capture(), {})),
        loader_(capture_, 1),
        instants_(instants_of(capture_, "train")) {
    options_.window = 2;
    options_.uses = 1;
    options_.seed = 3;
  }
  std::unique_ptr<ImageStore> make(uint64_t windows) {
    // What the store counts for an image: alpha may be there.
    const uint64_t window = uint64_t{2} * 14 * 64 * 48 * 4;
    options_.memory = windows * window;
    return make_image_store(loader_, instants_, options_, nullptr);
  }

  Capture capture_;
  ImageLoader loader_;
  std::vector<Instant> instants_;
  StoreOptions options_;
};

TEST_F(StoreTest, KeepsAllThatFits) {
  const auto store = make(10);
  store->go_to(0);
  EXPECT_EQ(store->instants().size(), 20U);
  EXPECT_EQ(store->bytes(), uint64_t{280} * 64 * 48 * 3);
  EXPECT_EQ(instants_[3].views.size(), 14U);
}

TEST_F(StoreTest, ReservoirMeetsAllImagesInBoundedMemory) {
  const auto all = make(10);
  const auto store = make(4);
  std::set<uint32_t> met;
  std::vector<std::vector<uint32_t>> history;
  for (uint64_t step = 0; step < 14 * 60; ++step) {
    store->go_to(step);
    EXPECT_LE(store->bytes(), options_.memory);
    ASSERT_EQ(store->instants().size(), 6U);  // three windows; one more is being read
    if (step % 14 != 0) continue;
    history.push_back(store->instants());
    met.insert(store->instants().begin(), store->instants().end());
    // Windows in memory are spread over the sequence: none is there twice.
    EXPECT_EQ(std::set<uint32_t>(store->instants().begin(), store->instants().end()).size(), 6U);
    for (const uint32_t k : store->instants()) {
      const uint32_t view = instants_[k].views[step % 14];
      EXPECT_EQ(store->image(view).rgb, all->image(view).rgb);
    }
  }
  EXPECT_EQ(met.size(), 20U);
  // A training that resumes meets what the whole one met.
  const auto resumed = make(4);
  resumed->go_to(14 * 31);
  EXPECT_EQ(resumed->instants(), history[31]);
  resumed->go_to(14 * 32);
  EXPECT_EQ(resumed->instants(), history[32]);
}

// Where only some windows are wanted, there is a reservoir even if all images fit, and instants may
// be those of its newest windows alone.
TEST_F(StoreTest, DrawsFromFewerWindows) {
  options_.few = true;
  const auto store = make(30);
  store->go_to(0);
  EXPECT_EQ(store->windows(), 5U);  // half of the ten
  ASSERT_EQ(store->instants().size(), 10U);
  const std::vector<uint32_t> all = store->instants();
  store->use_windows(2);
  EXPECT_EQ(store->windows(), 2U);
  const std::vector<uint32_t> fewer = store->instants();
  ASSERT_EQ(fewer.size(), 4U);
  EXPECT_TRUE(std::includes(all.begin(), all.end(), fewer.begin(), fewer.end()));
  store->go_to(14);
  EXPECT_EQ(store->period(), 1U);
  EXPECT_EQ(store->instants().size(), 4U);
  EXPECT_NE(store->instants(), fewer);
  store->use_windows(0);
  EXPECT_EQ(store->windows(), 1U);
  store->use_windows(UINT32_MAX);
  EXPECT_EQ(store->windows(), 5U);
  // The same instants, whenever the bound was set.
  const auto other = make(30);
  other->go_to(14);
  EXPECT_EQ(other->instants(), store->instants());

  options_.few = false;
  EXPECT_EQ(make(30)->windows(), 1U);
}

TEST_F(StoreTest, RefusesTooLittleMemory) {
  try {
    make(2);
    FAIL();
  } catch (const io::Error& error) {
    EXPECT_EQ(error.status(), L4D_ERR_LIMIT_EXCEEDED);
  }
}

TEST_F(StoreTest, MissingImagesAreNamed) {
  capture_.views[17].file = "/nonexistent/frame.png";
  const CaptureView& view = capture_.views[17];
  if (capture_.cameras[view.camera].split != "train") GTEST_FAIL() << "a view of a test camera";
  try {
    make(10);
    FAIL();
  } catch (const io::Error& error) {
    EXPECT_EQ(error.status(), L4D_ERR_IO);
    EXPECT_THAT(error.what(), testing::HasSubstr(capture_.cameras[view.camera].name + ", frame " +
                                                 std::to_string(view.frame)));
  }
}

}  // namespace
}  // namespace l4d::train

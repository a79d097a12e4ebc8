// SPDX-License-Identifier: Apache-2.0
// Work beside the calling thread: SH beside the layers where there is a device, scales and both
// halves of rotors where there are threads enough. Neither may change a bit of the file, nor what
// cancelling does.
#include "libl4dcodec/base/async.h"

#include <gtest/gtest.h>

#include <atomic>
#include <stdexcept>
#include <string>
#include <thread>

#include "encoder/encoder.h"
#include "tests/common/test_scene.h"

namespace l4d {
namespace {

using test::SceneOptions;
using test::TestScene;

TEST(AsyncTest, ApartOrAtOnce) {
  std::thread::id worker;
  const auto work = [&] {
    worker = std::this_thread::get_id();
    return 5;
  };
  EXPECT_EQ(start_async(true, work).get(), 5);
  EXPECT_NE(worker, std::this_thread::get_id());
  std::future<int> done = start_async(false, work);
  EXPECT_EQ(worker, std::this_thread::get_id());
  EXPECT_EQ(done.get(), 5);
}

TEST(AsyncTest, ExceptionsComeWithTheResult) {
  for (const bool concurrent : {true, false}) {
    std::future<void> failed = start_async(concurrent, [] { throw std::runtime_error("no"); });
    EXPECT_THROW(failed.get(), std::runtime_error);
  }
}

// A device of the host's own: it does what it is asked, and counts.
class HostDevice : public NearestDevice {
 public:
  explicit HostDevice(std::atomic<size_t>& searches) : searches_(searches) {}
  bool search(const Job& job) override {
    if (job.keep) {
      update_nearest(job.points, job.n, job.dim, job.codebook, job.k, job.first_label, 1,
                     job.labels, job.sq_dist);
    } else {
      assign_nearest(job.points, job.n, job.dim, job.codebook, job.k, 1, nullptr, job.labels,
                     job.sq_dist);
    }
    ++searches_;
    return true;
  }
  std::unique_ptr<HeldPoints> hold(const float*, size_t, size_t, size_t) override {
    return std::make_unique<HeldPoints>();
  }

 private:
  std::atomic<size_t>& searches_;
};

struct Answers {
  int calls = 0;
  int at = -1;  // this call is answered with a wish to cancel
  std::thread::id thread = std::this_thread::get_id();
  bool elsewhere = false;
  uint64_t done = 0;
  bool backwards = false;
};

int on_progress(void* user, uint64_t done, uint64_t, const char*) {
  Answers& a = *static_cast<Answers*>(user);
  a.elsewhere = a.elsewhere || std::this_thread::get_id() != a.thread;
  a.backwards = a.backwards || done < a.done;
  a.done = done;
  return a.calls++ == a.at ? 1 : 0;
}

class AsyncEncode : public testing::TestWithParam<bool> {  // whether with one stage of codebooks
 protected:
  void SetUp() override {
    SceneOptions s;
    s.count = 1200;
    s.sh_degree = 2;
    scene_ = test::make_scene(s);
  }

  // The file; empty where it is cancelled.
  std::string encode(uint32_t threads, bool device, Answers* answers = nullptr) {
    l4d_encoder_options options = L4D_INIT(l4d_encoder_options);
    options.threads = threads;
    Encoder encoder(options);
    EXPECT_TRUE(encoder.settings().set_preset("indexed").ok());
    EXPECT_TRUE(encoder.settings().set(Parameter::kMergeCount, kAllComponents, 20).ok());
    EXPECT_TRUE(encoder.settings().set(Parameter::kCodebookSize, kAllComponents, 128).ok());
    EXPECT_TRUE(encoder.settings().set(Parameter::kRcq, kAllComponents, 2).ok());
    if (GetParam()) {
      EXPECT_TRUE(encoder.settings().set_stages(kAllComponents, {1.0f}).ok());
    }
    if (device) encoder.set_device(std::make_unique<HostDevice>(searches_));
    if (answers != nullptr) encoder.set_progress(on_progress, answers);
    l4d_placement placement{};
    placement.scale = 1;
    EXPECT_TRUE(encoder.set_scene(scene_.view(), scene_.timeline, placement).ok());
    std::string file;
    const Status status = encoder.encode([&](const unsigned char* data, size_t n) {
      file.append(reinterpret_cast<const char*>(data), n);
      return true;
    });
    if (status.code() == L4D_ERR_CANCELLED) return {};
    EXPECT_TRUE(status.ok()) << status.detail();
    return file;
  }

  TestScene scene_;
  std::atomic<size_t> searches_{0};
};

TEST_P(AsyncEncode, ChangesNoBit) {
  const std::string want = encode(1, false);
  ASSERT_FALSE(want.empty());
  for (const uint32_t threads : {1u, 2u, 3u, 7u}) {
    EXPECT_TRUE(encode(threads, false) == want) << threads << " threads";
    searches_ = 0;
    EXPECT_TRUE(encode(threads, true) == want) << threads << " threads and a device";
    EXPECT_GT(searches_, 20u);
  }
}

TEST_P(AsyncEncode, CancelsFromTheFirstCallOn) {
  Answers count;
  const std::string want = encode(4, true, &count);
  EXPECT_FALSE(want.empty());
  EXPECT_GT(count.calls, 5);
  for (int k = 0; k < count.calls; k = 2 * k + 1) {
    Answers a;
    a.at = k;
    const std::string file = encode(4, true, &a);
    EXPECT_EQ(file.empty(), a.calls > k) << "call " << k;
    EXPECT_FALSE(a.elsewhere);
    EXPECT_FALSE(a.backwards);
  }
}

INSTANTIATE_TEST_SUITE_P(Settings, AsyncEncode, testing::Bool());

}  // namespace
}  // namespace l4d

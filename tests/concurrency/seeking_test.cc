// SPDX-License-Identifier: Apache-2.0
// Handles share no mutable state: many threads, each with decoders or encoders of its own, get what
// one thread gets. Meant to run under ThreadSanitizer too (preset tsan).
#include <gtest/gtest.h>

#include <atomic>
#include <string>
#include <thread>
#include <vector>

#include "tests/common/codec.h"
#include "tests/common/random.h"
#include "tests/concurrency/seeks.h"

namespace l4d {
namespace {

using namespace test;

// Runs body(i) on n threads at once; they wait for each other to begin.
template <typename Body>
void at_once(uint32_t n, const Body& body) {
  std::atomic<uint32_t> ready{0};
  std::vector<std::thread> threads;
  for (uint32_t i = 0; i < n; ++i) {
    threads.emplace_back([&, i] {
      ++ready;
      while (ready < n) std::this_thread::yield();
      body(i);
    });
  }
  for (std::thread& t : threads) t.join();
}

constexpr uint32_t kThreads = 8;

class Seeking : public testing::TestWithParam<NamedFile> {};

// One reader over one descriptor serves them all, since pread needs no position.
TEST_P(Seeking, ThreadsWithDecodersOfTheirOwn) {
  const TemporaryFile file(GetParam().bytes());
  const Seeks seeks(GetParam().bytes(), 12);
  const SharedReader shared(file.path());
  std::atomic<uint32_t> right{0};
  at_once(kThreads, [&](uint32_t i) {
    // Some of them take worker threads besides.
    const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1 + i % 3);
    DecoderHandle d(&o);
    d.open(shared.reader());
    Random random(100 + i);
    for (int k = 0; k < 10; ++k) {
      right += seeks.matches(d, random.below(static_cast<uint32_t>(seeks.size())));
    }
  });
  EXPECT_EQ(right, kThreads * 10);
}

TEST_P(Seeking, DecodersThatOpenTheFileThemselves) {
  const TemporaryFile file(GetParam().bytes());
  const Seeks seeks(GetParam().bytes(), 6);
  std::atomic<uint32_t> right{0};
  at_once(2, [&](uint32_t i) {
    for (int round = 0; round < 3; ++round) {
      DecoderHandle d;
      d.open_file(file.path());
      for (size_t k = 0; k < seeks.size(); ++k) {
        right += seeks.matches(d, i == 0 ? k : seeks.size() - 1 - k);
      }
    }
  });
  EXPECT_EQ(right, 2 * 3 * seeks.size());
}

INSTANTIATE_TEST_SUITE_P(Streams, Seeking,
                         testing::Values(NamedFile{"dynamic", dynamic_file},
                                         NamedFile{"staged", staged_file},
                                         NamedFile{"transform", transform_file},
                                         NamedFile{"lossless", lossless_file}),
                         file_name);

TEST(Coexistence, EncodersBesideDecoders) {
  SceneOptions s;
  s.count = 400;
  const TestScene scene = make_scene(s);
  EncodeOptions options = small_options();
  options.settings.push_back({L4D_ENC_CODEBOOK_SIZE, 8});
  const Bytes want = encode(scene, options).bytes;
  const Seeks seeks(dynamic_file(), 8);
  std::atomic<uint32_t> right{0};
  at_once(6, [&](uint32_t i) {
    if (i % 2 == 0) {
      EncodeOptions mine = options;
      mine.threads = 1 + i;
      right += encode(scene, mine).bytes == want;
      return;
    }
    DecoderHandle d;
    d.open_memory(dynamic_file().data(), dynamic_file().size());
    uint32_t matches = 0;
    for (size_t k = 0; k < seeks.size(); ++k) matches += seeks.matches(d, k);
    right += matches == seeks.size();
  });
  EXPECT_EQ(right, 6u);
}

TEST(Coexistence, FailuresStayWithTheirHandle) {
  Bytes damaged = dynamic_file();
  damaged[damaged.size() - 100] ^= 1;
  const Seeks seeks(dynamic_file(), 4);
  std::atomic<uint32_t> right{0};
  at_once(kThreads, [&](uint32_t i) {
    for (int round = 0; round < 5; ++round) {
      DecoderHandle d;
      if (i % 2 == 0) {
        d.open_memory(dynamic_file().data(), dynamic_file().size());
        right += seeks.matches(d, static_cast<size_t>(round) % seeks.size());
        continue;
      }
      d.open_memory(damaged.data(), damaged.size());
      try {
        d.decode(all_query());
      } catch (const Error& e) {
        const std::string detail = l4d_last_error_message();
        right += e.status() == L4D_ERR_CHECKSUM && detail.find("CHNK-2") != std::string::npos;
      }
    }
  });
  EXPECT_EQ(right, kThreads * 5);
}

TEST(Coexistence, ValidatorsAndTables) {
  const std::string info = l4d_build_info();
  std::atomic<uint32_t> right{0};
  at_once(kThreads, [&](uint32_t i) {
    const l4d_reader reader = memory_reader(i % 2 == 0 ? dynamic_file() : staged_file());
    uint64_t violations = 99;
    const l4d_status status = l4d_validate(&reader, nullptr, nullptr, nullptr, &violations);
    right += status == L4D_OK && violations == 0 && l4d_build_info() == info &&
             std::string(l4d_status_name(L4D_ERR_IO)) == "L4D_ERR_IO" &&
             std::string(l4d_encoder_preset_name(0)) == "default";
  });
  EXPECT_EQ(right, kThreads);
}

}  // namespace
}  // namespace l4d

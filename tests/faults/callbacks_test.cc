// SPDX-License-Identifier: Apache-2.0
// Readers, writers and progress callbacks that fail at any call.
#include <gtest/gtest.h>

#include <cstring>

#include "l4d/experimental/parameters.h"
#include "tests/common/sh_detail.h"
#include "tests/faults/decoder_calls.h"

namespace l4d {
namespace {

using namespace test;

// Fails in one call, or gives too little there and nothing after.
struct FaultyReader {
  enum Fault { kNone, kFails, kEnds, kTooMuch };
  const Bytes* bytes;
  Fault fault = kNone;
  int at = -1;
  int calls = 0;
  l4d_reader reader() {
    l4d_reader r = memory_reader(*bytes);
    r.user = this;
    r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
      FaultyReader& self = *static_cast<FaultyReader*>(user);
      const bool now = self.calls++ == self.at;
      if (now && self.fault == kFails) return -1;
      if (now && self.fault == kEnds) return 0;
      if (now && self.fault == kTooMuch) return static_cast<int64_t>(n) + 1;
      std::memcpy(dst, self.bytes->data() + offset, n);
      return static_cast<int64_t>(n);
    };
    r.size = [](void* user) -> int64_t {
      return static_cast<int64_t>(static_cast<FaultyReader*>(user)->bytes->size());
    };
    return r;
  }
};

void fail_every_read(const Bytes& file) {
  DecoderCalls calls(file);
  for (const Call call : kCalls) {
    SCOPED_TRACE(name_of(call));
    FaultyReader count{&file};
    int before = 0;
    {
      const DecoderHandle d = calls.opened(count.reader(), 1);
      before = count.calls;
      ASSERT_EQ(calls.make(call, d.get(), count.reader()), L4D_OK);
    }
    ASSERT_GT(count.calls, before);
    for (int k = before; k < count.calls; ++k) {
      for (const auto fault : {FaultyReader::kFails, FaultyReader::kEnds, FaultyReader::kTooMuch}) {
        FaultyReader faulty{&file, fault, k};
        const l4d_reader reader = faulty.reader();
        const DecoderHandle d = calls.opened(reader, 1);
        ASSERT_EQ(calls.make(call, d.get(), reader), L4D_ERR_IO) << "read " << k;
        ASSERT_STRNE(l4d_last_error_message(), "");
        ASSERT_EQ(calls.make(call, d.get(), reader), L4D_OK) << "read " << k;
        ASSERT_TRUE(calls.right(call)) << "read " << k;
      }
    }
  }
}

TEST(ReaderFaults, EveryCallOfEveryFunction) {
  fail_every_read(tiny_file());
  EncodeOptions o = small_options();
  o.rans = true;
  fail_every_read(with_sh_detail(encode(head(make_scene({}), 300), o).bytes, 0));
}

// ---- progress ----------------------------------------------------------------------------------

// Says stop at one call, and remembers the arguments.
struct Stop {
  int at = -1;
  int calls = 0;
  uint64_t last = 0;
  bool sane = true;
  static int callback(void* user, uint64_t done, uint64_t total, const char* stage) {
    Stop& self = *static_cast<Stop*>(user);
    self.sane = self.sane && done <= total && stage != nullptr && *stage != '\0';
    self.last = done;
    return self.calls++ == self.at ? 7 : 0;
  }
};

TEST(Cancelling, DecoderAtEveryPoint) {
  for (const Bytes* bytes : {&tiny_file(), &dynamic_file()}) {
    DecoderCalls calls(*bytes);
    const l4d_reader reader = memory_reader(*bytes);
    for (const Call call : {Call::kDecode, Call::kPacked, Call::kSlice}) {
      SCOPED_TRACE(name_of(call));
      Stop count;
      {
        const DecoderHandle d = calls.opened(reader, 1);
        ASSERT_EQ(l4d_decoder_set_progress(d.get(), &Stop::callback, &count), L4D_OK);
        ASSERT_EQ(calls.make(call, d.get(), reader), L4D_OK);
        EXPECT_TRUE(count.sane);
      }
      ASSERT_GT(count.calls, 0);
      for (int k = 0; k < count.calls; ++k) {
        const DecoderHandle d = calls.opened(reader, 1);
        Stop stop{k};
        l4d_decoder_set_progress(d.get(), &Stop::callback, &stop);
        ASSERT_EQ(calls.make(call, d.get(), reader), L4D_ERR_CANCELLED) << "point " << k;
        EXPECT_EQ(stop.calls, k + 1);
        ASSERT_EQ(calls.make(call, d.get(), reader), L4D_OK) << "point " << k;
        ASSERT_TRUE(calls.right(call)) << "point " << k;
      }
    }
  }
}

// The options carry a callback too: validation has no handle to register one with.
TEST(Cancelling, ValidationAtEveryPoint) {
  const l4d_reader reader = memory_reader(dynamic_file());
  l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  Stop count;
  o.progress = &Stop::callback;
  o.progress_user = &count;
  uint64_t violations = 0;
  ASSERT_EQ(l4d_validate(&reader, &o, nullptr, nullptr, &violations), L4D_OK);
  EXPECT_TRUE(count.sane);
  DecoderHandle d;
  d.open_memory(dynamic_file().data(), dynamic_file().size());
  EXPECT_EQ(count.last, d.info().num_gaussians);
  ASSERT_GT(count.calls, 10);
  for (int k = 0; k < count.calls; ++k) {
    Stop stop{k};
    o.progress_user = &stop;
    ASSERT_EQ(l4d_validate(&reader, &o, nullptr, nullptr, &violations), L4D_ERR_CANCELLED);
    EXPECT_EQ(stop.calls, k + 1);
    EXPECT_EQ(violations, 0u);
  }
}

TEST(Cancelling, OptionsRegisterTheCallbackOfADecoder) {
  l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  Stop stop{0};
  o.progress = &Stop::callback;
  o.progress_user = &stop;
  DecoderHandle d(&o);
  d.open_memory(tiny_file().data(), tiny_file().size());
  const l4d_query q = all_query();
  l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
  b.capacity = d.info().num_gaussians;
  EXPECT_EQ(l4d_decoder_decode(d.get(), &q, &b), L4D_ERR_CANCELLED);
  l4d_decoder_set_progress(d.get(), nullptr, nullptr);
  EXPECT_EQ(l4d_decoder_decode(d.get(), &q, &b), L4D_OK);
}

// ---- writers -----------------------------------------------------------------------------------

struct FaultyWriter {
  int at = -1;
  int calls = 0;
  Bytes bytes;
  l4d_writer writer() {
    l4d_writer w = L4D_INIT(l4d_writer);
    w.user = this;
    w.write = [](void* user, const void* src, size_t n) -> int {
      FaultyWriter& self = *static_cast<FaultyWriter*>(user);
      if (self.calls++ == self.at) return -5;
      const auto* p = static_cast<const unsigned char*>(src);
      self.bytes.insert(self.bytes.end(), p, p + n);
      return 0;
    };
    return w;
  }
};

struct SmallEncode {
  TestScene scene;
  const l4d_encoder_options options = one_thread();
  EncoderHandle encoder{&options};
  SmallEncode() {
    SceneOptions s;
    s.count = 60;
    s.sh_degree = 1;
    s.num_frames = 4;
    scene = make_scene(s);
    EncodeOptions o = small_options();
    o.settings.push_back({L4D_ENC_CODEBOOK_SIZE, 4});
    o.settings.push_back({L4D_ENC_PAGE_SIZE, 64});
    prepare_encoder(scene, o, encoder);
  }
};

TEST(WriterFaults, EveryCall) {
  const SmallEncode small;
  FaultyWriter whole;
  l4d_writer writer = whole.writer();
  ASSERT_EQ(l4d_encoder_encode(small.encoder.get(), &writer), L4D_OK);
  ASSERT_GT(whole.calls, 5);
  for (int k = 0; k < whole.calls; ++k) {
    FaultyWriter faulty{k, 0, {}};
    writer = faulty.writer();
    ASSERT_EQ(l4d_encoder_encode(small.encoder.get(), &writer), L4D_ERR_IO) << "write " << k;
    EXPECT_EQ(faulty.calls, k + 1) << "nothing is written after a failure";
    ASSERT_STRNE(l4d_last_error_message(), "");
    // What came before is a beginning of the file.
    ASSERT_LE(faulty.bytes.size(), whole.bytes.size());
    ASSERT_TRUE(std::equal(faulty.bytes.begin(), faulty.bytes.end(), whole.bytes.begin()));
  }
  FaultyWriter again;
  writer = again.writer();
  ASSERT_EQ(l4d_encoder_encode(small.encoder.get(), &writer), L4D_OK);
  EXPECT_EQ(again.bytes, whole.bytes);
}

TEST(Cancelling, EncoderAtEveryPoint) {
  const SmallEncode small;
  Stop count;
  ASSERT_EQ(l4d_encoder_set_progress(small.encoder.get(), &Stop::callback, &count), L4D_OK);
  const Bytes want = small.encoder.encode();
  EXPECT_TRUE(count.sane);
  ASSERT_GT(count.calls, 10);
  for (int k = 0; k < count.calls; ++k) {
    Stop stop{k};
    l4d_encoder_set_progress(small.encoder.get(), &Stop::callback, &stop);
    FaultyWriter out;
    const l4d_writer writer = out.writer();
    ASSERT_EQ(l4d_encoder_encode(small.encoder.get(), &writer), L4D_ERR_CANCELLED) << "point " << k;
    EXPECT_EQ(stop.calls, k + 1) << "one answer is enough";
    l4d_encode_report report = L4D_INIT(l4d_encode_report);
    // That of the last success stays.
    ASSERT_EQ(l4d_encoder_get_report(small.encoder.get(), &report), L4D_OK);
    EXPECT_EQ(report.file_bytes, want.size());
  }
  l4d_encoder_set_progress(small.encoder.get(), nullptr, nullptr);
  EXPECT_EQ(small.encoder.encode(), want);
}

}  // namespace
}  // namespace l4d

// SPDX-License-Identifier: Apache-2.0
// What the headers for C++ add to the C functions: errors, callbacks and lists.
#include <gtest/gtest.h>

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "l4d/l4d.hpp"
#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace l4d::test;

l4d_status status_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.status();
  }
  return L4D_OK;
}

TEST(Handles, AProgressFunctionMovesWithItsHandleAndCancels) {
  const TestScene scene = make_scene({});
  EncoderHandle first;
  uint64_t calls = 0, most = 0;
  first.set_progress([&](uint64_t done, uint64_t, const char*) {
    ++calls;
    most = std::max(most, done);
    return calls < 3;
  });
  EncoderHandle encoder = std::move(first);
  encoder.set_scene(scene.view(), scene.timeline);
  EXPECT_EQ(status_of([&] { encoder.encode(); }), L4D_ERR_CANCELLED);
  EXPECT_EQ(calls, 3u);
  encoder.set_progress([](uint64_t, uint64_t, const char*) -> bool { throw std::logic_error(""); });
  EXPECT_EQ(status_of([&] { encoder.encode(); }), L4D_ERR_CANCELLED);
  encoder.set_progress({});
  const size_t size = encoder.encode().size();
  EXPECT_EQ(size, encoder.report().file_bytes);
  EXPECT_EQ(encoder.order().size(), encoder.report().coded_gaussians);
  EXPECT_EQ(calls, 3u);
}

TEST(Handles, NamesAndParametersAreListed) {
  const std::vector<std::string> names = EncoderHandle::preset_names();
  ASSERT_FALSE(names.empty());
  EncoderHandle encoder;
  for (const std::string& name : names) encoder.set_preset(name);
  EXPECT_EQ(status_of([&] { encoder.set_preset("no such one"); }), L4D_ERR_INVALID_ARGUMENT);
  for (const l4d_parameter_info& info : EncoderHandle::parameters()) {
    if (info.max_values == 1 && info.per_component == 0) encoder.set(info.name, info.initial);
  }
  encoder.set(L4D_ENC_QUALITY, 40);
  EXPECT_EQ(encoder.value(L4D_ENC_QUALITY), 40);
}

TEST(Handles, AViolationCanEndInAnException) {
  Bytes bytes = dynamic_file();
  const l4d_reader whole = memory_reader(bytes);
  EXPECT_EQ(l4d::validate(whole, nullptr, [](const l4d_violation&) {}), 0u);
  bytes.back() ^= 1;
  const l4d_reader damaged = memory_reader(bytes);
  uint64_t told = 0;
  EXPECT_EQ(l4d::validate(damaged, nullptr, [&](const l4d_violation&) { ++told; }), told);
  EXPECT_GT(told, 0u);
  const auto stop = [](const l4d_violation& v) { throw std::runtime_error(v.clause); };
  EXPECT_THROW(l4d::validate(damaged, nullptr, stop), std::runtime_error);
}

TEST(Handles, ListsAreThoseOfTheFunctions) {
  const Bytes& file = dynamic_file();
  const l4d_reader reader = memory_reader(file);
  const MembersHandle members(reader);
  ASSERT_EQ(members.info().count, 1u);
  EXPECT_EQ(members.shown(0.5), std::vector<uint32_t>{0});
  EXPECT_TRUE(members.needs(0).empty());
  DecoderHandle decoder;
  decoder.open(members.reader(0));
  const l4d_query query = time_query(0.5);
  EXPECT_EQ(decoder.spans(query).size(), decoder.select(query).num_spans);
  EXPECT_TRUE(decoder.losses().empty());
  const l4d_shown_stream shown[] = {{decoder.get(), 0.5}};
  const ArrayView<const l4d_shown_stream> streams(shown, 1);
  EXPECT_TRUE(same_bits(slice_streams(streams, decoder.info().sh_degree), decoder.slice(0.5)));

  PlaybackHandle engine;
  EXPECT_EQ(status_of([&] { engine.decoder(0); }), L4D_ERR_NEED_DATA);
  engine.open(0, reader);
  engine.play(0);
  engine.set_rate(0, 2);
  engine.update(0);
  EXPECT_EQ(engine.buffered().size(), 1u);
  EXPECT_EQ(engine.shown(0, 0.1).size(), 1u);
  EXPECT_TRUE(engine.losses().empty());
  EXPECT_EQ(engine.slice(0.5).count(), decoder.slice(0.5).count());
  engine.close(0);
  EXPECT_EQ(engine.state().stream, uint32_t{L4D_STREAM_CLOSED});
}

}  // namespace
}  // namespace l4d

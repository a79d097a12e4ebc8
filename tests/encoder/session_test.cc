// SPDX-License-Identifier: Apache-2.0
// Sessions: what the members of a scene show at an instant is what the scene shows then.
#include "l4d/experimental/session.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <memory>

#include "l4d/attributes.hpp"
#include "l4d/experimental/inspect.h"
#include "libl4dcodec/scene/slice.h"
#include "libl4dcodec/scene/timeline.h"
#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;

struct Destroy {
  void operator()(l4d_members* m) const { l4d_members_destroy(m); }
  void operator()(l4d_session* s) const { l4d_session_destroy(s); }
};
using Members = std::unique_ptr<l4d_members, Destroy>;
using SessionHandle = std::unique_ptr<l4d_session, Destroy>;

int append(void* user, const void* src, size_t n) {
  const auto* bytes = static_cast<const unsigned char*>(src);
  auto& to = *static_cast<Bytes*>(user);
  to.insert(to.end(), bytes, bytes + n);
  return 0;
}

struct Recorded {
  Bytes bytes;
  std::vector<l4d_member> members;
};

l4d_session_options session_options(double segment) {
  l4d_session_options o = L4D_INIT(l4d_session_options);
  o.segment_seconds = segment;
  return o;
}

class Recorder {
 public:
  Recorder(const EncodeOptions& options, const TestScene& first, const l4d_session_options& session)
      : options_(options) {
    prepare_encoder(first, options_, encoder_);
    l4d_session* made = nullptr;
    encoder_.check(l4d_session_create(encoder_.get(), &session, &made));
    session_.reset(made);
  }

  l4d_status add(const TestScene& piece) {
    prepare_encoder(piece, options_, encoder_);
    const l4d_status status = l4d_session_add(session_.get());
    return status != L4D_OK ? status : encode();
  }
  l4d_status add_empty(const l4d_timeline& timeline, const l4d_placement* placement) {
    const l4d_status status = l4d_session_add_empty(session_.get(), &timeline, placement);
    return status != L4D_OK ? status : encode();
  }
  // All members of the piece.
  l4d_status encode() {
    l4d_writer writer = L4D_INIT(l4d_writer);
    writer.user = &out.bytes;
    writer.write = &append;
    for (;;) {
      l4d_member member = L4D_INIT(l4d_member);
      encoder_.check(l4d_session_encode(session_.get(), &writer, &member));
      if (member.bytes == 0) return L4D_OK;
      out.members.push_back(member);
    }
  }
  l4d_session* session() const { return session_.get(); }
  const EncoderHandle& encoder() const { return encoder_; }

  Recorded out;

 private:
  EncodeOptions options_;
  EncoderHandle encoder_;
  SessionHandle session_;
};

Recorded record(const TestScene& scene, const EncodeOptions& options, double segment) {
  l4d_session_options o = session_options(segment);
  o.has_end = 1;
  o.end = scene.timeline.time_begin + scene.duration();
  Recorder recorder(options, scene, o);
  EXPECT_EQ(recorder.add(scene), L4D_OK) << l4d_last_error_message();
  return recorder.out;
}

Members open(const Bytes& file) {
  const l4d_reader reader = memory_reader(file);
  l4d_members* out = nullptr;
  EXPECT_EQ(l4d_members_open(&reader, nullptr, &out), L4D_OK) << l4d_last_error_message();
  return Members(out);
}

struct Splat {
  float position[3];
  float opacity;
};
// By colours, which lossless streams keep as they are.
using Shown = std::map<std::array<float, 3>, Splat>;

void collect(const SplatArrays& s, float least, Shown* out) {
  for (size_t i = 0; i < s.count(); ++i) {
    if (s.opacity[i] < least) continue;
    const float* sh = s.sh.data() + i * (s.sh.size() / s.count());
    const bool added =
        out->insert(
               {{sh[0], sh[1], sh[2]},
                {{s.position[3 * i], s.position[3 * i + 1], s.position[3 * i + 2]}, s.opacity[i]}})
            .second;
    EXPECT_TRUE(added) << "a Gaussian is shown twice";
  }
}

// What the members that show a time show then, as a player has it.
Shown shown_by_members(const Bytes& file, const Members& members, double time, float least) {
  uint32_t indices[32];
  uint64_t count = 0;
  EXPECT_EQ(l4d_members_get_shown(members.get(), time, indices, 32, &count), L4D_OK);
  EXPECT_LE(count, 32u);
  Shown out;
  for (uint64_t k = 0; k < count; ++k) {
    l4d_member member = L4D_INIT(l4d_member);
    EXPECT_EQ(l4d_members_get(members.get(), indices[k], &member), L4D_OK);
    l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
    options.accept_needs = 1;
    DecoderHandle decoder(&options);
    decoder.open_memory(file.data() + member.offset, static_cast<size_t>(member.bytes));
    if (decoder.info().num_gaussians == 0) continue;
    collect(decoder.slice(time - member.shift), least, &out);
  }
  return out;
}

Shown shown_by_scene(const TestScene& scene, double time, float least) {
  EncodeOptions options;
  options.preset = "lossless";
  options.rans = true;
  const Bytes whole = encode(scene, options).bytes;
  DecoderHandle decoder;
  decoder.open_memory(whole.data(), whole.size());
  Shown out;
  collect(decoder.slice(time), least, &out);
  return out;
}

// Above the threshold by more than rounding.
constexpr float kSeen = 1.001f / 255;

void expect_same(const Shown& members, const Shown& scene, double time) {
  EXPECT_EQ(members.size(), scene.size()) << "at " << time;
  size_t missing = 0;
  for (const auto& [color, splat] : scene) {
    const auto it = members.find(color);
    if (it == members.end()) {
      ++missing;
      continue;
    }
    EXPECT_NEAR(it->second.opacity, splat.opacity, 1e-4f);
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(it->second.position[k], splat.position[k],
                  1e-4f * (1 + std::fabs(splat.position[k])));
    }
  }
  EXPECT_EQ(missing, 0u) << "at " << time;
}

EncodeOptions lossless() {
  EncodeOptions options;
  options.preset = "lossless";
  options.rans = true;
  return options;
}

TEST(Session, MembersShowWhatTheSceneShows) {
  for (const uint64_t seed : {uint64_t{1}, uint64_t{2}, uint64_t{3}}) {
    SceneOptions o;
    o.count = 3000;
    o.seed = seed;
    o.num_frames = 97 + static_cast<uint32_t>(seed) * 41;
    o.time_begin = seed == 2 ? -3.7 : 0;
    const TestScene scene = make_scene(o);
    const Recorded r = record(scene, lossless(), seed == 3 ? 0.31 : 0.5);
    const Members members = open(r.bytes);
    EXPECT_GT(r.members.size(), 4u);
    EXPECT_EQ(r.members[0].role, static_cast<uint32_t>(L4D_MEMBER_STANDING));
    for (const l4d_member& m : r.members) {
      if (m.role != L4D_MEMBER_MEDIA) continue;
      for (const double t :
           {m.begin, 0.6 * m.begin + 0.4 * m.end, std::nextafter(m.end, m.begin)}) {
        expect_same(shown_by_members(r.bytes, members, t, kSeen), shown_by_scene(scene, t, kSeen),
                    t);
      }
    }
  }
}

TEST(Session, WindowsAreCutAtBorders) {
  SceneOptions o;
  o.count = 1200;
  TestScene scene = make_scene(o);
  for (uint32_t i = 0; i < scene.count(); ++i) {
    const bool flat = i % 3 != 0;
    const uint32_t begin = i % 53;
    scene.window.push_back(flat ? begin : 0);
    scene.window.push_back(flat ? std::min(60u, begin + 1 + i % 31) : 0);
  }
  const Recorded r = record(scene, lossless(), 0.4);
  const Members members = open(r.bytes);
  for (uint32_t frame = 0; frame < 60; frame += 3) {
    const double t = (frame + 0.5) / 30;
    expect_same(shown_by_members(r.bytes, members, t, kSeen), shown_by_scene(scene, t, kSeen), t);
  }
}

// The Gaussians of a scene whose mean time is in the piece, or outside the scene on its side.
TestScene piece_of(const TestScene& scene, double begin, double end) {
  TestScene piece = scene;
  piece.flags |= L4D_POSITION_AT_MEAN_TIME;
  piece.timeline.time_begin = begin;
  piece.timeline.num_frames = static_cast<uint32_t>(std::lround((end - begin) * 30));
  std::vector<char> mask(scene.count());
  for (size_t i = 0; i < scene.count(); ++i) {
    const double t = std::clamp(static_cast<double>(scene.mean_t[i]), 0.0, scene.duration() - 1e-6);
    mask[i] = t >= begin && t < end;
  }
  keep_rows(mask, 3, &piece.position);
  keep_rows(mask, 1, &piece.mean_t);
  keep_rows(mask, 4, &piece.log_scale);
  keep_rows(mask, 8, &piece.rotor);
  keep_rows(mask, 1, &piece.opacity);
  keep_rows(mask, scene.sh_dim(), &piece.sh);
  return piece;
}

// Pieces hold what became known with them: together they are the scene.
void check_pieces(size_t count, double seconds, uint64_t gaussians, Recorded* out) {
  SceneOptions o;
  o.count = gaussians;
  o.num_frames = static_cast<uint32_t>(std::lround(30 * seconds * static_cast<double>(count)));
  const TestScene scene = make_scene(o);
  Recorder recorder(lossless(), scene, session_options(seconds));
  std::vector<TestScene> pieces;
  for (size_t k = 0; k < count; ++k) {
    const double begin = static_cast<double>(k) * seconds;
    pieces.push_back(piece_of(scene, begin, begin + seconds));
    ASSERT_EQ(recorder.add(pieces.back()), L4D_OK) << l4d_last_error_message();
  }
  *out = recorder.out;
  const Members members = open(out->bytes);
  for (size_t k = 0; k < count; k += count / 5) {
    for (const double part : {0.0, 0.4, 0.999}) {
      const double t = (static_cast<double>(k) + part) * seconds;
      Shown expected;
      for (size_t p = 0; p <= k; ++p) {
        TestScene whole = pieces[p];
        whole.timeline = scene.timeline;
        const Shown more = shown_by_scene(whole, t, kSeen);
        expected.insert(more.begin(), more.end());
      }
      expect_same(shown_by_members(out->bytes, members, t, kSeen), expected, t);
    }
  }
}

uint32_t count_role(const Recorded& r, uint32_t role) {
  return static_cast<uint32_t>(std::count_if(r.members.begin(), r.members.end(),
                                             [&](const l4d_member& m) { return m.role == role; }));
}

TEST(Session, PiecesShowWhatTheySayTogether) {
  Recorded r;
  check_pieces(5, 1, 3000, &r);
  EXPECT_EQ(count_role(r, L4D_MEMBER_MEDIA), 5u);
}

TEST(Session, MembersNeedFewOthersHoweverManyPiecesCome) {
  Recorded r;
  check_pieces(30, 0.5, 20000, &r);
  EXPECT_EQ(count_role(r, L4D_MEMBER_MEDIA), 30u);
  EXPECT_GT(count_role(r, L4D_MEMBER_STANDING), 8u);
  for (const l4d_member& m : r.members) EXPECT_LE(m.num_needs, 8u);
}

// The bytes that a refusal says are needed.
uint64_t needed_bytes() {
  const std::string message = l4d_last_error_message();
  const std::string before = "need ";
  const size_t at = message.find(before);
  EXPECT_NE(at, std::string::npos) << message;
  return at == std::string::npos ? 0 : std::stoull(message.substr(at + before.size()));
}

TEST(Session, RefusesAPieceThatItsMemoryDoesNotHold) {
  SceneOptions o;
  o.count = 2000;
  o.num_frames = 120;
  const TestScene scene = make_scene(o);
  const TestScene first = piece_of(scene, 0, 2), second = piece_of(scene, 2, 4);
  const auto with_limit = [](uint64_t bytes) {
    l4d_session_options s = session_options(1);
    s.max_memory_bytes = bytes;
    return s;
  };
  Recorder least(lossless(), first, with_limit(1));
  ASSERT_EQ(least.add(first), L4D_ERR_LIMIT_EXCEEDED);
  const uint64_t of_first = needed_bytes();
  EXPECT_GT(of_first, first.count() * (3 + 1 + 4 + 8 + 1 + scene.sh_dim()) * sizeof(float));
  Recorder below(lossless(), first, with_limit(of_first - 1));
  EXPECT_EQ(below.add(first), L4D_ERR_LIMIT_EXCEEDED);

  Recorder recorder(lossless(), first, with_limit(of_first));
  ASSERT_EQ(recorder.add(first), L4D_OK) << l4d_last_error_message();
  ASSERT_EQ(recorder.add(second), L4D_ERR_LIMIT_EXCEEDED);
  const uint64_t of_both = needed_bytes();
  EXPECT_GT(of_both, of_first);
  EXPECT_LE(of_both, of_first / first.count() * scene.count());
  // The refused piece changes nothing: what lives on is shown as if it had not come.
  ASSERT_EQ(recorder.add_empty(second.timeline, nullptr), L4D_OK) << l4d_last_error_message();
  Recorder other(lossless(), first, session_options(1));
  ASSERT_EQ(other.add(first), L4D_OK);
  ASSERT_EQ(other.add_empty(second.timeline, nullptr), L4D_OK);
  EXPECT_EQ(recorder.out.bytes, other.out.bytes);

  Recorder enough(lossless(), first, with_limit(of_both));
  ASSERT_EQ(enough.add(first), L4D_OK);
  EXPECT_EQ(enough.add(second), L4D_OK) << l4d_last_error_message();
}

// All Gaussians of a scene for a part of its time, as `cut` makes pieces: positions are of times of
// the piece, rounded.
TestScene whole_piece_of(const TestScene& scene, double begin, double end) {
  TestScene piece = scene;
  piece.timeline.time_begin = begin;
  piece.timeline.num_frames = static_cast<uint32_t>(std::lround((end - begin) * 30));
  if ((scene.flags & L4D_POSITION_AT_MEAN_TIME) != 0) return piece;
  for (size_t i = 0; i < scene.count(); ++i) {
    const double mean = static_cast<double>(scene.mean_t[i]);
    const double moved =
        reference_time(piece.timeline, mean) - reference_time(scene.timeline, mean);
    const Slice4D<double> slice =
        slice_attributes<double>(scene.rotor.data() + 8 * i, scene.log_scale.data() + 4 * i);
    for (size_t k = 0; k < 3; ++k) {
      float& x = piece.position[3 * i + k];
      x = static_cast<float>(static_cast<double>(x) + slice.velocity[k] * moved);
    }
  }
  return piece;
}

// What lives across borders is coded once, also where each piece has it again.
TEST(Session, PiecesMayRepeatWhatLivesOn) {
  for (const uint32_t flags : {0U, static_cast<uint32_t>(L4D_POSITION_AT_MEAN_TIME)}) {
    SceneOptions o;
    o.count = 3000;
    o.num_frames = 180;
    TestScene scene = make_scene(o);
    scene.flags |= flags;
    const Recorded whole = record(scene, lossless(), 1);
    Recorder recorder(lossless(), scene, session_options(1));
    for (int k = 0; k < 6; ++k) {
      ASSERT_EQ(recorder.add(whole_piece_of(scene, k, k + 1)), L4D_OK);
    }
    const Recorded& r = recorder.out;
    EXPECT_EQ(count_role(r, L4D_MEMBER_STANDING), 1u);
    EXPECT_LT(r.bytes.size(), whole.bytes.size() * 11 / 10);
    const Members members = open(r.bytes);
    for (double t = 0; t < 6; t += 0.45) {
      expect_same(shown_by_members(r.bytes, members, t, kSeen), shown_by_scene(scene, t, kSeen), t);
    }
  }
}

// As many as the fullest of the pieces has: one that is there twice is shown twice.
TEST(Session, EqualGaussiansOfAPieceStay) {
  SceneOptions o;
  o.count = 300;
  o.permanent = 1;
  o.outside = 0;
  const TestScene scene = make_scene(o);
  TestScene twice = scene;
  twice.timeline.time_begin += scene.duration();
  const auto repeat = [](std::vector<float>* v) {
    const std::vector<float> once = *v;
    v->insert(v->end(), once.begin(), once.end());
  };
  for (std::vector<float>* v : {&twice.position, &twice.mean_t, &twice.log_scale, &twice.rotor,
                                &twice.opacity, &twice.sh}) {
    repeat(v);
  }
  Recorder recorder(lossless(), scene, session_options(1));
  ASSERT_EQ(recorder.add(scene), L4D_OK);
  ASSERT_EQ(recorder.add(twice), L4D_OK);
  uint64_t standing = 0;
  for (const l4d_member& m : recorder.out.members) {
    if (m.role != L4D_MEMBER_STANDING) continue;
    l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
    DecoderHandle decoder(&options);
    decoder.open_memory(recorder.out.bytes.data() + m.offset, static_cast<size_t>(m.bytes));
    standing += decoder.info().num_gaussians;
  }
  EXPECT_EQ(standing, 600u);
}

// The largest error of an opacity that a member states.
double stated_opacity_error(const Recorded& r, const l4d_member& member) {
  DecoderHandle decoder;
  decoder.open_memory(r.bytes.data() + member.offset, static_cast<size_t>(member.bytes));
  l4d_coding_errors errors = L4D_INIT(l4d_coding_errors);
  decoder.check(l4d_decoder_get_coding_errors(decoder.get(), &errors));
  return errors.opacity;
}

// Opacities of a piece may be fitted; what its members state is about the scene.
TEST(Session, StatesErrorsOfFittedOpacitiesAgainstTheScene) {
  SceneOptions o;
  o.count = 60;
  o.outside = 0;
  TestScene scene = make_scene(o);
  scene.flags &= ~static_cast<uint32_t>(L4D_OPACITY_LOGIT);
  for (float& opacity : scene.opacity) opacity = 0.8f;
  TestScene next = scene;
  next.timeline.time_begin += scene.duration();
  for (float& t : next.mean_t) t += static_cast<float>(scene.duration());
  const std::vector<float> fitted(scene.opacity.size(), 0.3f);
  Recorder recorder(EncodeOptions(), scene, session_options(scene.duration()));
  ASSERT_EQ(recorder.add(scene), L4D_OK);
  const size_t before = recorder.out.members.size();
  prepare_encoder(next, EncodeOptions(), recorder.encoder());
  recorder.encoder().check(l4d_encoder_set_fitted_opacity(recorder.encoder().get(), fitted.data()));
  ASSERT_EQ(l4d_session_add(recorder.session()), L4D_OK) << l4d_last_error_message();
  ASSERT_EQ(recorder.encode(), L4D_OK);
  const Recorded& r = recorder.out;
  double first = 0, second = 0;
  for (size_t m = 0; m < r.members.size(); ++m) {
    double& worst = m < before ? first : second;
    worst = std::max(worst, stated_opacity_error(r, r.members[m]));
  }
  EXPECT_LT(first, 0.1);
  EXPECT_NEAR(second, 0.5, 0.05);
}

// A member in which nothing of its own is visible has no Gaussians, and shows what it needs.
TEST(Session, MembersMayHaveNothingOfTheirOwn) {
  SceneOptions o;
  o.count = 600;
  o.permanent = 1;
  o.outside = 0;
  const TestScene scene = make_scene(o);
  const Recorded r = record(scene, lossless(), 0.5);
  ASSERT_EQ(r.members.size(), 5u);
  for (size_t k = 1; k < 5; ++k) {
    EXPECT_LT(r.members[k].bytes, 500u);
    EXPECT_EQ(r.members[k].num_needs, 1u);
    const Bytes one(
        r.bytes.begin() + static_cast<std::ptrdiff_t>(r.members[k].offset),
        r.bytes.begin() + static_cast<std::ptrdiff_t>(r.members[k].offset + r.members[k].bytes));
    EXPECT_TRUE(validate(one).empty());
  }
  const Members members = open(r.bytes);
  EXPECT_EQ(shown_by_members(r.bytes, members, 1.2, kSeen).size(), 600u);
}

TEST(Session, MembersAreWhatTheirHeadersSay) {
  SceneOptions o;
  o.time_begin = 1.7e9;
  const TestScene scene = make_scene(o);
  EncodeOptions options;
  options.preset = "default";
  options.rans = true;
  const Recorded r = record(scene, options, 0.4);
  const Members members = open(r.bytes);
  l4d_members_info info = L4D_INIT(l4d_members_info);
  ASSERT_EQ(l4d_members_get_info(members.get(), &info), L4D_OK);
  EXPECT_EQ(info.rest, L4D_OK);
  EXPECT_NE(info.stream, 0u);
  ASSERT_EQ(info.count, r.members.size());
  for (uint64_t i = 0; i < info.count; ++i) {
    l4d_member m = L4D_INIT(l4d_member);
    ASSERT_EQ(l4d_members_get(members.get(), i, &m), L4D_OK);
    const l4d_member& w = r.members[i];
    EXPECT_EQ(m.offset, w.offset);
    EXPECT_EQ(m.bytes, w.bytes);
    EXPECT_EQ(m.header_hash, w.header_hash);
    EXPECT_EQ(m.begin, w.begin);
    EXPECT_EQ(m.end, w.end);
    EXPECT_EQ(m.number, w.number);
    EXPECT_EQ(m.role, w.role);
    EXPECT_EQ(m.num_needs, w.num_needs);
  }
  EXPECT_TRUE(
      std::equal(r.bytes.begin(), r.bytes.end(), record(scene, options, 0.4).bytes.begin()));
}

// spec: MEMB-11
TEST(Session, MembersWithoutGaussiansAreOfTheSameScene) {
  for (const EncodeOptions& options : {lossless(), EncodeOptions()}) {
    const TestScene scene = make_scene(SceneOptions());
    const l4d_placement placement = {
        {1, 2, 3}, 0.5, L4D_COORDINATES_RIGHT_UP_BACK, L4D_COLOR_LINEAR_SRGB};
    Recorder recorder(options, scene, session_options(1));
    const l4d_gaussians view = scene.view();
    recorder.encoder().check(
        l4d_encoder_set_scene(recorder.encoder().get(), &view, &scene.timeline, &placement));
    ASSERT_EQ(l4d_session_add(recorder.session()), L4D_OK);
    ASSERT_EQ(recorder.encode(), L4D_OK);
    const size_t before = recorder.out.members.size();
    l4d_timeline later = scene.timeline;
    later.time_begin += 50 * scene.duration();
    EXPECT_EQ(recorder.add_empty(later, nullptr), L4D_ERR_INVALID_ARGUMENT) << "another placement";
    ASSERT_EQ(recorder.add_empty(later, &placement), L4D_OK);
    ASSERT_GT(recorder.out.members.size(), before);
    l4d_decoder_options shows = decoder_options(L4D_BACKEND_AUTO, 1);
    shows.accept_needs = 1;
    DecoderHandle first(&shows), empty(&shows);
    const l4d_member& last = recorder.out.members.back();
    EXPECT_EQ(last.begin, later.time_begin + scene.duration() - (last.end - last.begin));
    first.open_memory(recorder.out.bytes.data() + recorder.out.members.front().offset,
                      static_cast<size_t>(recorder.out.members.front().bytes));
    empty.open_memory(recorder.out.bytes.data() + last.offset, static_cast<size_t>(last.bytes));
    const l4d_info a = first.info(), b = empty.info();
    EXPECT_EQ(b.num_gaussians, 0u);
    EXPECT_EQ(std::memcmp(&a.placement, &b.placement, sizeof a.placement), 0);
    EXPECT_EQ(a.sh_degree, b.sh_degree);
    EXPECT_EQ(a.profile, b.profile);
    EXPECT_EQ(b.level, 1u);
    l4d_members_info info = L4D_INIT(l4d_members_info);
    const Members members = open(recorder.out.bytes);
    ASSERT_EQ(l4d_members_get_info(members.get(), &info), L4D_OK);
    EXPECT_EQ(info.rest, L4D_OK) << info.rest_message;
    EXPECT_EQ(info.count, recorder.out.members.size());
  }
}

TEST(Session, RefusesWhatDoesNotFollow) {
  const TestScene scene = make_scene(SceneOptions());
  l4d_session* out = nullptr;
  EncoderHandle encoder;
  l4d_session_options bad = session_options(-1);
  EXPECT_EQ(l4d_session_create(encoder.get(), &bad, &out), L4D_ERR_INVALID_ARGUMENT);
  bad = session_options(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(l4d_session_create(encoder.get(), &bad, &out), L4D_ERR_INVALID_ARGUMENT);
  bad = session_options(2);
  bad.has_end = 1;
  bad.end = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(l4d_session_create(encoder.get(), &bad, &out), L4D_ERR_INVALID_ARGUMENT);
  ASSERT_EQ(l4d_session_create(encoder.get(), nullptr, &out), L4D_OK);
  EXPECT_EQ(l4d_session_add(out), L4D_ERR_INVALID_STATE);
  l4d_session_destroy(out);

  Recorder recorder(lossless(), scene, session_options(1));
  ASSERT_EQ(recorder.add(scene), L4D_OK);
  EXPECT_EQ(recorder.add(scene), L4D_ERR_INVALID_ARGUMENT) << "it begins before the end";
  SceneOptions later;
  later.time_begin = 2;
  later.sh_degree = 2;
  EXPECT_EQ(recorder.add(make_scene(later)), L4D_ERR_INVALID_ARGUMENT) << "another SH degree";
  later.sh_degree = SceneOptions().sh_degree;
  const TestScene after = make_scene(later);
  const l4d_gaussians view = after.view();
  recorder.encoder().check(
      l4d_encoder_set_scene(recorder.encoder().get(), &view, &after.timeline, nullptr));
  l4d_importance importance = L4D_INIT(l4d_importance);
  importance.metric = L4D_SENSITIVITY_GAUSS_NEWTON;
  recorder.encoder().check(l4d_encoder_set_importance(recorder.encoder().get(), &importance));
  EXPECT_EQ(l4d_session_add(recorder.session()), L4D_ERR_INVALID_ARGUMENT) << "another metric";
  EXPECT_NE(std::string(l4d_last_error_message()).find("metric"), std::string::npos);
  later.sh_degree = 1;
  ASSERT_EQ(recorder.add(make_scene(later)), L4D_OK);
  later.time_begin = 4;
  const TestScene last = make_scene(later);
  prepare_encoder(last, lossless(), recorder.encoder());
  ASSERT_EQ(l4d_session_add(recorder.session()), L4D_OK);
  EXPECT_EQ(l4d_session_add(recorder.session()), L4D_ERR_INVALID_STATE) << "not coded yet";
}

}  // namespace
}  // namespace l4d

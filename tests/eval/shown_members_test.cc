// SPDX-License-Identifier: Apache-2.0
// What an instant of a file of several streams shows: the media member with those that it needs.
#include "eval/scene/shown_members.h"

#include <gtest/gtest.h>

#include <cstring>

#include "eval/views/rendered_scene.h"
#include "eval/views/views.h"
#include "io/synth/synth.h"
#include "l4d/experimental/copy.h"
#include "l4d/l4d.hpp"

namespace l4d::eval {
namespace {

using Bytes = std::vector<unsigned char>;

l4d_reader reader_of(const Bytes& bytes) {
  l4d_reader reader = L4D_INIT(l4d_reader);
  reader.user = const_cast<Bytes*>(&bytes);
  reader.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
    const auto& from = *static_cast<const Bytes*>(user);
    if (offset > from.size()) return -1;
    const size_t got = std::min<size_t>(n, from.size() - static_cast<size_t>(offset));
    std::memcpy(dst, from.data() + offset, got);
    return static_cast<int64_t>(got);
  };
  reader.size = [](void* user) {
    return static_cast<int64_t>(static_cast<const Bytes*>(user)->size());
  };
  return reader;
}

Bytes encode(const io::Scene& scene) {
  const EncoderHandle encoder;
  encoder.check(l4d_encoder_set_preset(encoder.get(), "lossless"));
  const l4d_gaussians view = scene.view();
  encoder.check(l4d_encoder_set_scene(encoder.get(), &view, &scene.timeline, &scene.placement));
  return encoder.encode();
}

void append(const Bytes& stream, uint32_t number, uint32_t role, double shift,
            const std::vector<uint32_t>& needs, Bytes* file) {
  l4d_member_parameters p = L4D_INIT(l4d_member_parameters);
  p.is_member = 1;
  p.number = number;
  p.role = role;
  p.shift = shift;
  p.needs = needs.data();
  p.num_needs = static_cast<uint32_t>(needs.size());
  l4d_writer writer = L4D_INIT(l4d_writer);
  writer.user = file;
  writer.write = [](void* user, const void* src, size_t n) {
    const auto* bytes = static_cast<const unsigned char*>(src);
    auto& to = *static_cast<Bytes*>(user);
    to.insert(to.end(), bytes, bytes + n);
    return 0;
  };
  const l4d_reader reader = reader_of(stream);
  ASSERT_EQ(l4d_copy_member(&reader, nullptr, &p, &writer, nullptr), L4D_OK)
      << l4d_last_error_message();
}

io::Scene synthesize(uint32_t gaussians, uint32_t seed) {
  io::SynthOptions options;
  options.gaussians = gaussians;
  options.seconds = 1;
  options.seed = seed;
  return io::synthesize(options);
}

// One scene that is always there, 2 s before it is shown; one that needs it; one that does not.
struct Setting {
  Bytes standing = encode(synthesize(500, 1)), media = encode(synthesize(400, 2)), file;

  Setting() {
    append(standing, 0, L4D_MEMBER_STANDING, 2, {}, &file);
    append(media, 1, L4D_MEMBER_MEDIA, 2, {0}, &file);
    append(media, 2, L4D_MEMBER_MEDIA, 3, {}, &file);
  }
};

SplatArrays slice(const Bytes& stream, double time) {
  DecoderHandle decoder;
  decoder.open_memory(stream.data(), stream.size());
  return decoder.slice(time);
}

TEST(ShownMembers, SliceToTheUnionOfWhatTheyNeed) {
  const Setting s;
  l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
  const l4d_reader reader = reader_of(s.file);
  ShownMembers members(reader, options);
  EXPECT_EQ(members.timeline().time_begin, 2);
  EXPECT_EQ(io::duration(members.timeline()), 2);
  EXPECT_EQ(members.num_gaussians(), 1300u);
  const SplatArrays both = members.slice(2.25);
  SplatArrays expected = slice(s.media, 0.25);
  const SplatArrays more = slice(s.standing, 0.25);
  const size_t own = expected.count();
  ASSERT_GT(own, 100u);
  ASSERT_GT(more.count(), 100u);
  ASSERT_EQ(both.count(), own + more.count());
  EXPECT_TRUE(
      std::equal(expected.position.begin(), expected.position.end(), both.position.begin()));
  EXPECT_TRUE(std::equal(more.position.begin(), more.position.end(),
                         both.position.begin() + static_cast<std::ptrdiff_t>(3 * own)));
  EXPECT_TRUE(std::equal(more.sh.rbegin(), more.sh.rend(), both.sh.rbegin()));
  EXPECT_TRUE(
      std::equal(more.covariance.rbegin(), more.covariance.rend(), both.covariance.rbegin()));
  EXPECT_TRUE(std::equal(more.opacity.rbegin(), more.opacity.rend(), both.opacity.rbegin()));
  // The other member needs nothing; before and after all spans the nearest is shown.
  EXPECT_EQ(members.slice(3.25).position, expected.position);
  EXPECT_EQ(members.slice(-7).count(), slice(s.media, 0).count() + slice(s.standing, 0).count());
  EXPECT_EQ(members.slice(9).position, slice(s.media, 1).position);
}

// Gaussians of all members are one scene: they are sorted together.
TEST(ShownMembers, RenderAsOneScene) {
  const Setting s;
  io::Scene all = synthesize(400, 2);
  const io::Scene more = synthesize(500, 1);
  const auto add = [](const std::vector<float>& from, std::vector<float>* to) {
    to->insert(to->end(), from.begin(), from.end());
  };
  add(more.position, &all.position);
  add(more.log_scale, &all.log_scale);
  add(more.rotor, &all.rotor);
  add(more.mean_t, &all.mean_t);
  add(more.opacity, &all.opacity);
  add(more.sh, &all.sh);
  const Bytes together = encode(all);
  l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
  const l4d_reader reader = reader_of(s.file);
  RenderedScene one({}, StreamBytes{together.data(), together.size()}, "one");
  RenderedScene several({}, StreamMembers{nullptr, std::make_shared<ShownMembers>(reader, options)},
                        "several");
  RenderedScene alone({}, StreamBytes{s.media.data(), s.media.size()}, "alone");
  const io::CameraSet cameras = io::orbit_cameras(one.instant(0.5), 3, 64, 48);
  for (const double time : {0.1, 0.5, 0.9}) {
    for (const io::Camera& camera : cameras.cameras) {
      io::Image expected, image, media, later;
      one.set_time(time);
      one.render(camera.camera, &expected);
      several.set_time(2 + time);
      several.render(camera.camera, &image);
      double worst = 0, differs = 0;
      alone.set_time(time);
      alone.render(camera.camera, &media);
      for (size_t i = 0; i < image.rgb.size(); ++i) {
        worst = std::max(worst, std::fabs(double{image.rgb[i]} - double{expected.rgb[i]}));
        differs = std::max(differs, std::fabs(double{media.rgb[i]} - double{expected.rgb[i]}));
      }
      EXPECT_LT(worst, 1e-4);
      EXPECT_GT(differs, 0.05);
      several.set_time(3 + time);
      several.render(camera.camera, &later);
      EXPECT_EQ(later.rgb, media.rgb);
    }
  }
}

}  // namespace
}  // namespace l4d::eval

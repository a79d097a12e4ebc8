// SPDX-License-Identifier: Apache-2.0
// What it costs to cut a scene into members (experimental/session.h): bytes, and fidelity over
// instants at the borders and in the middle of each member, of the basketball scene and of a
// synthetic one of a minute. Prints Markdown. tables_members [basketball | synth] [QUALITY]
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <memory>
#include <string>

#include "bench/tables/common.h"
#include "eval/scene/decoded_scene.h"
#include "io/camera/cameras.h"
#include "io/synth/synth.h"
#include "l4d/experimental/session.h"
#include "l4d/render.hpp"
#include "libl4dcodec/scene/attributes.h"

namespace {

using namespace l4d;
using namespace l4d::bench;

using Bytes = std::vector<unsigned char>;
using Images = std::vector<std::vector<float>>;

constexpr size_t kSpans = 12;  // that are looked at, of those there are

struct Piece {
  l4d_member member{};
  std::vector<uint32_t> needs;
};

struct Recorded {
  Bytes bytes;
  std::vector<Piece> pieces;

  const Piece& numbered(uint32_t number) const {
    return *std::find_if(pieces.begin(), pieces.end(),
                         [&](const Piece& p) { return p.member.number == number; });
  }
};

int append(void* user, const void* src, size_t n) {
  const auto* bytes = static_cast<const unsigned char*>(src);
  auto& to = *static_cast<Bytes*>(user);
  to.insert(to.end(), bytes, bytes + n);
  return 0;
}

l4d_reader reader_of(const Bytes& bytes) {
  l4d_reader reader = L4D_INIT(l4d_reader);
  reader.user = const_cast<Bytes*>(&bytes);
  reader.size = [](void* user) { return static_cast<int64_t>(static_cast<Bytes*>(user)->size()); };
  reader.read_at = [](void* user, void* dst, size_t n, uint64_t at) {
    const Bytes& from = *static_cast<Bytes*>(user);
    const size_t begin = static_cast<size_t>(std::min<uint64_t>(at, from.size()));
    const size_t count = std::min(n, from.size() - begin);
    std::copy_n(from.data() + begin, count, static_cast<unsigned char*>(dst));
    return static_cast<int64_t>(count);
  };
  return reader;
}

Recorded record(const EncoderHandle& encoder, const l4d_timeline& timeline, double segment) {
  Recorded out;
  l4d_session_options options = L4D_INIT(l4d_session_options);
  options.segment_seconds = segment;
  options.has_end = 1;
  options.end = timeline.time_begin + io::duration(timeline);
  l4d_session* session = nullptr;
  encoder.check(l4d_session_create(encoder.get(), &options, &session));
  const std::unique_ptr<l4d_session, void (*)(l4d_session*)> owner(session, &l4d_session_destroy);
  encoder.check(l4d_session_add(session));
  l4d_writer writer = L4D_INIT(l4d_writer);
  writer.user = &out.bytes;
  writer.write = &append;
  for (;;) {
    l4d_member member = L4D_INIT(l4d_member);
    encoder.check(l4d_session_encode(session, &writer, &member));
    if (member.bytes == 0) break;
  }
  const l4d_reader reader = reader_of(out.bytes);
  const MembersHandle list(reader);
  for (uint64_t i = 0; i < list.info().count; ++i) {
    out.pieces.push_back({list.member(i), list.needs(i)});
  }
  return out;
}

eval::DecodedScene decode(const Bytes& bytes, const l4d_member& member) {
  l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
  options.accept_needs = 1;
  DecoderHandle decoder(&options);
  decoder.open_memory(bytes.data() + member.offset, static_cast<size_t>(member.bytes));
  return eval::decode_scene(decoder);
}

// Appends Gaussians of another stream, with positions at the reference times of `timeline`.
void add(eval::DecodedScene from, const l4d_timeline& timeline, AttributeArrays* to) {
  eval::present(timeline.time_begin, timeline.time_begin + io::duration(timeline), 0, &from);
  for_each_attribute(
      [](const AttributeInfo&, std::vector<float>& out, const std::vector<float>& in) {
        out.insert(out.end(), in.begin(), in.end());
      },
      *to, from.scene);
}

struct Error {
  double sum = 0, count = 0;
  void add(const Images& a, const Images& b) {
    for (size_t k = 0; k < a.size(); ++k) {
      for (size_t i = 0; i < a[k].size(); ++i) {
        const double d = static_cast<double>(a[k][i]) - static_cast<double>(b[k][i]);
        sum += d * d;
      }
      count += static_cast<double>(a[k].size());
    }
  }
  void add(const Error& more) {
    sum += more.sum;
    count += more.count;
  }
  double decibels() const { return -10 * std::log10(std::max(sum / count, 1e-10)); }
};

class Bench {
 public:
  Bench(WeightedScene scene, std::vector<l4d_camera> cameras, double quality)
      : scene_(std::move(scene)), cameras_(std::move(cameras)) {
    sh_ = sh_weights(scene_);
    encoder_ = std::make_unique<EncoderHandle>(make_encoder(scene_, sh_, "default"));
    if (quality > 0) {
      encoder_->check(l4d_encoder_set(encoder_->get(), L4D_ENC_QUALITY, quality));
    }
    original_.set_gaussians(scene_.scene.view(), scene_.scene.timeline);
    const Bytes whole = encoder_->encode();
    whole_bytes_ = static_cast<double>(whole.size());
    l4d_member all{};
    all.bytes = whole.size();
    decoded_ = decode(whole, all);
    whole_.set_gaussians(decoded_.scene.view(), decoded_.scene.timeline);
  }

  void print(const char* name, double segment) {
    const double begin = seconds_now();
    const Recorded r = record(*encoder_, scene_.scene.timeline, segment);
    const double seconds = seconds_now() - begin;
    std::map<uint32_t, eval::DecodedScene> standing;
    std::vector<const Piece*> media;
    uint64_t standing_bytes = 0;
    for (const Piece& p : r.pieces) {
      if (p.member.role == L4D_MEMBER_MEDIA) {
        media.push_back(&p);
      } else {
        standing.emplace(p.member.number, decode(r.bytes, p.member));
        standing_bytes += p.member.bytes;
      }
    }
    Error all, all_whole;
    double worst = HUGE_VAL, largest_change = 0, whole_worst = HUGE_VAL, before = 0, end = 0;
    for (size_t k = 0; k < std::min(kSpans, media.size()); ++k) {
      // Spans in pairs, for the borders between them.
      const size_t pair = media.size() <= kSpans ? k : k / 2 * 2 * media.size() / kSpans + k % 2;
      const Piece& p = *media[std::min(pair, media.size() - 1)];
      const eval::DecodedScene own = decode(r.bytes, p.member);
      const l4d_timeline& timeline = own.scene.timeline;
      AttributeArrays shown;
      shown.sh_degree = scene_.scene.sh_degree;
      add(own, timeline, &shown);
      for (const uint32_t number : p.needs) add(standing.at(number), timeline, &shown);
      RendererHandle renderer;
      renderer.set_gaussians(shown.view(), timeline);
      Error member, member_whole;
      double first = 0, last = 0;
      const double times[] = {p.member.begin, 0.5 * (p.member.begin + p.member.end),
                              std::nextafter(p.member.end, p.member.begin)};
      for (const double t : times) {
        Error here, here_whole;
        const Images truth = render(original_, t);
        here.add(truth, render(renderer, t));
        here_whole.add(truth, render(whole_, t));
        if (t == times[0]) first = here.decibels();
        last = here.decibels();
        member.add(here);
        member_whole.add(here_whole);
      }
      if (k > 0 && p.member.begin == end) {
        largest_change = std::max(largest_change, std::fabs(first - before));
      }
      before = last;
      end = p.member.end;
      worst = std::min(worst, member.decibels() - member_whole.decibels());
      whole_worst = std::min(whole_worst, member.decibels());
      all.add(member);
      all_whole.add(member_whole);
    }
    std::printf(
        "| %s | %g | %.1f | %.3f | %.1f | %.1f | %.2f | %.2f | %.2f | %+.2f | %.2f | %.1f |\n",
        name, segment, static_cast<double>(r.bytes.size()) / 1e3,
        static_cast<double>(r.bytes.size()) / whole_bytes_,
        static_cast<double>(standing_bytes) / 1e3,
        static_cast<double>(r.bytes.size() - standing_bytes) / 1e3 /
            static_cast<double>(media.size()),
        all_whole.decibels(), all.decibels(), whole_worst, worst, largest_change, seconds);
    std::fflush(stdout);
  }

 private:
  Images render(RendererHandle& renderer, double time) {
    Images out;
    renderer.set_time(time);
    for (const l4d_camera& camera : cameras_) out.push_back(renderer.render(camera));
    return out;
  }

  WeightedScene scene_;
  std::vector<float> sh_;
  std::vector<l4d_camera> cameras_;
  std::unique_ptr<EncoderHandle> encoder_;
  eval::DecodedScene decoded_;
  RendererHandle original_, whole_;
  double whole_bytes_ = 0;
};

// Pixels of half the size.
l4d_camera half(l4d_camera c) {
  c.width /= 2;
  c.height /= 2;
  c.fx /= 2;
  c.fy /= 2;
  c.cx /= 2;
  c.cy /= 2;
  return c;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string which = argc > 1 ? argv[1] : "";
  const double quality = argc > 2 ? std::atof(argv[2]) : 0;
  std::puts(
      "| scene | member s | kB | of whole | standing kB | a media member kB | whole dB | members "
      "dB "
      "| worst member dB | worst against whole | change across a border dB | encode s "
      "|\n|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|");
  if (which != "synth" && !data_dir().empty()) {
    const io::CameraSet set = io::read_cameras(data_dir() + "/basketball/cameras.json");
    std::vector<l4d_camera> cameras;
    for (size_t k = 0; k < set.cameras.size(); k += 7)
      cameras.push_back(half(set.cameras[k].camera));
    Bench bench(load_basketball(), cameras, quality);
    for (const double s : {1.0, 2.0, 5.0}) bench.print("basketball", s);
  }
  if (which != "basketball") {
    io::SynthOptions options;
    options.seconds = 60;
    options.gaussians = 150000;
    WeightedScene scene{io::synthesize(options), {}};
    std::vector<l4d_camera> cameras;
    for (const io::Camera& c : io::orbit_cameras(scene.scene, 4, 480, 360).cameras) {
      cameras.push_back(c.camera);
    }
    Bench bench(std::move(scene), cameras, quality);
    for (const double s : {1.0, 2.0, 5.0, 10.0}) bench.print("synth, 60 s", s);
  }
}

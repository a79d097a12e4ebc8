// SPDX-License-Identifier: Apache-2.0
#include "eval/views/views.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "eval/scene/motion.h"
#include "io/camera/first_view.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d::eval {

std::vector<l4d_camera> CameraViews::pinholes() const {
  std::vector<l4d_camera> out;
  for (const io::Camera& camera : set.cameras) out.push_back(camera.camera);
  return out;
}

std::vector<l4d_view> CameraViews::numbered() const {
  std::vector<l4d_view> out;
  for (const io::View& view : views) {
    out.push_back({view.time, static_cast<uint32_t>(view.camera), 0});
  }
  return out;
}

CameraViews spread_views(CameraViews all, size_t most) {
  std::vector<io::View>& views = all.views;
  if (views.size() <= most) return all;
  // By camera, so that even steps do not meet the same cameras again and again.
  const auto by_camera = [](const io::View& x, const io::View& y) {
    return x.camera != y.camera ? x.camera < y.camera : x.time < y.time;
  };
  std::stable_sort(views.begin(), views.end(), by_camera);
  std::vector<io::View> chosen;
  for (size_t k = 0; k < most; ++k) {
    chosen.push_back(views[(2 * k + 1) * views.size() / (2 * most)]);
  }
  // Cameras of an instant share the scene as it is then.
  std::stable_sort(chosen.begin(), chosen.end(),
                   [](const io::View& x, const io::View& y) { return x.time < y.time; });
  views = std::move(chosen);
  return all;
}

CameraViews short_videos(CameraViews all, size_t cameras, size_t frames) {
  std::map<size_t, std::vector<io::View>> by_camera;
  for (const io::View& view : all.views) by_camera[view.camera].push_back(view);
  const size_t most = std::min(cameras, by_camera.size());
  all.views.clear();
  size_t k = 0, chosen = 0;
  for (auto& [camera, views] : by_camera) {
    if ((2 * chosen + 1) * by_camera.size() / (2 * most) != k++) continue;
    ++chosen;
    std::stable_sort(views.begin(), views.end(),
                     [](const io::View& x, const io::View& y) { return x.time < y.time; });
    const size_t count = std::min(frames, views.size());
    const auto first = views.begin() + static_cast<std::ptrdiff_t>((views.size() - count) / 2);
    all.views.insert(all.views.end(), first, first + static_cast<std::ptrdiff_t>(count));
  }
  return all;
}

namespace {

// Views of the check in parts of those of the fit, and how many of them share a few instants.
constexpr double kCheckShare = 1, kSeenShare = 0.75;
constexpr double kRounding = 1e-6;  // of sums that are whole numbers

}  // namespace

size_t golden_stride(size_t n) {
  size_t stride = std::max<size_t>(1, n * 5 / 8);
  while (std::gcd(stride, n) != 1) ++stride;
  return stride;
}

DealtViews deal_views(const CameraViews& all, size_t most) {
  std::vector<std::vector<io::View>> instants;
  std::vector<io::View> views = all.views;
  std::stable_sort(views.begin(), views.end(),
                   [](const io::View& x, const io::View& y) { return x.time < y.time; });
  for (const io::View& view : views) {
    if (instants.empty() || instants.back().front().time != view.time) instants.emplace_back();
    instants.back().push_back(view);
  }
  const double num_instants = static_cast<double>(instants.size());
  const double num_fit = static_cast<double>(most) / std::max(1.0, num_instants);
  // Instants that are checked as most cameras see them.
  const double num_seen = static_cast<double>(most) * kCheckShare * kSeenShare;
  const auto num_whole = static_cast<size_t>(
      std::clamp(num_seen * num_instants / static_cast<double>(views.size()), 1.0, num_instants));
  DealtViews dealt{{all.set, {}}, {all.set, {}}};
  double fit_due = 0, check_due = 0;
  for (size_t k = 0; k < instants.size(); ++k) {
    const std::vector<io::View>& of = instants[k];
    const double size = static_cast<double>(of.size());
    // What one view shows serves the fit or the check.
    const double most_share = size / (1 + kCheckShare);
    const double share = std::clamp(num_fit, std::min(1.0, most_share), most_share);
    fit_due += share;
    check_due += share * kCheckShare * (1 - kSeenShare);
    const auto fit = std::min(static_cast<size_t>(fit_due + kRounding), of.size());
    fit_due -= static_cast<double>(fit);
    const bool is_whole = (k + 1) * num_whole / instants.size() != k * num_whole / instants.size();
    const size_t check = std::min(is_whole ? of.size() : static_cast<size_t>(check_due + kRounding),
                                  of.size() - fit);
    if (!is_whole) check_due -= static_cast<double>(check);
    const size_t stride = golden_stride(of.size());
    for (size_t n = 0; n < fit + check; ++n) {
      (n < fit ? dealt.fit : dealt.check).views.push_back(of[(7 * k + n * stride) % of.size()]);
    }
  }
  if (dealt.fit.views.empty()) std::swap(dealt.fit, dealt.check);
  if (dealt.check.views.empty()) dealt.check = dealt.fit;
  return dealt;
}

bool is_long_fit(const CameraViews& all, size_t most, size_t num_gaussians) {
  constexpr double kMostWork = 6e8;  // pixels, and Gaussians, of one pass over the views
  const CameraViews fit = deal_views(all, most).fit;
  double work = 0;
  for (size_t view = 0; view < fit.views.size(); ++view) {
    const l4d_camera& camera = fit.camera_of(view).camera;
    work += static_cast<double>(camera.width) * static_cast<double>(camera.height) +
            static_cast<double>(num_gaussians);
  }
  return work > kMostWork;
}

namespace {

// The scale of a ball whose section is as broad as the broadest side of a Gaussian: sqrt(a b) where
// its standard deviations are a >= b >= c, of which c is small.
float scale_of_broadest(const float* covariance /* xx xy xz yy yz zz */) {
  const double xx = static_cast<double>(covariance[0]), xy = static_cast<double>(covariance[1]),
               xz = static_cast<double>(covariance[2]), yy = static_cast<double>(covariance[3]),
               yz = static_cast<double>(covariance[4]), zz = static_cast<double>(covariance[5]);
  // (ab)^2 + (ac)^2 + (bc)^2
  const double minors = xx * yy - xy * xy + xx * zz - xz * xz + yy * zz - yz * yz;
  return static_cast<float>(0.25 * std::log(std::max(minors, 1e-60)));
}

io::Scene scene_of(SplatArrays&& splats, const l4d_timeline& timeline,
                   const l4d_placement& placement, const l4d_presentation& presentation) {
  io::Scene instant;
  instant.timeline = timeline;
  instant.placement = placement;
  instant.presentation = presentation;
  instant.position = std::move(splats.position);
  instant.opacity = std::move(splats.opacity);
  instant.mean_t.resize(instant.opacity.size());
  instant.log_scale.resize(4 * instant.opacity.size());
  for (size_t i = 0; i < instant.opacity.size(); ++i) {
    std::fill_n(&instant.log_scale[4 * i], 3, scale_of_broadest(&splats.covariance[6 * i]));
  }
  return instant;
}

}  // namespace

double middle_of(const l4d_timeline& timeline) {
  return timeline.time_begin + 0.5 * io::duration(timeline);
}

io::Scene instant_of(const io::Scene& scene, double seconds) {
  io::Scene instant;
  instant.timeline = scene.timeline;
  instant.placement = scene.placement;
  instant.presentation = scene.presentation;
  instant.has_found_view = scene.has_found_view;
  const uint32_t frame = frame_of_time(scene.timeline, seconds);
  for (size_t i = 0; i < scene.count(); ++i) {
    const Motion motion = motion_of(scene, i);
    const FrameWindow window = window_in(scene, i);
    const double part = window.is_flat() ? (window.holds(frame) ? 1.0 : 0.0)
                                         : falloff(motion.lambda, seconds - motion.mean_t);
    for (const double p : motion.at(seconds)) instant.position.push_back(static_cast<float>(p));
    instant.opacity.push_back(static_cast<float>(linear_opacity(scene, i) * part));
  }
  instant.mean_t.resize(scene.count());
  instant.log_scale = scene.log_scale;
  return instant;
}

io::Scene instant_of(const DecoderHandle& decoder, double seconds) {
  const l4d_info info = decoder.info();
  return scene_of(decoder.slice(seconds), info.timeline, info.placement, decoder.presentation());
}

io::Scene instant_of(ShownMembers& members, double seconds) {
  const DecoderHandle& first = members.first();
  return scene_of(members.slice(seconds), members.timeline(), first.info().placement,
                  first.presentation());
}

CameraViews made_up_views(const io::Scene& scene, const io::Hold& holder) {
  constexpr uint32_t kCameras = 36, kWidth = 320, kHeight = 180;
  CameraViews made;
  constexpr uint64_t kBytes = (3 + 1 + 1 + 4) * sizeof(float);  // of a Gaussian at an instant
  const std::shared_ptr<void> memory =
      io::hold(holder, scene.count() * kBytes, "an instant of the scene");
  io::Scene middle = instant_of(scene, middle_of(scene.timeline));
  // It tells places from objects.
  if (middle.presentation.has_camera == 0) {
    io::state_first_view(scene, &middle.presentation, holder);
  }
  made.set = io::orbit_cameras(middle, kCameras, kWidth, kHeight, holder);
  const size_t count = made.set.cameras.size(), stride = golden_stride(count);
  for (size_t k = 0; k < count; ++k) {
    const double part = (static_cast<double>(k) + 0.5) / static_cast<double>(count);
    io::View view;
    view.camera = k * stride % count;
    view.time = scene.timeline.time_begin + part * io::duration(scene.timeline);
    view.frame = frame_of_time(scene.timeline, view.time);
    made.views.push_back(view);
  }
  return made;
}

}  // namespace l4d::eval

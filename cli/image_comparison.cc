// SPDX-License-Identifier: Apache-2.0
#include "cli/image_comparison.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "cli/captured_images.h"
#include "cli/text/progress.h"
#include "cli/text/units.h"
#include "io/metrics.h"

namespace l4d::cli {
namespace {

// Captured images in memory at a time.
constexpr uint64_t kMaxCapturedBytes = uint64_t{1} << 30;

double capped(double decibels) { return std::min(decibels, kMaxDecibels); }

io::Fidelity fidelity_over(const std::vector<ViewFidelity>& views, ImageError ViewFidelity::*of) {
  io::FidelityAccumulator sums;
  double decibels = 0;
  for (const ViewFidelity& view : views) {
    sums.add((view.*of).mse, (view.*of).ssim);
    decibels += capped_psnr((view.*of).mse);
  }
  io::Fidelity result = sums.result();
  result.psnr = capped(result.psnr);
  result.min_psnr = capped(result.min_psnr);
  // One view that is equal must not make the mean of all infinite.
  result.mean_psnr = decibels / static_cast<double>(views.size());
  return result;
}

std::string format_db(double decibels) {
  return format(decibels < kMaxDecibels ? "%.2f" : "%.0f", decibels);
}

std::string row(const std::string& name, double psnr, double ssim) {
  return format("%-28s %8s dB  SSIM %.4f\n", name.c_str(), format_db(psnr).c_str(), ssim);
}

}  // namespace

double capped_psnr(double mse) { return capped(io::psnr_of_mse(mse)); }

double ImageComparison::fidelity_db() const {
  return fidelity_over(views, &ViewFidelity::fidelity).psnr;
}

size_t ImageComparison::worst() const {
  const auto at = std::max_element(
      views.begin(), views.end(),
      [](const ViewFidelity& x, const ViewFidelity& y) { return x.fidelity.mse < y.fidelity.mse; });
  return static_cast<size_t>(at - views.begin());
}

Json ImageComparison::json(bool per_view) const {
  const io::Fidelity f = fidelity_over(views, &ViewFidelity::fidelity);
  const ViewFidelity& least = views[worst()];
  Json j = {{"views", views.size()},
            {"fidelity_db", f.psnr},
            {"min_fidelity_db", f.min_psnr},
            {"mean_fidelity_db", f.mean_psnr},
            {"ssim", f.mean_ssim},
            {"worst_view", {{"camera", least.camera}, {"frame", least.view.frame}}}};
  if (has_images) {
    const io::Fidelity a = fidelity_over(views, &ViewFidelity::a);
    const io::Fidelity b = fidelity_over(views, &ViewFidelity::b);
    j["psnr_a_db"] = a.mean_psnr;
    j["psnr_b_db"] = b.mean_psnr;
    j["ssim_a"] = a.mean_ssim;
    j["ssim_b"] = b.mean_ssim;
  }
  j["render_s"] = render_seconds;
  if (!per_view) return j;
  j["per_view"] = Json::array();
  for (const ViewFidelity& view : views) {
    Json entry = {{"camera", view.camera},
                  {"frame", view.view.frame},
                  {"time", view.view.time},
                  {"fidelity_db", capped_psnr(view.fidelity.mse)},
                  {"ssim", view.fidelity.ssim}};
    if (has_images) {
      entry["psnr_a_db"] = capped_psnr(view.a.mse);
      entry["psnr_b_db"] = capped_psnr(view.b.mse);
      entry["ssim_a"] = view.a.ssim;
      entry["ssim_b"] = view.b.ssim;
    }
    j["per_view"].push_back(entry);
  }
  return j;
}

std::string ImageComparison::text(bool per_view) const {
  const io::Fidelity f = fidelity_over(views, &ViewFidelity::fidelity);
  const ViewFidelity& least = views[worst()];
  std::string t =
      format("\nimages of %s views, rendered in %s\n", format_count(views.size()).c_str(),
             format_seconds(render_seconds).c_str());
  t += row("B against A", f.psnr, f.mean_ssim);
  t += row(format("worst: camera %d, frame %u", least.camera, least.view.frame), f.min_psnr,
           least.fidelity.ssim);
  if (has_images) {
    const io::Fidelity a = fidelity_over(views, &ViewFidelity::a);
    const io::Fidelity b = fidelity_over(views, &ViewFidelity::b);
    t += row("A against captured, mean", a.mean_psnr, a.mean_ssim);
    t += row("B against captured, mean", b.mean_psnr, b.mean_ssim);
  }
  if (!per_view) return t;
  t += format("\n%-7s %-7s %-9s %9s %7s", "camera", "frame", "time", "fidelity", "ssim");
  t += has_images ? format(" %9s %9s %7s %7s\n", "psnr a", "psnr b", "ssim a", "ssim b") : "\n";
  for (const ViewFidelity& view : views) {
    t += format("%-7d %-7u %-9.3f %9s %7.4f", view.camera, view.view.frame, view.view.time,
                format_db(capped_psnr(view.fidelity.mse)).c_str(), view.fidelity.ssim);
    if (has_images) {
      t += format(" %9s %9s %7.4f %7.4f", format_db(capped_psnr(view.a.mse)).c_str(),
                  format_db(capped_psnr(view.b.mse)).c_str(), view.a.ssim, view.b.ssim);
    }
    t += '\n';
  }
  return t;
}

ImageComparison compare_images(Context& context, RenderedScene& a, RenderedScene& b,
                               const CameraViews& all, bool images) {
  Progress progress(context, "compare");
  std::vector<std::vector<size_t>> parts;
  if (images) {
    parts = parts_of(all, kMaxCapturedBytes);
  } else {
    parts.emplace_back(all.views.size());
    std::iota(parts[0].begin(), parts[0].end(), size_t{0});
  }
  ImageComparison result;
  result.has_images = images;
  result.views.resize(all.views.size());
  const auto error_of = [&](const io::Image& x, const io::Image& y) {
    return ImageError{io::mse(x, y), io::ssim(x, y, context.options.threads)};
  };
  io::Image image_a, image_b;
  size_t done = 0;
  for (const std::vector<size_t>& part : parts) {
    std::optional<CapturedImages> captured;
    if (images) captured.emplace(all, part, progress);
    for (const size_t index : part) {
      progress.update(done++, all.views.size(), "rendering");
      ViewFidelity& out = result.views[index];
      out.view = all.views[index];
      const io::Camera& camera = all.set.cameras[out.view.camera];
      out.camera = camera.id;
      const Stopwatch watch;
      a.set_time(out.view.time);
      a.render(camera.camera, &image_a);
      b.set_time(out.view.time);
      b.render(camera.camera, &image_b);
      result.render_seconds += watch.seconds();
      out.fidelity = error_of(image_a, image_b);
      if (!captured) continue;
      const io::Image seen = captured->image(index);
      out.a = error_of(image_a, seen);
      out.b = error_of(image_b, seen);
    }
  }
  return result;
}

io::Image side_by_side(RenderedScene& a, RenderedScene& b, const CameraViews& views,
                       const io::View& view, double gain) {
  const l4d_camera& camera = views.set.cameras[view.camera].camera;
  io::Image image_a, image_b;
  a.set_time(view.time);
  a.render(camera, &image_a);
  b.set_time(view.time);
  b.render(camera, &image_b);
  const io::Image error = io::error_map(image_a, image_b, gain);
  return io::side_by_side({std::move(image_a), std::move(image_b), error});
}

}  // namespace l4d::cli

// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/image_text.h"

#include "cli/text/units.h"

namespace l4d::cli {
namespace {

using eval::CameraJod;
using eval::ViewFidelity;

std::string format_db(double decibels) {
  return format(decibels < eval::kMaxDecibels ? "%.2f" : "%.0f", decibels);
}

// lpips: the network of LPIPS, or "".
std::string row(const std::string& name, double psnr, double ssim, const std::string& lpips,
                double distance) {
  return format("%-28s %8s dB  SSIM %.4f", name.c_str(), format_db(psnr).c_str(), ssim) +
         (lpips.empty() ? "\n" : format("  LPIPS (%s) %.4f\n", lpips.c_str(), distance));
}

void put_jod(const eval::ImageComparison& c, Json& j) {
  if (c.display == nullptr) return;
  j["jod"] = c.mean_jod(&CameraJod::jod);
  j["min_jod"] = c.min_jod();
  if (c.has_images) {
    j["jod_a"] = c.mean_jod(&CameraJod::a);
    j["jod_b"] = c.mean_jod(&CameraJod::b);
  }
  j["jod_display"] = c.display->name;
  j["jod_metric"] = "ColorVideoVDP 0.5.6";
  for (const CameraJod& camera : c.jods) {
    Json entry = {{"camera", camera.camera},
                  {"frames", camera.frames},
                  {"fps", camera.fps},
                  {"jod", camera.jod}};
    if (c.has_images) {
      entry["jod_a"] = camera.a;
      entry["jod_b"] = camera.b;
    }
    j["jod_cameras"].push_back(entry);
  }
}

std::string jod_text(const eval::ImageComparison& c) {
  if (c.display == nullptr) return "";
  std::string t =
      format("%-28s %8.3f     %s, %.2f pixels a degree\n", "mean JOD, B against A",
             c.mean_jod(&CameraJod::jod), c.display->name, c.display->pixels_per_degree);
  if (c.has_images) {
    t += format("%-28s %8.3f\n%-28s %8.3f\n", "mean JOD, A against captured",
                c.mean_jod(&CameraJod::a), "mean JOD, B against captured",
                c.mean_jod(&CameraJod::b));
  }
  for (const CameraJod& camera : c.jods) {
    const std::string frames =
        camera.frames == 1 ? "an image"
                           : format("%s frames, %s a second", format_count(camera.frames).c_str(),
                                    format_number(camera.fps).c_str());
    t += format("  camera %-19d %8.3f     %s\n", camera.camera, camera.jod, frames.c_str());
  }
  return t;
}

}  // namespace

Json image_json(const eval::ImageComparison& c, bool per_view) {
  const io::Fidelity f = c.summary(&ViewFidelity::fidelity);
  const ViewFidelity& least = c.views[c.worst()];
  Json j = {{"views", c.views.size()},
            {"fidelity_db", f.psnr},
            {"min_fidelity_db", f.min_psnr},
            {"mean_fidelity_db", f.mean_psnr},
            {"ssim", f.mean_ssim},
            {"worst_view", {{"camera", least.camera}, {"frame", least.view.frame}}}};
  if (c.has_images) {
    const io::Fidelity a = c.summary(&ViewFidelity::a);
    const io::Fidelity b = c.summary(&ViewFidelity::b);
    j["psnr_a_db"] = a.mean_psnr;
    j["psnr_b_db"] = b.mean_psnr;
    j["ssim_a"] = a.mean_ssim;
    j["ssim_b"] = b.mean_ssim;
  }
  if (!c.lpips.empty()) {
    const std::string key = "lpips_" + c.lpips;
    j[key] = c.mean_lpips(&ViewFidelity::fidelity);
    if (c.has_images) {
      j[key + "_a"] = c.mean_lpips(&ViewFidelity::a);
      j[key + "_b"] = c.mean_lpips(&ViewFidelity::b);
    }
  }
  put_jod(c, j);
  j["render_s"] = c.render_seconds;
  if (!per_view) return j;
  j["per_view"] = Json::array();
  for (const ViewFidelity& view : c.views) {
    Json entry = {{"camera", view.camera},
                  {"frame", view.view.frame},
                  {"time", view.view.time},
                  {"fidelity_db", eval::capped_psnr(view.fidelity.mse)},
                  {"ssim", view.fidelity.ssim}};
    if (c.has_images) {
      entry["psnr_a_db"] = eval::capped_psnr(view.a.mse);
      entry["psnr_b_db"] = eval::capped_psnr(view.b.mse);
      entry["ssim_a"] = view.a.ssim;
      entry["ssim_b"] = view.b.ssim;
    }
    if (!c.lpips.empty()) {
      const std::string key = "lpips_" + c.lpips;
      entry[key] = view.fidelity.lpips;
      if (c.has_images) {
        entry[key + "_a"] = view.a.lpips;
        entry[key + "_b"] = view.b.lpips;
      }
    }
    j["per_view"].push_back(entry);
  }
  return j;
}

std::string image_text(const eval::ImageComparison& c, bool per_view) {
  const io::Fidelity f = c.summary(&ViewFidelity::fidelity);
  const ViewFidelity& least = c.views[c.worst()];
  std::string t =
      format("\nimages of %s views, rendered in %s\n", format_count(c.views.size()).c_str(),
             format_seconds(c.render_seconds).c_str());
  t += row("B against A", f.psnr, f.mean_ssim, c.lpips, c.mean_lpips(&ViewFidelity::fidelity));
  t += row(format("worst: camera %d, frame %u", least.camera, least.view.frame), f.min_psnr,
           least.fidelity.ssim, c.lpips, least.fidelity.lpips);
  if (c.has_images) {
    const io::Fidelity a = c.summary(&ViewFidelity::a);
    const io::Fidelity b = c.summary(&ViewFidelity::b);
    t += row("A against captured, mean", a.mean_psnr, a.mean_ssim, c.lpips,
             c.mean_lpips(&ViewFidelity::a));
    t += row("B against captured, mean", b.mean_psnr, b.mean_ssim, c.lpips,
             c.mean_lpips(&ViewFidelity::b));
  }
  t += jod_text(c);
  if (!per_view) return t;
  t += format("\n%-7s %-7s %-9s %9s %7s", "camera", "frame", "time", "fidelity", "ssim");
  t += c.has_images ? format(" %9s %9s %7s %7s\n", "psnr a", "psnr b", "ssim a", "ssim b") : "\n";
  for (const ViewFidelity& view : c.views) {
    t += format("%-7d %-7u %-9.3f %9s %7.4f", view.camera, view.view.frame, view.view.time,
                format_db(eval::capped_psnr(view.fidelity.mse)).c_str(), view.fidelity.ssim);
    if (c.has_images) {
      t += format(" %9s %9s %7.4f %7.4f", format_db(eval::capped_psnr(view.a.mse)).c_str(),
                  format_db(eval::capped_psnr(view.b.mse)).c_str(), view.a.ssim, view.b.ssim);
    }
    t += '\n';
  }
  return t;
}

}  // namespace l4d::cli

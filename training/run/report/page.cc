// SPDX-License-Identifier: Apache-2.0
#include "training/run/report/page.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "io/image/svg.h"

namespace l4d::train {
namespace {

using Vector = std::array<double, 3>;

double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
Vector unit(const Vector& a) {
  const double length = std::sqrt(dot(a, a));
  return length > 0 ? Vector{a[0] / length, a[1] / length, a[2] / length} : Vector{0, 0, 1};
}

std::string base64(const std::string& bytes) {
  const char* digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (size_t k = 0; k < bytes.size(); k += 3) {
    const size_t n = std::min<size_t>(3, bytes.size() - k);
    uint32_t word = 0;
    for (size_t i = 0; i < 3; ++i) {
      word = word << 8 | (i < n ? static_cast<uint8_t>(bytes[k + i]) : 0U);
    }
    for (size_t i = 0; i < 4; ++i) out += i <= n ? digits[word >> (18 - 6 * i) & 63] : '=';
  }
  return out;
}

template <typename... Numbers>
std::string format(const char* pattern, Numbers... numbers) {
  char text[200];
  std::snprintf(text, sizeof(text), pattern, numbers...);
  return text;
}

std::string number(double value, int digits) {
  return std::isfinite(value) ? format("%.*f", digits, value) : "–";
}

std::string row_of(const std::string& name, const Score& score, bool has_lpips, bool has_jod) {
  if (score.plain.views == 0) return "";
  return "<tr><th>" + name + "</th><td>" + number(score.plain.mean_psnr, 2) + "</td><td>" +
         number(score.plain.min_psnr, 2) + "</td><td>" + number(score.psnr_affine, 2) +
         "</td><td>" + number(score.plain.mean_ssim, 4) + "</td>" +
         (has_lpips ? "<td>" + number(score.lpips, 4) + "</td>" : "") +
         (has_jod ? "<td>" + number(score.jod, 3) + "</td>" : "") + "<td>" +
         std::to_string(score.plain.views) + "</td></tr>\n";
}

std::string cameras_of(const RunReport& report) {
  std::string out;
  double most = 1;
  for (const Score* score : {&report.train, &report.test}) {
    for (const CameraScore& camera : score->cameras) {
      if (std::isfinite(camera.psnr)) most = std::max(most, camera.psnr);
    }
  }
  for (const Score* score : {&report.train, &report.test}) {
    const bool tests = score == &report.test;
    for (const CameraScore& camera : score->cameras) {
      const double share = std::isfinite(camera.psnr) ? std::max(0.0, camera.psnr) / most : 1;
      out += "<tr><th>" + io::escaped_xml(camera.name) + "</th><td>" +
             (tests ? "test" : "training") + "</td><td>" + number(camera.psnr, 2) + "</td><td>" +
             number(camera.min_psnr, 2) + "</td><td><div class=\"bar" + (tests ? " test" : "") +
             format("\" style=\"width: %.0fpx\"></div></td></tr>\n", 240 * share);
    }
  }
  return out;
}

std::string worst_of(const Score& score, const char* name) {
  std::string out;
  for (const WorstView& view : score.worst) {
    out += "<figure><img alt=\"\" src=\"data:image/png;base64," + base64(view.beside) +
           "\"><figcaption>" + name + ": " + io::escaped_xml(view.camera) +
           format(", frame %u (%.3f s): ", view.frame, view.time) + number(view.psnr, 2) +
           " dB</figcaption></figure>\n";
  }
  return out;
}

constexpr const char* kStyle =
    "body{font:15px/1.4 system-ui,sans-serif;margin:2rem auto;max-width:1000px;padding:0 1rem;"
    "color:#222;background:#fff}table{border-collapse:collapse;margin:1rem 0}th,td{padding:.2rem "
    ".8rem;text-align:right;border-bottom:1px solid #ddd}th:first-child{text-align:left}"
    ".bar{height:.8em;background:#3b6fb6}.bar.test{background:#c8553d}figure{margin:1rem 0}"
    "img,svg{max-width:100%;height:auto}figcaption{color:#555}";

}  // namespace

std::string map_of(const Capture& capture) {
  constexpr double kSize = 420, kMargin = 50;
  io::Svg svg(kSize, kSize);
  Vector up{};
  std::vector<Vector> centers, ahead;
  for (const CaptureCamera& camera : capture.cameras) {
    const double* m = camera.source.camera.world_to_camera;
    for (size_t k = 0; k < 3; ++k) up[k] -= m[4 + k];
    Vector center;
    camera_center(camera.source.camera, center.data());
    centers.push_back(center);
    ahead.push_back({m[8], m[9], m[10]});
  }
  up = unit(up);
  const double* m = capture.cameras[0].source.camera.world_to_camera;
  const Vector back = unit(cross({m[0], m[1], m[2]}, up));  // of the first camera, level
  const Vector right = cross(up, back);
  const CaptureFrame frame = frame_of(capture);
  const Vector middle = {frame.center[0], frame.center[1], frame.center[2]};
  const double scale = (kSize / 2 - kMargin) / std::max(frame.radius, 1e-9);
  for (size_t c = 0; c < centers.size(); ++c) {
    const Vector at = {centers[c][0] - middle[0], centers[c][1] - middle[1],
                       centers[c][2] - middle[2]};
    const double x = kSize / 2 + scale * dot(at, right), y = kSize / 2 + scale * dot(at, back);
    const bool tests = capture.cameras[c].split == "test";
    const std::string color = tests ? "#c8553d" : "#3b6fb6";
    svg.line({x, y}, {x + 24 * dot(ahead[c], right), y + 24 * dot(ahead[c], back)}, color);
    const double side = tests ? 10 : 6;
    svg.rect(x - side / 2, y - side / 2, side, side, color);
    if (centers.size() <= 40)
      svg.text({x + 6, y - 5}, std::to_string(capture.cameras[c].source.id));
  }
  return svg.finish();
}

std::string page_of(const RunReport& r, const Capture& capture, const std::string& curves) {
  const bool has_lpips = !r.lpips.empty(), has_jod = std::isfinite(r.train.jod);
  std::string out =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<title>l4dtrain: " +
      io::escaped_xml(r.settings.capture) + "</title>\n<style>" + kStyle +
      "</style></head><body>\n<h1>" + io::escaped_xml(r.settings.capture) + "</h1>\n<p>" +
      std::to_string(r.cameras) + " cameras, " + std::to_string(r.training_images) +
      " images for training and " + std::to_string(r.test_images) + " for tests, " +
      std::to_string(r.width) + " x " + std::to_string(r.height) + " pixels; " +
      std::to_string(r.gaussians) + " Gaussians";
  if (r.steps > 0) {
    out +=
        " after " + std::to_string(r.steps) + " steps in " + number(r.training_seconds, 1) + " s";
  }
  if (r.stream_bytes > 0) out += "; a stream of " + std::to_string(r.stream_bytes) + " bytes";
  out +=
      ".</p>\n<table><tr><th></th><th>PSNR</th><th>worst view</th><th>after fitting "
      "colours</th><th>SSIM</th>" +
      (has_lpips ? "<th>LPIPS (" + io::escaped_xml(r.lpips) + ")</th>" : std::string()) +
      (has_jod ? "<th>JOD</th>" : "") + "<th>views</th></tr>\n" +
      row_of("training views", r.train, has_lpips, has_jod) +
      row_of("test views", r.test, has_lpips, has_jod) +
      row_of("stream, training views", r.stream_train, has_lpips, has_jod) +
      row_of("stream, test views", r.stream_test, has_lpips, has_jod) + "</table>\n";
  if (!curves.empty()) out += "<h2>Curves</h2>\n" + curves + "\n";
  out += "<h2>Worst views</h2>\n<p>Captured, and as the scene shows it.</p>\n" +
         worst_of(r.test, "test") + worst_of(r.train, "training") +
         "<h2>Cameras</h2>\n<p>From above; blue ones train, large red ones test.</p>\n" +
         map_of(capture) +
         "\n<table><tr><th>camera</th><th></th><th>PSNR</th><th>worst</th><th></th></tr>\n" +
         cameras_of(r) + "</table>\n";
  if (!r.notes.empty()) {
    out += "<h2>Notes</h2>\n<ul>\n";
    for (const std::string& note : r.notes) out += "<li>" + io::escaped_xml(note) + "</li>\n";
    out += "</ul>\n";
  }
  return out + "</body></html>\n";
}

}  // namespace l4d::train

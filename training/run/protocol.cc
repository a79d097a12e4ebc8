// SPDX-License-Identifier: Apache-2.0
#include "training/run/protocol.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "training/run/report/report.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;

const Protocol kProtocols[] = {
    {"n3dv", 1352, "0:300", {}},
    {"selfcap", 1920, "", {}},
    {"hypernerf", 0, "", {}},
    {"dnerf", 400, "", {1, 1, 1}},
};

struct Found {
  fs::path path;
  uint32_t width = 0;  // of its images, pixels; 0: they cannot be read, which the training says
};

// Adds the path if it is a capture.
void add_capture(const fs::path& path, std::vector<Found>* found) {
  std::error_code error;
  if (!fs::is_directory(path, error)) return;
  try {
    CaptureOptions options;
    options.tolerant = true;
    const Capture capture = read_capture(path.string(), options);
    found->push_back({path, capture.cameras[0].source.camera.width});
  } catch (const io::Error& known) {
    if (known.status() != L4D_ERR_FEATURE_UNSUPPORTED) found->push_back({path, 0});
  }
}

std::vector<Found> captures_in(const std::string& data) {
  std::vector<Found> found;
  std::error_code error;
  for (fs::directory_iterator entry(data, error); !error && entry != fs::directory_iterator();
       entry.increment(error)) {
    add_capture(entry->path(), &found);
  }
  if (found.empty()) add_capture(fs::path(data).lexically_normal(), &found);
  if (found.empty()) {
    throw io::Error(L4D_ERR_IO, data + ": neither it nor a folder in it is a capture");
  }
  std::sort(found.begin(), found.end(),
            [](const Found& a, const Found& b) { return a.path < b.path; });
  return found;
}

// A name that ends with a slash has none of its own.
std::string name_of(const fs::path& path) {
  return path.filename().empty() ? path.parent_path().filename().string()
                                 : path.filename().string();
}

std::string cells(const Score& score) {
  char text[160];
  std::snprintf(text, sizeof(text), " %.2f | %.4f | %.4f |", score.plain.mean_psnr,
                score.plain.mean_ssim, (1 - score.plain.mean_ssim) / 2);
  return text;
}

// The mean over scenes of what a table has of a score.
Score mean_of(const std::vector<ProtocolScene>& scenes, Score RunReport::*of) {
  Score mean;
  const auto n = static_cast<double>(scenes.size());
  for (const ProtocolScene& scene : scenes) {
    const Score& score = scene.report.*of;
    mean.plain.mean_psnr += score.plain.mean_psnr / n;
    mean.plain.mean_ssim += score.plain.mean_ssim / n;
    mean.lpips += score.lpips / n;
    mean.jod = (&scene == &scenes[0] ? 0 : mean.jod) + score.jod / n;
    mean.plain.views += score.plain.views;
  }
  return mean;
}

}  // namespace

Protocol protocol_of(const std::string& name) {
  std::string names;
  for (const Protocol& protocol : kProtocols) {
    if (protocol.name == name) return protocol;
    names += (names.empty() ? "" : ", ") + protocol.name;
  }
  throw io::Error(L4D_ERR_INVALID_ARGUMENT,
                  "there is no protocol " + name + "; those are " + names);
}

std::vector<ProtocolScene> run_protocol(const Protocol& protocol, const std::string& data,
                                        const std::string& runs, RunOptions options,
                                        RunObserver* observer) {
  check_options(options);
  options.scored_instants = 0;
  options.background = protocol.background;
  std::vector<ProtocolScene> scenes;
  for (const auto& [capture, width] : captures_in(data)) {
    const std::string name = name_of(capture);
    options.folder = (fs::path(runs) / name).string();
    options.settings.capture = capture.string();
    options.settings.reading.frames = protocol.frames;
    observer->note("Scene " + name);
    std::error_code error;
    if (fs::exists(fs::path(options.folder) / "report.json", error) && !options.force) {
      scenes.push_back({name, evaluate_run(options.folder, "", options, "", observer)});
      continue;
    }
    const bool is_larger = protocol.width != 0 && width > protocol.width;
    options.settings.scale = is_larger ? static_cast<double>(protocol.width) / width : 1;
    scenes.push_back({name, train(options, observer)});
  }
  return scenes;
}

std::string table_of(const std::vector<ProtocolScene>& scenes) {
  const bool has_lpips = !scenes.empty() && !scenes[0].report.lpips.empty();
  const bool has_stream = !scenes.empty() && scenes[0].report.stream_bytes > 0;
  std::string out = "| scene | PSNR | SSIM | DSSIM |";
  std::string rule = "|---|---:|---:|---:|";
  const auto column = [&](const std::string& title) {
    out += " " + title + " |";
    rule += "---:|";
  };
  const bool has_jod = !scenes.empty() && std::isfinite(scenes[0].report.test.jod);
  if (has_lpips) column("LPIPS (" + scenes[0].report.lpips + ")");
  if (has_jod) column("JOD");
  column("test images");
  column("training s");
  column("Gaussians");
  for (const char* title : {"stream MB", "stream PSNR", "SSIM", "DSSIM"}) {
    if (has_stream) column(title);
  }
  if (has_stream && has_lpips) column("LPIPS");
  if (has_stream && has_jod) column("JOD");
  out += "\n" + rule + "\n";
  const auto row = [&](const std::string& name, const Score& test, double seconds, double gaussians,
                       double bytes, const Score& stream) {
    char text[80];
    const auto number = [&](const char* format, double value) {
      std::snprintf(text, sizeof(text), format, value);
      out += text;
    };
    out += "| " + name + " |" + cells(test);
    if (has_lpips) number(" %.4f |", test.lpips);
    if (has_jod) number(" %.3f |", test.jod);
    number(" %.0f |", static_cast<double>(test.plain.views));
    // A run that was only scored again does not say how long it trained.
    if (seconds > 0) {
      number(" %.0f |", seconds);
    } else {
      out += " – |";
    }
    number(" %.0f |", gaussians);
    if (has_stream) {
      number(" %.3f |", bytes / 1e6);
      out += cells(stream);
      if (has_lpips) number(" %.4f |", stream.lpips);
      if (has_jod) number(" %.3f |", stream.jod);
    }
    out += "\n";
  };
  double seconds = 0, gaussians = 0, bytes = 0;
  const auto n = static_cast<double>(scenes.size());
  for (const ProtocolScene& scene : scenes) {
    const RunReport& r = scene.report;
    row(scene.name, r.test, r.training_seconds, static_cast<double>(r.gaussians),
        static_cast<double>(r.stream_bytes), r.stream_test);
    seconds += r.training_seconds / n;
    gaussians += static_cast<double>(r.gaussians) / n;
    bytes += static_cast<double>(r.stream_bytes) / n;
  }
  if (scenes.size() > 1) {
    row("mean", mean_of(scenes, &RunReport::test), seconds, gaussians, bytes,
        mean_of(scenes, &RunReport::stream_test));
  }
  return out;
}

}  // namespace l4d::train

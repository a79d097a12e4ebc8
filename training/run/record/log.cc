// SPDX-License-Identifier: Apache-2.0
#include "training/run/record/log.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>

#include "io/file/file.h"
#include "io/image/svg.h"

namespace l4d::train {
namespace {

using Json = nlohmann::ordered_json;

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

Json json_of(const Score& score) {
  return {{"psnr", number(score.plain.mean_psnr)},
          {"ssim", number(score.plain.mean_ssim)},
          {"psnr_affine", number(score.psnr_affine)},
          {"views", score.plain.views}};
}

double read_number(const Json& object, const char* key) {
  return object.contains(key) && object[key].is_number() ? object[key].get<double>() : NAN;
}

Score score_of(const Json& object) {
  Score score;
  score.plain.mean_psnr = read_number(object, "psnr");
  score.plain.mean_ssim = read_number(object, "ssim");
  score.psnr_affine = read_number(object, "psnr_affine");
  score.plain.views = object.value("views", uint64_t{0});
  return score;
}

LogEntry entry_of(const Json& j) {
  LogEntry e;
  e.step = j.value("step", uint64_t{0});
  e.seconds = read_number(j, "seconds");
  e.progress = read_number(j, "progress");
  e.loss = read_number(j, "loss");
  e.psnr = read_number(j, "psnr");
  e.gaussians = j.value("gaussians", uint64_t{0});
  e.relocated = j.value("relocated", uint64_t{0});
  e.born = j.value("born", uint64_t{0});
  e.skipped_rows = j.value("skipped_rows", uint64_t{0});
  e.image_bytes = j.value("image_bytes", uint64_t{0});
  e.image_wait = read_number(j, "image_wait_s");
  e.swaps = read_number(j, "swap_s");
  for (size_t k = 0; k < kStages && j.contains("ms"); ++k) {
    e.stages[k] = read_number(j["ms"], kStageNames[k]);
  }
  e.has_score = j.contains("test");
  if (e.has_score) {
    e.train = score_of(j["train"]);
    e.test = score_of(j["test"]);
  }
  return e;
}

// One diagram: values over steps.
class Panel {
 public:
  Panel(io::Svg* svg, double top, double bottom, double steps)
      : svg_(svg), top_(top), bottom_(bottom), steps_(std::max(steps, 1.0)) {}

  void set_range(double low, double high) {
    low_ = low;
    high_ = high > low ? high : low + 1;
  }
  void axes(const std::string& title, const std::vector<double>& ticks, const char* pattern) {
    for (const double tick : ticks) {
      if (tick < low_ || tick > high_) continue;
      char text[40];
      std::snprintf(text, sizeof(text), pattern, tick);
      svg_->line({kLeft, y(tick)}, {kRight, y(tick)}, "#dddddd");
      svg_->text({kLeft - 6, y(tick) + 4}, text, io::SvgAnchor::kEnd);
    }
    svg_->line({kLeft, bottom_}, {kRight, bottom_}, "#555555");
    svg_->text({kLeft, top_ - 10}, title, io::SvgAnchor::kStart, 13);
  }
  void curve(const std::vector<std::pair<double, double>>& values, const std::string& colour,
             const std::string& name, double label_x) {
    std::vector<io::SvgPoint> points;
    for (const auto& [step, value] : values) points.push_back({x(step), y(value)});
    if (points.empty()) return;
    svg_->polyline(points, colour);
    if (name.empty()) return;
    svg_->rect(label_x, top_ - 19, 10, 10, colour);
    svg_->text({label_x + 15, top_ - 10}, name);
  }
  double x(double step) const { return kLeft + (kRight - kLeft) * step / steps_; }

  static constexpr double kLeft = 80, kRight = 780;

 private:
  double y(double value) const {
    const double share = (std::clamp(value, low_, high_) - low_) / (high_ - low_);
    return bottom_ - (bottom_ - top_) * share;
  }

  io::Svg* svg_;
  double top_, bottom_, steps_;
  double low_ = 0, high_ = 1;
};

std::vector<double> ticks_between(double low, double high) {
  std::vector<double> ticks;
  const double step = std::max(1.0, std::ceil((high - low) / 6));
  for (double t = std::ceil(low / step) * step; t <= high; t += step) ticks.push_back(t);
  return ticks;
}

}  // namespace

void MemoryUse::raise_to(const MemoryUse& other) {
  const auto raise = [](uint64_t* own, uint64_t value) { *own = std::max(*own, value); };
  raise(&backend.model, other.backend.model);
  raise(&backend.renderer, other.backend.renderer);
  raise(&backend.targets, other.backend.targets);
  raise(&images, other.images);
  raise(&bucket_memory, other.bucket_memory);
  raise(&bucket_files, other.bucket_files);
  raise(&resident, other.resident);
  raise(&away, other.away);
}

MemoryUse memory_use(const Backend& backend, const ImageStore& images, const Residence* residence) {
  MemoryUse use;
  use.backend = backend.memory();
  use.images = images.bytes();
  use.resident = backend.count();
  if (residence == nullptr) return use;
  use.bucket_memory = residence->buckets().memory_bytes();
  use.bucket_files = residence->buckets().file_bytes();
  use.away = residence->buckets().rows();
  return use;
}

std::string json_of(const LogEntry& e) {
  Json j = {{"step", e.step},
            {"seconds", number(e.seconds)},
            {"progress", number(e.progress)},
            {"loss", number(e.loss)},
            {"psnr", number(e.psnr)},
            {"gaussians", e.gaussians},
            {"relocated", e.relocated},
            {"born", e.born},
            {"skipped_rows", e.skipped_rows},
            {"image_bytes", e.image_bytes},
            {"image_wait_s", number(e.image_wait)},
            {"swap_s", number(e.swaps)}};
  for_each_size(e.memory, [&](const char* name, uint64_t value) { j["memory"][name] = value; });
  for (size_t k = 0; k < kStages; ++k) j["ms"][kStageNames[k]] = number(e.stages[k]);
  if (e.has_score) {
    j["train"] = json_of(e.train);
    j["test"] = json_of(e.test);
  }
  if (e.ends_early) j["ends_early"] = true;
  return j.dump();
}

Log::Log(const std::string& path, uint64_t resumed_step) : path_(path) {
  std::string kept;
  if (resumed_step > 0) {
    std::ifstream in(path);
    for (std::string line; std::getline(in, line);) {
      const Json j = Json::parse(line, nullptr, false);
      // A line may be cut off where a process was killed.
      if (j.is_discarded() || !j.is_object()) continue;
      const LogEntry entry = entry_of(j);
      if (entry.step > resumed_step) continue;
      entries_.push_back(entry);
      kept += line + "\n";
    }
  }
  io::OutputFile file(path);
  file.write(kept.data(), kept.size());
  file.commit();
}

void Log::add(const LogEntry& entry) {
  entries_.push_back(entry);
  errno = 0;
  std::ofstream out(path_, std::ios::app);
  out << json_of(entry) << "\n";
  out.flush();
  if (out) return;
  throw io::Error(L4D_ERR_IO, path_ + ": cannot write the log: " + std::strerror(errno));
}

std::string draw_curves(const std::vector<LogEntry>& entries) {
  io::Svg svg(860, 620);
  const double steps = entries.empty() ? 1 : static_cast<double>(entries.back().step);
  std::vector<std::pair<double, double>> running, train, test, count;
  double low = 100, high = 0, most = 1;
  const auto add = [&](auto* list, double step, double value) {
    if (!std::isfinite(value)) return;
    list->emplace_back(step, value);
    low = std::min(low, value);
    high = std::max(high, value);
  };
  for (const LogEntry& e : entries) {
    const double step = static_cast<double>(e.step);
    add(&running, step, e.psnr);
    if (e.has_score) {
      add(&train, step, e.train.plain.mean_psnr);
      add(&test, step, e.test.plain.mean_psnr);
    }
    count.emplace_back(step, static_cast<double>(e.gaussians));
    most = std::max(most, static_cast<double>(e.gaussians));
  }
  Panel quality(&svg, 50, 340, steps);
  quality.set_range(std::floor(low) - 1, std::ceil(high) + 1);
  quality.axes("PSNR, dB", ticks_between(std::floor(low) - 1, std::ceil(high) + 1), "%.0f");
  quality.curve(running, "#bbbbbb", "views of the steps", 200);
  quality.curve(train, "#3b6fb6", "training views", 360);
  quality.curve(test, "#c8553d", "test views", 500);
  Panel size(&svg, 410, 560, steps);
  const std::vector<double> ticks = io::axis_ticks(most, 4);
  size.set_range(0, ticks.back());
  size.axes("Gaussians", ticks, "%.0f");
  size.curve(count, "#4c9a5b", "", 840);
  for (const double tick : io::axis_ticks(steps, 6)) {
    if (tick > steps * 1.001) continue;
    char text[40];
    std::snprintf(text, sizeof(text), "%.0f", tick);
    svg.text({size.x(tick), 580}, text, io::SvgAnchor::kMiddle);
  }
  svg.text({430, 602}, "step", io::SvgAnchor::kMiddle);
  return svg.finish();
}

}  // namespace l4d::train

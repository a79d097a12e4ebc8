// SPDX-License-Identifier: Apache-2.0
#include "io/image/packet_list.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace l4d::io {
namespace {

constexpr double kSteady = 0.9;      // of the steps from frame to frame
constexpr double kTolerance = 0.25;  // of a step: times may be whole milliseconds

bool begins_with(const char* line, const char* text) {
  return std::strncmp(line, text, std::strlen(text)) == 0;
}

}  // namespace

PacketList::PacketList(const std::string& path, std::FILE* list) : path_(path) {
  std::rewind(list);
  double tick = 0, duration = 0;
  char line[256];
  while (std::fgets(line, sizeof(line), list) != nullptr) {
    unsigned a = 0, b = 0;
    long long dts = 0, pts = 0, length = 0, size = 0;
    if (std::sscanf(line, "#tb 0: %u/%u", &a, &b) == 2 && b != 0) {
      tick = static_cast<double>(a) / b;
    } else if (std::sscanf(line, "#dimensions 0: %ux%u", &a, &b) == 2) {
      facts_.width = a;
      facts_.height = b;
    } else if (begins_with(line, "#codec_id 0: h264") || begins_with(line, "#codec_id 0: hevc")) {
      has_units_ = true;
    } else if (std::sscanf(line, "0, %lld, %lld, %lld, %lld", &dts, &pts, &length, &size) == 4) {
      ++facts_.frames;
      duration += static_cast<double>(length) * tick;
      times_.push_back(pts);
      sizes_.push_back(static_cast<uint32_t>(std::clamp<long long>(size, 0, UINT32_MAX)));
    }
  }
  if (duration > 0) facts_.fps = static_cast<double>(facts_.frames) / duration;
}

void PacketList::check_times() const {
  if (times_.size() < 3) return;
  std::vector<int64_t> times = times_;
  std::sort(times.begin(), times.end());
  std::vector<double> steps;
  for (size_t k = 1; k < times.size(); ++k) {
    steps.push_back(static_cast<double>(times[k]) - static_cast<double>(times[k - 1]));
  }
  std::vector<double> sorted = steps;
  std::sort(sorted.begin(), sorted.end());
  const double usual = sorted[sorted.size() / 2];
  const auto is_usual = [usual](double step) {
    return std::abs(step - usual) <= kTolerance * usual;
  };
  const auto steady = std::count_if(steps.begin(), steps.end(), is_usual);
  if (usual <= 0 || static_cast<double>(steady) < kSteady * static_cast<double>(steps.size())) {
    return;
  }
  for (size_t k = 0; k < steps.size(); ++k) {
    if (steps[k] > 0 && steps[k] < 1.5 * usual) continue;
    throw Error(L4D_ERR_CORRUPT, path_ +
                                     (steps[k] > 0 ? ": a frame is missing between its frames "
                                                   : ": one time is that of both its frames ") +
                                     std::to_string(k) + " and " + std::to_string(k + 1));
  }
}

void PacketList::fail_at(uint64_t byte) const {
  size_t packet = 0;
  for (uint64_t end = 0; packet + 1 < sizes_.size(); ++packet) {
    end += sizes_[packet];
    if (byte < end) break;
  }
  size_t frame = 0;  // frames are coded in another order than they are shown
  for (const int64_t time : times_) frame += time < times_.at(packet) ? 1U : 0U;
  throw Error(L4D_ERR_CORRUPT, path_ + ": frame " + std::to_string(frame) +
                                   " is damaged: it has bytes that no encoder writes");
}

}  // namespace l4d::io

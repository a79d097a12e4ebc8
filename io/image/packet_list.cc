// SPDX-License-Identifier: Apache-2.0
#include "io/image/packet_list.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace l4d::io {
namespace {

constexpr long long kNoTime = INT64_MIN;  // as ffmpeg prints it
constexpr double kSameRate = 1e-3;
constexpr double kTolerance = 0.25;  // of a step: times may be whole milliseconds

bool begins_with(const char* line, const char* text) {
  return std::strncmp(line, text, std::strlen(text)) == 0;
}

// By the mean of the steps that are about as long as the median; 0 where there is none.
double usual_rate(const std::vector<double>& times) {
  std::vector<double> steps;
  for (size_t k = 1; k < times.size(); ++k) steps.push_back(times[k] - times[k - 1]);
  if (steps.empty()) return 0;
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  const double median = *middle;
  double sum = 0, count = 0;
  for (const double step : steps) {
    if (std::abs(step - median) > kTolerance * median) continue;
    sum += step;
    ++count;
  }
  return sum > 0 ? count / sum : 0;
}

}  // namespace

PacketList::PacketList(const std::string& path, std::FILE* list) : path_(path) {
  std::rewind(list);
  double tick = 0, duration = 0;
  bool has_times = true;
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
      has_times = has_times && pts != kNoTime;
      times_.push_back(pts);
      sizes_.push_back(static_cast<uint32_t>(std::clamp<long long>(size, 0, UINT32_MAX)));
    }
  }
  facts_.fps = duration > 0 ? static_cast<double>(facts_.frames) / duration : 0;
  if (!has_times) return;
  std::vector<int64_t> shown = times_;
  std::sort(shown.begin(), shown.end());
  for (size_t k = 0; k < shown.size(); ++k) {
    if (k > 0 && shown[k] == shown[k - 1]) {
      throw Error(L4D_ERR_CORRUPT, path + ": one time is that of both its frames " +
                                       std::to_string(k - 1) + " and " + std::to_string(k));
    }
    facts_.times.push_back((static_cast<double>(shown[k]) - static_cast<double>(shown[0])) * tick);
  }
  // Where that is about the same, lengths of frames tell the rate without rounding.
  const double rate = usual_rate(facts_.times);
  if (rate > 0 && std::abs(rate - facts_.fps) > kSameRate * rate) facts_.fps = rate;
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

// SPDX-License-Identifier: Apache-2.0
#include "io/image/loudness.h"

#include <cmath>
#include <cstdint>
#include <cstring>

#include "io/image/ffmpeg_process.h"
#include "io/image/video_input.h"

namespace l4d::io {

std::vector<double> read_loudness(const std::string& path, double rate) {
  constexpr double kSamples = 8000, kSeconds = 3600;
  std::vector<std::string> arguments = input_of(path, 0, 0);
  // Sound that begins late begins with silence.
  for (const char* word :
       {"-vn", "-map", "0:a:0", "-t", "3600", "-af", "aresample=async=1:first_pts=0", "-ac", "1",
        "-ar", "8000", "-f", "s16le", "-"}) {
    arguments.emplace_back(word);
  }
  FfmpegProcess process(path, arguments, FfmpegProcess::Direction::kFrom);
  std::vector<double> loudness;
  std::vector<int16_t> samples(static_cast<size_t>(kSamples / rate));
  double before = 0;
  while (process.read(samples.data(), samples.size() * sizeof(int16_t)) ==
             samples.size() * sizeof(int16_t) &&
         static_cast<double>(loudness.size()) < kSeconds * rate) {
    // Of differences: rumble and hum tell nothing.
    double sum = 0;
    for (const int16_t sample : samples) {
      const double step = static_cast<double>(sample) - before;
      before = static_cast<double>(sample);
      sum += step * step;
    }
    loudness.push_back(std::sqrt(sum / static_cast<double>(samples.size())));
  }
  try {
    process.finish();
  } catch (const Error& error) {
    if (std::strstr(error.what(), "matches no streams") == nullptr) throw;
    return {};
  }
  return loudness;
}

}  // namespace l4d::io

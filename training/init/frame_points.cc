// SPDX-License-Identifier: Apache-2.0
// A cloud of points for each frame to begin with.
#include <algorithm>
#include <filesystem>
#include <map>

#include "training/init/start.h"
#include "training/model/random.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;

// The last digits of a name as a number; false: it has none, or they are no number of a frame.
bool frame_of(const std::string& name, uint32_t* frame) {
  constexpr const char* kDigits = "0123456789";
  const size_t last = name.find_last_of(kDigits);
  if (last == std::string::npos) return false;
  const size_t before = name.find_last_not_of(kDigits, last);
  const size_t first = before == std::string::npos ? 0 : before + 1;
  if (last + 1 - first > 9) return false;
  *frame = static_cast<uint32_t>(std::stoul(name.substr(first, last + 1 - first)));
  return true;
}

// The files by the frame that their names end with.
std::map<uint32_t, std::string> files_of(const std::string& folder) {
  std::map<uint32_t, std::string> files;
  std::error_code error;
  fs::directory_iterator entry(folder, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    if (entry->path().extension() != ".ply") continue;
    const std::string path = entry->path().string();
    uint32_t frame = 0;
    if (!frame_of(entry->path().stem().string(), &frame)) {
      throw io::Error(L4D_ERR_INVALID_ARGUMENT,
                      path + ": the name has no number of a frame, as 000012.ply has");
    }
    if (!files.emplace(frame, path).second) {
      throw io::Error(
          L4D_ERR_INVALID_ARGUMENT,
          path + " and " + files[frame] + " are both points of frame " + std::to_string(frame));
    }
  }
  if (error) throw io::Error(L4D_ERR_IO, folder + ": " + error.message());
  if (files.empty()) {
    throw io::Error(L4D_ERR_INVALID_ARGUMENT,
                    folder + " has no .ply files: --init takes one for each frame, as 000012.ply");
  }
  return files;
}

}  // namespace

std::vector<Point> frame_points(const std::string& folder, const Capture& capture, uint64_t count,
                                uint64_t seed, const io::Hold& holder,
                                std::vector<std::string>* notes) {
  std::map<uint32_t, double> times;
  for (const CaptureView& view : capture.views) times.emplace(view.frame, view.time);
  const std::map<uint32_t, std::string> files = files_of(folder);
  const auto used = std::count_if(files.begin(), files.end(),
                                  [&](const auto& file) { return times.count(file.first) != 0; });
  if (used == 0) {
    throw io::Error(L4D_ERR_INVALID_ARGUMENT, folder + ": the capture has none of the frames " +
                                                  std::to_string(files.begin()->first) + " to " +
                                                  std::to_string(files.rbegin()->first) +
                                                  " that its files are points of");
  }
  // A training draws its Gaussians from twice as many: more of a file only take memory.
  const double most = std::max(1.0, 2 * static_cast<double>(count) / static_cast<double>(used));
  std::vector<Point> points;
  const size_t noted = notes->size();  // what one file lacks, others may lack, too: one note
  for (const auto& [frame, path] : files) {
    const auto time = times.find(frame);
    if (time == times.end()) continue;
    const std::vector<Point> all =
        read_points(path, holder, notes->size() == noted ? notes : nullptr);
    const double share = most / static_cast<double>(all.size());
    for (size_t i = 0; i < all.size(); ++i) {
      const float drawn = uniform(philox(seed, frame, i, Use::kPoints).v[0]);
      if (static_cast<double>(drawn) >= share) continue;
      points.push_back(all[i]);
      points.back().time = static_cast<float>(time->second);
      points.back().has_time = true;
    }
  }
  const auto others = static_cast<int64_t>(files.size()) - static_cast<int64_t>(used);
  if (others > 0) {
    notes->push_back(std::to_string(others) + " of " + std::to_string(files.size()) +
                     " files of points are of frames that the capture does not have.");
  }
  return points;
}

}  // namespace l4d::train

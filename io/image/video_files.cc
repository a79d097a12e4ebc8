// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <filesystem>
#include <iterator>

#include "io/image/video.h"

namespace l4d::io {
namespace {

namespace fs = std::filesystem;

constexpr const char* kVideoExtensions[] = {".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi",
                                            ".mts", ".ts",  ".3gp", ".flv", ".ogv",  ".y4m"};

bool is_video_name(const fs::path& path) {
  const std::string name = path.filename().string();
  if (name.empty() || name[0] == '.') return false;  // hidden: what some systems leave behind
  std::string extension = path.extension().string();
  for (char& c : extension) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return std::find(std::begin(kVideoExtensions), std::end(kVideoExtensions), extension) !=
         std::end(kVideoExtensions);
}

}  // namespace

std::vector<fs::path> videos_in(const fs::path& folder) {
  std::vector<fs::path> videos;
  std::error_code error;
  fs::directory_iterator entry(folder.empty() ? fs::path(".") : folder, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    if (is_video_name(entry->path())) videos.push_back(folder / entry->path().filename());
  }
  std::sort(videos.begin(), videos.end());
  return videos;
}

}  // namespace l4d::io

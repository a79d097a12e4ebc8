// SPDX-License-Identifier: Apache-2.0
#include "training/images/frame_cache.h"

#include <xxhash.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "io/file/file.h"
#include "training/capture/capture_hash.h"

// FOLDER/frames1-HASH-SCALE/CAMERA-PART.frames: a header, then the frames, each [height, width, 3].
// Numbers are those of the machine, for whose trainings the cache is.
namespace l4d::train {
namespace {

namespace fs = std::filesystem;

// Names the version of the files, and of what makes frames of videos: where one of them changes, so
// does the name, and older files are not found.
constexpr const char* kPrefix = "frames1-";
constexpr const char* kSuffix = ".frames";
constexpr char kMagic[9] = "L4DFRM01";

struct Header {
  char magic[8];
  uint32_t camera, part, count, width, height, reserved;
  uint64_t hashes[FrameCache::kFrames];  // XXH3 of each frame; 0 beyond the last
};

uint64_t bytes_of_frame(const FramePart& part) { return uint64_t{3} * part.width * part.height; }

uint64_t bytes_of_file(const FramePart& part) {
  return sizeof(Header) + part.count * bytes_of_frame(part);
}

// An open file whose header and length are those of the part; else none.
io::FileHandle open_part(const std::string& path, const FramePart& part, Header* header) {
  std::error_code error;
  if (!fs::is_regular_file(path, error)) return {};
  io::FileHandle file(std::fopen(path.c_str(), "rb"));
  const bool is_right = file && std::fread(header, sizeof(*header), 1, file.get()) == 1 &&
                        std::memcmp(header->magic, kMagic, sizeof(header->magic)) == 0 &&
                        header->camera == part.camera && header->part == part.part &&
                        header->count == part.count && header->width == part.width &&
                        header->height == part.height &&
                        fs::file_size(path, error) == bytes_of_file(part);
  return is_right ? std::move(file) : io::FileHandle();
}

bool is_cache(const fs::path& folder) { return folder.filename().string().rfind(kPrefix, 0) == 0; }

// Of the files of a cache, those that are being written too. Others in the folder do not count.
uint64_t bytes_in(const fs::path& cache) {
  uint64_t bytes = 0;
  std::error_code error;
  fs::directory_iterator entry(cache, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    if (entry->path().filename().string().find(kSuffix) == std::string::npos) continue;
    std::error_code gone;
    const uint64_t size = entry->is_regular_file(gone) ? entry->file_size(gone) : 0;
    if (!gone) bytes += size;
  }
  return bytes;
}

uint64_t bytes_in_caches(const std::string& folder) {
  uint64_t bytes = 0;
  std::error_code error;
  fs::directory_iterator entry(folder, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    if (is_cache(entry->path())) bytes += bytes_in(entry->path());
  }
  return bytes;
}

}  // namespace

FrameCache::FrameCache(const std::string& folder, const std::string& key, uint64_t limit)
    : folder_((fs::path(folder) / key).string()), limit_(limit), bytes_(bytes_in_caches(folder)) {}

std::string FrameCache::key_of(const Capture& capture, double scale) {
  char text[40];
  std::snprintf(text, sizeof(text), "-%.17g", scale);
  return kPrefix + hash_with_videos(capture) + text;
}

std::string FrameCache::path_of(const FramePart& part) const {
  const std::string name = std::to_string(part.camera) + "-" + std::to_string(part.part) + kSuffix;
  return (fs::path(folder_) / name).string();
}

std::vector<Pixels> FrameCache::read(const FramePart& part,
                                     const std::vector<uint32_t>& frames) const {
  Header header;
  const io::FileHandle file = open_part(path_of(part), part, &header);
  if (!file) return {};
  const uint64_t size = bytes_of_frame(part);
  std::vector<Pixels> out;
  for (const uint32_t frame : frames) {
    Pixels pixels{part.width, part.height, std::vector<uint8_t>(size), {}};
    const auto place = static_cast<long>(sizeof(header) + frame * size);
    if (std::fseek(file.get(), place, SEEK_SET) != 0 ||
        std::fread(pixels.rgb.data(), 1, size, file.get()) != size ||
        XXH3_64bits(pixels.rgb.data(), size) != header.hashes[frame]) {
      return {};
    }
    out.push_back(std::move(pixels));
  }
  return out;
}

bool FrameCache::has(const FramePart& part) const {
  Header header;
  return open_part(path_of(part), part, &header) != nullptr;
}

void FrameCache::write(const FramePart& part, const std::vector<Pixels>& frames) {
  if (!is_writable()) return;
  Header header{};
  std::memcpy(header.magic, kMagic, sizeof(header.magic));
  header.camera = part.camera;
  header.part = part.part;
  header.count = part.count;
  header.width = part.width;
  header.height = part.height;
  for (size_t k = 0; k < frames.size(); ++k) {
    header.hashes[k] = XXH3_64bits(frames[k].rgb.data(), frames[k].rgb.size());
  }
  const uint64_t size = bytes_of_file(part);
  if (bytes_.fetch_add(size) + size > limit_) {
    return stop("the files in its folder have the " + std::to_string(limit_) +
                " bytes of --cache-limit");
  }
  try {
    std::error_code error;
    fs::create_directories(folder_, error);
    if (error) return stop(folder_ + ": cannot make the folder: " + error.message());
    io::OutputFile file(path_of(part));
    file.write(&header, sizeof(header));
    for (const Pixels& pixels : frames) file.write(pixels.rgb.data(), pixels.rgb.size());
    file.commit();
  } catch (const io::Error& error) {
    stop(error.what());
  }
}

void FrameCache::stop(const std::string& why) {
  const std::lock_guard<std::mutex> lock(mutex_);
  is_writable_ = false;
  if (trouble_.empty()) trouble_ = "The cache keeps no more frames: " + why + ".";
}

std::string FrameCache::trouble() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return trouble_;
}

std::vector<FrameCache::Content> FrameCache::list(const std::string& folder,
                                                  const Capture& capture) {
  std::vector<Content> out;
  const std::string begin = kPrefix + hash_with_videos(capture) + "-";
  std::error_code error;
  fs::directory_iterator entry(folder, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (name.rfind(begin, 0) != 0) continue;
    out.push_back({std::strtod(name.c_str() + begin.size(), nullptr), bytes_in(entry->path())});
  }
  std::sort(out.begin(), out.end(),
            [](const Content& a, const Content& b) { return a.scale < b.scale; });
  return out;
}

}  // namespace l4d::train

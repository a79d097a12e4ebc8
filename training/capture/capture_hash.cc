// SPDX-License-Identifier: Apache-2.0
#include "training/capture/capture_hash.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include <algorithm>
#include <cstdio>
#include <vector>

#include "io/file/file.h"
#include "libl4dcodec/base/threads.h"

namespace l4d::train {
namespace {

// From either end of a file. A compressed image that changes does so in its length or in its last
// bytes, where its checksums are; most images are hashed whole.
constexpr uint64_t kEnd = 64 << 10;
constexpr size_t kBatch = 128;      // files in memory at a time
constexpr size_t kBlock = 1 << 20;  // of a file that is hashed whole
constexpr int kReaders = 16;        // threads, which mostly wait for files

// What is hashed of a file. One that is not there is nothing: who reads it says so.
struct FileEnds {
  double size = -1;  // bytes; -1: no path, -2: no file
  std::vector<uint8_t> bytes;
};

// With few system calls, some of which take long on some file systems.
FileEnds ends_of(const std::string& path) {
  FileEnds out;
  if (path.empty()) return out;
  out.size = -2;
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOCTTY | O_NONBLOCK);
  if (fd < 0) return out;
  struct stat status {};
  if (::fstat(fd, &status) == 0 && S_ISREG(status.st_mode)) {
    const auto size = static_cast<uint64_t>(status.st_size);
    out.size = static_cast<double>(size);
    const auto add = [&](uint64_t begin, uint64_t n) {
      const size_t before = out.bytes.size();
      out.bytes.resize(before + static_cast<size_t>(n));
      const ssize_t got =
          ::pread(fd, out.bytes.data() + before, static_cast<size_t>(n), static_cast<off_t>(begin));
      out.bytes.resize(before + static_cast<size_t>(std::max<ssize_t>(got, 0)));
    };
    add(0, std::min(size, kEnd));
    if (size > kEnd) add(std::max(kEnd, size - kEnd), std::min(size - kEnd, kEnd));
  }
  ::close(fd);
  return out;
}

class Hash {
 public:
  Hash() : state_(XXH3_createState()) { XXH3_64bits_reset(state_); }
  ~Hash() { XXH3_freeState(state_); }
  Hash(const Hash&) = delete;
  Hash& operator=(const Hash&) = delete;

  void bytes(const void* data, size_t n) { XXH3_64bits_update(state_, data, n); }
  void number(double value) { bytes(&value, sizeof(value)); }
  void text(const std::string& value) {
    number(static_cast<double>(value.size()));
    bytes(value.data(), value.size());
  }
  void file(const FileEnds& ends) {
    number(ends.size);
    bytes(ends.bytes.data(), ends.bytes.size());
  }
  void whole_file(const std::string& path) {
    const io::FileHandle file(std::fopen(path.c_str(), "rb"));
    std::vector<uint8_t> block(kBlock);
    uint64_t size = 0;
    for (size_t n = kBlock; file && n == kBlock; size += n) {
      n = std::fread(block.data(), 1, kBlock, file.get());
      bytes(block.data(), n);
    }
    number(static_cast<double>(size));
  }
  std::string digits() const {
    char out[24];
    std::snprintf(out, sizeof(out), "%016llx",
                  static_cast<unsigned long long>(XXH3_64bits_digest(state_)));
    return out;
  }

 private:
  XXH3_state_t* state_;
};

void add(Hash* hash, const CaptureCamera& camera) {
  const l4d_camera& c = camera.source.camera;
  hash->text(camera.name);
  hash->text(camera.split);
  for (const double number :
       {static_cast<double>(c.width), static_cast<double>(c.height), c.fx, c.fy, c.cx, c.cy,
        static_cast<double>(c.near_plane), camera.source.time_offset,
        static_cast<double>(camera.source.id), static_cast<double>(camera.frames)}) {
    hash->number(number);
  }
  for (const double number : c.world_to_camera) hash->number(number);
  for (const double number : camera.source.distortion.k) hash->number(number);
  for (const double number : camera.source.distortion.p) hash->number(number);
  hash->number(static_cast<double>(camera.source.distortion.model));
  hash->file(ends_of(camera.source.video));
  hash->file(ends_of(camera.source.mask));
}

// Files are read several at a time: a long capture has thousands, and opening one may take long.
void add_views(Hash* hash, const std::vector<CaptureView>& views) {
  std::vector<FileEnds> ends(kBatch);
  for (size_t first = 0; first < views.size(); first += kBatch) {
    const size_t count = std::min(kBatch, views.size() - first);
    parallel_for(kReaders, count, 1,
                 [&](size_t k, size_t) { ends[k] = ends_of(views[first + k].file); });
    for (size_t k = 0; k < count; ++k) {
      const CaptureView& view = views[first + k];
      hash->number(view.camera);
      hash->number(view.frame);
      hash->number(view.time);
      hash->file(ends[k]);
    }
  }
}

}  // namespace

std::string hash_of(const Capture& capture) {
  Hash hash;
  hash.text(capture.layout);
  hash.number(capture.fps);
  hash.number(capture.frames);
  for (const CaptureCamera& camera : capture.cameras) add(&hash, camera);
  add_views(&hash, capture.views);
  for (const Point& point : capture.points) {
    hash.bytes(point.position, sizeof(point.position));
    hash.bytes(point.rgb, sizeof(point.rgb));
    hash.number(static_cast<double>(point.time));
  }
  return hash.digits();
}

std::string hash_with_videos(const Capture& capture) {
  Hash hash;
  hash.text(hash_of(capture));
  for (const CaptureCamera& camera : capture.cameras) {
    if (camera.is_video()) hash.whole_file(camera.source.video);
  }
  return hash.digits();
}

}  // namespace l4d::train

// SPDX-License-Identifier: Apache-2.0
#include "training/capture/capture_hash.h"

#include <xxhash.h>

#include <algorithm>
#include <cstdio>
#include <vector>

#include "io/file.h"

namespace l4d::train {
namespace {

// From either end of a file. A compressed image that changes does so in its length or in its last
// bytes, where its checksums are; most images are hashed whole.
constexpr uint64_t kEnd = 64 << 10;

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
  // A file that is not there is nothing: who reads it says so.
  void file(const std::string& path) {
    if (path.empty()) return number(-1);
    const io::FileHandle file(std::fopen(path.c_str(), "rb"));
    if (!file || std::fseek(file.get(), 0, SEEK_END) != 0) return number(-2);
    const auto size = static_cast<uint64_t>(std::max(0L, std::ftell(file.get())));
    number(static_cast<double>(size));
    part(file.get(), 0, std::min(size, kEnd));
    if (size > kEnd) part(file.get(), std::max(kEnd, size - kEnd), std::min(size - kEnd, kEnd));
  }
  std::string digits() const {
    char out[24];
    std::snprintf(out, sizeof(out), "%016llx",
                  static_cast<unsigned long long>(XXH3_64bits_digest(state_)));
    return out;
  }

 private:
  void part(std::FILE* file, uint64_t begin, uint64_t n) {
    buffer_.resize(static_cast<size_t>(n));
    if (std::fseek(file, static_cast<long>(begin), SEEK_SET) != 0) return;
    bytes(buffer_.data(), std::fread(buffer_.data(), 1, buffer_.size(), file));
  }

  XXH3_state_t* state_;
  std::vector<uint8_t> buffer_;
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
  hash->file(camera.source.video);
  hash->file(camera.source.mask);
}

}  // namespace

std::string hash_of(const Capture& capture) {
  Hash hash;
  hash.text(capture.layout);
  hash.number(capture.fps);
  hash.number(capture.frames);
  for (const CaptureCamera& camera : capture.cameras) add(&hash, camera);
  for (const CaptureView& view : capture.views) {
    hash.number(view.camera);
    hash.number(view.frame);
    hash.number(view.time);
    hash.file(view.file);
  }
  for (const Point& point : capture.points) {
    hash.bytes(point.position, sizeof(point.position));
    hash.bytes(point.rgb, sizeof(point.rgb));
    hash.number(static_cast<double>(point.time));
  }
  return hash.digits();
}

}  // namespace l4d::train

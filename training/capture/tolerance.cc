// SPDX-License-Identifier: Apache-2.0
#include "training/capture/tolerance.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "io/file/file.h"
#include "libl4dcodec/base/threads.h"

namespace l4d::train {
namespace {

constexpr size_t kMaxNamed = 10;
constexpr int kReaders = 8;  // a long capture has thousands of files, and opening one may take long
constexpr uint8_t kPngBegin[16] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n',
                                   0,    0,   0,   13,  'I',  'H',  'D',  'R'};
constexpr uint8_t kPngEnd[12] = {0, 0, 0, 0, 'I', 'E', 'N', 'D', 0xae, 0x42, 0x60, 0x82};

uint32_t big_endian(const uint8_t* bytes) {
  return uint32_t{bytes[0]} << 24 | uint32_t{bytes[1]} << 16 | uint32_t{bytes[2]} << 8 | bytes[3];
}

// to_end: whether the last bytes count, too.
std::string trouble_of(const std::string& path, const l4d_camera& camera, bool to_end) {
  const io::FileHandle file(std::fopen(path.c_str(), "rb"));
  if (!file) return "cannot open " + path;
  uint8_t begin[24], end[12];
  if (std::fread(begin, 1, sizeof(begin), file.get()) != sizeof(begin) ||
      !std::equal(std::begin(kPngBegin), std::end(kPngBegin), begin)) {
    return path + " is no PNG";
  }
  const auto ends = [&] {
    return std::fseek(file.get(), -static_cast<long>(sizeof(end)), SEEK_END) == 0 &&
           std::fread(end, 1, sizeof(end), file.get()) == sizeof(end) &&
           std::equal(std::begin(kPngEnd), std::end(kPngEnd), end);
  };
  if (to_end && !ends()) return path + " is cut off";
  const uint32_t width = big_endian(begin + 16), height = big_endian(begin + 20);
  if (width == camera.width && height == camera.height) return "";
  return path + " has " + std::to_string(width) + " x " + std::to_string(height) +
         " pixels, and the camera has " + std::to_string(camera.width) + " x " +
         std::to_string(camera.height);
}

[[noreturn]] void fail(const std::string& path, const std::string& what) {
  std::error_code error;
  const bool is_there = std::filesystem::is_regular_file(path, error);
  throw io::Error(is_there ? L4D_ERR_CORRUPT : L4D_ERR_IO, what);
}

}  // namespace

std::string trouble_of_image(const std::string& path, const l4d_camera& camera) {
  return trouble_of(path, camera, true);
}

void check_image_files(const Capture& capture) {
  for (const CaptureCamera& camera : capture.cameras) {
    const std::string& mask = camera.source.mask;
    if (mask.empty()) continue;
    const std::string trouble = trouble_of(mask, camera.source.camera, false);
    if (!trouble.empty()) fail(mask, camera.name + ": its mask: " + trouble);
  }
  parallel_for(kReaders, capture.views.size(), 1, [&](size_t k, size_t) {
    const CaptureView& view = capture.views[k];
    if (view.file.empty()) return;
    const CaptureCamera& camera = capture.cameras[view.camera];
    const std::string trouble = trouble_of(view.file, camera.source.camera, false);
    if (trouble.empty()) return;
    fail(view.file, camera.name + ", frame " + std::to_string(view.frame) + ": " + trouble);
  });
}

void LeftOut::add(const std::string& what) {
  ++count_;
  if (named_.size() < kMaxNamed) named_.push_back("Left out: " + what);
}

void LeftOut::append_to(std::vector<std::string>* notes) const {
  notes->insert(notes->end(), named_.begin(), named_.end());
  const uint64_t more = count_ - named_.size();
  if (more > 0) notes->push_back("Left out likewise: " + std::to_string(more) + " more.");
}

}  // namespace l4d::train

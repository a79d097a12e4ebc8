// SPDX-License-Identifier: Apache-2.0
#include "training/capture/tolerance.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "io/file/file.h"
#include "io/image/exr_header.h"
#include "io/image/image.h"
#include "libl4dcodec/base/threads.h"

namespace l4d::train {
namespace {

constexpr size_t kMaxNamed = 10;
constexpr int kReaders = 8;  // a long capture has thousands of files, and opening one may take long
constexpr uint8_t kPngEnd[] = {0, 0, 0, 0, 'I', 'E', 'N', 'D', 0xae, 0x42, 0x60, 0x82};
constexpr uint8_t kJpegEnd[] = {0xff, 0xd9};

template <size_t kCount>
bool ends_with(std::FILE* file, const uint8_t (&wanted)[kCount]) {
  uint8_t end[kCount];
  return std::fseek(file, -static_cast<long>(kCount), SEEK_END) == 0 &&
         std::fread(end, 1, kCount, file) == kCount && std::equal(wanted, wanted + kCount, end);
}

std::string trouble_of_decoding(const std::string& path, const l4d_camera& camera) {
  try {
    io::read_image_bytes(path, {camera.width, camera.height, {}});
    return "";
  } catch (const io::Error& error) {
    return error.what();
  }
}

// to_end: whether the last bytes count, too.
std::string trouble_of(const std::string& path, const l4d_camera& camera, bool to_end) {
  const io::FileHandle file(std::fopen(path.c_str(), "rb"));
  if (!file) return "cannot open " + path;
  uint32_t size[2];
  try {
    if (!io::image_size(path, size)) return path + " is no PNG, JPEG or EXR";
  } catch (const io::Error& error) {
    return error.what();
  }
  uint8_t begin[io::kExrMagicBytes];
  const size_t known = std::fread(begin, 1, sizeof begin, file.get());
  const bool is_jpeg = known > 0 && begin[0] == 0xff, is_exr = io::is_exr(begin, known);
  const bool fits = size[0] == camera.width && size[1] == camera.height;
  // A JPEG may be turned, and have more behind its end.
  if (is_jpeg && (!fits || (to_end && !ends_with(file.get(), kJpegEnd)))) {
    return trouble_of_decoding(path, camera);
  }
  if (is_exr && fits && to_end) return trouble_of_decoding(path, camera);
  if (!is_jpeg && !is_exr && to_end && !ends_with(file.get(), kPngEnd)) return path + " is cut off";
  if (fits) return "";
  return path + " has " + std::to_string(size[0]) + " x " + std::to_string(size[1]) +
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

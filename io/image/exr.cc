// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <initializer_list>
#include <memory>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "io/file/little_endian.h"
#include "io/image/ffmpeg_process.h"
#include "io/image/stored_image.h"

namespace l4d::io {
namespace {

// ffmpeg counts the bytes of an image in 31 bits, and appends some.
constexpr uint64_t kMaxBytes = (uint64_t{1} << 31) - (uint64_t{1} << 16);
// Pixels of a byte. A block of 32 rows of one colour takes some 50 bytes.
constexpr uint64_t kMaxInflation = uint64_t{1} << 14;

[[noreturn]] void fail(const ImageFile& file, const std::string& what) {
  throw Error(L4D_ERR_CORRUPT, file.path + ": bad EXR: " + what);
}

// 0 to 1; NaN is 0.
float within(float value) { return value > 0 ? std::min(value, 1.0F) : 0.0F; }

// The transfer function of IEC 61966-2-1.
float shown(float linear) {
  const float v = within(linear);
  return v <= 0.0031308F ? 12.92F * v : 1.055F * std::pow(v, 1 / 2.4F) - 0.055F;
}

// ffmpeg gets the bytes that were checked, and neither the path, which might mean more to it than a
// name, nor a file that another program may have changed since.
FileHandle copy_of(const ImageFile& file) {
  FileHandle copy = anonymous_file();
  if (std::fwrite(file.bytes.data(), 1, file.bytes.size(), copy.get()) != file.bytes.size() ||
      std::fseek(copy.get(), 0, SEEK_SET) != 0) {
    throw Error(L4D_ERR_IO, file.path + ": cannot write a copy for ffmpeg: " +
                                std::generic_category().message(errno));
  }
  return copy;
}

// As the decoder has them: naming a form of pixels might have them converted with losses.
std::vector<std::string> arguments_for(const ImageFile& file) {
  constexpr uint64_t kPadding = 128;
  const uint64_t pixels = (file.exr->width + kPadding) * (file.exr->height + kPadding);
  std::vector<std::string> arguments = {"-xerror", "-err_detect:v", "explode", "-threads", "1"};
  const auto add = [&](std::initializer_list<std::string> more) {
    arguments.insert(arguments.end(), more);
  };
  add({"-protocol_whitelist", "pipe", "-max_pixels", std::to_string(pixels)});
  add({"-f", "exr_pipe", "-frame_size", std::to_string(file.bytes.size())});
  add({"-i", "pipe:" + std::to_string(FfmpegProcess::kExtra), "-map", "0:v:0"});
  add({"-frames:v", "1", "-c:v", "rawvideo", "-f", "rawvideo", "-"});
  return arguments;
}

// Planes of binary32 in this order: green, blue, red and alpha. False if there is less or more.
bool read_planes(FfmpegProcess* process, bool has_alpha, Image* image, std::vector<float>* alpha) {
  std::vector<float> row(image->width);
  const size_t row_bytes = row.size() * sizeof(float);
  constexpr size_t kOrder[] = {1, 2, 0, 3};
  for (const size_t c : kOrder) {
    if (c == 3 && !has_alpha) continue;
    for (size_t y = 0; y < image->height; ++y) {
      if (process->read(row.data(), row_bytes) != row_bytes) return false;
      const size_t at = y * image->width;
      for (size_t x = 0; x < row.size(); ++x) {
        (c == 3 ? (*alpha)[at + x] : image->rgb[3 * (at + x) + c]) = row[x];
      }
    }
  }
  return process->read(row.data(), 1) == 0;
}

void decode(const ImageFile& file, Image* image, std::vector<float>* alpha) {
  const FileHandle copy = copy_of(file);
  FfmpegProcess process(file.path, arguments_for(file), FfmpegProcess::Direction::kFrom,
                        copy.get());
  const bool fits = read_planes(&process, file.exr->has_alpha, image, alpha);
  std::string words;
  try {
    process.finish();
    words = process.words();
    if (!words.empty()) words = "ffmpeg does not decode all of it: " + words;
  } catch (const Error& error) {
    const std::string prefix = file.path + ": ", what = error.what();
    words = what.rfind(prefix, 0) == 0 ? what.substr(prefix.size()) : what;
  }
  // It leaves black what it cannot decode, and says only that all went well.
  if (!words.empty()) fail(file, words);
  if (!fits) {
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
                file.path +
                    ": this version of ffmpeg does not give the pixels of an EXR as "
                    "32-bit floats");
  }
}

}  // namespace

void check_exr(const ImageFile& file) {
  const ExrHeader& header = *file.exr;
  const std::vector<uint8_t>& bytes = file.bytes;
  if (bytes.size() > kMaxBytes) {
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED, file.path + ": an EXR of 2 GiB or more");
  }
  if (uint64_t{header.width} * header.height / kMaxInflation > bytes.size()) {
    fail(file, "the file is too short for its size in pixels");
  }
  const auto count = [](uint32_t pixels, uint32_t block) { return (pixels + block - 1) / block; };
  const uint32_t across = count(header.width, header.block_width);
  const uint64_t blocks = uint64_t{across} * count(header.height, header.block_height);
  const uint64_t table = header.end, end = table + 8 * blocks;
  if (end > bytes.size()) fail(file, "the file ends early");
  // Before the pixels of a block: its place and how many bytes it has.
  const size_t head = header.is_tiled ? 20 : 8;
  for (uint64_t k = 0; k < blocks; ++k) {
    const uint8_t* entry = &bytes[table + 8 * k];
    const uint64_t at = little_endian64(entry);
    if (at < end || at > bytes.size() || bytes.size() - at < head) {
      fail(file, "some of its pixels are missing");
    }
    const uint8_t* block = &bytes[at];
    const auto x = static_cast<uint32_t>(k % across), y = static_cast<uint32_t>(k / across);
    const auto number = [&](size_t which) { return little_endian32(block + 4 * which); };
    const bool is_here = header.is_tiled
                             ? number(0) == x && number(1) == y && number(2) == 0 && number(3) == 0
                             : number(0) == y * header.block_height;
    if (!is_here) fail(file, "some of its pixels are out of place");
    const uint32_t size = little_endian32(block + head - 4);
    if (size > bytes.size() - at - head) fail(file, "the file ends early");
    const uint64_t width = std::min(header.block_width, header.width - x * header.block_width);
    const uint64_t height = std::min(header.block_height, header.height - y * header.block_height);
    const uint64_t unpacked = width * height * header.pixel_bytes;
    if (size == 0 || size > unpacked || (!header.is_compressed && size != unpacked)) {
      fail(file, "some of its pixels take too many bytes, or too few");
    }
  }
}

Image decode_exr(const ImageFile& file, std::vector<float>* alpha_plane,
                 const ImageLimits& limits) {
  check_exr(file);
  const ExrHeader& header = *file.exr;
  const uint64_t pixels = uint64_t{header.width} * header.height;
  // The copy, which may lie in memory; three colours and alpha.
  const std::shared_ptr<void> memory =
      hold(limits.holder, file.bytes.size() + pixels * 4 * sizeof(float), file.path);
  Image image(header.width, header.height);
  std::vector<float> own(header.has_alpha ? static_cast<size_t>(pixels) : 0);
  decode(file, &image, &own);
  for (size_t i = 0; i < pixels; ++i) {
    float* rgb = &image.rgb[3 * i];
    // Colours are of the light that is there, and have been multiplied by alpha.
    const float alpha = header.has_alpha ? within(own[i]) : 1;
    for (size_t c = 0; c < 3; ++c) {
      rgb[c] = alpha > 0 ? shown(rgb[c] / alpha) : 0;
      if (alpha_plane == nullptr) rgb[c] *= alpha;
    }
    if (header.has_alpha) own[i] = alpha;
  }
  if (alpha_plane != nullptr) *alpha_plane = std::move(own);
  return image;
}

}  // namespace l4d::io

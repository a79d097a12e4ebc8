// SPDX-License-Identifier: Apache-2.0
#include "io/image/video.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <optional>
#include <system_error>
#include <utility>

#include "io/file/file.h"
#include "io/image/ffmpeg_process.h"
#include "io/image/nal_scan.h"
#include "io/image/packet_list.h"
#include "io/image/video_input.h"

namespace l4d::io {
namespace fs = std::filesystem;
namespace {

constexpr double kHalfFrame = 0.5;
// What may be read, whatever the file is called: containers that hold the frames themselves. Others
// (ffconcat, HLS, image2) are lists, with which a file would have others read.
constexpr const char* kContainers =
    "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,flv,ogg,yuv4mpegpipe";

// Without the scheme a name such as concat:a would be more than a name to ffmpeg.
std::string url_of(const std::string& path) { return "file:" + path; }

std::string decimal(double value) {
  char text[32];
  const auto result = std::to_chars(text, text + sizeof(text), value);
  return {text, result.ptr};
}

void check_size(const std::string& path, uint32_t width, uint32_t height) {
  if (width >= 1 && height >= 1 && width <= L4D_MAX_IMAGE_SIDE && height <= L4D_MAX_IMAGE_SIDE)
    return;
  throw Error(L4D_ERR_INVALID_ARGUMENT,
              path + ": a video has 1 to " + std::to_string(L4D_MAX_IMAGE_SIDE) + " pixels a side");
}

[[noreturn]] void fail(const std::string& path, const char* action, int error) {
  throw Error(L4D_ERR_IO, path + ": " + action + ": " + std::generic_category().message(error));
}

void check_file(const std::string& path) {
  std::error_code error;
  if (fs::is_regular_file(path, error)) return;
  fail(path, "cannot open the video", error ? error.value() : ENOENT);
}

void check(const FileError& error, const std::string& path) {
  if (!error.ok()) fail(path, error.action, error.error);
}

[[noreturn]] void fail_for_size(const std::string& path, uint32_t width, uint32_t height) {
  throw Error(L4D_ERR_CORRUPT, path + ": the frames are not of the camera's size, " +
                                   std::to_string(width) + " x " + std::to_string(height));
}

// How ffmpeg decodes a part of a video.
std::vector<std::string> arguments_of(const std::string& path, uint32_t width, uint32_t height,
                                      const VideoRange& range) {
  // Damage ends the frames: what ffmpeg would put in the place of a damaged one is no picture.
  std::vector<std::string> arguments = {"-xerror", "-err_detect:v", "explode"};
  if (range.first > 0) {
    arguments.insert(arguments.end(), {"-ss", decimal(range.seek)});
  }
  // PPM and not raw frames: it tells the size of each frame, so that a video of another size than
  // the camera's is an error and not a scrambled picture.
  const std::vector<std::string> input = input_of(path, width, height);
  arguments.insert(arguments.end(), input.begin(), input.end());
  // Each frame once: else ffmpeg fills gaps with copies of the frame before.
  arguments.insert(arguments.end(), {"-map", "0:v:0", "-vsync", "passthrough"});
  if (range.out_width != 0 && (range.out_width != width || range.out_height != height)) {
    const auto size = [](uint32_t w, uint32_t h) {
      return std::to_string(w) + ":" + std::to_string(h);
    };
    // Frames that are turned so that one side is shorter fail to be cropped, and are not squeezed.
    arguments.insert(arguments.end(),
                     {"-vf", "crop=" + size(width, height) + ":0:0:exact=1,scale=" +
                                 size(range.out_width, range.out_height) + ":flags=area"});
  }
  arguments.insert(arguments.end(), {"-f", "image2pipe", "-c:v", "ppm", "-pix_fmt", "rgb24", "-"});
  return arguments;
}

// Whether the boxes of an MP4 fill the file, and one of them lists the frames.
bool is_whole_mp4(const std::string& path) {
  std::error_code error;
  const uint64_t size = fs::file_size(path, error);
  std::ifstream file(path, std::ios::binary);
  const auto number = [&file](size_t bytes) {  // big-endian
    uint64_t value = 0;
    for (size_t k = 0; k < bytes; ++k) value = value << 8 | static_cast<uint8_t>(file.get());
    return value;
  };
  bool has_list = false;
  for (uint64_t at = 0; !error && at < size;) {
    file.seekg(static_cast<std::streamoff>(at));
    uint64_t bytes = number(4);
    char type[4];
    file.read(type, sizeof type);
    if (bytes == 1) bytes = number(8);
    if (!file || bytes < 8 || bytes > size - at) return false;
    has_list = has_list || std::memcmp(type, "moov", sizeof type) == 0;
    at += bytes;
  }
  return has_list;
}

}  // namespace

std::vector<std::string> input_of(const std::string& path, uint32_t width, uint32_t height) {
  constexpr uint64_t kPadding = 128;
  const uint64_t side = L4D_MAX_IMAGE_SIDE;
  const uint64_t pixels =
      ((width > 0 ? width : side) + kPadding) * ((height > 0 ? height : side) + kPadding);
  return {"-protocol_whitelist",  "file", "-format_whitelist", kContainers, "-max_pixels",
          std::to_string(pixels), "-i",   url_of(path)};
}

VideoFacts probe_video(const std::string& path, uint32_t width, uint32_t height) {
  check_file(path);
  const FileHandle list = anonymous_file();
  std::vector<std::string> arguments = input_of(path, width, height);
  for (const auto& [format, output] :
       {std::pair{"data", std::string("-")},
        std::pair{"framecrc", "pipe:" + std::to_string(FfmpegProcess::kExtra)}}) {
    for (const char* word : {"-map", "0:v:0", "-c", "copy", "-f", format}) {
      arguments.emplace_back(word);
    }
    arguments.push_back(output);
  }
  FfmpegProcess process(path, arguments, FfmpegProcess::Direction::kFrom, list.get());
  NalScan scan;
  std::vector<uint8_t> block(size_t{1} << 16);
  while (const size_t n = process.read(block.data(), block.size())) scan.add(block.data(), n);
  try {
    process.finish();
  } catch (const Error& error) {
    if (std::strstr(error.what(), "max pixel count") != nullptr) fail_for_size(path, width, height);
    throw;
  }
  const PacketList packets(path, list.get());
  const std::optional<uint64_t> damaged = scan.damaged_unit();
  if (damaged && packets.has_units()) packets.fail_at(*damaged);
  return packets.facts();
}

void check_video(const std::string& path, uint32_t width, uint32_t height) {
  const VideoFacts facts = probe_video(path, width, height);
  if (!has_size(path, facts, width, height)) fail_for_size(path, width, height);
  const double rate = facts.fps;
  size_t frame = 0;
  if (is_steady(facts.times, rate, kHalfFrame, &frame)) return;
  throw Error(L4D_ERR_CORRUPT, path + ": frame " + std::to_string(frame) + " comes at " +
                                   decimal(facts.times[frame]) + " s, and " + decimal(rate) +
                                   " frames a second have it at " +
                                   decimal(static_cast<double>(frame) / rate) + " s");
}

bool is_steady(const std::vector<double>& times, double fps, double off, size_t* first) {
  for (size_t k = 0; k < times.size(); ++k) {
    *first = k;
    if (std::abs(times[k] * fps - static_cast<double>(k)) >= off) return false;
  }
  return true;
}

bool has_size(const std::string& path, const VideoFacts& facts, uint32_t width, uint32_t height) {
  if (facts.width == width && facts.height == height) return true;
  if (facts.width != height || facts.height != width) return false;
  try {  // a decoder knows whether it is to be turned
    VideoReader reader(path, width, height);
    return reader.next(static_cast<Image*>(nullptr));
  } catch (const Error& error) {
    if (error.status() == L4D_ERR_CORRUPT) return false;
    throw;
  }
}

void decode_video(const std::string& path, uint32_t width, uint32_t height, uint32_t frames) {
  VideoRange whole;
  whole.is_video = true;
  VideoReader reader(path, width, height, whole);
  while (reader.next(static_cast<Image*>(nullptr))) {
  }
  if (reader.position() == frames) return;
  throw Error(L4D_ERR_CORRUPT, path + ": " + std::to_string(reader.position()) +
                                   " frames come out of its " + std::to_string(frames) +
                                   " coded frames");
}

VideoReader::VideoReader(const std::string& path, uint32_t width, uint32_t height)
    : VideoReader(path, width, height, VideoRange{}) {}

VideoReader::VideoReader(const std::string& path, uint32_t width, uint32_t height,
                         const VideoRange& range)
    : path_(path),
      width_(range.out_width != 0 ? range.out_width : width),
      height_(range.out_height != 0 ? range.out_height : height),
      is_video_(range.is_video),
      first_(range.first),
      position_(range.first) {
  check_size(path, width, height);
  check_size(path, width_, height_);
  check_file(path);
  if (range.first > 0 && !(range.seek > 0)) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                path + ": nothing says when frame " + std::to_string(range.first) + " comes");
  }
  arguments_ = arguments_of(path, width, height, range);
  may_turn_ = width != height;
  process_ = std::make_unique<FfmpegProcess>(path, arguments_, FfmpegProcess::Direction::kFrom);
  header_ = "P6\n" + std::to_string(width_) + " " + std::to_string(height_) + "\n255\n";
  frame_.resize(header_.size() + size_t{3} * width_ * height_);
}

VideoReader::~VideoReader() = default;
VideoReader::VideoReader(VideoReader&&) noexcept = default;
VideoReader& VideoReader::operator=(VideoReader&&) noexcept = default;

void VideoReader::finish() {
  try {
    process_->finish();
  } catch (const Error& error) {
    const std::string prefix = path_ + ": ";
    const std::string what = error.what();
    if (!is_video_ && position_ == first_) throw;
    throw Error(L4D_ERR_CORRUPT,
                prefix + "frame " + std::to_string(position_) +
                    " or one soon after it is damaged: " +
                    (what.rfind(prefix, 0) == 0 ? what.substr(prefix.size()) : what));
  }
}

bool VideoReader::fetch() {
  if (process_ == nullptr) return false;
  // The header first: where frames are smaller, a whole frame would be more than there is.
  size_t header_bytes = process_->read(frame_.data(), header_.size());
  const auto fits = [&] { return std::equal(header_.begin(), header_.end(), frame_.begin()); };
  if (may_turn_ && (header_bytes == 0 || !fits())) {
    // ffmpeg turns frames as the file says; the camera may see them as they are stored.
    arguments_.insert(arguments_.begin(), "-noautorotate");
    process_ = std::make_unique<FfmpegProcess>(path_, arguments_, FfmpegProcess::Direction::kFrom);
    header_bytes = process_->read(frame_.data(), header_.size());
  }
  may_turn_ = false;
  if (header_bytes == 0) {
    finish();
    process_.reset();
    return false;
  }
  if (!fits()) fail_for_size(path_, width_, height_);
  const size_t pixel_bytes = frame_.size() - header_.size();
  if (process_->read(&frame_[header_.size()], pixel_bytes) != pixel_bytes) {
    finish();
    throw Error(L4D_ERR_IO, path_ + ": ffmpeg stopped within frame " + std::to_string(position_));
  }
  ++position_;
  return true;
}

bool VideoReader::next(std::vector<uint8_t>* rgb) {
  if (!fetch()) return false;
  rgb->assign(frame_.begin() + static_cast<ptrdiff_t>(header_.size()), frame_.end());
  return true;
}

bool VideoReader::next(Image* image) {
  if (!fetch()) return false;
  if (image == nullptr) return true;
  if (image->width != width_ || image->height != height_) *image = Image(width_, height_);
  from_bytes(&frame_[header_.size()], frame_.size() - header_.size(), image->rgb.data());
  return true;
}

void VideoReader::read(uint32_t frame, Image* image) {
  if (frame < position_) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                path_ + ": frame " + std::to_string(frame) + " is already past");
  }
  while (position_ < frame && fetch()) {
  }
  if (position_ == frame && next(image)) return;
  throw Error(L4D_ERR_IO, path_ + ": there is no frame " + std::to_string(frame) +
                              "; the video ends after " + std::to_string(position_));
}

VideoWriter::VideoWriter(const std::string& path, uint32_t width, uint32_t height,
                         const VideoOptions& options)
    : path_(path), width_(width), height_(height) {
  check_size(path, width, height);
  if (!(std::isfinite(options.fps) && options.fps > 0) || options.crf > 51) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, path + ": the frame rate is above 0, crf is 0 to 51");
  }
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if ((fs::exists(status) && !fs::is_regular_file(status)) || descriptor_named(path) >= 0) {
    throw Error(L4D_ERR_IO, path + ": an .mp4 can only be written to a regular file");
  }
  check(file_.open(path.c_str()), path);
  const std::string size = std::to_string(width) + "x" + std::to_string(height);
  // ffmpeg opens the file itself, to go back in it.
  process_ = std::make_unique<FfmpegProcess>(
      path,
      std::vector<std::string>{
          "-f",
          "rawvideo",
          "-pix_fmt",
          "rgb24",
          "-video_size",
          size,
          "-framerate",
          decimal(options.fps),
          "-i",
          "pipe:0",
          "-vf",
          "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv",
          "-c:v",
          "libx264",
          "-crf",
          std::to_string(options.crf),
          "-pix_fmt",
          "yuv420p",
          "-colorspace",
          "bt709",
          "-color_primaries",
          "bt709",
          "-color_trc",
          "bt709",
          "-color_range",
          "tv",
          "-movflags",
          "+faststart",
          "-f",
          "mp4",
          "-y",
          url_of(file_.temporary_path())},
      FfmpegProcess::Direction::kTo);
  frame_.resize(size_t{3} * width * height);
}

VideoWriter::~VideoWriter() = default;

void VideoWriter::write(const Image& image) {
  if (process_ == nullptr) throw Error(L4D_ERR_INVALID_STATE, path_ + ": the video is finished");
  if (image.width != width_ || image.height != height_) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, path_ + ": a frame differs in size from the video");
  }
  to_bytes(image.rgb.data(), image.rgb.size(), frame_.data());
  process_->write(frame_.data(), frame_.size());
}

void VideoWriter::finish() {
  if (process_ == nullptr) throw Error(L4D_ERR_INVALID_STATE, path_ + ": the video is finished");
  const std::unique_ptr<FfmpegProcess> process = std::move(process_);
  process->finish();
  // On a full disk, ffmpeg may leave a part of the file and say that all went well.
  if (!is_whole_mp4(file_.temporary_path())) process->fail("ffmpeg wrote a part of the video");
  check(file_.commit(), path_);
}

}  // namespace l4d::io

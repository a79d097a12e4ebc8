// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "io/file/file.h"
#include "io/image/image.h"

namespace l4d::io {

// Videos are decoded and encoded by the program ffmpeg, found through PATH.

class FfmpegProcess;  // io/image/ffmpeg_process.h

// The files of a folder whose names end as those of videos do, in the order of their names, hidden
// ones left out. None where the folder cannot be read; "" is the folder at hand.
std::vector<std::filesystem::path> videos_in(const std::filesystem::path& folder);

// What a video says of itself without being decoded.
struct VideoFacts {
  uint32_t width = 0, height = 0;  // pixels, as they are stored
  uint32_t frames = 0;
  double fps = 0;  // of most frames: by the time between them; 0 = unknown
  // [frames] s after the first frame, in the order of showing; empty where the file says none.
  std::vector<double> times;
};
// Whether no frame is `off` frames or more from where a steady rate has it; if not, the first one.
// times: as of VideoFacts.
bool is_steady(const std::vector<double>& times, double fps, double off, size_t* first);
// Reads all packets, and decodes none. Throws Error(L4D_ERR_IO) where ffmpeg is missing or fails,
// and L4D_ERR_CORRUPT, which names the frame, where two frames have one time, or where packets of
// H.264 or H.265 have what no encoder writes (io/image/nal_scan.h).
// width, height: pixels that its frames should have, above which ffmpeg decodes none; 0 = any.
VideoFacts probe_video(const std::string& path, uint32_t width = 0, uint32_t height = 0);
// The same for what is about to be read as a video of width x height pixels, whose frames count and
// not their times: throws L4D_ERR_CORRUPT if it has another size, or where a frame, which it names,
// is half a frame or more from where the video's own rate has it.
void check_video(const std::string& path, uint32_t width, uint32_t height);
// Whether a reader of a video with such facts returns frames of this size: as it is stored, or
// turned, as phones have it turned.
bool has_size(const std::string& path, const VideoFacts& facts, uint32_t width, uint32_t height);
// Decodes all of a video that has this many frames, and keeps nothing. Throws as VideoReader does,
// and L4D_ERR_CORRUPT if another number of frames comes out.
void decode_video(const std::string& path, uint32_t width, uint32_t height, uint32_t frames);

// A part of a video, possibly at another size.
struct VideoRange {
  bool is_video = false;  // it was probed: if ffmpeg fails, frames are damaged
  uint32_t first = 0;     // frame
  double seek = 0;  // s: later than the frame before `first` and no later than `first`; as in times
  uint32_t out_width = 0, out_height = 0;  // pixels: frames are averaged by area; 0 = as they are
};

// The frames of a video in order, from the first on; turned as the file says, or, if only that is
// of the camera's size, as they are stored. Throws Error: L4D_ERR_IO where ffmpeg is missing or
// fails, with its words, as it does on what is no container of frames but a list of other files;
// L4D_ERR_CORRUPT where frames are not of the size that the camera has, and where the decoder finds
// damage, which ends the frames before it is concealed.
class VideoReader {
 public:
  VideoReader(const std::string& path, uint32_t width, uint32_t height);
  // From frame `range.first` on, which has that number in next() and read(). Nothing is decoded
  // before the last key frame ahead of it. A caller that wants another size has to know that the
  // video has width x height pixels: only the size of what ffmpeg returns is checked.
  VideoReader(const std::string& path, uint32_t width, uint32_t height, const VideoRange& range);
  ~VideoReader();
  VideoReader(VideoReader&&) noexcept;
  VideoReader& operator=(VideoReader&&) noexcept;

  // The next frame; false at the end of the video. Null passes it over without converting it.
  bool next(Image* image);
  // The same as 8-bit RGB, [height, width, 3].
  bool next(std::vector<uint8_t>* rgb);
  // Frame number `frame`, which must not lie before the next one. Throws where the video has fewer.
  void read(uint32_t frame, Image* image);
  uint32_t position() const { return position_; }  // number of the next frame

 private:
  bool fetch();  // the next frame into frame_; false at the end
  // Ends ffmpeg after its last byte; throws if it failed, with what that says of the frames.
  void finish();

  std::string path_;
  uint32_t width_, height_;  // of frames as they are returned
  bool is_video_ = false;
  bool may_turn_ = false;  // not known before the first frame
  std::vector<std::string> arguments_;
  uint32_t first_ = 0, position_ = 0;
  std::unique_ptr<FfmpegProcess> process_;  // null once the end was reached
  std::string header_;                      // that every frame must have
  std::vector<uint8_t> frame_;
};

struct VideoOptions {
  double fps = 30;
  uint32_t crf = 18;  // constant rate factor of H.264, 0 (lossless) to 51
};

// Writes H.264 in an .mp4 that plays everywhere (yuv420p; odd sizes get a black row or column). It
// appears under its name when finish() returns, and not at all without it.
class VideoWriter {
 public:
  VideoWriter(const std::string& path, uint32_t width, uint32_t height,
              const VideoOptions& options = {});
  ~VideoWriter();
  VideoWriter(const VideoWriter&) = delete;
  VideoWriter& operator=(const VideoWriter&) = delete;

  void write(const Image& image);
  void finish();

 private:
  std::string path_;  // as the caller named it, for messages
  AtomicFile file_;   // of which ffmpeg fills the temporary file
  uint32_t width_, height_;
  std::unique_ptr<FfmpegProcess> process_;  // ends before the file that it writes is removed
  std::vector<uint8_t> frame_;
};

}  // namespace l4d::io

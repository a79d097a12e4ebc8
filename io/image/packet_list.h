// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

#include "io/image/video.h"

namespace l4d::io {

// The packets of a video, as ffmpeg's framecrc lists them: "#codec_id 0: h264", "#tb 0: 1/15360",
// "#dimensions 0: 640x360", then a line for each: stream, dts, pts, duration, size, checksum.
class PacketList {
 public:
  // path: of the video, for messages. list: what ffmpeg wrote; it is read from its begin. Throws
  // L4D_ERR_CORRUPT if two frames have one time.
  PacketList(const std::string& path, std::FILE* list);

  const VideoFacts& facts() const { return facts_; }
  // Whether it is H.264 or H.265.
  bool has_units() const { return has_units_; }

  // Throws L4D_ERR_CORRUPT, which names the frame. byte: of all packets, one after the other.
  [[noreturn]] void fail_at(uint64_t byte) const;

 private:
  std::string path_;
  VideoFacts facts_;
  bool has_units_ = false;
  std::vector<int64_t> times_;   // by packet, in the order of coding
  std::vector<uint32_t> sizes_;  // bytes
};

}  // namespace l4d::io

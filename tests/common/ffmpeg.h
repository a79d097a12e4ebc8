// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "io/file/file.h"
#include "io/image/ffmpeg_process.h"

namespace l4d::test {

// Whether PATH has an ffmpeg that runs. Tests of videos are skipped without one.
inline bool ffmpeg_available() {
  try {
    io::FfmpegProcess process("", {"-version"}, io::FfmpegProcess::Direction::kFrom);
    char text[4096];
    while (process.read(text, sizeof(text)) > 0) {
    }
    process.finish();
    return true;
  } catch (const io::Error&) {
    return false;
  }
}

}  // namespace l4d::test

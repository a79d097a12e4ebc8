// SPDX-License-Identifier: Apache-2.0
// The command line of l4dtrain.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <utility>
#include <vector>

#include "training/footage/footage.h"
#include "training/run/protocol.h"
#include "training/run/report/render_capture.h"

namespace l4d::train {

// As those of l4dcodec (docs/cli.md).
enum ExitCode : int {
  kExitOk = 0,
  kExitUsage = 2,
  kExitIo = 3,
  kExitCorrupt = 4,
  kExitUnsupported = 5,
  kExitLimit = 6,
  kExitRuntime = 7,
  kExitCancelled = 130
};

// With what each means.
std::vector<std::pair<int, std::string>> exit_statuses();

struct Arguments {
  RunOptions run;
  std::string limit_memory, host_memory = "8G", device_memory = "auto", bucket_memory = "8G";
  std::string cache_limit = "64G";
  std::string near = "auto", opacity_weight = "auto", refine_times = "auto", background = "black";
  std::string size, bitrate;  // of the stream
  std::string sheet;
  std::string page;            // of HTML with the scores of eval; "" = none
  std::string cameras_out;     // of the cameras with their clocks; "" = none
  std::string folder;          // of a run that is evaluated, or for a capture that is rendered
  std::string protocol, data;  // of bench
  std::string moved;           // the capture of a run that is evaluated, where it is elsewhere now
  std::string scene;           // that a capture is rendered of
  std::string image_size = "320x240", cameras = "16";
  RenderCaptureOptions capture;
  FootageOptions footage;
  bool json = false, quiet = false;
};

// All verbs. Each has arguments of its own.
struct Command {
  Command();
  Command(const Command&) = delete;
  Command& operator=(const Command&) = delete;

  CLI::App app;
  Arguments training, evaluation, inspection, synchronisation, capture, bench;
};

}  // namespace l4d::train

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "l4d/render.hpp"
#include "training/images/loader.h"
#include "training/run/report/run_report.h"
#include "training/run/setup/run_options.h"

namespace l4d::train {

std::string json_of(const RunReport& report);

// Scores the scene of a run, and its stream if there is one, against its capture. moved: where the
// capture is now, or "" where it is as the run has it. Of the options, lpips, background,
// scored_instants and threads count. page: a file of HTML to write as well; "" = none.
RunReport evaluate_run(const std::string& folder, const std::string& moved,
                       const RunOptions& options, const std::string& page, RunObserver* observer);

// The part of a report that follows from the capture alone.
RunReport describe_capture(const Capture& capture, const ImageLoader& loader);

// What is said where the stream shows training views much worse than the scene; "" where it does
// not. settles: the training had the encoder in its loop.
std::string note_of_stream(double scene_psnr, double stream_psnr, bool settles);

std::string json_of(const Settings& settings);
Settings settings_of(const std::string& json);  // throws io::Error(CORRUPT)
// Those of the run in a folder; nothing where it has none. Throws io::Error.
std::optional<Settings> settings_in(const std::string& folder);

// Views of a capture, rendered from a stream.
class StreamViews {
 public:
  StreamViews(const std::string& path, const Capture& capture, const ImageLoader& loader,
              const Colour& background, const l4d_renderer_options& rendering);
  io::Image render(uint32_t view);

 private:
  const Capture& capture_;
  const ImageLoader& loader_;
  DecoderHandle decoder_;
  RendererHandle renderer_;
};

}  // namespace l4d::train

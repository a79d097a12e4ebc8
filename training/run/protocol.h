// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "training/run/run.h"

// Trainings of all scenes of a data set, as papers have them in a table.
namespace l4d::train {

struct Protocol {
  std::string name;
  uint32_t width = 0;  // of images, pixels, to which larger ones are scaled; 0 = as they are
  std::string frames;  // as CaptureOptions has them
  Colour background{};
};
// "n3dv", "selfcap", "hypernerf", "dnerf". Throws io::Error(INVALID_ARGUMENT) for other names.
Protocol protocol_of(const std::string& name);

struct ProtocolScene {
  std::string name;
  RunReport report;
};

// Trains each folder of `data` that is a capture, or `data` itself, in a folder of its name in
// `runs`, and scores all test images. A run that has ended there is scored again and not trained.
// Of the options, all but the capture, its reading, the scale, the folder and what scores take
// count. Throws as train().
std::vector<ProtocolScene> run_protocol(const Protocol& protocol, const std::string& data,
                                        const std::string& runs, RunOptions options,
                                        RunObserver* observer);

// Rows of Markdown: each scene and the mean, of the scene and of its stream.
std::string table_of(const std::vector<ProtocolScene>& scenes);

}  // namespace l4d::train

// SPDX-License-Identifier: Apache-2.0
// The log as TensorBoard reads it: events of scalars, as protocol buffers in TFRecord frames.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "training/run/record/log.h"

namespace l4d::train {

// A scalar of a moment: "psnr/test", 28.1.
using Scalars = std::vector<std::pair<std::string, double>>;

// What an entry of the log has; numbers that are not finite are left out.
Scalars scalars_of(const LogEntry& entry);

// One event in its frame: length, checksum, bytes, checksum. wall_time: s since 1970.
std::string event_record(double wall_time, uint64_t step, const Scalars& scalars);
// The first record of a file.
std::string version_record(double wall_time);

// RUN/events.out.tfevents.l4dtrain. A run that resumes writes it again from the log.
class EventFile {
 public:
  // `kept`: entries of the run before it was interrupted.
  EventFile(const std::string& path, const std::vector<LogEntry>& kept);
  void add(const LogEntry& entry);

 private:
  std::string path_;
};

}  // namespace l4d::train

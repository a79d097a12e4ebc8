// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <thread>
#include <vector>

#include "training/model/state.h"
#include "training/run/train/trainer.h"

namespace l4d::train {

// All that a training needs to go on.
struct Checkpoint {
  std::string settings;  // text_of(Settings)
  RunState run;
  ModelState model;
};

// Named arrays with a checksum each. See checkpoint.cc for the layout.
std::vector<uint8_t> pack_checkpoint(const Checkpoint& checkpoint);
// name: of the file, for messages. Throws io::Error(CORRUPT) that names the array or the byte that
// is wrong; nothing is allocated that the file does not hold.
Checkpoint unpack_checkpoint(const std::string& name, const std::vector<uint8_t>& bytes);

// The checkpoints in a folder, newest first.
std::vector<std::string> list_checkpoints(const std::string& folder);
// The newest one that is right: where one is not, that is noted, and it stays. Throws
// io::Error(CORRUPT) where none is.
Checkpoint newest_checkpoint(const std::string& folder, std::vector<std::string>* notes);
// Throws io::Error(INVALID_ARGUMENT) where a run cannot go on from the checkpoint: it is of other
// settings, or the capture has other cameras.
void check_resumes(const std::string& folder, const Checkpoint& checkpoint,
                   const Settings& settings, const Capture& capture, bool accept_changes);

// What a run that fails says of them: "--resume goes on from" the newest, or that there is none.
std::string where_it_goes_on(const std::string& folder);

// Writes checkpoints of a run on a thread, under a temporary name until they are whole, and keeps
// the newest two.
class CheckpointWriter {
 public:
  explicit CheckpointWriter(std::string folder) : folder_(std::move(folder)) {}
  ~CheckpointWriter();
  CheckpointWriter(const CheckpointWriter&) = delete;
  CheckpointWriter& operator=(const CheckpointWriter&) = delete;

  // Waits for the one before. Throws io::Error where that failed.
  void write(const Checkpoint& checkpoint);
  void finish();  // waits; throws likewise

 private:
  std::string folder_;
  std::thread thread_;
  std::string error_;
};

}  // namespace l4d::train

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "training/run/setup/run_options.h"

namespace l4d::train {

// A path that means the same from any folder, and whichever way it was written.
std::string absolute_path(const std::string& path);

// Whether a folder has nothing in it, or does not exist. What FolderLock leaves does not count,
// nor what a training leaves that was killed before its first step.
bool is_empty_folder(const std::string& folder);

// Whether a run of ours wrote to the folder: it has settings, a report or a checkpoint of one.
// Other files by the same names, which captures and other programs also have, do not make a run.
bool is_run(const std::string& folder);

// Refuses what the run may not write to, and changes nothing. Throws io::Error.
void check_folder(const RunOptions& options);

// Removes the checkpoints and results of a run, before another takes its place.
void remove_results(const std::string& folder);

// Keeps other trainings out of a folder for as long as it lives.
class FolderLock {
 public:
  // Makes the folder where there is none, which then goes away if nothing is written to it. Throws
  // io::Error where another training has the folder.
  explicit FolderLock(const std::string& folder);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  std::string folder_, path_;
  bool is_new_ = false;
  int file_ = -1;
};

}  // namespace l4d::train

// SPDX-License-Identifier: Apache-2.0
// The pieces of a scene that `encode --live` codes, in their order.
#pragma once

#include <deque>
#include <set>
#include <string>
#include <vector>

#include "cli/command/context.h"
#include "cli/input/files.h"

namespace l4d::cli {

// Scenes that are named, or a folder in which they appear.
class LivePieces {
 public:
  // output: what comes to lie in the folder of pieces under this name is none.
  LivePieces(Context& context, const std::vector<std::string>& inputs, const std::string& output);

  bool is_folder() const { return !folder_.empty(); }
  // Whether there is nothing but this scene, so that its end is the end.
  bool is_one() const { return !is_folder() && inputs_.size() == 1; }

  // Waits for the next piece of a folder. Null after the last.
  const Input* next();

 private:
  void keep_pieces();
  std::string first_after();
  bool is_piece(const std::string& name);

  Context& context_;
  std::string folder_;
  std::string output_name_;  // if it lies there
  std::deque<Input> inputs_;
  size_t next_ = 0;
  std::string last_;  // of the folder, that was taken
  std::set<std::string> taken_;
  std::set<std::string> passed_;  // that are no files or came too late
};

}  // namespace l4d::cli

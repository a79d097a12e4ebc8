// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/encode/live_pieces.h"

#include <chrono>
#include <filesystem>
#include <thread>

#include "cli/command/progress.h"
#include "cli/text/name_order.h"

namespace l4d::cli {
namespace {

namespace fs = std::filesystem;

constexpr const char* kEnd = "end";  // of a folder: no more pieces come
constexpr std::chrono::milliseconds kLookAgain{50};

bool has_name_of_piece(const fs::path& path) {
  const std::string extension = path.extension().string();
  return path.filename().string().front() != '.' && (extension == ".ply" || extension == ".l4d");
}

}  // namespace

LivePieces::LivePieces(Context& context, const std::vector<std::string>& inputs,
                       const std::string& output)
    : context_(context) {
  std::error_code error;
  if (inputs.size() == 1 && fs::is_directory(inputs.front(), error)) {
    folder_ = inputs.front();
    const bool same = fs::equivalent(folder_, fs::absolute(output).parent_path(), error);
    if (same && !error) output_name_ = fs::path(output).filename().string();
    keep_pieces();
    return;
  }
  for (const std::string& name : inputs) inputs_.emplace_back(context, name);
}

const Input* LivePieces::next() {
  if (!is_folder()) return next_ < inputs_.size() ? &inputs_[next_++] : nullptr;
  for (;;) {
    check_interrupt();
    // Before the look at the pieces: all of them are there if this is.
    const bool ended = fs::exists(fs::path(folder_) / kEnd);
    const std::string found = first_after();
    if (!found.empty()) {
      last_ = found;
      taken_.insert(found);
      inputs_.clear();
      inputs_.emplace_back(context_, (fs::path(folder_) / found).string());
      return &inputs_.back();
    }
    if (ended) return nullptr;
    std::this_thread::sleep_for(kLookAgain);
  }
}

// No output takes the place of a piece that is there, also not with --force.
void LivePieces::keep_pieces() {
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_, error)) {
    if (!has_name_of_piece(entry.path()) || !entry.is_regular_file(error)) continue;
    context_.files.keep(entry.path().string(), "a piece of the input");
  }
}

// A folder or a link that leads nowhere may have the name of a piece; it may be one later.
bool LivePieces::is_piece(const std::string& name) {
  if (!has_name_of_piece(name) || name == output_name_ || taken_.count(name) != 0) return false;
  const std::string path = (fs::path(folder_) / name).string();
  std::error_code error;
  const bool is_file = fs::is_regular_file(path, error);
  if (is_file && (last_.empty() || name_is_before(last_, name))) return true;
  if (passed_.insert(name).second) {
    context_.note(path + (is_file ? " came after " + last_ + ", and is passed over"
                                  : " is no file, and is passed over"));
  }
  return false;
}

// The first name of a piece that sorts behind the last one taken; "" if there is none.
std::string LivePieces::first_after() {
  std::string first;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_, error)) {
    const std::string name = entry.path().filename().string();
    if (is_piece(name) && (first.empty() || name_is_before(name, first))) first = name;
  }
  if (error) throw Failure(L4D_ERR_IO, folder_ + ": cannot read: " + error.message());
  return first;
}

}  // namespace l4d::cli

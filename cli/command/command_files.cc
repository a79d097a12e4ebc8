// SPDX-License-Identifier: Apache-2.0
#include "cli/command/command_files.h"

#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "cli/command/context.h"

namespace l4d::cli {

void CommandFiles::add(const std::string& path, const Entry& entry) {
  const std::optional<io::FileId> id = io::identify(path);
  if (!id) return;
  const auto [known, is_new] = entries_.emplace(*id, entry);
  if (is_new || (!known->second.is_output && !entry.is_output)) return;
  throw usage_error(path + ": " + known->second.what + " and " + entry.what + " are the same file");
}

void CommandFiles::add_input(const std::string& path, const std::string& what) {
  if (path == "-") return add("/dev/stdin", {what, false});
  if (::access(path.c_str(), R_OK) != 0) {
    const bool is_pattern = errno == ENOENT && path.find_first_of("%*") != std::string::npos;
    throw Failure(L4D_ERR_IO, path + ": cannot open: " + std::strerror(errno) +
                                  (is_pattern ? "; `encode` and `convert` make a stream of the "
                                                "frames that a pattern names"
                                              : ""));
  }
  add(path, {what, false});
  // A writer of the name without the ending would take this file for what a dead one left.
  const std::string target = target_of_temporary(path);
  if (!target.empty()) add(target, {what + " (by its name a temporary file of it)", false});
}

void CommandFiles::add_output(const std::string& path, const std::string& what) {
  add(path == "-" ? "/dev/stdout" : path, {what, true});
}

}  // namespace l4d::cli

// SPDX-License-Identifier: Apache-2.0
// What ends a command early, and the exit status that it gives.
#pragma once

#include <stdexcept>
#include <string>
#include <utility>

#include "l4d/l4d.h"

namespace l4d::cli {

// Documented in docs/cli.md; scripts depend on them.
enum ExitCode : int {
  kExitOk = 0,
  kExitNo = 1,  // the answer is no: invalid stream, scenes differ
  kExitUsage = 2,
  kExitIo = 3,
  kExitCorrupt = 4,
  kExitUnsupported = 5,
  kExitLimit = 6,
  kExitRuntime = 7,
  kExitCancelled = 130
};
ExitCode exit_code_of(l4d_status status);

// What ends a command early. `name` is stable and for scripts, what() is for people.
class Failure : public std::runtime_error {
 public:
  Failure(ExitCode code, std::string name, const std::string& detail)
      : std::runtime_error(detail), code_(code), name_(std::move(name)) {}
  Failure(l4d_status status, const std::string& detail)
      : Failure(exit_code_of(status), l4d_status_name(status), detail) {}
  ExitCode code() const { return code_; }
  const std::string& name() const { return name_; }

 private:
  ExitCode code_;
  std::string name_;
};
Failure usage_error(const std::string& detail);
bool has_renderer();
// Throws a Failure (L4D_ERR_FEATURE_UNSUPPORTED) in a build without the renderer, which `what`
// needs.
void require_renderer(const std::string& what);
// The exception being handled, as a Failure whose detail begins with `subject`: a file, mostly.
// Library messages say what is wrong, and rarely with which of several files.
Failure current_failure(const std::string& subject);

template <typename Body>
auto about(const std::string& subject, const Body& body) {
  try {
    return body();
  } catch (...) {
    throw current_failure(subject);
  }
}

}  // namespace l4d::cli

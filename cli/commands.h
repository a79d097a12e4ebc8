// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "cli/command/context.h"

namespace l4d::cli {

// The whole command line: parsing it leaves in `registry` what to run.
struct CommandLine {
  CommandLine();
  ~CommandLine();
  CommandLine(const CommandLine&) = delete;
  CommandLine& operator=(const CommandLine&) = delete;

  std::unique_ptr<CLI::App> app;
  Context context;
  Registry registry;
};

struct ExitStatus {
  ExitCode code;
  const char* brief;
  const char* meaning;  // a sentence or more
};
const std::vector<ExitStatus>& exit_statuses();

}  // namespace l4d::cli

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "cli/command/command_files.h"
#include "cli/command/failure.h"
#include "cli/command/options.h"
#include "cli/command/process_group.h"
#include "cli/text/json.h"
#include "io/file/memory.h"
#include "io/scene/scene.h"
#include "l4d/l4d.hpp"

namespace l4d::cli {

// Options that every verb has.
struct CommonOptions {
  bool json = false;
  bool quiet = false;
  bool force = false;
  uint32_t threads = 0;
  std::string backend = "auto";
  std::string progress = "auto";
  std::string limit_memory;
};

// Result of a verb: both forms of the answer, of which main prints one.
struct Outcome {
  Json json = Json::object();
  std::string text;
  ExitCode code = kExitOk;
  bool stdout_is_data = false;     // the text then goes to stderr
  bool text_is_asked_for = false;  // it is printed with --quiet too
};

class Context {
 public:
  CommonOptions options;
  CommandFiles files;

  // A remark on what was done, for people and, in a list, for --json.
  void note(const std::string& text);
  const std::vector<std::string>& notes() const { return notes_; }

  // Throws usage errors of the common options.
  void check_options() const;
  uint32_t backend() const;  // L4D_BACKEND_*
  const ProcessGroup& group() const { return group_; }
  // share: what part of --limit-memory one of these decoders may take. A command that makes
  // something of a stream keeps half of the limit for that.
  l4d_decoder_options decoder_options(uint32_t share = 2) const;
  // A quarter of the limit for the renderers of a command, or less for one of several; 0 = no
  // limit.
  uint64_t renderer_memory(uint32_t renderers = 1) const;
  // An eighth of the limit for the Gaussians that a session keeps; 0 = no limit.
  uint64_t session_memory() const;
  // A sixteenth of the limit for renders of a scene that are kept; none: most_bytes.
  uint64_t render_memory(uint64_t most_bytes) const;
  // An eighth of the limit for captured images that are in memory together; 0 = no limit.
  uint64_t captured_memory() const;
  // The half of the limit that is not for decoding. From it is taken what a command holds, itself
  // or through a renderer, because of its input, before it is allocated.
  const io::MemoryBudget& budget();

 private:
  uint64_t memory_limit() const;  // 0 = none was given
  std::vector<std::string> notes_;
  ProcessGroup group_;
  std::optional<io::MemoryBudget> budget_;
};

// A verb adds its subcommand and stores here what to run once the whole line is parsed.
struct Registry {
  CLI::App* app;
  Context* context;
  std::function<Outcome()> run;
  std::string verb;
  std::deque<Verb> verbs;
};
// Subcommand; `run` is called when it was chosen.
Verb* add_verb(Registry& registry, const std::string& name, const std::string& description,
               std::function<Outcome(Context&)> run);

// Called last for each verb, so that help shows them last.
void add_common_options(Verb* verb, CommonOptions& options);

}  // namespace l4d::cli

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "cli/command_files.h"
#include "cli/options.h"
#include "cli/process_group.h"
#include "cli/text/json.h"
#include "io/file/memory.h"
#include "io/scene/scene.h"
#include "l4d/l4d.hpp"

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

void add_version(Registry& registry);
void add_encode(Registry& registry);
void add_decode(Registry& registry);
void add_convert(Registry& registry);
void add_info(Registry& registry);
void add_slice(Registry& registry);
void add_validate(Registry& registry);
void add_compare(Registry& registry);
void add_render(Registry& registry);
void add_sensitivity(Registry& registry);
void add_synth(Registry& registry);
void add_concat(Registry& registry);
void add_cut(Registry& registry);
void add_repair(Registry& registry);
void add_remux(Registry& registry);
void add_manifest(Registry& registry);
void add_sign(Registry& registry);
void add_keygen(Registry& registry);

}  // namespace l4d::cli

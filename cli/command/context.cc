// SPDX-License-Identifier: Apache-2.0
#include "cli/command/context.h"

#include <algorithm>
#include <cstdio>

#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/text/units.h"
#include "l4d/cuda.h"

namespace l4d::cli {

void Context::note(const std::string& text) {
  // Once, where a command reads a file twice.
  if (std::find(notes_.begin(), notes_.end(), text) != notes_.end()) return;
  notes_.push_back(text);
  if (!options.json && !options.quiet && !group_.helps())
    std::fprintf(stderr, "note: %s\n", text.c_str());
}

void Context::check_options() const {
  if (options.limit_memory.empty()) return;
  if (parse_size(options.limit_memory, "--limit-memory") == 0) {
    throw usage_error("--limit-memory must be positive");
  }
}

uint32_t Context::backend() const {
  return options.backend == "reference" ? L4D_BACKEND_REFERENCE
         : options.backend == "cpu"     ? L4D_BACKEND_CPU
         : options.backend == "cuda"    ? L4D_BACKEND_CUDA
                                        : L4D_BACKEND_AUTO;
}

uint64_t Context::memory_limit() const {
  return options.limit_memory.empty() ? 0 : parse_size(options.limit_memory, "--limit-memory");
}

uint64_t Context::renderer_memory(uint32_t renderers) const {
  const uint64_t limit = memory_limit();
  return limit == 0 ? 0 : std::max<uint64_t>(1, limit / 4 / renderers);
}

uint64_t Context::session_memory() const {
  const uint64_t limit = memory_limit();
  return limit == 0 ? 0 : std::max<uint64_t>(1, limit / 8);
}

uint64_t Context::render_memory(uint64_t most_bytes) const {
  const uint64_t limit = memory_limit();
  return limit == 0 ? most_bytes : std::min(most_bytes, limit / 16);
}

uint64_t Context::captured_memory() const {
  const uint64_t limit = memory_limit();
  return limit == 0 ? 0 : std::max<uint64_t>(1, limit / 8);
}

const io::MemoryBudget& Context::budget() {
  if (!budget_) {
    const uint64_t limit = memory_limit();
    budget_.emplace("half of --limit-memory", limit == 0 ? 0 : std::max<uint64_t>(1, limit / 2));
  }
  return *budget_;
}

l4d_decoder_options Context::decoder_options(uint32_t share) const {
  l4d_decoder_options o = L4D_INIT(l4d_decoder_options);
  o.threads = options.threads;
  o.backend = backend();
  const uint64_t limit = memory_limit();
  if (limit > 0) o.max_memory_bytes = std::max<uint64_t>(1, limit / share);
  return o;
}

void add_common_options(Verb* verb, CommonOptions& o) {
  const std::string group = "Common options";
  verb->add_flag("--json", o.json, "One JSON document on stdout and nothing else")->group(group);
  verb->add_flag("-q,--quiet", o.quiet, "Print errors only")->group(group);
  verb->add_flag("-f,--force", o.force, "Overwrite existing output")->group(group);
  verb->add_option("-t,--threads", o.threads, "Threads, 0 = one per core; never changes the output")
      ->type_name("N")
      ->whole_number(0, 4096)
      ->group(group);
  verb->add_option(
          "--backend", o.backend,
          "What works: auto, reference, cpu, cuda; changes no stream and no decoded bit, of "
          "images and weights the rounding")
      ->type_name("NAME")
      ->one_of({"auto", "reference", "cpu", "cuda"})
      ->group(group);
  verb->add_option("--limit-memory", o.limit_memory,
                   "Memory that input may make the command take, as 4GiB: half of it to decode "
                   "streams, half for all else that is read and what is made of it (default: 16GiB "
                   "to decode)")
      ->type_name("SIZE")
      ->group(group);
  verb->add_option("--progress", o.progress,
                   "Progress on stderr: auto (a line where it is a terminal), plain, json, none")
      ->type_name("FORM")
      ->one_of({"auto", "plain", "json", "none"})
      ->group(group);
}

namespace {

void require_device() {
  l4d_cuda_device_info info = L4D_INIT(l4d_cuda_device_info);
  const l4d_status status = l4d_cuda_get_device_info(0, &info);
  if (status == L4D_ERR_FEATURE_UNSUPPORTED) {
    throw Failure(status, "this build has no CUDA backend; use --backend auto, reference or cpu");
  }
  if (status != L4D_OK) {
    throw Failure(
        L4D_ERR_DEVICE,
        "there is no CUDA device, or no driver for it; use --backend auto, reference or cpu");
  }
  if (info.usable == 0) {
    throw Failure(L4D_ERR_DEVICE,
                  format("%s, of compute capability %u.%u, is none that this build has "
                         "code for; use --backend auto, reference or cpu",
                         info.name, info.compute_major, info.compute_minor));
  }
}

}  // namespace

Verb* add_verb(Registry& registry, const std::string& name, const std::string& description,
               std::function<Outcome(Context&)> run) {
  Context* context = registry.context;
  Verb& verb = registry.verbs.emplace_back(*registry.app, name, description);
  verb.when_chosen([&registry, context, name, run = std::move(run)] {
    registry.verb = name;
    registry.run = [context, run] {
      context->check_options();
      if (context->options.backend == "cuda") require_device();
      return run(*context);
    };
  });
  return &verb;
}

}  // namespace l4d::cli

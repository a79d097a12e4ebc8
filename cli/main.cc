// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <new>
#include <sstream>
#include <string_view>

#include "cli/command/progress.h"
#include "cli/commands.h"
#include "cli/text/units.h"

namespace l4d::cli {
namespace {

// Levenshtein distance, for "did you mean".
size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<size_t> row(b.size() + 1);
  for (size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (size_t i = 1; i <= a.size(); ++i) {
    size_t diagonal = row[0];
    row[0] = i;
    for (size_t j = 1; j <= b.size(); ++j) {
      const size_t above = row[j];
      row[j] = std::min({above + 1, row[j - 1] + 1, diagonal + (a[i - 1] != b[j - 1])});
      diagonal = above;
    }
  }
  return row[b.size()];
}

std::string suggestion(const std::string& given, const std::vector<std::string>& known) {
  std::string best;
  // A third of the letters may be wrong; beyond that a suggestion is noise.
  size_t best_distance = given.size() / 3 + 1;
  for (const std::string& name : known) {
    const size_t distance = edit_distance(given, name);
    if (distance < best_distance || (distance == best_distance && best.empty())) {
      best = name;
      best_distance = distance;
    }
  }
  return best.empty() ? "" : "; did you mean " + best + "?";
}

// What no option and no argument of the verb takes; "" if there is none.
std::string describe_stray(const CLI::App& app, const CLI::App* verb, bool options_alone) {
  std::string given;
  for (const std::string& token : app.remaining(true)) {
    if (token.empty() && !options_alone) return "an argument is empty";
    if (token.empty() || token == "--") continue;
    if (given.empty() || token[0] == '-') given = token;
    if (given[0] == '-') break;
  }
  if (given.empty() || (options_alone && given[0] != '-')) return "";
  std::vector<std::string> known;
  if (given[0] == '-') {
    given = given.substr(0, given.find('='));
    if (verb != nullptr) {
      for (const CLI::Option* option : verb->get_options()) {
        for (const std::string& name : option->get_lnames()) known.push_back("--" + name);
      }
    }
    if (std::find(known.begin(), known.end(), given) != known.end()) {
      return "the option " + given + " belongs behind the command " + verb->get_name();
    }
    return "unknown option " + given + suggestion(given, known);
  }
  if (verb != nullptr) return "unexpected argument '" + given + "'";
  for (const CLI::App* each : app.get_subcommands(nullptr)) known.push_back(each->get_name());
  return "unknown command '" + given + "'" + suggestion(given, known);
}

// What CLI11 says, in our words where ours are better.
std::string describe_usage_error(const CLI::ParseError& error, const CLI::App& app,
                                 const CLI::App* verb) {
  // What is missing may be what a slip in the name of an option takes away.
  const bool is_extra = dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr;
  const std::string stray = describe_stray(app, verb, !is_extra);
  if (!stray.empty()) return stray;
  if (dynamic_cast<const CLI::ArgumentMismatch*>(&error) != nullptr) {
    // "--seed: At Most 1 required but received 2"
    const std::string words = error.what();
    const size_t at = words.find(": At Most 1 required but received ");
    const size_t times = words.rfind(' ');
    if (at != std::string::npos) {
      return words.substr(0, at) + ": given" + words.substr(times) + " times, takes one value";
    }
  }
  return error.what();
}

void print_document(const Json& document) {
  const std::string text = document.dump(2);
  std::fwrite(text.data(), 1, text.size(), stdout);
  std::fputc('\n', stdout);
}

int report_failure(const Failure& failure, bool json, const std::string& verb) {
  // Whatever a call made of it, the cause of its failure was the user's Ctrl-C.
  const bool cancelled = interrupted();
  const ExitCode code = cancelled ? kExitCancelled : failure.code();
  const std::string name = cancelled ? l4d_status_name(L4D_ERR_CANCELLED) : failure.name();
  const std::string detail = cancelled ? "cancelled" : failure.what();
  if (json) {
    print_document(
        {{"schema", "l4dcodec.error/1"},
         {"error", {{"code", static_cast<int>(code)}, {"name", name}, {"message", detail}}}});
  } else if (code == kExitUsage) {
    std::fprintf(stderr, "l4dcodec: %s\nsee l4dcodec %s%s--help\n", detail.c_str(), verb.c_str(),
                 verb.empty() ? "" : " ");
  } else {
    std::fprintf(stderr, "l4dcodec: %s\n", detail.c_str());
  }
  std::fflush(stdout);
  return code;
}

// Whether all that was printed has arrived; says so where it has not.
bool flush_stdout() {
  errno = 0;
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0) return true;
  // What failed before left no errno.
  std::fprintf(stderr, "l4dcodec: stdout: cannot write: %s\n",
               std::strerror(errno != 0 ? errno : EIO));
  return false;
}

int print_outcome(Outcome& outcome, const Context& context) {
  if (context.options.json) {
    outcome.json["notes"] = context.notes();
    print_document(outcome.json);
  } else if (!context.options.quiet || outcome.text_is_asked_for) {
    std::fputs(outcome.text.c_str(), outcome.stdout_is_data ? stderr : stdout);
  }
  return flush_stdout() ? outcome.code : kExitIo;
}

// A variable of a script that is not set must not pass for an option that is not given.
void refuse_empty_values(const CLI::App& verb) {
  for (const CLI::Option* option : verb.get_options()) {
    for (const std::string& value : option->results()) {
      if (value.empty()) throw usage_error(option->get_name() + ": the value is empty");
    }
  }
}

// A file that is opened while one of the standard streams is closed would take its place, and be
// given what the stream is meant to get. What takes the place here fails to be read or written.
void fill_standard_streams() {
  for (const int fd : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    if (::fcntl(fd, F_GETFD) >= 0 || errno != EBADF) continue;
    // The lowest free number, which is this one.
    if (::open("/dev/null", fd == STDIN_FILENO ? O_WRONLY : O_RDONLY) != fd) std::_Exit(kExitIo);
  }
}

// Decoder and renderer name the share of the limit that they were given.
Failure with_limit(Failure failure, const Context& context) {
  const std::string option = "--limit-memory";
  const std::string& given = context.options.limit_memory;
  if (failure.code() != kExitLimit || given.empty()) return failure;
  const std::string message = failure.what();
  if (message.find(option) != std::string::npos) return failure;
  return Failure(failure.code(), failure.name(), message + ", a share of " + option + " " + given);
}

int run(int argc, char** argv) {
  std::vector<std::string> words(argv + std::min(argc, 1), argv + argc);
  const bool json = std::find(words.begin(), words.end(), "--json") != words.end();
  // "help", "help encode": the forms people try first.
  if (!words.empty() && words[0] == "help") {
    words.erase(words.begin());
    words.push_back("--help");
  } else if (!words.empty() && words[0] == "--version") {
    words[0] = "version";
  }
  CommandLine line;
  CLI::App& app = *line.app;
  Context& context = line.context;
  Registry& registry = line.registry;

  try {
    // CLI11 takes them last first.
    std::reverse(words.begin(), words.end());
    app.parse(words);
    if (!registry.run) throw usage_error("no command given");
    refuse_empty_values(*app.get_subcommands()[0]);
  } catch (const CLI::Success& help) {
    std::ostringstream text, error;
    const int status = app.exit(help, text, error);
    std::fputs(text.str().c_str(), stdout);
    return !flush_stdout() ? kExitIo : status == 0 ? kExitOk : kExitUsage;
  } catch (const CLI::ParseError& error) {
    const std::vector<CLI::App*> chosen = app.get_subcommands();
    const CLI::App* verb = chosen.empty() ? nullptr : chosen[0];
    return report_failure(usage_error(describe_usage_error(error, app, verb)), json,
                          verb == nullptr ? "" : verb->get_name());
  } catch (const Failure& failure) {
    return report_failure(failure, json, registry.verb);
  }
  const bool helps = context.group().helps();
  // What one rank does alone is not done again by the others.
  if (helps && registry.verb != "encode" && registry.verb != "sensitivity") return kExitOk;
  try {
    install_interrupt_handler();
    context.files.add_output("-", "stdout");
    Outcome outcome = registry.run();
    return helps ? static_cast<int>(kExitOk) : print_outcome(outcome, context);
  } catch (...) {
    const int code = report_failure(with_limit(current_failure(""), context), json, registry.verb);
    context.group().abort(code);
    return code;
  }
}

}  // namespace
}  // namespace l4d::cli

int main(int argc, char** argv) {
  try {
    l4d::cli::fill_standard_streams();
    // A reader that goes away must not end the tool before it has removed what it began.
    std::signal(SIGPIPE, SIG_IGN);
    std::signal(SIGXFSZ, SIG_IGN);  // nor a file that gets larger than `ulimit -f` allows
    return l4d::cli::run(argc, argv);
  } catch (const std::bad_alloc&) {
    std::fputs("l4dcodec: out of memory\n", stderr);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "l4dcodec: %s\n", error.what());
  }
  return l4d::cli::kExitRuntime;
}

// SPDX-License-Identifier: Apache-2.0
// serve and view: files over HTTP to a browser at this machine.

#include <fcntl.h>
#include <spawn.h>
#include <unistd.h>

#include <cctype>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <memory>

#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/http/embedded.h"
#include "cli/http/folder.h"
#include "cli/http/listener.h"
#include "cli/http/peer.h"
#include "cli/http/server.h"
#include "cli/input/member_file.h"
#include "cli/input/playlist.h"
#include "cli/text/units.h"
#include "cli/verbs/drawn_scene.h"
#include "cli/verbs/verbs.h"

extern char** environ;

namespace l4d::cli {
namespace {

struct ServeArguments {
  std::string input;
  uint32_t port = 0;
  bool no_browser = false;
  bool pictures = false;
  ImportArguments import;
  std::string rate;
  uint32_t delay = 0;
};

void add_server_options(Verb* verb, ServeArguments& arguments) {
  verb->add_option("--port", arguments.port, "Port to listen at (default: any that is free)")
      ->type_name("N")
      ->whole_number(1, 65535);
  verb->add_option("--rate", arguments.rate,
                   "Of all answers together, to try a slow network: Mbit/s, or 5Mbit/s, 1MB/s "
                   "(default: no limit)")
      ->type_name("R");
  verb->add_option("--delay", arguments.delay,
                   "Milliseconds before each answer, likewise (default: 0)")
      ->type_name("N")
      ->whole_number(0, 60000);
}

// Mbit/s; 0: no limit.
double megabits(const std::string& text) {
  if (text.empty()) return 0;
  const std::string option = "--rate";
  const bool has_unit = std::isalpha(static_cast<unsigned char>(text.back())) != 0;
  const double rate = has_unit ? parse_bitrate(text, option) * 8 / 1e6 : parse_number(text, option);
  if (!(rate >= 0 && rate <= 1e6)) {
    throw usage_error(option + " is " + text + "; it must be between 0 and 1000000 Mbit/s");
  }
  return rate;
}

// Where somebody sits at a screen. Everybody on the machine can read the arguments of a program:
// `url` is the landing, not the address with the token, and leads nowhere unless the system tells
// users apart.
void open_browser(const std::string& url) {
  if (!tells_users()) return;
  if (std::getenv("DISPLAY") == nullptr && std::getenv("WAYLAND_DISPLAY") == nullptr) return;
  std::string program = "xdg-open", address = url;
  char* words[] = {program.data(), address.data(), nullptr};
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  for (const int fd : {STDOUT_FILENO, STDERR_FILENO}) {
    posix_spawn_file_actions_addopen(&actions, fd, "/dev/null", O_WRONLY, 0);
  }
  pid_t child;
  // Without such a program the address that is printed has to do.
  (void)posix_spawnp(&child, program.c_str(), &actions, nullptr, words, environ);
  posix_spawn_file_actions_destroy(&actions);
}

// Whether players need a list of the streams of a file: there are several, or there will be.
bool needs_playlist(const MemberFile& file) {
  const MemberInfo& first = file.members().front();
  return file.members().size() > 1 || file.info().stream != 0 || !first.is_media() ||
         first.member.shift != 0 || !first.needs.empty();
}

// As ServerOptions::playlist has it. A file that is no stream has none: the player says why.
std::string playlist_of_file(const Context& context, const std::string& path,
                             const std::string& url) {
  try {
    const MemberFile file(context, path, path, false);
    return needs_playlist(file)
               ? playlist_of(file.members(), file.has_index(), url, file.info().stream)
               : "";
  } catch (const Failure&) {
    return "";
  }
}

Outcome run_server(Context& context, const ServeArguments& arguments, ServerOptions options,
                   const std::string& verb, bool browse) {
  options.port = static_cast<int>(arguments.port);
  options.megabits = megabits(arguments.rate);
  options.delay_ms = arguments.delay;
  options.playlist = [&](const std::string& path, const std::string& url) {
    return playlist_of_file(context, path, url);
  };
  Server server(options);
  // Now, not when it has ended.
  std::string line = server.url();
  if (context.options.json) {
    const Json json = {{"schema", "l4dcodec.listening/1"},
                       {"input", arguments.input},
                       {"url", server.url()},
                       {"address", Listener::kAddress},
                       {"port", server.port()}};
    line = json.dump();
  }
  if (std::fprintf(stdout, "%s\n", line.c_str()) < 0 || std::fflush(stdout) != 0) {
    throw Failure(L4D_ERR_IO, std::string("stdout: cannot write: ") + std::strerror(errno));
  }
  if (browse) open_browser(server.landing_url());
  const ServerCounts counts = server.run(interrupted);
  Outcome outcome;
  outcome.json = {{"schema", "l4dcodec." + verb + "/1"},
                  {"input", arguments.input},
                  {"url", server.url()},
                  {"requests", counts.requests},
                  {"bytes", counts.bytes}};
  outcome.text = format("%s requests, %s\n", format_count(counts.requests).c_str(),
                        format_bytes(counts.bytes).c_str());
  return outcome;
}

Outcome run_serve(Context& context, const ServeArguments& arguments) {
  std::error_code error;
  if (!std::filesystem::is_directory(arguments.input, error)) {
    throw Failure(L4D_ERR_IO, arguments.input + ": not a folder");
  }
  ServerOptions options;
  options.folder = arguments.input;
  if (!Folder(arguments.input).may_have_streams()) {
    context.note(arguments.input + ": the folder has no streams (.l4d) yet; `encode` makes them");
  }
  return run_server(context, arguments, options, "serve", false);
}

// Throws what is wrong with a stream. False: it is no stream.
bool is_stream(Context& context, const Input& input) {
  try {
    DecoderHandle decoder;
    decoder.open_file(input.path());
    if (playlist_of_file(context, input.path(), "x").empty()) {
      note_members(context, input, decoder.info().timeline);
    }
    return true;
  } catch (const Error& error) {
    if (error.status() == L4D_ERR_NOT_L4D) return false;
    throw current_failure(input.name());
  }
}

Outcome run_view(Context& context, const ServeArguments& arguments) {
  const bool has_player = !player_files().empty();
  if (!has_player) {
    context.note("The player is not in this build ('./dev web' builds it, and then the tool).");
  }
  ServerOptions options;
  std::error_code error;
  if (std::filesystem::is_directory(arguments.input, error)) {
    if (arguments.pictures) throw usage_error("--pictures is for one scene, not for a folder");
    if (!has_player) {
      throw Failure(L4D_ERR_FEATURE_UNSUPPORTED,
                    arguments.input + ": a folder is shown by the player alone");
    }
    if (!Folder(arguments.input).may_have_streams()) {
      throw Failure(L4D_ERR_NOT_L4D, arguments.input +
                                         ": the folder has no streams (.l4d); `encode` makes one "
                                         "of frames");
    }
    options.folder = arguments.input;
    return run_server(context, arguments, options, "view", !arguments.no_browser);
  }
  arguments.import.check();
  context.files.add_input(arguments.input, "the input");
  const Input input(context, arguments.input);
  const bool plays = is_stream(context, input) && has_player && !arguments.pictures;
  if (!plays) {
    options.folder = ".";  // of which nothing is served
    options.pictures = draw_pictures(context, input, arguments.import);
    return run_server(context, arguments, options, "view", !arguments.no_browser);
  }
  const std::filesystem::path path = std::filesystem::canonical(input.path(), error);
  if (error) {
    throw Failure(L4D_ERR_IO,
                  input.name() + ": the player wants a file with a name, or --pictures");
  }
  options.folder = path.parent_path();
  options.file = path.filename();
  return run_server(context, arguments, options, "view", !arguments.no_browser);
}

}  // namespace

void add_serve(Registry& registry) {
  auto arguments = std::make_shared<ServeArguments>();
  Verb* verb = add_verb(registry, "serve", "Serve a folder of streams over HTTP to this machine",
                        [arguments](Context& context) { return run_serve(context, *arguments); });
  verb->add_option("folder", arguments->input,
                   "Folder: its .l4d files, playlists and folders are listed")
      ->required();
  add_server_options(verb, *arguments);
  verb->footer(
      "Examples:\n"
      "  l4dcodec serve scenes\n"
      "Prints the address, whose path is random, and serves until Ctrl-C. Other machines cannot\n"
      "reach it. This is for trying things out: put files on any web server to publish them.");
}

void add_view(Registry& registry) {
  auto arguments = std::make_shared<ServeArguments>();
  Verb* verb = add_verb(registry, "view", "Show a scene in the browser",
                        [arguments](Context& context) { return run_view(context, *arguments); });
  verb->add_option("input", arguments->input, scene_help() + ", or a folder of streams")
      ->required();
  verb->add_flag("--no-browser", arguments->no_browser, "Only print the address");
  verb->add_flag("--pictures", arguments->pictures,
                 "Draw here and send pictures, for a browser without WebGL 2");
  add_import_options(verb, arguments->import);
  add_server_options(verb, *arguments);
  verb->footer(
      "Examples:\n"
      "  l4dcodec view scene.l4d\n"
      "  l4dcodec view scene.ply\n"
      "  l4dcodec view scenes --port 8080 --no-browser\n"
      "Prints the address, opens it where there is a screen, and serves until Ctrl-C. A file of\n"
      "several streams plays as one presentation, also while `encode --live` appends to it.\n"
      "Of a scene that is no stream, and in a build without the player, the page shows pictures\n"
      "that this program draws: drag to turn, scroll to come nearer.");
}

}  // namespace l4d::cli

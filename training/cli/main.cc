// SPDX-License-Identifier: Apache-2.0
// l4dtrain: trains scenes from captures.
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <iostream>
#include <optional>
#include <string>

#include "io/file/amounts.h"
#include "io/formats/scene_file.h"
#include "l4d/l4d.hpp"
#include "training/cli/command.h"
#include "training/cli/numbers.h"
#include "training/cli/pace.h"
#include "training/run/report/inspect.h"
#include "training/run/report/report.h"
#include "training/sync/sync.h"

namespace l4d::train {
namespace {

int exit_code_of(l4d_status status) {
  switch (status) {
    case L4D_ERR_INVALID_ARGUMENT:
      return kExitUsage;
    case L4D_ERR_IO:
      return kExitIo;
    case L4D_ERR_CORRUPT:
      return kExitCorrupt;
    case L4D_ERR_FEATURE_UNSUPPORTED:
      return kExitUnsupported;
    case L4D_ERR_LIMIT_EXCEEDED:
    case L4D_ERR_OUT_OF_MEMORY:
      return kExitLimit;
    case L4D_ERR_CANCELLED:
      return kExitCancelled;
    default:
      return kExitRuntime;
  }
}

volatile std::sig_atomic_t stop_signal = 0;
volatile std::sig_atomic_t checkpoint_signal = 0;

void install_handlers() {
  struct sigaction stop {};
  stop.sa_handler = [](int) { stop_signal = 1; };
  // A second signal ends the process at once.
  stop.sa_flags = static_cast<int>(SA_RESETHAND);
  ::sigaction(SIGINT, &stop, nullptr);
  ::sigaction(SIGTERM, &stop, nullptr);
  // A terminal that goes away; nohup wants that to be ignored.
  struct sigaction hangup {};
  if (::sigaction(SIGHUP, nullptr, &hangup) == 0 && hangup.sa_handler != SIG_IGN) {
    ::sigaction(SIGHUP, &stop, nullptr);
  }
  struct sigaction checkpoint {};
  checkpoint.sa_handler = [](int) { checkpoint_signal = 1; };
  checkpoint.sa_flags = SA_RESTART;
  ::sigaction(SIGUSR1, &checkpoint, nullptr);
}

// A line on stderr that is drawn again and again, or lines where stderr is no terminal.
class Terminal final : public RunObserver {
 public:
  explicit Terminal(bool quiet) : quiet_(quiet), draws_(::isatty(STDERR_FILENO) == 1) {}
  ~Terminal() override { clear(); }

  void update(uint64_t done, uint64_t total, const std::string& stage) override {
    if (quiet_) return;
    const auto now = Clock::now();
    if (total != total_ || done < done_) {
      total_ = total;
      pace_.begin(seconds_of(now), done);
      tenth_ = -1;
    }
    pace_.note(seconds_of(now), done);
    done_ = done;
    const double share = total == 0 ? 0 : static_cast<double>(done) / static_cast<double>(total);
    const int tenth = static_cast<int>(share * 10);
    if (draws_ ? now - drawn_ < std::chrono::milliseconds(200) && total != 0
               : total != 0 && tenth == tenth_) {
      return;
    }
    drawn_ = now;
    tenth_ = tenth;
    std::string line = stage;
    if (total > 0) line += "  " + std::to_string(static_cast<int>(100 * share)) + "%" + eta(done);
    std::fprintf(stderr, draws_ ? "\r%s\033[K" : "%s\n", line.c_str());
    shown_ = draws_;
  }
  void note(const std::string& text) override {
    clear();
    if (!quiet_) std::fprintf(stderr, "note: %s\n", text.c_str());
  }
  void clear() {
    if (shown_) std::fputs("\r\033[K", stderr);
    shown_ = false;
  }
  bool cancelled() override { return stop_signal != 0; }
  bool wants_checkpoint() override {
    const bool wanted = checkpoint_signal != 0;
    checkpoint_signal = 0;
    return wanted;
  }

 private:
  using Clock = std::chrono::steady_clock;

  static double seconds_of(Clock::time_point time) {
    return std::chrono::duration<double>(time.time_since_epoch()).count();
  }
  std::string eta(uint64_t done) const {
    const double left = pace_.left(seconds_of(Clock::now()), done, total_);
    if (left < 0) return "";
    const auto seconds = static_cast<unsigned>(left + 0.5);
    char text[40];
    std::snprintf(text, sizeof(text), "  ETA %u:%02u:%02u", seconds / 3600, seconds / 60 % 60,
                  seconds % 60);
    return text;
  }

  bool quiet_, draws_, shown_ = false;
  Pace pace_;
  uint64_t total_ = UINT64_MAX, done_ = 0;
  int tenth_ = -1;
  Clock::time_point drawn_{};
};

// lpips: the network of LPIPS, or "".
std::string describe(const Score& score, const std::string& lpips) {
  if (score.plain.views == 0) return "no views";
  char text[120];
  std::snprintf(text, sizeof(text), "%.2f dB, SSIM %.4f, %.2f dB after fitting colours, %llu views",
                score.plain.mean_psnr, score.plain.mean_ssim, score.psnr_affine,
                static_cast<unsigned long long>(score.plain.views));
  std::string out = text;
  if (!lpips.empty()) {
    std::snprintf(text, sizeof(text), ", LPIPS (%s) %.4f", lpips.c_str(), score.lpips);
    out += text;
  }
  if (std::isfinite(score.jod)) {
    std::snprintf(text, sizeof(text), ", %.3f JOD", score.jod);
    out += text;
  }
  return out;
}

std::string describe(const RunReport& r) {
  std::string out;
  const auto line = [&](const char* name, const std::string& text) {
    char begin[24];
    std::snprintf(begin, sizeof(begin), "%-12s", name);
    out += begin + text + "\n";
  };
  char text[160];
  std::snprintf(text, sizeof(text), "%llu, %llu steps in %.1f s",
                static_cast<unsigned long long>(r.gaussians),
                static_cast<unsigned long long>(r.steps), r.training_seconds);
  line("Gaussians", r.steps > 0 ? text : std::to_string(r.gaussians));
  line("training", describe(r.train, r.lpips));
  line("test", describe(r.test, r.lpips));
  if (r.stream_bytes > 0) {
    std::string stream = std::to_string(r.stream_bytes) + " bytes";
    if (r.stream_fidelity) {
      const eval::CheckedFidelity& f = r.stream_fidelity->fidelity;
      std::snprintf(text, sizeof(text), ", renders have %.2f dB of the scene's; %.2f dB at worst",
                    f.psnr, r.stream_fidelity->worst());
      stream += text;
    }
    line("stream", stream);
    line("  training", describe(r.stream_train, r.lpips));
    line("  test", describe(r.stream_test, r.lpips));
  }
  return out;
}

int run_footage(Arguments& a, Terminal& terminal) {
  a.footage.threads = a.run.threads;
  const FootageReport report = make_capture(
      a.scene, a.folder, a.footage, [&](const std::string& step) { terminal.update(0, 0, step); },
      [&] { return terminal.cancelled(); });
  for (const std::string& note : report.notes) terminal.note(note);
  terminal.clear();
  if (!a.quiet) {
    std::printf("%s: %zu cameras, %.1f to %.1f degrees of view wide\n%s", a.folder.c_str(),
                report.cameras, report.least_field, report.largest_field,
                report.clocks.text().c_str());
  }
  return kExitOk;
}

int run_capture(Arguments& a, Terminal& terminal) {
  if (is_footage(a.scene)) return run_footage(a, terminal);
  char rest = 0;
  RenderCaptureOptions& capture = a.capture;
  const bool is_number = a.cameras.find_first_not_of("0123456789") == std::string::npos;
  if (!is_number) capture.camera_file = a.cameras;
  if (std::sscanf(a.image_size.c_str(), "%ux%u%c", &capture.width, &capture.height, &rest) != 2 ||
      capture.width < 1 || capture.height < 1 || capture.width > L4D_MAX_IMAGE_SIDE ||
      capture.height > L4D_MAX_IMAGE_SIDE ||
      (is_number && (std::sscanf(a.cameras.c_str(), "%u", &capture.cameras) != 1 ||
                     capture.cameras < 1 || capture.cameras > 1000))) {
    throw io::Error(L4D_ERR_INVALID_ARGUMENT,
                    "--size must be like 320x240, and --cameras 1 to 1000, or a file");
  }
  capture.threads = a.run.threads;
  const io::Scene scene = io::read_scene_file(a.scene, a.scene);
  io::require_valid(scene, a.scene);
  for (const std::string& note : scene.notes) terminal.note(note);
  std::vector<std::string> notes;
  const uint32_t cameras = render_capture(a.folder, scene, capture, &notes);
  for (const std::string& note : notes) terminal.note(note);
  if (!a.quiet) std::printf("%s: %u cameras\n", a.folder.c_str(), cameras);
  return kExitOk;
}

int run_sync(const Arguments& a, Terminal& terminal) {
  if (!a.cameras_out.empty() && io::identify(a.cameras_out)) {
    throw io::Error(L4D_ERR_INVALID_ARGUMENT, a.cameras_out + " exists; nothing is replaced");
  }
  const Capture capture = read_capture(a.run.settings.capture, a.run.settings.reading);
  for (const std::string& note : capture.notes) terminal.note(note);
  terminal.update(0, 0, "listening and watching");
  const ClockReport clocks = find_clocks(capture, a.footage.max_offset, a.run.threads);
  if (!a.cameras_out.empty()) write_synchronised(a.cameras_out, capture, clocks);
  terminal.clear();
  std::printf("%s%s", (a.json ? clocks.json() : clocks.text()).c_str(), a.json ? "\n" : "");
  return kExitOk;
}

int run_bench(const Arguments& a, Terminal& terminal) {
  const std::vector<ProtocolScene> scenes =
      run_protocol(protocol_of(a.protocol), a.data, a.run.folder, a.run, &terminal);
  terminal.clear();
  if (!a.json) {
    std::printf("%s", table_of(scenes).c_str());
    return kExitOk;
  }
  std::string all;
  for (const ProtocolScene& scene : scenes) {
    all += (all.empty() ? "[" : ",\n") + json_of(scene.report);
  }
  std::printf("%s]\n", all.c_str());
  return kExitOk;
}

int report_failure(int code, const std::string& message) {
  std::fprintf(stderr, "l4dtrain: %s\n", message.c_str());
  return code;
}

// What stdout did not take is a failure, whatever was done before.
int written(int code) {
  errno = 0;
  std::cout.flush();
  const bool is_whole = std::fflush(stdout) == 0 && std::ferror(stdout) == 0 && std::cout.good();
  if (is_whole) return code;
  // What failed before left no reason behind: the next byte fails for the same one.
  if (errno == 0 && std::fputc('\n', stdout) != EOF) std::fflush(stdout);
  const std::string why = errno != 0 ? std::string(": ") + std::strerror(errno) : "";
  return report_failure(kExitIo, "cannot write to the standard output" + why);
}

// What the stream is to be.
void set_stream(Arguments* a) {
  RunOptions& run = a->run;
  if (!a->size.empty()) run.settings.size = io::parse_size(a->size, "--size");
  if (!a->bitrate.empty()) run.bitrate = io::parse_bitrate(a->bitrate, "--bitrate");
  if ((!a->size.empty() && run.settings.size == 0) || (!a->bitrate.empty() && run.bitrate == 0)) {
    throw io::Error(L4D_ERR_INVALID_ARGUMENT, "--size and --bitrate must be positive");
  }
  if (a->size.empty() && a->bitrate.empty() && run.settings.quality == 0) return;
  if (run.preset.empty()) run.preset = "default";
  if (run.settings.codec == "off") run.settings.codec = "prune";
}

int run_verb(const CLI::App& app, Arguments& a) {
  Terminal terminal(a.quiet);
  if (app.got_subcommand("inspect")) {
    const Inspection result = inspect(a.run.settings.capture, a.run.settings.reading, a.sheet,
                                      a.run.cache, a.run.threads);
    std::printf("%s%s", (a.json ? result.json : result.text).c_str(), a.json ? "\n" : "");
    return kExitOk;
  }
  if (app.got_subcommand("bench")) return run_bench(a, terminal);
  if (app.got_subcommand("sync")) return run_sync(a, terminal);
  if (app.got_subcommand("capture")) return run_capture(a, terminal);
  RunReport report;
  if (a.background == "white") a.run.background = {1, 1, 1};
  if (app.got_subcommand("train")) {
    a.run.settings.host_memory = io::parse_size(a.host_memory, "--host-memory");
    a.run.may_shrink_images = app.get_subcommand("train")->count("--host-memory") == 0;
    a.run.cache_bytes = io::parse_size(a.cache_limit, "--cache-limit");
    if (!a.limit_memory.empty())
      a.run.limit_memory = io::parse_size(a.limit_memory, "--limit-memory");
    if (!a.limit_memory.empty() && a.run.limit_memory == 0) {
      throw io::Error(L4D_ERR_INVALID_ARGUMENT, "--limit-memory must be positive");
    }
    a.run.bucket_memory = io::parse_size(a.bucket_memory, "--bucket-memory");
    if (a.device_memory != "auto") {
      a.run.settings.device_memory = io::parse_size(a.device_memory, "--device-memory");
      if (a.run.settings.device_memory == 0) {
        throw io::Error(L4D_ERR_INVALID_ARGUMENT, "--device-memory must be positive");
      }
    }
    if (a.near != "auto") a.run.settings.near = number_of("--near", a.near);
    if (a.refine_times != "auto") {
      a.run.settings.refine_times = number_of("--refine-times", a.refine_times);
    }
    if (a.opacity_weight != "auto") {
      a.run.settings.opacity_weight = number_of("--opacity-weight", a.opacity_weight);
    }
    set_stream(&a);
    report = train(a.run, &terminal);
  } else {
    report = evaluate_run(a.folder, a.moved, a.run, a.page, &terminal);
  }
  std::printf("%s%s", (a.json ? json_of(report) : describe(report)).c_str(), a.json ? "\n" : "");
  return kExitOk;
}

// What the command line does not say is as the run has it that is resumed.
void start_from_run(const Arguments& parsed, Arguments* a) {
  const std::optional<Settings> settings = settings_in(parsed.run.folder);
  if (!settings) return;
  a->run.settings = *settings;
  a->run.preset = settings->preset;
  a->host_memory = std::to_string(settings->host_memory);
  if (settings->device_memory != 0) a->device_memory = std::to_string(settings->device_memory);
}

int run_parsed(Command& command) {
  const CLI::App& app = command.app;
  // Writes that fail are reported as such.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  // What does not ask whether it is to stop ends as any program by signals.
  const bool is_film = app.got_subcommand("capture") && is_footage(command.capture.scene);
  const bool runs = app.got_subcommand("train") || app.got_subcommand("bench");
  if (runs || app.got_subcommand("eval") || is_film) install_handlers();
  Arguments& chosen = app.got_subcommand("train")     ? command.training
                      : app.got_subcommand("eval")    ? command.evaluation
                      : app.got_subcommand("bench")   ? command.bench
                      : app.got_subcommand("sync")    ? command.synchronisation
                      : app.got_subcommand("capture") ? command.capture
                                                      : command.inspection;
  try {
    return written(run_verb(app, chosen));
  } catch (const io::Error& error) {
    return report_failure(exit_code_of(error.status()), error.what());
  } catch (const l4d::Error& error) {
    return report_failure(exit_code_of(error.status()), error.what());
  } catch (const TrainingFailed& error) {
    return report_failure(kExitRuntime, error.what());
  } catch (const std::bad_alloc&) {
    return report_failure(kExitLimit, "out of memory");
  } catch (const std::exception& error) {
    return report_failure(kExitRuntime, error.what());
  }
}

// `help VERB` is `VERB --help`.
std::vector<std::string> arguments_of(int argc, char** argv) {
  std::vector<std::string> arguments(argv + 1, argv + argc);
  if (!arguments.empty() && arguments[0] == "help") {
    arguments.erase(arguments.begin());
    arguments.emplace_back("--help");
  }
  std::reverse(arguments.begin(), arguments.end());  // as the parser takes them
  return arguments;
}

int run(int argc, char** argv) {
  const std::vector<std::string> arguments = arguments_of(argc, argv);
  Command command, resumed;
  try {
    command.app.parse(std::vector<std::string>(arguments));
    if (!command.training.run.resume) return run_parsed(command);
    start_from_run(command.training, &resumed.training);
    resumed.app.parse(std::vector<std::string>(arguments));
    return run_parsed(resumed);
  } catch (const CLI::ParseError& error) {
    return command.app.exit(error) == 0 ? written(kExitOk) : kExitUsage;
  } catch (const io::Error& error) {
    return report_failure(exit_code_of(error.status()), error.what());
  }
}

}  // namespace
}  // namespace l4d::train

int main(int argc, char** argv) { return l4d::train::run(argc, argv); }

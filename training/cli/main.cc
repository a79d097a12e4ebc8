// SPDX-License-Identifier: Apache-2.0
// l4dtrain: trains scenes from captures.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <iostream>
#include <optional>
#include <string>

#include "io/formats/scene_file.h"
#include "l4d/l4d.hpp"
#include "training/cli/numbers.h"
#include "training/cli/pace.h"
#include "training/run/report/inspect.h"
#include "training/run/report/render_capture.h"
#include "training/run/report/report.h"
#include "training/run/run.h"
#include "training/run/train/output.h"

namespace l4d::train {
namespace {

// As those of l4dcodec (docs/cli.md).
enum ExitCode : int {
  kExitOk = 0,
  kExitUsage = 2,
  kExitIo = 3,
  kExitCorrupt = 4,
  kExitUnsupported = 5,
  kExitLimit = 6,
  kExitRuntime = 7,
  kExitCancelled = 130
};

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
  void clear() {
    if (shown_) std::fputs("\r\033[K", stderr);
    shown_ = false;
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
  if (lpips.empty()) return out;
  std::snprintf(text, sizeof(text), ", LPIPS (%s) %.4f", lpips.c_str(), score.lpips);
  return out + text;
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

struct Arguments {
  RunOptions run;
  std::string limit_memory, host_memory = "8G", device_memory = "auto", bucket_memory = "8G";
  std::string cache_limit = "64G";
  std::string near = "auto", opacity_weight = "auto";
  std::string sheet;
  std::string folder;  // of a run that is evaluated, or for a capture that is rendered
  std::string moved;   // the capture of a run that is evaluated, where it is elsewhere now
  std::string scene;   // that a capture is rendered of
  std::string size = "320x240", cameras = "16";
  RenderCaptureOptions capture;
  bool json = false, quiet = false;
};

void add_reading(CLI::App* verb, Arguments& a) {
  Settings& s = a.run.settings;
  verb->add_option("capture", s.capture, "Folder of the capture, or the file that describes it")
      ->required();
  verb->add_option("--frames", s.reading.frames, "Frames: first:end or first:end:step (all)");
  verb->add_option("--test", s.reading.test,
                   "Cameras for tests: 0,10,15 or 0-3 (those that the capture names, else the "
                   "first and every 8th after it)");
  verb->add_option("--seconds", s.reading.seconds,
                   "D-NeRF: the time that 1 in its files stands for")
      ->check(above_zero)
      ->capture_default_str();
  verb->add_option("--fps", s.reading.fps, "Frame rate (that of the capture)")->check(above_zero);
  verb->add_flag(
      "--tolerant", s.reading.tolerant,
      "Leave out cameras and images that are missing or damaged, and cut all to the shortest; "
      "videos are decoded once more to find damage");
  verb->add_flag("--any-path", s.reading.any_path,
                 "Read videos, images and masks wherever the capture says that they are, and not "
                 "only in its folder and below");
}

void add_common(CLI::App* verb, Arguments& a) {
  verb->add_option("--threads", a.run.threads, "Threads; never change the result (one per core)")
      ->check(number_of_threads);
  verb->add_flag("--json", a.json, "Print the report as JSON");
  verb->add_flag("-q,--quiet", a.quiet, "No progress and no notes");
}

void add_lpips(CLI::App* verb, Arguments& a) {
  verb->add_option(
      "--lpips", a.run.lpips,
      "Also report LPIPS, with the weights in this .safetensors file: AlexNet or VGG16");
}

// How it is trained, beyond what most users choose.
void add_method(CLI::App* verb, Arguments& a) {
  Settings& s = a.run.settings;
  verb->add_option("--density", s.density, "relocate, gradient, off")->capture_default_str();
  verb->add_option("--temporal-split", s.temporal_split,
                   "on, off: split Gaussians that instants pull to and fro in time; of --backend "
                   "cpu")
      ->capture_default_str();
  verb->add_option("--density-every", s.density_every,
                   "Steps between two changes of the density; all rows come up in 100 steps")
      ->capture_default_str();
  verb->add_option(
          "--codec", s.codec,
          "For the size of the stream: off; prune removes the Gaussians that images miss least; "
          "settle also those that an encode with the preset of --encode drops")
      ->capture_default_str();
  verb->add_option("--adam", s.adam,
                   "dense, sparse; auto: dense if all Gaussians are in the back end")
      ->capture_default_str();
  verb->add_option("--backend", s.backend, "cpu, cuda; auto takes a CUDA device where there is one")
      ->capture_default_str();
  verb->add_option("--devices", s.devices,
                   "CUDA devices that share the views of each step: 0,1 (the first); their number "
                   "changes the bits");
  verb->add_option("--drift", s.drift,
                   "Bound of the temporal rotor's rate, in steps of positions; 0: no bound")
      ->capture_default_str();
  verb->add_option("--error-weight", s.error_weight,
                   "How strongly errors of images attract Gaussians")
      ->capture_default_str();
  verb->add_option(
          "--near", a.near,
          "Cameras see nothing nearer than this, in units of their radius; auto: 0.2 where "
          "all look at one place, else 0")
      ->capture_default_str();
  verb->add_option(
          "--opacity-weight", a.opacity_weight,
          "Weight of the mean opacity in the loss; auto: 0.015, of images with alpha 0.005")
      ->capture_default_str();
  verb->add_option("--scale-weight", s.scale_weight,
                   "Weight of the mean scale in the loss, in units of the radius of the cameras")
      ->capture_default_str();
  verb->add_option("--max-scale", s.max_scale,
                   "The largest scale of a Gaussian, in units of the radius of the cameras")
      ->capture_default_str();
}

// What is kept where.
void add_memory(CLI::App* verb, Arguments& a) {
  verb->add_option("--host-memory", a.host_memory,
                   "Bytes of images in memory: 500M, 8G; with --limit-memory, fewer if need be")
      ->capture_default_str();
  verb->add_option("--limit-memory", a.limit_memory,
                   "Bytes that the training may take, as 4G; one that needs more is refused");
  verb->add_option(
          "--device-memory", a.device_memory,
          "Bytes that the back end may use: for Gaussians, the renderer and, on a device, captured "
          "images. Gaussians that do not fit are elsewhere while no image in memory shows them. "
          "auto: half of what a device has free; on a processor all are in the back end")
      ->capture_default_str();
  verb->add_option("--resident", a.run.settings.resident,
                   "Gaussians in the back end at most (from --device-memory)")
      ->check(above_zero);
  verb->add_option("--bucket-memory", a.bucket_memory,
                   "Bytes of Gaussians in memory that are not in the back end; more are in files "
                   "in the folder `buckets` of the results")
      ->capture_default_str();
  verb->add_option("--cache", a.run.cache,
                   "Folder that keeps the frames of videos as they are trained on, for this "
                   "training and later ones (none)");
  verb->add_option("--cache-limit", a.cache_limit,
                   "Bytes that the files of the --cache may have; further frames are not kept")
      ->capture_default_str();
}

void add_train(CLI::App& app, Arguments& a) {
  CLI::App* verb = app.add_subcommand("train", "Train a scene from a capture");
  Settings& s = a.run.settings;
  add_reading(verb, a);
  verb->add_option("-o,--output", a.run.folder, "Folder for the results")->required();
  verb->add_option("-n,--gaussians", s.gaussians,
                   "Gaussians at most (from the size of images and the duration)")
      ->check(above_zero);
  auto* steps =
      verb->add_option("--steps", s.steps, "Steps (20000 for 10 s and less)")->check(above_zero);
  verb->add_option("--time", s.seconds, "Seconds to train for, in place of steps; not repeatable")
      ->check(above_zero)
      ->excludes(steps);
  verb->add_option("--views", s.views, "Views of a step (4; 1 for a moving camera)")
      ->check(above_zero);
  verb->add_option("--scale", s.scale, "Of images, 0 to 1")->capture_default_str();
  verb->add_option(
          "--init", s.init,
          "Where Gaussians begin: frustum, hull (images with alpha), a PLY of points; auto "
          "takes the capture's points, else the hull, else the frustum")
      ->capture_default_str();
  verb->add_option("--sh-degree", s.sh_degree, "0 to 3")->capture_default_str();
  verb->add_option("--exposure", s.exposure, "Colours of cameras: auto (on from 8 videos), on, off")
      ->capture_default_str();
  add_method(verb, a);
  add_memory(verb, a);
  verb->add_option("--seed", s.seed, "Of all random numbers")
      ->check(whole_number)
      ->capture_default_str();
  verb->add_option("--encode", a.run.preset,
                   "Also encode, with this preset of the encoder: " + preset_names());
  add_lpips(verb, a);
  verb->add_option("--checkpoint-every", a.run.checkpoint_seconds, "Seconds between checkpoints")
      ->check(above_zero)
      ->capture_default_str();
  auto* resume = verb->add_flag("--resume", a.run.resume,
                                "Go on from the last checkpoint, with the settings of the run");
  verb->add_flag("--accept-changes", a.run.accept_changes,
                 "Resume also where the capture, or --resident, has changed")
      ->needs(resume);
  verb->add_flag("--force", a.run.force, "Replace a run that is in the folder")->excludes(resume);
  add_common(verb, a);
  verb->footer(
      "Examples:\n"
      "  l4dtrain train capture -o run --encode default\n"
      "  l4dtrain train capture -o run --time 600 --scale 0.5 --gaussians 200000\n"
      "  l4dtrain train capture -o run --resume\n"
      "SIGINT, SIGTERM and SIGHUP end a training after a checkpoint, SIGUSR1 writes one.");
}

void add_capture(CLI::App& app, Arguments& a) {
  CLI::App* verb =
      app.add_subcommand("capture", "Render a scene as a capture, whose truth is then known");
  verb->add_option("scene", a.scene,
                   "File of a scene, of any format that `l4dcodec convert` reads but a stream")
      ->required();
  verb->add_option("-o,--output", a.folder, "Folder for the capture")->required();
  verb->add_option("--cameras", a.cameras,
                   "Number of cameras around the scene, or a file of them, as `l4dcodec cameras` "
                   "makes; the first and every 8th after it test, unless the file names others")
      ->capture_default_str();
  verb->add_option("--size", a.size, "Pixels of images of cameras around the scene: 320x240")
      ->capture_default_str();
  verb->add_option("--points", a.capture.points,
                   "Also write points.ply, so many points on what training cameras see, each off "
                   "by a pixel (none)");
  verb->add_option("--first", a.capture.first_frame, "First frame")->capture_default_str();
  verb->add_option("--frames", a.capture.frames, "Number of frames (all)")->check(above_zero);
  verb->add_option("--format", a.capture.format, "png, mp4")->capture_default_str();
  add_common(verb, a);
}

int run_capture(Arguments& a, Terminal& terminal) {
  char rest = 0;
  RenderCaptureOptions& capture = a.capture;
  const bool is_number = a.cameras.find_first_not_of("0123456789") == std::string::npos;
  if (!is_number) capture.camera_file = a.cameras;
  if (std::sscanf(a.size.c_str(), "%ux%u%c", &capture.width, &capture.height, &rest) != 2 ||
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

int run_verb(const CLI::App& app, Arguments& a) {
  Terminal terminal(a.quiet);
  if (app.got_subcommand("inspect")) {
    const Inspection result = inspect(a.run.settings.capture, a.run.settings.reading, a.sheet,
                                      a.run.cache, a.run.threads);
    std::printf("%s%s", (a.json ? result.json : result.text).c_str(), a.json ? "\n" : "");
    return kExitOk;
  }
  if (app.got_subcommand("capture")) return run_capture(a, terminal);
  RunReport report;
  if (app.got_subcommand("train")) {
    a.run.settings.host_memory = bytes_of("--host-memory", a.host_memory);
    a.run.may_shrink_images = app.get_subcommand("train")->count("--host-memory") == 0;
    a.run.cache_bytes = bytes_of("--cache-limit", a.cache_limit);
    if (!a.limit_memory.empty()) a.run.limit_memory = bytes_of("--limit-memory", a.limit_memory);
    if (!a.limit_memory.empty() && a.run.limit_memory == 0) {
      throw io::Error(L4D_ERR_INVALID_ARGUMENT, "--limit-memory must be positive");
    }
    a.run.bucket_memory = bytes_of("--bucket-memory", a.bucket_memory);
    if (a.device_memory != "auto") {
      a.run.settings.device_memory = bytes_of("--device-memory", a.device_memory);
      if (a.run.settings.device_memory == 0) {
        throw io::Error(L4D_ERR_INVALID_ARGUMENT, "--device-memory must be positive");
      }
    }
    if (a.near != "auto") a.run.settings.near = number_of("--near", a.near);
    if (a.opacity_weight != "auto") {
      a.run.settings.opacity_weight = number_of("--opacity-weight", a.opacity_weight);
    }
    report = train(a.run, &terminal);
  } else {
    report = evaluate_run(a.folder, a.moved, a.run.lpips, a.run.threads, &terminal);
  }
  std::printf("%s%s", (a.json ? json_of(report) : describe(report)).c_str(), a.json ? "\n" : "");
  return kExitOk;
}

// All verbs. Each has arguments of its own.
struct Command {
  Command() {
    app.require_subcommand(1);
    app.failure_message([](const CLI::App*, const CLI::Error& error) {
      return "l4dtrain: " + std::string(error.what()) + "; --help lists what there is\n";
    });
    add_train(app, training);
    CLI::App* eval = app.add_subcommand("eval", "Compare the scene of a run with its capture");
    eval->add_option("run", evaluation.folder, "Folder of the run")->required();
    eval->add_option("--capture", evaluation.moved,
                     "Where the capture is now (where it was when the run began)");
    add_lpips(eval, evaluation);
    add_common(eval, evaluation);
    CLI::App* look = app.add_subcommand("inspect", "Say what a capture is");
    add_reading(look, inspection);
    look->add_option("--cache", inspection.run.cache,
                     "Folder that `train --cache` made: list what it has of the capture");
    look->add_option("--sheet", inspection.sheet, "PNG to write: the first image of each camera");
    add_common(look, inspection);
    add_capture(app, capture);
  }
  Command(const Command&) = delete;
  Command& operator=(const Command&) = delete;

  CLI::App app{"Trains scenes of 4D Gaussians from captures, for l4dcodec"};
  Arguments training, evaluation, inspection, capture;
};

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
  // The other verbs do not ask whether they are to stop: signals end them as they end any program.
  if (app.got_subcommand("train") || app.got_subcommand("eval")) install_handlers();
  Arguments& chosen = app.got_subcommand("train")     ? command.training
                      : app.got_subcommand("eval")    ? command.evaluation
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

int run(int argc, char** argv) {
  Command command, resumed;
  try {
    command.app.parse(argc, argv);
    if (!command.training.run.resume) return run_parsed(command);
    start_from_run(command.training, &resumed.training);
    resumed.app.parse(argc, argv);
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

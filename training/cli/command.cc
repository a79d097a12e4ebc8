// SPDX-License-Identifier: Apache-2.0
#include "training/cli/command.h"

#include "l4d/l4d.h"
#include "training/cli/numbers.h"
#include "training/run/train/output.h"

namespace l4d::train {
namespace {

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

void add_scores(CLI::App* verb, Arguments& a) {
  verb->add_option(
          "--score", a.run.scored_instants,
          "Instants of each split, at most, that the last scores take, spread evenly; or all")
      ->type_name("N")
      ->transform(number_or_all)
      ->capture_default_str();
  verb->add_option("--background", a.background,
                   "black, white: behind renders and images with alpha, where they are compared")
      ->check(CLI::IsMember({"black", "white"}))
      ->capture_default_str();
  verb->add_option(
          "--lpips", a.run.lpips,
          "Also report LPIPS, with the weights in this .safetensors file: AlexNet or VGG16")
      ->type_name("FILE");
  verb->add_flag("--jod", a.run.jod,
                 "Also report JOD (ColorVideoVDP 0.5.6, standard_4k) of the videos that the views "
                 "of each camera are, where they are evenly spaced");
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
  verb->add_option(
          "--entropy-weight", s.entropy_weight,
          "Weight of the mean -o ln o of opacities o in the loss, which drives them to 0 or 1")
      ->capture_default_str();
  verb->add_option("--consistency-weight", s.consistency_weight,
                   "Weight in the loss of how far the velocities of Gaussians are from the mean of "
                   "their 8 neighbours', in radii of the cameras by the duration")
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
                   "training and later ones (none)")
      ->type_name("FOLDER");
  verb->add_option("--cache-limit", a.cache_limit,
                   "Bytes that the files of the --cache may have; further frames are not kept")
      ->capture_default_str();
}

// In one number how large or how good the stream is to be.
void add_stream(CLI::App* verb, Arguments& a) {
  auto* size = verb->add_option(
      "--size", a.size,
      "Train for a stream of at most this many bytes, as 2MB, and encode it: chooses the number of "
      "Gaussians, removes those that images miss least until they fit, and searches the quality");
  auto* bitrate =
      verb->add_option("--bitrate", a.bitrate,
                       "Likewise, for so many bytes or bits per second of the capture: 3Mbit/s")
          ->excludes(size);
  verb->add_option(
          "--quality", a.run.settings.quality,
          "Encode so that renders of the stream are this near the scene's, in dB, in place "
          "of the preset's; removes Gaussians as --codec prune")
      ->check(CLI::Range(20, 90))
      ->excludes(size)
      ->excludes(bitrate);
}

void add_train(CLI::App& app, Arguments& a) {
  CLI::App* verb = app.add_subcommand("train", "Train a scene from a capture");
  Settings& s = a.run.settings;
  add_reading(verb, a);
  verb->add_option("-o,--output", a.run.folder, "Folder for the results")
      ->type_name("FOLDER")
      ->required();
  verb->add_option("-n,--gaussians", s.gaussians,
                   "Gaussians at most (from the size of images and the duration)")
      ->check(above_zero);
  auto* steps = verb->add_option("--steps", s.steps, "Steps (of --effort)")->check(above_zero);
  verb->add_option("--time", s.seconds, "Seconds to train for, in place of steps; not repeatable")
      ->check(above_zero)
      ->excludes(steps);
  verb->add_option("--effort", s.effort,
                   "quick, good, best: 5000, 20000 or 60000 steps for 10 s and less, more for "
                   "longer captures")
      ->capture_default_str();
  verb->add_option("--stop-at", s.stop_at,
                   "End before the steps are over, once test views (training views where there are "
                   "none) have this mean PSNR in one of the ten scores while training")
      ->type_name("DB")
      ->check(above_zero);
  verb->add_option("--views", s.views, "Views of a step (4; 1 for a moving camera)")
      ->check(above_zero);
  verb->add_option("--scale", s.scale, "Of images, 0 to 1")->capture_default_str();
  verb->add_option("--init", s.init,
                   "Where Gaussians begin: frustum, hull (images with alpha), a PLY of points, or "
                   "a folder of "
                   "them with one for each frame (000012.ply); auto "
                   "takes the capture's points, else the hull, else the frustum")
      ->capture_default_str();
  verb->add_option("--sh-degree", s.sh_degree, "0 to 3")->capture_default_str();
  verb->add_option("--exposure", s.exposure, "Colours of cameras: auto (on from 8 videos), on, off")
      ->capture_default_str();
  verb->add_option("--refine-times", a.refine_times,
                   "Find the clocks of training cameras while they train, within so many frames of "
                   "what the capture says, up to 10; auto: 2 where it has time offsets, else 0")
      ->capture_default_str();
  verb->add_option("--refine-cameras", s.refine_cameras,
                   "Likewise how they are turned, within so many degrees about each axis, up to 5, "
                   "and, within the "
                   "same angle of the radius and of the focal length, where they are and their "
                   "focal lengths")
      ->capture_default_str();
  add_method(verb, a);
  add_memory(verb, a);
  verb->add_option("--seed", s.seed, "Of all random numbers")
      ->check(whole_number)
      ->capture_default_str();
  verb->add_option("--encode", a.run.preset,
                   "Also encode, with this preset of the encoder: " + preset_names());
  add_stream(verb, a);
  add_scores(verb, a);
  verb->add_flag("--watch", a.run.watch,
                 "Also write preview.l4d, the scene so far, every 10 s or more: `l4dcodec view "
                 "RUN/preview.l4d` shows it, and each that follows");
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
      "  l4dtrain train capture -o run --size 2MB\n"
      "  l4dtrain train capture -o run --time 600 --scale 0.5 --gaussians 200000\n"
      "  l4dtrain train capture -o run --resume\n"
      "SIGINT, SIGTERM and SIGHUP end a training after a checkpoint, SIGUSR1 writes one.");
}

void add_bench(CLI::App& app, Arguments& a) {
  CLI::App* verb = app.add_subcommand(
      "bench", "Train and score all scenes of a data set, and print the table that papers have");
  Settings& s = a.run.settings;
  verb->add_option("protocol", a.protocol, "n3dv, selfcap, hypernerf, dnerf")->required();
  verb->add_option("data", a.data, "Folder of captures, or one capture")->required();
  verb->add_option("-o,--output", a.run.folder,
                   "Folder of the runs; those that have ended there are scored again alone")
      ->type_name("FOLDER")
      ->required();
  verb->add_option("-n,--gaussians", s.gaussians, "As of train")->check(above_zero);
  auto* steps = verb->add_option("--steps", s.steps, "As of train")->check(above_zero);
  verb->add_option("--time", s.seconds, "As of train")->check(above_zero)->excludes(steps);
  verb->add_option("--backend", s.backend, "auto, cpu, cuda")->capture_default_str();
  verb->add_option("--seed", s.seed, "Of all random numbers")->check(whole_number);
  verb->add_option("--encode", a.run.preset, "Also encode, with this preset: " + preset_names());
  verb->add_option("--lpips", a.run.lpips, "As of train")->type_name("FILE");
  verb->add_flag("--jod", a.run.jod, "As of train");
  verb->add_flag("--force", a.run.force, "Replace runs that are there");
  add_common(verb, a);
  verb->footer(
      "n3dv: the first 300 frames, 1352 pixels wide; selfcap: all frames, 1920 pixels wide;\n"
      "hypernerf: as the images are; dnerf: 400 pixels wide, on white. Test cameras are those of\n"
      "the layout; all their images are scored.");
}

void add_max_offset(CLI::App* verb, Arguments& a) {
  verb->add_option("--max-offset", a.footage.max_offset,
                   "Seconds that the clocks of two videos are apart, at most")
      ->check(above_zero)
      ->capture_default_str();
}

void add_sync(CLI::App& app, Arguments& a) {
  CLI::App* verb = app.add_subcommand(
      "sync",
      "Compare the clocks of cameras that recorded by themselves: by sound, else by motion");
  CaptureOptions& reading = a.run.settings.reading;
  verb->add_option("capture", a.run.settings.capture,
                   "Folder of the capture, or the file that describes it")
      ->required();
  verb->add_option("-o,--output", a.cameras_out,
                   "A new cameras.json in the folder of the capture, with the offsets of clocks "
                   "that are off")
      ->type_name("FILE");
  add_max_offset(verb, a);
  verb->add_flag("--tolerant", reading.tolerant, "Leave out cameras that are missing or damaged");
  verb->add_flag("--any-path", reading.any_path,
                 "Read what lies outside the folder of the capture");
  add_common(verb, a);
}

void add_capture(CLI::App& app, Arguments& a) {
  CLI::App* verb =
      app.add_subcommand("capture",
                         "Make a capture: of videos, whose cameras are found by COLMAP, or of a "
                         "scene, which is rendered, so that its truth is known");
  verb->add_option("input", a.scene,
                   "Folder of videos, one for each camera; or file of a scene, of any format that "
                   "`l4dcodec convert` reads but a stream")
      ->required();
  verb->add_option("-o,--output", a.folder, "Folder for the capture")
      ->type_name("FOLDER")
      ->required();
  verb->add_option("--cameras", a.cameras,
                   "Number of cameras around the scene, or a file of them, as `l4dcodec cameras` "
                   "makes; the first and every 8th after it test, unless the file names others")
      ->capture_default_str();
  verb->add_option("--size", a.image_size, "Pixels of images of cameras around the scene: 320x240")
      ->capture_default_str();
  verb->add_option("--points", a.capture.points,
                   "Also write points.ply, so many points on what training cameras see, each off "
                   "by a pixel (none)");
  verb->add_option("--first", a.capture.first_frame, "First frame")->capture_default_str();
  verb->add_option("--frames", a.capture.frames, "Number of frames (all)")->check(above_zero);
  verb->add_option("--format", a.capture.format, "png, mp4")->capture_default_str();
  verb->add_option(
          "--lens", a.footage.lens,
          "Of videos: model of COLMAP for the lens of each camera: SIMPLE_PINHOLE, PINHOLE, "
          "SIMPLE_RADIAL, RADIAL, OPENCV, OPENCV_FISHEYE, FULL_OPENCV")
      ->capture_default_str();
  add_max_offset(verb, a);
  verb->add_flag("--tolerant", a.footage.tolerant,
                 "Of videos: leave out cameras that find no place");
  add_common(verb, a);
}

}  // namespace

std::vector<std::pair<int, std::string>> exit_statuses() {
  return {{kExitOk, "Done."},
          {kExitUsage, "Wrong usage."},
          {kExitIo, "Input or output failed."},
          {kExitCorrupt, "The capture, a scene or a checkpoint is damaged or contradicts itself."},
          {kExitUnsupported, "The capture has what is not read: a lens, a layout, a video."},
          {kExitLimit, "It needs more memory than there is or than --limit-memory allows."},
          {kExitRuntime, "A device or the training failed; or a defect."},
          {kExitCancelled, "Ended by SIGINT, SIGTERM or SIGHUP, after a checkpoint."}};
}

Command::Command() : app("Trains scenes of 4D Gaussians from captures, for l4dcodec", "l4dtrain") {
  app.require_subcommand(1);
  app.set_version_flag("--version", std::string("l4dtrain ") + l4d_version_string());
  app.failure_message([](const CLI::App*, const CLI::Error& error) {
    return "l4dtrain: " + std::string(error.what()) + "; --help lists what there is\n";
  });
  add_train(app, training);
  add_bench(app, bench);
  CLI::App* eval = app.add_subcommand("eval", "Compare the scene of a run with its capture");
  eval->add_option("run", evaluation.folder, "Folder of the run")->required();
  eval->add_option("--capture", evaluation.moved,
                   "Where the capture is now (where it was when the run began)")
      ->type_name("FOLDER");
  add_scores(eval, evaluation);
  eval->add_option(
          "--html", evaluation.page,
          "Also write the report as a page, as `train` writes report.html; replaces a file")
      ->type_name("FILE");
  add_common(eval, evaluation);
  CLI::App* look = app.add_subcommand("inspect", "Say what a capture is");
  add_reading(look, inspection);
  look->add_option("--cache", inspection.run.cache,
                   "Folder that `train --cache` made: list what it has of the capture")
      ->type_name("FOLDER");
  look->add_option("--sheet", inspection.sheet, "PNG to write: the first image of each camera")
      ->type_name("FILE");
  add_common(look, inspection);
  add_sync(app, synchronisation);
  add_capture(app, capture);
  // As the help of l4dcodec calls numbers.
  for (CLI::App* verb : app.get_subcommands(nullptr)) {
    for (CLI::Option* option : verb->get_options()) {
      const std::string type = option->get_type_name();
      if (type == "UINT" || type == "FLOAT") option->type_name("N");
    }
  }
}

}  // namespace l4d::train

// SPDX-License-Identifier: Apache-2.0
#include "training/run/report/report.h"

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "io/file/file.h"
#include "io/ply/scene_ply.h"
#include "training/capture/capture_hash.h"
#include "training/run/record/checkpoint.h"
#include "training/run/report/page.h"
#include "training/run/train/output.h"
#include "training/run/train/refine.h"
#include "training/step/cuda_backend.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using io::Error;

Json finite_or_null(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

// lpips: the network of LPIPS, or "".
Json object_of(const Score& score, const std::string& lpips) {
  Json object = {{"psnr", finite_or_null(score.plain.mean_psnr)},
                 {"psnr_of_mse", finite_or_null(score.plain.psnr)},
                 {"min_psnr", finite_or_null(score.plain.min_psnr)},
                 {"ssim", finite_or_null(score.plain.mean_ssim)},
                 {"psnr_affine", finite_or_null(score.psnr_affine)},
                 {"views", score.plain.views}};
  if (!lpips.empty()) object["lpips_" + lpips] = finite_or_null(score.lpips);
  if (std::isfinite(score.jod)) object["jod"] = score.jod;
  for (const CameraScore& camera : score.cameras) {
    Json& entry =
        object["cameras"].emplace_back(Json{{"name", camera.name},
                                            {"views", camera.views},
                                            {"psnr", finite_or_null(camera.psnr)},
                                            {"min_psnr", finite_or_null(camera.min_psnr)}});
    if (std::isfinite(camera.jod)) entry["jod"] = camera.jod;
  }
  for (const WorstView& view : score.worst) {
    object["worst_views"].push_back({{"camera", view.camera},
                                     {"frame", view.frame},
                                     {"time_s", view.time},
                                     {"psnr", finite_or_null(view.psnr)}});
  }
  return object;
}

Json object_of(const Settings& settings) {
  Json object = Json::object();
  for_each_setting(settings, [&](const char* name, const auto& value) { object[name] = value; });
  return object;
}

}  // namespace

std::string json_of(const Settings& settings) { return object_of(settings).dump(1); }

Settings settings_of(const std::string& text) {
  Settings s = defaults_of_before();
  try {
    const Json j = Json::parse(text);
    j.at("capture");
    for_each_setting(s, [&](const char* name, auto& value) {
      if (const auto found = j.find(name); found != j.end()) found->get_to(value);
    });
  } catch (const Json::exception& error) {
    throw Error(L4D_ERR_CORRUPT, std::string("settings.json: ") + error.what());
  }
  return s;
}

std::optional<Settings> settings_in(const std::string& folder) {
  const std::string path = (fs::path(folder) / "settings.json").string();
  std::error_code error;
  if (!fs::exists(path, error)) return std::nullopt;
  const std::vector<uint8_t> text = io::read_whole_file(path);
  return settings_of(std::string(text.begin(), text.end()));
}

RunReport describe_capture(const Capture& capture, const ImageLoader& loader) {
  RunReport report;
  report.layout = capture.layout;
  report.cameras = capture.cameras.size();
  for (const CaptureView& view : capture.views) {
    ++(capture.cameras[view.camera].split == "train" ? report.training_images : report.test_images);
  }
  report.width = loader.camera(0).width;
  report.height = loader.camera(0).height;
  return report;
}

std::string json_of(const RunReport& r) {
  Json j = {{"schema", "l4dtrain.report/1"},
            {"layout", r.layout},
            {"cameras", r.cameras},
            {"training_images", r.training_images},
            {"test_images", r.test_images},
            {"width", r.width},
            {"height", r.height},
            {"steps", r.steps},
            {"gaussians", r.gaussians},
            {"training_s", r.training_seconds},
            {"total_s", r.total_seconds},
            {"background", r.background},
            {"train", object_of(r.train, r.lpips)},
            {"test", object_of(r.test, r.lpips)}};
  for (const auto& [name, change] : r.refined) {
    const double* turn = &change[kTurn];
    j["refined"].push_back({{"name", name},
                            {"time_s", change[kTime]},
                            {"turn_rad", {turn[0], turn[1], turn[2]}},
                            {"move", {turn[3], turn[4], turn[5]}},
                            {"focal_factor", std::exp(change[kFocal])}});
  }
  if (r.steps > 0) {
    j["devices"] = r.devices;
    for (size_t p = 0; p < kParts; ++p) j["seconds"][kPartNames[p]] = finite_or_null(r.seconds[p]);
    for (size_t s = 0; s < kStages; ++s) j["ms"][kStageNames[s]] = finite_or_null(r.stages[s]);
  }
  if (r.memory.resident > 0) {
    for_each_size(r.memory, [&](const char* name, uint64_t size) { j["memory"][name] = size; });
  }
  if (r.stream_bytes > 0) {
    j["stream"] = {{"file_bytes", r.stream_bytes},
                   {"train", object_of(r.stream_train, r.lpips)},
                   {"test", object_of(r.stream_test, r.lpips)}};
  }
  if (r.stream_fidelity) {
    const eval::CheckedFidelity& f = r.stream_fidelity->fidelity;
    j["stream"]["fidelity"] = {
        {"psnr", f.psnr}, {"worst_camera", f.worst_camera}, {"worst_instant", f.worst_instant}};
  }
  j["settings"] = object_of(r.settings);
  j["notes"] = r.notes;
  return j.dump(1);
}

StreamViews::StreamViews(const std::string& path, const Capture& capture, const ImageLoader& loader,
                         const Colour& background, const l4d_renderer_options& rendering)
    : capture_(capture), loader_(loader), renderer_(&rendering) {
  decoder_.open_file(path);
  renderer_.set_decoder(decoder_);
  renderer_.set_background(background);
}

io::Image StreamViews::render(uint32_t view) {
  const l4d_camera& camera = loader_.camera_of(view);
  renderer_.set_time(capture_.time_of(view));
  io::Image image(camera.width, camera.height);
  renderer_.render(camera, image.rgb.data());
  return image;
}

namespace {

// A run that has a scene: its settings.
Settings settings_of_run(const std::string& folder) {
  const auto file = [&](const char* name) { return (fs::path(folder) / name).string(); };
  const std::vector<uint8_t> text = io::read_whole_file(file("settings.json"));
  std::error_code error;
  if (!fs::exists(file("scene.ply"), error)) {
    throw Error(L4D_ERR_IO, folder + ": the training has not ended, so that there is no scene; " +
                                (list_checkpoints(folder).empty()
                                     ? "there is no checkpoint to resume from"
                                     : "`l4dtrain train CAPTURE -o RUN --resume` goes on with it"));
  }
  return settings_of(std::string(text.begin(), text.end()));
}

}  // namespace

std::string note_of_stream(double scene_psnr, double stream_psnr, bool settles) {
  constexpr double kMuch = 3;  // dB
  const double loss = scene_psnr - stream_psnr;
  if (!(loss > kMuch)) return "";
  char text[160];
  std::snprintf(text, sizeof(text),
                "The stream has %.1f dB less than the scene on training views%s", loss,
                settles ? "; a preset of more bytes keeps more"
                        : ", because the encoder drops many Gaussians that show little each; "
                          "--codec settle trains without them");
  return text;
}

RunReport evaluate_run(const std::string& folder, const std::string& moved,
                       const RunOptions& options, const std::string& page, RunObserver* observer) {
  const auto file = [&](const char* name) { return (fs::path(folder) / name).string(); };
  Settings settings = settings_of_run(folder);
  std::error_code error;
  if (!moved.empty()) settings.capture = moved;
  if (moved.empty() && !fs::exists(settings.capture, error)) {
    throw Error(L4D_ERR_IO, settings.capture +
                                ": the capture of the run does not exist; --capture " +
                                "states where it is now");
  }
  Capture capture = read_capture(settings.capture, settings.reading);
  if (!settings.capture_hash.empty() && hash_of(capture) != settings.capture_hash) {
    capture.notes.push_back("The capture is not the one of the training, or has changed since.");
    observer->note(capture.notes.back());
  }
  ImageLoader loader(capture, settings.scale, settings.near);
  if (fs::exists(file("refined.json"), error)) {
    follow_refined(file("refined.json"), &capture, &loader);
  }
  const std::unique_ptr<eval::Lpips> lpips = read_lpips(options.lpips);
  check_sizes(lpips.get(), capture, loader);
  const io::Scene scene = io::read_scene_ply(file("scene.ply"));
  const l4d_renderer_options rendering = rendering_of(settings, options.threads);
  const std::unique_ptr<Backend> backend = rendering.backend == L4D_BACKEND_CUDA
                                               ? make_cuda_group({rendering.device})
                                               : make_cpu_backend(options.threads);
  backend->load(model_of(scene), capture.timeline());
  RunReport report = describe_capture(capture, loader);
  report.settings = settings;
  report.background = options.background;
  report.gaussians = scene.count();
  report.notes = capture.notes;
  if (lpips) report.lpips = lpips->network();
  const auto score = [&](const char* split, const RenderView& render) {
    return score_views(capture, loader, views_to_score(capture, split, options.scored_instants),
                       Scorer(lpips.get(), options.background, options.jod), options.threads,
                       render, [&] { return observer->cancelled(); });
  };
  const auto render = [&](uint32_t view) {
    return backend->render(loader.camera_of(view), capture.time_of(view),
                           options.background.data());
  };
  observer->update(0, 0, "comparing with the captured images");
  report.train = score("train", render);
  report.test = score("test", render);
  for (const std::string& note : notes_of_cameras(report.train)) {
    observer->note(note);
    report.notes.push_back(note);
  }
  const auto finish = [&] {
    if (page.empty()) return report;
    std::string curves;
    if (fs::exists(file("curves.svg"), error)) {
      const std::vector<uint8_t> text = io::read_whole_file(file("curves.svg"));
      curves.assign(text.begin(), text.end());
    }
    const std::string html = page_of(report, capture, curves);
    io::OutputFile out(page);
    out.write(html.data(), html.size());
    out.commit();
    return report;
  };
  if (!fs::exists(file("scene.l4d"), error)) return finish();
  report.stream_bytes = fs::file_size(file("scene.l4d"), error);
  StreamViews views(file("scene.l4d"), capture, loader, options.background, rendering);
  const auto render_stream = [&](uint32_t view) { return views.render(view); };
  report.stream_train = score("train", render_stream);
  report.stream_test = score("test", render_stream);
  return finish();
}

}  // namespace l4d::train

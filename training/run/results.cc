// SPDX-License-Identifier: Apache-2.0
#include "eval/refit/view_encoding.h"
#include "io/camera/write_cameras.h"
#include "io/ply/scene_ply.h"
#include "training/run/report/page.h"
#include "training/run/report/report.h"
#include "training/run/run_parts.h"
#include "training/run/train/output.h"
#include "training/step/cuda_backend.h"

namespace l4d::train {
namespace {

constexpr uint64_t kRenderShare = 16;  // of --limit-memory: renders that an encode keeps

// The steps of an encode, as those of a run.
class EncodeObserver : public eval::Observer {
 public:
  explicit EncodeObserver(RunObserver* run) : run_(run) {}
  void update(uint64_t done, uint64_t total, const char* stage) override {
    run_->update(done, total, std::string("encoding: ") + stage);
  }
  bool cancelled() const override { return run_->cancelled(); }

 private:
  RunObserver* run_;
};

Score score(const RunParts& parts, const char* split, const RenderView& render) {
  return score_views(parts.capture, *parts.loader,
                     views_to_score(parts.capture, split, parts.options.scored_instants),
                     Scorer(parts.lpips.get(), parts.options.background, parts.options.jod),
                     parts.options.threads, render, [&] { return parts.observer->cancelled(); });
}

void encode(const io::Scene& scene, RunParts* parts, RunReport* report) {
  parts->observer->update(0, 0, "encoding");
  EncodeObserver hears(parts->observer);
  eval::ViewEncodingOptions how;
  how.preset = parts->options.preset;
  how.rendering.renderer = rendering_of(parts->settings, parts->options.threads);
  how.rendering.decoder.threads = parts->options.threads;
  how.rendering.holder = parts->budget.holder();
  if (parts->options.limit_memory > 0)
    how.max_render_bytes = parts->options.limit_memory / kRenderShare;
  how.seed = parts->settings.seed;
  const EncoderHandle encoder = make_encoder(scene, parts->options.preset, parts->options.threads);
  if (parts->settings.quality > 0) encoder.set(L4D_ENC_QUALITY, parts->settings.quality);
  if (parts->settings.size > 0) {
    how.target.emplace();
    how.target->requested = static_cast<double>(parts->settings.size);
  }
  const eval::ViewEncoding made = eval::encode_for_views(
      encoder, scene, views_of(parts->capture, *parts->loader, "train"), how, hears);
  io::write_weights_ply(parts->file("weights.ply"), made.importance.weights);
  const std::string stream = parts->file("scene.l4d");
  parts->write("scene.l4d", made.encoding.stream);
  report->stream_bytes = made.encoding.stream.size();
  if (made.refit) report->stream_fidelity = made.refit->checked();
  StreamViews views(stream, parts->capture, *parts->loader, parts->options.background,
                    rendering_of(parts->settings, parts->options.threads));
  const auto render = [&](uint32_t view) { return views.render(view); };
  io::write_png(parts->file("stream.png"), parts->sample().beside(parts->trainer.get(), render));
  report->stream_train = score(*parts, "train", render);
  report->stream_test = score(*parts, "test", render);
  if (parts->settings.size == 0) {
    const std::string note =
        note_of_stream(report->train.plain.mean_psnr, report->stream_train.plain.mean_psnr,
                       parts->settings.codec == "settle");
    if (!note.empty()) parts->say(note);
  } else if (!made.search.result().met) {
    parts->say("The stream has " + std::to_string(report->stream_bytes) + " bytes, more than the " +
               std::to_string(parts->settings.size) + " of --size");
  }
}

}  // namespace

RunReport write_results(RunParts* parts, Steps* steps) {
  parts->observer->update(0, 0, "writing the scene");
  parts->times.begin(kWriting);
  const ModelState model = parts->trainer->model();
  io::Scene scene = scene_of(model, parts->capture.timeline());
  scene.presentation = first_view(parts->capture, *parts->loader);
  io::write_l4d_ply(parts->file("scene.ply"), scene);
  scene.presentation = as_read(scene.presentation);  // streams of both have the same bytes
  io::write_cameras(parts->file("cameras.json"),
                    views_of(parts->capture, *parts->loader, "train").set);
  if (parts->refinement) {
    write_refined(parts->file("refined.json"), parts->capture,
                  parts->settings.reading.frames.empty());
    parts->say(parts->refinement->notes());
  }
  steps->write_preview();
  parts->times.begin(kWriting);
  steps->write_curves();

  RunReport report = describe_capture(parts->capture, *parts->loader);
  report.settings = parts->settings;
  report.background = parts->options.background;
  report.gaussians = model.count;
  if (parts->settings.backend == "cuda") report.devices = devices_of(parts->settings.devices);
  steps->describe(&report);
  for (const CaptureCamera& camera : parts->capture.cameras) {
    if (parts->refinement && camera.split == "train") {
      report.refined.emplace_back(camera.name, camera.change);
    }
  }
  if (parts->lpips) report.lpips = parts->lpips->network();
  const auto render = [&](uint32_t view) { return parts->trainer->render(view); };
  parts->observer->update(0, 0, "comparing with the captured images");
  parts->times.begin(kComparison);
  report.train = score(*parts, "train", render);
  report.test = score(*parts, "test", render);
  parts->say(notes_of_cameras(report.train));
  parts->times.begin(kEncoding);
  if (!parts->options.preset.empty()) encode(scene, parts, &report);
  report.notes = parts->notes;
  report.seconds = parts->times.seconds(parts->store->seconds_waited() - parts->first_wait,
                                        parts->trainer->seconds_swapping());
  report.total_seconds =
      parts->seconds_before +
      std::chrono::duration<double>(RunParts::Clock::now() - parts->started).count();
  parts->write("report.json", json_of(report) + "\n");
  parts->write("report.html", page_of(report, parts->capture, steps->curves()));
  steps->finish_writing();
  return report;
}

}  // namespace l4d::train

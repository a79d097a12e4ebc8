// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/drawn_scene.h"

#include <memory>
#include <mutex>

#include "cli/input/rendering.h"
#include "cli/text/json.h"
#include "eval/views/views.h"
#include "io/camera/first_view.h"

namespace l4d::cli {
namespace {

constexpr int kPngLevel = 1;  // of zlib: a picture goes no farther than this machine

// Answers several threads, one after the other.
class DrawnScene {
 public:
  DrawnScene(Context& context, const Input& input, const ImportArguments& arguments)
      : scene_(render_input(context, input, arguments)), first_(scene_.presentation()) {
    const float black[3] = {};
    scene_.set_background(black);
    if (first_.has_camera != 0) return;
    const io::Scene instant = scene_.instant(eval::middle_of(scene_.timeline()));
    io::state_first_view(instant, &first_, context.budget().holder());
    if (first_.has_camera == 0) throw Failure(L4D_ERR_INVALID_SCENE, "nothing of it is visible");
  }
  const l4d_timeline& timeline() const { return scene_.timeline(); }
  std::string draw(const PictureRequest& wanted) {
    const std::lock_guard<std::mutex> lock(mutex_);
    scene_.set_time(wanted.time);
    const l4d_presentation view = io::turned(first_, wanted.angle, wanted.rise, wanted.zoom);
    scene_.render(io::camera_of(view, wanted.width, wanted.height), &image_);
    return io::encode_png(image_, kPngLevel);
  }

 private:
  std::mutex mutex_;
  eval::RenderedScene scene_;
  l4d_presentation first_;
  io::Image image_;
};

}  // namespace

Pictures draw_pictures(Context& context, const Input& input, const ImportArguments& arguments) {
  const auto scene =
      about(input.name(), [&] { return std::make_shared<DrawnScene>(context, input, arguments); });
  const l4d_timeline& t = scene->timeline();
  Pictures out;
  out.scene =
      Json{{"name", input.name()}, {"begin", t.time_begin}, {"end", t.time_begin + io::duration(t)}}
          .dump();
  out.draw = [scene](const PictureRequest& wanted) { return scene->draw(wanted); };
  return out;
}

}  // namespace l4d::cli

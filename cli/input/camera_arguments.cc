// SPDX-License-Identifier: Apache-2.0
#include "cli/input/camera_arguments.h"

#include <algorithm>
#include <charconv>
#include <filesystem>

#include "cli/command/values.h"
#include "cli/text/units.h"
#include "io/camera/colmap.h"

namespace l4d::cli {

std::string cameras_help() { return std::string("Cameras to look from: ") + io::kCameraFiles; }

void CameraArguments::add_options(Verb* verb, const std::string* seconds) {
  seconds_ = seconds;
  const std::string group = "Cameras and views";
  auto* file =
      verb->add_option("--cameras", cameras, cameras_help())->type_name("FILE")->group(group);
  auto* made_up = verb->add_option("--orbit", orbit,
                                   "In place of --cameras, N cameras made up around the scene")
                      ->type_name("N")
                      ->whole_number(1, 100000)
                      ->group(group);
  file->excludes(made_up);
  verb->add_option("--size", size, "Image size of --orbit (default: 640x360)")
      ->type_name("WxH")
      ->group(group);
  verb->add_option("--split", split, "Views of these cameras only: train, test, val or all")
      ->type_name("NAME")
      ->one_of({"train", "test", "val", "all"})
      ->group(group);
  verb->add_option("--ids", ids, "Cameras with these ids only: 0,10,15 or 0-3")
      ->type_name("LIST")
      ->group(group);
  verb->add_option("--frames", frames,
                   "These frames only: first:end:step (without the end), first:end, or one")
      ->type_name("RANGE")
      ->group(group);
  add_any_path_option(verb, any_path)->group(group)->needs(file);
}

Option* add_any_path_option(Verb* verb, bool& any_path) {
  return verb->add_flag("--any-path", any_path,
                        "Read videos and images wherever the file of cameras says that they are, "
                        "and not only in its folder and below");
}

namespace {

// Whether the file is there; if so, the command does not write it.
bool keep_seen(Context& context, const io::Camera& camera, const std::string& path) {
  std::error_code error;
  if (path.empty() || !std::filesystem::exists(path, error)) return false;
  context.files.keep(path, "what camera " + std::to_string(camera.id) + " saw");
  return true;
}

// Images of any frame: frames may be missing, also the first ones.
void keep_numbered(Context& context, const io::Camera& camera) {
  const std::filesystem::path folder = std::filesystem::path(camera.images).parent_path();
  if (io::is_image_pattern(folder.string())) {  // each frame has a folder of its own
    uint32_t frame = 0;
    while (keep_seen(context, camera, io::numbered_image(camera, frame))) ++frame;
    return;
  }
  std::error_code error;
  std::filesystem::directory_iterator entry(folder.empty() ? "." : folder, error);
  for (; !error && entry != std::filesystem::directory_iterator(); entry.increment(error)) {
    if (io::is_numbered_image(camera.images, entry->path().filename().string())) {
      keep_seen(context, camera, entry->path().string());
    }
  }
}

// The files of a model of COLMAP, of which only the folder is named.
void keep_model(Context& context, const std::string& path) {
  const std::string model = io::find_colmap_model(path);
  std::error_code error;
  if (model.empty()) return;
  for (const auto& entry : std::filesystem::directory_iterator(model, error)) {
    if (entry.is_regular_file(error)) context.files.keep(entry.path().string(), "of the cameras");
  }
}

}  // namespace

io::CameraSet read_camera_file(Context& context, const std::string& path, bool any_path) {
  context.files.add_input(path, "--cameras");
  keep_model(context, path);
  io::CameraSet set = io::read_cameras(path, any_path, context.budget().holder());
  set.image_memory = context.captured_memory();
  for (const io::Camera& camera : set.cameras) {
    keep_seen(context, camera, camera.video);
    keep_seen(context, camera, camera.image);
    if (io::is_image_pattern(camera.images)) keep_numbered(context, camera);
  }
  return set;
}

const io::CameraSet* CameraArguments::load(Context& context) const {
  if (cameras.empty()) return nullptr;
  if (!set_) {
    io::CameraSet set = read_camera_file(context, cameras, any_path);
    if (!seconds_->empty()) set.seconds = parse_seconds(*seconds_, "--seconds");
    set_ = std::make_shared<io::CameraSet>(std::move(set));
  }
  return set_.get();
}

void CameraArguments::check() const {
  if (given()) require_renderer(cameras.empty() ? "--orbit" : "--cameras");
  const std::pair<const char*, const std::string*> dependent[] = {
      {"--split", &split}, {"--ids", &ids}, {"--frames", &frames}};
  for (const auto& [option, value] : dependent) {
    if (!given() && !value->empty()) {
      throw usage_error(std::string(option) + " needs --cameras or --orbit");
    }
  }
  if (orbit == 0 && !size.empty()) throw usage_error("--size needs --orbit");
  uint32_t width, height;
  if (!size.empty()) parse_image_size(size, &width, &height);
}

void parse_image_size(const std::string& text, uint32_t* width, uint32_t* height) {
  const char* end = text.data() + text.size();
  const auto side = std::from_chars(text.data(), end, *width);
  if (side.ec == std::errc() && side.ptr != end && *side.ptr == 'x') {
    const auto other = std::from_chars(side.ptr + 1, end, *height);
    const auto fits = [](uint32_t n) { return n >= 1 && n <= L4D_MAX_IMAGE_SIDE; };
    if (other.ec == std::errc() && other.ptr == end && fits(*width) && fits(*height)) return;
  }
  throw usage_error("--size: '" + text + "' is no size of 1 to " +
                    std::to_string(L4D_MAX_IMAGE_SIDE) + " pixels a side, as 640x360");
}

void made_up_size(const std::string& size, uint32_t* width, uint32_t* height) {
  *width = 640;
  *height = 360;
  if (!size.empty()) parse_image_size(size, width, height);
}

io::CameraSet make_orbit(Context& context, io::Scene instant, uint32_t count,
                         const std::string& size) {
  uint32_t width, height;
  made_up_size(size, &width, &height);
  if (instant.has_found_view) instant.presentation.has_camera = 0;
  return io::orbit_cameras(instant, count, width, height, context.budget().holder());
}

void note_cameras(Context& context, const io::CameraSet& set) {
  for (const std::string& note : io::notes_of_pinholes(set)) context.note(note);
}

void check_captured(const eval::CameraViews& all) {
  for (size_t view = 0; view < all.views.size(); ++view) {
    io::require_inside(all.set, all.camera_of(view));
  }
}

namespace {

// Says where times of cameras are in the sequence: files of D-NeRF do not state their unit.
void note_times(Context& context, const eval::CameraViews& all, const l4d_timeline& timeline) {
  double last = -1;
  for (size_t view = 0; view < all.views.size(); ++view) {
    last = std::max(last, all.camera_of(view).time.value_or(-1) * all.set.seconds);
  }
  if (last < 0) return;
  const double end = io::duration(timeline);
  context.note("Times of cameras are multiplied by --seconds (" + format_number(all.set.seconds) +
               "): the last view is at " + format_time(last) + " s, and the sequence lasts " +
               format_time(end) + " s" +
               (last > end ? "; views after its end show its end." : "."));
}

}  // namespace

eval::CameraViews choose_views(Context& context, const CameraArguments& arguments,
                               const std::string& split, const l4d_timeline& timeline,
                               const std::function<io::Scene()>& instant) {
  eval::CameraViews result;
  result.set = arguments.orbit > 0 ? make_orbit(context, instant(), arguments.orbit, arguments.size)
                                   : *arguments.load(context);
  const auto& cameras = result.set.cameras;
  io::ViewSelection selection;
  selection.ids = arguments.ids;
  selection.frames = arguments.frames;
  const bool has_split = std::any_of(cameras.begin(), cameras.end(),
                                     [&](const io::Camera& c) { return c.split == split; });
  // Ids name cameras of any split.
  if (!arguments.split.empty()) {
    selection.split = arguments.split;
  } else if (arguments.ids.empty() && has_split) {
    selection.split = split;
  }
  result.views =
      about(arguments.cameras, [&] { return io::select_views(result.set, selection, timeline); });
  note_cameras(context, result.set);
  note_times(context, result, timeline);
  return result;
}

}  // namespace l4d::cli

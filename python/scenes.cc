// SPDX-License-Identifier: Apache-2.0
#include "python/scenes.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <iterator>
#include <memory>
#include <new>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "eval/errors.h"
#include "eval/observer.h"
#include "eval/pair/comparison.h"
#include "eval/pair/pairing.h"
#include "eval/scene/decoded_scene.h"
#include "eval/scene/shown_members.h"
#include "io/camera/cameras.h"
#include "io/camera/first_view.h"
#include "io/file/output_name.h"
#include "io/formats/instant_file.h"
#include "io/formats/raw_arrays.h"
#include "io/formats/scene_file.h"
#include "io/formats/write_4dgs.h"
#include "io/ply/scene_ply.h"
#include "io/scene/scene.h"
#include "io/sequence/sequence.h"
#include "l4d/l4d.hpp"
#include "l4d/members.h"

struct l4dpy_scene {
  l4d::eval::DecodedScene decoded;
  std::string notes;
};

struct l4dpy_movie {
  l4d::eval::ShownMembers members;
};

namespace {

using l4d::eval::DecodedScene;

// Calls body(). Exceptions end here: they become the status and the message of the thread.
template <typename Body>
l4d_status guarded(const Body& body) noexcept {
  try {
    body();
    return L4D_OK;
  } catch (const l4d::io::Error& error) {
    l4d_keep_error_message_(error.what());
    return error.status();
  } catch (const l4d::Error& error) {
    l4d_keep_error_message_(l4d::eval::detail_of(error).c_str());
    return error.status();
  } catch (const std::bad_alloc&) {
    l4d_keep_error_message_("out of memory");
    return L4D_ERR_OUT_OF_MEMORY;
  } catch (const std::exception& error) {
    l4d_keep_error_message_(error.what());
    return L4D_ERR_INTERNAL;
  }
}

// Ends an evaluation when another thread has set the flag of the caller.
class Flag : public l4d::eval::Observer {
 public:
  explicit Flag(const int32_t* flag) : flag_(flag) {}
  bool cancelled() const override {
    return flag_ != nullptr && __atomic_load_n(flag_, __ATOMIC_RELAXED) != 0;
  }

 private:
  const int32_t* flag_;
};

l4d::io::Check check_of(const int32_t* cancel) {
  return [cancel] { Flag(cancel).check(); };
}

template <typename T>
void copy(const T* from, size_t n, std::vector<T>* to) {
  if (from != nullptr) to->assign(from, from + n);
}

l4dpy_scene* new_scene(l4d::io::Scene scene) {
  auto out = std::make_unique<l4dpy_scene>();
  for (const std::string& note : scene.notes) out->notes += note + '\n';
  out->decoded.scene = std::move(scene);
  return out.release();
}

l4d::io::Scene copy_of(const l4dpy_parts& parts) {
  const l4d_gaussians& g = parts.gaussians;
  const size_t n = static_cast<size_t>(g.count);
  l4d::io::Scene scene;
  scene.sh_degree = g.sh_degree;
  scene.flags = g.flags;
  l4d::for_each_attribute(
      [&](const l4d::AttributeInfo& a, const float* from, std::vector<float>& to) {
        copy(from, n * a.numbers(g.sh_degree), &to);
      },
      g, scene);
  copy(g.window, 2 * n, &scene.window);
  if (g.mean_t_double != nullptr) {
    scene.set_mean_times(std::vector<double>(g.mean_t_double, g.mean_t_double + n));
  }
  scene.timeline = parts.timeline;
  scene.placement = parts.placement;
  scene.rendering = parts.rendering;
  scene.presentation = parts.presentation;
  scene.source = "python";
  if (!(scene.placement.scale > 0 && std::isfinite(scene.placement.scale))) {
    throw l4d::io::Error(L4D_ERR_INVALID_ARGUMENT, "placement: scale must be above 0 and finite");
  }
  return scene;
}

void add(const char* name, const char* meaning, double max, double rmse, double p999,
         l4dpy_comparison* out) {
  if (out->num_errors == L4DPY_MAX_ERRORS) {
    throw l4d::io::Error(L4D_ERR_INTERNAL, "more errors than L4DPY_MAX_ERRORS");
  }
  out->errors[out->num_errors++] = {name, meaning, max, rmse, p999};
}

void write_comparison(const l4d::eval::Comparison& c, l4dpy_comparison* out) {
  *out = {};
  out->count_a = c.count_a;
  out->count_b = c.count_b;
  out->matched = c.pairing.matched;
  out->equal_rows = c.pairing.equal_rows;
  out->identical = c.identical() ? 1 : 0;
  c.pairing.match.copy(out->match, sizeof out->match - 1);
  if (!c.pairing.is_known()) return;
  for (const l4d::eval::AttributeError& e : c.attributes) {
    add(e.name, e.meaning, e.max, e.rmse, std::nan(""), out);
  }
  for (const l4d::eval::SeenError& e : c.seen) {
    add(e.name, e.meaning, e.max, std::nan(""), e.p999, out);
  }
  add("visible_position", "distance while visible, scene units", c.visible.max, c.visible.rmse,
      c.visible.p999, out);
}

l4d::io::ImportOptions import_options(double seconds, double fps, int32_t activated) {
  l4d::io::ImportOptions options;
  options.seconds = seconds;
  options.fps = fps;
  options.activated = activated != 0;
  return options;
}

// Whether a file is one stream that shows all of its sequence at its own times. One whose members
// cannot be listed, or of which no media member is whole, counts as that: a decoder may still read
// it in part, and shows the first standing member.
bool is_plain(const l4d_reader& reader, const l4d_timeline& timeline) {
  l4d_members* list = nullptr;
  l4d_members_info info = L4D_INIT(l4d_members_info);
  l4d_member first = L4D_INIT(l4d_member);
  l4d_status status = l4d_members_open(&reader, nullptr, &list);
  if (status == L4D_OK) status = l4d_members_get_info(list, &info);
  if (status == L4D_OK) status = l4d_members_get(list, 0, &first);
  bool has_media = false;
  l4d_member member = L4D_INIT(l4d_member);
  for (uint64_t i = 0; status == L4D_OK && i < info.count; ++i) {
    status = l4d_members_get(list, i, &member);
    has_media |= member.role == L4D_MEMBER_MEDIA;
  }
  l4d_members_destroy(list);
  if (!has_media) return true;
  if (status != L4D_OK) return true;
  const l4d_timeline shown =
      l4d::eval::timeline_between(timeline, first.sequence_begin, first.sequence_end);
  return info.count == 1 && first.role == L4D_MEMBER_MEDIA && first.num_needs == 0 &&
         first.shift == 0 && shown.time_begin == timeline.time_begin &&
         shown.num_frames == timeline.num_frames;
}

// `first`, then a line for each note, cut to `size` bytes with the zero at the end.
void put_notes(std::string first, const l4d::io::WriteNotes& found, char* notes, size_t size) {
  for (const auto& [text, count] : found) {
    first += (count == 0 ? text : std::to_string(count) + " " + text) + '\n';
  }
  if (size > 0) notes[first.copy(notes, size - 1)] = 0;
}

}  // namespace

l4d_status l4dpy_check_name(const char* name, const char* written) {
  return guarded([&] {
    std::vector<std::string> kinds;
    std::istringstream words(written);
    for (std::string kind; words >> kind;) kinds.push_back(kind);
    const std::string refusal = l4d::io::name_at_odds(name, kinds);
    if (!refusal.empty()) {
      throw l4d::io::Error(L4D_ERR_INVALID_ARGUMENT, "`output`: " + refusal);
    }
  });
}

l4d_status l4dpy_is_scene_file(const char* path, int32_t* out) {
  return guarded([&] {
    const std::string refusal = l4d::io::foreign_refusal(path, path);
    if (!refusal.empty()) throw l4d::Error(L4D_ERR_FEATURE_UNSUPPORTED, path + refusal);
    *out = l4d::io::is_scene_file(path, path) ? 1 : 0;
  });
}

l4d_status l4dpy_read_file(const char* path, double seconds, double fps, int32_t activated,
                           l4dpy_scene** out) {
  return guarded([&] {
    const l4d::io::ImportOptions options = import_options(seconds, fps, activated);
    l4d::io::Scene scene = l4d::io::read_scene_file(path, path, options);
    for (std::string& note : l4d::io::unused_options(options, scene.timeline, scene.source)) {
      scene.notes.push_back(std::move(note));
    }
    *out = new_scene(std::move(scene));
  });
}

void l4dpy_subtract_origin(const double* positions, uint64_t count, l4d_placement* placement,
                           float* out) {
  l4d::io::subtract_origin(positions, static_cast<size_t>(count), placement, out);
}

l4d_status l4dpy_read_frames(const char* paths, double fps, int32_t match, const double* errors,
                             uint32_t threads, const int32_t* cancel, l4dpy_scene** out) {
  return guarded([&] {
    l4d::io::SequenceOptions options;
    std::istringstream lines(paths);
    for (std::string line; std::getline(lines, line);) options.paths.push_back(line);
    options.fps = fps;
    options.match = static_cast<l4d::io::SequenceMatch>(match);
    options.threads = static_cast<int>(threads);
    double* const tolerances[] = {&options.tolerance.position, &options.tolerance.scale,
                                  &options.tolerance.rotation, &options.tolerance.color,
                                  &options.tolerance.opacity};
    for (size_t k = 0; k < std::size(tolerances); ++k) {
      if (errors[k] >= 0) *tolerances[k] = errors[k];
    }
    const Flag flag(cancel);
    options.progress = [&](size_t, size_t) { flag.check(); };
    *out = new_scene(l4d::io::read_sequence(options));
  });
}

l4d_status l4dpy_read_stream(const l4d_reader* reader, double seconds, double fps,
                             int32_t activated, l4dpy_scene** out) {
  return guarded([&] {
    l4d::DecoderHandle decoder;
    decoder.open(*reader);
    auto scene = std::make_unique<l4dpy_scene>();
    scene->decoded = l4d::eval::decode_scene(decoder);
    for (const std::string& note : l4d::io::unused_options(import_options(seconds, fps, activated),
                                                           scene->decoded.scene.timeline, "l4d")) {
      scene->notes += note + '\n';
    }
    *out = scene.release();
  });
}

l4d_status l4dpy_copy(const l4dpy_parts* parts, l4dpy_scene** out) {
  return guarded([&] { *out = new_scene(copy_of(*parts)); });
}

l4d_status l4dpy_state_first_view(l4dpy_parts* parts) {
  return guarded([&] { l4d::io::state_first_view(copy_of(*parts), &parts->presentation); });
}

void l4dpy_destroy(l4dpy_scene* scene) { delete scene; }

void l4dpy_get(const l4dpy_scene* scene, l4dpy_parts* out) {
  const l4d::io::Scene& s = scene->decoded.scene;
  *out = {s.view(),       s.timeline,       s.placement,         s.rendering,
          s.presentation, s.source.c_str(), scene->notes.c_str()};
}

l4d_status l4dpy_write_scene(const l4dpy_scene* scene, const char* format, const char* path,
                             const int32_t* cancel, char* notes, size_t size) {
  return guarded([&] {
    const std::string name = format;
    const l4d::io::Check check = check_of(cancel);
    l4d::io::WriteNotes found;
    if (name == "l4d") {
      l4d::io::write_l4d_ply(path, scene->decoded.scene, check);
    } else if (name == "ftgs") {
      found = l4d::io::write_ftgs_ply(path, scene->decoded.scene, check);
    } else if (name == "stg") {
      found = l4d::io::write_stg_ply(path, scene->decoded.scene, check);
    } else if (name == "4dgs") {
      found = l4d::io::write_4dgs(path, scene->decoded.scene, check);
    } else if (name == "raw") {
      l4d::io::write_raw(path, scene->decoded.scene, check);
    } else {
      throw l4d::io::Error(
          L4D_ERR_INVALID_ARGUMENT,
          "the format is '" + name + "'; it must be 'l4d', 'ftgs', 'stg', '4dgs' or 'raw'");
    }
    put_notes("", found, notes, size);
  });
}

l4d_status l4dpy_write_splats(const l4d_splat_buffers* splats, uint32_t sh_degree,
                              const l4dpy_parts* setting, const char* extension, const char* path,
                              const int32_t* cancel, char* notes, size_t size) {
  return guarded([&] {
    const std::vector<std::string> known = l4d::io::instant_extensions();
    if (std::find(known.begin(), known.end(), extension) == known.end()) {
      std::string names;
      for (const std::string& name : known) names += (names.empty() ? "" : ", ") + name;
      throw l4d::io::Error(L4D_ERR_INVALID_ARGUMENT,
                           std::string(path) + ": a file of an instant ends in one of " + names);
    }
    const size_t n = static_cast<size_t>(splats->count);
    l4d::io::Splats s;
    s.sh_degree = sh_degree;
    copy<float>(splats->position, 3 * n, &s.position);
    copy<float>(splats->covariance, 6 * n, &s.covariance);
    copy<float>(splats->opacity, n, &s.opacity);
    copy<float>(splats->sh, 3 * n * (sh_degree + 1) * (sh_degree + 1), &s.sh);
    const l4d::io::WriteNotes found =
        l4d::io::write_instant_file(path, extension, std::move(s),
                                    {setting->placement,
                                     setting->rendering,
                                     setting->presentation.metres_per_unit,
                                     {},
                                     check_of(cancel)});
    put_notes(l4d::io::loss_of_instants(extension) + '\n', found, notes, size);
  });
}

l4d_status l4dpy_compare(const l4dpy_scene* a, const l4dpy_scene* b, const uint32_t* order,
                         uint64_t num_order, uint32_t threads, const int32_t* cancel,
                         l4dpy_comparison* out) {
  return guarded([&] {
    const Flag flag(cancel);
    const DecodedScene &from = a->decoded, &to = b->decoded;
    const DecodedScene* stream = from.levels.empty() ? nullptr : &from;
    l4d::eval::Pairing pairing =
        order != nullptr ? l4d::eval::pair_by_order(from.scene, to.scene,
                                                    std::vector<uint32_t>(order, order + num_order))
                         : l4d::eval::pair_by_content(from.scene, to, threads, {}, stream, flag);
    flag.check();
    write_comparison(
        l4d::eval::compare_scenes(from.scene, to, std::move(pairing), threads, {}, stream), out);
  });
}

l4d_status l4dpy_movie_open(const l4d_reader* reader, const l4d_decoder_options* options,
                            const l4d_timeline* timeline, l4dpy_movie** out) {
  return guarded([&] {
    *out = is_plain(*reader, *timeline) ? nullptr : new l4dpy_movie{{*reader, *options}};
  });
}

void l4dpy_movie_destroy(l4dpy_movie* movie) { delete movie; }

l4d_status l4dpy_movie_get(l4dpy_movie* movie, l4d_timeline* timeline, uint64_t* num_gaussians,
                           l4d_decoder** first) {
  return guarded([&] {
    *timeline = movie->members.timeline();
    *num_gaussians = movie->members.num_gaussians();
    *first = movie->members.first().get();
  });
}

l4d_status l4dpy_movie_show(l4dpy_movie* movie, double time, l4dpy_shown* out, uint64_t capacity,
                            uint64_t* count) {
  return guarded([&] {
    const auto& shown = movie->members.show(time);
    movie->members.close_others();
    *count = shown.size();
    for (size_t i = 0; i < std::min<uint64_t>(capacity, *count); ++i) {
      out[i] = {shown[i].decoder->get(), shown[i].time, shown[i].shift};
    }
  });
}

l4d_status l4dpy_read_cameras(const char* path, l4d_camera* out, int32_t* ids, uint64_t capacity,
                              uint64_t* count, char* notes, size_t size) {
  return guarded([&] {
    const l4d::io::CameraSet set = l4d::io::read_cameras(path);
    *count = set.cameras.size();
    std::string lines;
    for (const std::string& note : l4d::io::notes_of_pinholes(set)) lines += note + '\n';
    put_notes(std::move(lines), {}, notes, size);
    for (size_t i = 0; i < std::min<uint64_t>(capacity, *count); ++i) {
      out[i] = set.cameras[i].camera;
      ids[i] = set.cameras[i].id;
    }
  });
}

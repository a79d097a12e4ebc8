// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <set>
#include <string>
#include <utility>

#include "io/file/safetensors.h"
#include "io/formats/raw_arrays.h"
#include "io/formats/readers.h"
#include "io/scene/counted.h"
#include "io/scene/statements.h"

namespace l4d::io {
namespace {

[[noreturn]] void fail(const TensorFile& file, l4d_status status, const std::string& message) {
  throw Error(status, file.path() + ": " + message);
}

uint32_t whole_number(const TensorFile& file, const char* key, uint32_t most) {
  const char* text = file.metadata(key);
  uint32_t value = 0;
  if (text == nullptr) fail(file, L4D_ERR_CORRUPT, std::string("the metadata lack ") + key);
  const char* end = text + std::strlen(text);
  const auto result = std::from_chars(text, end, value);
  if (result.ec != std::errc() || result.ptr != end || value > most) {
    fail(file, L4D_ERR_CORRUPT,
         std::string(key) + " of the metadata is '" + text + "'; it must be a whole number up to " +
             std::to_string(most));
  }
  return value;
}

void check_schema(const TensorFile& file) {
  const char* schema = file.metadata("schema");
  if (schema == nullptr) {
    fail(file, L4D_ERR_FEATURE_UNSUPPORTED,
         "a file of tensors that `decode --format raw` did not write: its metadata lack `schema`; "
         "docs/formats.md lists the arrays and metadata of a scene");
  }
  if (std::strcmp(schema, "l4dcodec.raw/1") != 0) {
    fail(file, L4D_ERR_FEATURE_UNSUPPORTED,
         std::string("the schema ") + schema + "; it must be l4dcodec.raw/1");
  }
  const char* form = file.metadata("form");
  if (form == nullptr || std::strcmp(form, "attributes") != 0) {
    fail(file, L4D_ERR_FEATURE_UNSUPPORTED,
         "arrays that are no attributes: codes without their codebooks make no scene");
  }
}

// What is stated twice says the same.
void check_repeated(const TensorFile& file, uint64_t count, uint32_t flags) {
  const bool is_logit = (flags & L4D_OPACITY_LOGIT) != 0;
  const bool at_mean_time = (flags & L4D_POSITION_AT_MEAN_TIME) != 0;
  const std::pair<const char*, std::string> stated[] = {
      {"byte_order", "little"},
      {"num_gaussians", std::to_string(count)},
      {"opacity", is_logit ? "logit" : "linear"},
      {"position_at", at_mean_time ? "mean_time" : "reference_time"}};
  for (const auto& [key, expected] : stated) {
    const char* text = file.metadata(key);
    if (text == nullptr || text == expected) continue;
    fail(file, L4D_ERR_CORRUPT,
         std::string(key) + " of the metadata is '" + text + "', and the rest of the file says " +
             expected);
  }
}

void read_timeline(const TensorFile& file, const TextOf& text_of, const ImportOptions& options,
                   Scene* scene) {
  l4d_timeline& timeline = scene->timeline;
  if (const char* unit = text_of("time_unit"); unit != nullptr && std::strcmp(unit, "seconds") != 0)
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED, "time_unit is not seconds");
  if (options.fps > 0 && text_of("fps") == nullptr) {
    set_fps(timeline, options.fps);
  } else {
    read_stated_fps(text_of, &timeline);
  }
  timeline.time_begin = stated_number(text_of, "time_begin", 0);
  const bool has_frames = text_of("num_frames") != nullptr,
             has_end = text_of("time_end") != nullptr;
  const double seconds = stated_number(text_of, "time_end", 0) - timeline.time_begin;
  if (has_frames) {
    timeline.num_frames = whole_number(file, "num_frames", L4D_MAX_FRAMES);
    const double frame = static_cast<double>(timeline.fps_den) / timeline.fps_num;
    if (has_end && !(std::abs(duration(timeline) - seconds) <= frame / 2)) {
      throw Error(L4D_ERR_CORRUPT,
                  "num_frames and fps of the metadata are " + text_of_number(duration(timeline)) +
                      " seconds, time_begin and time_end are " + text_of_number(seconds));
    }
  } else if (has_end) {
    set_duration(timeline, seconds);
  } else {
    set_duration(timeline, options.seconds > 0 ? options.seconds : 1);
    scene->notes.push_back("The file has no timeline; " + text_of_number(duration(timeline)) +
                           " seconds were assumed.");
  }
}

void read_statements(const TensorFile& file, const ImportOptions& options, Scene* scene) {
  const TextOf text_of = [&](const std::string& key) { return file.metadata(key); };
  try {
    read_timeline(file, text_of, options, scene);
    read_stated_placement(text_of, scene);
  } catch (const Error& error) {
    fail(file, error.status() == L4D_ERR_FEATURE_UNSUPPORTED ? error.status() : L4D_ERR_CORRUPT,
         error.what());
  }
}

void note_unread(const TensorFile& file, const std::set<std::string>& read, Scene* scene) {
  static const std::set<std::string> kOwn = {"schema",     "form",          "sh_degree",
                                             "flags",      "num_gaussians", "opacity",
                                             "byte_order", "position_at",   "num_frames"};
  for (const std::string& key : file.metadata_keys()) {
    if (is_statement(key) || kOwn.count(key) != 0) continue;
    scene->notes.push_back("The metadata " + list_of_names({key}) +
                           " are not known and were not read.");
  }
  std::vector<std::string> unread;
  for (const std::string& name : file.names()) {
    if (read.count(name) == 0) unread.push_back(name);
  }
  if (unread.empty()) return;
  scene->notes.push_back(counted(unread.size(), "array was", "arrays were") +
                         " not read: " + list_of_names(unread) + ".");
}

}  // namespace

Scene read_raw(InputFile input, const ImportOptions& options) {
  TensorFile file(std::move(input), options.holder);
  check_schema(file);
  Scene scene;
  scene.source = "raw";
  scene.sh_degree = whole_number(file, "sh_degree", 3);
  scene.flags = whole_number(file, "flags", L4D_POSITION_AT_MEAN_TIME | L4D_OPACITY_LOGIT);
  read_statements(file, options, &scene);
  const std::vector<uint64_t>* shape = file.shape_of("mean_t");
  if (shape == nullptr || shape->size() != 1) {
    fail(file, L4D_ERR_CORRUPT, "there is no array mean_t of one dimension");
  }
  const uint64_t n = shape->front();
  // Counts of other arrays follow from this one, which the reader holds against the file.
  std::set<std::string> read = {"buckets", "mean_t_local"};  // what follows from others
  std::vector<TensorTarget> targets;
  const auto want = [&](const char* name, std::vector<uint64_t> dimensions, auto* to) {
    targets.push_back({{name, std::move(dimensions)}, to});
    read.insert(name);
  };
  for_each_attribute(
      [&](const AttributeInfo& a, std::vector<float>& to) {
        want(a.name, raw_shape(a, n, scene.sh_degree), &to);
      },
      scene);
  std::vector<double> times;
  if (file.shape_of("mean_t_exact") != nullptr) want("mean_t_exact", {n}, &times);
  if (file.shape_of("window") != nullptr) want("window", {n, 2}, &scene.window);
  scene.memory = file.hold_values(targets, options.holder);
  file.read_into(targets);
  check_repeated(file, n, scene.flags);
  if (!times.empty()) scene.set_mean_times(std::move(times));
  if (std::all_of(scene.window.begin(), scene.window.end(), [](uint32_t f) { return f == 0; })) {
    scene.window.clear();
  }
  note_unread(file, read, &scene);
  return scene;
}

}  // namespace l4d::io

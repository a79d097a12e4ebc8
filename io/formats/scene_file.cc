// SPDX-License-Identifier: Apache-2.0
#include "io/formats/scene_file.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <new>
#include <utility>

#include "io/file/file_kind.h"
#include "io/formats/readers.h"
#include "io/ply/read_ply.h"

namespace l4d::io {
namespace {

using Reader = Scene (*)(InputFile file, const ImportOptions& options);

struct KnownReader {
  const char* extension;  // as file_kind.h names the kind
  Reader read;
};
constexpr KnownReader kReaders[] = {
    {".safetensors", read_raw}, {".spz", read_spz},       {".sog", read_sog},
    {".splat", read_splat},     {".ksplat", read_ksplat}, {".4dgs", read_4dgs},
    {".splatv", read_splatv},   {".glb", read_gltf},      {".gltf", read_gltf}};

// Whose columns are for logits and logarithms.
constexpr const char* kTakesActivated[] = {"3dgs_ply", "ftgs_ply", "stg_ply", "rt4dgs_ply"};

// Nothing for a PLY, and for what has no reader.
Reader reader_of(const std::string& path, const std::string& name) {
  const std::optional<FileKind> kind = identify_file(path, name);
  if (!kind) return nullptr;
  for (const KnownReader& known : kReaders) {
    if (kind->extension == known.extension) return known.read;
  }
  return nullptr;
}

}  // namespace

bool is_scene_file(const std::string& path, const std::string& name) {
  return is_ply(path) || reader_of(path, name) != nullptr;
}

bool has_scene_name(const std::string& name) {
  const std::string extension = lower_extension(name);
  return extension == ".ply" ||
         std::any_of(std::begin(kReaders), std::end(kReaders),
                     [&](const KnownReader& known) { return extension == known.extension; });
}

std::string foreign_refusal(const std::string& path, const std::string& name) {
  if (is_scene_file(path, name)) return "";
  const std::optional<FileKind> foreign = identify_file(path, name);
  if (!foreign) return "";
  return ": this is " + foreign->name + ", and no stream or PLY; " + foreign->way;
}

std::string list_of_scene_files() {
  std::string list = ".ply";
  for (const KnownReader& known : kReaders) list += std::string(", ") + known.extension;
  return list;
}

Scene read_scene_file(const std::string& path, const std::string& name,
                      const ImportOptions& options) {
  const Reader read = reader_of(path, name);
  if (read == nullptr) {
    const std::string refusal = foreign_refusal(path, name);
    if (!refusal.empty()) throw Error(L4D_ERR_FEATURE_UNSUPPORTED, name + refusal);
    if (is_stream(path)) {
      throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
                  name +
                      ": this is a stream, which is not read here; `l4dcodec decode` makes a "
                      "PLY of it, which is");
    }
    return read_scene_ply(path, options);
  }
  try {
    Scene scene = read(InputFile(path, options.holder), options);
    note_far_times(scene);
    return scene;
  } catch (const std::bad_alloc&) {
    throw Error(L4D_ERR_OUT_OF_MEMORY, path + ": not enough memory for the scene");
  }
}

std::vector<std::string> unused_options(const ImportOptions& options, const l4d_timeline& timeline,
                                        const std::string& source) {
  std::vector<std::string> unused;
  const auto is_unused = [&](const char* name, double given, const char* why, double stated) {
    char text[160];
    std::snprintf(text, sizeof(text), "%s %g is not used: the file states %s%g.", name, given, why,
                  stated);
    unused.emplace_back(text);
  };
  const double fps = static_cast<double>(timeline.fps_num) / timeline.fps_den;
  const double seconds = duration(timeline);
  // A sequence has whole frames.
  if (options.seconds > 0 && std::abs(seconds - options.seconds) > 1 / fps) {
    is_unused("--seconds", options.seconds, "a duration in seconds of ", seconds);
  }
  if (options.fps > 0 && std::abs(fps - options.fps) > 1e-4 * options.fps) {
    is_unused("--fps", options.fps, "a frame rate of ", fps);
  }
  const auto is_source = [&](const char* known) { return source == known; };
  if (options.activated &&
      std::none_of(std::begin(kTakesActivated), std::end(kTakesActivated), is_source)) {
    unused.push_back(
        "--activated is not used: it is for PLY files with columns for logits and logarithms, and "
        "this is " +
        source + ".");
  }
  return unused;
}

}  // namespace l4d::io

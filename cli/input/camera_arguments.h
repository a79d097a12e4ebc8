// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "cli/command/context.h"
#include "eval/views/views.h"
#include "io/camera/cameras.h"

namespace l4d::cli {

// Options of verbs that look at a scene from many sides.
struct CameraArguments {
  std::string cameras;
  uint32_t orbit = 0;
  std::string size;
  std::string split;
  std::string ids;
  std::string frames;
  bool any_path = false;

  // seconds: the text of --seconds, which the verb also has for PLY files; it must outlive this.
  void add_options(Verb* verb, const std::string* seconds);
  bool given() const { return !cameras.empty() || orbit > 0; }
  // Usage errors: options that say which views without saying which cameras.
  void check() const;
  // Reads --cameras, where given; the file and what it names count among the files of the command.
  // Once: what is read is kept.
  const io::CameraSet* load(Context& context) const;

 private:
  const std::string* seconds_ = nullptr;
  mutable std::shared_ptr<const io::CameraSet> set_;
};

// What help says of --cameras: the kinds of files.
std::string cameras_help();

// --any-path, of whatever reads a file of cameras.
Option* add_any_path_option(Verb* verb, bool& any_path);
// Reads a file of cameras and adds it, and what it names that is there, to the command's files.
io::CameraSet read_camera_file(Context& context, const std::string& path, bool any_path);

// "640x360"
void parse_image_size(const std::string& text, uint32_t* width, uint32_t* height);

// Of images of cameras that no file has: --size, else 640x360.
void made_up_size(const std::string& size, uint32_t* width, uint32_t* height);

// An orbit around an instant of a scene as its file states it, so that each verb makes the same;
// size as of --size.
io::CameraSet make_orbit(Context& context, io::Scene instant, uint32_t count,
                         const std::string& size);
// Says what was assumed about cameras that are used.
void note_cameras(Context& context, const io::CameraSet& set);

// Usage error where what a camera of these views saw lies where it may not be read (--any-path).
void check_captured(const eval::CameraViews& views);

// The views that the arguments ask for. `instant` gives the scene to circle, and is called for an
// orbit alone. Without --split the views of `split` are taken where the cameras have some, else
// all.
eval::CameraViews choose_views(Context& context, const CameraArguments& arguments,
                               const std::string& split, const l4d_timeline& timeline,
                               const std::function<io::Scene()>& instant);

}  // namespace l4d::cli

// SPDX-License-Identifier: Apache-2.0
#include "io/camera/cameras.h"

#include <algorithm>
#include <filesystem>
#include <iterator>

namespace l4d::io {
namespace {

// Where %d or %04d stands in a path. Paths come from files, and are no formats for printf.
struct NumberPlace {
  size_t begin, end, width;
};

std::optional<NumberPlace> number_in(const std::string& pattern) {
  const size_t begin = pattern.find('%');
  if (begin == std::string::npos) return std::nullopt;
  NumberPlace place{begin, begin + 1, 0};
  while (place.end < pattern.size() && pattern[place.end] >= '0' && pattern[place.end] <= '9') {
    const auto digit = static_cast<size_t>(pattern[place.end++] - '0');
    place.width = std::min<size_t>(10 * place.width + digit, 20);
  }
  if (place.end >= pattern.size() || pattern[place.end++] != 'd') return std::nullopt;
  return place;
}

}  // namespace

bool same_lens(const Distortion& a, const Distortion& b) {
  return a.model == b.model && std::equal(std::begin(a.k), std::end(a.k), b.k) &&
         std::equal(std::begin(a.p), std::end(a.p), b.p);
}

bool is_image_pattern(const std::string& pattern) { return number_in(pattern).has_value(); }

bool is_numbered_image(const std::string& pattern, const std::string& name) {
  const std::string own = std::filesystem::path(pattern).filename().string();
  const std::optional<NumberPlace> place = number_in(own);
  if (!place) return false;
  const std::string behind = own.substr(place->end);
  if (name.size() <= place->begin + behind.size()) return false;
  const size_t end = name.size() - behind.size();
  return name.compare(0, place->begin, own, 0, place->begin) == 0 && name.substr(end) == behind &&
         std::all_of(name.begin() + static_cast<std::ptrdiff_t>(place->begin),
                     name.begin() + static_cast<std::ptrdiff_t>(end),
                     [](char c) { return c >= '0' && c <= '9'; });
}

std::string numbered_image(const Camera& camera, uint32_t frame) {
  const std::string& pattern = camera.images;
  const std::optional<NumberPlace> place = number_in(pattern);
  if (!place) {
    throw Error(L4D_ERR_CORRUPT, pattern + ": a path of numbered images has one %d or %04d");
  }
  std::string number = std::to_string(uint64_t{camera.first_image} + frame);
  if (number.size() < place->width) number.insert(0, place->width - number.size(), '0');
  return pattern.substr(0, place->begin) + number + pattern.substr(place->end);
}

void find_first_images(CameraSet* set) {
  std::vector<Camera*> numbered;
  for (Camera& camera : set->cameras) {
    if (is_image_pattern(camera.images)) numbered.push_back(&camera);
  }
  std::error_code error;
  const bool from_one = std::all_of(numbered.begin(), numbered.end(), [&](const Camera* camera) {
    const bool may_look = set->any_path || camera->outside.empty();
    return may_look && camera->first_image == 0 &&
           !std::filesystem::exists(numbered_image(*camera, 0), error) &&
           std::filesystem::is_regular_file(numbered_image(*camera, 1), error);
  });
  if (numbered.empty() || !from_one) return;
  for (Camera* camera : numbered) camera->first_image = 1;
  set->notes.push_back("Images are numbered from 1.");
}

std::vector<std::string> notes_of_pinholes(const CameraSet& set) {
  std::vector<std::string> notes = set.notes;
  const auto distorted = std::count_if(
      set.cameras.begin(), set.cameras.end(),
      [](const Camera& camera) { return camera.distortion.model != Distortion::Model::kNone; });
  if (distorted > 0) {
    notes.push_back("Cameras whose lens distorts, which is left out: " + std::to_string(distorted) +
                    "; pictures of them must be undistorted.");
  }
  return notes;
}

const std::string& seen_by(const Camera& camera) {
  if (!camera.video.empty()) return camera.video;
  return camera.images.empty() ? camera.image : camera.images;
}

void require_inside(const CameraSet& set, const Camera& camera) {
  if (set.any_path || camera.outside.empty()) return;
  throw Error(L4D_ERR_INVALID_ARGUMENT,
              "camera " + std::to_string(camera.id) + ": " + camera.outside +
                  " is not in the folder of the cameras; --any-path reads it all the same");
}

}  // namespace l4d::io

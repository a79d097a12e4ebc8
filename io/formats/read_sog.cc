// SPDX-License-Identifier: Apache-2.0
// SOG, versions 1 and 2: meta.json and WebP images with a pixel for each Gaussian, whose bytes are
// codes, in a ZIP archive or in a folder. Version 1 has ranges where version 2 has codebooks of 256
// values.
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "io/file/json_text.h"
#include "io/formats/inflate.h"
#include "io/formats/readers.h"
#include "io/formats/webp.h"
#include "io/formats/zip.h"
#include "io/ply/static_scene.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d::io {
namespace {

using Json = nlohmann::json;

constexpr size_t kPaletteRow = 64;       // centroids of spherical harmonics in a row of their image
constexpr uint64_t kMostMeta = 1 << 20;  // bytes of meta.json, which takes some 20,000
constexpr int kFirstRotation = 252;      // alpha of a rotation whose w is the largest

// What a byte stands for, in each of up to four channels.
using Codes = std::array<std::array<float, 256>, 4>;

// The files of an archive, or those beside a meta.json.
class Files {
 public:
  Files(InputFile* input, const ImportOptions& options)
      : path_(input->path()), holder_(options.holder), reads_(options.reads) {
    bytes_ = read_counted(input, holder_, &memory_);
    if (bytes_.empty() || bytes_[0] != 'P') return;
    archive_.emplace(std::move(bytes_), path_);
  }

  // memory: counts the bytes of the file before they are there.
  std::vector<uint8_t> read(const std::string& name, std::shared_ptr<void>* memory,
                            uint64_t most = UINT32_MAX) const {
    if (archive_) return archive_->read(name, holder_, memory, most);
    if (name == kMeta) {
      check_size(name, bytes_.size(), most);
      return bytes_;
    }
    // A file may come from anywhere.
    if (std::filesystem::path(name).filename() != name) {
      throw Error(L4D_ERR_CORRUPT, path_ + ": it names " + name + ", which is not beside it");
    }
    const std::string path = (std::filesystem::path(path_).parent_path() / name).string();
    reads_(path);
    InputFile file(path, holder_);
    check_size(name, file.size(), most);
    return read_counted(&file, holder_, memory);
  }

  bool is_archive() const { return archive_.has_value(); }

  static constexpr const char* kMeta = "meta.json";

 private:
  void check_size(const std::string& name, uint64_t size, uint64_t most) const {
    if (size <= most) return;
    throw Error(L4D_ERR_LIMIT_EXCEEDED, path_ + ": " + name + " has " + std::to_string(size) +
                                            " bytes; at most " + std::to_string(most) + " may be");
  }

  std::string path_;
  Hold holder_;
  std::function<void(const std::string&)> reads_;
  std::shared_ptr<void> memory_;
  std::vector<uint8_t> bytes_;  // of meta.json
  std::optional<ZipArchive> archive_;
};

class SogReader {
 public:
  SogReader(InputFile* input, const ImportOptions& options)
      : path_(input->path()), options_(options), files_(input, options) {}

  Scene read() {
    std::shared_ptr<void> memory;
    const std::vector<uint8_t> text = files_.read(Files::kMeta, &memory, kMostMeta);
    const char* begin = reinterpret_cast<const char*>(text.data());
    const std::shared_ptr<void> parsed =
        hold(options_.holder, json_bytes(begin, text.size(), 0), path_ + ": meta.json");
    const std::string wrong = parse_json(begin, begin + text.size(), &meta_);
    if (!wrong.empty() || !meta_.is_object()) {
      const std::string what = wrong.empty() ? "it is no object of JSON" : wrong;
      fail((files_.is_archive() ? "meta.json: "
                                : "no SOG file: it is neither a ZIP archive nor a meta.json: ") +
           what);
    }
    has_codebooks_ = meta_.contains("version");
    if (has_codebooks_ && meta_["version"] != 2) {
      throw Error(L4D_ERR_FEATURE_UNSUPPORTED, path_ + ": version " + meta_["version"].dump() +
                                                   " of SOG; 2 is read, and files that state none");
    }
    const Json& means = part("means");
    count_ = has_codebooks_ ? whole(meta_, "count", UINT32_MAX) : count_of_shape(means);
    const bool has_harmonics = meta_.contains("shN");
    const RgbaImage low = image(means, 0), high = image(means, 1);
    std::optional<Palette> palette;
    if (has_harmonics) palette = read_palette();
    const uint32_t degree = palette ? palette->degree : 0;
    std::shared_ptr<void> scene_memory =
        hold(options_.holder, static_scene_bytes(count_, degree), path_);
    StaticRows rows(count_, degree);
    unpack_positions(low, high, means, &rows);
    unpack_rotations(&rows);
    unpack_scales(&rows);
    unpack_colors(&rows);
    if (palette) unpack_harmonics(*palette, &rows);
    Scene scene = static_scene(std::move(rows), "sog", options_);
    scene.memory = std::move(scene_memory);
    return scene;
  }

 private:
  struct Palette {
    uint32_t degree = 0;
    size_t count = 0;
    RgbaImage centroids;
    Codes codes;
    size_t coefficients() const { return (size_t{degree} + 1) * (degree + 1) - 1; }
  };

  [[noreturn]] void fail(const std::string& message) const {
    throw Error(L4D_ERR_CORRUPT, path_ + ": " + message);
  }

  const Json& part(const char* name) const {
    const auto found = meta_.find(name);
    if (found == meta_.end() || !found->is_object()) {
      fail(std::string("meta.json has no object ") + name);
    }
    return *found;
  }

  size_t whole(const Json& object, const char* key, uint64_t most) const {
    const auto found = object.find(key);
    if (found == object.end() || !found->is_number_unsigned() || found->get<uint64_t>() > most) {
      fail(std::string("meta.json: ") + key + " is no whole number up to " + std::to_string(most));
    }
    return static_cast<size_t>(found->get<uint64_t>());
  }

  size_t count_of_shape(const Json& means) const {
    const auto shape = means.find("shape");
    if (shape == means.end() || !shape->is_array() || shape->empty() ||
        !shape->front().is_number_unsigned() || shape->front().get<uint64_t>() > UINT32_MAX) {
      fail("meta.json has neither a version nor a shape of means");
    }
    return shape->front().get<size_t>();
  }

  // `least` to `most` finite numbers, or one that is no list.
  std::vector<double> numbers(const Json& object, const char* key, size_t least,
                              size_t most) const {
    std::vector<double> values;
    const auto found = object.find(key);
    if (found != object.end() && found->is_number()) values.push_back(found->get<double>());
    if (found != object.end() && found->is_array() && found->size() <= most) {
      for (const Json& value : *found) {
        if (value.is_number()) values.push_back(value.get<double>());
      }
      if (values.size() != found->size()) values.clear();
    }
    const bool is_finite =
        std::all_of(values.begin(), values.end(), [](double x) { return std::isfinite(x); });
    if (values.size() < least || values.size() > most || !is_finite) {
      fail(std::string("meta.json: ") + key + " has not the numbers that it should have");
    }
    return values;
  }

  // What the codes of each channel span. From end to begin, it would mirror the scene.
  std::pair<std::vector<double>, std::vector<double>> range_of(const Json& object,
                                                               size_t channels) const {
    std::vector<double> least = numbers(object, "mins", channels, channels);
    std::vector<double> most = numbers(object, "maxs", channels, channels);
    for (size_t c = 0; c < channels; ++c) {
      if (least[c] > most[c]) fail("meta.json: mins are above maxs");
    }
    return {std::move(least), std::move(most)};
  }

  RgbaImage image_of_any_size(const Json& object, size_t index) const {
    const auto files = object.find("files");
    if (files == object.end() || !files->is_array() || files->size() <= index ||
        !(*files)[index].is_string()) {
      fail("meta.json does not name the images");
    }
    const std::string name = (*files)[index].get<std::string>();
    std::shared_ptr<void> memory;
    const std::vector<uint8_t> bytes = files_.read(name, &memory);
    return decode_webp(bytes, path_ + ": " + name, options_.holder);
  }

  RgbaImage image(const Json& object, size_t index) const {
    RgbaImage image = image_of_any_size(object, index);
    if (image.pixels() < count_) {
      fail("an image of " + std::to_string(image.pixels()) + " pixels for " +
           std::to_string(count_) + " Gaussians");
    }
    return image;
  }

  // The first `channels` have codes of their own if there are ranges.
  Codes codes(const Json& object, size_t channels) const {
    Codes codes{};
    if (has_codebooks_) {
      const std::vector<double> book = numbers(object, "codebook", 256, 256);
      for (auto& channel : codes) {
        for (size_t k = 0; k < 256; ++k) channel[k] = static_cast<float>(book[k]);
      }
      return codes;
    }
    const auto [least, most] = range_of(object, channels);
    for (size_t c = 0; c < codes.size(); ++c) {
      const size_t from = std::min(c, channels - 1);
      for (size_t k = 0; k < 256; ++k) {
        const double t = static_cast<double>(k) / 255;
        codes[c][k] = static_cast<float>(least[from] + (most[from] - least[from]) * t);
      }
    }
    return codes;
  }

  // 16 bits of sign(x) log(1 + |x|).
  void unpack_positions(const RgbaImage& low, const RgbaImage& high, const Json& means,
                        StaticRows* rows) const {
    const auto [least, most] = range_of(means, 3);
    for (size_t i = 0; i < count_; ++i) {
      for (size_t k = 0; k < 3; ++k) {
        const double code = low.at(i)[k] + 256.0 * high.at(i)[k];
        const double log = least[k] + (most[k] - least[k]) * code / 65535;
        rows->position[3 * i + k] =
            static_cast<float>(std::copysign(std::expm1(std::fabs(log)), log));
      }
    }
  }

  // Three numbers of w x y z, times sqrt(2), and which one is the largest.
  void unpack_rotations(StaticRows* rows) const {
    const RgbaImage pixels = image(part("quats"), 0);
    for (size_t i = 0; i < count_; ++i) {
      const uint8_t* p = pixels.at(i);
      float* wxyz = &rows->rotation[4 * i];
      if (p[3] < kFirstRotation) {
        wxyz[0] = 1;  // as players take it
        continue;
      }
      const auto largest = static_cast<size_t>(p[3] - kFirstRotation);
      double sum = 0;
      for (size_t k = 0, next = 0; k < 4; ++k) {
        if (k == largest) continue;
        const double x = (p[next++] / 127.5 - 1) * std::sqrt(0.5);
        wxyz[k] = static_cast<float>(x);
        sum += x * x;
      }
      wxyz[largest] = static_cast<float>(std::sqrt(std::max(0.0, 1 - sum)));
    }
  }

  void unpack_scales(StaticRows* rows) const {
    const Json& scales = part("scales");
    const Codes values = codes(scales, 3);
    const RgbaImage pixels = image(scales, 0);
    for (size_t i = 0; i < count_; ++i) {
      for (size_t k = 0; k < 3; ++k) rows->log_scale[3 * i + k] = values[k][pixels.at(i)[k]];
    }
  }

  // Alpha is the opacity, or in version 1 a code of its logit.
  void unpack_colors(StaticRows* rows) const {
    const Json& colors = part("sh0");
    const Codes values = codes(colors, 4);
    const RgbaImage pixels = image(colors, 0);
    const size_t numbers = size_t{3} * (rows->sh_degree + 1) * (rows->sh_degree + 1);
    for (size_t i = 0; i < count_; ++i) {
      const uint8_t* p = pixels.at(i);
      for (size_t k = 0; k < 3; ++k) rows->sh[numbers * i + k] = values[k][p[k]];
      rows->opacity[i] = static_cast<float>(
          has_codebooks_ ? p[3] / 255.0
                         : linear_opacity(static_cast<double>(values[3][p[3]]), true));
    }
  }

  // A row of the image has 64 centroids, each a pixel for each coefficient.
  Palette read_palette() const {
    const Json& harmonics = part("shN");
    Palette palette;
    palette.codes = codes(harmonics, 1);
    palette.centroids = image_of_any_size(harmonics, 0);
    palette.degree = 1;
    while (palette.degree < 3 && palette.centroids.width != kPaletteRow * palette.coefficients()) {
      ++palette.degree;
    }
    if (palette.centroids.width != kPaletteRow * palette.coefficients()) {
      fail("centroids of spherical harmonics " + std::to_string(palette.centroids.width) +
           " pixels wide belong to no degree");
    }
    palette.count = kPaletteRow * palette.centroids.height;
    if (has_codebooks_) {
      palette.count = whole(harmonics, "count", palette.count);
      if (whole(harmonics, "bands", 3) != palette.degree) {
        fail("bands of spherical harmonics are others than their centroids have");
      }
    }
    return palette;
  }

  void unpack_harmonics(const Palette& palette, StaticRows* rows) const {
    const RgbaImage labels = image(part("shN"), 1);
    const size_t rest = palette.coefficients();
    for (size_t i = 0; i < count_; ++i) {
      const size_t label = labels.at(i)[0] + size_t{256} * labels.at(i)[1];
      if (label >= palette.count) {
        fail("Gaussian " + std::to_string(i) + " has centroid " + std::to_string(label) + " of " +
             std::to_string(palette.count));
      }
      // Rows of the image follow each other without a gap, and so do centroids.
      const uint8_t* p = palette.centroids.at(label * rest);
      float* sh = &rows->sh[3 * (rest + 1) * i + 3];
      for (size_t k = 0; k < rest; ++k) {
        for (size_t c = 0; c < 3; ++c) sh[3 * k + c] = palette.codes[c][p[4 * k + c]];
      }
    }
  }

  std::string path_;
  ImportOptions options_;
  Files files_;
  Json meta_;
  size_t count_ = 0;
  bool has_codebooks_ = false;
};

}  // namespace

Scene read_sog(InputFile input, const ImportOptions& options) {
  return SogReader(&input, options).read();
}

}  // namespace l4d::io

// SPDX-License-Identifier: Apache-2.0
// .splatv: a magic number, the length of a list of chunks in JSON, the list, and the chunks one
// after the other. The chunk "splat" is a texture with 64 bytes for each Gaussian of a
// SpacetimeGaussians lite model.
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "io/file/json_text.h"
#include "io/file/little_endian.h"
#include "io/formats/inflate.h"
#include "io/formats/readers.h"
#include "io/formats/splatv_view.h"
#include "io/ply/read_ply.h"
#include "io/ply/spacetime.h"
#include "io/scene/counted.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d::io {
namespace {

using Json = nlohmann::json;

constexpr uint32_t kSplatvMagic = 0x674b;
constexpr uint64_t kListBegin = 8;
constexpr uint64_t kMostListBytes = uint64_t{16} << 20;  // with the cameras of thousands of images
constexpr uint64_t kSplatvRow = 64;
// Gaussians have their places in the texture by this width.
constexpr uint64_t kTextureWidth = 4096, kTexel = 16;

// Where a row has what; numbers are binary16 unless said otherwise.
enum SplatvOffset : size_t {
  kAtPosition = 0,  // float32
  kAtRotation = 12,
  kAtScale = 20,
  kAtColor = 28,  // bytes: red, green, blue, opacity
  kAtMotion = 32,
  kAtTurning = 52,
  kAtCenter = 60,
  kAtWidth = 62
};

class SplatvReader {
 public:
  SplatvReader(InputFile* input, const ImportOptions& options)
      : path_(input->path()),
        options_(options),
        file_(read_counted(input, options.holder, &file_memory_)) {}

  Scene read() {
    read_list();
    const size_t count = count_rows();
    // With the coordinates of which the middle is found.
    const uint64_t numbers = numbers_per_gaussian(0) + SpacetimeRows::kFloats + 1;
    std::shared_ptr<void> memory = hold(options_.holder, count * numbers * sizeof(float), path_);
    scene_.source = "splatv";
    scene_.flags = L4D_POSITION_AT_MEAN_TIME;
    set_default_timeline(scene_, options_);
    scene_.resize(count);
    SpacetimeRows rows(count);
    for (size_t i = 0; i < count; ++i) unpack(i, &rows);
    raise_flat_scales(scene_);
    store_spacetime(rows, scene_);
    leave_out_unseen(rows);
    if (!cameras_.is_null()) state_splatv_view(cameras_, &scene_);
    scene_.memory = std::move(memory);
    return std::move(scene_);
  }

 private:
  [[noreturn]] void fail(const std::string& message, l4d_status status = L4D_ERR_CORRUPT) const {
    throw Error(status, path_ + ": " + message);
  }

  uint64_t whole(const Json& chunk, const char* key) const {
    const auto found = chunk.find(key);
    if (found == chunk.end() || !found->is_number_unsigned()) {
      fail(std::string("a chunk of its list has no whole number ") + key);
    }
    return found->get<uint64_t>();
  }

  void read_list() {
    if (file_.size() < kListBegin || little_endian32(file_.data()) != kSplatvMagic) {
      fail("no SPLATV file");
    }
    const uint64_t bytes = little_endian32(&file_[4]), left = file_.size() - kListBegin;
    if (bytes > std::min(left, kMostListBytes)) {
      fail("byte 4: the list of chunks has " + std::to_string(bytes) + " bytes; it may have " +
           std::to_string(std::min(left, kMostListBytes)) + " here");
    }
    const char* text = reinterpret_cast<const char*>(&file_[0]) + kListBegin;
    list_memory_ = hold(options_.holder, json_bytes(text, static_cast<size_t>(bytes), 0),
                        path_ + ": its list of chunks");
    Json list;
    const std::string wrong = parse_json(text, text + bytes, &list);
    if (!wrong.empty()) fail("byte 8: the list of chunks: " + wrong);
    if (!list.is_array()) fail("byte 8: there is no list of chunks in JSON");
    uint64_t at = kListBegin + bytes;
    std::vector<std::string> unread;
    for (Json& chunk : list) {
      if (!chunk.is_object() || !chunk.contains("type") || !chunk["type"].is_string()) {
        fail("a chunk of its list has no type");
      }
      const std::string type = chunk["type"].get<std::string>();
      const uint64_t size = whole(chunk, "size");
      if (size > file_.size() - at) {
        fail("the chunk " + type + " has " + std::to_string(size) + " bytes, and " +
             std::to_string(file_.size() - at) + " are left");
      }
      if (type == "splat") {
        add_texture(chunk, at, size);
        // Moved: a copy follows brackets in brackets as deep as they go.
        if (chunk.contains("cameras")) cameras_ = std::move(chunk["cameras"]);
      } else {
        unread.push_back(type);
      }
      at += size;
    }
    if (rows_ == nullptr) fail("its list has no chunk of the type splat");
    if (!unread.empty()) {
      scene_.notes.push_back(counted(unread.size(), "chunk was", "chunks were") +
                             " not read: " + list_of_names(unread) + ".");
    }
    if (at < file_.size()) {
      scene_.notes.push_back(
          counted(file_.size() - at, "byte behind the chunks was", "bytes behind the chunks were") +
          " not read.");
    }
  }

  void add_texture(const Json& chunk, uint64_t at, uint64_t size) {
    if (rows_ != nullptr) fail("several chunks of the type splat", L4D_ERR_FEATURE_UNSUPPORTED);
    const uint64_t width = whole(chunk, "texwidth"), height = whole(chunk, "texheight");
    if (width != kTextureWidth) {
      fail("a texture " + std::to_string(width) + " wide; those of SPLATV are " +
               std::to_string(kTextureWidth),
           L4D_ERR_FEATURE_UNSUPPORTED);
    }
    if (size % (width * kTexel) != 0 || size / (width * kTexel) != height) {
      fail("a texture of " + std::to_string(width) + " x " + std::to_string(height) +
           " is not what the " + std::to_string(size) + " bytes of its chunk are");
    }
    rows_ = file_.data() + at;
    row_bytes_ = size;
  }

  // The texture is filled up with zeros.
  size_t count_rows() const {
    uint64_t end = row_bytes_;
    while (end > 0 && rows_[end - 1] == 0) --end;
    return static_cast<size_t>((end + kSplatvRow - 1) / kSplatvRow);
  }

  void unpack(size_t i, SpacetimeRows* rows) {
    const uint8_t* row = rows_ + kSplatvRow * i;
    const auto half = [&](size_t at, size_t k) { return little_endian_half(row + at + 2 * k); };
    const auto halves = [&](size_t at, size_t n, float* to) {
      for (size_t k = 0; k < n; ++k) to[k] = static_cast<float>(half(at, k));
    };
    for (size_t k = 0; k < 3; ++k) {
      scene_.position[3 * i + k] = little_endian_float(row + kAtPosition + 4 * k);
      // Squared where it is used, so that a sign means nothing.
      scene_.log_scale[4 * i + k] = static_cast<float>(std::log(std::abs(half(kAtScale, k))));
      scene_.sh[3 * i + k] = static_cast<float>((row[kAtColor + k] / 255.0 - 0.5) /
                                                static_cast<double>(sh_constant::k0));
    }
    scene_.opacity[i] = static_cast<float>(row[kAtColor + 3] / 255.0);
    halves(kAtRotation, 4, &rows->quaternion[4 * i]);
    halves(kAtMotion, 9, &rows->motion[9 * i]);
    halves(kAtTurning, 4, &rows->turning_rate[4 * i]);
    halves(kAtCenter, 1, &rows->center[i]);
    const double width = std::abs(half(kAtWidth, 0));
    // What binary16 does not hold never fades: as long as a static Gaussian lasts.
    rows->log_width[i] =
        static_cast<float>(std::log(std::isinf(width) ? 16 * kWidthOfSigma : width));
  }

  // Those that last for no time.
  void leave_out_unseen(const SpacetimeRows& rows) {
    std::vector<char> seen(rows.log_width.size(), 1);
    size_t unseen = 0;
    for (size_t i = 0; i < seen.size(); ++i) {
      if (rows.log_width[i] != -HUGE_VALF) continue;
      seen[i] = 0;
      ++unseen;
    }
    if (unseen == 0) return;
    scene_.keep(seen);
    scene_.notes.push_back(counted(unseen,
                                   "Gaussian is never seen, as it lasts for no time, and was",
                                   "Gaussians are never seen, as they last for no time, and were") +
                           " left out.");
  }

  std::string path_;
  ImportOptions options_;
  std::shared_ptr<void> file_memory_;
  std::vector<uint8_t> file_;
  const uint8_t* rows_ = nullptr;  // of `file_`
  uint64_t row_bytes_ = 0;
  std::shared_ptr<void> list_memory_;  // of `cameras_`, too
  Json cameras_;
  Scene scene_;
};

}  // namespace

Scene read_splatv(InputFile input, const ImportOptions& options) {
  return SplatvReader(&input, options).read();
}

}  // namespace l4d::io

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include "io/camera/read_cameras.h"
#include "io/image/video.h"

namespace l4d::io {
namespace {

namespace fs = std::filesystem;

constexpr size_t kColumns = 17;  // 3 x 5 [R | t | height width focal], then two bounds of depth

// The header of an .npy file: a Python dictionary of three entries.
struct NpyHeader {
  std::string descr;
  bool fortran_order = true;
  std::vector<uint64_t> shape;
};

class NpyHeaderParser {
 public:
  NpyHeaderParser(const CameraPlace& place, std::string text)
      : place_(place), text_(std::move(text)) {}

  NpyHeader parse() {
    NpyHeader header;
    unsigned seen = 0;
    expect('{');
    while (!accept('}')) {
      const std::string key = quoted();
      expect(':');
      if (key == "descr") {
        header.descr = quoted();
        seen |= 1;
      } else if (key == "fortran_order") {
        header.fortran_order = truth();
        seen |= 2;
      } else if (key == "shape") {
        header.shape = numbers();
        seen |= 4;
      } else {
        fail();
      }
      if (!accept(',')) {
        expect('}');
        break;
      }
    }
    skip_blanks();
    if (seen != 7 || at_ != text_.size()) fail();
    return header;
  }

 private:
  [[noreturn]] void fail() const { place_.fail("bad header of an .npy file"); }
  void skip_blanks() {
    while (at_ < text_.size() && (text_[at_] == ' ' || text_[at_] == '\n')) ++at_;
  }
  bool accept(char c) {
    skip_blanks();
    if (at_ == text_.size() || text_[at_] != c) return false;
    ++at_;
    return true;
  }
  void expect(char c) {
    if (!accept(c)) fail();
  }
  std::string quoted() {
    skip_blanks();
    const char quote = at_ < text_.size() ? text_[at_] : ' ';
    if (quote != '\'' && quote != '"') fail();
    const size_t end = text_.find(quote, at_ + 1);
    if (end == std::string::npos) fail();
    std::string content = text_.substr(at_ + 1, end - at_ - 1);
    at_ = end + 1;
    return content;
  }
  bool truth() {
    skip_blanks();
    for (const char* word : {"True", "False"}) {
      if (text_.compare(at_, std::strlen(word), word) != 0) continue;
      at_ += std::strlen(word);
      return *word == 'T';
    }
    fail();
  }
  std::vector<uint64_t> numbers() {
    std::vector<uint64_t> values;
    expect('(');
    while (!accept(')')) {
      skip_blanks();
      uint64_t value = 0;
      const size_t begin = at_;
      for (; at_ < text_.size() && text_[at_] >= '0' && text_[at_] <= '9'; ++at_) {
        if (value > UINT64_MAX / 10 - 1) fail();
        value = value * 10 + static_cast<uint64_t>(text_[at_] - '0');
      }
      if (at_ == begin) fail();
      values.push_back(value);
      if (!accept(',')) {
        expect(')');
        break;
      }
    }
    return values;
  }

  const CameraPlace& place_;
  std::string text_;
  size_t at_ = 0;
};

void take(const CameraPlace& place, InputFile& file, void* dst, size_t n) {
  if (file.read(dst, n) != n) place.fail("the file ends early");
}

uint64_t little_endian(const uint8_t* bytes, size_t n) {
  uint64_t value = 0;
  for (size_t k = n; k-- > 0;) value = value << 8 | bytes[k];
  return value;
}

// The array of an .npy file, which must be [rows, 17]; row-major.
std::vector<double> read_array(const CameraPlace& place, InputFile& file) {
  uint8_t begin[12];
  take(place, file, begin, 10);
  if (std::memcmp(begin, "\x93NUMPY", 6) != 0) place.fail("no .npy file: its magic is missing");
  const unsigned version = begin[6];
  if (version != 1 && version != 2) {
    place.fail(L4D_ERR_FEATURE_UNSUPPORTED, "version " + std::to_string(version) + " of .npy");
  }
  const size_t length_bytes = version == 1 ? 2 : 4;
  take(place, file, begin + 10, length_bytes - 2);
  const uint64_t header_bytes = little_endian(begin + 8, length_bytes);
  const uint64_t header_end = 8 + length_bytes + header_bytes;
  if (header_end > file.size()) place.fail("the file ends within the header");
  std::string text(static_cast<size_t>(header_bytes), ' ');
  take(place, file, text.data(), text.size());
  const NpyHeader header = NpyHeaderParser(place, std::move(text)).parse();

  if (header.descr != "<f8" && header.descr != "<f4") {
    place.fail(L4D_ERR_FEATURE_UNSUPPORTED,
               "numbers of type " + header.descr.substr(0, 16) + ", not <f8 or <f4");
  }
  if (header.fortran_order) {
    place.fail(L4D_ERR_FEATURE_UNSUPPORTED, "an array in Fortran order");
  }
  if (header.shape.size() != 2 || header.shape[1] != kColumns) {
    place.fail("the array does not have the shape (cameras, 17)");
  }
  const size_t value_bytes = header.descr == "<f8" ? 8 : 4;
  const uint64_t left = file.size() - header_end;
  if (header.shape[0] != left / (kColumns * value_bytes) || left % (kColumns * value_bytes) != 0) {
    place.fail("the header tells of " + std::to_string(header.shape[0]) +
               " cameras, which is not what " + std::to_string(left) + " bytes hold");
  }
  std::vector<uint8_t> bytes(static_cast<size_t>(left));
  take(place, file, bytes.data(), bytes.size());
  std::vector<double> values(bytes.size() / value_bytes);
  for (size_t i = 0; i < values.size(); ++i) {
    const uint64_t bits = little_endian(&bytes[i * value_bytes], value_bytes);
    if (value_bytes == 8) {
      std::memcpy(&values[i], &bits, sizeof(double));
    } else {
      const uint32_t low = static_cast<uint32_t>(bits);
      float value = 0;
      std::memcpy(&value, &low, sizeof(value));
      values[i] = static_cast<double>(value);
    }
  }
  return values;
}

uint32_t image_size(const CameraPlace& place, double value) {
  if (!(value >= 1 && value <= static_cast<double>(kMaxImageSize)) || value != std::floor(value)) {
    place.fail("height and width are not whole numbers from 1 to " + std::to_string(kMaxImageSize));
  }
  return static_cast<uint32_t>(value);
}

// The matrix is camera to world with x down, y right, z back.
Camera llff_camera(const CameraPlace& place, const double* row) {
  for (size_t k = 0; k < 17; ++k) {
    if (!std::isfinite(row[k])) place.fail("number " + std::to_string(k) + " is not finite");
  }
  Camera out;
  l4d_camera& camera = out.camera = default_camera();
  camera.height = image_size(place, row[4]);
  camera.width = image_size(place, row[9]);
  camera.fx = camera.fy = row[14];
  camera.cx = static_cast<double>(camera.width) / 2;
  camera.cy = static_cast<double>(camera.height) / 2;
  double axes[9], center[3];
  for (size_t r = 0; r < 3; ++r) {
    axes[3 * r] = row[5 * r + 1];
    axes[3 * r + 1] = row[5 * r];
    axes[3 * r + 2] = -row[5 * r + 2];
    center[r] = row[5 * r + 3];
  }
  set_pose(camera, axes, center);
  check_camera(place, out);
  return out;
}

// The depths from and to which each camera sees something. Nothing here takes them, but where they
// are none, the file may not be what it seems.
void note_bounds(const std::vector<double>& rows, CameraSet* set) {
  size_t wrong = 0, first = 0;
  for (size_t i = 0; i < rows.size() / kColumns; ++i) {
    const double* bounds = &rows[kColumns * (i + 1) - 2];
    if (bounds[0] > 0 && bounds[0] < bounds[1]) continue;
    if (wrong++ == 0) first = i;
  }
  if (wrong == 0) return;
  char text[240];
  std::snprintf(text, sizeof(text),
                "Cameras whose bounds of depth are no range above 0: %zu; those of camera %zu are "
                "%g and %g. Bounds are not used.",
                wrong, first, rows[kColumns * (first + 1) - 2], rows[kColumns * (first + 1) - 1]);
  set->notes.push_back(text);
}

// The videos beside the file in the order of their names, which is that of the rows: cam*.mp4 where
// there is one for each of `rows`, else all videos.
std::vector<std::string> videos_beside(const std::string& path, size_t rows) {
  std::vector<std::string> all, usual;
  for (const fs::path& video : videos_in(fs::path(path).parent_path())) {
    const std::string name = video.filename().string();
    all.push_back(name);
    if (name.compare(0, 3, "cam") == 0 && video.extension() == ".mp4") usual.push_back(name);
  }
  std::vector<std::string>& chosen = usual.size() == rows ? usual : all;
  return std::move(chosen);
}

}  // namespace

CameraSet read_poses_bounds(InputFile& file, const Hold& holder) {
  const std::string& path = file.path();
  // As it is stored and as numbers, and a camera of each row.
  const uint64_t rows_at_most = file.size() / (kColumns * sizeof(float));
  const std::shared_ptr<void> memory =
      hold(holder, 3 * file.size() + 2 * sizeof(Camera) * rows_at_most, path);
  const std::vector<double> rows = read_array({path, ""}, file);
  CameraSet set;
  set.source = "poses_bounds";
  for (size_t i = 0; i < rows.size() / kColumns; ++i) {
    Camera camera = llff_camera({path, "camera " + std::to_string(i)}, &rows[kColumns * i]);
    camera.id = static_cast<int>(i);
    camera.split = i == 0 ? "test" : "train";
    set.cameras.push_back(std::move(camera));
  }
  note_bounds(rows, &set);
  const std::vector<std::string> videos = videos_beside(path, set.cameras.size());
  if (videos.size() == set.cameras.size()) {
    for (size_t i = 0; i < videos.size(); ++i) set.cameras[i].video = beside(path, videos[i]);
  } else {
    set.notes.push_back("The folder of the file has " + std::to_string(videos.size()) +
                        " videos for " + std::to_string(set.cameras.size()) +
                        " cameras; none is used.");
  }
  set.notes.push_back(
      "Poses are used as they are: the scene must be in their world, neither recentred nor "
      "rescaled.");
  set.notes.push_back("Camera 0 is for testing and all others are for training, as is usual.");
  return set;
}

}  // namespace l4d::io

// SPDX-License-Identifier: Apache-2.0
#include "io/image/exr_header.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <iterator>
#include <set>
#include <string>

#include "io/file/little_endian.h"
#include "io/scene/scene.h"
#include "l4d/render.h"

namespace l4d::io {
namespace {

constexpr uint8_t kMagic[kExrMagicBytes] = {0x76, 0x2f, 0x31, 0x01};
// Bits of the second word.
constexpr uint32_t kVersion = 0xff, kTiled = 0x200, kLongNames = 0x400, kDeep = 0x800,
                   kMultipart = 0x1000;
constexpr size_t kMaxName = 255;
// Of the list of channels, and so some thousands of them.
constexpr uint32_t kMaxChannelBytes = 1 << 16;
// Rows of a block, by the kind of compression: none, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A.
constexpr uint32_t kRows[] = {1, 1, 1, 16, 32, 16, 32, 32};
// Of red, green, blue and white: those of sRGB.
constexpr float kPrimaries[] = {0.64F, 0.33F, 0.30F, 0.60F, 0.15F, 0.06F, 0.3127F, 0.3290F};
constexpr float kSamePrimary = 0.005F;

class HeaderReader {
 public:
  explicit HeaderReader(InputFile* file) : file_(*file) {}

  ExrHeader read() {
    read_version();
    std::string name;
    while (!(name = text()).empty()) attribute(name, text());
    for (const char* needed : {"channels", "compression", "dataWindow", "displayWindow"}) {
      if (seen_.count(needed) == 0) fail(std::string("its header has no ") + needed);
    }
    if (header_.is_tiled && seen_.count("tiles") == 0) fail("nothing says how large its tiles are");
    if (!header_.is_tiled) header_.block_width = header_.width;
    if (!header_.is_tiled) header_.block_height = rows_;
    // ffmpeg 5.1 fails on it where a block has many different values.
    if (is_piz_ && has_32_bits_) {
      refuse(
          "of PIZ compression of 32-bit channels, which is not read; ZIP is, and of 16 bits PIZ");
    }
    // The program that decodes it counts the bytes of a block in 32 bits.
    if (header_.block_bytes() > INT32_MAX) refuse("of blocks of more than 2 GiB");
    header_.end = at_;
    return header_;
  }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    throw Error(L4D_ERR_CORRUPT, file_.path() + ": bad EXR: " + what);
  }
  [[noreturn]] void refuse(const std::string& what) const {
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED, file_.path() + ": an EXR " + what);
  }

  void take(uint8_t* bytes, size_t n) {
    if (file_.read(bytes, n) != n) fail("the file ends early");
    at_ += n;
  }

  std::string text() {
    std::string text;
    for (;;) {
      uint8_t byte = 0;
      take(&byte, 1);
      if (byte == 0) return text;
      if (text.size() == kMaxName) fail("a name in its header is too long");
      text += static_cast<char>(byte);
    }
  }

  void read_version() {
    file_.seek(0);
    uint8_t begin[8];
    take(begin, sizeof begin);
    if (!is_exr(begin, sizeof begin)) fail("it does not begin as one");
    const uint32_t version = little_endian32(begin + 4);
    if ((version & kDeep) != 0) refuse("of several samples for a pixel (deep), which is not read");
    if ((version & kMultipart) != 0) refuse("of several parts; one of one part is read");
    if ((version & kVersion) != 2 || (version & ~(kVersion | kTiled | kLongNames)) != 0) {
      refuse("of a version that is not known");
    }
    header_.is_tiled = (version & kTiled) != 0;
  }

  void attribute(const std::string& name, const std::string& type) {
    uint8_t bytes[4];
    take(bytes, sizeof bytes);
    const uint32_t size = little_endian32(bytes);
    if (size > file_.size() - at_) fail("the file ends early");
    const auto is = [&](const char* wanted, const char* its_type, uint32_t its_size) {
      if (name != wanted) return false;
      if (type != its_type || (its_size != 0 && size != its_size) || !seen_.insert(name).second) {
        fail(name + " of its header is not as it should be");
      }
      return true;
    };
    const uint64_t end = at_ + size;
    if (is("channels", "chlist", 0)) {
      read_channels(size);
    } else if (is("compression", "compression", 1)) {
      read_compression();
    } else if (is("dataWindow", "box2i", 16) || is("displayWindow", "box2i", 16)) {
      read_window();
    } else if (is("tiles", "tiledesc", 9)) {
      read_tiles();
    } else if (is("chromaticities", "chromaticities", sizeof kPrimaries)) {
      read_primaries();
    }
    file_.seek(end);
    at_ = end;
  }

  void read_channels(uint32_t size) {
    if (size > kMaxChannelBytes) refuse("of more channels than are read");
    const uint64_t end = at_ + size;
    std::string names, before;
    uint32_t type_of_colours = 0;
    unsigned colours = 0;
    bool is_usual = true;
    for (std::string name; !(name = text()).empty(); before = name) {
      if (!before.empty() && name <= before) fail("its channels are in disorder");
      uint8_t bytes[16];  // type, is linear, three bytes of nothing, every which column and row
      take(bytes, sizeof bytes);
      const uint32_t type = little_endian32(bytes);
      if (at_ > end || type > 2) fail("its list of channels is damaged");
      names += (names.empty() ? "" : ", ") + name;
      is_usual = is_usual && little_endian32(bytes + 8) == 1 && little_endian32(bytes + 12) == 1;
      header_.pixel_bytes += type == 1 ? 2 : 4;
      has_32_bits_ = has_32_bits_ || type != 1;
      if (name.size() > 1 || std::strchr("ABGRabgr", name[0]) == nullptr) continue;
      // Small letters, and whole numbers (type 0), would be taken for what they are not.
      is_usual = is_usual && name[0] < 'a' && type != 0;
      is_usual = is_usual && (type_of_colours == 0 || type == type_of_colours);
      type_of_colours = type;
      if (name[0] == 'A') {
        header_.has_alpha = true;
      } else {
        ++colours;
      }
    }
    if (is_usual && colours == 3) return;
    constexpr size_t kMaxNames = 200;
    if (names.size() > kMaxNames) names = names.substr(0, kMaxNames) + "...";
    refuse("with the channels " + names +
           "; R, G and B, and A if there is one, all of 16-bit or all of 32-bit floats for each "
           "pixel, are read");
  }

  void read_compression() {
    uint8_t kind = 0;
    take(&kind, 1);
    if (kind == 8 || kind == 9) {  // ffmpeg 5.1 has other pixels come out of it, and says nothing
      refuse("of DWA compression, which is not read; ZIP, PIZ and others are");
    }
    if (kind >= std::size(kRows)) refuse("of a compression that is not known");
    header_.is_compressed = kind != 0;
    is_piz_ = kind == 4;
    rows_ = kRows[kind];
  }

  void read_window() {
    uint8_t bytes[16];
    take(bytes, sizeof bytes);
    int64_t sides[4];  // left, top, right, bottom, all of them inclusive
    for (size_t k = 0; k < 4; ++k) sides[k] = static_cast<int32_t>(little_endian32(bytes + 4 * k));
    const int64_t width = sides[2] - sides[0] + 1, height = sides[3] - sides[1] + 1;
    if (width < 1 || height < 1 || width > L4D_MAX_IMAGE_SIDE || height > L4D_MAX_IMAGE_SIDE) {
      fail("a side of its picture is not 1 to " + std::to_string(L4D_MAX_IMAGE_SIDE) + " pixels");
    }
    if (sides[0] != 0 || sides[1] != 0 ||
        (header_.width != 0 && (width != header_.width || height != header_.height))) {
      refuse(
          "whose pixels are not those of the picture (dataWindow and displayWindow), from 0, 0 on, "
          "which is not read");
    }
    header_.width = static_cast<uint32_t>(width);
    header_.height = static_cast<uint32_t>(height);
  }

  void read_tiles() {
    uint8_t bytes[9];
    take(bytes, sizeof bytes);
    if (!header_.is_tiled) fail("it has tiles, and says that it has none");
    if ((bytes[8] & 0xf) != 0)
      refuse("of several sizes of one picture (mipmap), which is not read");
    header_.block_width = little_endian32(bytes);
    header_.block_height = little_endian32(bytes + 4);
    for (const uint32_t side : {header_.block_width, header_.block_height}) {
      if (side < 1 || side > L4D_MAX_IMAGE_SIDE) fail("its tiles have no size");
    }
  }

  void read_primaries() {
    uint8_t bytes[sizeof kPrimaries];
    take(bytes, sizeof bytes);
    for (size_t k = 0; k < std::size(kPrimaries); ++k) {
      const float value = little_endian_float(bytes + 4 * k);
      if (std::abs(value - kPrimaries[k]) <= kSamePrimary) continue;
      refuse("of other primaries than those of sRGB (chromaticities), which is not read");
    }
  }

  InputFile& file_;
  uint64_t at_ = 0;
  uint32_t rows_ = 0;
  bool is_piz_ = false, has_32_bits_ = false;
  std::set<std::string> seen_;  // attributes that count here
  ExrHeader header_;
};

}  // namespace

bool is_exr(const uint8_t* begin, size_t n) {
  return n >= sizeof kMagic && std::equal(std::begin(kMagic), std::end(kMagic), begin);
}

ExrHeader read_exr_header(InputFile* file) { return HeaderReader(file).read(); }

}  // namespace l4d::io

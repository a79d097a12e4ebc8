// SPDX-License-Identifier: Apache-2.0
#include <png.h>

#include <algorithm>
#include <csetjmp>
#include <cstdio>
#include <cstring>
#include <new>
#include <optional>
#include <utility>

#include "io/file/file.h"
#include "io/image/stored_image.h"

namespace l4d::io {
namespace {

constexpr uint32_t kMaxSize = L4D_MAX_IMAGE_SIDE;
constexpr int kDefaultLevel = 6;  // zlib's own default
// No deflate stream grows by more than this factor when it is unpacked.
constexpr uint64_t kMaxInflation = 1032;

struct PngSource {
  const uint8_t* bytes = nullptr;
  size_t left = 0;
  char message[160] = "";
};

struct PngLayout {
  uint32_t width = 0, height = 0;
  uint64_t stored_row_bytes = 0;  // as in the file, unpacked
  size_t row_bytes = 0;           // as delivered
  unsigned channels = 0, depth = 0;
};

// libpng leaves its functions by longjmp on errors, which must not pass by an object with a
// destructor. The functions below therefore have none; their callers own the memory.
[[noreturn]] void on_error(png_structp png, png_const_charp message) {
  auto* source = static_cast<PngSource*>(png_get_error_ptr(png));
  std::snprintf(source->message, sizeof(source->message), "%s", message);
  png_longjmp(png, 1);
}

void on_warning(png_structp, png_const_charp) {}

void on_read(png_structp png, png_bytep to, size_t n) {
  auto* source = static_cast<PngSource*>(png_get_io_ptr(png));
  if (n > source->left) png_error(png, "the file ends early");
  std::memcpy(to, source->bytes, n);
  source->bytes += n;
  source->left -= n;
}

// Reads what precedes the pixels and asks for them as 8 or 16-bit RGB or RGBA.
bool read_layout(png_structp png, png_infop info, PngSource* source, PngLayout* layout) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_read_fn(png, source, on_read);
  png_set_user_limits(png, kMaxSize, kMaxSize);
  png_read_info(png, info);
  layout->width = png_get_image_width(png, info);
  layout->height = png_get_image_height(png, info);
  layout->stored_row_bytes = png_get_rowbytes(png, info);
  png_set_expand(png);  // palettes, fewer than 8 bits, transparent colours
  png_set_gray_to_rgb(png);
  png_set_interlace_handling(png);
  png_read_update_info(png, info);
  layout->row_bytes = png_get_rowbytes(png, info);
  layout->channels = png_get_channels(png, info);
  layout->depth = png_get_bit_depth(png, info);
  return true;
}

bool read_pixels(png_structp png, png_bytepp rows) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_read_image(png, rows);
  png_read_end(png, nullptr);
  return true;
}

class PngReadStruct {
 public:
  explicit PngReadStruct(PngSource* source)
      : png(png_create_read_struct(PNG_LIBPNG_VER_STRING, source, on_error, on_warning)) {
    if (png != nullptr) info = png_create_info_struct(png);
    if (info != nullptr) return;
    png_destroy_read_struct(&png, nullptr, nullptr);
    throw std::bad_alloc();
  }
  ~PngReadStruct() { png_destroy_read_struct(&png, &info, nullptr); }
  PngReadStruct(const PngReadStruct&) = delete;
  PngReadStruct& operator=(const PngReadStruct&) = delete;

  png_structp png;
  png_infop info = nullptr;
};

// What libpng has written of an image and is not yet in its file. No exception may pass through
// libpng: where memory is missing, it gets an error of its own.
struct PngTarget {
  std::vector<uint8_t> bytes;
  char message[160] = "";

  void flush(OutputFile* file) {
    file->write(bytes.data(), bytes.size());
    bytes.clear();
  }
};

bool append(std::vector<uint8_t>* to, const uint8_t* bytes, size_t n) noexcept {
  try {
    to->insert(to->end(), bytes, bytes + n);
    return true;
  } catch (const std::bad_alloc&) {
    return false;
  }
}

[[noreturn]] void on_write_error(png_structp png, png_const_charp message) {
  auto* target = static_cast<PngTarget*>(png_get_error_ptr(png));
  std::snprintf(target->message, sizeof(target->message), "%s", message);
  png_longjmp(png, 1);
}

void on_write(png_structp png, png_bytep bytes, size_t n) {
  auto* target = static_cast<PngTarget*>(png_get_io_ptr(png));
  if (!append(&target->bytes, bytes, n)) png_error(png, "not enough memory");
}

bool write_begin(png_structp png, png_infop info, uint32_t width, uint32_t height, int level) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_write_fn(png, png_get_error_ptr(png), on_write, nullptr);
  png_set_user_limits(png, kMaxSize, kMaxSize);
  png_set_IHDR(png, info, width, height, 8, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_set_compression_level(png, level);
  png_set_sRGB(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
  png_write_info(png, info);
  return true;
}

bool write_row(png_structp png, const uint8_t* row) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_write_row(png, row);
  return true;
}

bool write_end(png_structp png) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_write_end(png, nullptr);
  return true;
}

class PngWriteStruct {
 public:
  explicit PngWriteStruct(PngTarget* target)
      : png(png_create_write_struct(PNG_LIBPNG_VER_STRING, target, on_write_error, on_warning)) {
    if (png != nullptr) info = png_create_info_struct(png);
    if (info != nullptr) return;
    png_destroy_write_struct(&png, nullptr);
    throw std::bad_alloc();
  }
  ~PngWriteStruct() { png_destroy_write_struct(&png, &info); }
  PngWriteStruct(const PngWriteStruct&) = delete;
  PngWriteStruct& operator=(const PngWriteStruct&) = delete;

  png_structp png;
  png_infop info = nullptr;
};

// Calls take(target) for each row and at the end, when some of the image has been encoded.
template <typename Take>
void encode(const std::string& name, const Image& image, int level, const Take& take) {
  if (image.width < 1 || image.height < 1 || image.width > kMaxSize || image.height > kMaxSize) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                name + ": an image has 1 to " + std::to_string(kMaxSize) + " pixels a side");
  }
  PngTarget target;
  PngWriteStruct writer(&target);
  bool good = write_begin(writer.png, writer.info, image.width, image.height, level);
  std::vector<uint8_t> row(3 * size_t{image.width});
  for (size_t y = 0; good && y < image.height; ++y) {
    to_bytes(&image.rgb[y * row.size()], row.size(), row.data());
    good = write_row(writer.png, row.data());
    take(&target);
  }
  if (!good || !write_end(writer.png)) {
    throw Error(L4D_ERR_INTERNAL, name + ": encoding the PNG: " + target.message);
  }
  take(&target);
}

}  // namespace

bool png_size(const uint8_t* begin, uint32_t* size) {
  constexpr uint8_t kBegin[16] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n',
                                  0,    0,   0,   13,  'I',  'H',  'D',  'R'};
  if (!std::equal(std::begin(kBegin), std::end(kBegin), begin)) return false;
  for (size_t k = 0; k < 2; ++k) {
    size[k] = 0;
    for (size_t b = 0; b < 4; ++b) size[k] = size[k] << 8 | begin[16 + 4 * k + b];
  }
  return true;
}

std::optional<StoredImage> decode_png(const ImageFile& file, unsigned deepest,
                                      const ImageLimits& limits) {
  const std::string& path = file.path;
  const std::vector<uint8_t>& bytes = file.bytes;
  PngSource source;
  source.bytes = bytes.data();
  source.left = bytes.size();
  PngReadStruct reader(&source);
  const auto fail = [&](const char* what) {
    throw Error(L4D_ERR_CORRUPT, path + ": bad PNG: " + what);
  };
  PngLayout layout;
  if (!read_layout(reader.png, reader.info, &source, &layout)) fail(source.message);
  if ((layout.channels != 3 && layout.channels != 4) || (layout.depth != 8 && layout.depth != 16)) {
    fail("a layout of pixels that is not known");
  }
  if (layout.stored_row_bytes * layout.height / kMaxInflation > bytes.size()) {
    fail("the file is too short for its size in pixels");
  }
  if (layout.depth > deepest) return std::nullopt;
  StoredImage out;
  out.width = layout.width;
  out.height = layout.height;
  out.channels = layout.channels;
  out.depth = layout.depth;
  const uint64_t values = uint64_t{layout.width} * layout.height * (layout.channels + 1);
  out.memory = hold(limits.holder, layout.row_bytes * layout.height + values * sizeof(float), path);
  out.pixels.resize(layout.row_bytes * layout.height);
  std::vector<uint8_t*> rows(layout.height);
  for (size_t y = 0; y < rows.size(); ++y) rows[y] = &out.pixels[y * layout.row_bytes];
  if (!read_pixels(reader.png, rows.data())) fail(source.message);
  return out;
}

void write_png(const std::string& path, const Image& image, const Check& check) {
  OutputFile file(path);
  encode(path, image, kDefaultLevel, [&](PngTarget* target) {
    call(check);
    target->flush(&file);
  });
  file.commit();
}

std::string encode_png(const Image& image, int level) {
  std::string bytes;
  encode("the picture", image, level, [&](PngTarget* target) {
    bytes.append(target->bytes.begin(), target->bytes.end());
    target->bytes.clear();
  });
  return bytes;
}

}  // namespace l4d::io

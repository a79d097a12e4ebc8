// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <csetjmp>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <memory>
#include <new>
#include <utility>

// Needs size_t and FILE before it.
#include <jpeglib.h>

// Numbers messages by the version of the interface that jpeglib.h states.
#include <jerror.h>

#include "io/image/stored_image.h"

namespace l4d::io {
namespace {

// Each scan of a progressive file goes through all of the image; encoders write about ten.
constexpr int kMaxScans = 100;
// Pixels of a byte. A Huffman code has a bit or more for each block of 64 samples, so that no file
// has more than 512.
constexpr uint64_t kMaxInflation = 4096;
constexpr int kExif = JPEG_APP0 + 1;

// libjpeg leaves its functions by longjmp on errors, which must not pass by an object with a
// destructor. The functions below therefore have none; their callers own the memory.
struct JpegState {
  jpeg_error_mgr errors;
  jpeg_progress_mgr progress;
  std::jmp_buf jump;
  char message[JMSG_LENGTH_MAX] = "";
  bool is_damaged = false;
};

JpegState* state_of(j_common_ptr jpeg) { return static_cast<JpegState*>(jpeg->client_data); }

[[noreturn]] void on_error(j_common_ptr jpeg) {
  JpegState* state = state_of(jpeg);
  if (state->message[0] == 0) jpeg->err->format_message(jpeg, state->message);
  std::longjmp(state->jump, 1);
}

// level: -1 for a warning. What follows some of them is not what was taken.
void on_message(j_common_ptr jpeg, int level) {
  static constexpr int kDamage[] = {JWRN_JPEG_EOF,       JWRN_HIT_MARKER,  JWRN_HUFF_BAD_CODE,
                                    JWRN_NOT_SEQUENTIAL, JWRN_MUST_RESYNC, JWRN_BOGUS_PROGRESSION};
  if (level >= 0) return;
  const int* const end = kDamage + sizeof kDamage / sizeof kDamage[0];
  JpegState* state = state_of(jpeg);
  if (state->is_damaged || std::find(+kDamage, end, jpeg->err->msg_code) == end) return;
  state->is_damaged = true;
  jpeg->err->format_message(jpeg, state->message);
}

void on_progress(j_common_ptr jpeg) {
  if (reinterpret_cast<j_decompress_ptr>(jpeg)->input_scan_number <= kMaxScans) return;
  JpegState* state = state_of(jpeg);
  std::snprintf(state->message, sizeof state->message, "more than %d scans", kMaxScans);
  on_error(jpeg);
}

bool begin(jpeg_decompress_struct* jpeg, JpegState* state, const uint8_t* bytes, size_t n) {
  jpeg->err = jpeg_std_error(&state->errors);
  state->errors.error_exit = on_error;
  state->errors.emit_message = on_message;
  if (setjmp(state->jump) != 0) return false;
  jpeg->client_data = state;
  jpeg_create_decompress(jpeg);
  state->progress.progress_monitor = on_progress;
  jpeg->progress = &state->progress;
  jpeg_mem_src(jpeg, bytes, static_cast<unsigned long>(n));
  jpeg_save_markers(jpeg, kExif, 0xffff);
  jpeg_read_header(jpeg, TRUE);
  return true;
}

// Rows of RGB.
bool read_rows(jpeg_decompress_struct* jpeg, JpegState* state, uint8_t* pixels) {
  if (setjmp(state->jump) != 0) return false;
  jpeg->out_color_space = JCS_RGB;
  jpeg->dct_method = JDCT_ISLOW;
  jpeg_start_decompress(jpeg);
  while (jpeg->output_scanline < jpeg->output_height) {
    JSAMPROW row = pixels + size_t{3} * jpeg->output_width * jpeg->output_scanline;
    jpeg_read_scanlines(jpeg, &row, 1);
  }
  jpeg_finish_decompress(jpeg);
  return !state->is_damaged;
}

struct JpegReader {
  JpegReader() = default;
  ~JpegReader() { jpeg_destroy_decompress(&jpeg); }
  JpegReader(const JpegReader&) = delete;
  JpegReader& operator=(const JpegReader&) = delete;

  jpeg_decompress_struct jpeg{};
  JpegState state{};
};

// Tag 0x112 of the first directory (Exif 2.32, 4.6.4); 1, as stored, if there is none.
unsigned orientation_in(const uint8_t* bytes, size_t n) {
  constexpr size_t kHead = 6;  // "Exif", two zeros
  if (n < kHead + 8 || std::memcmp(bytes, "Exif\0", kHead) != 0) return 1;
  bytes += kHead;
  n -= kHead;
  const bool little = bytes[0] == 'I';
  const auto number = [&](size_t at, size_t count) {
    uint32_t value = 0;
    for (size_t k = 0; k < count; ++k) {
      value |= uint32_t{bytes[at + k]} << 8 * (little ? k : count - 1 - k);
    }
    return value;
  };
  const size_t first = number(4, 4);
  if (first > n - 2) return 1;
  for (size_t k = 0, entries = number(first, 2); k < entries; ++k) {
    const size_t at = first + 2 + 12 * k;
    if (at + 12 > n) return 1;
    if (number(at, 2) != 0x112) continue;
    const uint32_t value = number(at + 8, 2);
    return value >= 1 && value <= 8 ? value : 1;
  }
  return 1;
}

unsigned orientation_of(const jpeg_decompress_struct& jpeg) {
  for (const jpeg_marker_struct* m = jpeg.marker_list; m != nullptr; m = m->next) {
    if (m->marker == kExif && m->data_length > 6) return orientation_in(m->data, m->data_length);
  }
  return 1;
}

// Orientations 5 to 8: rows become columns.
StoredImage turned(const StoredImage& in, unsigned orientation) {
  StoredImage out;
  out.width = in.height;
  out.height = in.width;
  out.channels = in.channels;
  out.depth = in.depth;
  out.memory = in.memory;
  out.pixels.resize(in.pixels.size());
  const bool from_right = orientation == 7 || orientation == 8;
  const bool from_below = orientation == 6 || orientation == 7;
  for (size_t y = 0; y < out.height; ++y) {
    for (size_t x = 0; x < out.width; ++x) {
      const size_t column = from_right ? in.width - 1 - y : y;
      const size_t row = from_below ? in.height - 1 - x : x;
      std::copy_n(&in.pixels[3 * (row * in.width + column)], 3,
                  &out.pixels[3 * (y * out.width + x)]);
    }
  }
  return out;
}

}  // namespace

StoredImage decode_jpeg(const ImageFile& file, const ImageLimits& limits) {
  const auto fail = [&](const std::string& what) {
    throw Error(L4D_ERR_CORRUPT, file.path + ": bad JPEG: " + what);
  };
  // What the decoder keeps of the segments that may be EXIF: at most all of the file.
  const std::shared_ptr<void> segments = hold(limits.holder, file.bytes.size(), file.path);
  JpegReader reader;
  jpeg_decompress_struct& jpeg = reader.jpeg;
  if (!begin(&jpeg, &reader.state, file.bytes.data(), file.bytes.size())) {
    fail(reader.state.message);
  }
  StoredImage out;
  out.width = jpeg.image_width;
  out.height = jpeg.image_height;
  out.channels = 3;
  out.depth = 8;
  if (out.width > L4D_MAX_IMAGE_SIDE || out.height > L4D_MAX_IMAGE_SIDE) {
    fail("more than " + std::to_string(L4D_MAX_IMAGE_SIDE) + " pixels a side");
  }
  if (jpeg.jpeg_color_space == JCS_CMYK || jpeg.jpeg_color_space == JCS_YCCK) {
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
                file.path + ": a JPEG for printing (CMYK); convert it to RGB");
  }
  const unsigned orientation = orientation_of(jpeg);
  const bool turns = orientation >= 5 && limits.width != 0 && out.width == limits.height &&
                     out.height == limits.width && out.width != out.height;
  if (!turns) check_image_size(file.path, out.width, out.height, limits);
  const uint64_t pixels = uint64_t{out.width} * out.height;
  if (pixels / kMaxInflation > file.bytes.size()) {
    fail("the file is too short for its size in pixels");
  }
  // Coefficients of progressive files, rows, turned rows, and values.
  const uint64_t each = 3 * (2 + 1 + 1 + sizeof(float));
  out.memory = hold(limits.holder, pixels * each, file.path);
  out.pixels.resize(static_cast<size_t>(3 * pixels));
  if (!read_rows(&jpeg, &reader.state, out.pixels.data())) fail(reader.state.message);
  return turns ? turned(out, orientation) : std::move(out);
}

}  // namespace l4d::io

// SPDX-License-Identifier: Apache-2.0
// JPEG files of tests.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

// Needs size_t and FILE before it.
#include <jpeglib.h>

namespace l4d::test {

struct JpegForm {
  J_COLOR_SPACE colors = JCS_RGB;   // of the samples: RGB, grey or CMYK
  unsigned orientation = 0;         // EXIF; 0: none is stated
  bool scan_a_coefficient = false;  // 190 scans
};

// samples: [height, width, 3], or as many as the colours have.
inline std::string jpeg_of(uint32_t width, uint32_t height, const std::vector<uint8_t>& samples,
                           const JpegForm& form = {}) {
  jpeg_compress_struct jpeg{};
  jpeg_error_mgr errors{};
  jpeg.err = jpeg_std_error(&errors);
  jpeg_create_compress(&jpeg);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&jpeg, &bytes, &size);
  jpeg.image_width = width;
  jpeg.image_height = height;
  jpeg.in_color_space = form.colors;
  jpeg.input_components = form.colors == JCS_RGB ? 3 : form.colors == JCS_GRAYSCALE ? 1 : 4;
  jpeg_set_defaults(&jpeg);
  jpeg_set_quality(&jpeg, 95, TRUE);
  jpeg.comp_info[0].h_samp_factor = jpeg.comp_info[0].v_samp_factor = 1;
  std::vector<jpeg_scan_info> scans;
  if (form.scan_a_coefficient) {
    scans.push_back({3, {0, 1, 2, 0}, 0, 0, 0, 0});
    for (int component = 0; component < 3; ++component) {
      for (int k = 1; k < 64; ++k) scans.push_back({1, {component, 0, 0, 0}, k, k, 0, 0});
    }
    jpeg.scan_info = scans.data();
    jpeg.num_scans = static_cast<int>(scans.size());
  }
  jpeg_start_compress(&jpeg, TRUE);
  if (form.orientation != 0) {
    const uint8_t low = static_cast<uint8_t>(form.orientation);
    const std::vector<uint8_t> exif = {'E', 'x', 'i', 'f', 0, 0, 'M',  'M', 0, 42, 0,
                                       0,   0,   8,   0,   1, 1, 0x12, 0,   3, 0,  0,
                                       0,   1,   0,   low, 0, 0, 0,    0,   0, 0};
    jpeg_write_marker(&jpeg, JPEG_APP0 + 1, exif.data(), static_cast<unsigned>(exif.size()));
  }
  const size_t row = size_t{width} * static_cast<size_t>(jpeg.input_components);
  for (size_t y = 0; y < height; ++y) {
    JSAMPROW from = const_cast<JSAMPROW>(&samples[y * row]);
    jpeg_write_scanlines(&jpeg, &from, 1);
  }
  jpeg_finish_compress(&jpeg);
  jpeg_destroy_compress(&jpeg);
  std::string out(reinterpret_cast<const char*>(bytes), size);
  std::free(bytes);
  return out;
}

}  // namespace l4d::test

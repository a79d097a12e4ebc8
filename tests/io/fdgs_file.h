// SPDX-License-Identifier: Apache-2.0
// .4dgs files as the tests want them, written from the format's description.
#pragma once

#include <zlib.h>
#include <zstd.h>

#include <cmath>
#include <string>
#include <vector>

#include "tests/io/support.h"

namespace l4d::io::test {

struct FdgsParts {
  int codec = 0, mode = 0, width = 1;  // of streams; mode 2 only where all rows are equal
  std::string compression;             // of chunks
  uint32_t degree = 0;
  std::string model = "gaussian-birth", scheme = "uniform-v1";
  double seconds = 4, cutoff = std::exp(-2.0);
  std::vector<std::pair<double, double>> windows = {{0, 4}, {1, 2}};
  std::vector<std::pair<std::string, std::string>> attributes;
  std::string more;  // records in front of the chunks
  std::vector<int> second_window = {1};
  int extra_count = 0;
  bool objects = false;
};

inline std::string fdgs_text(const std::string& text) {
  std::string out;
  append(out, static_cast<uint32_t>(text.size()));
  return out + text;
}

inline std::string fdgs_record(uint8_t opcode, const std::string& content) {
  std::string out(1, static_cast<char>(opcode));
  append(out, static_cast<uint64_t>(content.size()));
  return out + content;
}

inline std::string fdgs_packed(const std::string& raw, bool zstd) {
  std::string out(2 * raw.size() + 512, '\0');
  if (zstd) {
    out.resize(ZSTD_compress(out.data(), out.size(), raw.data(), raw.size(), 3));
    return out;
  }
  uLongf size = out.size();
  EXPECT_EQ(compress(reinterpret_cast<Bytef*>(out.data()), &size,
                     reinterpret_cast<const Bytef*>(raw.data()), raw.size()),
            Z_OK);
  out.resize(size);
  return out;
}

// rows: of `channels` numbers each.
inline std::string fdgs_stream(const FdgsParts& parts, int attribute, size_t channels,
                               std::vector<int> rows) {
  const size_t count = rows.size() / channels;
  int mode = parts.mode;
  const std::vector<int> first(rows.begin(), rows.begin() + static_cast<ptrdiff_t>(channels));
  if (mode == 2) {
    for (size_t i = 0; i < rows.size(); ++i) {
      if (rows[i] != first[i % channels]) mode = 0;
    }
  }
  if (mode == 1) {
    for (size_t i = rows.size(); i-- > channels;) rows[i] -= rows[i - channels];
  }
  if (mode == 2) rows = first;
  int width = parts.width;
  std::vector<uint32_t> symbols;
  for (const int v : rows) {
    symbols.push_back(v < 0 ? 2 * static_cast<uint32_t>(-v) - 1 : 2 * static_cast<uint32_t>(v));
    if (symbols.back() > 255 && width == 1) width = 2;
  }
  std::string planes;
  for (int j = 0; j < width; ++j) {
    for (const uint32_t u : symbols) planes += static_cast<char>(u >> (8 * j));
  }
  const std::string payload = fdgs_packed(planes, parts.codec == 1);
  std::string out;
  for (const int byte : {attribute, width, mode, parts.codec, static_cast<int>(channels)}) {
    out += static_cast<char>(byte);
  }
  append(out, static_cast<uint32_t>(count));
  append(out, static_cast<uint64_t>(payload.size()));
  return out + payload;
}

inline std::string fdgs_chunk(const FdgsParts& parts, uint32_t count, const std::string& streams) {
  std::string out;
  append(out, 0.0);
  append(out, parts.seconds);
  append(out, uint32_t{0});
  append(out, count);
  out += fdgs_text(parts.compression);
  append(out, static_cast<uint64_t>(streams.size()));
  const std::string block =
      parts.compression.empty() ? streams : fdgs_packed(streams, parts.compression == "zstd");
  append(out, static_cast<uint64_t>(block.size()));
  return fdgs_record(5, out + block);
}

inline std::string fdgs_bands(const FdgsParts& parts, size_t count) {
  std::string out;
  for (uint32_t band = 1; band <= parts.degree; ++band) {
    std::vector<int> bytes;
    for (size_t i = 0; i < count; ++i) {
      for (uint32_t c = 0; c < 3; ++c) {
        for (uint32_t k = 0; k < 2 * band + 1; ++k) {
          bytes.push_back(static_cast<int>(70 * c + 10 * band + k));
        }
      }
    }
    out += fdgs_record(7, std::string(1, static_cast<char>(band)) +
                              fdgs_stream(parts, 7, 3 * (2 * band + 1), bytes));
  }
  return out;
}

// One Gaussian that fades and one that has a window; then one that lasts.
inline std::string fdgs_file(const FdgsParts& parts) {
  const std::string magic =
      "\x89"
      "4DGS1\r\n";
  std::string header = fdgs_text("") + fdgs_text("a test");
  append(header, parts.seconds);
  append(header, static_cast<uint64_t>(3 + parts.extra_count));
  append(header, parts.cutoff);
  header += fdgs_text(parts.model);
  for (int k = 0; k < 6; ++k) append(header, 0.0);
  header += static_cast<char>(parts.degree);
  header += '\0';
  std::string attributes;
  for (const auto& [key, text] : parts.attributes) attributes += fdgs_text(key) + fdgs_text(text);
  header += fdgs_text(attributes) + "a field of a later version";
  std::string file = magic + fdgs_record(1, header);

  std::string grids = fdgs_text(parts.scheme);
  for (const double x : {1.0, 2.0, 3.0, 0.5, 0.25, 0.5, 0.25, 0.125, 0.5, 0.25, 0.5}) {
    append(grids, x);
  }
  grids += '\1';
  file += fdgs_record(3, grids + fdgs_text(""));
  std::string windows;
  append(windows, static_cast<uint32_t>(parts.windows.size()));
  for (const auto& [begin, end] : parts.windows) {
    append(windows, begin);
    append(windows, end);
  }
  file += fdgs_record(4, windows) + parts.more;
  const auto stream = [&](int attribute, size_t channels, const std::vector<int>& rows) {
    return fdgs_stream(parts, attribute, channels, rows);
  };
  std::string two =
      stream(0, 3, {2, 4, -2, 0, 0, 0}) + stream(1, 3, {0, -4, 4, 0, 0, 0}) + stream(2, 1, {3, 0}) +
      stream(3, 3, {0, 0, 0, 1, 1, 1}) + stream(4, 3, {1, 1, -1, 2, 0, 1}) + stream(5, 1, {6, 8}) +
      stream(64, 2, {1, 2, 3, 4}) + stream(6, 3, {8, -4, 0, 4, 0, 0}) + stream(7, 1, {64, 4}) +
      stream(8, 1, {0, 0}) + stream(9, 1, {0, 1}) + stream(10, 1, {0, parts.second_window[0]});
  if (parts.objects) two += stream(14, 1, {0, 7});
  const std::string one = stream(0, 3, {0, 0, 0}) + stream(1, 3, {1, 1, 1}) + stream(2, 1, {3}) +
                          stream(3, 3, {1, 0, 0}) + stream(4, 3, {0, 0, 0}) + stream(5, 1, {9}) +
                          stream(6, 3, {0, 0, 0}) + stream(7, 1, {0}) + stream(8, 1, {0}) +
                          stream(9, 1, {1}) + stream(10, 1, {0});
  file += fdgs_chunk(parts, 2, two) + fdgs_bands(parts, 2);
  file += fdgs_chunk(parts, 1, one) + fdgs_bands(parts, 1);
  const uint64_t summary = file.size();
  file += fdgs_record(8, "as a reader from the begin needs it") + fdgs_record(12, "likewise");
  std::string footer;
  append(footer, summary);
  append(footer, uint64_t{0});
  append(footer, static_cast<uint32_t>(crc32(crc32(0, nullptr, 0),
                                             reinterpret_cast<const Bytef*>(&file[summary]),
                                             static_cast<uInt>(file.size() - summary))));
  return file + fdgs_record(2, footer) + magic;
}

}  // namespace l4d::io::test

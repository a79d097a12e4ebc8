// SPDX-License-Identifier: Apache-2.0
// KSPLAT, compression 0 to 2: a header, headers of sections, and sections of Gaussians. Compressed
// positions are relative to the centres of buckets, each a number of Gaussians that lie together.
#include <algorithm>
#include <array>
#include <cmath>

#include "io/file/little_endian.h"
#include "io/formats/inflate.h"
#include "io/formats/readers.h"
#include "io/ply/static_scene.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d::io {
namespace {

constexpr uint64_t kFileHeader = 4096, kSectionHeader = 1024, kCentre = 12;
constexpr uint32_t kMostHarmonicsDegree = 3;

// Bytes of numbers: positions and scales, rotations, spherical harmonics.
struct Widths {
  uint64_t position, rotation, harmonic;
};
constexpr std::array<Widths, 3> kWidths = {{{4, 4, 4}, {2, 2, 2}, {2, 2, 1}}};

struct Section {
  uint64_t count = 0, places = 0;  // of Gaussians, and how many the file has room for
  uint64_t bucket_capacity = 0, buckets = 0, bucket_bytes = 0, full_buckets = 0;
  uint64_t partial_buckets = 0;
  double block_size = 0, range = 0;
  uint32_t degree = 0;
  uint64_t begin = 0;  // sizes of partial buckets, then buckets, then Gaussians

  uint64_t coefficients() const { return (uint64_t{degree} + 1) * (degree + 1) - 1; }
  uint64_t rows() const { return begin + 4 * partial_buckets + bucket_bytes * buckets; }
};

class KsplatReader {
 public:
  KsplatReader(InputFile* input, const ImportOptions& options)
      : path_(input->path()),
        options_(options),
        file_(read_counted(input, options.holder, &file_memory_)) {}

  Scene read() {
    read_header();
    read_sections();
    std::shared_ptr<void> memory =
        hold(options_.holder, static_scene_bytes(count_, degree_), path_);
    StaticRows rows(static_cast<size_t>(count_), degree_);
    size_t first = 0;
    for (const Section& section : sections_) {
      unpack(section, first, &rows);
      first += static_cast<size_t>(section.count);
    }
    Scene scene = static_scene(std::move(rows), "ksplat", options_);
    scene.memory = std::move(memory);
    return scene;
  }

 private:
  [[noreturn]] void fail(const std::string& message) const {
    throw Error(L4D_ERR_CORRUPT, path_ + ": " + message);
  }

  uint32_t u32(uint64_t offset) const { return little_endian32(&file_[offset]); }
  double f32(uint64_t offset) const {
    return static_cast<double>(little_endian_float(&file_[offset]));
  }

  void read_header() {
    if (file_.size() < kFileHeader) fail("no KSPLAT file: it is shorter than a header");
    if (file_[0] != 0 || file_[1] < 1) {
      throw Error(L4D_ERR_FEATURE_UNSUPPORTED, path_ + ": version " + std::to_string(file_[0]) +
                                                   "." + std::to_string(file_[1]) +
                                                   " of KSPLAT; 0.1 and later are read");
    }
    level_ = little_endian16(&file_[20]);
    if (level_ >= kWidths.size()) {
      throw Error(L4D_ERR_FEATURE_UNSUPPORTED, path_ + ": compression " + std::to_string(level_) +
                                                   " of KSPLAT; 0 to 2 are read");
    }
    least_ = f32(36);
    most_ = f32(40);
    // Files of before have zeros there.
    if (least_ == 0) least_ = -1.5;
    if (most_ == 0) most_ = 1.5;
  }

  Section section_at(uint64_t header) const {
    Section s;
    s.count = u32(header);
    s.places = u32(header + 4);
    s.bucket_capacity = u32(header + 8);
    s.buckets = u32(header + 12);
    s.block_size = f32(header + 16);
    s.bucket_bytes = little_endian16(&file_[header + 20]);
    const uint32_t range = u32(header + 24);
    s.range = range == 0 ? 32767 : range;
    s.full_buckets = u32(header + 32);
    s.partial_buckets = u32(header + 36);
    s.degree = little_endian16(&file_[header + 40]);
    return s;
  }

  // Every section is compared with the bytes that are left before anything is allocated for it.
  void read_sections() {
    const uint64_t sections = u32(4);
    if (sections > (file_.size() - kFileHeader) / kSectionHeader) {
      fail("the headers of its sections reach beyond the file");
    }
    uint64_t begin = kFileHeader + sections * kSectionHeader;
    for (uint64_t k = 0; k < sections; ++k) {
      Section s = section_at(kFileHeader + k * kSectionHeader);
      s.begin = begin;
      if (s.degree > kMostHarmonicsDegree) {
        throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
                    path_ + ": spherical harmonics of degree " + std::to_string(s.degree));
      }
      // Products of numbers of 32 bits and small ones: none of them wraps around.
      const uint64_t end = s.rows() + bytes_of_row(s) * s.places;
      if (s.count > s.places || end > file_.size()) {
        fail("section " + std::to_string(k) + " reaches beyond the file");
      }
      const bool has_buckets = level_ > 0 && s.count > 0;
      if (has_buckets && (s.bucket_bytes < kCentre || s.full_buckets > s.buckets ||
                          s.partial_buckets > s.buckets - s.full_buckets)) {
        fail("the buckets of section " + std::to_string(k) + " do not fit together");
      }
      begin = end;
      if (s.count == 0) continue;
      count_ += s.count;
      degree_ = std::max(degree_, s.degree);
      sections_.push_back(s);
    }
    if (count_ != u32(16)) {
      fail("its sections have " + std::to_string(count_) + " Gaussians, and the file should have " +
           std::to_string(u32(16)));
    }
  }

  uint64_t bytes_of_row(const Section& s) const {
    const Widths& w = kWidths[level_];
    return 6 * w.position + 4 * w.rotation + 4 + 3 * s.coefficients() * w.harmonic;
  }

  double number(uint64_t offset) const {
    return level_ == 0 ? f32(offset) : little_endian_half(&file_[offset]);
  }
  double harmonic(uint64_t offset) const {
    return level_ < 2 ? number(offset) : least_ + (most_ - least_) * file_[offset] / 255;
  }

  // Which bucket each Gaussian of a section is in: full ones first, then others with their sizes.
  class BucketWalk {
   public:
    BucketWalk(const KsplatReader& reader, const Section& section)
        : reader_(reader), s_(section), end_(section.full_buckets * section.bucket_capacity) {}
    uint64_t of(uint64_t row) {
      if (row < s_.full_buckets * s_.bucket_capacity) return row / s_.bucket_capacity;
      while (row >= end_) {
        if (partial_ == s_.partial_buckets) {
          reader_.fail("its buckets hold fewer Gaussians than their section");
        }
        end_ += reader_.u32(s_.begin + 4 * partial_++);
      }
      return s_.full_buckets + partial_ - 1;
    }

   private:
    const KsplatReader& reader_;
    const Section& s_;
    uint64_t end_ = 0;      // the first row behind the partial buckets so far
    uint64_t partial_ = 0;  // how many of them there were
  };

  void unpack(const Section& s, size_t first, StaticRows* rows) const {
    const Widths& w = kWidths[level_];
    BucketWalk walk(*this, s);
    const uint64_t centres = s.begin + 4 * s.partial_buckets;
    const double step = s.block_size / 2 / s.range;
    const size_t numbers = size_t{3} * (rows->sh_degree + 1) * (rows->sh_degree + 1);
    for (uint64_t row = 0; row < s.count; ++row) {
      uint64_t at = s.rows() + row * bytes_of_row(s);
      const size_t i = first + static_cast<size_t>(row);
      const uint64_t centre = level_ == 0 ? 0 : centres + s.bucket_bytes * walk.of(row);
      for (uint64_t k = 0; k < 3; ++k, at += w.position) {
        rows->position[3 * i + k] = static_cast<float>(
            level_ == 0 ? f32(at)
                        : (little_endian16(&file_[at]) - s.range) * step + f32(centre + 4 * k));
      }
      for (uint64_t k = 0; k < 3; ++k, at += w.position) {
        rows->log_scale[3 * i + k] = static_cast<float>(std::log(number(at)));
      }
      for (uint64_t k = 0; k < 4; ++k, at += w.rotation) {
        rows->rotation[4 * i + k] = static_cast<float>(number(at));
      }
      float* sh = &rows->sh[numbers * i];
      for (uint64_t k = 0; k < 3; ++k) {
        sh[k] = static_cast<float>((file_[at + k] / 255.0 - 0.5) /
                                   static_cast<double>(sh_constant::k0));
      }
      rows->opacity[i] = static_cast<float>(file_[at + 3] / 255.0);
      at += 4;
      // Degree after degree, each channel after channel.
      for (uint32_t degree = 1; degree <= s.degree; ++degree) {
        for (uint32_t c = 0; c < 3; ++c) {
          for (uint32_t k = degree * degree; k < (degree + 1) * (degree + 1); ++k) {
            sh[3 * k + c] = static_cast<float>(harmonic(at));
            at += w.harmonic;
          }
        }
      }
    }
  }

  std::string path_;
  ImportOptions options_;
  std::shared_ptr<void> file_memory_;
  std::vector<uint8_t> file_;
  size_t level_ = 0;               // of compression
  double least_ = 0, most_ = 0;    // of spherical harmonics of a byte
  std::vector<Section> sections_;  // that have Gaussians
  uint64_t count_ = 0;
  uint32_t degree_ = 0;
};

}  // namespace

Scene read_ksplat(InputFile input, const ImportOptions& options) {
  return KsplatReader(&input, options).read();
}

}  // namespace l4d::io

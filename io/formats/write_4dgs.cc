// SPDX-License-Identifier: Apache-2.0
#include "io/formats/write_4dgs.h"

#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <utility>

#include "io/file/file.h"
#include "io/file/little_endian.h"
#include "io/formats/fdgs_born.h"
#include "io/formats/fdgs_streams.h"
#include "io/scene/statements.h"
#include "libl4dcodec/scene/sh.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d::io {
namespace {

using fdgs::Born;
using Bytes = std::vector<uint8_t>;

// Halves of the sequence, and halves of those: a Gaussian is in the smallest that it is seen in
// alone.
constexpr uint32_t kMostLevels = 8;
constexpr double kShortestChunk = 0.5;  // seconds
// Readers limit the size of a stream.
constexpr size_t kMostInChunk = size_t{1} << 20;

void put_double(double value, Bytes* to) {
  uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof(bits));
  append_little_endian(to, bits, 8);
}
void put_text(const std::string& text, Bytes* to) {
  append_little_endian(to, text.size(), 4);
  to->insert(to->end(), text.begin(), text.end());
}
void put_texts(const fdgs::Texts& texts, Bytes* to) {
  Bytes block;
  for (const auto& [key, text] : texts) {
    put_text(key, &block);
    put_text(text, &block);
  }
  append_little_endian(to, block.size(), 4);
  to->insert(to->end(), block.begin(), block.end());
}

// The integers of a Gaussian.
struct BornBins {
  std::array<int32_t, 3> position, scale, rotation, color, motion;
  int32_t left_out = 0, opacity = 0, time = 0, sigma = 0, flags = 0;
};

int32_t bin_of(double value, double step) {
  return static_cast<int32_t>(std::lround(value / step));
}

struct ChunkOfScene {
  double begin = HUGE_VAL, end = -HUGE_VAL;
  uint32_t level = 0;
  std::vector<const Born*> gaussians;
};

// Where a record lies.
struct Place {
  uint64_t offset = 0, size = 0;
};

class FdgsWriter {
 public:
  FdgsWriter(const std::string& path, const Scene& scene, const Check& check)
      : scene_(scene),
        check_(check),
        born_(fdgs::born_scene(scene, path, &notes_)),
        grids_(fdgs::grids_of(born_)),
        file_(path) {
    if (born_.gaussians.size() > UINT32_MAX) {
      throw Error(L4D_ERR_LIMIT_EXCEEDED, path + ": more than 2^32 - 1 Gaussians");
    }
  }

  WriteNotes write() {
    write_bytes({fdgs::kMagic.begin(), fdgs::kMagic.end()});
    const std::vector<ChunkOfScene> chunks = chunks_of_scene();
    write_record(fdgs::kHeader, header());
    write_record(fdgs::kQuantization, quantization());
    write_record(fdgs::kWindowTable, windows());
    write_frame();
    write_view();
    Bytes index;
    for (const ChunkOfScene& chunk : chunks) write_chunk(chunk, &index);
    append_record(fdgs::kStatistics, statistics(chunks.size()), &index);
    Bytes footer;
    append_little_endian(&footer, offset_, 8);
    append_little_endian(&footer, 0, 8);
    append_little_endian(
        &footer, crc32(crc32(0, nullptr, 0), index.data(), static_cast<uInt>(index.size())), 4);
    write_bytes(index);
    write_record(fdgs::kFooter, footer);
    write_bytes({fdgs::kMagic.begin(), fdgs::kMagic.end()});
    file_.commit();
    note_lost_statements(".4dgs", lost_statements(), &notes_);
    if (const uint64_t coarse = count_coarse(); coarse > 0) {
      notes_.emplace("Gaussians are smaller than steps of position, as the scene is so wide",
                     coarse);
    }
    if (colors_ > 0) {
      notes_.emplace("Gaussians had a base colour outside 0 to 1, now limited", colors_);
    }
    if (harmonics_ > 0) {
      notes_.emplace("Gaussians had spherical harmonics outside -4 to 4, now limited", harmonics_);
    }
    return std::move(notes_);
  }

 private:
  void write_bytes(const Bytes& bytes) {
    file_.write(bytes.data(), bytes.size());
    offset_ += bytes.size();
  }
  static void append_record(uint8_t opcode, const Bytes& content, Bytes* to) {
    to->push_back(opcode);
    append_little_endian(to, content.size(), 8);
    to->insert(to->end(), content.begin(), content.end());
  }
  Place write_record(uint8_t opcode, const Bytes& content) {
    Bytes begin = {opcode};
    append_little_endian(&begin, content.size(), 8);
    const Place place{offset_, begin.size() + content.size()};
    write_bytes(begin);
    write_bytes(content);
    return place;
  }

  void put_bounds(Bytes* to) const {
    Vec3 low{0, 0, 0}, high{0, 0, 0};
    bool is_first = true;
    for (const Born& g : born_.gaussians) {
      for (size_t k = 0; k < 3; ++k) {
        const double x =
            grids_.origin[k] +
            grids_.position * std::round((g.position[k] - grids_.origin[k]) / grids_.position);
        low[k] = is_first ? x : std::min(low[k], x);
        high[k] = is_first ? x : std::max(high[k], x);
      }
      is_first = false;
    }
    for (const double x : low) put_double(x, to);
    for (const double x : high) put_double(x, to);
  }

  Bytes header() const {
    constexpr uint8_t kCompressed = 2;
    Bytes out;
    put_text("", &out);  // profile
    put_text("l4dcodec", &out);
    put_double(born_.seconds, &out);
    append_little_endian(&out, born_.gaussians.size(), 8);
    put_double(fdgs::kCutoff, &out);
    put_text(fdgs::kTemporalModel, &out);
    put_bounds(&out);
    out.push_back(static_cast<uint8_t>(scene_.sh_degree));
    out.push_back(kCompressed);
    const bool is_linear = scene_.placement.color_space == L4D_COLOR_LINEAR_SRGB;
    put_texts({{fdgs::kColorSpace, is_linear ? fdgs::kLinearColors : fdgs::kDisplayColors},
               {fdgs::kFrameRate, std::to_string(scene_.timeline.fps_num) + "/" +
                                      std::to_string(scene_.timeline.fps_den)}},
              &out);
    return out;
  }

  Bytes quantization() const {
    Bytes out;
    put_text(fdgs::kScheme, &out);
    for (const double x : grids_.origin) put_double(x, &out);
    for (const double step : {grids_.position, grids_.scale_log, grids_.rotation, grids_.color,
                              grids_.opacity, grids_.motion, grids_.time, grids_.sigma_log}) {
      put_double(step, &out);
    }
    out.push_back(1);  // of spherical harmonics: every byte counts
    const auto half = [](double step) { return text_of_number(step / 2); };
    put_texts({{"pos", half(grids_.position)},
               {"scale_rel", half(grids_.scale_log)},
               {"rot", half(grids_.rotation)},
               {"rgb", half(grids_.color)},
               {"alpha", half(grids_.opacity)},
               {"motion", half(grids_.motion)},
               {"time", half(grids_.time)},
               {"sigma_rel", half(grids_.sigma_log)},
               {"sh", "0"}},
              &out);
    return out;
  }

  Bytes windows() const {
    Bytes out;
    append_little_endian(&out, born_.windows.size(), 4);
    for (const auto& [begin, end] : born_.windows) {
      put_double(begin, &out);
      put_double(end, &out);
    }
    return out;
  }

  // Axes and unit, where they are known.
  void write_frame() {
    constexpr uint8_t kRight = 1, kUp = 1, kForward = 2, kDown = 4, kBack = 5, kMetre = 1;
    const uint32_t system = scene_.placement.coordinate_system;
    if (system == L4D_COORDINATES_UNKNOWN) return;
    const bool is_up = system == L4D_COORDINATES_RIGHT_UP_BACK;
    const double metres = scene_.presentation.metres_per_unit;
    Bytes out;
    put_text("", &out);
    out.insert(out.end(), {kRight, is_up ? kUp : kDown, is_up ? kBack : kForward,
                           metres == 1 ? kMetre : uint8_t{0}});
    put_double(metres, &out);
    write_record(fdgs::kCoordinateFrame, out);
  }

  std::vector<std::string> lost_statements() const {
    l4d_placement placement = scene_.placement;
    l4d_presentation presentation = scene_.presentation;
    // The unit stands beside the axes.
    if (placement.coordinate_system != L4D_COORDINATES_UNKNOWN) presentation.metres_per_unit = 0;
    placement.coordinate_system = L4D_COORDINATES_UNKNOWN;
    placement.color_space = L4D_COLOR_SRGB;
    presentation.has_camera = 0;
    std::vector<std::string> lost = begin_statements(scene_.timeline);
    for (const std::string& line :
         placement_statements(placement, scene_.rendering, presentation)) {
      lost.push_back(line);
    }
    return lost;
  }

  // The first view, without a path.
  void write_view() {
    const l4d_presentation& p = scene_.presentation;
    if (p.has_camera == 0) return;
    Bytes out;
    put_double(p.camera_fov * 57.29577951308232, &out);
    for (const double x : p.camera_position) put_double(x, &out);
    for (const double x : p.camera_target) put_double(x, &out);
    append_little_endian(&out, 0, 4);
    put_text("linear", &out);
    out.push_back(0);
    write_record(fdgs::kCamera, out);
  }

  Bytes statistics(size_t chunks) const {
    Bytes out;
    append_little_endian(&out, born_.gaussians.size(), 8);
    append_little_endian(&out, chunks, 4);
    put_double(born_.seconds, &out);
    put_bounds(&out);
    return out;
  }

  std::vector<ChunkOfScene> chunks_of_scene() const {
    std::map<std::pair<uint32_t, uint32_t>, ChunkOfScene> found;
    for (const Born& g : born_.gaussians) {
      uint32_t level = 0, part = 0;
      for (uint32_t finer = 1; finer <= kMostLevels; ++finer) {
        const double size = std::ldexp(born_.seconds, -static_cast<int>(finer));
        const double begin = std::floor(g.begin / size);
        if (size < kShortestChunk || g.end > (begin + 1) * size) break;
        level = finer;
        part = static_cast<uint32_t>(begin);
      }
      ChunkOfScene& chunk = found[{level, part}];
      chunk.level = level;
      chunk.begin = std::min(chunk.begin, g.begin);
      chunk.end = std::max(chunk.end, g.end);
      chunk.gaussians.push_back(&g);
    }
    std::vector<ChunkOfScene> chunks;
    for (auto& [key, chunk] : found) append_sorted(std::move(chunk), &chunks);
    return chunks;
  }

  // Neighbours in space follow each other, which makes differences small.
  void append_sorted(ChunkOfScene chunk, std::vector<ChunkOfScene>* to) const {
    std::vector<std::pair<uint64_t, const Born*>> keyed;
    keyed.reserve(chunk.gaussians.size());
    for (const Born* g : chunk.gaussians) keyed.emplace_back(place_on_curve(*g), g);
    std::sort(keyed.begin(), keyed.end(), [](const auto& a, const auto& b) {
      return std::make_pair(a.first, a.second->row) < std::make_pair(b.first, b.second->row);
    });
    for (size_t first = 0; first < keyed.size(); first += kMostInChunk) {
      ChunkOfScene part;
      part.begin = chunk.begin;
      part.end = chunk.end;
      part.level = chunk.level;
      const size_t end = std::min(first + kMostInChunk, keyed.size());
      for (size_t i = first; i < end; ++i) part.gaussians.push_back(keyed[i].second);
      to->push_back(std::move(part));
    }
  }

  // 21 bits of each number, interleaved.
  uint64_t place_on_curve(const Born& g) const {
    uint64_t key = 0;
    for (size_t k = 0; k < 3; ++k) {
      // Cells of 16 steps; what is more than 2^20 of them away counts as in the last.
      const double bins = (g.position[k] - grids_.origin[k]) / grids_.position;
      const auto x = static_cast<uint64_t>(std::clamp(bins / 16, -1048576.0, 1048575.0) + 1048576);
      for (unsigned bit = 0; bit < 21; ++bit) key |= ((x >> bit) & 1) << (3 * bit + k);
    }
    return key;
  }

  // In the order in which steps depend on each other: sigma, time, the rest.
  BornBins bins_of(Born g) {
    BornBins out;
    if (std::isinf(g.sigma)) {
      out.flags = fdgs::kNeverFades;
    } else {
      out.sigma = bin_of(std::log(g.sigma), grids_.sigma_log);
      g.sigma = std::exp(out.sigma * grids_.sigma_log);
    }
    const double time = fdgs::time_step(grids_, g.sigma);
    out.time = bin_of(g.time, time);
    // The position follows the time as it will be read.
    for (size_t k = 0; k < 3; ++k) g.position[k] += g.velocity[k] * (out.time * time - g.time);
    const auto [begin, end] = born_.windows[g.window];
    const double motion = fdgs::motion_step(grids_, fdgs::kCutoff, g.sigma, end - begin);
    for (size_t k = 0; k < 3; ++k) {
      out.position[k] = bin_of(g.position[k] - grids_.origin[k], grids_.position);
      out.scale[k] = bin_of(g.log_scale[k], grids_.scale_log);
      out.motion[k] = bin_of(g.velocity[k], motion);
    }
    put_rotation(g.wxyz, &out);
    put_color(g.row, &out);
    return out;
  }

  // x y z w; the largest is left out, and positive.
  void put_rotation(const Vec4& wxyz, BornBins* out) const {
    const Vec4 xyzw{wxyz[1], wxyz[2], wxyz[3], wxyz[0]};
    size_t largest = 0;
    for (size_t k = 1; k < 4; ++k) {
      if (std::fabs(xyzw[k]) > std::fabs(xyzw[largest])) largest = k;
    }
    out->left_out = static_cast<int32_t>(largest);
    const double sign = xyzw[largest] < 0 ? -1 : 1;
    for (size_t k = 0, to = 0; k < 4; ++k) {
      if (k != largest) out->rotation[to++] = bin_of(sign * xyzw[k], grids_.rotation);
    }
  }

  void put_color(size_t row, BornBins* out) {
    std::array<int32_t, 3> rgb;
    bool is_limited = false;
    for (size_t k = 0; k < 3; ++k) {
      const double color =
          0.5 + static_cast<double>(sh_constant::k0) *
                    static_cast<double>(scene_.sh[3 * scene_.sh_coefficients() * row + k]);
      is_limited |= !(color >= -grids_.color / 2 && color <= 1 + grids_.color / 2);
      rgb[k] = bin_of(std::clamp(color, 0.0, 1.0), grids_.color);
    }
    colors_ += is_limited;
    out->color = {rgb[1], rgb[0] - rgb[1], rgb[2] - rgb[1]};
    const double opacity = linear_opacity(static_cast<double>(scene_.opacity[row]),
                                          (scene_.flags & L4D_OPACITY_LOGIT) != 0);
    out->opacity = bin_of(std::clamp(opacity, 0.0, 1.0), grids_.opacity);
  }

  Bytes streams_of(const ChunkOfScene& chunk) {
    std::array<std::vector<int32_t>, fdgs::kRequiredAttributes> values;
    const auto append = [&](fdgs::AttributeId id, const std::array<int32_t, 3>& row) {
      values[id].insert(values[id].end(), row.begin(), row.end());
    };
    for (const Born* g : chunk.gaussians) {
      const BornBins bins = bins_of(*g);
      append(fdgs::kPosition, bins.position);
      append(fdgs::kScale, bins.scale);
      append(fdgs::kRotation, bins.rotation);
      append(fdgs::kColor, bins.color);
      append(fdgs::kMotion, bins.motion);
      values[fdgs::kRotationIndex].push_back(bins.left_out);
      values[fdgs::kOpacity].push_back(bins.opacity);
      values[fdgs::kMeanTime].push_back(bins.time);
      values[fdgs::kSigma].push_back(bins.sigma);
      values[fdgs::kFlags].push_back(bins.flags);
      values[fdgs::kWindowIndex].push_back(static_cast<int32_t>(g->window));
    }
    Bytes out;
    for (size_t id = 0; id < values.size(); ++id) {
      call(check_);
      const Bytes stream =
          fdgs::pack_stream(static_cast<uint8_t>(id), fdgs::kChannels[id], values[id]);
      out.insert(out.end(), stream.begin(), stream.end());
    }
    return out;
  }

  // Red, then green, then blue, of each Gaussian.
  Bytes band_of(const ChunkOfScene& chunk, uint32_t band) {
    call(check_);
    const size_t numbers = 2 * size_t{band} + 1;
    std::vector<int32_t> bytes;
    bytes.reserve(3 * numbers * chunk.gaussians.size());
    for (const Born* g : chunk.gaussians) {
      const float* sh = &scene_.sh[3 * scene_.sh_coefficients() * g->row];
      bool is_limited = false;
      for (size_t c = 0; c < 3; ++c) {
        for (size_t k = 0; k < numbers; ++k) {
          const double x = static_cast<double>(sh[3 * (size_t{band} * band + k) + c]);
          is_limited |= !(std::fabs(x) <= -fdgs::kLeastHarmonic);
          const double least = fdgs::kLeastHarmonic;
          bytes.push_back(bin_of(std::clamp(x, least, -least) - least, fdgs::kHarmonicStep));
        }
      }
      harmonics_ += is_limited;
    }
    Bytes out = {static_cast<uint8_t>(band)};
    const Bytes stream = fdgs::pack_stream(fdgs::kShBand, static_cast<uint8_t>(3 * numbers), bytes);
    out.insert(out.end(), stream.begin(), stream.end());
    return out;
  }

  // Gaussians that the least step of a scene of this width may move by half of their size or more.
  uint64_t count_coarse() const {
    uint64_t count = 0;
    for (const Born& g : born_.gaussians) {
      const double size = std::exp(*std::max_element(g.log_scale.begin(), g.log_scale.end()));
      count += size < grids_.position ? 1 : 0;
    }
    return count;
  }

  void write_chunk(const ChunkOfScene& chunk, Bytes* index) {
    const Bytes streams = streams_of(chunk);
    Bytes content;
    put_double(chunk.begin, &content);
    put_double(chunk.end, &content);
    append_little_endian(&content, chunk.level, 4);
    append_little_endian(&content, chunk.gaussians.size(), 4);
    put_text("", &content);  // streams are compressed, not the whole
    append_little_endian(&content, streams.size(), 8);
    append_little_endian(&content, streams.size(), 8);
    content.insert(content.end(), streams.begin(), streams.end());
    const Place place = write_record(fdgs::kChunk, content);
    Bytes entry;
    put_double(chunk.begin, &entry);
    put_double(chunk.end, &entry);
    append_little_endian(&entry, place.offset, 8);
    append_little_endian(&entry, place.size, 8);
    append_little_endian(&entry, chunk.gaussians.size(), 4);
    append_little_endian(&entry, scene_.sh_degree, 4);
    for (uint32_t band = 1; band <= scene_.sh_degree; ++band) {
      const Place at = write_record(fdgs::kShBand, band_of(chunk, band));
      entry.push_back(static_cast<uint8_t>(band));
      append_little_endian(&entry, at.offset, 8);
      append_little_endian(&entry, at.size, 8);
    }
    append_record(fdgs::kChunkIndex, entry, index);
  }

  const Scene& scene_;
  const Check& check_;
  WriteNotes notes_;
  fdgs::BornScene born_;
  fdgs::Grids grids_;
  OutputFile file_;
  uint64_t offset_ = 0, colors_ = 0, harmonics_ = 0;
};

}  // namespace

uint64_t bytes_to_write_4dgs(const Scene& scene) {
  // A chunk, which may be all of them, is there as pointers and keys, as numbers of steps, as their
  // bytes, and packed. A position and a number of SH take 4 bytes of these at most.
  constexpr uint64_t kOfOrder = 64, kForms = 3;
  const uint64_t bins = sizeof(BornBins) + 4 * 3 * scene.sh_coefficients();
  return scene.count() * (sizeof(Born) + 3 * sizeof(double) + kOfOrder + kForms * bins);
}

WriteNotes write_4dgs(const std::string& path, const Scene& scene, const Check& check) {
  return FdgsWriter(path, scene, check).write();
}

}  // namespace l4d::io

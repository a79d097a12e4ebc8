// SPDX-License-Identifier: Apache-2.0
// The scene header: everything that is global to a file or a layer, O(layers) in size.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/base/status.h"
#include "libl4dcodec/scene/layers.h"
#include "libl4dcodec/scene/rendering.h"

namespace l4d {

// Registry values (spec/registry/*.json). Constants of the format.
enum class ScalarCodingId : uint8_t { kConstant = 0, kRaw32 = 1, kSq = 2 };
enum class ComponentCodingId : uint8_t { kZero = 0, kRaw32 = 1, kVq = 2, kTransform = 3 };
enum class ElementType : uint8_t { kF16 = 0, kSq = 1 };
enum class CoordinateCodingId : uint8_t {
  kNone = 0,
  kRaw32 = 1,
  kF16 = 2,
  kFixed = 3,
  kRaw64 = 4,
  kWindow = 5
};

constexpr uint32_t kMaxCodebookEntries = 65536;
constexpr uint32_t kMaxResidualEntries = 4096;
constexpr uint32_t kMaxPageGaussians = 65536;
constexpr uint32_t kMaxScaleBits = 16;
constexpr uint8_t kEscapeDepth = 15;
constexpr unsigned kMaxPositionBits = 21;  // three of them in a 63-bit Morton code
constexpr unsigned kMaxMeanShift = 10;     // of the bits of a binary16, at least its exponent stays
constexpr unsigned kMaxMeanBits = 16;
constexpr unsigned kMaxWindowBits = 24;  // frames: L4D_MAX_FRAMES
// Flat windows take four columns: the low 16 bits of begins, those above, and likewise of lengths.
constexpr size_t kWindowColumns = 4;
constexpr unsigned kMaxCoefficients = 48;
constexpr unsigned kTransformStepExponents = 16;

struct ChunkRef {
  uint64_t offset = 0;
  uint64_t hash = 0;
  uint32_t stored_bytes = 0;
  uint32_t raw_bytes = 0;
  uint32_t codec = 0;
};

enum class ExtensionId : uint32_t { kMember = 1, kEdit = 2 };

struct Extension {
  uint32_t id = 0;
  bool critical = false;
  ChunkRef chunk;
};

// Upper bounds of raw_bytes (spec: CHNK-8). A codec can blow up a few bytes without end; these are
// what the content of each kind of chunk can take in its longest form, so nothing larger is ever
// allocated.
constexpr uint64_t kMaxStreamOverhead = 32;  // mode, channel codecs and sizes of one stream
constexpr uint64_t kMaxDirectoryPageBytes = uint64_t{1} << 26;
inline uint64_t max_codebook_bytes(uint32_t num_entries, uint32_t dim) {
  return uint64_t{dim} * (2 * uint64_t{num_entries} + kMaxStreamOverhead);
}
inline uint64_t max_rcq_table_bytes(uint32_t num_entries) {
  return 2 * (2 * uint64_t{num_entries} + kMaxStreamOverhead);
}

struct ScalarCoding {
  ScalarCodingId coding = ScalarCodingId::kConstant;
  unsigned bits = 0;
  float offset = 0;
  float step = 0;
};

struct StageCoding {
  uint32_t num_entries = 0;
  ElementType element = ElementType::kF16;
  ChunkRef codebook;
  float step = 0;  // sq
};

struct ComponentCoding {
  ComponentCodingId coding = ComponentCodingId::kZero;
  std::vector<StageCoding> stages;
  bool escapes = false;
  bool has_rcq = false;
  StageCoding rcq;
  StageCoding basis;               // transform: coefficients() + 1 rows
  std::vector<float> steps;        // transform, one per coefficient
  std::vector<uint8_t> eob_table;  // transform, ascending, the last is the number of coefficients

  bool transform() const { return coding == ComponentCodingId::kTransform; }
  unsigned coefficients() const { return static_cast<unsigned>(steps.size()); }
  // Codebook chunks besides that of RCQ: stages, or the basis.
  size_t num_codebooks() const { return transform() ? 1 : stages.size(); }
  const StageCoding& codebook(size_t i) const { return transform() ? basis : stages[i]; }
  StageCoding& codebook(size_t i) { return transform() ? basis : stages[i]; }
  bool vq() const { return coding == ComponentCodingId::kVq; }
  // Whether each page carries a depth per Gaussian.
  bool has_depth() const { return vq() && (stages.size() > 1 || escapes); }
};

// How the mean times of a layer are coded.
struct MeanTimeCoding {
  CoordinateCodingId mean_t = CoordinateCodingId::kF16;
  unsigned mean_t_shift = 0;  // f16: low bits of the ordered binary16 that are not coded
  unsigned mean_t_bits = 0;   // fixed: of a code
  unsigned mean_t_zero = 0;   // fixed: the code of the bucket's centre
  float mean_t_step = 0;      // fixed: seconds from code to code
  bool mean_t_fine = false;   // fixed: pages hold a refinement of each code
  // window: of the frames of a window, counted from window_base; and of its length, counted from
  // the least.
  unsigned window_begin_bits = 0;
  unsigned window_length_bits = 0;
  uint32_t window_length = 0;  // window: the least length, frames

  // Bits of a coded mean time, where there are any.
  unsigned mean_t_width() const {
    return mean_t == CoordinateCodingId::kFixed ? mean_t_bits : 16 - mean_t_shift;
  }
  bool has_raw_means() const {
    return mean_t == CoordinateCodingId::kRaw32 || mean_t == CoordinateCodingId::kRaw64;
  }
  // Gaussians have flat windows in place of mean times.
  bool flat() const { return mean_t == CoordinateCodingId::kWindow; }
  // Bits of a column of windows: the low 16 bits of begins, those above, and likewise of lengths.
  unsigned window_width(size_t column) const {
    if (!flat()) return 0;
    const unsigned bits = column < 2 ? window_begin_bits : window_length_bits;
    const unsigned low = bits < 16 ? bits : 16;
    return column % 2 == 0 ? low : bits - low;
  }
  bool has_mean_codes() const {
    return mean_t == CoordinateCodingId::kF16 || mean_t == CoordinateCodingId::kFixed;
  }
};

struct LayerHeader : MeanTimeCoding {
  unsigned level = 0;
  bool permanent = false;
  uint64_t num_gaussians = 0;
  float log_scale_t = 0;
  ScalarCoding scale_factor;
  std::array<ComponentCoding, L4D_COMPONENT_COUNT> component;  // SH unused: it is global
  unsigned directory_bits = 0;
  uint64_t page_table_offset = 0;
  bool has_entropy = false;
  ChunkRef entropy;                   // tables of the layer's rans32 pages
  bool raw_position = false;          // raw32, whatever the scene's positions are
  unsigned tier = 0;                  // players may leave out those above one
  unsigned symbols_per_gaussian = 0;  // of rANS pages, at most; 0 = not declared

  // Numbers of a normalised scale vector: permanent layers carry no temporal scale.
  unsigned scale_dim() const { return permanent ? 3 : 4; }
};

// What the encoder states of single Gaussians (spec: section 8.5).
struct ErrorStatement {
  bool stated = false;
  float position = 0, covariance = 1, opacity = 0, visible = 0, mean_t = 0;
  float position_bound = 0, covariance_bound = 0, opacity_bound = 0, visible_bound = 0;
  float min_size = 0;
  bool own_min_sizes = false;
  bool colors = false;  // what follows is stated
  float base_color = 0, directional_color = 0;
  float base_color_bound = 0, directional_color_bound = 0;
};

// How positions are coded, in all layers but those of raw positions.
struct PositionCoding {
  CoordinateCodingId position = CoordinateCodingId::kF16;
  unsigned position_bits = 0;  // fixed
  float position_center[3] = {0, 0, 0};
  float position_scale = 1;

  // Scene units of a unit of page bounds (spec: section 12): fixed coordinates go beyond binary16.
  double bounds_unit() const {
    const unsigned shift =
        position == CoordinateCodingId::kFixed && position_bits > 15 ? position_bits - 15 : 0;
    return static_cast<double>(position_scale) * static_cast<double>(1u << shift);
  }
};

struct SceneHeader : PositionCoding {
  uint64_t num_gaussians = 0;
  l4d_timeline timeline{};
  float gate = 16;
  l4d_placement placement{};
  bool position_at_mean_time = false;
  bool opacity_logit = false;
  ScalarCoding opacity;
  unsigned sh_degree = 0;
  ComponentCoding sh;
  unsigned sh_base = 0;  // transform: how many of its coefficients the base chunk of a page holds
  std::vector<LayerHeader> layers;
  // Directory pages count offsets from here, so their bytes do not depend on what lies before them.
  uint64_t payload_offset = 0;
  uint64_t file_bytes = 0;       // of the stream; 0 = to the end of the file
  uint64_t extension_bytes = 0;  // of chunks
  bool needs_members = false;    // of the same file, without which this is not the whole picture
  std::vector<std::pair<std::string, std::string>> metadata;
  unsigned profile = 0;            // declared; 0 = none
  unsigned conformance_level = 0;  // declared; 0 = none
  ErrorStatement errors;
  l4d_rendering rendering = default_rendering();  // stated where it differs from the defaults
  l4d_presentation presentation = default_presentation();

  unsigned sh_dim() const { return 3 * (sh_degree + 1) * (sh_degree + 1); }
  // Whether Gaussians of some layer have flat windows.
  bool has_windows() const {
    for (const LayerHeader& layer : layers) {
      if (layer.flat() && layer.num_gaussians > 0) return true;
    }
    return false;
  }
  // Whether a rans32 page can have an SH chunk: channels of SH that are not of the base.
  bool has_sh_detail() const { return sh.vq() || (sh.transform() && sh_base < sh.coefficients()); }
  CoordinateCodingId position_of(const LayerHeader& layer) const {
    return layer.raw_position ? CoordinateCodingId::kRaw32 : position;
  }
  const ComponentCoding& component(const LayerHeader& layer, unsigned c) const {
    return c == L4D_COMPONENT_SH ? sh : layer.component[c];
  }
  unsigned component_dim(const LayerHeader& layer, unsigned c) const {
    if (c == L4D_COMPONENT_SH) return sh_dim();
    if (c == L4D_COMPONENT_SCALE) return layer.scale_dim();
    return layer.component[c].transform() ? 3
                                          : 4;  // a rotor's transform is of its stereographic form
  }
  // Raw float32 rotors are handed out as they are; coded ones are normalised.
  static bool normalizes_rotor(const LayerHeader& layer) {
    return layer.component[L4D_COMPONENT_ROTOR_SPATIAL].coding != ComponentCodingId::kRaw32;
  }
  static bool stereographic_rotor(const LayerHeader& layer) {
    return layer.component[L4D_COMPONENT_ROTOR_SPATIAL].transform();
  }
};

Bytes serialize_scene_header(const SceneHeader& header,
                             const std::vector<Extension>& extensions = {});
// `base`: file offset of the bytes, for messages. Checks every rule of the header that needs no
// other part of the file.
Status parse_scene_header(ByteSpan bytes, uint64_t base, SceneHeader* out);

}  // namespace l4d

// SPDX-License-Identifier: Apache-2.0
// What the host lays out for the kernels: tables of a layer, pages of a request, and the columns
// between the two steps of decoding. Plain data, the same on both sides.
#pragma once

#include <cstddef>
#include <cstdint>

#include "l4d/cuda.h"
#include "l4d/experimental/packed.h"
#include "libl4dcodec/container/channels.h"

namespace l4d::cuda {

// A rANS table (1,024 slots) as records of 32 slots: small enough that the tables of a whole
// layer stay in shared memory, and one load away from all that a step needs.
//   bits  0..31  bit i: slot i of the record is the first one of a token, for i > 0
//   bits 32..43  how many slots before the record the token of its slot 0 begins
//   bits 44..56  how many slots after the begin of the record the token of its last slot ends
//   bits 57..63  rank of the token of slot 0 among those of the table
constexpr unsigned kRecordSlots = 32;
constexpr unsigned kTableRecords = kRansSlots / kRecordSlots;
constexpr unsigned kTableRanks = 128;  // bytes that tell the token of each rank

// Tables of a channel by what is known of a symbol: eight for each step exponent, of which the
// first is that of symbols of which no magnitudes are known.
constexpr unsigned kMapBytes = 8 * kTransformStepExponents;
constexpr unsigned kIdleContext = 7;  // in a map, of lanes that have no symbol
static_assert(kMagnitudes <= kIdleContext, "a context that no symbol has");
// States that a page has room for behind those of its Gaussians: what lanes look at ahead of the
// last one.
constexpr unsigned kStatesBehind = 224;

// One channel of a page, in the order of the stream.
struct ChannelProgram {
  uint8_t kind;  // ChannelKind
  uint8_t component;
  uint8_t index;
  uint8_t table;  // of all symbols, where there is no map
  uint8_t reserved;
  uint8_t by_depth;    // index: members are those whose depth is above
  uint8_t keep_above;  // afterwards only members of a larger EOB index or depth stay; 0 = all
  uint8_t context_of;  // step exponent: component whose step_exponents are the contexts, 255 = none
  uint32_t map;        // where its map lies in those of the layer, of kinds from step exponent on
  uint32_t limit;      // values are below this; of stage 0 what the page says
};
static_assert(sizeof(ChannelProgram) == 16);

struct DeviceScalar {
  uint32_t is_coded;  // 0: the offset is the value
  float offset, step;
};

struct DeviceComponent {
  uint32_t coding;  // ComponentCodingId
  uint32_t num_stages;
  uint32_t has_depth;
  uint32_t num_coefficients;
  uint32_t num_eob_indices;  // steps of the EOB table; with one there is no column of EOB indices
  uint32_t dim;              // numbers of a row, as coded
  // [entries, dim]; of a transform [0] is the basis, the origin first.
  const float* codebook[L4D_MAX_STAGES];
  const float* steps;  // [num_coefficients]
  // Of SH in place of steps (quant/integer_basis.h): [num_coefficients, dim].
  const int16_t* integer_basis;
  float integer_scale;
  uint8_t eob_table[kMaxCoefficients];
};

struct DeviceLayer {
  // rANS.
  const uint64_t* records;  // [num_tables, kTableRecords], the last one idle
  const uint8_t* tokens;    // [num_tables, kTableRanks]
  const uint8_t* maps;      // [map_bytes], kMapBytes each
  const ChannelProgram* channels;
  uint32_t num_tables;
  uint32_t map_bytes;
  uint32_t num_channels;
  // Reconstruction.
  uint32_t position_fixed;
  uint32_t position_bits;  // of a coded coordinate
  uint32_t mean_t_coded;   // 0: none, else a CoordinateCodingId
  uint32_t mean_t_shift;
  uint32_t mean_t_zero;
  uint32_t mean_t_fine;
  float mean_t_step;
  uint32_t flat;            // Gaussians have windows
  uint32_t window_columns;  // bit k: column k of windows has bits
  uint32_t window_length;   // the least
  uint32_t permanent;
  uint32_t stereographic;
  float position_center[3];
  float position_scale;
  float log_scale_t;                // clamped
  float min_opacity, most_opacity;  // what decoded opacities are clamped to
  DeviceScalar opacity, scale_factor;
  DeviceComponent component[L4D_COMPONENT_COUNT];
};

constexpr uint64_t kNoCodebook = ~uint64_t{0};

// A page and where its parts lie in the upload, each at a multiple of 16 bytes.
struct DevicePage {
  uint64_t first;  // Gaussian in the decoded arrays
  uint64_t chunk_at[2];
  uint64_t codebook[L4D_COMPONENT_COUNT];  // of stage 0 in the upload; kNoCodebook = the layer's
  double center;
  float width;
  uint32_t slot;   // first Gaussian in the columns, a multiple of 32
  uint32_t state;  // and among the states
  uint32_t n;
  uint32_t layer;
  uint32_t chunk_bytes[2];
  uint32_t middle;       // channels of the base chunk
  uint32_t sh_limit;     // coefficients of SH that count
  uint32_t has_sh;       // 0: no channel of SH is decoded, not even depths and step_exponents
  uint32_t piece;        // first of the pieces that its escapes are counted in
  uint32_t window_base;  // of a flat layer: the frame that begins count from
  uint32_t stage0_entries[L4D_COMPONENT_COUNT];
};

// What one warp decodes: the parts of a page that are in `parts`, bit p = part p, one after
// another.
struct WarpTask {
  uint32_t page;
  uint32_t parts;
};

// What one block of threads decodes: pages of one layer.
struct BlockTask {
  uint32_t layer;
  uint32_t first;  // WarpTask
  uint32_t count;
};

// Gaussians [first, first + kExpandGaussians) of a page.
constexpr uint32_t kExpandGaussians = 256;
struct ExpandTask {
  uint32_t page;
  uint32_t first;
};

// Pages of one layer that the host has packed: one piece, and escapes that lie in the upload.
struct HostPiece {
  uint64_t at[L4D_COMPONENT_COUNT];  // in the upload, [rows, dim] binary16
  uint64_t rows[L4D_COMPONENT_COUNT];
  uint32_t dim[L4D_COMPONENT_COUNT];
  uint32_t piece;
  uint32_t reserved;
};

// Escapes of a piece, and then of the pieces before it: rows, and the numbers of those rows, which
// are more or fewer from layer to layer.
struct EscapeSum {
  uint64_t rows, numbers;
};

// What is wrong with a part of a page; the first word that is not kPageOk ends its decoding.
enum PageFault : uint32_t {
  kPageOk = 0,
  kFaultEnd,           // RANS-7
  kFaultPosition,      // RANS-8
  kFaultCode,          // STRM-3
  kFaultNotFinite,     // VAL-1
  kFaultEscape,        // VAL-2
  kFaultDepth,         // VQ-1
  kFaultIndex,         // VQ-2
  kFaultStepExponent,  // TRAN-5
  kFaultEobIndex,      // TRAN-6
  kFaultWindow,        // WIND-3
};

// Values between the two steps, one column after another, `stride` slots each. Values of a
// component are those of its stages and then of its escapes, or its coefficients; what a Gaussian
// does not have is not written.
struct Columns {
  uint64_t* morton;
  uint16_t* mean_t;       // binary16, or codes of fixed ones
  uint16_t* mean_t_fine;  // refinements
  uint16_t* window;       // kWindowColumns of them, of requests with flat layers
  uint16_t* opacity;
  uint16_t* scale_factor;
  uint32_t* state;  // [2, state_stride] of the Gaussians that take part in the channel at hand
  struct Component {
    uint8_t* head;  // depth or step exponent
    uint8_t* eob_index;
    uint16_t* value;
  } component[L4D_COMPONENT_COUNT];
  size_t stride;
  size_t state_stride;
};

// A request as kernels see it.
struct DeviceRequest {
  const DeviceLayer* layers;
  const unsigned char* upload;
  const DevicePage* pages;
  const WarpTask* warps;
  const BlockTask* blocks;
  const ExpandTask* expands;
  uint32_t* faults;  // [pages, 2]
  Columns columns;
  l4d_timeline timeline;
  // Of the packed form. Pieces are ExpandTasks and HostPieces in the order of the Gaussians.
  const HostPiece* host_pieces;
  EscapeSum* escapes;     // [num_pieces, L4D_COMPONENT_COUNT]
  uint64_t* num_escapes;  // [L4D_COMPONENT_COUNT]
  uint32_t num_expands;
  uint32_t num_host_pieces;
  uint32_t num_pieces;  // 0 where nothing may have escapes
};

// Decoded arrays; null = not wanted.
using DeviceArrays = l4d_cuda_gaussian_buffers;

// Packed arrays, as l4d_packed_buffers; null = not wanted.
struct PackedArrays {
  uint16_t* position;
  uint16_t* mean_t;
  uint16_t* opacity;
  uint16_t* scale_factor;
  uint32_t* window;
  struct Component {
    uint8_t* depth;
    uint16_t* index;  // stage s at s * capacity
    uint16_t* escape;
    uint64_t escape_capacity;
  } component[L4D_COMPONENT_COUNT];
  uint64_t capacity;
};
static_assert(sizeof(DeviceRequest) + sizeof(PackedArrays) <= 4096, "parameters of one kernel");

}  // namespace l4d::cuda

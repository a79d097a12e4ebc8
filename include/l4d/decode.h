/* SPDX-License-Identifier: Apache-2.0
 * decode.h: reading .l4d streams. Safe on untrusted input: every failure is a status.
 *
 *   l4d_decoder* decoder;
 *   l4d_decoder_create(NULL, &decoder);                   // each call returns an l4d_status
 *   l4d_decoder_open_file(decoder, "scene.l4d");
 *   l4d_query query; l4d_query_init(&query);
 *   query.kind = L4D_QUERY_TIME; query.time_begin = 2.5;
 *   l4d_selection selection; l4d_selection_init(&selection);
 *   l4d_decoder_select(decoder, &query, &selection);      // number of Gaussians and of bytes
 *   float* position = malloc(selection.num_gaussians * 3 * sizeof *position);
 *   l4d_gaussian_buffers buffers; l4d_gaussian_buffers_init(&buffers);
 *   buffers.capacity = selection.num_gaussians; buffers.position = position;
 *   l4d_decoder_decode(decoder, &query, &buffers);
 *   l4d_decoder_destroy(decoder);
 */
#ifndef L4D_DECODE_H
#define L4D_DECODE_H

#include "l4d/l4d.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct l4d_decoder l4d_decoder;

enum { L4D_BACKEND_AUTO = 0, L4D_BACKEND_REFERENCE = 1, L4D_BACKEND_CPU = 2, L4D_BACKEND_CUDA = 3 };

typedef struct l4d_decoder_options {
  size_t struct_size;
  /* Limits on what a stream may cost; 0 = the default. A stream beyond one fails with
   * LIMIT_EXCEEDED. */
  uint64_t max_memory_bytes; /* of all allocations of the handle; 16 GiB */
  uint64_t max_gaussians;    /* of one stream; 2^30 */
  uint32_t max_frames;       /* of one stream; 2^24, the format's own maximum */
  uint32_t threads; /* at most L4D_MAX_THREADS; 0 = one per core; never changes the output */
  /* L4D_BACKEND_*; never changes the output. With CUDA, l4d_decoder_decode runs on CUDA device 0
   * and copies the result to the host. All other functions, and all of a tolerant decoder, run on
   * the host. To keep decoded arrays on the device, use cuda.h. */
  uint32_t backend;
  uint64_t cache_bytes; /* budget of the bucket cache that time stepping uses; 0 = 512 MiB */
  /* 0 (strict): a damaged chunk or a failure of the reader fails the query. 1 (tolerant): the query
   * skips what cannot be read and succeeds; l4d_decoder_get_losses lists what is missing. */
  uint32_t tolerant;
  /* 0: a stream that is a member of a file and needs others (members.h) fails with
   * FEATURE_UNSUPPORTED when it is opened. 1: it opens; the caller shows the others with it. */
  uint32_t accept_needs;
  /* As l4d_decoder_set_progress, for l4d_validate too; NULL = none. */
  l4d_progress_fn progress;
  void* progress_user;
} l4d_decoder_options;
L4D_API void l4d_decoder_options_init_(l4d_decoder_options* options, size_t struct_size);
#define l4d_decoder_options_init(options) l4d_decoder_options_init_((options), sizeof(*(options)))

/* Creates a decoder without a stream. options may be NULL: all defaults. On failure
 * l4d_last_error_message returns the reason.
 * Fails with INVALID_ARGUMENT if an option is out of range, OUT_OF_MEMORY, DEVICE if backend is
 * CUDA and no device can be used, FEATURE_UNSUPPORTED if this build lacks the backend. */
L4D_API l4d_status l4d_decoder_create(const l4d_decoder_options* options, l4d_decoder** out);
L4D_API void l4d_decoder_destroy(l4d_decoder* decoder); /* accepts NULL */

/* Returns why the last call on this handle failed, or "" if it succeeded. UTF-8, owned by the
 * handle, valid until the next call on it. For people: its wording changes between versions. */
L4D_API const char* l4d_decoder_error_message(const l4d_decoder* decoder);

/* Opens a stream, and closes the one that was open. Reads the file header and the scene header:
 * bytes and time grow with the number of layers only. The decoder copies `reader`, and uses
 * reader->user until another stream is opened or the decoder is destroyed. It borrows `data` of
 * open_memory for as long.
 * Fails with NOT_L4D, VERSION_UNSUPPORTED, FEATURE_UNSUPPORTED, TRUNCATED, CORRUPT, CHECKSUM,
 * LIMIT_EXCEEDED, IO, OUT_OF_MEMORY. */
L4D_API l4d_status l4d_decoder_open(l4d_decoder* decoder, const l4d_reader* reader);
L4D_API l4d_status l4d_decoder_open_memory(l4d_decoder* decoder, const void* data, size_t size);
L4D_API l4d_status l4d_decoder_open_file(l4d_decoder* decoder, const char* path);

/* ---- properties of the stream ---------------------------------------------------------------- */

/* Coding tools (spec chapter "Tools"). A tool that a stream does not use costs no byte and runs no
 * code. */
enum {
  L4D_TOOL_MOTION = 1u << 0,           /* some layer has temporal rotors */
  L4D_TOOL_TEMPORAL_OPACITY = 1u << 1, /* some layer has mean times or windows */
  L4D_TOOL_VIEW_DEPENDENCE = 1u << 2,  /* SH degree above 0 */
  L4D_TOOL_RESIDUAL_STAGES = 1u << 3,  /* some component has more than one stage */
  L4D_TOOL_ESCAPES = 1u << 4,   /* some component has escapes, or one that is stored as escapes */
  L4D_TOOL_RCQ = 1u << 5,       /* some block has its own codebook */
  L4D_TOOL_LOSSLESS = 1u << 6,  /* attributes are coded as raw float32 */
  L4D_TOOL_TRANSFORM = 1u << 7, /* some component is transform coefficients, without codebooks */
  L4D_TOOL_RANS = 1u << 8,      /* some layer has pages coded by rANS */
  L4D_TOOL_SH_BASE = 1u << 9,   /* L4D_DETAIL_BASE_COLOR gives colours averaged over directions */
  L4D_TOOL_FLAT_WINDOWS = 1u << 10 /* Gaussians of some layer are shown in a range of frames */
};

typedef struct l4d_info {
  size_t struct_size;
  uint32_t format_major;
  uint32_t format_minor;
  uint32_t development; /* 1: made by a draft of the format, no guarantee */
  uint32_t sh_degree;
  uint32_t flags; /* of the decoded arrays: L4D_POSITION_AT_MEAN_TIME, L4D_OPACITY_LOGIT */
  uint32_t tools; /* L4D_TOOL_* */
  uint32_t num_layers;
  uint32_t reserved;
  uint64_t num_gaussians;
  uint64_t file_bytes;
  l4d_timeline timeline;
  double duration; /* seconds */
  l4d_placement placement;
  /* What the header declares; 0 = nothing. l4d_validate checks it, l4d_decoder_open does not. */
  uint32_t profile; /* L4D_PROFILE_*, or of a later version */
  uint32_t level;   /* conformance level, see l4d_get_level_limits */
  /* 1: the file declares the streamable layout: what a player needs first comes first. l4d_validate
   * checks it, l4d_decoder_open does not. */
  uint32_t streamable;
  uint32_t reserved2;
} l4d_info;
L4D_API void l4d_info_init_(l4d_info* info, size_t struct_size);
#define l4d_info_init(info) l4d_info_init_((info), sizeof(*(info)))
L4D_API l4d_status l4d_decoder_get_info(const l4d_decoder* decoder, l4d_info* info);

/* The encoder's statement on single Gaussians (spec section "ErrorStatement"): the largest errors
 * over all decoded Gaussians of the stream, and the bounds that were set. The decoder does not
 * check it.
 */
typedef struct l4d_coding_errors {
  size_t struct_size;
  uint32_t stated; /* 0: the stream states no errors; all that follows is 0 */
  /* 1: the caller of the encoder gave each Gaussian a minimum size of its own, such as half a pixel
   * at the nearest camera; smaller sizes count as that. */
  uint32_t own_min_sizes;
  /* Distance while the Gaussian has half of its greatest opacity or more, over its size. */
  double position;
  /* Ratio between a principal variance and the given one, whichever is larger over the other; and 1
   * plus the change of the variance in any direction over the largest variance. 1 = no error */
  double covariance;
  double opacity; /* at any instant */
  double visible; /* scene units: distance at any instant at which the Gaussian is visible */
  double mean_t;  /* in standard deviations over time of the Gaussian */
  /* 0 = there was none. */
  double position_bound;
  double covariance_bound;
  double opacity_bound;
  double visible_bound;
  double min_size; /* scene units: the size of a Gaussian that is smaller counts as this */
  /* Colours, as L4D_ENC_MAX_BASE_COLOR_ERROR and L4D_ENC_MAX_DIRECTIONAL_COLOR_ERROR measure them.
   * 0: the stream states nothing of colours, and the next four are 0. */
  uint32_t colors_stated;
  uint32_t reserved;
  double base_color;
  double directional_color;
  double base_color_bound;
  double directional_color_bound;
} l4d_coding_errors;
L4D_API void l4d_coding_errors_init_(l4d_coding_errors* errors, size_t struct_size);
#define l4d_coding_errors_init(errors) l4d_coding_errors_init_((errors), sizeof(*(errors)))
L4D_API l4d_status l4d_decoder_get_coding_errors(const l4d_decoder* decoder,
                                                 l4d_coding_errors* errors);

/* How the stream asks to be drawn and shown; the defaults where it states nothing. */
L4D_API l4d_status l4d_decoder_get_rendering(const l4d_decoder* decoder, l4d_rendering* rendering);
L4D_API l4d_status l4d_decoder_get_presentation(const l4d_decoder* decoder,
                                                l4d_presentation* presentation);

/* How a component is coded. The values are those of the spec's chapter "Scene header". */
enum {
  L4D_CODING_ZERO = 0, /* not coded: all values are 0 */
  L4D_CODING_RAW = 1,  /* binary32 */
  L4D_CODING_CODEBOOKS = 2,
  L4D_CODING_TRANSFORM = 3 /* coefficients of a basis */
};

typedef struct l4d_layer_info {
  size_t struct_size;
  uint32_t index;
  uint32_t level; /* temporal level: bucket width is duration / 2^(level + 1), level 0 one bucket */
  uint32_t tools; /* L4D_TOOL_* of this layer */
  uint32_t permanent; /* 1: always visible, no temporal falloff */
  uint64_t num_buckets;
  uint64_t num_gaussians;
  double bucket_width;     /* seconds */
  uint64_t codebook_bytes; /* stored */
  uint32_t num_stages[L4D_COMPONENT_COUNT];
  uint32_t codebook_size[L4D_COMPONENT_COUNT];    /* entries of stage 0; 0 = no codebook */
  uint32_t coding[L4D_COMPONENT_COUNT];           /* L4D_CODING_* */
  uint32_t num_coefficients[L4D_COMPONENT_COUNT]; /* of the basis of a transform, else 0 */
  /* 0 for what matters most. The encoder may cut the long-lived Gaussians into tiers by importance,
   * so that a player shows a coarse picture before all of them are here. */
  uint32_t tier;
  /* Upper bound of the symbols of rANS that decoding a Gaussian takes, as the layer declares it or
   * by its channels; 0 where it has none. */
  uint32_t symbols_per_gaussian;
} l4d_layer_info;
L4D_API void l4d_layer_info_init_(l4d_layer_info* info, size_t struct_size);
#define l4d_layer_info_init(info) l4d_layer_info_init_((info), sizeof(*(info)))
L4D_API l4d_status l4d_decoder_get_layer_info(const l4d_decoder* decoder, uint32_t layer,
                                              l4d_layer_info* info);

/* Parts of a file. Their stored bytes add up to the size of the file. */
enum {
  L4D_SECTION_HEADER = 0, /* file header, scene header, extensions */
  L4D_SECTION_DIRECTORY,  /* page tables, directory pages */
  L4D_SECTION_CODEBOOKS,
  L4D_SECTION_RCQ_TABLES,
  L4D_SECTION_PAGE_OVERHEAD,
  L4D_SECTION_POSITION,
  L4D_SECTION_MEAN_T, /* or flat windows */
  L4D_SECTION_OPACITY,
  L4D_SECTION_SCALE_FACTOR,
  L4D_SECTION_SH,
  L4D_SECTION_SCALE,
  L4D_SECTION_ROTOR_SPATIAL,
  L4D_SECTION_ROTOR_TEMPORAL,
  L4D_SECTION_ENTROPY_TABLES, /* of rANS pages */
  L4D_SECTION_COUNT
};
L4D_API const char* l4d_section_name(uint32_t section); /* "codebooks"; static; NULL if unknown */
/* Counts stored bytes. Reads every directory page and the head of every page.
 * sections: [capacity], indexed by L4D_SECTION_*. *count, unless NULL, receives the number of
 * sections that this library knows; the first min(capacity, *count) elements are written.
 * layer_bytes: [layer_capacity], bytes of each layer's directory, codebooks, tables and pages; the
 * first min(layer_capacity, num_layers) elements are written. May be NULL if layer_capacity is 0.
 */
L4D_API l4d_status l4d_decoder_get_sections(l4d_decoder* decoder, uint64_t* sections,
                                            uint32_t capacity, uint32_t* count,
                                            uint64_t* layer_bytes, uint32_t layer_capacity);

/* ---- selecting and decoding ---------------------------------------------------------------- */
enum {
  L4D_QUERY_ALL = 0,    /* the whole stream */
  L4D_QUERY_TIME = 1,   /* every bucket that can hold a Gaussian visible at time_begin */
  L4D_QUERY_RANGE = 2,  /* ... visible at some time in [time_begin, time_end] */
  L4D_QUERY_BUCKETS = 3 /* the listed buckets, complete */
};
/* A time bucket of a layer, as in l4d_bucket_span. */
typedef struct l4d_bucket {
  uint32_t layer;
  uint32_t bucket; /* below l4d_layer_info.num_buckets */
} l4d_bucket;      /* frozen */
/* Which chunks of each page a query reads. */
enum {
  L4D_DETAIL_FULL = 0, /* the base chunk and the SH chunk */
  /* The base chunk only. If the stream has L4D_TOOL_SH_BASE, colours are approximately their
   * average over view directions. Otherwise Gaussians of pages with an SH chunk get the
   * scene's mean colour (transforms) or SH coefficients of 0 (codebooks). Pages without such a
   * chunk are unaffected: small pages, and all pages of streams without rANS. */
  L4D_DETAIL_BASE_COLOR = 1
};
typedef struct l4d_query {
  size_t struct_size;
  uint32_t kind;
  uint32_t max_level; /* finest temporal level to decode; UINT32_MAX (the default) = all */
  double time_begin;  /* seconds; clamped to the sequence */
  double time_end;
  uint32_t detail; /* L4D_DETAIL_*; FULL is the default */
  /* For TIME and RANGE. 0: skips the pages in which nothing is visible. 1: returns complete
   * buckets; use this to cache buckets. */
  uint32_t whole_buckets;
  /* For BUCKETS: [num_buckets], borrowed during the call, in strictly ascending order of layer and
   * then bucket. Any other order fails with INVALID_ARGUMENT. Buckets of levels above max_level and
   * of tiers above max_tier are skipped. */
  const l4d_bucket* buckets;
  uint64_t num_buckets;
  /* Highest tier to decode; UINT32_MAX (the default) = all. Layers of lower tiers matter more. */
  uint32_t max_tier;
  uint32_t reserved;
} l4d_query;
L4D_API void l4d_query_init_(l4d_query* query, size_t struct_size);
#define l4d_query_init(query) l4d_query_init_((query), sizeof(*(query)))

/* The Gaussians of one bucket. They are contiguous in the decoded arrays, which are ordered by
 * layer, then bucket, then the order in the file. */
typedef struct l4d_bucket_span {
  uint64_t first;
  uint64_t count;
  double center; /* bucket centre, seconds; mean_t_local is relative to it */
  double width;  /* bucket width, seconds */
  uint32_t layer;
  uint32_t bucket;
  uint32_t block;  /* RCQ block of the layer, or L4D_NO_BLOCK */
  uint32_t level;  /* temporal level of the layer */
} l4d_bucket_span; /* frozen */
#define L4D_NO_BLOCK 0xffffffffu

/* Names a Gaussian of a stream. It is the same in every slice and in every query that returns the
 * Gaussian, whatever the detail, the number of threads, and losses of a tolerant decoder. `index`
 * is the place of the Gaussian among all Gaussians of its bucket, in the order of the file: the sum
 * of num_gaussians over the records of the bucket in the directory before that of its page, plus
 * its place in the page. A query that returns complete buckets (ALL, BUCKETS, or whole_buckets = 1)
 * and loses nothing returns it at l4d_bucket_span.first + index. Another encode of the scene gives
 * other ids. */
typedef struct l4d_gaussian_id {
  uint32_t layer;
  uint32_t bucket; /* of the layer */
  uint64_t index;  /* in the bucket */
} l4d_gaussian_id; /* frozen */

/* What a query selects and costs. Computed from the directory; no page is read. */
typedef struct l4d_selection {
  size_t struct_size;
  uint64_t num_gaussians;
  uint64_t num_spans;
  uint64_t num_pages;       /* pages */
  uint64_t bytes;           /* stored bytes that decoding reads of these pages */
  uint64_t directory_bytes; /* stored bytes of the directory that the query needs, cached or not */
  /* Stored bytes of the SH detail of these pages: included in `bytes` in full detail, not included
   * in base colour. */
  uint64_t sh_bytes;
} l4d_selection;
L4D_API void l4d_selection_init_(l4d_selection* selection, size_t struct_size);
#define l4d_selection_init(selection) l4d_selection_init_((selection), sizeof(*(selection)))
L4D_API l4d_status l4d_decoder_select(l4d_decoder* decoder, const l4d_query* query,
                                      l4d_selection* selection);
/* Lists the bucket spans that decoding the query would return. Reads the directory only. With
 * query->whole_buckets = 1 these are the buckets that a player must hold at that time. *count
 * receives their number; the first min(capacity, *count) are written to `out`, which may be NULL if
 * capacity is 0. */
L4D_API l4d_status l4d_decoder_get_spans(l4d_decoder* decoder, const l4d_query* query,
                                         l4d_bucket_span* out, uint64_t capacity, uint64_t* count);

/* A range of bytes of a file: [offset, offset + size). */
typedef struct l4d_byte_range {
  uint64_t offset;
  uint64_t size;
} l4d_byte_range; /* frozen */

/* What the ranges of l4d_decoder_get_reads hold, and what the call itself reads. Each step holds
 * the ranges of the steps before it and reads only those. */
enum {
  L4D_READS_PAGE_TABLES = 0, /* the entries of page tables; the call reads nothing */
  L4D_READS_DIRECTORY = 1,   /* and the directory pages that they name */
  L4D_READS_ALL = 2          /* and codebooks, tables and pages: all that the query needs */
};
/* The bytes of the file that a query needs, for a caller that fetches them itself: a prefetcher, or
 * a client whose reads are asynchronous and whose l4d_reader answers from memory. Once the reader
 * can answer these ranges, l4d_decoder_select, _get_spans, _decode and _decode_packed succeed with
 * the same query, and l4d_decoder_slice where the query is of kind TIME, with the time and the
 * detail of the slice and `whole_buckets` = 1. With a reader whose block_bytes is 0 they ask for no
 * other byte; otherwise they may, and do without it where the reader fails.
 *
 * A client that holds only the bytes that l4d_decoder_open has read calls this once per step, and
 * fetches the returned ranges before the next step. If the reader can block, one call with ALL is
 * enough. A tolerant decoder skips unreadable directory pages and reports them as losses.
 *
 * The ranges are in ascending order, at least one byte apart, and inside the file. They do not
 * depend on what the decoder holds already; neighbouring pages are joined over small gaps, as the
 * decoder reads them. *count is their number; the first min(capacity, *count) go to `ranges`, which
 * may be NULL where capacity is 0.
 * Fails with INVALID_ARGUMENT on an unknown step, and otherwise as l4d_decoder_select does. */
L4D_API l4d_status l4d_decoder_get_reads(l4d_decoder* decoder, const l4d_query* query,
                                         uint32_t step, l4d_byte_range* ranges, uint64_t capacity,
                                         uint64_t* count);

/* Returns the range of the scene header: the only bytes that l4d_decoder_open reads after the first
 * L4D_FILE_HEADER_BYTES. `data`: the first `size` bytes of the file. Does not check the range
 * against the end of the file. Fails with TRUNCATED if size is below L4D_FILE_HEADER_BYTES, and
 * otherwise as l4d_decoder_open does. */
#define L4D_FILE_HEADER_BYTES 40
L4D_API l4d_status l4d_get_header_range(const void* data, size_t size, l4d_byte_range* range);

/* Output arrays, owned by the caller. A NULL array is not decoded and costs no time. If `sh` is
 * NULL, SH detail is not read either. */
typedef struct l4d_gaussian_buffers {
  size_t struct_size;
  uint64_t capacity;   /* Gaussians each array can hold */
  uint64_t count;      /* out */
  float* position;     /* [N, 3] */
  float* mean_t;       /* [N] seconds, rounded to binary32: see mean_t_double */
  float* mean_t_local; /* [N] seconds from the centre of the bucket: full precision at any time */
  float* log_scale;    /* [N, 4] in [-17, 17] */
  float* rotor;        /* [N, 8] unit, unless the stream is lossless */
  float* opacity;      /* [N] in [0, 1]; a logit, of any size, with L4D_OPACITY_LOGIT */
  float* sh;           /* [N, (D+1)^2, 3] */
  l4d_bucket_span* spans; /* [span_capacity] or NULL */
  uint64_t span_capacity;
  uint64_t num_spans; /* out, where spans is given */
  /* [N] seconds in full precision: the range's `center` plus mean_t_local; in lossless streams the
   * value that was encoded. If given, the host decodes, whatever the backend. */
  double* mean_t_double;
  l4d_gaussian_id* id; /* [N] */
  /* [N, 2] frames: begin and end of flat windows, as in l4d_gaussians; 0, 0 in layers without
   * L4D_TOOL_FLAT_WINDOWS. The mean time of a Gaussian with a window is the middle of it. If given,
   * the host decodes, whatever the backend. */
  uint32_t* window;
} l4d_gaussian_buffers;
L4D_API void l4d_gaussian_buffers_init_(l4d_gaussian_buffers* buffers, size_t struct_size);
#define l4d_gaussian_buffers_init(buffers) l4d_gaussian_buffers_init_((buffers), sizeof(*(buffers)))

/* Decodes what the query selects. Reads the pages of the selected buckets, and each codebook on its
 * first use.
 * Fails with BUFFER_TOO_SMALL if capacity or span_capacity is below the selection; `count` and
 * `num_spans` then receive what is needed. On any other failure the arrays hold unspecified
 * values. A tolerant decoder skips lost pages. The remaining Gaussians are contiguous; `count` and
 * the spans' counts exclude the lost ones; spans without a Gaussian are not listed; elements from
 * `count` on hold unspecified values. The capacities must still suffice for the whole selection. */
L4D_API l4d_status l4d_decoder_decode(l4d_decoder* decoder, const l4d_query* query,
                                      l4d_gaussian_buffers* out);

/* Packed form, for players that keep data quantised: the integers of the stream, entropy-decoded
 * and not dequantised. l4d_decoder_get_codebook returns the codebooks. */
typedef struct l4d_packed_component {
  uint8_t* depth;   /* [N] number of stages to add up, 255 = escape; may be NULL */
  uint16_t* index;  /* [num_stages][N], stage s of Gaussian i at s * capacity + i; entries of
                       unused or absent stages are 0 */
  uint16_t* escape; /* [escape_capacity, dim] binary16 bits, in order of their Gaussians */
  uint64_t escape_capacity;
  uint64_t num_escapes; /* out: also set when escape is NULL */
} l4d_packed_component; /* frozen */
typedef struct l4d_packed_buffers {
  size_t struct_size;
  uint64_t capacity;
  uint64_t count;         /* out */
  uint16_t* position;     /* [N, 3] binary16 bits in the coded frame */
  uint16_t* mean_t;       /* [N] binary16 bits, bucket widths from the bucket centre */
  uint16_t* opacity;      /* [N] SQ code */
  uint16_t* scale_factor; /* [N] SQ code */
  l4d_packed_component component[L4D_COMPONENT_COUNT];
  l4d_bucket_span* spans;
  uint64_t span_capacity;
  uint64_t num_spans; /* out, where spans is given */
  uint32_t* window;   /* [N, 2] frames, as in l4d_gaussian_buffers; mean_t is 0 there */
} l4d_packed_buffers;
L4D_API void l4d_packed_buffers_init_(l4d_packed_buffers* buffers, size_t struct_size);
#define l4d_packed_buffers_init(buffers) l4d_packed_buffers_init_((buffers), sizeof(*(buffers)))
/* Decodes to the packed form. Only streams of the profile "indexed" have one; the encoder's presets
 * "indexed*" make them if L4D_ENC_PROFILE is 1. Other streams fail with FEATURE_UNSUPPORTED. A
 * tolerant decoder skips lost pages, and their escapes, as l4d_decoder_decode does. Fails with
 * BUFFER_TOO_SMALL if a capacity is too small. */
L4D_API l4d_status l4d_decoder_decode_packed(l4d_decoder* decoder, const l4d_query* query,
                                             l4d_packed_buffers* out);

/* Returns one codebook as float32. The decoder owns it. It is valid until the stream is closed; a
 * codebook of a block only until the next call that selects, decodes or slices. `block`:
 * L4D_NO_BLOCK, or, for stage 0 of a component with RCQ, a block of the layer. All layers have the
 * same SH codebooks. */
typedef struct l4d_codebook {
  size_t struct_size;
  const float* entries; /* [num_entries, dim]; NULL where the component has no such stage */
  uint32_t num_entries;
  uint32_t dim;
} l4d_codebook;
L4D_API void l4d_codebook_init_(l4d_codebook* codebook, size_t struct_size);
#define l4d_codebook_init(codebook) l4d_codebook_init_((codebook), sizeof(*(codebook)))
L4D_API l4d_status l4d_decoder_get_codebook(l4d_decoder* decoder, uint32_t layer,
                                            uint32_t component, uint32_t stage, uint32_t block,
                                            l4d_codebook* out);

/* How to dequantise the packed integers of a layer:
 *   position = position_center + position_scale * half
 *   opacity = opacity_offset + code * opacity_step, clamped to [0, 1] unless the stream has
 *             L4D_OPACITY_LOGIT
 *   factor = scale_factor_offset + code * scale_factor_step
 *   log_scale[k] = factor + k-th element of the scale vector, clamped to [-17, 17] */
typedef struct l4d_dequantization {
  size_t struct_size;
  float position_center[3];
  float position_scale;
  float opacity_offset, opacity_step;
  float scale_factor_offset, scale_factor_step;
  float log_scale_t; /* permanent layers: temporal log scale of every Gaussian; else 0 */
  uint32_t reserved;
} l4d_dequantization;
L4D_API void l4d_dequantization_init_(l4d_dequantization* out, size_t struct_size);
#define l4d_dequantization_init(out) l4d_dequantization_init_((out), sizeof(*(out)))
L4D_API l4d_status l4d_decoder_get_dequantization(l4d_decoder* decoder, uint32_t layer,
                                                  l4d_dequantization* out);

/* ---- profiles and levels --------------------------------------------------------------------- */

/* The codings that a stream is restricted to (spec chapter "Profiles and levels"). */
enum {
  L4D_PROFILE_NONE = 0,
  L4D_PROFILE_INDEXED = 1, /* has a packed form: codebooks and scalar codes */
  L4D_PROFILE_MAIN = 2,    /* nothing is raw float32 */
  L4D_PROFILE_LOSSLESS = 3 /* all attributes are raw float32 */
};
L4D_API const char* l4d_profile_name(uint32_t profile); /* "main"; static; NULL if unknown */

/* Upper limits of a level. Byte counts are stored (compressed) bytes, except table_bytes and
 * memory_bytes. */
typedef struct l4d_level_limits {
  size_t struct_size;
  const char* name; /* "phone"; static */
  uint64_t instant_gaussians;
  uint64_t table_bytes;
  uint64_t instant_bytes;
  uint64_t start_bytes;
  uint64_t bytes_per_second;
  uint64_t burst_bytes;
  uint64_t memory_bytes;
  uint64_t instant_symbols;    /* of rANS */
  uint64_t symbols_per_second; /* with instant_symbols at once */
} l4d_level_limits;
L4D_API void l4d_level_limits_init_(l4d_level_limits* limits, size_t struct_size);
#define l4d_level_limits_init(limits) l4d_level_limits_init_((limits), sizeof(*(limits)))
/* level: 1..L4D_NUM_LEVELS. profile: L4D_PROFILE_LOSSLESS allows more stored bytes. */
#define L4D_NUM_LEVELS 6
L4D_API l4d_status l4d_get_level_limits(uint32_t level, uint32_t profile, l4d_level_limits* limits);

/* What playing the stream forward at normal speed demands of a player. */
typedef struct l4d_stream_demand {
  size_t struct_size;
  uint32_t profile;              /* the narrowest that the stream meets, L4D_PROFILE_* */
  uint32_t level;                /* the smallest that the stream meets; 0 = none */
  uint64_t instant_gaussians;    /* of the pages that an instant needs, the most of all instants */
  double instant_gaussians_time; /* seconds: the first such instant */
  uint64_t instant_bytes;        /* stored, of these pages and their block codebooks */
  double instant_bytes_time;
  uint64_t memory_bytes; /* tables, and pages and block codebooks of an instant, expanded */
  double memory_time;
  uint64_t table_bytes; /* codebooks and entropy tables, decoded */
  /* Stored, of all that the first instant needs, headers and codebooks included. */
  uint64_t start_bytes;
  /* In: a link, set by the caller. */
  uint64_t bytes_per_second;
  uint64_t burst_bytes;
  /* Out: bytes that a player must buffer before it starts, at bytes_per_second (leaky bucket), and
   * the window of time that determines them, in seconds. */
  uint64_t min_burst_bytes;
  double window_begin, window_end;
  /* Out: lowest rate at which a player that buffers burst_bytes never stalls; UINT64_MAX if a
   * single instant needs more than burst_bytes. */
  uint64_t min_bytes_per_second;
  /* Entropy decoding: symbols of rANS, by the bound that layers declare for each Gaussian. Of the
   * pages that an instant needs, the most of all instants, and the first such instant. */
  uint64_t instant_symbols;
  double instant_symbols_time;
  /* In: symbols that a player has decoded ahead, set by the caller. Out: lowest rate of decoding,
   * in symbols a second, that then keeps up; UINT64_MAX if none does. */
  uint64_t burst_symbols;
  uint64_t min_symbols_per_second;
} l4d_stream_demand;
L4D_API void l4d_stream_demand_init_(l4d_stream_demand* demand, size_t struct_size);
#define l4d_stream_demand_init(demand) l4d_stream_demand_init_((demand), sizeof(*(demand)))
/* Reads the whole directory and no page. Fails on damage, also in a tolerant decoder. */
L4D_API l4d_status l4d_decoder_get_stream_demand(l4d_decoder* decoder, l4d_stream_demand* demand);

/* ---- slicing ------------------------------------------------------------------------------- */

/* 3D Gaussians at one instant. Slices are not normative: implementations agree within rounding. The
 * backends and thread counts of this library give identical values. Covariances are positive
 * semi-definite. All values are finite: a Gaussian whose covariance, or whose position at some time
 * of the sequence, overflows float32 is skipped. Only rotors of lossless streams can cause that. */
typedef struct l4d_splat_buffers {
  size_t struct_size;
  uint64_t capacity;
  uint64_t count;    /* out: number of visible Gaussians, also if the call fails for capacity */
  float* position;   /* [M, 3] */
  float* covariance; /* [M, 6] xx xy xz yy yz zz */
  float* opacity;    /* [M] in [0, 1], temporal falloff applied */
  float* sh;         /* [M, (D+1)^2, 3] */
  /* [M] pointers to the SH coefficients of each Gaussian, [(D+1)^2, 3], in the decoder's cache; use
   * them in place of `sh` to avoid the copy. Valid until the next call that selects, decodes,
   * slices or closes. */
  const float** sh_rows;
  /* Out: the first num_still Gaussians look the same at every instant. */
  uint64_t num_still;
  /* To skip writing the still Gaussians again: pass the same arrays, unchanged, and the still_key
   * that the last call returned. Pass 0 to write everything. Out: the key of the still Gaussians
   * now in the arrays; 0 if all arrays are NULL. */
  uint64_t still_key;
  /* [M, 3] and [M, 4]: the axes of the covariance, R diag(scale)^2 R^T. scale: standard deviations
   * in scene units, >= 0, in falling order. rotation: w x y z, a unit quaternion that takes the
   * axes of the Gaussian to those of the scene. Of the quaternions that do so, the one whose w is
   * no smaller than |x|, |y| and |z|. Each entry of R diag(scale)^2 R^T is within 1e-6 times xx +
   * yy + zz of `covariance`. The decoder finds the axes when it first decodes a bucket for a call
   * that gives one of these arrays, and decodes cached buckets again that lack them. */
  float* scale;
  float* rotation;
  /* [M, 3] red, green, blue: 0.5 + SH in the direction from camera_position to the Gaussian, and at
   * least 0, as the renderer computes it. A Gaussian at camera_position itself is seen along +z.
   * Every call writes the colours of all Gaussians, also of still ones. */
  float* color;
  l4d_gaussian_id* id;       /* [M] */
  double camera_position[3]; /* scene units; used with `color` only */
} l4d_splat_buffers;
L4D_API void l4d_splat_buffers_init_(l4d_splat_buffers* buffers, size_t struct_size);
#define l4d_splat_buffers_init(buffers) l4d_splat_buffers_init_((buffers), sizeof(*(buffers)))
/* Sets the detail of all following slices, including those of a renderer that uses this decoder.
 * detail: L4D_DETAIL_*; FULL at first. Opening another stream keeps it. The cache keeps buckets of
 * both details apart. */
L4D_API l4d_status l4d_decoder_set_detail(l4d_decoder* decoder, uint32_t detail);
/* Sets which layers all following slices show: those of at most this temporal level and this tier;
 * UINT32_MAX, as at first, for all. Opening another stream keeps it. */
L4D_API l4d_status l4d_decoder_set_layers(l4d_decoder* decoder, uint32_t max_level,
                                          uint32_t max_tier);
/* Slices the stream at `time` seconds, clamped to the sequence. Decoded buckets are cached:
 * stepping forward decodes each bucket once. A handle with one thread allocates no memory for an
 * instant whose buckets and directory pages it holds, once it has sliced one of as many pages; a
 * handle with more threads starts them in each call. If all arrays are NULL, only `count` is
 * computed; l4d_selection.num_gaussians of a TIME query is an upper bound of it. Fails with
 * BUFFER_TOO_SMALL if capacity is below `count`, and with INVALID_ARGUMENT if camera_position is
 * not finite and color is given. A tolerant decoder skips lost pages and reads them again in each
 * call, so that `count` grows when the reader recovers. */
L4D_API l4d_status l4d_decoder_slice(l4d_decoder* decoder, double time, l4d_splat_buffers* out);

/* 3D Gaussians at one instant as a structure of arrays, the form that renderers take. */
typedef struct l4d_splat_columns {
  size_t struct_size;
  uint64_t capacity;     /* number of Gaussians that each array has room for */
  uint64_t count;        /* out: number of Gaussians, also if the call fails for capacity */
  float* position[3];    /* [M] each: x, y, z */
  float* covariance[6];  /* [M] each: xx xy xz yy yz zz */
  float* opacity;        /* [M] in [0, 1], temporal falloff applied */
  const float** sh_rows; /* [M] as in l4d_splat_buffers */
  /* As in l4d_splat_buffers. Here every Gaussian that looks the same throughout the sequence is
   * among the first num_still, whichever bucket holds it. */
  uint64_t num_still;
  uint64_t still_key;
  /* In: the call skips Gaussians whose opacity at `time` is below this. It may keep some that are
   * within rounding of it. 0 = skip none. */
  float min_opacity;
  uint32_t reserved;
  /* As in l4d_splat_buffers. All columns of one of these are NULL, or none is. */
  float* scale[3];     /* [M] each */
  float* rotation[4];  /* [M] each: w, x, y, z */
  float* color[3];     /* [M] each: red, green, blue */
  l4d_gaussian_id* id; /* [M], or NULL */
  double camera_position[3];
} l4d_splat_columns;
L4D_API void l4d_splat_columns_init_(l4d_splat_columns* columns, size_t struct_size);
#define l4d_splat_columns_init(columns) l4d_splat_columns_init_((columns), sizeof(*(columns)))
/* Slices the stream at `time` seconds, clamped to the sequence. The Gaussians and their numbers are
 * those of l4d_decoder_slice, in another order. If capacity is 0, only `count` is computed;
 * otherwise position, covariance, opacity and sh_rows must not be NULL.
 * Fails with BUFFER_TOO_SMALL if capacity is above 0 and below `count`; the arrays are unchanged
 * then. Fails with INVALID_ARGUMENT if min_opacity is not a number >= 0, if only some columns of
 * scale, rotation or color are NULL, or if camera_position is not finite and color is given. */
L4D_API l4d_status l4d_decoder_slice_columns(l4d_decoder* decoder, double time,
                                             l4d_splat_columns* out);

/* ---- losses -------------------------------------------------------------------------------- */

/* One loss of a query of a tolerant decoder.
 *   damaged or unreadable      what is lost
 *   page, base chunk           its Gaussians
 *   page, SH chunk             the SH detail of its Gaussians
 *   directory page             the buckets that it lists
 *   codebook of a layer        the pages of the layer
 *   codebook of a block        the pages of the block; nothing in packed form
 *   missing directory entries  the Gaussians that the layer's header counts and no entry lists
 * These fail the query even so: damage to a header or an SH codebook, pages that share stored
 * bytes, more Gaussians in a directory than the layer's header counts, lack of memory, and limits.
 */
typedef struct l4d_loss {
  l4d_status status; /* what a strict decoder returns: IO, TRUNCATED, CORRUPT, CHECKSUM or
                        FEATURE_UNSUPPORTED */
  uint32_t layer;
  uint32_t bucket;      /* of the layer; the first, where there are more */
  uint32_t num_buckets; /* from there on; some of them may be complete */
  uint64_t num_pages;   /* pages; 0 = unknown */
  uint64_t num_gaussians;
  uint64_t offset;    /* byte offset in the file, UINT64_MAX if none */
  const char* clause; /* id of the MUST, "" if none; static */
  /* 1: the Gaussians were decoded in base colour; only their SH detail is lost. */
  uint32_t detail_only;
  uint32_t reserved;
} l4d_loss; /* frozen */
/* Lists the losses of the last call that selected, decoded or sliced, whatever it returned. *count
 * receives their number; the first min(capacity, *count) are written to `out`, which may be NULL if
 * capacity is 0. */
L4D_API l4d_status l4d_decoder_get_losses(const l4d_decoder* decoder, l4d_loss* out,
                                          uint64_t capacity, uint64_t* count);

/* ---- counters and checking ----------------------------------------------------------------- */
typedef struct l4d_counters {
  size_t struct_size;
  uint64_t reads; /* calls of the reader */
  uint64_t bytes_read;
  uint64_t pages_decoded;
  uint64_t buckets_decoded;
  uint64_t cache_hits;   /* buckets */
  uint64_t memory_bytes; /* held now */
  uint64_t peak_memory_bytes;
  /* Sums over all queries of a tolerant decoder: a part that stays lost counts in each query. */
  uint64_t pages_lost;
  /* Including all buckets of lost directory pages, empty or not. */
  uint64_t buckets_lost;
  uint64_t gaussians_lost; /* of lost pages */
  uint64_t details_lost;   /* pages decoded without their SH detail */
} l4d_counters;
L4D_API void l4d_counters_init_(l4d_counters* counters, size_t struct_size);
#define l4d_counters_init(counters) l4d_counters_init_((counters), sizeof(*(counters)))
L4D_API l4d_status l4d_decoder_get_counters(const l4d_decoder* decoder, l4d_counters* counters);

/* One violation. Strings are valid during the callback. */
typedef struct l4d_violation {
  size_t struct_size;
  l4d_status status;
  uint32_t reserved;
  const char* clause; /* id of the MUST, "" if none */
  uint64_t offset;    /* byte offset in the file, UINT64_MAX if none */
  const char* message;
} l4d_violation;
typedef void (*l4d_violation_fn)(void* user, const l4d_violation* violation);

/* Checks a whole file, with all its members, against every MUST that a stream can break, including
 * those that a decoder need not check. Calls `fn`, unless NULL, for each violation, and continues
 * where the rest is still readable. *num_violations receives the number of violations. Returns OK
 * if the check ran to its end, whatever it found; otherwise l4d_last_error_message returns the
 * reason. Time is proportional to the bytes of the file plus the Gaussians that its header states.
 */
L4D_API l4d_status l4d_validate(const l4d_reader* reader, const l4d_decoder_options* options,
                                l4d_violation_fn fn, void* user, uint64_t* num_violations);

/* Checks an open stream against a profile and a level, whatever it declares; 0 = do not check.
 * Calls `fn`, unless NULL, for each broken rule of the spec's chapter "Profiles and levels"; the
 * message says by how much and when. Fails with INVALID_ARGUMENT if the profile or the level is
 * unknown. */
L4D_API l4d_status l4d_decoder_check_conformance(l4d_decoder* decoder, uint32_t profile,
                                                 uint32_t level, l4d_violation_fn fn, void* user,
                                                 uint64_t* num_violations);

/* Registers a callback for the progress of decode calls; NULL removes it. */
L4D_API l4d_status l4d_decoder_set_progress(l4d_decoder* decoder, l4d_progress_fn fn, void* user);

#ifdef __cplusplus
}
#endif
#endif /* L4D_DECODE_H */

/* SPDX-License-Identifier: Apache-2.0
 * decode.h: reading .l4d streams. Safe on untrusted input: every failure is a status.
 *
 *   l4d_decoder* decoder;
 *   l4d_decoder_create(NULL, &decoder);                   // each call returns an l4d_status
 *   l4d_decoder_open_file(decoder, "scene.l4d");
 *   l4d_query query = L4D_INIT(l4d_query);
 *   query.kind = L4D_QUERY_TIME; query.time_begin = 2.5;
 *   l4d_selection selection = L4D_INIT(l4d_selection);
 *   l4d_decoder_select(decoder, &query, &selection);      // number of Gaussians and of bytes
 *   float* position = malloc(selection.num_gaussians * 3 * sizeof *position);
 *   l4d_gaussian_buffers buffers = L4D_INIT(l4d_gaussian_buffers);
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

/* Creates a decoder without a stream. options may be NULL: all defaults.
 * Fails with INVALID_ARGUMENT if an option is out of range, OUT_OF_MEMORY, DEVICE if backend is
 * CUDA and no device can be used, FEATURE_UNSUPPORTED if this build lacks the backend. */
L4D_API l4d_status l4d_decoder_create(const l4d_decoder_options* options, l4d_decoder** out);
L4D_API void l4d_decoder_destroy(l4d_decoder* decoder); /* accepts NULL */

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

/* The codings that a stream is restricted to (spec chapter "Profiles and levels"). */
enum {
  L4D_PROFILE_NONE = 0,
  L4D_PROFILE_INDEXED = 1, /* has a packed form: codebooks and scalar codes */
  L4D_PROFILE_MAIN = 2,    /* nothing is raw float32 */
  L4D_PROFILE_LOSSLESS = 3 /* all attributes are raw float32 */
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
  uint32_t level;   /* conformance level, see l4d_get_level_limits (experimental/inspect.h) */
  /* 1: the file declares the streamable layout: what a player needs first comes first. l4d_validate
   * checks it, l4d_decoder_open does not. */
  uint32_t streamable;
  uint32_t reserved2;
} l4d_info;
L4D_API l4d_status l4d_decoder_get_info(const l4d_decoder* decoder, l4d_info* info);

/* How the stream asks to be drawn and shown; the defaults where it states nothing. */
L4D_API l4d_status l4d_decoder_get_rendering(const l4d_decoder* decoder, l4d_rendering* rendering);
L4D_API l4d_status l4d_decoder_get_presentation(const l4d_decoder* decoder,
                                                l4d_presentation* presentation);

/* What l4d_encoder_add_metadata stored, pair by pair, for people; keys may repeat. Texts are UTF-8
 * that the encoder was given, and lent until another stream is opened or the decoder is destroyed;
 * a zero byte in one ends it. Both are NULL if index is beyond the last pair. */
L4D_API l4d_status l4d_decoder_get_metadata(const l4d_decoder* decoder, uint32_t index,
                                            const char** key, const char** value);

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
L4D_API l4d_status l4d_decoder_get_layer_info(const l4d_decoder* decoder, uint32_t layer,
                                              l4d_layer_info* info);

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
/* How much of a stream a call takes, as of a scalable video: all zero is all of it. What it leaves
 * out is neither read nor decoded. Fails with INVALID_ARGUMENT if the detail is unknown. */
typedef struct l4d_operating_point {
  uint32_t levels; /* number of temporal levels, the coarsest first; 0 = all */
  uint32_t tiers;  /* number of tiers, those that matter most first; 0 = all */
  uint32_t detail; /* L4D_DETAIL_* */
  uint32_t reserved;
} l4d_operating_point; /* frozen */

typedef struct l4d_query {
  size_t struct_size;
  uint32_t kind;
  uint32_t reserved;
  double time_begin; /* seconds; clamped to the sequence */
  double time_end;
  l4d_operating_point point;
  /* For TIME and RANGE. 0: skips the pages in which nothing is visible. 1: returns complete
   * buckets; use this to cache buckets. */
  uint32_t whole_buckets;
  uint32_t reserved2;
  /* For BUCKETS: [num_buckets], borrowed during the call, in strictly ascending order of layer and
   * then bucket. Any other order fails with INVALID_ARGUMENT. Buckets of levels and tiers that are
   * not decoded are skipped. */
  const l4d_bucket* buckets;
  uint64_t num_buckets;
} l4d_query;

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
L4D_API l4d_status l4d_decoder_select(l4d_decoder* decoder, const l4d_query* query,
                                      l4d_selection* selection);
/* Lists the bucket spans that decoding the query would return. Reads the directory only. With
 * query->whole_buckets = 1 these are the buckets that a player must hold at that time. *count
 * receives their number; the first min(capacity, *count) are written to `out`, which may be NULL if
 * capacity is 0. */
L4D_API l4d_status l4d_decoder_get_spans(l4d_decoder* decoder, const l4d_query* query,
                                         l4d_bucket_span* out, uint64_t capacity, uint64_t* count);

/* Output arrays, owned by the caller. A NULL array is not decoded and costs no time. If `sh`
 * and `sh_half` are NULL, SH detail is not read either. */
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
   * L4D_TOOL_FLAT_WINDOWS. The mean time of a Gaussian with a window is the middle of it. */
  uint32_t* window;
  /* [N, (D+1)^2, 3] binary16, each the nearest to that of `sh` (ties to even), within +-65504: half
   * the memory of `sh`, as GPUs take it. The host decodes, whatever the backend. */
  uint16_t* sh_half;
} l4d_gaussian_buffers;

/* Decodes what the query selects. Reads the pages of the selected buckets, and each codebook on its
 * first use.
 * Fails with BUFFER_TOO_SMALL if capacity or span_capacity is below the selection; `count` and
 * `num_spans` then receive what is needed. On any other failure the arrays hold unspecified
 * values. A tolerant decoder skips lost pages. The remaining Gaussians are contiguous; `count` and
 * the spans' counts exclude the lost ones; spans without a Gaussian are not listed; elements from
 * `count` on hold unspecified values. The capacities must still suffice for the whole selection. */
L4D_API l4d_status l4d_decoder_decode(l4d_decoder* decoder, const l4d_query* query,
                                      l4d_gaussian_buffers* out);

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
  /* In: what is shown. The cache keeps buckets of both details apart. */
  l4d_operating_point point;
} l4d_splat_buffers;
/* Slices the stream at `time` seconds, clamped to the sequence. Decoded buckets are cached:
 * stepping forward decodes each bucket once. A handle with one thread allocates no memory for an
 * instant whose buckets and directory pages it holds, once it has sliced one of as many pages; a
 * handle with more threads starts them in each call. If all arrays are NULL, only `count` is
 * computed; l4d_selection.num_gaussians of a TIME query is an upper bound of it. Fails with
 * BUFFER_TOO_SMALL if capacity is below `count`, and with INVALID_ARGUMENT if camera_position is
 * not finite and color is given. A tolerant decoder skips lost pages and reads them again in each
 * call, so that `count` grows when the reader recovers. */
L4D_API l4d_status l4d_decoder_slice(l4d_decoder* decoder, double time, l4d_splat_buffers* out);

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

/* Registers a callback for the progress of decode calls; NULL removes it. */
L4D_API l4d_status l4d_decoder_set_progress(l4d_decoder* decoder, l4d_progress_fn fn, void* user);

#ifdef __cplusplus
}
#endif
#endif /* L4D_DECODE_H */

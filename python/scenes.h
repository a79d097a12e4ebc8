/* SPDX-License-Identifier: Apache-2.0
 * scenes.h: scenes of files, and the distance between two scenes, for the Python module. The C API
 * does not contain these; the folders io and eval do. Functions follow the conventions of l4d.h.
 */
#ifndef L4D_PYTHON_SCENES_H
#define L4D_PYTHON_SCENES_H

#include "l4d/render.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A scene in memory. It never changes, so that several threads may read it. */
typedef struct l4dpy_scene l4dpy_scene;

typedef struct l4dpy_parts {
  l4d_gaussians gaussians;
  l4d_timeline timeline;
  l4d_placement placement;
  l4d_rendering rendering;
  l4d_presentation presentation;
  const char* source; /* name of the format that the scene was read from */
  const char* notes;  /* approximations that the import made, one a line */
} l4dpy_parts;

/* Whether the name of an output promises what is written: `written`, extensions with a space
 * between them. Fails with INVALID_ARGUMENT where its own is that of another format. */
l4d_status l4dpy_check_name(const char* name, const char* written);
/* Sets *out to 1 if l4dpy_read_file has a reader for the file, by its first bytes or its extension.
 * Fails with IO. */
l4d_status l4dpy_is_scene_file(const char* path, int32_t* out);
/* Reads a scene of any format that the tool reads, but for streams. seconds, fps: the timeline of a
 * file that states none; 0 = 1 second, 30 frames a second. activated: 1 if a PLY has opacities and
 * lengths in the columns for logits and logarithms. Fails with IO, CORRUPT, FEATURE_UNSUPPORTED. */
l4d_status l4dpy_read_file(const char* path, double seconds, double fps, int32_t activated,
                           l4dpy_scene** out);
/* Splits positions [count, 3] into a common origin, which is added to the placement, and float32
 * differences from it, `out`, as the tool does with map coordinates. */
void l4dpy_subtract_origin(const double* positions, uint64_t count, l4d_placement* placement,
                           float* out);
/* Reads frames, each a file with a static scene, as one scene. paths: one a line. match: 0 auto, 1
 * order, 2 content, 3 none. errors: [5] position, scale, rotation, color, opacity, as the option
 * --sequence-error of the tool has them; negative = its default. threads: 0 = one per core. If
 * another thread sets *cancel to 1, the call fails with CANCELLED. */
l4d_status l4dpy_read_frames(const char* paths, double fps, int32_t match, const double* errors,
                             uint32_t threads, const int32_t* cancel, l4dpy_scene** out);
/* Decodes all of the first stream of a file. seconds, fps, activated: as for l4dpy_read_file; a
 * stream has no use for them, and notes say so. */
l4d_status l4dpy_read_stream(const l4d_reader* reader, double seconds, double fps,
                             int32_t activated, l4dpy_scene** out);
/* Copies a scene. `source` and `notes` may be NULL. */
l4d_status l4dpy_copy(const l4dpy_parts* parts, l4dpy_scene** out);
/* Sets the first view of the presentation as `l4dcodec encode` does where a scene states none. */
l4d_status l4dpy_state_first_view(l4dpy_parts* parts);
void l4dpy_destroy(l4dpy_scene* scene); /* accepts NULL */
/* The parts of a scene. The arrays are borrowed until the scene is destroyed. */
void l4dpy_get(const l4dpy_scene* scene, l4dpy_parts* out);

/* Writes a PLY with all attributes ("l4d"), one of FreeTimeGS ("ftgs"), a .4dgs ("4dgs"), or raw
 * arrays ("raw"). What the file does not have of the scene goes to `notes`, a sentence a line, cut
 * to `size` bytes. If another thread sets *cancel to 1, it fails with CANCELLED and leaves what was
 * there before. Fails with INVALID_ARGUMENT, IO, INVALID_SCENE, LIMIT_EXCEEDED, and
 * FEATURE_UNSUPPORTED where the format has no flat windows. */
l4d_status l4dpy_write_scene(const l4dpy_scene* scene, const char* format, const char* path,
                             const int32_t* cancel, char* notes, size_t size);
/* Writes the 3D Gaussians of an instant in the format of `extension`: ".ply" for 3DGS, ".spz",
 * ".sog", ".glb" or ".usda". splats: `count` of them, with position, covariance, opacity and sh.
 * setting: its placement, rendering and presentation are used. What the file does not have of them
 * goes to `notes`, a sentence a line, cut to `size` bytes. cancel: as above. Fails with
 * INVALID_ARGUMENT, IO, INVALID_SCENE, LIMIT_EXCEEDED, and FEATURE_UNSUPPORTED where the library
 * has no WebP, which SOG needs. */
l4d_status l4dpy_write_splats(const l4d_splat_buffers* splats, uint32_t sh_degree,
                              const l4dpy_parts* setting, const char* extension, const char* path,
                              const int32_t* cancel, char* notes, size_t size);

/* One error of a comparison. NaN = not measured. */
typedef struct l4dpy_error {
  const char* name;    /* static */
  const char* meaning; /* how it is measured; static */
  double max, rmse, p999;
} l4dpy_error;
#define L4DPY_MAX_ERRORS 32
typedef struct l4dpy_comparison {
  uint64_t count_a, count_b;
  uint64_t matched;    /* pairs */
  uint64_t equal_rows; /* pairs of the same bits */
  uint32_t identical;  /* 1: the same Gaussians bit for bit, in any order */
  uint32_t num_errors;
  char match[16]; /* how Gaussians were paired: "order", "exact", "stated" or "unknown" */
  l4dpy_error errors[L4DPY_MAX_ERRORS];
} l4dpy_comparison;
/* Measures how far `b` is from `a`. order: [num_order], the index in `a` of each Gaussian of `b`,
 * or NULL: Gaussians are then paired by content. threads: 0 = one per core. If
 * another thread sets *cancel to 1, the call fails with CANCELLED. */
l4d_status l4dpy_compare(const l4dpy_scene* a, const l4dpy_scene* b, const uint32_t* order,
                         uint64_t num_order, uint32_t threads, const int32_t* cancel,
                         l4dpy_comparison* out);

/* A file of several streams as one scene (members.h). It belongs to one thread at a time. */
typedef struct l4dpy_movie l4dpy_movie;
typedef struct l4dpy_shown {
  l4d_decoder* decoder;
  double time;  /* seconds of the stream */
  double shift; /* seconds of the file less seconds of the stream */
} l4dpy_shown;
/* Opens a file, of which `timeline` is that of the first stream. *out is NULL if the file is one
 * stream that shows all of its sequence at its own times: a decoder alone then shows the file,
 * and so it does if the members cannot be listed. reader->user is used until the movie is
 * destroyed. Fails as l4d_members_open and l4d_decoder_open do. */
l4d_status l4dpy_movie_open(const l4d_reader* reader, const l4d_decoder_options* options,
                            const l4d_timeline* timeline, l4dpy_movie** out);
void l4dpy_movie_destroy(l4dpy_movie* movie); /* accepts NULL */
/* The timeline and the Gaussians of all streams. *first receives the decoder of the first stream
 * that shows something, which is borrowed until l4dpy_movie_show. */
l4d_status l4dpy_movie_get(l4dpy_movie* movie, l4d_timeline* timeline, uint64_t* num_gaussians,
                           l4d_decoder** first);
/* The streams that show `time` (seconds, limited to the file), each with an open decoder that is
 * borrowed until the next call of this function. *count receives their number; the first
 * min(capacity, *count) are written to `out`. */
l4d_status l4dpy_movie_show(l4dpy_movie* movie, double time, l4dpy_shown* out, uint64_t capacity,
                            uint64_t* count);

/* The cameras of a file that the tool reads (docs/formats.md). *count receives their number; the
 * first min(capacity, *count) are written to `out`, and their ids to `ids`. What was assumed goes
 * to `notes`, a sentence a line, cut to `size` bytes. */
l4d_status l4dpy_read_cameras(const char* path, l4d_camera* out, int32_t* ids, uint64_t capacity,
                              uint64_t* count, char* notes, size_t size);

#ifdef __cplusplus
}
#endif
#endif /* L4D_PYTHON_SCENES_H */

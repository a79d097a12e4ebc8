// SPDX-License-Identifier: Apache-2.0
// Encoding and decoding in one line, comparing bits.
#pragma once

#include <gtest/gtest.h>

#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "l4d/experimental/columns.h"
#include "l4d/experimental/parameters.h"
#include "l4d/l4d.hpp"
#include "libl4dcodec/base/bytes.h"
#include "tests/common/test_scene.h"

namespace l4d::test {

struct Setting {
  const char* name;  // of a parameter
  double value;
};

struct EncodeOptions {
  const char* preset = "indexed";
  bool rans = false;  // pages of streams, which tests can take apart, unless set
  std::vector<Setting> settings;
  std::vector<std::pair<const char*, std::vector<double>>> stages;  // L4D_ENC_STAGES, fractions
  uint32_t threads = 1;
  uint64_t seed = 0;
  std::vector<std::pair<uint32_t, const std::vector<float>*>> weights;  // L4D_WEIGHT_*, [n]
  uint32_t metric = L4D_SENSITIVITY_SUM;                                // of weights
  uint32_t views = L4D_WEIGHT_VIEWS_UNKNOWN;                            // of weights
  const std::vector<float>* min_sizes = nullptr;                        // [n]
  std::vector<double> tiers;                                            // shares
};

struct Encoded {
  Bytes bytes;
  l4d_encode_report report;
  std::vector<uint32_t> order;
};

// Small codebooks and thin layers, so that a small scene has all kinds of layers and chunks.
EncodeOptions small_options();

// Throw l4d::Error.
Encoded encode(const TestScene& scene, const EncodeOptions& options);
// Of options.weights and the like, borrowed.
l4d_importance importance_of(const TestScene& scene, const EncodeOptions& options);
void prepare_encoder(const TestScene& scene, const EncodeOptions& options,
                     const EncoderHandle& encoder);
// Of an encoder whose calls of the caller are as many in each run: threads share pages, and which
// of them is asked differs.
l4d_encoder_options one_thread();

// The seeded scenes that many tests share, encoded once per process.
const Bytes& dynamic_file();    // several layers, a permanent one, motion, small pages
const Bytes& staged_file();     // residual stages and escapes
const Bytes& rcq_file();        // block codebooks
const Bytes& transform_file();  // the default preset: rANS pages, transforms, fixed positions
const Bytes& lossless_file();
// One bucket of many pages, each visible for a time of its own: where a Gaussian is tells when it
// lives, and pages follow places.
const Bytes& wandering_file();
const Bytes& tiny_file();  // a few hundred bytes to a few kB: for exhaustive damage

// One of them as a test parameter.
struct NamedFile {
  const char* name;
  const Bytes& (*bytes)();
};
inline std::ostream& operator<<(std::ostream& out, const NamedFile& f) { return out << f.name; }
inline std::string file_name(const testing::TestParamInfo<NamedFile>& file) {
  return file.param.name;
}

l4d_decoder_options decoder_options(uint32_t backend, uint32_t threads);
l4d_query all_query();
l4d_query time_query(double time);
l4d_query range_query(double begin, double end);
// Of one stream.
inline l4d_status slice_columns(l4d_decoder* decoder, double time, l4d_splat_columns* out) {
  const l4d_shown_stream stream{decoder, time};
  return l4d_slice_streams_columns(&stream, 1, out);
}
GaussianArrays decode(const Bytes& bytes, const l4d_query& query,
                      uint32_t backend = L4D_BACKEND_AUTO, uint32_t threads = 1);

// Equality of bits, so that -0 and NaN count.
testing::AssertionResult same_bits(const char* what, const std::vector<float>& a,
                                   const std::vector<float>& b);
testing::AssertionResult same_bits(const GaussianArrays& a, const GaussianArrays& b);
testing::AssertionResult same_bits(const SplatArrays& a, const SplatArrays& b);

struct Violation {
  l4d_status status;
  std::string clause;
  uint64_t offset;
  std::string message;
};
// What l4d_validate reports; its own status must be OK.
std::vector<Violation> validate(const Bytes& bytes);

// A reader over bytes that must outlive it.
l4d_reader memory_reader(const Bytes& bytes);

// A file name in the temporary directory of the test run, unique in the process.
std::string temporary_path(const std::string& suffix);

}  // namespace l4d::test

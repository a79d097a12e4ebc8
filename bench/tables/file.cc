// SPDX-License-Identifier: Apache-2.0
// tables_file [--runs N] FILE..: how fast one thread decodes given streams: all attributes, without
// SH detail, and positions alone, in CPU time. It needs nothing but the public headers, so that it
// also builds against an older version of the library, to compare the two. OLD is a tree with its
// build:
//   c++ -std=c++17 -O2 -I OLD/include -I OLD/build/release/include bench/tables/file.cc
//     OLD/build/release/api/libl4dcodec.a -lzstd -lhwy -lxxhash -pthread
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include "l4d/attributes.hpp"
#include "l4d/decode.h"

namespace {

constexpr int kRuns = 15;
// A run decodes until this much CPU time has passed, as clocks are coarse beside small files.
constexpr double kLeastSeconds = 0.05;

struct Destroy {
  void operator()(l4d_decoder* decoder) const { l4d_decoder_destroy(decoder); }
};
using Decoder = std::unique_ptr<l4d_decoder, Destroy>;

// Arrays for all attributes, and for mean times relative to their bucket.
struct Arrays {
  std::vector<std::vector<float>> all;

  l4d_gaussian_buffers buffers(size_t count, uint32_t sh_degree) {
    l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
    b.capacity = count;
    l4d::for_each_decoded(
        [&](const l4d::AttributeInfo& a, float*& to) {
          all.emplace_back(count * a.numbers(sh_degree));
          to = all.back().data();
        },
        b);
    return b;
  }
};

double cpu_seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

bool report(const char* path) {
  std::fprintf(stderr, "%s: %s\n", path, l4d_last_error_message());
  return false;
}

// The median of million Gaussians a second of CPU time; 0 if a decode fails.
double speed(l4d_decoder* decoder, const l4d_query& query, l4d_gaussian_buffers buffers, int runs) {
  const auto decode = [&] { return l4d_decoder_decode(decoder, &query, &buffers) == L4D_OK; };
  if (!decode()) return 0;
  std::vector<double> speeds;
  for (int run = 0; run < runs; ++run) {
    uint64_t count = 0;
    double seconds = 0;
    for (const double begin = cpu_seconds(); seconds < kLeastSeconds;) {
      if (!decode()) return 0;
      count += buffers.count;
      seconds = cpu_seconds() - begin;
    }
    speeds.push_back(static_cast<double>(count) / seconds / 1e6);
  }
  std::sort(speeds.begin(), speeds.end());
  return speeds[speeds.size() / 2];
}

bool print_file(const char* path, int runs) {
  l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
  options.threads = 1;
  options.backend = L4D_BACKEND_CPU;
  l4d_decoder* made = nullptr;
  if (l4d_decoder_create(&options, &made) != L4D_OK) {
    std::fprintf(stderr, "%s\n", l4d_last_error_message());
    return false;
  }
  const Decoder decoder(made);
  l4d_info info = L4D_INIT(l4d_info);
  if (l4d_decoder_open_file(made, path) != L4D_OK) return report(path);
  if (l4d_decoder_get_info(made, &info) != L4D_OK) return report(path);
  Arrays arrays;
  const l4d_gaussian_buffers all =
      arrays.buffers(static_cast<size_t>(info.num_gaussians), info.sh_degree);
  l4d_gaussian_buffers positions = L4D_INIT(l4d_gaussian_buffers);
  positions.capacity = all.capacity;
  positions.position = all.position;
  l4d_query full = L4D_INIT(l4d_query);
  l4d_query base = full;
  base.point.detail = L4D_DETAIL_BASE_COLOR;
  const double results[] = {speed(made, full, all, runs), speed(made, base, all, runs),
                            speed(made, full, positions, runs)};
  if (*std::min_element(std::begin(results), std::end(results)) == 0) return report(path);
  std::printf("| %s | %llu | %llu | %.1f | %.1f | %.1f |\n", path,
              static_cast<unsigned long long>(info.num_gaussians),
              static_cast<unsigned long long>(info.file_bytes), results[0], results[1], results[2]);
  std::fflush(stdout);
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  int first = 1, runs = kRuns;
  if (argc > 2 && std::strcmp(argv[1], "--runs") == 0) {
    runs = std::atoi(argv[2]);
    first = 3;
  }
  if (first >= argc || runs < 1) {
    std::fprintf(stderr, "usage: tables_file [--runs N] FILE..\n");
    return 2;
  }
  std::printf(
      "One thread, median of %d runs, million Gaussians a second of CPU time:\n\n"
      "| file | Gaussians | bytes | all | base colours | positions |\n"
      "|---|---:|---:|---:|---:|---:|\n",
      runs);
  bool good = true;
  for (int i = first; i < argc; ++i) good = print_file(argv[i], runs) && good;
  return good ? 0 : 1;
}
